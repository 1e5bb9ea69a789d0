"""`sma-sim simulate`: run the model under an input file."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from sma_sim.cli.tables import read_columns, write_columns
from sma_sim.model.config import read_config
from sma_sim.model.errors import UserError
from sma_sim.solver.simulate import Input, Model, SimulationError, simulate


def add_parser(verbs: Any) -> None:
    """Declare the verb."""
    parser: argparse.ArgumentParser = verbs.add_parser('simulate', help='run the model under an input file')
    parser.add_argument('--input', type=Path, required=True, help='CSV: time_s and J_eq_W (module) or strain (wire)')
    parser.add_argument('--out', type=Path, required=True, help='CSV to write')
    parser.add_argument('--rate', type=float, default=100.0, help='samples per second (default 100)')
    parser.add_argument('--model', choices=('hybrid', 'mas'))
    parser.add_argument('--system', choices=('module', 'wire'))
    parser.add_argument('--interpolation', choices=('hold', 'linear'), default='hold', help='of J_eq between rows')
    parser.add_argument('--config', type=Path, help='YAML parameter file')
    parser.add_argument('--set', action='append', default=[], metavar='NAME=VALUE', dest='words')
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> None:
    """Simulate and write the samples."""
    words = list(arguments.words)
    words += [f'{name}={getattr(arguments, name)}' for name in ('model', 'system') if getattr(arguments, name)]
    config = read_config(arguments.config, words)
    if not 0.0 < arguments.rate <= 1e6:
        raise UserError(f'--rate {arguments.rate:g}: expected more than 0 and at most 1e6 samples per second')
    model = Model(config)
    read = read_wire_input if config.system == 'wire' else read_module_input
    T_E = config.parameters['environment.T_E']
    source = read(arguments.input, T_E, arguments.interpolation == 'linear')
    first, last = source.times[0], source.times[-1]
    count = int(np.floor((last - first) * arguments.rate + 1e-9)) + 1
    times = np.minimum(first + np.arange(count) / arguments.rate, last)
    try:
        trajectory = simulate(model, source, times)
    except SimulationError as error:
        raise UserError(str(error)) from error
    held = np.searchsorted(source.times, trajectory.time, side='right') - 1
    names = ('strain', 'J_W', 'T_E_K') if config.system == 'wire' else ('J_eq_W', 'T_E_K')
    columns = {'time_s': trajectory.time}
    for k, name in enumerate(names):
        column = source.values[:, k]
        columns[name] = np.interp(trajectory.time, source.times, column) if source.linear[k] else column[held]
    write_columns(arguments.out, columns | trajectory.columns)
    print(f'{arguments.out}: {len(trajectory.time)} samples, {trajectory.steps} steps, {len(trajectory.jumps)} jumps')
    if not trajectory.completed:
        raise UserError(f'the run ended at {trajectory.time[-1]:g} s: {trajectory.reason}')


def read_module_input(path: Path, T_E: float, linear: bool) -> Input:
    """Command (and ambient temperature, if given) of a module."""
    columns = read_columns(path, ('time_s', 'J_eq_W'), ('T_E_K',))
    ambient = columns.get('T_E_K', np.full(len(columns['time_s']), T_E))
    return Input(_increasing(path, columns['time_s']), np.column_stack([columns['J_eq_W'], ambient]), (linear, False))


def read_wire_input(path: Path, T_E: float, linear: bool) -> Input:
    """Strain, heating and ambient temperature of a wire."""
    columns = read_columns(path, ('time_s', 'strain'), ('J_W', 'T_E_K'))
    time = _increasing(path, columns['time_s'])
    heating = columns.get('J_W', np.zeros(len(time)))
    if (heating < 0.0).any():
        raise UserError(f'{path}, column J_W: heating cannot be negative, got {heating.min():g} W')
    ambient = columns.get('T_E_K', np.full(len(time), T_E))
    return Input(time, np.column_stack([columns['strain'], heating, ambient]), (True, linear, False))


def _increasing(path: Path, time: Any) -> Any:
    if len(time) < 2:
        raise UserError(f'{path}: expected at least two rows, the last one gives the end of the run')
    steps = np.diff(time)
    if (steps <= 0.0).any():
        row = int(np.argmax(steps <= 0.0)) + 3
        raise UserError(f'{path}, row {row}, column time_s: time does not increase')
    return time
