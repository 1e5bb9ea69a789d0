"""The diagnosis beside what a scientist would otherwise use, on the same robots: pysindy, gplearn, sysidentpy, emcee.

    pip install -r benchmarks/requirements-peers.txt
    python benchmarks/peers.py [--seed 8600] [--share 0.2] [--minutes 240] [--at-once 1]

40 robots as in calibration.py, with seeds of their own: nothing missing, one effect, two, a law that no list has, by turns,
as strong as they are drawn; a share of them is as mixed. `peer_methods.py` says how each program is used. All start from
the same calibrated model, whose fit is in the time of the diagnosis only; equations are sought for

- the residual, measured minus modelled, of each channel (by gplearn, which takes longest, of the channel with the largest);
  judged on the held-out run;
- the latent input that `sma-sim latent` estimates, at the place where the hidden law acts if that is reported, else at the
  best; sought in one run, judged on the other. They are handed the place, which the diagnosis has to find, and need not say
  anything where `latent` says that nothing is missing.

An equation counts where it takes away EXPLAINED of the squares of the run on which it is judged. The reading is the most
generous: an equation is right if any variable of any hidden law is in it, however many others are, and so is a diagnosis
whose most probable answer has any hidden effect, or for a law of no list says that it is unlisted; how often that answer is
exactly what is hidden is counted besides. Robots whose held-out run the calibrated model predicts with a normalized RMSE
below SEEN say nothing on hits. Where nothing is missing, an answer or an equation is a false alarm. Of robots with two
effects, 95 % intervals of PAIR stand beside emcee's, for the robot's own laws and all other parameters known. Times are
those of the processor, of all threads together.

Finished robots are kept in --file; Ctrl-C ends with the tables of those.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from functools import partial
from importlib.metadata import version
from threading import Event
from typing import Any

import numpy as np
from calibration import AS_DRAWN, NONE, NOTHING, UNLISTED, Case, answers, challenge_of, is_truth, right_answers, truth_of
from calibration import cases as calibration_cases
from cases import add_options, drawn, of, solved
from numpy.typing import NDArray
from peer_methods import (
    Equation,
    Samples,
    SeenRun,
    explained,
    genetic_equation,
    narx,
    rms,
    sampled_intervals,
    sparse_equation,
    weak_model,
)

from sma_sim.challenge.make import Challenge
from sma_sim.evidence.data.recording import CHANNEL_COLUMNS, Recording
from sma_sim.evidence.data.train_test_split import hold_out_last
from sma_sim.evidence.diagnosis.diagnose import Diagnosis, diagnose
from sma_sim.evidence.estimation.calibrate import Calibration, FitOptions, final_calibration, problem_for
from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.estimation.held_out_prediction import nuisances_of
from sma_sim.evidence.estimation.levenberg_marquardt import minimize
from sma_sim.evidence.estimation.problem import start_point
from sma_sim.evidence.estimation.residuals import model_columns
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.estimation.stop_criteria import FROM_PRIORS
from sma_sim.evidence.latent_input.latent_search import estimate_latent_inputs
from sma_sim.evidence.latent_input.results import InputFinding, LatentInputs
from sma_sim.evidence.symbolic_regression.visited_states import kernel_fields
from sma_sim.model.effects.scope import SEPARATOR

PARTS = (NOTHING, 'one', 'pairs', UNLISTED)
ROBOTS = 40
EXPLAINED = 0.05  # part of the squares of a run from which an equation counts
SEEN = 1.1  # error over noise of the held-out run from which something can be found
PAIR = ('wire.c_V', 'wire.lambda')  # the parameters whose intervals are compared: both say how hot a wire gets
STEPS = 500  # of emcee
OF_WIRE, OF_POSE = ('T', 'x', 'J', 'sigma', 'deps', 'dx'), ('alpha', 'U_x', 'U_y', 'dalpha', 'dU_x', 'dU_y', 't')
STATES = (*(f'{name}_{wire}' for wire in (1, 2) for name in OF_WIRE), *OF_POSE)
# What a law's variables are called among these states; a constant is the term 1 of an equation.
SAME = {'F': ('sigma',), 'v': ('deps',), 'T_other': ('T',), 'value': ('alpha', 'U_x', 'U_y', 'sigma'), 'constant': ('1',)}
METHODS = {
    'sma_sim': 'sma_sim.diagnose',
    'sindy_residual': 'pysindy, residual',
    'gplearn_residual': 'gplearn, residual',
    'sindy_latent': 'pysindy, latent input',
    'gplearn_latent': 'gplearn, latent input',
    'sindy_weak': 'pysindy, weak form',
    'narx': 'sysidentpy',
    'narx_residual': 'sysidentpy, residual',
}
NAMING = tuple(METHODS)[:5]  # those that say what is missing
MAX_SHOWN = 80  # characters of an equation
PROGRAMS = ('sma_sim', 'pysindy', 'gplearn', 'sysidentpy', 'emcee', 'numpy')
Matrix = NDArray[np.float64]
Search = Callable[[Sequence[Samples], Sequence[str]], Equation]


def cases(seed: int) -> list[Case]:
    """The robots; the parts take turns, so that the first ones are of all."""
    known = calibration_cases(PARTS, seed)
    parts = [drawn([case for case in known if case[0] == part and case[2] == AS_DRAWN], 1.0) for part in PARTS]
    return [case for some in zip(*parts, strict=False) for case in some][:ROBOTS]


def solve(
    part: str, hidden: Sequence[str], error: float, seed: int, forces: bool, closed: bool, pool: Executor
) -> dict[str, Any]:
    """One robot: what every method says of it."""
    made = challenge_of(hidden, error, seed, forces, closed, pool)
    found, seconds = timed(lambda: diagnose(made.dataset, made.nominal, executor=pool))
    *training, held_out = runs = seen_runs(found, made)
    latent, latent_seconds = timed(lambda: estimate_latent_inputs(made.dataset, made.nominal, executor=pool))
    finding = finding_for(latent, made)
    inputs = input_samples(finding, runs)
    result = {
        'versions': {name: version(name) for name in PROGRAMS},
        'nominal': found.nominal.held_out,
        'variables': sorted(variables_of(hidden)),
        'latent': {'verdict': latent.verdict, 'used': finding.name, 'seconds': latent_seconds},
        'sma_sim': {**diagnosed(part, hidden, found), 'held_out': found.stages[-1].held_out, 'seconds': seconds},
    }
    for name, search, channels in (('sindy', sparse_equation, None), ('gplearn', genetic_equation, 1)):
        result[f'{name}_residual'] = of_residual(search, training, held_out, channels)
        result[f'{name}_latent'] = of_latent_input(search, inputs)
    for name, simulate in (('sindy_weak', weak_model), ('narx', narx_channels), ('narx_residual', narx_of_residual)):
        shown, seconds = timed(partial(simulate, training, held_out))
        result[name] = {'held_out': rms(shown - held_out.measured), 'seconds': seconds}
    if part == 'pairs' and all(one.truth.sensor is None for one in made.robot.hidden):
        result['intervals'] = intervals(made, pool)
    return result


def timed(work: Callable[[], Any]) -> tuple[Any, float]:
    """What some work gives, and the time [s] of the processor that it takes, in all threads."""
    t_start = time.process_time()
    found = work()
    return found, time.process_time() - t_start


def diagnosed(part: str, hidden: Sequence[str], found: Diagnosis) -> dict[str, Any]:
    """The most probable answer of a diagnosis, whether it is exactly right, and whether it has any of the hidden effects."""
    said, probability = next(iter(answers(found.posterior).items()))
    exact = is_truth(said, {'seen': None, 'truth': right_answers(part, hidden, found)})
    effects = {name.partition(SEPARATOR)[0] for name in said.split('+')}
    right = exact or part in ('one', 'pairs') and bool(effects.intersection(hidden))
    return {'said': said, 'probability': probability, 'exact': exact, 'right': right}


def seen_runs(found: Diagnosis, made: Challenge) -> list[SeenRun]:
    """The recordings beside the calibrated model, the held-out one last."""
    nominal, noise = found.nominal, made.dataset.noise_std
    nuisances = nuisances_of(nominal.calibration.delay, (*nominal.calibration.runs, *nominal.predicted))
    training, held_out = hold_out_last(made.dataset, None)
    assert held_out is not None

    def seen(recording: Recording) -> SeenRun:
        columns = model_columns(nominal.config, recording, nuisances[recording.name])
        wires = [kernel_fields(recording.time, columns, nominal.config, wire) for wire in (0, 1)]
        states = [fields[name] for fields in wires for name in OF_WIRE] + [wires[0][name] for name in OF_POSE]
        return SeenRun(
            recording.name,
            recording.time,
            np.column_stack([fields['J'] for fields in wires]),
            np.column_stack([recording.channels[name] / std for name, std in noise.items()]),
            np.column_stack([columns[CHANNEL_COLUMNS[name]] / std for name, std in noise.items()]),
            np.column_stack(states),
        )

    return [seen(recording) for recording in (*training.recordings, *held_out.recordings)]


def finding_for(latent: LatentInputs, made: Challenge) -> InputFinding:
    """The reported input that acts where a hidden law does, else the best."""
    ports = {one.truth.port for one in made.robot.hidden}
    return next((one for one in latent.findings if one.hypothesis.hook in ports), latent.findings[0])


def input_samples(finding: InputFinding, runs: Sequence[SeenRun]) -> list[list[Samples]]:
    """By port, of each run the states (k, names) and the input (k,) at the times of its estimate."""
    known, by_port = {run.name: run for run in runs}, dict[str, list[Samples]]()
    for one in finding.inputs:
        run = known[one.run]
        states = np.column_stack([np.interp(one.time, run.time, state) for state in run.states.T])
        by_port.setdefault(one.port.name, []).append((states, one.mean))
    return list(by_port.values())


def of_residual(search: Search, training: Sequence[SeenRun], held_out: SeenRun, count: int | None) -> dict[str, Any]:
    """Equations of the residuals of the `count` worst channels, or of all; and what they leave of the held-out run."""
    errors = [-rms(residual) for residual in np.concatenate([run.residual for run in training]).T]
    channels = np.argsort(errors)[:count]
    equations, seconds = timed(
        lambda: [search([(run.states, run.residual[:, k]) for run in training], STATES) for k in channels]
    )
    shown = held_out.modelled.copy()
    for k, equation in zip(channels, equations, strict=True):
        shown[:, k] += equation.values(held_out.states)
    judged = [(held_out.states, held_out.residual[:, k]) for k in channels]
    return {**named(equations, judged), 'held_out': rms(shown - held_out.measured), 'seconds': seconds}


def of_latent_input(search: Search, inputs: Sequence[Sequence[Samples]]) -> dict[str, Any]:
    """Equations of a latent input at each of its ports."""
    equations, seconds = timed(lambda: [search(runs[:1], STATES) for runs in inputs])
    return {**named(equations, [runs[-1] for runs in inputs]), 'seconds': seconds}


def named(equations: Sequence[Equation], judged: Sequence[Samples]) -> dict[str, Any]:
    """The variables of the equations that count, wires not told apart; and the equation that explains most."""
    parts = [explained(equation, samples) for equation, samples in zip(equations, judged, strict=True)]
    counting = [equation for equation, part in zip(equations, parts, strict=True) if part >= EXPLAINED]
    variables = {name.removesuffix('_1').removesuffix('_2') for equation in counting for name in equation.variables}
    best = int(np.argmax(parts))
    return {'named': sorted(variables), 'said': equations[best].text, 'explained': parts[best]}


def narx_channels(training: Sequence[SeenRun], held_out: SeenRun) -> Matrix:
    """The channels (k, channels) that NARX models simulate, driven by the powers."""
    return np.column_stack(
        [
            narx([(run.powers, run.measured[:, k]) for run in training], (held_out.powers, held_out.measured[:, k]))
            for k in range(held_out.measured.shape[1])
        ]
    )


def narx_of_residual(training: Sequence[SeenRun], held_out: SeenRun) -> Matrix:
    """The same of the residuals, driven by the modelled channel too."""

    def samples(run: SeenRun, k: int) -> Samples:
        return np.column_stack([run.powers, run.modelled[:, k]]), run.residual[:, k]

    channels = range(held_out.measured.shape[1])
    shown = [narx([samples(run, k) for run in training], samples(held_out, k)) for k in channels]
    return held_out.modelled + np.column_stack(shown)


def intervals(made: Challenge, pool: Executor) -> dict[str, Any]:
    """95 % intervals of PAIR by a fit and by emcee, of the first recording; all else of the robot is known."""
    config = made.robot.model.config.variant({name: made.nominal.parameters[name] for name in (*PAIR, 'solver.rtol')})
    dataset = replace(made.dataset, recordings=made.dataset.recordings[:1])
    options, context = FitOptions(free=PAIR, kinetics='mas', starts=1), SearchContext(pool, Event())
    problem = problem_for(dataset, config, options, 1, step_limited=False)

    def fitted() -> tuple[FitResult, Calibration]:
        fit = minimize(problem, start_point(problem), FROM_PRIORS, context)
        return fit, final_calibration(dataset, fit, options, context)

    (fit, calibration), seconds = timed(fitted)
    sampled, sampled_seconds = timed(lambda: sampled_intervals(problem, fit.z, STEPS, pool))
    return {
        'truth': {name: made.robot.parameters[name] for name in PAIR},
        'sma_sim': {name: [one.low, one.high] for name, one in calibration.intervals.items()},
        'seconds': seconds,
        'emcee': {**sampled, 'seconds': sampled_seconds},
    }


def variables_of(hidden: Sequence[str]) -> set[str]:
    """The variables of hidden laws as STATES have them."""
    names = {name for law in hidden for name in truth_of(law).variables}
    return {name for one in names for name in SAME.get(one, (one,))}


def variables_named(one: Mapping[str, Any], method: str) -> list[str]:
    """The variables of the equations that count: none of an input of which `latent` says that it is none."""
    is_none = method.endswith('_latent') and one['latent']['verdict'] == NONE
    return [] if is_none else one[method].get('named', [])


def is_right(one: Mapping[str, Any], method: str) -> bool:
    """Whether a method names what is hidden."""
    right = one[method]['right'] if method == 'sma_sim' else set(variables_named(one, method)) & set(one['variables'])
    return bool(right)


def is_alarm(one: Mapping[str, Any], method: str) -> bool:
    """Whether a method names anything."""
    return one[method]['said'] != NONE if method == 'sma_sim' else bool(variables_named(one, method))


def named_by(results: Sequence[Mapping[str, Any]], method: str) -> tuple[int, int, int, int]:
    """How often a method names something hidden, of how many; its false alarms, of how many."""
    seen = [one for one in results if one['case'][0] != NOTHING and one['nominal'] >= SEEN]
    nothing = [one for one in results if one['case'][0] == NOTHING]
    return sum(is_right(one, method) for one in seen), len(seen), sum(is_alarm(one, method) for one in nothing), len(nothing)


def table(results: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """The methods side by side, the intervals, then every robot."""
    failed, results = [one for one in results if 'failed' in one], [one for one in results if 'failed' not in one]
    if failed:
        yield f'refused by the program: {len(failed)}'
    if not results:
        return
    nothing = [one for one in results if one['case'][0] == NOTHING]
    hiding = [one for one in results if one['case'][0] != NOTHING]
    seen = [one for one in hiding if one['nominal'] >= SEEN]
    exact = of(sum(one['sma_sim']['exact'] for one in seen), len(seen))
    versions = {f'{name} {number}' for one in results for name, number in one['versions'].items()}
    yield f'{len(results)} robots; {", ".join(sorted(versions))}'
    yield ''
    yield (
        '| method | names something hidden | false alarms | variables named | normalized RMSE, held out: nothing hidden '
        '| something hidden, median | worst | processor [s] |'
    )
    yield '|---|---|---|---|---|---|---|---|'
    left = [middle([one['nominal'] for one in some]) for some in (nothing, hiding)]
    yield f'| calibrated model | | | | {left[0]} | {left[1]} | {worst([one["nominal"] for one in hiding])} | |'
    for method, title in METHODS.items():
        counted = named_by(results, method) if method in NAMING else (0, 0, 0, 0)
        right, alarms = (of(*pair) if method in NAMING else '' for pair in (counted[:2], counted[2:]))
        counts = [len(names) for one in hiding if (names := variables_named(one, method))]
        errors = [[one[method]['held_out'] for one in some if 'held_out' in one[method]] for some in (nothing, hiding)]
        yield (
            f'| {title} | {right} | {alarms} | {middle(counts)} | {middle(errors[0])} | {middle(errors[1])} | '
            f'{worst(errors[1])} | {middle([one[method]["seconds"] for one in results])} |'
        )
    yield ''
    yield f'most probable answer of the diagnosis exactly what is hidden: {exact}'
    yield ''
    yield from interval_rows([one for one in results if 'intervals' in one])
    yield '| part | hidden | seed | recorded | loop | error without | method | said | counts | error with |'
    yield '|---|---|---|---|---|---|---|---|---|---|'
    for one in sorted(results, key=lambda one: PARTS.index(one['case'][0])):
        yield from rows(one)


def interval_rows(results: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """The 95 % intervals of both programs."""
    if not results:
        return
    yield '| hidden | seed | parameter | truth | sma_sim | emcee | width of emcee / sma_sim | processor [s] | ratio |'
    yield '|---|---|---|---|---|---|---|---|---|'
    inside = {'sma_sim': 0, 'emcee': 0}
    for one in results:
        known = one['intervals']
        seconds = known['seconds'], known['emcee']['seconds']
        for name, truth in known['truth'].items():
            ends = {'sma_sim': known['sma_sim'][name], 'emcee': known['emcee']['intervals'][name]}
            for program, (low, high) in ends.items():
                inside[program] += low <= truth <= high
            shown = ' | '.join(f'{low:.5g} to {high:.5g}' for low, high in ends.values())
            yield (
                f'| {", ".join(one["case"][1])} | {one["case"][3]} | {name} | {truth:.4g} | {shown} | '
                f'{np.ptp(ends["emcee"]) / np.ptp(ends["sma_sim"]):.2f} | {seconds[0]:.1f}, {seconds[1]:.0f} | '
                f'{seconds[1] / seconds[0]:.0f} |'
            )
    yield ''
    lengths = [one['intervals']['emcee']['times'] for one in results]
    counts = '; '.join(f'{program} {of(count, len(PAIR) * len(results))}' for program, count in inside.items())
    yield f'intervals that hold the truth: {counts}; emcee ran for {min(lengths):.0f} or more autocorrelation times'
    yield ''


def rows(one: Mapping[str, Any]) -> Iterator[str]:
    """A robot: a line for every method."""
    part, hidden, _, seed, forces, closed = one['case']
    robot = (
        f'{part} | {", ".join(hidden)} | {seed} | {"forces" if forces else "pose"} | {"closed" if closed else "open"} | '
        f'{one["nominal"]:.3f}'
    )
    for method, title in METHODS.items():
        found = one[method]
        said = found.get('said', '')
        said = said if len(said) <= MAX_SHOWN else f'{said[:MAX_SHOWN]}...'
        counts = ('yes' if is_alarm(one, method) else 'no') if method in NAMING else ''
        right = ', right' if method in NAMING and part != NOTHING and is_right(one, method) else ''
        error = f'{found["held_out"]:.3g}' if 'held_out' in found else ''
        yield f'| {robot} | {title} | {said} | {counts}{right} | {error} |'


def middle(values: Sequence[float]) -> str:
    """The median."""
    return f'{np.median(values):.3g}' if values else ''


def worst(values: Sequence[float]) -> str:
    """The largest."""
    return f'{max(values):.3g}' if values else ''


def main() -> None:
    """Solve the robots that are not in the file yet, as far as the time goes; print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--seed', type=int, default=8600, help='of the first robot; the others follow')
    add_options(parser, 'peers.jsonl', 240.0)
    asked = parser.parse_args()
    chosen = cases(asked.seed)
    some = chosen[: max(1, round(asked.share * len(chosen)))]
    print(*table(solved(some, solve, asked, lambda one: '\n'.join(rows(one)))), sep='\n')


if __name__ == '__main__':
    main()
