"""Score tests: what each candidate could explain of the residuals that the fitted parameters cannot.

With residuals r, derivatives J of everything that is fitted and the response s to a probe of a candidate (all over noise),
s' = s - J^T (J J^T + 1)^-1 J s is the part of s that no fitted unknown can absorb. To first order the sum of squares
decreases by the largest of -2 a s'r - a^2 s's' over a >= 0.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Hashable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import cache, cached_property
from itertools import product

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.estimation.problem import (
    LinearizedRun,
    Problem,
    accumulated,
    change_of,
    linearize,
    near,
    normal_equations,
    residuals_at,
    residuals_under,
)
from sma_sim.evidence.model_selection.candidates import Candidate, Probe, at_instants, instants_of, with_effect
from sma_sim.evidence.model_selection.criteria import CRITERIA
from sma_sim.model.arrays import Matrix, Vector
from sma_sim.model.effects.scope import EVERY
from sma_sim.solver.simulate import SimulationError

WEAK = 0.5  # of a step, below which a strength is probed again: a response over it is no longer the slope


@dataclass(frozen=True)
class ScreeningResult:
    """What a candidate could explain: `gain` (decrease of the sum of squares) at `values` of its parameters.

    `lines`: by probe, the slope and the curvature of half the squares along its amount, in steps, and up to which amount it
    is realistic.
    """

    candidate: Candidate
    gain: float
    values: Mapping[str, float]
    lines: tuple[tuple[float, float, float], ...] = ()


class ScoreTests:
    """The score tests of candidates beside a fit, or in place of one of its effects.

    Responses to probes beside the fit are kept: they serve both.
    """

    def __init__(self, problem: Problem, z: Vector, pool: Executor) -> None:
        self._problem, self._z, self._pool = problem, z, pool
        self._known: dict[int, Vector | None] = {}  # by the id of the probe
        self._probed: list[Candidate] = []  # whose ids no other object gets, as long as they are here
        self.tested: tuple[ScreeningResult, ...] = ()  # beside the fit, also those that gain nothing

    @cached_property
    def linear(self) -> list[LinearizedRun]:
        """The fit linearised. Raises SimulationError."""
        return linearize(self._problem, self._z, self._pool)

    def beside(self, candidates: Sequence[Candidate]) -> tuple[ScreeningResult, ...]:
        """The candidates by gain, the largest first; those that the channels cannot see are left out. Raises
        SimulationError."""
        self.tested = ranked(self._problem, self.linear, candidates, self.responses)
        return gaining(self.tested)

    def in_place(self, rest: Problem, z: Vector, candidates: Sequence[Candidate]) -> tuple[ScreeningResult, ...]:
        """The same beside what an effect less leaves of the fit: the problem `rest`, at its z.

        To first order, responses are those beside the whole fit, and its derivatives are those of the rest. What acts as the
        effect does, in other places too, cannot act beside it, and is probed without it. Raises SimulationError.
        """
        kept = [k for k, free in enumerate(self._problem.free) if free in rest.free]
        kept += range(len(self._problem.free), len(self._problem.unknowns))
        shown = residuals_at(near(rest, [run.correction for run in self.linear]), z, self._pool)
        linear = [
            replace(run, indices=indices, residuals=here, jacobian=run.jacobian[kept[: len(indices)]])
            for run, indices, here in zip(self.linear, rest.indices(), shown, strict=True)
            if here is not None
        ]
        if len(linear) < len(shown):
            raise SimulationError('the model cannot be run without one of its effects')
        law = {one.found.effect.plain_name for one in self._problem.config.effects if one not in rest.config.effects}

        def responses(some: Sequence[Candidate]) -> Mapping[int, Vector]:
            alike = [one for one in some if one.found.effect.plain_name in law]
            others = [one for one in some if one.found.effect.plain_name not in law]
            return {**self.responses(others), **probe_all(rest, z, alike, linear, self._pool)}

        return gaining(ranked(rest, linear, candidates, responses))

    def responses(self, candidates: Sequence[Candidate]) -> Mapping[int, Vector]:
        """The changes (N,) of all residuals by the probes of candidates beside the fit, each made once; by the probe's id,
        without those that cannot be run."""
        probes = [[id(probe) for family in one.families for probe in family] for one in candidates]
        new = [one for one, own in zip(candidates, probes, strict=True) if not self._known.keys() >= set(own)]
        found = probe_all(self._problem, self._z, new, self.linear, self._pool)
        self._known |= {id(probe): found.get(id(probe)) for one in new for family in one.families for probe in family}
        self._probed += new
        known = {key: self._known[key] for own in probes for key in own}
        return {key: response for key, response in known.items() if response is not None}


def screen(problem: Problem, z: Vector, candidates: Sequence[Candidate], pool: Executor) -> tuple[ScreeningResult, ...]:
    """The candidates beside a fit by gain (`ScoreTests.beside`)."""
    return ScoreTests(problem, z, pool).beside(candidates)


def gaining(tested: Sequence[ScreeningResult]) -> tuple[ScreeningResult, ...]:
    """Those that explain anything."""
    return tuple(one for one in tested if one.gain > 0.0)


def ranked(
    problem: Problem,
    linear: Sequence[LinearizedRun],
    candidates: Sequence[Candidate],
    responses: Callable[[Sequence[Candidate]], Mapping[int, Vector]],
) -> tuple[ScreeningResult, ...]:
    """The candidates by gain, the largest first, from the `responses` to their probes."""
    residuals = np.concatenate([run.residuals.ravel() for run in linear])
    if any(instants_of(candidate.found) for candidate in candidates):
        instants = change_points(problem, linear)
        candidates = [at_instants(candidate, instants) for candidate in candidates]
    project = Projection(linear, len(problem.unknowns), problem.tempering)

    def tested(some: Sequence[Candidate]) -> list[ScreeningResult]:
        shown = responses(some)
        return [score_test(candidate, shown, project, residuals) for candidate in some]

    found = tested(candidates)
    weak = {k: Candidate(one.candidate.found, (family,)) for k, one in enumerate(found) if (family := nearer_probes(one))}
    for k, again in zip(weak, tested(list(weak.values())), strict=True):
        lines = (*found[k].lines, *again.lines)
        best = again if again.gain > found[k].gain else found[k]
        found[k] = replace(best, candidate=found[k].candidate, lines=lines)
    return tuple(sorted(found, key=lambda result: -result.gain))


def score_test(
    candidate: Candidate, responses: Mapping[int, Vector], project: Projection, residuals: Vector
) -> ScreeningResult:
    """What the best family of a candidate's probes could explain; nothing where the channels cannot see it."""
    best, lines = ScreeningResult(candidate, 0.0, {}), list[tuple[float, float, float]]()
    for family in candidate.families:
        projected = [(probe, project.visible(responses[id(probe)])) for probe in family if id(probe) in responses]
        visible = [(probe, response) for probe, response in projected if response is not None]
        lines += [(0.0, 0.0, candidate.largest(probe)) for probe, response in projected if response is None]
        if visible:
            lines += [(float(one @ residuals), float(one @ one), candidate.largest(probe)) for probe, one in visible]
            probes = [probe for probe, _ in visible]
            gain, amounts = explained(probes, np.array([response for _, response in visible]), residuals)
            if gain > best.gain:
                best = ScreeningResult(candidate, gain, values_at(probes, amounts))
    return replace(best, lines=tuple(lines))


