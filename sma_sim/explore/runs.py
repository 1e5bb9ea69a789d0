"""What a run of the model looks like on the page: curves over time, loops, mode bands, and the structure as it moves."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sma_sim.evidence.residual_analysis.wire_states import wires_of
from sma_sim.explore.command import Command, input_of
from sma_sim.explore.decimation import decimated, where_it_moves
from sma_sim.explore.packing import Numbers
from sma_sim.model.arrays import Vector
from sma_sim.model.config import Config
from sma_sim.model.structures.drawing import Sketch, projected
from sma_sim.model.structures.structure import Coordinate
from sma_sim.report.run_panels import COLOURS, MODE_COLUMN, UNITS, is_held, panels_of
from sma_sim.solver.inputs import inputs_at
from sma_sim.solver.model import Model
from sma_sim.solver.simulate import simulate, uninterrupted
from sma_sim.solver.wire_columns import strains_from_pose, stresses_from_forces

RATE, MAX_SAMPLES = 50.0, 20_000  # samples per second, and in a run at most
LOOP_SAMPLES, FRAMES = 1500, 160
LOOP_COLUMNS = (('T', '_K'), ('x_M', ''), ('F', '_N'), ('stress', '_Pa'), ('strain', ''))  # of a wire, without its number


@dataclass(frozen=True)
class ShownRun:
    """A run with its command: columns of the file contract, (k,) each, and how the run ended."""

    config: Config
    columns: Mapping[str, Vector]
    rate: float
    reason: str
    completed: bool
    notes: tuple[str, ...]

    @property
    def time(self) -> Vector:
        """Times of the samples [s]."""
        return self.columns['time_s']


def run_of(config: Config, command: Command) -> ShownRun:
    """Simulate; the columns are what `sma-sim simulate --rate` writes. Raises UserError."""
    source = input_of(command, config)
    rate = min(RATE, MAX_SAMPLES / (source.times[-1] - source.times[0]))
    found = uninterrupted(simulate(Model(config), source, rate))
    columns = inputs_at(source, found.time) | found.columns
    return ShownRun(config, columns, rate, found.reason, found.completed, found.notes)


def curves_data(run: ShownRun, window: tuple[float, float] | None, pixels: int, numbers: Numbers) -> dict[str, Any]:
    """Panels over time, mode bands and loops; the numbers go to `numbers`, those outside `window` [s] are left out."""
    part = slice(None)
    if window is not None:
        first, last = np.searchsorted(run.time, window)
        part = slice(max(int(first) - 1, 0), int(last) + 1)
    columns = {name: values[part] for name, values in run.columns.items()}
    return {
        'panels': panels_data(columns, pixels, numbers),
        'modes': modes_data(columns),
        'loops': loops_data(run, numbers),
        'rate': run.rate,
        'end': float(run.time[-1]) if len(run.time) else 0.0,
        'reason': run.reason,
        'completed': run.completed,
        'notes': list(run.notes),
    }


def panels_data(columns: Mapping[str, Vector], pixels: int, numbers: Numbers) -> list[dict[str, Any]]:
    """The panels of the figure of a run, in SI units: the page multiplies by `factor` and adds `offset`."""
    present = [name for name, column in columns.items() if np.isfinite(column).any()]
    time, found = columns['time_s'], []
    for panel in panels_of(present):
        curves = []
        for name, label, colour, factor, offset in panel.curves:
            at = decimated(time, columns[name], pixels)
            curves.append(
                {
                    'column': name,
                    'label': label,
                    'colour': colour,
                    'factor': factor,
                    'offset': offset,
                    'held': is_held(name),
                    'x': numbers.put(time[at]),
                    'y': numbers.put(columns[name][at]),
                }
            )
        found.append({'id': panel.label, 'label': panel.label, 'curves': curves})
    return found


def modes_data(columns: Mapping[str, Vector]) -> list[dict[str, Any]]:
    """The active mode of each wire: where each begins [s], and which it is."""
    bands, time = [], columns['time_s']
    for name, values in columns.items():
        wire = re.fullmatch(MODE_COLUMN, name)
        if wire is None or not np.isfinite(values).any():
            continue
        mode = np.nan_to_num(values, nan=3.0).astype(int)
        begin = np.concatenate([[0], np.flatnonzero(np.diff(mode)) + 1])
        bands.append(
            {
                'label': f'wire {wire.group(1) or ""}'.strip(),
                'begin': time[begin].tolist(),
                'mode': mode[begin].tolist(),
                'end': float(time[-1]),
            }
        )
    return bands


def loops_data(run: ShownRun, numbers: Numbers) -> list[dict[str, Any]]:
    """The loops of the hysteresis: coordinates over the heating, stress over strain and x_M over T of every wire."""
    structure, suffixes = run.config.structure, wires_of(run.config)
    of_wires = [f'{name}{suffix}{unit}' for suffix in suffixes for name, unit in LOOP_COLUMNS]
    at = where_it_moves([run.columns[name] for name in of_wires if name in run.columns], LOOP_SAMPLES)
    columns = {name: values[at] for name, values in run.columns.items()}
    if structure.coordinates:
        columns |= strains_from_pose(run.config, columns)
    loops = command_loop(run, numbers)
    stress, fraction = [], []
    for k, (suffix, name) in enumerate(suffixes.items()):
        if f'strain{suffix}' in columns:
            values = 100.0 * columns[f'strain{suffix}']
            stress.append(loop_curve(values, 1e-6 * stress_of(run, columns, suffix), name, k, numbers))
        T = columns[f'T{suffix}_K'] - 273.15
        fraction.append(loop_curve(T, columns[f'x_M{suffix}'], name, k, numbers))
    if stress:
        loops.append({'id': 'stress', 'x': 'strain [%]', 'y': 'stress [MPa]', 'curves': stress})
    loops.append({'id': 'fraction', 'x': 'T [deg C]', 'y': 'x_M [-]', 'curves': fraction})
    return loops


def command_loop(run: ShownRun, numbers: Numbers) -> list[dict[str, Any]]:
    """The coordinate that moves most over the first heating that changes; none of a wire by itself, and without heating."""
    structure = run.config.structure
    moved = [name for name in structure.commands if np.ptp(run.columns.get(f'{name}_W', np.zeros(1))) > 0.0]
    loops = []
    for name in moved[:1] if len(run.time) else ():
        for coordinate in most_moved(structure.coordinates, run.columns):
            unit, factor = UNITS.get(coordinate.unit, (coordinate.unit, 1.0))
            heating, position = run.columns[f'{name}_W'], factor * run.columns[coordinate.column]
            at = where_it_moves([heating, position], LOOP_SAMPLES)
            curve = loop_curve(heating[at], position[at], '', 0, numbers)
            loops.append({'id': 'command', 'x': f'{name} [W]', 'y': f'{coordinate.name} [{unit}]', 'curves': [curve]})
    return loops


def most_moved(coordinates: Sequence[Coordinate], columns: Mapping[str, Vector]) -> list[Coordinate]:
    """Of the coordinates with the unit of the last one, that which moves most; none of a wire by itself."""
    alike = [one for one in coordinates if one.unit == coordinates[-1].unit and len(columns[one.column])]
    return [max(alike, key=lambda one: float(np.ptp(columns[one.column])))] if alike else []


def stress_of(run: ShownRun, columns: Mapping[str, Vector], suffix: str) -> Vector:
    """Stress of a wire [Pa], (k,): measured on a bench, of a structure from the force of its bundle."""
    if 'stress_Pa' in columns:
        return columns['stress_Pa']
    return stresses_from_forces(run.config, columns)[f'stress{suffix}']


def loop_curve(x: Vector, y: Vector, label: str, k: int, numbers: Numbers) -> dict[str, Any]:
    """A curve of a loop."""
    known = np.isfinite(x) & np.isfinite(y)
    colour = COLOURS[k % len(COLOURS)] if label else COLOURS[1]
    return {'label': label, 'colour': colour, 'x': numbers.put(x[known]), 'y': numbers.put(y[known])}


def frames_data(run: ShownRun, numbers: Numbers) -> dict[str, Any]:
    """The structure at some instants of the run: of each line its points, in the plane of the picture [m]."""
    structure = run.config.structure
    at = np.unique(np.linspace(0, len(run.time) - 1, FRAMES).astype(int)) if len(run.time) else np.zeros(0, int)
    sketch = Sketch(structure, run.config.parameters)
    poses = [{c.name: float(run.columns[c.column][k]) for c in structure.coordinates} for k in at]
    found: list[list[float]] = []
    shape: dict[str, list[int]] = {'wires': [], 'bodies': []}
    for k, pose in zip(at, poses, strict=True):
        lengths = sketch.lengths_at(pose)
        if not structure.coordinates:
            strain = run.columns['strain'][k] if 'strain' in run.columns else 0.0
            lengths = tuple(length * (1.0 + strain) for length in lengths)
        lines = sketch.lines(pose, lengths)
        shape = {'wires': [len(line) for line in lines.wires], 'bodies': [len(line) for line in lines.bodies]}
        found.append([value for line in (*lines.wires, *lines.bodies) for axis in projected(line) for value in axis])
    modes = [name for name in run.columns if re.fullmatch(MODE_COLUMN, name)]
    return {
        **shape,
        'count': len(at),
        'time': numbers.put(run.time[at]),
        'points': numbers.put(np.array(found)),
        'modes': [numbers.put(np.nan_to_num(run.columns[name][at], nan=3.0)) for name in modes],
    }
