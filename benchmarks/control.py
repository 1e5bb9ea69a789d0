"""How well controllers with a model follow a target, on robots with a hidden effect, against a PI controller alone.

    python benchmarks/control.py [--robots 20] [--first 0] [--seconds 20] [--file control.jsonl] [--minutes 60]

A robot has MAS kinetics, the parameters of a challenge (each off by 5 to 15 %), noisy sensors of its pose, and one hidden
effect that the library has. The target is a sum of two sines. Every controller is behind the same guard, whose observer has
the nominal model. It does so within limits that leave room, and within limits that bind (T_BINDING, STRESS_BINDING), there
also without the guard, so that it shows what controllers keep to by themselves with a model that is not the robot. Models
are the nominal one (the data sheet) and the improved one: with the effect that was hidden, calibrated on three recordings of
the robot, as `sma-sim diagnose` writes it once it has found the effect.

The PI controller is tuned on the robot itself, not on a model, for the smallest error along another target of the same kind:
by a grid of gains, then a finer one about the best. The one beside the feedforward has the package's gains. Finished robots
are kept in --file, so that a run can be continued.
"""

from __future__ import annotations

import argparse
import gc
import time
from collections.abc import Iterator
from concurrent.futures import Executor
from typing import Any, NamedTuple

import numpy as np
from cases import add_options, solved
from numpy.typing import NDArray

from sma_sim import Config, FitOptions, calibrate
from sma_sim.challenge.make import Challenge, RecordingPlan, challenge_with
from sma_sim.challenge.robot import MAX_ANGLE, NOISE_STD, REST_DURATION
from sma_sim.challenge.truth import Truth, truths
from sma_sim.control import PI, FeedforwardPI, PredictiveController, Target
from sma_sim.evidence.estimation.search_context import silent_iteration
from sma_sim.guard import Guard
from sma_sim.model.effects.discovery import package_effects
from sma_sim.observer import Observer
from sma_sim.solver.columns import sample_columns
from sma_sim.solver.fixed_rate import FixedRateRun
from sma_sim.solver.integrate import PER_WIRE, WIRE_COLUMNS

RATE = 50.0  # [Hz]
T_MAX, STRESS_MAX = 390.0, 400e6  # [K], [Pa] of the guard
T_BINDING, STRESS_BINDING = 345.0, 150e6  # [K], [Pa] that the target asks to pass
POSE = ('U_x', 'U_y', 'alpha')
AMPLITUDE, PERIODS = 0.045, (6.0, 14.0)  # [rad], [s] of the sines
GAINS = ((300.0, 1000.0, 3000.0, 1e4), (0.3, 1.0, 3.0))  # kp [W/rad], and ki/kp [1/s]
FROM_REST = 3.0  # [s] that are not counted: at rest robots differ, and wires have to warm before they move
PLAN = RecordingPlan(3, 60.0, 20.0)
Vector = NDArray[np.float64]
Limits = dict[str, float]
WIDE: Limits = {'guard.T_max': T_MAX, 'guard.stress_max': STRESS_MAX}
BINDING: Limits = {'guard.T_max': T_BINDING, 'guard.stress_max': STRESS_BINDING}


class Followed(NamedTuple):
    """A run: RMS error [deg], largest T [K] and stress [Pa], share of commands that the guard cut, times of a step [ms]."""

    error: float
    T: float
    stress: float
    cut: float
    mean_ms: float
    longest_ms: float


def target_of(seed: int, which: int) -> Target:
    """A target of the angle [rad]: two sines, with a start from rest."""
    random = np.random.default_rng([seed, which, 17])
    periods, phases = random.uniform(*PERIODS, 2), random.uniform(0.0, 2.0 * np.pi, 2)
    share = random.uniform(0.4, 0.7)

    def target(times: Vector) -> Vector:
        waves = [np.sin(2.0 * np.pi * times / T + phase) for T, phase in zip(periods, phases, strict=True)]
        found: Vector = AMPLITUDE * (1.0 - np.exp(-times / 2.0)) * (share * waves[0] + (1.0 - share) * waves[1])
        return found

    return target


