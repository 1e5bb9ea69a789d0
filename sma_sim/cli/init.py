"""`sma-sim init`: write a parameter file for the user's own robot, asked for or given as flags."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from sma_sim.cli.common.commands import example_of
from sma_sim.cli.common.options import add_config_options, announce_first_compilation, folders_beside
from sma_sim.cli.common.robot_check import at_rest, when_heated
from sma_sim.cli.common.units import in_unit, to_si, typed_units
from sma_sim.evidence.data.tables import check_writable, write_whole
from sma_sim.model.config import Config, read_config
from sma_sim.model.errors import UserError
from sma_sim.model.parameter_file import yaml_number
from sma_sim.model.parameters import DEFAULTS
from sma_sim.solver.model import Model
from sma_sim.solver.simulate import new_run, new_work
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
    parser: argparse.ArgumentParser = verbs.add_parser(
        'init',
        epilog=example_of('init'),
        help='write the parameter file of your robot',
        description='Write the parameter file of your robot. On a terminal it asks for the dimensions. With a dimension '
        'among the options, or without a terminal, it does not ask; what is not given is taken from --config, else from '
        'the paper.',
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
        own = ', '.join(config.structure.structure.declared)
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
    structure = config.structure.structure
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
