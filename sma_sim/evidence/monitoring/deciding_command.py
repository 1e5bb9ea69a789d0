"""The shortest command that tells the two leading causes of a deviation apart."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np

from sma_sim.evidence.monitoring.live_criteria import BIN, DURATIONS, PARTS
from sma_sim.evidence.monitoring.past import Window
from sma_sim.evidence.search.refine import TIE
from sma_sim.model.arrays import Vector
from sma_sim.solver.model import Model


@dataclass(frozen=True)
class DecidingCommand:
    """Rows (t [s] from now, command [W], ...) and the expected log odds between the causes `between` after them."""

    rows: tuple[tuple[float, ...], ...]
    between: tuple[str, str]
    log_odds: float

    @property
    def decides(self) -> bool:
        """Whether the causes are no tie then."""
        return self.log_odds > TIE

    def as_data(self) -> dict[str, Any]:
        """For JSON."""
        return {'command': self.rows, 'between': self.between, 'log_odds': self.log_odds, 'decides': self.decides}

    def __str__(self) -> str:
        steps = ', then '.join(f'{", ".join(f"{value:g}" for value in row[1:])} W at {row[0]:g} s' for row in self.rows)
        verdict = 'tells' if self.decides else 'hardly tells'
        return f'{steps}: {verdict} {self.between[0]} and {self.between[1]} apart (expected log odds {self.log_odds:.1f})'


@dataclass(frozen=True)
class ChangedModel:
    """A model after a cause began at `onset` [s] of a window: the name of that, by how much it is warmer [K]."""

    name: str
    model: Model
    warmer: float
    onset: float


def deciding_command(
    part: Window, base: Model, causes: tuple[ChangedModel, ChangedModel], noise: Vector, most: Sequence[float]
) -> DecidingCommand | None:
    """The shortest of simple commands after which two causes are no tie, else the one that promises most; None where none
    can be run. `most`: power of each command [W], negative where it may be so.

    With the outputs y_1 and y_2 of the two models over what is known and the command, and y_0 without a cause, the expected
    log odds are |d|^2/2, d = y_1 - y_2 without the part along y_2 - y_0 that another amount of the second cause would give.
    """
    best: DecidingCommand | None = None
    structure = base.structure
    heated = [k for k, name in enumerate(structure.input_columns) if k >= len(structure.drives)][:-1]
    for duration, part_of_most, (number, power) in product(DURATIONS, PARTS, enumerate(most)):
        column = heated[min(number, len(heated) - 1)] if not structure.antagonistic else heated[number // 2]
        longer = extended(part, column, part_of_most * power, duration)
        shown = [longer.shown(one.model, base, noise, one.warmer, one.onset) for one in causes]
        without = longer.shown(base, base, noise)
        if without is None or shown[0] is None or shown[1] is None:
            continue
        rival, apart = shown[1] - without, shown[0] - shown[1]
        apart = apart - rival * float(rival @ apart) / max(float(rival @ rival), 1e-9)
        idle = [0.0] * len(heated)
        on = idle.copy()
        on[heated.index(column)] = part_of_most * power
        found = DecidingCommand(
            ((0.0, *on), (duration, *idle)), (causes[0].name, causes[1].name), 0.5 * float(apart @ apart)
        )
        if found.decides:
            return found
        best = found if best is None or found.log_odds > best.log_odds else best
    return best


def extended(part: Window, column: int, power: float, duration: float) -> Window:
    """A part of the past and what follows where a column of the input has a power, and then none."""
    new = int(round(2.0 * duration / BIN))
    now = part.end + 0.5 * BIN
    times = part.end + BIN * np.arange(1, new + 1)
    root = np.tile(part.root.max(axis=0), (new, 1))
    off = [(now, k, 0.0) for k in range(len(part.first) - 1) if k != column]
    changes = (*part.changes, *off, (now, column, power), (now + duration, column, 0.0))
    none = np.zeros((new, *part.slopes.shape[1:]))
    return replace(
        part,
        times=np.concatenate([part.times, times]),
        means=np.vstack([part.means, np.zeros((new, part.means.shape[1]))]),
        root=np.vstack([part.root, root]),
        changes=changes,
        slopes=np.concatenate([part.slopes, none]),
    )
