"""Whether a guard keeps the wires of simulated robots within their limits, and what that costs.

    python benchmarks/guard.py [--robots 200] [--first 0] [--seconds 20] [--off 0.15] [--margin 2.0] [--hot]
        [--driver as_asked|gain|rising] [--minutes 60]

A robot has MAS kinetics, parameters off by --off (each either way, the free length by up to 0.3 %), sensors with noise, and
every second one a hidden effect. It is observed at 50 Hz with pose and forces, by a model with the nominal parameters,
which is told how well they are known. The guard keeps clear of limits by --margin standard deviations.
Commands are adversarial: full power in either direction, for long, in bursts, switched to and fro; every third robot is
commanded gently, so that no limit comes near. Reported are the largest excesses over the limits, and the stroke (mean
|alpha|) that is lost: of safe commands against no guard, of others against a guard that knows the true state. So is what a
guard loses that knows all but the scale of T - T_E, which pose and forces do not tell, and keeps all such robots below
T_MAX + 2 K. With --hot observer and guard start beside a robot whose wire was heated with full power to 1 K below the
limit, and goes on to be. With --driver gain the robot gets 1.4 times the power that it is sent, with rising as much more at
full power only, by its square. Finished robots are kept in --file, so that a run can be continued.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from typing import Any, NamedTuple

import numpy as np
from cases import add_options, drawn, solved
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

RATE = 50.0  # [Hz] of estimates and commands
T_MAX, STRESS_MAX = 360.0, 250e6  # [K], [Pa]
J_FULL, J_GENTLE = 25.0, 5.0  # [W]
MORE = 0.4  # of the power that is sent, which a driver gives in addition
DRIVERS: dict[str, Callable[[float], float]] = {
    'as_asked': lambda J: J,
    'gain': lambda J: (1.0 + MORE) * J,
    'rising': lambda J: (1.0 + MORE * (J / J_FULL) ** 2) * J,
}
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


def run_of(config: Config, robot: Robot, asked: Vector, who: str, seed: int, hot: bool, driver: str) -> Guarded:
    """A run under commands that pass a guard: by an ``observer``, by one that knows the ``truth``, or under ``none``."""
    model, random = robot.model, np.random.default_rng([seed, 3])
    where, T_E = sample_columns(model.structure), config.parameters['environment.T_E']
    run = FixedRateRun(model, RATE, np.array([0.0, T_E]))
    run.step(np.array([0.0, T_E]), round(REST_DURATION * RATE))
    wires, T_column = where.wires, WIRE_COLUMNS.index('T')
    while hot and run.sample[wires][T_column::PER_WIRE].max() < T_MAX - 1.0:
        run.step(np.array([DRIVERS[driver](asked[0]), T_E]))
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
        run.step(np.array([DRIVERS[driver](J), T_E]))
    return Guarded(T, stress, stroke, limited / len(asked))


def without_scale(config: Config, robot: Robot, off: float) -> float:
    """How hot a robot is [K] where the hottest one of its kind, which shows the same, is at T_MAX + 2 K."""
    names = ('wire.sigma_T', 'wire.c_V', 'wire.lambda')
    scale = np.prod([robot.parameters[name] / config.parameters[name] for name in names]) ** (1.0 / len(names))
    T_E = config.parameters['environment.T_E']
    return T_E + (T_MAX + 2.0 - T_E) * (1.0 - off) / float(scale)


def solve(seed: int, duration: float, off: float, margin: float, hot: bool, driver: str, pool: Executor) -> dict[str, Any]:
    """All numbers of a robot. Raises SimulationError where it cannot do its run."""
    config, robot = robot_of(seed, off, margin)
    asked = commands_of(seed, round(duration * RATE))
    if hot:
        asked[: round(RATE)] = J_FULL * (-1.0) ** seed
    alone, observed = (run_of(config, robot, asked, who, seed, hot, driver) for who in ('none', 'observer'))
    safe = alone.T <= T_MAX and alone.stress <= STRESS_MAX
    compared = alone if safe else run_of(config, robot, asked, 'truth', seed, hot, driver)
    known = config.variant({'guard.T_max': without_scale(config, robot, off)})
    but_scale = compared if safe else run_of(known, robot, asked, 'truth', seed, hot, driver)
    return {
        'hidden': robot.hidden[0].truth.name if robot.hidden else '',
        'safe': safe,
        'T below without guard': max(T_MAX - alone.T, 0.0),
        'T excess': max(observed.T - T_MAX, 0.0),
        'stress excess': max(observed.stress / STRESS_MAX - 1.0, 0.0),
        'T excess without guard': max(alone.T - T_MAX, 0.0),
        'stress excess without guard': max(alone.stress / STRESS_MAX - 1.0, 0.0),
        'stroke lost': 1.0 - observed.stroke / compared.stroke,
        'stroke lost by the scale alone': 1.0 - but_scale.stroke / compared.stroke,
        'limited': observed.limited,
    }


def table(results: list[dict[str, Any]]) -> Iterator[str]:
    """The largest excesses, how many robots keep the limits to 2 K and 2 %, and the stroke that is lost, in the mean."""
    said = list[str]()
    yield (
        '| commands | robots | within 2 K and 2 % | beyond T_max [K] | beyond stress_max [%] | stroke lost [%] | at most | '
        'by the scale alone | without guard [K] | [%] |'
    )
    yield '|---|' + '---|' * 9
    for name, is_safe in (('safe', True), ('others', False)):
        robots = [one for one in results if 'failed' not in one and one['safe'] == is_safe]
        if not robots:
            continue
        found = {key: np.array([one[key] for one in robots]) for key in robots[0] if key not in ('case', 'hidden')}
        within = (found['T excess'] <= 2.0) & (found['stress excess'] <= 0.02)
        T, stress = found['T excess'].max(), 100.0 * found['stress excess'].max()
        lost = 100.0 * found['stroke lost']
        yield (
            f'| {name} | {len(robots)} | {within.sum()} | {T:.1f} | {stress:.1f} | {lost.mean():.1f} | {lost.max():.1f} | '
            f'{100.0 * found["stroke lost by the scale alone"].mean():.1f} | {found["T excess without guard"].max():.0f} | '
            f'{100.0 * found["stress excess without guard"].max():.0f} |'
        )
        said.append(f'{name}: {within.sum()} of {len(robots)} within 2 K and 2 %, {lost.mean():.1f} % of the stroke lost')
    yield '\n' + '; '.join(said)


def row(result: dict[str, Any]) -> str:
    """How one robot went."""
    return f'{result["case"][0]} ' + ', '.join(f'{key} {value}' for key, value in result.items() if key != 'case')


def main() -> None:
    """Solve what is not in the file yet, as far as the time goes, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--robots', type=int, default=200)
    parser.add_argument('--first', type=int, default=0)
    parser.add_argument('--seconds', type=float, default=20.0)
    parser.add_argument('--off', type=float, default=0.15)
    parser.add_argument('--margin', type=float, default=2.0)
    parser.add_argument('--hot', action='store_true')
    parser.add_argument('--driver', choices=DRIVERS, default='as_asked')
    add_options(parser, 'guard.jsonl', 60.0)
    asked = parser.parse_args()
    seeds = range(asked.first, asked.first + asked.robots)
    cases = [(seed, asked.seconds, asked.off, asked.margin, asked.hot, asked.driver) for seed in seeds]
    print('\n'.join(table(solved(drawn(cases, asked.share), solve, asked, row))))


if __name__ == '__main__':
    main()
