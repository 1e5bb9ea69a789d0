"""Whether a guard keeps the wires of simulated robots within their limits, and what that costs.

    python benchmarks/guard.py [--robots 20] [--first 0] [--seconds 20] [--off 0.15] [--margin 2.0] [--hot 1] [--json FILE]

A robot has MAS kinetics, parameters off by --off (each either way, the free length by up to 0.3 %), sensors with noise, and
every second one a hidden effect. It is observed at 50 Hz with pose and forces, by a model with the nominal parameters,
which is told how well they are known. The guard keeps clear of limits by --margin standard deviations.
Commands are adversarial: full power in either direction, for long, in bursts, switched to and fro; every third robot is
commanded gently, so that no limit comes near. Reported are the largest excesses over the limits, and the stroke (mean
|alpha|) that is lost: of safe commands against no guard, of others against a guard that knows the true state. So is what a
guard loses that knows all but the scale of T - T_E, which pose and forces do not tell, and keeps all such robots below
T_MAX + 2 K. With --hot observer and guard start beside a robot whose wire was heated with full power to 1 K below the
limit, and goes on to be.
"""

from __future__ import annotations

import argparse
from typing import Any, NamedTuple

import numpy as np
from common import report
from numpy.typing import NDArray

from sma_sim import Config
from sma_sim.challenge.draw import UNCERTAIN_PARAMETERS, draw_truths
from sma_sim.challenge.make import nominal_for
from sma_sim.challenge.robot import NOISE_STD, REST_DURATION, Hidden, Robot
from sma_sim.guard import Guard
from sma_sim.observer import Estimate, Observer
from sma_sim.solver.columns import sample_columns
from sma_sim.solver.fixed_rate import FixedRateRun
from sma_sim.solver.integrate import PER_WIRE, WIRE_COLUMNS
from sma_sim.solver.simulate import SimulationError

RATE = 50.0  # [Hz] of estimates and commands
T_MAX, STRESS_MAX = 360.0, 250e6  # [K], [Pa]
J_FULL, J_GENTLE = 25.0, 5.0  # [W]
CHANNELS = ('U_x', 'U_y', 'alpha', 'F_1', 'F_2')
Vector = NDArray[np.float64]


class Guarded(NamedTuple):
    """A run: largest T [K] and stress [Pa] of a wire, mean |alpha| [rad], the share of time with less than was asked for."""

    T: float
    stress: float
    stroke: float
    limited: float


def robot_of(seed: int, off: float, margin: float) -> tuple[Config, Robot]:
    """The nominal model with its limits, and a robot."""
    random = np.random.default_rng([seed, 1])
    chosen = draw_truths(random, 1, None, ()) if seed % 2 == 0 else ()
    nominal = nominal_for(chosen)
    values = dict(nominal.parameters)
    for name in UNCERTAIN_PARAMETERS:
        values[name] *= 1.0 + off * float(random.choice((-1.0, 1.0)))
    values['wire.l0'] *= 1.0 + float(random.uniform(-0.003, 0.003))
    limits = {'guard.T_max': T_MAX, 'guard.stress_max': STRESS_MAX, 'guard.margin': margin}
    config = nominal.variant({**limits, 'observer.parameter_std': off})
    return config, Robot(values, tuple(Hidden(one, one.draw(random)) for one in chosen))


def commands_of(seed: int, count: int) -> Vector:
    """What is asked for at each of `count` instants [W]."""
    random, most = np.random.default_rng([seed, 2]), J_GENTLE if seed % 3 == 0 else J_FULL
    asked = np.zeros(count)
    k = round(0.5 * RATE)
    while k < count:
        length = int(RATE * random.choice([0.06, 0.3, 1.0, 4.0]))
        asked[k : k + length] = most * random.choice([-1.0, 1.0, 1.0, 0.0])
        k += length
    return asked


def true_estimate(t: float, row: Vector, where: Any, l0: float) -> Estimate:
    """The state of the robot itself, without uncertainty."""
    of_wires = row[where.wires].reshape(-1, PER_WIRE).T
    state = {name: of_wires[WIRE_COLUMNS.index(name)] for name in WIRE_COLUMNS}
    size = 3 * of_wires.shape[1]
    modes, strain = state['mode'].astype(np.int64), state['length'] / l0 - 1.0
    return Estimate(t, state['T'], state['x_M'], state['sigma'], modes, np.zeros((size, size)), strain, 1.0)


