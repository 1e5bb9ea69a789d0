"""Beyond the linear: a hypothesis is simulated with its time courses, and estimated again around them."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import Executor
from dataclasses import replace
from threading import Event

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.latent.design import Place, Told, design_of
from sma_sim.evidence.latent.hypotheses import Hypothesis
from sma_sim.evidence.latent.ports import Port
from sma_sim.evidence.latent.ranking import Weighed, estimate_of, weigh, widening
from sma_sim.solver.simulate import SimulationError

Vector = NDArray[np.float64]
PARTS = (1.0, 0.5, 0.25)  # of a step that are tried
ITERATIONS = 3
ENOUGH = 0.95  # of the squares before: a step that leaves more is the last


def refined(place: Place, one: Weighed, T_E: float, pool: Executor, stop: Event, told: Told) -> Weighed:
    """The hypothesis around its own time courses, after a few Gauss-Newton steps; as it was where none of them helps."""
    before = squares_of(place, pool)
    for _ in range(ITERATIONS):
        if stop.is_set():
            break
        widened = widening(one, 1.0)
        found = estimate_of(one, widened)
        ahead = stepped(place, one.hypothesis, found.u, one.design.z + found.z, before, pool)
        if ahead is None:
            break
        place, after = ahead
        told(f'{one.hypothesis.name}: error over noise {np.sqrt(after / residual_count(one)):.2f}')
        one = weigh(design_of(place, one.hypothesis.ports, pool, stop, lambda words: None), one.hypothesis, T_E, (), 1.0)
        if after > ENOUGH * before:
            break
        before = after
    return one


def residual_count(one: Weighed) -> int:
    """Bins of all channels and runs."""
    return sum(run.residuals.size for run in one.design.runs)


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
