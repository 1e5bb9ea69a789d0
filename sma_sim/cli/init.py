"""`sma-sim init`: write a parameter file for the user's own robot, asked for or given as flags."""

from __future__ import annotations

import argparse
import math
import re
import sys
from collections.abc import Mapping
from decimal import Decimal
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from sma_sim.cli.common.commands import add_command
from sma_sim.cli.common.config_options import add_config_options, announce_first_compilation, folders_beside
from sma_sim.evidence.data.display_units import ZERO_CELSIUS
from sma_sim.evidence.data.tables import check_writable, write_whole
from sma_sim.model.config import Config, read_config
from sma_sim.model.errors import UserError
from sma_sim.model.layout import O_EPS, O_SIGMA
from sma_sim.model.parameter_file import yaml_number
from sma_sim.model.program_parameters import DEFAULTS
from sma_sim.solver.inputs import module_input
from sma_sim.solver.model import Model
from sma_sim.solver.simulate import new_run, new_work, simulate, uninterrupted
from sma_sim.workflow.code_folders import parameter_file_at


class Question(NamedTuple):
    """A quantity as people measure it: `scale` times it is the parameter (a diameter is twice a radius)."""

    flag: str
    parameter: str
    unit: str
    words: str
    scale: float = 1.0

    @property
    def si(self) -> str:
        """SI unit of the parameter."""
        return DEFAULTS[self.parameter].unit

    def value(self, text: str) -> float:
        """The parameter's value that `text` stands for, within its bounds. Raises UserError."""
        value = self.scale * to_si(text, self.si, self.unit)
        low, high = DEFAULTS[self.parameter].bounds
        if not low <= value <= high:
            raise UserError(f'{text.strip()} is out of range: expected {self.show(low)} to {self.show(high)}')
        return value

    def show(self, value: float) -> str:
        """The parameter's value as people say it."""
        return in_unit(value / self.scale, self.si, self.unit)


QUESTIONS = (
    Question('beam-length', 'beam.L', 'mm', 'length of the beam'),
    Question('beam-diameter', 'beam.h', 'mm', 'diameter of the beam', 0.5),
    Question('beam-modulus', 'beam.E', 'GPa', "Young's modulus of the beam"),
    Question('plate-width', 'plate.W', 'mm', 'distance of the two bundles at the plate'),
    Question('plate-mass', 'plate.m_H', 'g', 'mass of the plate'),
    Question('wires', 'wire.n', '', 'wires in one bundle'),
    Question('wire-diameter', 'wire.r0', 'mm', 'diameter of one wire', 0.5),
    Question('wire-length', 'wire.l0', 'mm', 'length of a wire when hot and unloaded'),
    Question('ambient', 'environment.T_E', 'degC', 'ambient temperature'),
    Question('power-limit', 'node.J_max', 'W', 'largest heating power of one bundle'),
)
NOTHING_WRITTEN = 'nothing was written'
MODULE = 'module'  # whose dimensions are asked for


