"""Beyond the linear: a hypothesis is simulated with its time courses, and estimated again around them.

How far a linear model may be trusted is not known beforehand. With noise that is believed to be wider, estimates stay nearer
to where they began (a tempered likelihood): several widths, and parts of the way to each estimate, are simulated, and what
leaves the least is gone on from. Simulation alone decides which hypotheses are worth another step.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from threading import Event

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.estimation.calibrate import run_in_threads
from sma_sim.evidence.estimation.executors import workers_of
from sma_sim.evidence.estimation.injection_points import Port
from sma_sim.evidence.latent_input.design_matrix import OnProgress, Place, Stopped, design_of
from sma_sim.evidence.latent_input.hypotheses import Hypothesis
from sma_sim.evidence.latent_input.ranking import Weighed, error_of, estimate_of, weigh, widened_for, widening
from sma_sim.solver.simulate import SimulationError

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]
PARTS = (1.0, 0.5, 0.25, 0.1)  # of a step that are tried
WIDTHS = 3  # of noise, from what the linear model would leave to what is left
BELIEFS = (0.5, 0.25)  # powers of the present width at which it is chosen what the course looks like; the first at first
FINALISTS = 5  # that get a second step
BEHIND = (3.0, 1.3, 1.15, 1.1)  # ratio to the least error left above which a hypothesis is given up, step by step
FAST = 0.75  # to this part an error must fall in a step for the hypothesis to stay as far behind as at first
ENOUGH = 0.95  # of the squares before: a step that leaves more is the last


@dataclass(frozen=True)
class RefinedHypothesis:
    """A hypothesis on its way: where its courses are, its linear problem around an earlier place, what simulation leaves.

    `squares`: over the bins; `doubt`: by how much noise is to be widened for what is left; `settled`: it gets no further;
    `fell`: to which part the error fell in the last step.
    """

    place: Place
    weighed: Weighed
    squares: float
    doubt: float
    settled: bool = False
    fell: float = 1.0

    @property
    def error(self) -> float:
        """Error over noise that is left, simulated."""
        return error_of(self.weighed.design, self.squares)

    @property
    def u(self) -> Vector:
        """The courses (m,), in probes, by run and port."""
        ports = self.weighed.hypothesis.ports
        return np.concatenate([own[port] / port.probe for own in self.place.courses for port in ports])


def refined(
    start: Place, weighed: Sequence[Weighed], T_E: float, pool: Executor, stop: Event, on_progress: OnProgress
) -> list[RefinedHypothesis]:
    """Those that lead after one step of all, as far as they came; the best first. Raises Stopped."""
    left = left_at(start, pool)
    on_progress(f'simulating each of {len(weighed)} hypotheses')
    tried = [RefinedHypothesis(without_any(start, one.hypothesis), one, *left) for one in weighed]
    tried = leading(
        run_in_threads([partial(stepped, one, BELIEFS[:1], T_E, pool, stop) for one in tried], stop, workers_of(pool))
    )
    if stop.is_set():
        raise Stopped
    given_up: list[RefinedHypothesis] = []
    for behind in BEHIND:
        given_up += [one for one in tried if not keeps_up(one, tried[0], behind)]
        tried = [one for one in tried if keeps_up(one, tried[0], behind)]
        if all(one.settled for one in tried):
            break
        on_progress(f'simulating {", ".join(one.weighed.hypothesis.name for one in tried if not one.settled)}')
        try:
            tried = run_in_threads([partial(linearised, one, pool, stop) for one in tried], stop)
        except Stopped:
            break
        steps_on = [partial(stepped, one, BELIEFS, T_E, pool, stop) for one in tried]
        tried = in_order(run_in_threads(steps_on, stop, workers_of(pool)))
    near = [one for one in tried if one.error <= BEHIND[-1] * tried[0].error]
    return in_order([*tried, *given_up, *on_one_wire(near, T_E, pool, stop, on_progress)])


def keeps_up(one: RefinedHypothesis, best: RefinedHypothesis, behind: float) -> bool:
    """Whether another step is worth its time."""
    return one.error <= behind * best.error or (one.fell <= FAST and one.error <= BEHIND[0] * best.error)


def on_one_wire(
    tried: Sequence[RefinedHypothesis], T_E: float, pool: Executor, stop: Event, on_progress: OnProgress
) -> list[RefinedHypothesis]:
    """What is on both wires, on either of them alone, after two steps."""
    alone = [
        replace(
            one, settled=False, weighed=replace(one.weighed, hypothesis=Hypothesis(port.name, (port,))),
            place=replace(one.place, courses=tuple({port: own[port]} for own in one.place.courses)),
        )
        for one in tried for port in one.weighed.hypothesis.ports if len(one.weighed.hypothesis.ports) > 1
    ]  # fmt: skip
    if not alone:
        return []
    on_progress(f'simulating {", ".join(one.weighed.hypothesis.name for one in alone)}')
    try:
        return run_in_threads([partial(initial_refinements, one, T_E, pool, stop) for one in alone], stop, workers_of(pool))
    except Stopped:
        return []


def initial_refinements(tried: RefinedHypothesis, T_E: float, pool: Executor, stop: Event) -> RefinedHypothesis:
    """Two steps from what the simulation leaves at its place. Raises Stopped."""
    squares, doubt = left_at(tried.place, pool)
    one = stepped(replace(tried, squares=squares, doubt=doubt), BELIEFS, T_E, pool, stop)
    return stepped(linearised(one, pool, stop), BELIEFS, T_E, pool, stop)


def in_order(tried: Sequence[RefinedHypothesis]) -> list[RefinedHypothesis]:
    """What leaves the least first."""
    return sorted(tried, key=lambda one: one.squares)


def without_any(start: Place, one: Hypothesis) -> Place:
    """With courses that are zero."""
    zero = np.zeros(sum(len(grid.knots) for grid in start.grids) * len(one.ports))
    return replace(start, courses=tuple(courses_of(start, one, zero)))


def leading(tried: Sequence[RefinedHypothesis]) -> list[RefinedHypothesis]:
    """The quantities that leave the least, the best first; on both wires, from where the best on one or both has come."""
    by_group: dict[str, RefinedHypothesis] = {}
    widest = {one.weighed.hypothesis.group: one for one in sorted(tried, key=lambda one: len(one.weighed.hypothesis.ports))}
    for one in in_order(tried):
        by_group.setdefault(one.weighed.hypothesis.group, one)
    return [with_both(one, widest[group]) for group, one in by_group.items()][:FINALISTS]


def with_both(best: RefinedHypothesis, both: RefinedHypothesis) -> RefinedHypothesis:
    """A hypothesis that has all ports of the other, which have no course yet where that has none."""
    courses = tuple({port: own.get(port, 0.0 * next(iter(own.values()))) for port in both.weighed.hypothesis.ports}
                    for own in best.place.courses)  # fmt: skip
    return replace(best, place=replace(best.place, courses=courses), weighed=both.weighed)


def linearised(tried: RefinedHypothesis, pool: Executor, stop: Event) -> RefinedHypothesis:
    """With the linear problem around its place. Raises Stopped."""
    if tried.settled:
        return tried
    design = design_of(tried.place, tried.weighed.hypothesis.ports, pool, stop, lambda words: None)
    return replace(tried, weighed=replace(tried.weighed, design=design))


def stepped(
    tried: RefinedHypothesis, beliefs: Sequence[float], T_E: float, pool: Executor, stop: Event
) -> RefinedHypothesis:
    """The best of several steps; settled where none leaves much less than before."""
    if tried.settled or stop.is_set():
        return tried
    best = tried
    for weighed, there in steps(tried, beliefs, T_E):
        squares, doubt = left_at(there, pool)
        if squares < best.squares:
            best = RefinedHypothesis(there, weighed, squares, doubt)
    if best.squares > ENOUGH * tried.squares:
        return replace(tried, settled=True, fell=1.0)
    return replace(best, fell=best.error / tried.error)


def steps(tried: RefinedHypothesis, beliefs: Sequence[float], T_E: float) -> Iterator[tuple[Weighed, Place]]:
    """What a course may look like, and a place that this leads to."""
    low, high = tried.place.problem.limits()
    hypothesis, design = tried.weighed.hypothesis, tried.weighed.design
    for belief in beliefs:
        one = weigh(design, hypothesis, T_E, (), tried.doubt**belief, mixed=False)
        least = min(widening(one, 1.0), tried.doubt)
        for width in dict.fromkeys(np.geomspace(least, tried.doubt, WIDTHS).tolist()):
            found = estimate_of(one, width)
            target, z = courses_of(tried.place, hypothesis, found.u), design.z + found.z
            for part in PARTS:
                courses = zip(tried.place.courses, target, strict=True)
                yield one, replace(
                    tried.place, z=np.clip(tried.place.z + part * (z - tried.place.z), low, high),
                    courses=tuple(between(now, later, part) for now, later in courses),
                )  # fmt: skip


def left_at(place: Place, pool: Executor) -> tuple[float, float]:
    """Sum of the squared residuals, simulated, and by how much noise is to be widened; inf where a run cannot be made."""
    try:
        found = place.residuals(pool)
    except SimulationError:
        return np.inf, np.inf
    shown = [one for one in found if one is not None]
    if len(shown) < len(found):
        return np.inf, np.inf
    return float(sum(np.sum(one**2) for one in shown)), widened_for(shown)


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
    return {port: (1.0 - part) * now[port] + part * u for port, u in later.items()}
