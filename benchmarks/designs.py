"""Designed against default experiments, on robots of which the design has only recordings of low power.

    python benchmarks/designs.py [--seeds 1] [--tries 120] [--pairs A/B ...] [--minutes 60] [--at-once 2]

For each pair of explanations a robot of sma_sim/challenge (MAS kinetics, other parameters, its own formula of the first
effect) makes two recordings of low power, ever lower until both explain them to within 1 %. `next` designs 100 s between
the two. The designed and two default sequences (random steps of the same power) are run on the robot, with noise, and both
explanations are fitted to the old recordings and the new one together, from several starts. Achieved is by how much the new
recording raised the log evidence ratio for the true one. Finished cases are kept in --file, so that a run can be continued;
the table is of all in it.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from threading import Event
from typing import Any

import numpy as np
from cases import add_options, drawn, solved

from sma_sim import Dataset, Input, Recording
from sma_sim.challenge.make import RecordingPlan, make_challenge
from sma_sim.challenge.robot import NOISE_STD, Robot
from sma_sim.evidence.estimation.calibrate import FitOptions, problem_for
from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.estimation.levenberg_marquardt import refit
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.estimation.stop_criteria import FROM_PRIORS, WEAKLY_DAMPED
from sma_sim.evidence.experiment_design.design import next_experiment
from sma_sim.evidence.experiment_design.plan import DesignRequest, Plan
from sma_sim.evidence.experiment_design.rival_fits import (
    ModelHypothesis,
    NamedFit,
    fit_base_model,
    fit_hypotheses,
    named_rivals,
)
from sma_sim.evidence.experiment_design.sequences import CommandGrid, as_input, default_sequence
from sma_sim.model.config import Config

PAIRS = (
    ('natural_convection', 'radiation'),
    ('gravity', 'sensor_bias'),
    ('driver_lag', 'latent_heat_scale'),
    ('beam_creep', 'ambient_heating'),
    ('guide_friction', 'joint_friction'),
    ('thermal_crosstalk', 'polycrystal'),
    ('beam_nonlinearity', 'sensor_gain'),
    ('functional_fatigue', 'ambient_heating'),
    ('sensor_lag', 'driver_lag'),
    ('clausius_clapeyron_mismatch', 'r_phase'),
)
DEFAULTS = 2
RATE, LENGTH, HOLD = 20.0, 100.0, 0.5  # [1/s], [s], [s]
POWER = 15.0  # [W] of the new experiment
LOW_POWERS = (8.0, 5.0, 3.0, 2.0, 1.0)  # [W] of the old recordings: the first that leaves a pair confounded
SECONDS, STEPS = 60.0, 3  # of an old recording
CONFOUNDED = 1.01  # ratio of the errors, as in a diagnosis
POSE = ('U_x', 'U_y', 'alpha')


def robot_of(pair: Sequence[str], seed: int) -> tuple[Robot, Any]:
    """The robot that has the first effect of a pair, and the model to start from."""
    made = make_challenge(seed, kinds=[pair[0]], plan=RecordingPlan(duration=5.0, rate=10.0))
    return made.robot, made.nominal


def measured(robot: Robot, name: str, source: Input, random: np.random.Generator) -> Recording:
    """What the robot's sensors show under a command."""
    time_, channels = robot.measure(source, RATE)
    noisy = {channel: channels[channel] + NOISE_STD[channel] * random.standard_normal(len(time_)) for channel in POSE}
    return Recording(name, 'module', time_, noisy, source)


def with_recording(dataset: Dataset, more: Recording) -> Dataset:
    """One recording more."""
    return replace(dataset, recordings=(*dataset.recordings, more))


def achieved(plan: Plan, old: Dataset, new: Recording, context: SearchContext) -> tuple[float, float]:
    """By how much a new recording raises the log evidence of the true hypothesis, and what that leaves over noise."""
    more = with_recording(old, new)
    rivals = [NamedFit(hypothesis.name, refitted(hypothesis, more, context)) for hypothesis in plan.hypotheses]
    first, second = fit_hypotheses(more, rivals, context)
    before = plan.hypotheses[0].log_evidence - plan.hypotheses[1].log_evidence
    return first.log_evidence - second.log_evidence - before, first.fitted.error * first.noise_factor


def refitted(hypothesis: ModelHypothesis, more: Dataset, context: SearchContext) -> FitResult:
    """The best fit to one more recording, from the fit without it and from the middle of the priors."""
    fitted = hypothesis.fitted
    problem = replace(problem_for(more, fitted.problem.config, FitOptions(), 1), free=fitted.problem.free)
    wires = problem.runs[0].starts
    known = np.append(fitted.z, np.zeros(wires))  # the new run's starts in the middle of their priors
    of_effects = [p.name.startswith('effects.') for p in problem.free]
    middle = np.where([*of_effects, *[False] * (len(known) - len(of_effects))], known, 0.0)
    starts = [(z, criteria) for z in (known, middle) for criteria in (FROM_PRIORS, WEAKLY_DAMPED)]
    fits = [refit(problem, z, context, criteria) for z, criteria in starts]
    return min((fit for fit in fits if fit is not None), key=lambda fit: fit.cost)