def add_parser(verbs: Any) -> None:
    """Declare the verb."""
    parser = add_command(verbs, 'init')
    parser.description = (
        f'{parser.description} On a terminal it asks for the dimensions. With a dimension among the options, or without a '
        'terminal, it does not ask; what is not given is taken from --config, else from the paper.'
    )
    parser.add_argument(
        '--out', type=Path, default=Path('robot.yaml'), metavar='FILE', help='parameter file to write (default: robot.yaml)'
    )
    parser.add_argument('--overwrite', action='store_true', help='replace FILE')
    parser.add_argument(
        '--system', metavar='NAME', help='structure of the robot (default: module); sma-sim systems lists them'
    )
    parser.add_argument(
        '--no-questions', action='store_true', help='take all dimensions from the options, without questions'
    )
    for question in QUESTIONS:
        units = f'; in {question.unit}, or with its unit ({typed_units(question.si)})' if question.unit else ''
        parser.add_argument(f'--{question.flag}', metavar='VALUE', help=question.words + units)
    add_config_options(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Ask or take the flags, check that the robot can stand, write the file."""
    check_output_file(arguments.out, arguments.overwrite)
    values = values_of_flags(arguments)
    asking = sys.stdin.isatty() and not (values or arguments.words or arguments.effects or arguments.no_questions)
    if arguments.system:
        arguments.words = [f'system={arguments.system}', *arguments.words]
    config = read_config(arguments.config, arguments.words, arguments.effects)
    check_flags(values, config)
    asking = asking and config.system == MODULE
    config = asked(arguments, config) if asking else config_with_values(arguments, values)
    if not asking:
        print_robot_check(config)
    text = parameter_file_at(arguments.out, config, folders_beside(arguments, arguments.out))
    check_output_file(arguments.out, arguments.overwrite)  # once more: answers take a while
    write_whole(arguments.out, lambda file: file.write(text))
    print(arguments.out)
    return 0


def check_output_file(out: Path, overwrite: bool) -> None:
    """Raise UserError where the file cannot be written or is there already."""
    check_writable(out)
    if out.exists() and not overwrite:
        raise UserError(f'{out} exists already: give --overwrite to replace it, or another file with --out')


def values_of_flags(arguments: argparse.Namespace) -> dict[str, float]:
    """The dimensions among the options. Raises UserError."""
    values = {}
    for question in QUESTIONS:
        text = getattr(arguments, question.flag.replace('-', '_'))
        if text is not None:
            try:
                values[question.parameter] = question.value(text)
            except UserError as error:
                raise UserError(f'--{question.flag}: {error}') from error
    return values


def check_flags(values: Mapping[str, float], config: Config) -> None:
    """Raise UserError for a dimension that the structure does not have."""
    foreign = [
        question.flag
        for question in QUESTIONS
        if question.parameter in values and config.system != MODULE and question.parameter.startswith(('beam.', 'plate.'))
    ]
    if foreign:
        own = ', '.join(config.structure.declared)
        raise UserError(f'--{foreign[0]}: a {config.system} has none; give its own with --set, which are {own}')


def config_with_values(arguments: argparse.Namespace, values: Mapping[str, float]) -> Config:
    """The configuration of the options with `values` over it; a value given twice is refused."""
    twice = [word for word in arguments.words if word.partition('=')[0].strip() in values]
    if twice:
        flag = next(question.flag for question in QUESTIONS if question.parameter == twice[0].partition('=')[0].strip())
        raise UserError(f'--set {twice[0]} and --{flag} say the same: give one of them')
    words = [f'{name}={yaml_number(value)}' for name, value in values.items()]
    return read_config(arguments.config, [*arguments.words, *words], arguments.effects)


def print_robot_check(config: Config) -> None:
    """Say how the robot rests and what heating does to it. Raises UserError when it cannot stand."""
    structure = config.structure
    if not structure.coordinates:
        return
    announce_first_compilation()
    if config.system == MODULE:
        print(at_rest(config), when_heated(config), sep='\n', file=sys.stderr)
        return
    model, still = Model(config), np.zeros(len(structure.input_columns))
    still[-1] = config.parameters['environment.T_E']
    new_run(model, still, new_work(model))


def asked(arguments: argparse.Namespace, config: Config) -> Config:
    """The user's answers, asked for again when they make no robot."""
    print('Your robot: type a value (a unit may follow), or just Enter for the one in brackets. Ctrl-C stops.')
    while True:
        values = {question.parameter: ask(question, config.parameters[question.parameter]) for question in QUESTIONS}
        config = config_with_values(arguments, values)
        try:
            print_robot_check(config)
        except UserError as error:
            print(f'This robot cannot be simulated: {error}.\nPlease answer again; your answers are in the brackets:')
        else:
            return config


def ask(question: Question, before: float) -> float:
    """One answer, asked for until it makes sense."""
    while True:
        try:
            text = input(f'{question.words} [{question.show(before)}]: ')
        except EOFError as error:
            print()
            raise UserError(f'the input ended at {question.words!r}; {NOTHING_WRITTEN}') from error
        if not text.strip():
            return before
        try:
            return question.value(text)
        except UserError as error:
            print(f'  {error}')


# Numbers with the units that people have at hand, such as `98 mm` or `25 degC`, as SI values.
PREFIXES = {'G': 1e9, 'M': 1e6, 'k': 1e3, '': 1.0, 'm': 1e-3, 'u': 1e-6, 'µ': 1e-6, 'μ': 1e-6}
SCALES: dict[str, dict[str, float]] = {
    'm': {f'{prefix}m': PREFIXES[prefix] for prefix in ('', 'm', 'u', 'µ', 'μ')} | {'cm': 1e-2},
    'kg': {'kg': 1.0, 'g': 1e-3, 'mg': 1e-6},
    'Pa': {f'{prefix}Pa': PREFIXES[prefix] for prefix in ('', 'k', 'M', 'G')} | {'N/mm^2': 1e6},
    'Pa/K': {'Pa/K': 1.0, 'MPa/K': 1e6, 'MPa/degC': 1e6},
    'W': {f'{prefix}W': PREFIXES[prefix] for prefix in ('', 'm', 'k')},
    'K': {'K': 1.0},
    '-': {'': 1.0},
}
CELSIUS = ('degC', '°C', 'C')
QUANTITY = re.compile(r'\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(\S.*?)?\s*')


def units_of(si: str) -> tuple[str, ...]:
    """The units that may be typed for a quantity whose SI unit is `si`."""
    return (*SCALES.get(si, {si: 1.0}), *(CELSIUS if si == 'K' else ()))


def typed_units(si: str) -> str:
    """The units that may be typed, in words."""
    return ', '.join(unit for unit in units_of(si) if unit.isascii() and unit)


def to_si(text: str, si: str, default_unit: str) -> float:
    """The SI value of `text`: a number with a unit, or without one in `default_unit`. Raises UserError."""
    match, units = QUANTITY.fullmatch(text), typed_units(si)
    if match is None:
        raise UserError(f'{text.strip()!r} is not a number' + (f', or a number with a unit ({units})' if units else ''))
    number, unit = Decimal(match[1]), (match[2] or default_unit)
    if unit not in units_of(si):
        raise UserError(f'unit {unit!r} is not known here: expected {units or "a number without a unit"}')
    if unit in CELSIUS and si == 'K':
        return float(number + Decimal(repr(ZERO_CELSIUS)))
    return float(number * Decimal(repr(SCALES.get(si, {si: 1.0})[unit])))  # in decimals: 0.15 mm is 1.5e-4 m


def in_unit(value: float, si: str, unit: str) -> str:
    """An SI value in another unit, as text such as `98 mm`."""
    shown = value - ZERO_CELSIUS if unit in CELSIUS and si == 'K' else value / SCALES.get(si, {si: 1.0})[unit]
    return f'{shown:.10g} {unit}'.rstrip()


# Whether a robot makes sense: how it rests, and what heating does to it, in words.
HEATING_TIME = 10.0  # [s]
J_MAX_FRACTION = 0.5


def at_rest(config: Config) -> str:
    """Strain, stress and fractions of the module in static equilibrium. Raises SimulationError when there is none."""
    model = Model(config)
    work = new_work(model)
    run = new_run(model, np.array([0.0, config.parameters['environment.T_E']]), work)
    strains, stresses = 100.0 * work.first.obs[:, O_EPS], 1e-6 * work.first.obs[:, O_SIGMA]
    words = (
        f'At rest (static equilibrium found): wires strained by {two_numbers(strains)} %, '
        f'stressed by {two_numbers(stresses)} MPa, '
        f'martensite fraction {two_numbers(run.state.x_frozen)}, angle {math.degrees(run.state.y[2]):.3g} deg.'
    )
    if stresses.min() <= 0.0:
        words += '\nNote: a wire is not in tension at rest; a shorter wire.l0 pre-tensions it.'
    return words


def when_heated(config: Config) -> str:
    """Largest angle and temperature when one bundle is heated for a while."""
    power = J_MAX_FRACTION * config.parameters['node.J_max']
    command = module_input([0.0, HEATING_TIME], [power, 0.0], T_E=config.parameters['environment.T_E'])
    run = uninterrupted(simulate(Model(config), command, 50.0))
    words = f'Bundle 1 heated with {power:g} W (half of node.J_max) for {HEATING_TIME:g} s: '
    if not run.completed:
        return f'{words}the run ended after {run.end:.3g} s: {run.reason}.'
    angles = np.degrees(run['alpha_rad'])
    return (
        f'{words}the plate turns from {angles[0]:.3g} to {angles[np.argmax(np.abs(angles - angles[0]))]:.3g} deg, '
        f'the wires reach {run["T_1_K"].max() - ZERO_CELSIUS:.0f} degC.'
    )


def two_numbers(values: np.ndarray) -> str:
    """Two numbers, or one where they agree."""
    first, second = (f'{value:.3g}' for value in values)
    return first if first == second else f'{first} and {second}'
