"""How well an observer knows temperatures, fractions and stresses of simulated robots that differ from its model.

    python benchmarks/observer.py [--robots 200] [--first 0] [--seconds 40] [--strain 0.03] [--begin 10] [--minutes 60]

A robot has MAS kinetics, the parameters of a challenge (each off by 5 to 15 %, the free length by up to 0.3 %), sensors
with noise, and every third one a hidden effect. Half of them do random commands, half follow a target under a PI controller.
Each is observed at 25 Hz with pose and forces, with the pose alone, and with a tenth of all messages lost, with hybrid and
with MAS kinetics; beside that the heat balance of a wire alone, C dT/dt = J - lambda A_s (T - T_E), and the model that runs
without any measurement. All of these have the nominal parameters; with --strain the transformation strain is known that
well, as from a tensile test. With --begin observers start beside the running robot, within so many seconds. Finished robots
are kept in --file, so that a run can be continued; robots that cannot do their run count as none.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator, Mapping
from concurrent.futures import Executor
from typing import Any, NamedTuple

import numpy as np
from cases import add_options, drawn, solved
from numpy.typing import NDArray

from sma_sim import Config, Input, Model, simulate
from sma_sim.challenge.draw import draw_parameters, draw_random_command, draw_truths
from sma_sim.challenge.make import nominal_for
from sma_sim.challenge.robot import MAX_ANGLE, MAX_WIRE_TEMPERATURE, NOISE_STD, REST_DURATION, Hidden, Robot
from sma_sim.evidence.state_estimation.heat_balance import heat_balance
from sma_sim.observer import Observer
from sma_sim.solver.columns import sample_columns
from sma_sim.solver.fixed_rate import FixedRateRun
from sma_sim.solver.integrate import PER_WIRE, WIRE_COLUMNS
from sma_sim.solver.simulate import SimulationError

RATE = 25.0  # [Hz]
LOST = 0.1  # of the messages
POSE = ('U_x', 'U_y', 'alpha')
K_P, K_I, J_MAX = 300.0, 200.0, 15.0  # [W/rad], [W/(rad s)], [W]
INTERVAL = 1.959964  # standard deviations of 95 %
Vector = NDArray[np.float64]


class Truth(NamedTuple):
    """What a robot did: times (k,), J_eq from each on, T, x_M and stress (k, wires), what sensors show without noise."""

    time: Vector
    J_eq: Vector
    states: Mapping[str, NDArray[np.float64]]
    shown: Mapping[str, Vector]


def command(t: float, source: Input, target: Vector, run: FixedRateRun, integral: float) -> tuple[float, float]:
    """The next command [W] and integral: of a random input, or of a PI controller where there is a target."""
    if not len(target):
        return float(source.values[np.searchsorted(source.times, t, side='right') - 1, 0]), 0.0
    error = target[min(int(t / 10.0), len(target) - 1)] - run.shown('alpha')
    J = K_P * error + K_I * integral
    return float(np.clip(J, -J_MAX, J_MAX)), integral + error / RATE * (abs(J) < J_MAX)


def robot_of(seed: int) -> tuple[Config, Robot]:
    """The nominal model and a robot."""
    random = np.random.default_rng([seed, 1])
    chosen = draw_truths(random, 1, None, ()) if seed % 3 == 0 else ()
    nominal = nominal_for(chosen)
    return nominal, Robot(
        draw_parameters(nominal.parameters, random), tuple(Hidden(one, one.draw(random)) for one in chosen)
    )


def truth_of(nominal: Config, robot: Robot, seed: int, duration: float) -> Truth:
    """A run of a robot. Raises SimulationError where it cannot be made, or would break the robot."""
    random = np.random.default_rng([seed, 2])
    T_E = nominal.parameters['environment.T_E']
    source = draw_random_command(duration, T_E, random)
    target = random.uniform(-0.12, 0.12, int(duration / 10.0)) if seed % 2 else np.zeros(0)
    model = robot.model
    where, wires = sample_columns(model.structure), model.wires
    run = FixedRateRun(model, RATE, np.array([0.0, T_E]))
    run.step(np.array([0.0, T_E]), round(REST_DURATION * RATE))
    rows, commands, integral = [], [], 0.0
    count = round(duration * RATE)
    for k in range(count):
        rows.append(run.sample.copy())
        J, integral = command(k / RATE, source, target, run, integral)
        commands.append(J)
        run.step(np.array([J, T_E]))
    whole = np.array(rows)
    of_wires = whole[:, where.wires].reshape(count, wires, PER_WIRE)
    states = {name: of_wires[:, :, WIRE_COLUMNS.index(name)] for name in ('T', 'x_M', 'sigma')}
    shown = dict(zip(model.structure.channels, whole[:, where.sensed].T, strict=True))
    if np.abs(shown['alpha']).max() > MAX_ANGLE or states['T'].max() > MAX_WIRE_TEMPERATURE:
        raise SimulationError('the robot would break')
    t = np.arange(count) / RATE
    for hidden in robot.hidden:
        if hidden.truth.sensor is not None:
            shown |= hidden.truth.sensor(t, {name: shown[name] for name in NOISE_STD}, hidden.values)
    return Truth(t, np.array(commands), states, shown)


def observed(config: Config, truth: Truth, channels: tuple[str, ...], lost: float, seed: int) -> dict[str, Any]:
    """Errors and intervals of an observer beside a robot."""
    random = np.random.default_rng([seed, 3])
    noisy = {name: truth.shown[name] + NOISE_STD[name] * random.standard_normal(len(truth.time)) for name in channels}
    kept = random.random((len(truth.time), 2)) >= lost
    observer, found, began = Observer(config), [], time.process_time()
    J = truth.J_eq
    for k, t in enumerate(truth.time.tolist()):
        names = [name for name in channels if kept[k, int(name not in POSE)]]
        known = J[k] if k == 0 or J[k] != J[k - 1] else None
        found.append(observer.update(t, known, {name: float(noisy[name][k]) for name in names}))
    seconds = time.process_time() - began
    mean = {'T': np.array([e.T for e in found]), 'x_M': np.array([e.x_M for e in found])}
    std = {'T': np.array([e.T_std for e in found]), 'x_M': np.array([e.x_M_std for e in found])}
    mean['sigma'], std['sigma'] = np.array([e.stress for e in found]), np.array([e.stress_std for e in found])
    result: dict[str, Any] = {'ms': 1e3 * seconds / len(found), 'restarts': observer.restarts}
    for name, values in mean.items():
        error = values - truth.states[name]
        result[name] = float(np.sqrt(np.mean(error**2)))
        result[f'{name} covered'] = float(np.mean(np.abs(error) <= INTERVAL * std[name]))
    return result


def heat_balance_alone(config: Config, truth: Truth) -> float:
    """RMS error of T [K] of C dT/dt = J - lambda A_s (T - T_E), solved exactly over each step."""
    w, T_E = Model(config).wire, config.parameters['environment.T_E']
    T = np.full(2, T_E)
    rows = []
    for J in truth.J_eq:
        rows.append(T)
        T, for_each_watt = heat_balance(w, T, T_E, 1.0 / RATE)
        T = T + for_each_watt * np.maximum([J, -J], 0.0) / w.n
    return float(np.sqrt(np.mean((np.array(rows) - truth.states['T']) ** 2)))


def model_alone(config: Config, truth: Truth) -> dict[str, float]:
    """RMS errors of the model that runs without measurements."""
    T_E = config.parameters['environment.T_E']
    source = Input(truth.time, np.column_stack([truth.J_eq, np.full(len(truth.time), T_E)]), (False, False))
    run = simulate(Model(config), source, truth.time)
    T, x = (np.column_stack([run[f'{name}_1{unit}'], run[f'{name}_2{unit}']]) for name, unit in (('T', '_K'), ('x_M', '')))
    return {
        'T': float(np.sqrt(np.mean((T - truth.states['T']) ** 2))),
        'x_M': float(np.sqrt(np.mean((x - truth.states['x_M']) ** 2))),
    }


def told_strain(nominal: Config, robot: Robot, seed: int, std: float) -> Config:
    """The nominal model whose eps_T is that of the robot but for a relative standard deviation, which it is told."""
    value = robot.parameters['wire.eps_T'] * (1.0 + std * np.random.default_rng([seed, 9]).standard_normal())
    known = nominal.variant({'wire.eps_T': value})
    priors = {**known.priors, 'wire.eps_T': std * value}
    return Config(known.parameters, known.system, known.kinetics, effects=known.effects, priors=priors)


def from_then_on(truth: Truth, seed: int, begin: float) -> Truth:
    """A run from a random time on, at most `begin` [s]."""
    k = int(RATE * np.random.default_rng([seed, 4]).uniform(1.0, begin))
    states, shown = ({name: values[k:] for name, values in part.items()} for part in (truth.states, truth.shown))
    return Truth(truth.time[k:], truth.J_eq[k:], states, shown)


def solve(seed: int, duration: float, strain: float, begin: float, pool: Executor) -> dict[str, Any]:
    """All numbers of a robot. Raises SimulationError where it cannot do its run."""
    nominal, robot = robot_of(seed)
    nominal = told_strain(nominal, robot, seed, strain) if strain else nominal
    truth = truth_of(nominal, robot, seed, duration)
    truth = from_then_on(truth, seed, begin) if begin else truth
    forces = (*POSE, 'F_1', 'F_2')
    found: dict[str, Any] = {}
    for kinetics in ('hybrid', 'mas'):
        config = nominal.variant(kinetics=kinetics)
        found[f'{kinetics}, pose and forces'] = observed(config, truth, forces, 0.0, seed)
        found[f'{kinetics}, pose'] = observed(config, truth, POSE, 0.0, seed)
    found['hybrid, pose and forces, 10 % lost'] = observed(nominal, truth, forces, LOST, seed)
    found['hybrid, pose, 10 % lost'] = observed(nominal, truth, POSE, LOST, seed)
    found['heat balance alone'] = {'T': heat_balance_alone(nominal, truth)}
    found['model without measurements'] = model_alone(nominal, truth)
    return {'hidden': robot.hidden[0].truth.name if robot.hidden else '', 'observers': found}


def table(results: list[dict[str, Any]]) -> Iterator[str]:
    """Over robots: root mean squares of errors, quantiles of that of T, shares of true values in intervals."""
    known = [one for one in results if 'failed' not in one]
    yield '| observer | T [K] | median | 90 % | held [%] | x_M | held [%] | stress [Pa] | held [%] | ms |'
    yield '|---|' + '---|' * 9
    for name in known[0]['observers'] if known else ():
        runs = [one['observers'][name] for one in known]
        found = {key: np.array([run[key] for run in runs]) for key in runs[0]}
        cells = [f'{np.sqrt(np.mean(found["T"] ** 2)):.2f}', *(f'{np.quantile(found["T"], q):.2f}' for q in (0.5, 0.9))]
        for key in ('T covered', 'x_M', 'x_M covered', 'sigma', 'sigma covered', 'ms'):
            values = found.get(key, np.full(1, np.nan))
            cells.append(f'{100.0 * values.mean():.1f}' if 'covered' in key else f'{np.sqrt(np.mean(values**2)):.3g}')
        yield f'| {" | ".join([name, *cells]).replace("nan", "")} |'
    hidden = sum(bool(one['hidden']) for one in known)
    yield f'\n{len(known)} robots, {hidden} of them with a hidden effect'
    for seen in ('pose and forces', 'pose'):
        runs = [one['observers'][f'hybrid, {seen}'] for one in known]
        T, held = np.array([run['T'] for run in runs]), np.mean([run['T covered'] for run in runs])
        yield f'{seen}: T to {np.sqrt(np.mean(T**2)):.1f} K (RMS), {100.0 * held:.0f} % in its interval'


def row(result: dict[str, Any]) -> str:
    """How one robot went."""
    runs = result['observers']
    return f'{result["case"][0]} {result["hidden"]}: ' + ', '.join(f'{name} {run["T"]:.2f} K' for name, run in runs.items())


def main() -> None:
    """Solve what is not in the file yet, as far as the time goes, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--robots', type=int, default=200)
    parser.add_argument('--first', type=int, default=0)
    parser.add_argument('--seconds', type=float, default=40.0)
    parser.add_argument('--strain', type=float, default=0.0, help='relative, to which the transformation strain is known')
    parser.add_argument('--begin', type=float, default=0.0, help='[s] within which observers start')
    add_options(parser, 'observer.jsonl', 60.0)
    asked = parser.parse_args()
    cases = [(seed, asked.seconds, asked.strain, asked.begin) for seed in range(asked.first, asked.first + asked.robots)]
    print('\n'.join(table(solved(drawn(cases, asked.share), solve, asked, row))))


if __name__ == '__main__':
    main()
