"""The observer beside a particle filter that knows the same of a robot and linearises nothing.

    python benchmarks/observer_particles.py [--robots 3] [--first 200] [--seconds 30] [--particles 500] [--json FILE]

Robots are those of benchmarks/observer.py. A particle is a robot with MAS kinetics whose parameters, parts of heating and
ambient temperature are drawn from what the observer takes for possible; it runs under the commands. The slow difference of
model and sensor in each channel is linear, so that its filter is exact beside every particle: a marginalised particle filter
(Schon, Gustafsson, Nordlund, IEEE Trans. Signal Process. 53 (2005) 2279). Weights are products of the likelihoods of all
measurements so far. Parameters do not change, so that resampling would only copy particles: how many of them count in the
end is in the table (1 over the sum of squared weights).
"""

from __future__ import annotations

import argparse
import time
from typing import Any

import numpy as np
from common import report
from numpy.typing import NDArray
from observer import INTERVAL, NOISE_STD, POSE, RATE, Truth, heat_balance_alone, observed, robot_of, truth_of

from sma_sim import Config, Input, Model, simulate
from sma_sim.evidence.state_estimation.uncertain import channel_discrepancies, configured, uncertain_parameters
from sma_sim.solver.simulate import SimulationError

Matrix = NDArray[np.float64]
CHANNELS = (*POSE, 'F_1', 'F_2')


def particle(config: Config, truth: Truth, random: np.random.Generator) -> tuple[Matrix, Matrix] | None:
    """Channels (k, channels), and T and x_M of the wires (k, 4), of a robot that is possible; None where it cannot run."""
    u, free = config.parameters, uncertain_parameters(config)
    z = np.array([np.clip(random.standard_normal(), one.low, one.high) for one in free])
    gains = 1.0 + u['observer.power_std'] * random.standard_normal(2)
    T_E = u['environment.T_E'] + u['observer.T_E_std'] * random.standard_normal()
    J = np.where(truth.J_eq > 0.0, gains[0], gains[1]) * truth.J_eq
    source = Input(truth.time, np.column_stack([J, np.full(len(J), T_E)]), (False, False))
    try:
        run = simulate(Model(configured(config, free, z)), source, truth.time)
    except SimulationError:
        return None
    if not run.completed:
        return None
    columns = [run[name] for name in ('U_x_m', 'U_y_m', 'alpha_rad', 'F_1_N', 'F_2_N')]
    return np.column_stack(columns), np.column_stack([run[name] for name in ('T_1_K', 'T_2_K', 'x_M_1', 'x_M_2')])


def log_weights(config: Config, shown: Matrix, measured: Matrix, noise: Matrix) -> Matrix:
    """Log likelihoods (particles, k) of measurements (k, channels) up to each one; `shown` is (particles, k, channels)."""
    stationary = channel_discrepancies(config)[: len(noise)] ** 2
    decay = np.exp(-1.0 / RATE / config.parameters['observer.discrepancy_time'])
    mean, variance, found = np.zeros((len(shown), len(noise))), stationary.copy(), []
    for k in range(len(measured)):
        innovation, expected = measured[k] - shown[:, k] - mean, variance + noise**2
        found.append(-0.5 * np.sum(innovation**2 / expected + np.log(expected), axis=1))
        gain = variance / expected
        mean, variance = (
            decay * (mean + gain * innovation),
            decay**2 * (1.0 - gain) * variance + (1.0 - decay**2) * stationary,
        )
    return np.cumsum(found, axis=0).T


def filtered(config: Config, truth: Truth, channels: int, particles: int, seed: int) -> dict[str, float]:
    """Errors and intervals of the particle filter with the first channels."""
    random, began = np.random.default_rng([seed, 3]), time.process_time()
    noise = np.array([NOISE_STD[name] for name in CHANNELS[:channels]])
    measured = np.column_stack([truth.shown[name] for name in CHANNELS[:channels]])
    measured = measured + noise * random.standard_normal(measured.shape)
    drawn = [one for one in (particle(config, truth, random) for _ in range(particles)) if one is not None]
    shown, states = (np.array(part) for part in zip(*drawn, strict=True))
    log = log_weights(config, shown[:, :, :channels], measured, noise)
    weights = np.exp(log - log.max(axis=0))
    weights /= weights.sum(axis=0)
    mean = np.einsum('pk,pks->ks', weights, states)
    std = np.sqrt(np.maximum(np.einsum('pk,pks->ks', weights, states**2) - mean**2, 0.0))
    result: dict[str, float] = {
        'ms': 1e3 * (time.process_time() - began) / len(truth.time),
        'particles that count': float(1.0 / np.sum(weights[:, -1] ** 2)),
    }
    for name, at in (('T', slice(0, 2)), ('x_M', slice(2, 4))):
        error = mean[:, at] - truth.states[name]
        result[name] = float(np.sqrt(np.mean(error**2)))
        result[f'{name} covered'] = float(np.mean(np.abs(error) <= INTERVAL * std[:, at]))
    return result


def one_robot(seed: int, duration: float, particles: int) -> dict[str, Any] | None:
    """All numbers of a robot; None where it cannot do its run."""
    nominal, robot = robot_of(seed)
    try:
        truth = truth_of(nominal, robot, seed, duration)
    except SimulationError:
        return None
    config, found = nominal.variant(kinetics='mas'), dict[str, Any]()
    for words, count in (('pose and forces', 5), ('pose', 3)):
        found[f'observer, {words}'] = observed(config, truth, CHANNELS[:count], 0.0, seed)
        found[f'particles, {words}'] = filtered(config, truth, count, particles, seed)
    found['heat balance alone'] = {'T': heat_balance_alone(nominal, truth)}
    return found


def measure(arguments: argparse.Namespace) -> dict[str, Any]:
    """All robots."""
    robots, seed = list[dict[str, Any]](), arguments.first
    while len(robots) < arguments.robots:
        found = one_robot(seed, float(arguments.seconds), arguments.particles)
        if found is not None:
            robots.append(found)
            print(seed, found, flush=True)
        seed += 1
    return {
        name: {
            key: float(
                np.sqrt(np.mean([one[name][key] ** 2 for one in robots]))
                if key in ('T', 'x_M')
                else np.mean([one[name][key] for one in robots])
            )
            for key in robots[0][name]
            if key.startswith(('T', 'x_M', 'ms', 'particles'))
        }
        for name in robots[0]
    }


if __name__ == '__main__':
    report('The observer beside a particle filter', measure, robots=3, first=200, seconds=30, particles=500)
