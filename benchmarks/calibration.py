"""Is a probability of 90 % right in 90 % of cases? Diagnoses of robots with fresh seeds, and what they say of the truth.

    python benchmarks/calibration.py [--parts nothing one pairs forms unlisted] [--seed 7000] [--minutes 60] [--at-once 2]
                                     [--share 0.1] [--figure docs/figures/reliability.png]

Each case is a robot with other parameters, MAS kinetics and noise (sma_sim/challenge), three runs of 60 s at 20 Hz, the last
of them held out; with and without forces, every third one in a closed loop (a PI controller of the angle, which sets the
power five times a second). Hidden are nothing; one effect, whose strength is scaled until the best fit without it leaves
about the error that is asked for, or as it is drawn; two effects; a law of the library in another form or in a part of its
places (`other_form_truths.py`); a law that no list has.

An answer is what a model of the posterior says: `none`, `unlisted`, or effects with their scopes. Its probability is the sum
of the weights of such models. Counted are

- how often the most probable answer is right, by its probability (reliability), and the mean distance of the two (expected
  calibration error);
- the log score: the mean log probability of the truth;
- the mean probability of the truth where the data can show it: where the model with the robot's own laws, fitted from the
  robot's own values, is more probable than each model that lacks one of them, by more than 10 nats;
- the mean P(none) where nothing is missing.

What is hidden cannot be seen where that model is less probable than one that lacks a part of it: that is then right too,
which is `none` where it lacks everything. A law of the sensors, which no model simulates, is taken to be the listed effect.
Finished cases are kept in --file, so that a run can be continued; tables and figure are of all in it.
"""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from threading import Event
from typing import Any

import numpy as np
from cases import add_options, drawn, of, solved
from challenges import PAIRS
from matplotlib.figure import Figure
from other_form_truths import FORMS
from recovery import STRENGTHS, at_strength
from scipy.stats import binomtest

from sma_sim.challenge.draw import named_truth
from sma_sim.challenge.make import Challenge, RecordingPlan, challenge_with, noisy_recording
from sma_sim.challenge.robot import Hidden, Robot
from sma_sim.challenge.truth import Truth, truths
from sma_sim.evidence.data.recording import Dataset
from sma_sim.evidence.data.train_test_split import hold_out_last
from sma_sim.evidence.diagnosis.diagnose import Diagnosis, diagnose
from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.estimation.levenberg_marquardt import refit
from sma_sim.evidence.estimation.prepared_fit import prepare
from sma_sim.evidence.estimation.problem import Problem
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.estimation.stop_criteria import ADDED_EFFECT
from sma_sim.evidence.model_selection.candidates import Candidate, candidates_for
from sma_sim.evidence.model_selection.model_changes import with_candidate
from sma_sim.evidence.model_selection.nominal_fit import DiagnosisRequest, nominal_fit
from sma_sim.evidence.model_selection.score_tests import ScreeningResult
from sma_sim.evidence.search.posterior import Posterior
from sma_sim.evidence.search.prior import SPARSITY
from sma_sim.evidence.search.score import Evidence, evidence_of
from sma_sim.model.config import Config
from sma_sim.model.effects.conversion import effect_on
from sma_sim.model.effects.discovery import ActiveEffect, find_effects
from sma_sim.model.effects.scope import FORM, SEPARATOR
from sma_sim.report.palette import BLUE, GREY
from sma_sim.report.style import plain_axes, save, sized_figure
from sma_sim.solver.fixed_rate import FixedRateRun
from sma_sim.solver.inputs import Input
from sma_sim.solver.simulate import SimulationError