def nearer_probes(result: ScreeningResult) -> tuple[Probe, ...]:
    """Probes at the strengths that a test has found, where these are far less than those that it probed: what is linear
    there need not be linear as far as that."""
    families = sorted(result.candidate.families, key=lambda family: -abs(family[0].step))
    probes = {probe.parameter: probe for family in families for probe in family}  # the least of each strength
    shape = {name: value for name, value in result.values.items() if name not in probes}
    steps = {name: result.values[name] - probe.neutral for name, probe in probes.items() if name in result.values}
    if any(abs(step) > WEAK * abs(probes[name].step) for name, step in steps.items()):
        return ()
    return tuple(Probe(name, probes[name].neutral, step, shape) for name, step in steps.items() if step)


def change_points(problem: Problem, linear: Sequence[LinearizedRun]) -> list[float]:
    """The instants [s] at which something happens: from which on the residuals of a channel have another mean, the plainest
    channel first, and the one at which their squares burst.

    The former maximise the cumulative sum of what residuals are above their mean, over all runs (Page's test; Basseville and
    Nikiforov, Detection of Abrupt Changes, 2.6): its square over n f (1 - f), with n samples and a part f of them before.
    Where the fit has bent its parameters to a lasting change, only the transient at its beginning is left: the latter begins
    the window, of any length, whose squares are above their mean by the most standard deviations (a scan statistic).
    """
    times = np.unique(np.concatenate([run.time for run in problem.runs]))
    times = times[:: -(-len(times) // CRITERIA.most_instants)]
    evidence: dict[str, Vector] = {}
    squares, count = np.zeros(len(times)), np.zeros(len(times))
    for run, found in zip(problem.runs, linear, strict=True):
        for name, residuals, weight in zip(run.channels, found.residuals, run.weight, strict=True):
            known = weight > 0.0
            if known.sum() > 1:
                before = np.searchsorted(run.time[known], times)
                sums = np.concatenate([[0.0], np.cumsum(residuals[known] - residuals[known].mean())])[before]
                part = before / known.sum()
                among = np.where((part > 0.0) & (part < 1.0), part * (1.0 - part), np.inf) * known.sum()
                evidence[name] = evidence.get(name, np.zeros(len(times))) + sums**2 / among
                squares += np.concatenate([[0.0], np.cumsum(residuals[known] ** 2)])[before]
                count += before
    ordered = sorted(evidence.values(), key=lambda shown: -float(shown.max()))
    means = [float(times[np.argmax(shown)]) for shown in ordered[: CRITERIA.tried_instants]]
    return list(dict.fromkeys([*means, *burst(times, squares, count)]))


def burst(times: Vector, squares: Vector, count: Vector) -> list[float]:
    """The instant (of times (k,)) that begins the window in which squares are most above their mean; none without any.

    `squares`, `count` (k,): sums before each instant. That of n white residuals varies by sqrt(2 n).
    """
    if len(times) < 2 or squares[-1] <= squares[0]:
        return []
    excess = squares - squares[0] - (squares[-1] - squares[0]) / (count[-1] - count[0]) * (count - count[0])
    best = (0.0, float(times[0]))
    for width in 2 ** np.arange(int(np.log2(len(times)))):
        n = count[width:] - count[:-width]
        above = (excess[width:] - excess[:-width]) / np.sqrt(np.maximum(n, 1.0))
        best = max(best, (float(above.max()), float(times[np.argmax(above)])))
    return [best[1]]


def probe_all(
    problem: Problem, z: Vector, candidates: Sequence[Candidate], linear: Sequence[LinearizedRun], pool: Executor
) -> dict[int, Vector]:
    """The change of all residuals by every probe, (N,) by the probe's id; without those that cannot be run.

    That by an effect in all wires is the sum of those by it in each wire alone, where these are probed too: to first order.
    """
    config, nearby = problem.fitted(z), near(problem, [run.correction for run in linear])
    measured, sums = {channel for run in problem.runs for channel in run.channels}, in_each_wire(candidates)
    probes = [
        (candidate, probe)
        for candidate in candidates
        for family in candidate.families
        for probe in family
        if id(probe) not in sums and candidate.found.effect.is_seen(probe.parameter, measured)
    ]
    values = [{**probe.shape, probe.parameter: probe.neutral + probe.step} for _, probe in probes]
    configs = [with_effect(config, one.found, at) for (one, _), at in zip(probes, values, strict=True)]
    base = [run.residuals for run in linear]
    changes = [change_of(shown, base) for shown in residuals_under(nearby, z, configs, pool)]
    found = {id(probe): change for (_, probe), change in zip(probes, changes, strict=True) if change is not None}
    run = ((whole, parts) for whole, parts in sums.items() if found.keys() >= set(parts))
    return found | {whole: np.sum([found[part] for part in parts], axis=0) for whole, parts in run}


def in_each_wire(candidates: Sequence[Candidate]) -> dict[int, list[int]]:
    """By the id of each probe of an effect in all wires, those of the same probe in one wire after the other, where all of
    these are among the candidates."""
    alike = defaultdict[tuple[int, Hashable], dict[int, list[int]]](dict)
    for candidate in candidates:
        effect, scope = candidate.found.effect, candidate.found.effect.scope
        if not scope.name or (scope.wire != EVERY and not scope.field):
            for probe in (probe for family in candidate.families for probe in family):
                same = effect.plain_name, probe.parameter, probe.step, tuple(sorted(probe.shape.items()))
                alike[effect.structure.wires, same].setdefault(scope.wire, []).append(id(probe))
    complete = [ids for (wires, _), ids in alike.items() if EVERY in ids and len(ids) == wires + 1]
    return {whole: [one for one, *_ in ids.values()] for ids in complete for whole in ids.pop(EVERY)}


class Projection:
    """Takes from a response what the fitted unknowns can absorb; their priors hold them back as in the fit."""

    def __init__(self, linear: Sequence[LinearizedRun], n: int, tempering: float = 1.0) -> None:
        parts = (normal_equations(run, robust=False) for run in linear)
        self._linear, self._prior = linear, tempering**2
        self._inverse = np.linalg.inv(accumulated(parts, np.zeros(n), tempering)[2])

    def __call__(self, response: Vector) -> Vector:
        """The part that is left, (N,)."""
        absorbed = self._inverse @ self._scores(response)
        rest = [
            part - absorbed[run.indices] @ run.jacobian.reshape(len(run.indices), -1)
            for run, part in zip(self._linear, self._by_run(response), strict=True)
        ]
        return np.concatenate(rest)

    def _by_run(self, responses: Vector | Matrix) -> list[NDArray[np.float64]]:
        """The part of every run of responses (..., N)."""
        return np.split(responses, np.cumsum([run.residuals.size for run in self._linear])[:-1], axis=-1)

    def _scores(self, responses: Vector | Matrix) -> NDArray[np.float64]:
        """Products of responses (..., N) with all derivatives, (..., n)."""
        scores = np.zeros((*responses.shape[:-1], len(self._inverse)))
        for run, part in zip(self._linear, self._by_run(responses), strict=True):
            scores[..., run.indices] += part @ run.jacobian.reshape(len(run.indices), -1).T
        return scores

    def products(self, responses: Matrix, with_what: Vector) -> tuple[Vector, Vector]:
        """What is left of responses (m, N) times a vector (N,), and its squares, (m,) each, by half the work that what is
        left itself takes. NaN of those that are not `visible`."""
        scores = self._scores(responses)
        absorbed = scores @ self._inverse
        before = np.einsum('ij,ij->i', responses, responses)
        squares = before - np.sum(absorbed * scores, axis=1) - self._prior * np.sum(absorbed**2, axis=1)
        seen = (before > 0.0) & (squares >= CRITERIA.min_unabsorbed * before)
        left = responses @ with_what - absorbed @ self._scores(with_what)
        return np.where(seen, left, np.nan), np.where(seen, squares, np.nan)

    def visible(self, response: Vector) -> Vector | None:
        """The part that is left; None where the channels do not see the response, or all of it can be absorbed."""
        rest, size = self(response), float(response @ response)
        return None if size == 0.0 or float(rest @ rest) < CRITERIA.min_unabsorbed * size else rest


def explained(probes: Sequence[Probe], responses: Matrix, residuals: Vector) -> tuple[float, Vector]:
    """The gain of what is left of the responses (probes, N) to probes together, and their amounts (>= 0)."""
    scale = 1.0 / np.linalg.norm(responses, axis=1)
    columns = responses * scale[:, None]
    gram, targets = columns @ columns.T + 1e-9 * np.eye(len(scale)), -columns @ residuals
    gain, amounts = 0.0, np.zeros(len(scale))
    for active in one_side_each(tuple(probe.parameter for probe in probes)):
        found = np.linalg.solve(gram[active[:, :, None], active[:, None, :]], targets[active][:, :, None])[:, :, 0]
        gained = np.where((found > 0.0).all(axis=1), np.sum(found * targets[active], axis=1), 0.0)
        best = int(gained.argmax())
        if gained[best] > gain:
            gain, amounts = float(gained[best]), np.zeros(len(scale))
            amounts[active[best]] = found[best]
    return gain, scale * amounts


@cache
def one_side_each(parameters: tuple[str, ...]) -> tuple[NDArray[np.int64], ...]:
    """Sets of probes that may act together, the best of which has positive amounts: of each parameter one, up or down. By
    their size, (sets, size)."""
    sides = [[-1, *(k for k, other in enumerate(parameters) if other == name)] for name in dict.fromkeys(parameters)]
    sets = [[k for k in chosen if k >= 0] for chosen in product(*sides)]
    return tuple(np.array([one for one in sets if len(one) == size]) for size in range(1, len(sides) + 1))


def values_at(probes: Sequence[Probe], amounts: Vector) -> dict[str, float]:
    """The parameters at the best amounts of all probes of a family."""
    values = dict(probes[0].shape)
    for probe, amount in zip(probes, amounts, strict=True):
        before = values.get(probe.parameter, probe.neutral)
        values[probe.parameter] = before + float(amount) * probe.step
    return values
