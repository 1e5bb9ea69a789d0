"""What every term of every port could explain of residuals: weak-form regression on responses of the simulator.

A column of the regression is the change of all predicted channels by a finite amount of a term, less what the fitted
parameters, starts and delay absorb of it (as in the screening of effects). No measurement is differentiated. Shapes of the
best terms (thresholds, widths, time constants) are then improved within the same linearisation by Gauss-Newton steps.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from concurrent.futures import Executor, Future
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.estimation.executors import PickledConfig
from sma_sim.evidence.estimation.levenberg_marquardt import measured_steps
from sma_sim.evidence.estimation.problem import Evaluation, LinearizedRun, Problem, evaluate, linearize
from sma_sim.evidence.model_selection.candidates import with_effect
from sma_sim.evidence.model_selection.score_tests import FAINT, projection
from sma_sim.evidence.symbolic_regression.locations import BOTH_WIRES, Place, places_for
from sma_sim.evidence.symbolic_regression.shape_grids import Scope, grid_of, limits_of, standing_out
from sma_sim.evidence.symbolic_regression.terms import Term
from sma_sim.evidence.symbolic_regression.universal_term import any_term
from sma_sim.evidence.symbolic_regression.visited_states import Course, along, seen_at

Vector = NDArray[np.float64]
COARSE = 1e-4  # solver.rtol of the responses: both sides of each difference have it


@dataclass(frozen=True)
class TermFit:
    """One term at one place with its `shapes` and `amount` of the coefficient; `gain`: fall of the squares."""

    place: Place
    term: Term
    shapes: tuple[float, ...]
    amount: float
    gain: float
    limits: tuple[tuple[float, float], ...]

    @property
    def name(self) -> str:
        """Place and term."""
        return f'{self.place.name}: {self.term.name}'


class LinearizedFit:
    """A fitted problem, linearised, on which terms are tried."""

    def __init__(self, problem: Problem, z: Vector, pool: Executor) -> None:
        self._problem, self._z, self._pool = problem, z, pool
        self.linear: list[LinearizedRun] = linearize(problem, z, pool, measured_steps(problem, z, pool), central=True)
        self.residuals = np.concatenate([one.residuals.ravel() for one in self.linear])
        self._project = projection(self.linear, len(z))
        self.left = self._project(self.residuals)
        self._coarse, self._places = problem.at_tolerance(COARSE).fitted(z), problem.places()
        self._shown = [self._run(PickledConfig(self._coarse), at) for at in range(len(problem.runs))]
        self._peaks = standing_out(problem, self.linear)

    def scope(self, place: Place) -> Scope:
        """What the grids at a place are made of."""
        length = max(float(run.time[-1]) for run in self._problem.runs)
        return Scope(seen_at(place, self._problem, self._z), length, self._peaks)

    @property
    def places(self) -> tuple[Place, ...]:
        """The places to try."""
        channels = tuple(dict.fromkeys(name for run in self._problem.runs for name in run.channels))
        return places_for(self._problem.config.system, channels)

    def responses(self, wanted: Sequence[tuple[Place, Term, tuple[float, ...], float]]) -> list[Vector | None]:
        """The change of all residuals by each (place, term, shapes, amount), (N,); None where it cannot be run."""
        futures = []
        for place, term, shapes, amount in wanted:
            effect = any_term(place.hook, bool(term.rate))
            config = with_effect(self._coarse, effect.found, effect.values(place, term, amount, shapes))
            parcel = PickledConfig(config)
            futures.append([self._run(parcel, k) for k in range(len(self._places))])
        found: list[Vector | None] = []
        for runs in futures:
            pairs = [(one.result()[0], base.result()[0]) for one, base in zip(runs, self._shown, strict=True)]
            parts = [(one - base).ravel() for one, base in pairs if one is not None and base is not None]
            found.append(np.concatenate(parts) if len(parts) == len(pairs) else None)
        return found

    def _run(self, parcel: PickledConfig, k: int) -> Future[list[Any]]:
        """The residuals of one run."""
        nuisance = self._problem.nuisance(self._z[self._places[k]])
        return self._pool.submit(evaluate, Evaluation(self._problem.runs[k], ((parcel, nuisance),)))

    def project(self, response: Vector) -> Vector | None:
        """What is left of a response; None where the channels do not see it."""
        left, size = self._project(response), float(response @ response)
        return None if size == 0.0 or float(left @ left) < FAINT * size else left


def size_of(term: Term, shapes: Sequence[float], course: Course) -> float:
    """Root mean square of a term along a run."""
    return float(np.sqrt(np.mean(along(term, shapes, course) ** 2)))


def guesses_at(bench: LinearizedFit, group: Sequence[Place]) -> list[TermFit]:
    """The best shapes of every term at a place; or at either wire and, in the same way, in both (the sum of the two)."""
    scope = bench.scope(group[-1])
    wanted = [
        (term, shapes, group[0].probe / size)
        for term in group[0].terms for shapes in grid_of(term, scope)
        if (size := max(size_of(term, shapes, one) for one in scope.courses)) > 0.0
    ]  # fmt: skip
    alone = [bench.responses([(place, *one) for one in wanted]) for place in group[:2]]
    best: dict[tuple[str, str], TermFit] = {}
    for k, (term, shapes, amount) in enumerate(wanted):
        shown = [responses[k] for responses in alone]
        if len(group) == 3:
            shown.append(None if shown[0] is None or shown[1] is None else shown[0] + shown[1])
        for place, response in zip(group, shown, strict=True):
            guess = guessed(bench, place, term, shapes, amount, response)
            if guess and guess.gain > (best[place.name, term.name].gain if (place.name, term.name) in best else 0.0):
                best[place.name, term.name] = replace(guess, limits=tuple(limits_of(shape, scope) for shape in term.shapes))
    return list(best.values())


def guessed(
    bench: LinearizedFit, place: Place, term: Term, shapes: tuple[float, ...], amount: float, response: Vector | None
) -> TermFit | None:
    """A term by its response to an amount; None where the channels do not see it."""
    left = None if response is None else bench.project(response)
    if left is None:
        return None
    pull, size = float(left @ bench.left), float(left @ left)
    return TermFit(place, term, shapes, -amount * pull / size, pull**2 / size, ())


def groups_of(places: Sequence[Place]) -> list[list[Place]]:
    """Places that are tried together: the two wires and both; all others alone."""
    both = [place for place in places if place.component == BOTH_WIRES]
    grouped = [[*(one for one in places if one.name in place.ports), place] for place in both]
    taken = {one.name for group in grouped for one in group}
    return [*([place] for place in places if place.name not in taken), *grouped]


def everywhere(bench: LinearizedFit, hooks: Collection[str] = ()) -> list[TermFit]:
    """All terms of all places (of these hooks), the most explaining first."""
    groups = [group for group in groups_of(bench.places) if not hooks or group[0].hook in hooks]
    return sorted((guess for group in groups for guess in guesses_at(bench, group)), key=lambda one: -one.gain)