NONE, UNLISTED, NOTHING = 'none', 'unlisted', 'nothing'
PARTS = (NOTHING, 'one', 'pairs', 'forms', UNLISTED)
PLAN = RecordingPlan(3, 60.0, 20.0)
ERRORS = (1.005, 1.02, 1.05, 1.1, 1.3, 2.0, 4.0)  # over noise that the best fit without the effect leaves
AS_DRAWN = 0.0  # instead of one of them
VISIBLE = 10.0  # nats by which the true model is more probable than one that lacks a part of it
EDGES = (0.0, 0.5, 0.7, 0.9, 0.97, 0.99, 0.999, 1.0)  # of the probabilities by which answers are counted
LEAST = 1e-10  # probability of the truth that the log score counts, at the least
STEP_RATE, CONTROL_EVERY = 100, 20  # [Hz], steps: of the closed loop
K_P, K_I, J_MAX, MAX_TARGET = 60.0, 20.0, 15.0, 0.06  # [W/rad], [W/(rad s)], [W], [rad]
TARGET_LASTS = 10.0  # [s]
Case = tuple[str, tuple[str, ...], float, int, bool, bool]  # part, hidden, error, seed, with forces, in a closed loop


def cases(parts: Sequence[str], seed: int) -> list[Case]:
    """All cases; each has a seed of its own, and forces, pose, open and closed loop take turns."""
    hidden: list[tuple[str, tuple[str, ...], float]] = [(NOTHING, (), AS_DRAWN)] * 66
    hidden += [('one', (name,), error) for name in STRENGTHS for error in ERRORS]
    listed = sorted({one.library for one in truths().values() if one.library})
    hidden += [('one', (name,), AS_DRAWN) for name in listed] * 2
    hidden += [('pairs', pair, AS_DRAWN) for pair in PAIRS] * 4
    hidden += [('forms', (name,), AS_DRAWN) for name in FORMS] * 2
    hidden += [(UNLISTED, (name,), AS_DRAWN) for name, one in truths().items() if not one.library] * 2
    found = [
        (part, names, error, seed + k, k % 2 == 0, k % 3 == 0 and not any(map(is_of_sensors, names)))
        for k, (part, names, error) in enumerate(hidden)
    ]
    return [case for case in found if case[0] in parts]


def truth_of(name: str) -> Truth:
    """A hidden law by its name: of another form, else of a challenge."""
    return FORMS[name].truth if name in FORMS else named_truth(name)


def is_of_sensors(name: str) -> bool:
    """Whether a law acts on what is shown only, which no controller of these sees."""
    return truth_of(name).sensor is not None


def solve(
    part: str, hidden: Sequence[str], error: float, seed: int, forces: bool, closed: bool, pool: Executor
) -> dict[str, Any]:
    """Make one robot, diagnose it, and compare the answers with the truth."""
    made = challenge_of(hidden, error, seed, forces, closed, pool)
    found = diagnose(made.dataset, made.nominal, executor=pool)
    odds, seen = odds_of_truth(made, pool)
    return {
        'verdict': found.verdict,
        'answers': answers(found.posterior),
        'truth': right_answers(part, hidden, found),
        'odds': odds,
        'seen': seen,
        'k': found.posterior.overdispersion,
        'bare': found.stages[0].train,
        'last': found.stages[-1].train,
    }


def challenge_of(hidden: Sequence[str], error: float, seed: int, forces: bool, closed: bool, pool: Executor) -> Challenge:
    """The robot of a case, with its recordings."""
    chosen = [truth_of(name) for name in hidden]
    if error != AS_DRAWN:
        chosen = [at_strength(hidden[0], error, seed, forces, PLAN, pool)[0]]
    made = challenge_with(chosen, seed, forces, PLAN)
    if closed:
        made = in_closed_loop(made, seed, forces)
    return made


def in_closed_loop(made: Challenge, seed: int, forces: bool) -> Challenge:
    """The same robot under a controller: its commands are recorded, and what it does under them."""
    random = np.random.default_rng([seed, len(made.dataset.recordings)])
    recordings = []
    for recording in made.dataset.recordings:
        command = commanded(made.robot, made.nominal.parameters['environment.T_E'], random)
        time, channels = made.robot.measure(command, PLAN.rate)
        recordings.append(noisy_recording(recording.name, command, time, channels, made.dataset.noise_std, random))
    return replace(made, dataset=Dataset(tuple(recordings), made.dataset.noise_std))


