"""Beyond the linear: a hypothesis is simulated with its time courses, and estimated again around them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from threading import Event

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.calibrate import together
from sma_sim.evidence.latent.design import Place, Stopped, Told, design_of
from sma_sim.evidence.latent.hypotheses import Hypothesis
from sma_sim.evidence.latent.ports import Port
from sma_sim.evidence.latent.ranking import Weighed, error_of, estimate_of, widening
from sma_sim.solver.simulate import SimulationError

Vector = NDArray[np.float64]
PARTS = (1.0, 0.5, 0.25)  # of a step that are tried
ITERATIONS = 2
FAR, BEHIND = 1.6, 1.3  # ratio of the error left to the least, above which a hypothesis is given up: at first, and later
ENOUGH = 0.95  # of the squares before: a step that leaves more is the last


@dataclass(frozen=True)
class Tried:
    """A hypothesis on its way: around what it was linearised, the sum of squares there, and whether it got nowhere."""

    place: Place
    weighed: Weighed
    squares: float
    settled: bool = False

    @property
    def error(self) -> float:
        """Error over noise that the linear model foretells with its courses."""
        return error_of(self.weighed.design, estimate_of(self.weighed, 1.0).squares)


def refined(
    start: Place, finalists: Sequence[Weighed], pool: Executor, stop: Event, told: Told
) -> list[Weighed]:
    """The finalists around their own time courses, without those that fall far behind on the way; as far as they came."""
    squares = squares_of(start, pool)
    tried = nearly_best([Tried(start, one, squares) for one in finalists], FAR)
    for _ in range(ITERATIONS):
        told(f'simulating {", ".join(one.weighed.hypothesis.name for one in tried if not one.settled)}')
        try:
            tried = nearly_best(together([partial(closer, one, pool, stop) for one in tried], stop), BEHIND)
        except Stopped:
            break
        if all(one.settled for one in tried):
            break
    return [one.weighed for one in tried]


def nearly_best(tried: Sequence[Tried], far: float) -> list[Tried]:
    """Without those that leave more than `far` times what the best leaves."""
    errors = [one.error for one in tried]
    return [one for one, error in zip(tried, errors, strict=True) if error <= far * min(errors)]


def closer(tried: Tried, pool: Executor, stop: Event) -> Tried:
    """One Gauss-Newton step; the prior stays as it is. Raises Stopped."""
    one = tried.weighed
    if tried.settled:
        return tried
    found = estimate_of(one, widening(one, 1.0))
    ahead = stepped(tried.place, one.hypothesis, found.u, one.design.z + found.z, tried.squares, pool)
    if ahead is None:
        return replace(tried, settled=True)
    place, squares = ahead
    design = design_of(place, one.hypothesis.ports, pool, stop, lambda words: None)
    return Tried(place, replace(one, design=design), squares, squares > ENOUGH * tried.squares)


def squares_of(place: Place, pool: Executor) -> float:
    """Sum of the squared residuals, simulated; inf where a run cannot be made."""
    try:
        found = place.residuals(pool)
    except SimulationError:
        return np.inf
    return float(sum(np.inf if one is None else np.sum(one**2) for one in found))


def stepped(
    place: Place, one: Hypothesis, u: Vector, z: Vector, before: float, pool: Executor
) -> tuple[Place, float] | None:
    """The largest part of the way to (u, z) that lowers the squares, and these; None where none does."""
    low, high = place.problem.limits()
    target = courses_of(place, one, u)
    for part in PARTS:
        there = replace(
            place, z=np.clip(place.z + part * (z - place.z), low, high),
            courses=tuple(between(now, later, part) for now, later in zip(place.courses, target, strict=True)),
        )  # fmt: skip
        after = squares_of(there, pool)
        if after < before:
            return there, after
    return None


def courses_of(place: Place, one: Hypothesis, u: Vector) -> list[dict[Port, Vector]]:
    """u (m,), in probes, by run and port, in the ports' units."""
    found, at = [], 0
    for grid in place.grids:
        own = {}
        for port in one.ports:
            own[port] = port.probe * u[at : at + len(grid.knots)]
            at += len(grid.knots)
        found.append(own)
    return found


def between(now: Mapping[Port, Vector], later: Mapping[Port, Vector], part: float) -> dict[Port, Vector]:
    """Courses a part of the way on."""
    return {port: (1.0 - part) * now.get(port, np.zeros_like(u)) + part * u for port, u in later.items()}