def run_of(
    case: Challenge, controller: Any, target: Target, seed: int, duration: float, limits: Limits | None = None
) -> Followed:
    """A run of the robot under a controller, behind a guard with some limits or without one."""
    random, model, T_E = np.random.default_rng([seed, 5]), case.robot.model, case.nominal.parameters['environment.T_E']
    run = FixedRateRun(model, RATE, np.array([0.0, T_E]))
    run.step(np.array([0.0, T_E]), round(REST_DURATION * RATE))
    guarded = None if limits is None else case.nominal.variant(limits)
    observer, guard = (None, None) if guarded is None else (Observer(guarded), Guard(guarded))
    where, channel = sample_columns(model.structure), model.structure.channels.index
    errors, T, stress, cut, spent = [], 0.0, 0.0, 0, []
    for k in range(round(duration * RATE)):
        t, row = k / RATE, run.sample
        wires = row[where.wires].reshape(-1, PER_WIRE).T
        T = max(T, float(wires[WIRE_COLUMNS.index('T')].max()))
        stress = max(stress, float(wires[WIRE_COLUMNS.index('sigma')].max()))
        alpha = row[where.sensed][channel('alpha')]
        if not abs(alpha) < MAX_ANGLE:
            return Followed(np.inf, T, stress, 0.0, 0.0, 0.0)
        if t >= FROM_REST:
            errors.append(alpha - target(np.array([t]))[0])
        seen = {name: row[where.sensed][channel(name)] + NOISE_STD[name] * random.standard_normal() for name in POSE}
        began = time.process_time()
        J = controller.step(t, seen, target)
        spent.append(1e3 * (time.process_time() - began))
        if observer is not None and guard is not None:
            decision = guard.limit(J, observer.update(t, None, seen), t)
            cut, J = cut + (decision.scale < 1.0), decision.J_eq[0]
            observer.update(t, J)
        controller.observe(t, J)
        run.step(np.array([J, T_E]))
    return Followed(
        float(np.degrees(np.sqrt(np.mean(np.square(errors))))), T, stress, cut / len(spent), float(np.mean(spent)),
        max(spent),
    )  # fmt: skip


class Alone:
    """A PI controller without a model."""

    def __init__(self, kp: float, ki: float, J_max: float) -> None:
        self._law = PI(kp, ki, J_max)

    def step(self, t: float, seen: dict[str, float], target: Target) -> float:
        """The command [W]."""
        return self._law(float(target(np.array([t]))[0]) - seen['alpha'], 1.0 / RATE)

    def observe(self, t: float, J_eq: float) -> None:
        """Nothing is kept."""


def tuned(case: Challenge, seed: int, duration: float) -> tuple[float, float]:
    """The gains with the smallest error on the robot along another target."""
    target, J_max = target_of(seed, 1), case.nominal.parameters['node.J_max']

    def error(gains: tuple[float, float]) -> float:
        return run_of(case, Alone(*gains, J_max), target, seed, duration, None).error

    best = min(((kp, kp * ratio) for kp in GAINS[0] for ratio in GAINS[1]), key=error)
    finer = [(best[0] * a, best[1] * b) for a in (0.6, 1.0, 1.7) for b in (0.6, 1.0, 1.7)]
    return min(finer, key=error)


def controllers_of(models: dict[str, Config], limits: Limits, is_guarded: bool) -> dict[str, Any]:
    """Controllers with some models, which keep limits, alone or with a guard behind them."""
    found: dict[str, Any] = {}
    for name, model in models.items():
        config = Config(
            {**model.parameters, **limits, 'control.rate': RATE}, kinetics=model.kinetics, effects=model.effects,
            settings={'control.behind_guard': is_guarded},
        )  # fmt: skip
        found[f'feedforward, {name}'] = FeedforwardPI(config)
        found[f'predictive, {name}'] = PredictiveController(config)
    return found