def commanded(robot: Robot, T_E: float, random: np.random.Generator) -> Input:
    """The power that a PI controller of the angle sets while its target jumps; it does not wind up at its limits."""
    run, J_eq, integral = FixedRateRun(robot.model, STEP_RATE, np.array([0.0, T_E])), 0.0, 0.0
    targets, rows = random.uniform(-MAX_TARGET, MAX_TARGET, math.ceil(PLAN.duration / TARGET_LASTS)), []
    while run.time < PLAN.duration:
        if run.k % CONTROL_EVERY == 0:
            error = targets[int(run.time / TARGET_LASTS)] - run.shown('alpha')
            wanted = K_P * error + K_I * integral
            J_eq = min(max(wanted, -J_MAX), J_MAX)
            if J_eq == wanted:
                integral += error * CONTROL_EVERY / STEP_RATE
            rows.append((run.time, J_eq))
        run.step(np.array([J_eq, T_E]))
    times, powers = np.array([*rows, (PLAN.duration, J_eq)]).T
    return Input(times, np.column_stack([powers, np.full(len(times), T_E)]), (False, False))


def answers(posterior: Posterior) -> dict[str, float]:
    """The probability of every answer of the models that were fitted, the most probable first; what was not has the rest."""
    found: dict[str, float] = {}
    for model, weight in zip(posterior.models, posterior.weights, strict=True):
        names = sorted(one.name for one in model.of_robot if not one.is_formula)
        unlisted = 1.0 if any(one.is_formula for one in model.components) else model.unlisted
        for answer, share in ((UNLISTED, unlisted), ('+'.join(names) or NONE, 1.0 - unlisted)):
            found[answer] = found.get(answer, 0.0) + weight * share
    return dict(sorted(found.items(), key=lambda item: -item[1]))


def right_answers(part: str, hidden: Sequence[str], found: Diagnosis) -> list[str]:
    """What answers are the truth; a name stands for itself in any scope, NAME@ for itself everywhere."""
    if part == NOTHING:
        return [NONE]
    if part == UNLISTED:
        return [UNLISTED]
    if part != 'forms':
        return ['+'.join(sorted(hidden))]
    form = FORMS[hidden[0]]
    terms = found.proposal.formula.terms if found.proposal else ()
    exact = tuple(term.name for term in terms) in form.terms
    return [*([f'{form.effect}@{scope}' for scope in form.scopes] if form.effect else [NONE]), *([UNLISTED] * exact)]


def is_truth(answer: str, result: Mapping[str, Any]) -> bool:
    """Whether an answer is right: the truth, its law in another form at the same places, or the part of it that is more
    probable than the whole."""
    plain = '+'.join(sorted(name.partition(SEPARATOR)[0] for name in answer.split('+')))
    scoped = answer if SEPARATOR in answer else f'{answer}{SEPARATOR}'
    listed = re.sub(rf'_?{FORM}\w+$', '', scoped)
    return plain == result['seen'] or bool({answer, plain, scoped, listed}.intersection(result['truth']))


def odds_of_truth(made: Challenge, pool: Executor) -> tuple[float | None, str | None]:
    """By how many nats the robot's own laws are more probable than each model that lacks one of them, and the answer that
    such a model gives where it is the more probable one. None where nothing is hidden, or nothing that can be simulated."""
    hidden = made.robot.hidden
    if not hidden or any(one.truth.sensor is not None and not one.truth.library for one in hidden):
        return None, None
    training, _ = hold_out_last(made.dataset, None)
    context = SearchContext(pool, Event())
    nominal = nominal_fit(prepare(training, made.nominal, 'mas'), DiagnosisRequest().options, context)
    log_prior = -SPARSITY - math.log(len(candidates_for(made.nominal)))
    laws = [(one.truth.library or UNLISTED, as_simulated(one, made.nominal)) for one in hidden]
    whole = evidence_with([law for _, law in laws], made.robot, nominal, log_prior, context)
    lacking = {NONE: evidence_of(nominal, 0.0, context)} | {
        '+'.join(sorted(name for name, _ in some)): evidence_with(
            [law for _, law in some], made.robot, nominal, log_prior, context
        )
        for count in range(1, len(laws))
        for some in combinations(laws, count)
    }
    k = min(one.overdispersion for one in (whole, *lacking.values()))
    best = max(lacking, key=lambda answer: lacking[answer].score(k))
    odds = whole.score(k) - lacking[best].score(k)
    return odds, best if odds < 0.0 else None


