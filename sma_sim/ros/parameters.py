"""Parameters of the node: read from ROS, checked like those of the offline commands, declared with descriptors."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor, ParameterType, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from sma_sim.model.config import AUTO, MODELS, Config, checked, names_of_effects, settings_of
from sma_sim.model.effects.discovery import effects_on, find_effects
from sma_sim.model.given import LISTS, RawValue, given_in_file, given_over, named_folders
from sma_sim.model.likely_unit import unit_hint
from sma_sim.model.parameter_yaml import ConfigError, NothingForNode, belongs_to_ros
from sma_sim.model.parameters import Parameter as NumberParameter
from sma_sim.model.program_parameters import DEFAULTS
from sma_sim.model.structures.discovery import package_structures
from sma_sim.ros.command import ENVIRONMENT
from sma_sim.ros.qos import GIVEN

REAL_TIME_FACTOR, STEPS_PER_CALL = 'node.real_time_factor', 'node.steps_per_call'
LIVE = (ENVIRONMENT,)  # what every node of ours lets a user set while it runs
LIST_DESCRIPTIONS = {
    'effects.active': 'names of the active effects',
    'effects.paths': "folders of the user's own effects; relative ones start at the parameter file",
    'structures.paths': "folders of the user's own structures; relative ones start at the parameter file",
}
CHOICE_DESCRIPTIONS = {'system': 'what is simulated', 'model': f'kinetics of the wires; {AUTO}: {MODELS[0]} here'}


class Arguments(NamedTuple):
    """The arguments of a node without its parameter files, and what those say, by full name."""

    words: list[str]
    given: dict[str, RawValue]


def read_arguments(words: Sequence[str], name: str) -> Arguments:
    """Read the parameter files among the ROS arguments of a node, as the offline commands read them.

    Of files and ``-p``, the later argument wins, as in rcl. Raises ConfigError for a file that is wrong, and where no file
    has anything for the node.
    """
    node = full_name(words, name)
    given: dict[str, RawValue] = {}
    left, useless, useful, of_ros, k = list[str](), list[ConfigError](), False, False, 0
    while k < len(words):
        word, after = words[k], words[k + 1] if k + 1 < len(words) else None
        of_ros = word == '--ros-args' or of_ros and word != '--'
        if of_ros and word == '--params-file' and after is not None:
            try:
                given = given_over(given, given_in_file(Path(after), node))
                useful = True
            except NothingForNode as error:
                useless.append(error)
            k += 2
            continue
        if of_ros and word in ('-p', '--param') and after is not None:
            whose, _, parameter = after.partition(':=')[0].rpartition(':')
            if whose == '' or f'/{whose}' == node:  # as in rcl: of another node, or of one in a namespace, it says nothing
                given.pop(parameter, None)
        left.append(word)
        k += 1
    if useless and not useful:
        raise useless[0]
    return Arguments(left, given)


def full_name(words: Sequence[str], name: str) -> str:
    """The name of a node with its namespace, by the rules of remapping among its arguments."""
    found = {'__ns': '', '__node': name}
    for word, after in zip(words, words[1:], strict=False):
        if word in ('-r', '--remap'):
            rule, _, target = after.partition(':=')
            node, _, key = rule.rpartition(':')
            if node in ('', name):
                found['__node' if key == '__name' else key] = target
    space = found['__ns'].strip('/')
    return f'/{space}/{found["__node"]}' if space else f'/{found["__node"]}'


def overrides_of(given: Mapping[str, RawValue]) -> list[Any]:
    """What files say that belongs to ROS, for the node to be made with."""
    return [Parameter(name, value=one.value) for name, one in given.items() if belongs_to_ros(name)]


def given_to(node: Node) -> dict[str, RawValue]:
    """What was given to the node itself, by name (it was made to declare all that was given)."""
    given = {}
    for name, parameter in node.get_parameters_by_prefix('').items():
        if not belongs_to_ros(name):
            value = parameter.value
            given[name] = RawValue(list(value) if hasattr(value, 'tolist') else value, GIVEN)
    return given


def configure(node: Node, live: Collection[str] = LIVE, in_files: Mapping[str, RawValue] = MappingProxyType({})) -> Config:
    """Check what was given, declare every parameter, and return the configuration.

    Numbers in `live` may be set while the node runs, all else is read-only then; `in_files` is what parameter files say.
    Raises UserError.
    """
    own = given_to(node)
    given = given_over({name: one for name, one in in_files.items() if not belongs_to_ros(name)}, own)
    config = checked(given)
    for name in own:
        node.undeclare_parameter(name)
    for name, parameter in config.structure.all_parameters.items():
        declare_number(node, name, parameter, config.parameters[name], name in live)
    found = package_structures().items()
    systems = dict.fromkeys((*(name for name, one in found if one.has_own_columns), config.system))
    for name, value, choices in (
        ('system', config.system, tuple(systems)),
        ('model', config.simulated_kinetics, (*MODELS, AUTO)),
    ):
        words = ParameterDescriptor(
            description=CHOICE_DESCRIPTIONS[name],
            read_only=True,
            type=ParameterType.PARAMETER_STRING,
            additional_constraints=f'one of {", ".join(choices)}',
        )
        node.declare_parameter(name, value, words, ignore_override=True)
    for name, setting in settings_of(config.structure).items():
        kind = ParameterType.PARAMETER_BOOL if isinstance(setting.default, bool) else ParameterType.PARAMETER_STRING
        words = ParameterDescriptor(description=setting.description, read_only=True, type=kind)
        node.declare_parameter(name, config.settings[name], words, ignore_override=True)
    declare_effects(node, config, given)
    return config


def declare_effects(node: Node, config: Config, given: Mapping[str, RawValue]) -> None:
    """Declare the lists of effects and the parameters of all that were found."""
    for name in LISTS:
        value = given[name].value if name in given else ['']
        words = ParameterDescriptor(
            description=LIST_DESCRIPTIONS[name], read_only=True, type=ParameterType.PARAMETER_STRING_ARRAY
        )
        node.declare_parameter(name, value, words, ignore_override=True)
    values_by_name = {active.effect.name: active.values for active in config.effects}
    found = find_effects(named_folders('effects.paths', given.get('effects.paths', RawValue([], ''))))
    found = effects_on(found, names_of_effects(given), config.structure, config.parameters)
    for name, entry in found.items():
        values = values_by_name.get(name, tuple(p.default for p in entry.parameters))
        for parameter, value in zip(entry.parameters, values, strict=True):
            declare_number(node, f'effects.{name}.{parameter.name}', parameter, value)


def declare_number(node: Node, name: str, parameter: NumberParameter, value: float, live: bool = False) -> None:
    """Declare one number with its unit, range and description."""
    low, high = parameter.bounds
    # rclpy compares with the range, which NaN (chosen at the start) would fail
    bounds: list[Any] = [] if math.isnan(value) else [FloatingPointRange(from_value=low, to_value=high, step=0.0)]
    descriptor = ParameterDescriptor(
        description=f'{parameter.description} [{parameter.unit}]',
        type=ParameterType.PARAMETER_DOUBLE,
        read_only=not live,
        floating_point_range=bounds,
        additional_constraints=f'{low:g} to {high:g} {parameter.unit}',
    )
    node.declare_parameter(name, float(value), descriptor, ignore_override=True)


def follow_live_parameters(node: Node, apply: Mapping[str, Callable[[], object]], use_sim_time: bool) -> None:
    """Call the function of a parameter whenever it has a new value; `apply` has those that a user may set.

    A new value is only validated before it is set: another parameter of the same request may still be refused.
    """

    def validate(parameters: list[Any]) -> SetParametersResult:
        for parameter in parameters:
            wrong = ''
            if parameter.name in apply and parameter.type_ == Parameter.Type.DOUBLE:  # rclpy refuses the other types
                wrong = refused_value(parameter.name, float(parameter.value), use_sim_time)
            elif parameter.name == 'use_sim_time' and parameter.value != use_sim_time:
                wrong = 'use_sim_time: give it when the node starts (-p use_sim_time:=true)'
            if wrong:
                return SetParametersResult(successful=False, reason=wrong)
        return SetParametersResult(successful=True)

    def apply_values(parameters: list[Any]) -> None:
        for name in {parameter.name for parameter in parameters} & set(apply):
            apply[name]()

    node.add_on_set_parameters_callback(validate)
    node.add_post_set_parameters_callback(apply_values)


def refused_value(name: str, value: float, use_sim_time: bool) -> str:
    """Why a number that may be set while the node runs is refused; empty where it is not."""
    if name == REAL_TIME_FACTOR and use_sim_time:
        return f'{name}: with use_sim_time, /clock sets the pace'
    if name == STEPS_PER_CALL and value % 1.0 != 0.0:
        return f'{name} = {value}: expected a whole number of steps'
    (low, high), unit = DEFAULTS[name].bounds, DEFAULTS[name].unit
    if low <= value <= high:
        return ''
    return f'{name} = {value} {unit}: expected {low:g} to {high:g} {unit}{unit_hint(DEFAULTS[name], value)}'
