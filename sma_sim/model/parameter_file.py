"""The commented YAML file of parameters: config/module.yaml, and what `sma-sim init` writes, from one place."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from decimal import Decimal

from sma_sim.model.config import AUTO, MODELS, Config, folders_of, settings_of, with_unit
from sma_sim.model.likely_unit import likely_unit
from sma_sim.model.parameters import PAPER, Parameter
from sma_sim.model.program_parameters import GROUPS, Setting
from sma_sim.model.structures.discovery import package_structures
from sma_sim.model.structures.structure import Structure

HEAD = f"""\
# Parameters of sma_sim: a ROS 2 parameter file that the offline commands read too.
# Values of {PAPER}, unless a comment says otherwise. SI units.
/**:
  ros__parameters:
"""
KINETICS = f'{" | ".join(MODELS)}; {AUTO}: simulations are {MODELS[0]}, fits take the more probable of both'
KNOWN = 'standard deviations of values above as they are known before a fit, in their units'
TOGETHER = 'of fitted values, row by row: of logarithms of what is positive by nature, else in their units'
ACTIVE = 'names of effects to switch on, such as [gravity, natural_convection]; list: sma-sim effects'
PATHS = 'folders with effect files of your own; relative ones start at this file'
STRUCTURE_PATHS = 'folders with structure files of your own; relative ones start at this file'


def parameter_file(config: Config, effect_paths: Sequence[str] = (), structure_paths: Sequence[str] | None = None) -> str:
    """The text of a ROS 2 parameter file with every parameter of `config`: unit, meaning, and default where changed.

    `effect_paths` and `structure_paths` are the folders of the user's effects and structure, as they are to stand in the
    file; the latter are absolute unless they are given.
    """
    found = package_structures()
    plain = (name for name, each in found.items() if not each.variant_of)
    systems = list(dict.fromkeys([*plain, config.system]))
    lines = [f'system: {config.system}  # {" | ".join(systems)}', f'model: {config.kinetics}  # {KINETICS}']
    settings = settings_of(config.structure).items()
    for group, members in groups_of(config.structure).items():
        lines += [f'{group}:', *(f'  {line(p, config.parameters[f"{group}.{p.name}"])}' for p in members)]
        lines += [f'  {setting_line(name, setting, config)}' for name, setting in settings if name.startswith(f'{group}.')]
    lines += [*effect_lines(config, effect_paths), *prior_lines(config), *covariance_lines(config)]
    paths = folders_of(config.structure) if structure_paths is None else structure_paths
    lines += ['structures:', f'  paths: {words(paths)}  # {STRUCTURE_PATHS}']
    return HEAD + ''.join(f'    {line}\n' for line in lines)


def groups_of(structure: Structure) -> dict[str, tuple[Parameter, ...]]:
    """The parameters of a model with this structure, by group; those of other structures are left out."""
    others = {name.partition('.')[0] for found in package_structures().values() for name in found.declared}
    own: dict[str, list[Parameter]] = {}
    for name, parameter in structure.declared.items():
        group, _, short = name.partition('.')
        own.setdefault(group, []).append(replace(parameter, name=short))
    kept = {group: members for group, members in GROUPS.items() if group not in others - set(own)}
    kept['initial'] += tuple(replace(parameter, name=parameter.name.partition('.')[2]) for parameter in structure.initial)
    kept['check'] += tuple(structure.noise.values())
    return kept | {group: tuple(members) for group, members in own.items()}


def effect_lines(config: Config, paths: Sequence[str]) -> Iterator[str]:
    """The active effects and their parameters."""
    yield 'effects:'
    yield f'  active: {words([active.effect.name for active in config.effects])}  # {ACTIVE}'
    yield f'  paths: {words(paths)}  # {PATHS}'
    for active in config.effects:
        yield f'  {active.effect.name}:'
        for parameter, value in zip(active.effect.parameters, active.values, strict=True):
            yield f'    {line(parameter, value)}'


def prior_lines(config: Config) -> Iterator[str]:
    """How well values are known before a fit."""
    if config.priors:
        yield f'priors:  # {KNOWN}'
    for name, std in config.priors.items():
        yield f'  {name}: {yaml_number(std)}'


def covariance_lines(config: Config) -> Iterator[str]:
    """How well fitted values are known together."""
    if config.covariance is None:
        return
    yield f'covariance:  # {TOGETHER}'
    yield f'  names: {words(config.covariance.names)}'
    rows = [', '.join(map(yaml_number, row)) for row in config.covariance.matrix.tolist()]
    yield from ('  matrix: [', *(f'    {row},' for row in rows[:-1]), f'    {rows[-1]}]')


def line(parameter: Parameter, value: float) -> str:
    """``name: value  # [unit] meaning``."""
    same = value == parameter.default or math.isnan(value) and math.isnan(parameter.default)
    note = f'; default {yaml_number(parameter.default)}' if not same else ''
    source = f'; {parameter.source}' if same and parameter.source not in ('', PAPER) else ''
    number = f"'{with_unit(value, parameter)}'" if likely_unit(parameter, value)[0] else yaml_number(value)
    return f'{parameter.name}: {number}  # [{parameter.unit}] {parameter.description}{source}{note}'


def setting_line(name: str, setting: Setting, config: Config) -> str:
    """A text or a switch of the node."""
    value = config.settings.get(name, setting.default)
    text = str(value).lower() if isinstance(value, bool) else words([value])[1:-1]
    return f'{name.rpartition(".")[2]}: {text}  # {setting.description}'


def yaml_number(value: float) -> str:
    """A number that YAML and ROS read back as the same double: with a point, and a sign in the exponent."""
    if math.isnan(value):
        return '.nan'
    if value == 0.0 or 1e-4 <= abs(value) < 1e5:
        return repr(value)
    exact = Decimal(repr(value)).normalize()
    exponent = exact.adjusted() // 3 * 3
    mantissa = f'{exact.scaleb(-exponent):f}'
    return f'{mantissa if "." in mantissa else mantissa + ".0"}e{exponent:+d}'


def words(names: Sequence[str]) -> str:
    """A list of words; ROS 2 cannot write an empty one."""
    quoted = (name.replace("'", "''") for name in names or [''])
    return '[' + ', '.join(f"'{name}'" for name in quoted) + ']'