def as_simulated(hidden: Hidden, nominal: Config) -> tuple[ActiveEffect, ...]:
    """The effects of a law; one of the sensors is the listed effect, at its defaults."""
    if hidden.truth.sensor is None:
        return hidden.truth.active(hidden.values)
    effect = effect_on(find_effects()[hidden.truth.library], nominal.structure)
    return (ActiveEffect(effect, tuple(p.default for p in effect.parameters)),)


def evidence_with(
    laws: Iterable[Sequence[ActiveEffect]], robot: Robot, nominal: FitResult, log_prior: float, context: SearchContext
) -> Evidence:
    """The evidence of a model with some of the robot's laws: the better of two fits, from the robot's values and the
    nominal fit's."""
    fit, chosen = nominal, list(laws)
    for active in (one for law in chosen for one in law):
        values = {p.name: value for p, value in zip(active.effect.parameters, active.values, strict=True)}
        problem, z = with_candidate(fit, ScreeningResult(Candidate(active.effect, ()), 0.0, values))
        fit = FitResult(problem, z, math.inf)
    starts = (fit.z, at_values(fit.problem, fit.z, robot.parameters))
    found = [one for z in starts if (one := refit(fit.problem, z, context, ADDED_EFFECT)) is not None]
    if not found:
        raise SimulationError("the robot's own laws cannot be simulated from its own values")
    return evidence_of(min(found, key=lambda one: one.cost), len(chosen) * log_prior, context)


def at_values(problem: Problem, z: Any, values: Mapping[str, float]) -> Any:
    """A point with the robot's own parameters."""
    there = z.copy()
    for k, free in enumerate(problem.free):
        if free.name in values:
            there[k] = np.clip(free.coordinate(values[free.name]), free.low, free.high)
    return there


def truth_probability(result: Mapping[str, Any]) -> float:
    """The probability of all answers that are right."""
    return float(sum(p for answer, p in result['answers'].items() if is_truth(answer, result)))


def most_probable(result: Mapping[str, Any]) -> tuple[float, bool]:
    """The probability of the most probable answer, and whether it is right."""
    answer, p = max(result['answers'].items(), key=lambda item: item[1])
    return float(p), is_truth(answer, result)


def bins(results: Sequence[Mapping[str, Any]]) -> list[tuple[float, float, int, int]]:
    """By bin that holds any: lower edge, mean probability of the most probable answers, how many are right, and of all."""
    said, found = [most_probable(one) for one in results], []
    for low, high in zip(EDGES, EDGES[1:], strict=False):
        own = [(p, right) for p, right in said if low <= p < high or (high == 1.0 and p >= high)]
        if own:
            found.append((low, float(np.mean([p for p, _ in own])), sum(right for _, right in own), len(own)))
    return found


def expected_calibration_error(results: Sequence[Mapping[str, Any]]) -> float:
    """The mean distance of what is said from what is right, weighted by how often it is said."""
    return sum(count * abs(mean - right / count) for _, mean, right, count in bins(results)) / len(results)