def run_of(config: Config, robot: Robot, asked: Vector, who: str, seed: int, hot: bool) -> Guarded:
    """A run under commands that pass a guard: by an ``observer``, by one that knows the ``truth``, or under ``none``."""
    model, random = robot.model, np.random.default_rng([seed, 3])
    where, T_E = sample_columns(model.structure), config.parameters['environment.T_E']
    run = FixedRateRun(model, RATE, np.array([0.0, T_E]))
    run.step(np.array([0.0, T_E]), round(REST_DURATION * RATE))
    wires, T_column = where.wires, WIRE_COLUMNS.index('T')
    while hot and run.sample[wires][T_column::PER_WIRE].max() < T_MAX - 1.0:
        run.step(np.array([asked[0], T_E]))
    observer = Observer(config) if who == 'observer' else None
    limits = {name: value for name, value in config.parameters.items() if name.startswith('guard.')}
    knowing = config.variant({**robot.parameters, **limits, 'guard.margin': 0.0})
    guard = Guard(config if observer else knowing)
    shown = [model.structure.channels.index(name) for name in CHANNELS]
    noise = np.array([NOISE_STD[name] for name in CHANNELS])
    T, stress, stroke, limited, J = 0.0, 0.0, 0.0, 0, 0.0
    for k, wanted in enumerate(asked.tolist()):
        t, row = k / RATE, run.sample
        truth = true_estimate(t, row, where, model.wire.l0)
        if k or not hot:  # the first sample is what was done before
            T, stress = max(T, float(truth.T.max())), max(stress, float(truth.stress.max()))
        stroke += abs(run.shown('alpha')) / len(asked)
        estimate = truth
        if observer is not None:
            seen = row[where.sensed][shown] + noise * random.standard_normal(len(shown))
            estimate = observer.update(t, J, dict(zip(CHANNELS, seen.tolist(), strict=True)))
        decision = guard.limit(wanted, estimate, t)
        J = wanted if who == 'none' else decision.J_eq[0]
        limited += wanted != J
        if observer is not None:
            observer.update(t, J)
        run.step(np.array([J, T_E]))
    return Guarded(T, stress, stroke, limited / len(asked))


def without_scale(config: Config, robot: Robot, off: float) -> float:
    """How hot a robot is [K] where the hottest one of its kind, which shows the same, is at T_MAX + 2 K."""
    names = ('wire.sigma_T', 'wire.c_V', 'wire.lambda')
    scale = np.prod([robot.parameters[name] / config.parameters[name] for name in names]) ** (1.0 / len(names))
    T_E = config.parameters['environment.T_E']
    return T_E + (T_MAX + 2.0 - T_E) * (1.0 - off) / float(scale)


def one_robot(seed: int, duration: float, off: float, margin: float, hot: bool) -> dict[str, Any] | None:
    """All numbers of a robot; None where it cannot do its run."""
    config, robot = robot_of(seed, off, margin)
    asked = commands_of(seed, round(duration * RATE))
    if hot:
        asked[: round(RATE)] = J_FULL * (-1.0) ** seed
    try:
        alone, knowing, observed = (run_of(config, robot, asked, who, seed, hot) for who in ('none', 'truth', 'observer'))
    except SimulationError:
        return None
    safe = alone.T <= T_MAX and alone.stress <= STRESS_MAX
    compared = alone if safe else knowing
    known = config.variant({'guard.T_max': without_scale(config, robot, off)})
    but_scale = compared if safe else run_of(known, robot, asked, 'truth', seed, hot)
    return {
        'hidden': robot.hidden[0].truth.name if robot.hidden else '',
        'safe': safe,
        'T excess': max(observed.T - T_MAX, 0.0),
        'stress excess': max(observed.stress / STRESS_MAX - 1.0, 0.0),
        'T excess without guard': max(alone.T - T_MAX, 0.0),
        'stress excess without guard': max(alone.stress / STRESS_MAX - 1.0, 0.0),
        'stroke lost': 1.0 - observed.stroke / compared.stroke,
        'stroke lost by the scale alone': 1.0 - but_scale.stroke / compared.stroke,
        'limited': observed.limited,
    }


def summary(robots: list[dict[str, Any]]) -> dict[str, float]:
    """Over robots: the largest excesses, how many keep the limits to 2 K and 2 %, and the stroke that is lost."""
    T, stress, lost = (np.array([one[name] for one in robots]) for name in ('T excess', 'stress excess', 'stroke lost'))
    return {
        'robots': len(robots),
        'within 2 K': float(np.mean(T <= 2.0)),
        'within 2 % of stress': float(np.mean(stress <= 0.02)),
        'largest T excess': float(T.max()),
        'largest stress excess': float(stress.max()),
        'largest T excess without guard': max(one['T excess without guard'] for one in robots),
        'largest stress excess without guard': max(one['stress excess without guard'] for one in robots),
        'stroke lost': float(lost.mean()),
        'most stroke lost': float(lost.max()),
        'stroke lost by the scale alone': float(np.mean([one['stroke lost by the scale alone'] for one in robots])),
    }


def measure(arguments: argparse.Namespace) -> dict[str, Any]:
    """All robots."""
    robots, seed = list[dict[str, Any]](), arguments.first
    while len(robots) < arguments.robots:
        found = one_robot(seed, float(arguments.seconds), arguments.off, arguments.margin, bool(arguments.hot))
        if found is not None:
            robots.append(found)
            if arguments.each:
                print(seed, found, flush=True)
        seed += 1
    groups = {'safe commands': [one for one in robots if one['safe']], 'others': [one for one in robots if not one['safe']]}
    return {name: summary(group) for name, group in groups.items() if group}


if __name__ == '__main__':
    report(
        'Whether a guard keeps wires within their limits', measure,
        robots=20, first=0, seconds=20, off=0.15, margin=2.0, hot=0, each=0,
    )  # fmt: skip
