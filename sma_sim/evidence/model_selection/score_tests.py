"""Score tests: what each candidate could explain of the residuals that the fitted parameters cannot.

With residuals r, and s' what no fitted unknown can absorb (`projection`) of the response to a probe of a candidate, all over
noise, the sum of squares decreases to first order by the largest of -2 a s'r - a^2 s's' over a >= 0.
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
    change_of,
    linearize,
    near,
    residuals_at,
    residuals_under,
)
from sma_sim.evidence.estimation.projection import Projection
from sma_sim.evidence.model_selection.candidates import Candidate, Probe, at_instants, instants_of, with_effect
from sma_sim.evidence.residual_analysis.change_points import change_points
from sma_sim.model.arrays import Matrix, Vector
from sma_sim.model.effects.scope import EVERY
from sma_sim.solver.simulate import SimulationError

HELD = (1.0, 10.0, 100.0)  # times as narrow as priors are, which holds unknowns back where first order asks too much of them
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
        self._known: dict[Probe, Vector | None] = {}
        self.tested: tuple[ScreeningResult, ...] = ()  # beside the fit, also those that gain nothing

    @cached_property
    def linear(self) -> list[LinearizedRun]:
        """The fit linearised. Raises SimulationError."""
        return linearize(self._problem, self._z, self._pool)

    def beside(self, candidates: Sequence[Candidate]) -> tuple[ScreeningResult, ...]:
        """The candidates by gain, the largest first; those that the channels cannot see are left out. Raises
        SimulationError."""
        self.tested = ranked(self._problem, self.linear, candidates, self.responses)
        return tuple(one for one in self.tested if one.gain > 0.0)

    def in_place(self, rest: Problem, z: Vector, candidates: Sequence[Candidate]) -> tuple[ScreeningResult, ...]:
        """The same beside what an effect less leaves of the fit: the problem `rest`, at its z.

        To first order, responses are those beside the whole fit, and its derivatives are those of the rest. What acts as the
        effect does, in other places too, cannot act beside it, and is probed without it. Raises SimulationError.
        """
        shown = residuals_at(near(rest, [run.correction for run in self.linear]), z, self._pool)
        linear = [
            replace(run, residuals=here) for run, here in zip(self._within(rest), shown, strict=True) if here is not None
        ]
        if len(linear) < len(shown):
            raise SimulationError('the model cannot be run without one of its effects')
        law = self._laws_beyond(rest)

        def responses(some: Sequence[Candidate]) -> Mapping[Probe, Vector]:
            alike = [one for one in some if one.effect.plain_name in law]
            others = [one for one in some if one.effect.plain_name not in law]
            return {**self.responses(others), **probe_all(rest, z, alike, linear, self._pool)}

        return tuple(one for one in ranked(rest, linear, candidates, responses) if one.gain > 0.0)

    def in_tangent(
        self, rest: Problem, candidates: Sequence[Candidate], worth: float
    ) -> tuple[tuple[ScreeningResult, ...], float]:
        """In place of an effect that changes so much that without it no first order holds: all responses, its own too, are
        those where the fit lies, its strengths times the derivatives in them. And its own gain. `rest`: the problem without.

        `worth`: by how much squares are known to rise without the effect. Where it seems that other unknowns could absorb
        more of its response, they would have to go further than first order holds, and are held back until they do not.
        Left out is the effect in other places, which cannot be probed beside it. Raises SimulationError.
        """
        steps, law = self._to_neutral(rest), self._laws_beyond(rest)
        own = [np.tensordot(list(steps.values()), run.jacobian[list(steps)], 1) for run in self.linear]
        linear = [
            replace(run, residuals=run.residuals + change) for run, change in zip(self._within(rest), own, strict=True)
        ]
        response, gain = -np.concatenate([change.ravel() for change in own]), 0.0
        for held in HELD:
            damped = replace(rest, tempering=rest.tempering * held)
            project = Projection(linear, len(rest.unknowns), damped.tempering)
            left = project.visible(response)
            gain = 0.0 if left is None else float(left @ project.residuals) ** 2 / float(left @ left)
            if gain >= worth:
                break
        others = [one for one in candidates if one.effect.plain_name not in law]
        return tuple(one for one in ranked(damped, linear, others, self.responses) if one.gain > 0.0), gain

    def _laws_beyond(self, rest: Problem) -> set[str]:
        """Names, without their scopes, of the effects that a problem lacks."""
        return {one.effect.plain_name for one in self._problem.config.effects if one not in rest.config.effects}

    def _within(self, rest: Problem) -> list[LinearizedRun]:
        """The fit linearised in the unknowns of the problem without one of its effects."""
        kept = [k for k, free in enumerate(self._problem.free) if free in rest.free]
        kept += range(len(self._problem.free), len(self._problem.unknowns))
        return [
            replace(run, indices=indices, jacobian=run.jacobian[kept[: len(indices)]])
            for run, indices in zip(self.linear, rest.indices(), strict=True)
        ]

    def _to_neutral(self, rest: Problem) -> dict[int, float]:
        """By index in z, from where to where the strengths of what a problem lacks would have to go to act no more."""
        neutral = {
            f'effects.{one.effect.name}.{p.name}': p.neutral
            for one in self._problem.config.effects if one not in rest.config.effects
            for p in one.effect.parameters if p.neutral is not None
        }  # fmt: skip
        free = enumerate(self._problem.free)
        return {k: one.coordinate(neutral[one.name]) - float(self._z[k]) for k, one in free if one.name in neutral}

    def responses(self, candidates: Sequence[Candidate]) -> Mapping[Probe, Vector]:
        """The changes (N,) of all residuals by the probes of candidates beside the fit, each made once; without those that
        cannot be run."""
        new = [one for one in candidates if not self._known.keys() >= {*one.probes}]
        found = probe_all(self._problem, self._z, new, self.linear, self._pool)
        self._known |= {probe: found.get(probe) for one in new for probe in one.probes}
        known = ((probe, self._known[probe]) for one in candidates for probe in one.probes)
        return {probe: response for probe, response in known if response is not None}


def screen(problem: Problem, z: Vector, candidates: Sequence[Candidate], pool: Executor) -> tuple[ScreeningResult, ...]:
    """The candidates beside a fit by gain (`ScoreTests.beside`)."""
    return ScoreTests(problem, z, pool).beside(candidates)


def ranked(
    problem: Problem,
    linear: Sequence[LinearizedRun],
    candidates: Sequence[Candidate],
    responses: Callable[[Sequence[Candidate]], Mapping[Probe, Vector]],
) -> tuple[ScreeningResult, ...]:
    """The candidates by gain, the largest first, from the `responses` to their probes."""
    if any(instants_of(candidate.effect) for candidate in candidates):
        instants = change_points(problem, linear)
        candidates = [at_instants(candidate, instants) for candidate in candidates]
    project = Projection(linear, len(problem.unknowns), problem.tempering)

    def tested(some: Sequence[Candidate]) -> list[ScreeningResult]:
        shown = responses(some)
        return [score_test(candidate, shown, project) for candidate in some]

    found = tested(candidates)
    weak = {k: Candidate(one.candidate.effect, (family,)) for k, one in enumerate(found) if (family := nearer_probes(one))}
    for k, again in zip(weak, tested(list(weak.values())), strict=True):
        lines = (*found[k].lines, *again.lines)
        best = again if again.gain > found[k].gain else found[k]
        found[k] = replace(best, candidate=found[k].candidate, lines=lines)
    return tuple(sorted(found, key=lambda result: -result.gain))


def score_test(candidate: Candidate, responses: Mapping[Probe, Vector], project: Projection) -> ScreeningResult:
    """What the best family of a candidate's probes could explain; nothing where the channels cannot see it."""
    best, lines = ScreeningResult(candidate, 0.0, {}), list[tuple[float, float, float]]()
    for family in candidate.families:
        projected = [(probe, project.visible(responses[probe])) for probe in family if probe in responses]
        visible = [(probe, response) for probe, response in projected if response is not None]
        lines += [(0.0, 0.0, candidate.largest(probe)) for probe, response in projected if response is None]
        if visible:
            lines += [(float(one @ project.residuals), float(one @ one), candidate.largest(probe)) for probe, one in visible]
            probes = [probe for probe, _ in visible]
            gain, amounts = explained(probes, np.array([response for _, response in visible]), project.residuals)
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