def low_power_recordings(
    robot: Robot, nominal: Config, pair: Sequence[str], random: np.random.Generator, context: SearchContext
) -> tuple[float, Dataset]:
    """The power [W] and two recordings that leave a pair confounded; those of the least power, if none does."""
    noise = {name: NOISE_STD[name] for name in POSE}
    for power in LOW_POWERS:
        commands = [low_power_command(power, nominal.parameters['environment.T_E'], random) for _ in range(2)]
        old = Dataset(tuple(measured(robot, f'old{k + 1}', command, random) for k, command in enumerate(commands)), noise)
        base = fit_base_model(old, nominal, ('mas',), context)
        first, second = fit_hypotheses(old, named_rivals(base, pair, context), context)
        if max(first.fitted.error, second.fitted.error) <= CONFOUNDED * min(first.fitted.error, second.fitted.error):
            break
    return power, old


def solve(pair: Sequence[str], seed: int, tries: int, pool: Executor) -> dict[str, Any]:
    """One case."""
    robot, nominal = robot_of(pair, seed)
    T_E = nominal.parameters['environment.T_E']
    random = np.random.default_rng([seed, 77])
    context = SearchContext(pool, Event())
    power, old = low_power_recordings(robot, nominal, pair, random, context)
    plan = next_experiment(
        old, nominal, DesignRequest(tuple(pair), (), LENGTH, HOLD, POWER, 440.0, 5e8, 'mas', tries, seed), pool
    )
    grid = plan.grid
    defaults = [default_sequence(grid, random) for _ in range(DEFAULTS)]
    gains = [
        achieved(plan, old, measured(robot, 'new', as_input(levels, grid, T_E), random), context)
        for levels in (plan.levels, *defaults)
    ]
    before = plan.hypotheses[0].log_evidence - plan.hypotheses[1].log_evidence
    expected = plan.expected[0]
    return {
        'power': power,
        'before': before,
        'expected': [expected.designed, expected.default],
        'designed': gains[0][0],
        'defaults': [gain for gain, _ in gains[1:]],
        'errors': [error for _, error in gains],
        'levels': plan.levels.tolist(),
        'design_seconds': plan.seconds,
    }


def low_power_command(power: float, T_E: float, random: np.random.Generator) -> Input:
    """Few small steps."""
    grid = CommandGrid(round(SECONDS / HOLD), HOLD, power)
    return as_input(np.repeat(np.round(random.uniform(-power, power, STEPS), 3), grid.cells // STEPS), grid, T_E)


def ratio(result: dict[str, Any]) -> float:
    """Achieved by the design over achieved by the default sequences on average."""
    return float(result['designed'] / np.mean(result['defaults']))


def summary(results: list[dict[str, Any]]) -> Iterator[str]:
    """The table."""
    yield '| true, against | power [W] | before | expected: designed, default | achieved: designed | default | times |'
    yield '|---|---|---|---|---|---|---|'
    failed = [result for result in results if 'failed' in result]
    results = [result for result in results if 'failed' not in result]
    for result in failed:
        yield f'| {", ".join(result["case"][0])} | {result["failed"]} ||||||'
    for result in results:
        (true, rival), *_ = result['case']
        defaults = ', '.join(f'{x:.3g}' for x in result['defaults'])
        designed, usual = result['expected']
        yield (
            f'| {true}, {rival} | {result["power"]:g} | {result["before"]:.1f} | {designed:.3g}, {usual:.3g} | '
            f'{result["designed"]:.4g} | {defaults} | {ratio(result):.1f} |'
        )
    if results or failed:
        times = [ratio(result) for result in results] + [0.0] * len(failed)
        yield f'\nmedian {np.median(times):.1f} times, least {min(times):.1f}'


def main() -> None:
    """Solve what is not solved yet, as long as there is time; print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--pairs', nargs='+', default=['/'.join(pair) for pair in PAIRS], metavar='TRUE/RIVAL')
    parser.add_argument('--seeds', type=int, default=1)
    parser.add_argument('--tries', type=int, default=120)
    add_options(parser, 'designs.jsonl', 60.0)
    asked = parser.parse_args()
    cases = [(words.split('/'), seed, asked.tries) for seed in range(1, asked.seeds + 1) for words in asked.pairs]
    done = solved(drawn(cases, asked.share), solve, asked, lambda result: list(summary([result]))[2])
    print(*summary(done), sep='\n')


if __name__ == '__main__':
    main()