def table(results: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """Reliability, scores by part, then every case."""
    failed, results = [one for one in results if 'failed' in one], [one for one in results if 'failed' not in one]
    yield f'{len(results)} robots' + (f', {len(failed)} more refused by the program' if failed else '')
    yield ''
    if not results:
        return
    yield '| probability of the most probable answer | mean | right |'
    yield '|---|---|---|'
    for low, mean, right, count in bins(results):
        yield f'| from {low:g} | {mean:.3f} | {of(right, count)} |'
    yield ''
    yield f'expected calibration error: {expected_calibration_error(results):.3f}'
    yield f'log score: {np.mean([math.log(max(truth_probability(one), LEAST)) for one in results]):.3f} nats'
    seen = [one for one in results if one['odds'] is not None and one['odds'] > VISIBLE]
    yield f'mean probability of the truth where its odds are above {VISIBLE:g} nats: {mean_of(seen, truth_probability)}'
    nothing = [one for one in results if one['case'][0] == NOTHING]
    yield f'mean P(none) where nothing is missing: {mean_of(nothing, truth_probability)}'
    yield ''
    yield '| part | cases | most probable answer right | mean probability of the truth | where it can be seen |'
    yield '|---|---|---|---|---|'
    groups: list[tuple[str, Callable[[Any], bool]]] = [(part, lambda case, p=part: case[0] == p) for part in PARTS]
    groups += [('with forces', lambda case: case[4]), ('pose alone', lambda case: not case[4])]
    groups += [('closed loop', lambda case: case[5]), ('open loop', lambda case: not case[5])]
    for name, belongs in groups:
        own = [one for one in results if belongs(one['case'])]
        if own:
            right = of(sum(most_probable(one)[1] for one in own), len(own))
            visible = mean_of([one for one in own if one in seen], truth_probability)
            yield f'| {name} | {len(own)} | {right} | {mean_of(own, truth_probability)} | {visible} |'
    yield ''
    yield '| part | hidden | error asked | seed | recorded | loop | error without | with | odds [nats] | P(truth) | said |'
    yield '|---|---|---|---|---|---|---|---|---|---|---|'
    for one in sorted(results, key=lambda one: PARTS.index(one['case'][0])):
        yield line(one)


def line(one: Mapping[str, Any]) -> str:
    """One case."""
    part, hidden, error, seed, forces, closed = one['case']
    said = ', '.join(f'{answer} {p:.3f}' for answer, p in list(one['answers'].items())[:3])
    asked, odds = f'{error:g}' if error else 'as drawn', '' if one['odds'] is None else f'{one["odds"]:.1f}'
    return (
        f'| {part} | {", ".join(hidden)} | {asked} | {seed} | {"forces" if forces else "pose"} | '
        f'{"closed" if closed else "open"} | {one["bare"]:.3f} | {one["last"]:.3f} | {odds} | '
        f'{truth_probability(one):.3f} | {said} |'
    )


def mean_of(results: Sequence[Mapping[str, Any]], value: Callable[[Any], float]) -> str:
    """The mean of a value and how many there are."""
    return f'{np.mean([value(one) for one in results]):.3f} ({len(results)})' if results else '-'


def draw(results: Sequence[Mapping[str, Any]]) -> Figure:
    """Reliability diagram: how often answers are right, against the probability that is said, with 95 % intervals."""
    figure = sized_figure(5.2, 4.6)
    axis = figure.subplots()
    plain_axes(axis)
    axis.plot([0.0, 1.0], [0.0, 1.0], color=GREY, ls=':', label='calibrated')
    found = bins(results)
    said, shares = [mean for _, mean, _, _ in found], [right / count for _, _, right, count in found]
    limits = [binomtest(right, count).proportion_ci(method='wilson') for _, _, right, count in found]
    reach = np.array([[share - low, high - share] for share, (low, high) in zip(shares, limits, strict=True)]).T
    axis.errorbar(said, shares, np.maximum(reach, 0.0), color=BLUE, marker='o', ls='', label=f'{len(results)} robots')
    axis.set(
        xlim=(0.0, 1.02), ylim=(0.0, 1.02), xlabel='probability of the most probable answer', ylabel='share that is right'
    )
    axis.legend(frameon=False, loc='upper left')
    return figure


def main() -> None:
    """Solve what is not in the file yet, as far as the time goes; print the tables, draw the figure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--parts', nargs='+', choices=PARTS, default=list(PARTS))
    parser.add_argument('--seed', type=int, default=7000, help='of the first robot; the others follow')
    parser.add_argument('--figure', type=Path)
    add_options(parser, 'calibration.jsonl', 60.0)
    asked = parser.parse_args()
    results = solved(drawn(cases(asked.parts, asked.seed), asked.share), solve, asked, line)
    print(*table(results), sep='\n')
    if asked.figure and results:
        save(draw([one for one in results if 'failed' not in one]), asked.figure)


if __name__ == '__main__':
    main()