def probe_all(
    problem: Problem, z: Vector, candidates: Sequence[Candidate], linear: Sequence[LinearizedRun], pool: Executor
) -> dict[Probe, Vector]:
    """The change (N,) of all residuals by every probe; without those that cannot be run.

    That by an effect in all wires is the sum of those by it in each wire alone, where these are probed too: to first order.
    """
    config, nearby = problem.fitted(z), near(problem, [run.correction for run in linear])
    measured, sums = {channel for run in problem.runs for channel in run.channels}, in_each_wire(candidates)
    probes = [
        (candidate, probe)
        for candidate in candidates
        for probe in candidate.probes
        if probe not in sums and candidate.effect.is_seen(probe.parameter, measured)
    ]
    values = [{**probe.shape, probe.parameter: probe.neutral + probe.step} for _, probe in probes]
    configs = [with_effect(config, one.effect, at) for (one, _), at in zip(probes, values, strict=True)]
    base = [run.residuals for run in linear]
    changes = [change_of(shown, base) for shown in residuals_under(nearby, z, configs, pool)]
    found = {probe: change for (_, probe), change in zip(probes, changes, strict=True) if change is not None}
    run = ((whole, parts) for whole, parts in sums.items() if found.keys() >= set(parts))
    return found | {whole: np.sum([found[part] for part in parts], axis=0) for whole, parts in run}


def in_each_wire(candidates: Sequence[Candidate]) -> dict[Probe, list[Probe]]:
    """By probe of an effect in all wires, the same ones in one wire after the other, where all of these are among the
    candidates."""
    alike = defaultdict[tuple[int, Hashable], dict[int, list[Probe]]](dict)
    for candidate in candidates:
        effect, scope = candidate.effect, candidate.effect.scope
        if not scope.name or (scope.wire != EVERY and not scope.field):
            for probe in candidate.probes:
                same = effect.plain_name, probe.parameter, probe.step, tuple(sorted(probe.shape.items()))
                alike[effect.structure.wires, same].setdefault(scope.wire, []).append(probe)
    complete = [by_wire for (wires, _), by_wire in alike.items() if EVERY in by_wire and len(by_wire) == wires + 1]
    return {whole: [one for one, *_ in by_wire.values()] for by_wire in complete for whole in by_wire.pop(EVERY)}


def at_finite_step(candidate: Candidate) -> ScreeningResult:
    """A candidate with its strengths a probe's step from neutral."""
    family = candidate.families[len(candidate.families) // 2]
    first = {probe.parameter: probe.neutral + probe.step for probe in reversed(family)}  # of two sides
    return ScreeningResult(candidate, 0.0, {**family[0].shape, **first})


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