def choose(seed: int) -> Truth:
    """A hidden effect that the library has, and that is none of a sensor."""
    pool = [one for one in truths().values() if one.library in package_effects() and one.sensor is None]
    return pool[int(np.random.default_rng([seed, 9]).integers(len(pool)))]


def solve(seed: int, duration: float, pool: Executor) -> dict[str, Any]:
    """All controllers on one robot."""
    truth = choose(seed)
    case = challenge_with((truth,), seed, True, PLAN)
    effect = package_effects()[truth.library]
    models = {'nominal': case.nominal}
    start = Config(case.nominal.parameters, effects=[effect()])
    options = FitOptions(kinetics='hybrid', intervals=False)
    models['improved'] = calibrate(case.dataset, start, options, pool, silent_iteration).config
    kp, ki = tuned(case, seed, duration)
    target, J_max = target_of(seed, 0), case.nominal.parameters['node.J_max']
    gc.collect()
    gc.freeze()  # as the node does before it begins
    found = {}
    for name, limits, guard in (
        ('room', WIDE, WIDE),
        ('binding', BINDING, BINDING),
        ('binding, no guard', BINDING, None),
    ):
        controllers = {'PI': Alone(kp, ki, J_max), **controllers_of(models, limits, guard is not None)}
        found[name] = {key: run_of(case, one, target, seed, duration, guard)._asdict() for key, one in controllers.items()}
    return {'effect': truth.library, 'kp': kp, 'ki': ki, 'runs': found}


def table(results: list[dict[str, Any]]) -> Iterator[str]:
    """Errors over those of the PI controller, and limits."""
    results = [one for one in results if 'failed' not in one]
    yield (
        '| limits | controller | median error [deg] | largest | over that of PI | at most half of it | T beyond limit [K] | '
        'stress beyond limit [%] | runs beyond | cut [%] | step, mean [ms] | longest |'
    )
    yield '|---|---|' + '---|' * 10
    for limits, name in ((one, name) for one, runs in results[0]['runs'].items() for name in runs):
        runs, wide = [one['runs'][limits][name] for one in results], limits == 'room'
        errors = np.array([one['error'] for one in runs])
        ratio = errors / [one['runs'][limits]['PI']['error'] for one in results]
        T, stress = (WIDE if wide else BINDING).values()
        hotter, more = (np.array([one[key] for one in runs]) for key in ('T', 'stress'))
        over = (hotter > T) | (more > stress)
        yield (
            f'| {limits} | {name} | {np.median(errors):.3f} | {errors.max():.3f} | {np.median(ratio):.2f} | '
            f'{int(np.sum(ratio <= 0.5))} of {len(runs)} | {max(hotter.max() - T, 0.0):.1f} | '
            f'{100.0 * max(more.max() / stress - 1.0, 0.0):.1f} | {int(over.sum())} | '
            f'{100.0 * np.mean([one["cut"] for one in runs]):.0f} | {np.mean([one["mean_ms"] for one in runs]):.1f} | '
            f'{max(one["longest_ms"] for one in runs):.1f} |'
        )


def main() -> None:
    """Solve what is not in the file yet, as far as the time goes, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--robots', type=int, default=20)
    parser.add_argument('--first', type=int, default=0)
    parser.add_argument('--seconds', type=float, default=20.0)
    add_options(parser, 'control.jsonl', 60.0)
    asked = parser.parse_args()
    cases = [(seed, asked.seconds) for seed in range(asked.first, asked.first + asked.robots)]
    results = solved(cases, solve, asked, lambda result: '\n'.join(list(table([result]))[2:]))
    print('\n'.join(table(results)))


if __name__ == '__main__':
    main()
