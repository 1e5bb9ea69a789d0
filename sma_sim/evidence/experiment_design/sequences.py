"""Command sequences: levels of a command on a grid of equal cells, random ones of several shapes, and mutations of them.

A cell is as long as the hold time, so that no level is held for less. Ramps and sines are stairs on that grid.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from sma_sim.model.arrays import Vector
from sma_sim.solver.inputs import Input

Random = np.random.Generator
DEFAULT_STEPS = (4, 14)  # fewest and most of a default sequence in 100 s
MAX_PERIOD = 0.5  # of a sine or of pulses, as a fraction of the sequence: so that each is seen twice
LEVEL_DIGITS = 3  # decimals of a level [W]: a driver resolves no more


@dataclass(frozen=True)
class CommandGrid:
    """`cells` cells of `hold` [s]; levels lie within +-`power` [W], not below 0 where a command only heats (`one_sided`).

    `columns`: of the command and of the ambient temperature in files.
    """

    cells: int
    hold: float
    power: float
    one_sided: bool = False
    columns: tuple[str, ...] = ('J_eq_W', 'T_E_K')

    @property
    def length(self) -> float:
        """Duration [s]."""
        return self.cells * self.hold


def as_rows(levels: Vector, grid: CommandGrid) -> tuple[Vector, Vector]:
    """Times [s] and levels [W] of the rows of a file: one where the level changes, and the end at zero power."""
    first = np.flatnonzero(np.concatenate([[True], np.diff(levels) != 0.0]))
    return np.append(grid.hold * first, grid.length), np.append(levels[first], 0.0)


def as_input(levels: Vector, grid: CommandGrid, T_E: float) -> Input:
    """The input at an ambient temperature [K]; the last level holds to the end."""
    times, values = as_rows(levels, grid)
    values[-1] = values[-2]
    return Input(times, np.column_stack([values, np.full(len(times), T_E)]), (False, False), grid.columns)


def quantized(levels: Vector, grid: CommandGrid) -> Vector:
    """Levels within the limits, rounded; one that would have the other sign is turned round where a command only heats."""
    rounded = np.round(np.abs(levels) if grid.one_sided else levels, LEVEL_DIGITS) + 0.0
    return np.clip(rounded, -grid.power, grid.power)  # last: rounding must not exceed the limit


def default_sequence(grid: CommandGrid, random: Random) -> Vector:
    """Steps at random times to random levels, as recordings are often made: what a design is compared with."""
    fewest, most = DEFAULT_STEPS
    count = max(1, round(int(random.integers(fewest, most + 1)) * grid.length / 100.0))
    return steps_between(grid, random, random.uniform(0.0 if grid.one_sided else -grid.power, grid.power, count + 1))


def steps_between(grid: CommandGrid, random: Random, levels: Vector) -> Vector:
    """Levels that follow each other at random times."""
    at = np.sort(random.integers(0, grid.cells, len(levels) - 1))
    return levels[np.searchsorted(at, np.arange(grid.cells), side='right')]


def step_sequence(grid: CommandGrid, random: Random) -> Vector:
    """Few or many steps, of any height."""
    count = int(np.exp(random.uniform(np.log(3.0), np.log(max(4.0, grid.cells / 3.0)))))
    return steps_between(grid, random, random.uniform(-grid.power, grid.power, count))


def bang_bang(grid: CommandGrid, random: Random) -> Vector:
    """Full power either way, and pauses."""
    count = int(np.exp(random.uniform(np.log(3.0), np.log(max(4.0, grid.cells / 3.0)))))
    return steps_between(grid, random, grid.power * random.choice([-1.0, 0.0, 1.0], count, p=[0.4, 0.2, 0.4]))


def ramps(grid: CommandGrid, random: Random) -> Vector:
    """Lines between random levels."""
    knots = np.sort(np.append(random.uniform(0.0, grid.cells, int(random.integers(2, 12))), [0.0, grid.cells]))
    return np.interp(np.arange(grid.cells), knots, random.uniform(-grid.power, grid.power, len(knots)))


def sines(grid: CommandGrid, random: Random) -> Vector:
    """One to four sines of periods from four cells to half of the sequence, beside a constant."""
    t, longest = np.arange(grid.cells), max(4.0, MAX_PERIOD * grid.cells)
    periods = np.exp(random.uniform(np.log(4.0), np.log(longest), int(random.integers(1, 5))))
    wave = np.sum([np.sin(2.0 * np.pi * t / p + random.uniform(0.0, 6.3)) for p in periods], axis=0)
    size = grid.power * random.uniform(0.3, 1.0)
    levels: Vector = size * wave / max(1e-9, float(np.abs(wave).max())) + random.uniform(-0.5, 0.5) * (grid.power - size)
    return levels


def pulses(grid: CommandGrid, random: Random) -> Vector:
    """Pulses with pauses between, to one side or to both, of one height or growing."""
    longest = max(3, int(MAX_PERIOD * grid.cells))
    period = int(np.exp(random.uniform(np.log(2.0), np.log(longest))))
    t = np.arange(grid.cells)
    number, phase = t // period, t % period
    on = phase < max(1, round(period * random.uniform(0.1, 0.9)))
    sign = np.where(number % 2 == 0, 1.0, -1.0) if random.random() < 0.6 else random.choice([-1.0, 1.0])
    growth = np.linspace(random.uniform(0.3, 1.0), 1.0, grid.cells)
    levels: Vector = grid.power * growth * sign * on.astype(float)
    return levels


SIGNAL_SHAPES: tuple[Callable[[CommandGrid, Random], Vector], ...] = (step_sequence, bang_bang, ramps, sines, pulses)


def random_sequence(grid: CommandGrid, random: Random) -> Vector:
    """A sequence of one shape, or of up to four parts of several shapes."""
    parts = int(random.integers(1, 5))
    cuts = [0, *np.sort(random.integers(0, grid.cells, parts - 1)).tolist(), grid.cells]
    levels = np.zeros(grid.cells)
    for first, last in zip(cuts[:-1], cuts[1:], strict=True):
        shape = SIGNAL_SHAPES[int(random.integers(len(SIGNAL_SHAPES)))]
        levels[first:last] = shape(grid, random)[first:last]
    return quantized(levels, grid)


def mutated(parents: Sequence[Vector], grid: CommandGrid, random: Random) -> Vector:
    """A mutation of one of the sequences (the best first): segments are changed, replaced, moved, or taken from another."""
    levels = parents[min(int(random.exponential(0.4 * len(parents))), len(parents) - 1)].copy()
    for _ in range(int(random.integers(1, 4))):
        first = int(random.integers(0, grid.cells))
        size = int(np.exp(random.uniform(0.0, np.log(max(2.0, grid.cells / 2.0)))))
        segment = slice(first, min(grid.cells, first + size))
        levels[segment] = mutated_segment(levels, segment, parents, grid, random)
    return quantized(levels, grid)


def mutated_segment(levels: Vector, segment: slice, parents: Sequence[Vector], grid: CommandGrid, random: Random) -> Vector:
    """A segment set to a level or to an extreme, with noise, scaled, shifted in time, from another parent, or new."""
    old = levels[segment]
    kind = int(random.integers(0, 7))
    if kind == 0:
        return np.full_like(old, random.uniform(-grid.power, grid.power))
    if kind == 1:
        return np.full_like(old, grid.power * random.choice([-1.0, 0.0, 1.0]))
    if kind == 2:
        return old + grid.power * random.normal(0.0, 0.2)
    if kind == 3:
        return old * random.uniform(-1.2, 1.2)
    if kind == 4:
        return np.roll(levels, int(random.integers(-grid.cells // 4, grid.cells // 4 + 1)))[segment]
    if kind == 5:
        return parents[int(random.integers(len(parents)))][segment]
    return random_sequence(grid, random)[segment]
