"""Recordings made by the simulator itself, for the tests of the fit."""

from dataclasses import replace

import numpy as np

from sma_sim import Config, Dataset, Model, Recording, default_parameters, module_input, simulate
from sma_sim.evidence.data.recording import CHANNEL_COLUMNS

NOISE = {'U_x': 2e-6, 'U_y': 1e-5, 'alpha': 3.5e-4, 'F_1': 0.05, 'F_2': 0.05}


def config(model='auto', system='module', **parameters):
    """The paper's values; parameters as group__name=value."""
    given = {name.replace('__', '.'): value for name, value in parameters.items()}
    return Config(default_parameters() | given, system, model)


def scaled(base, **factors):
    """A configuration with parameters multiplied."""
    given = {name.replace('__', '.'): factor for name, factor in factors.items()}
    values = {name: base.parameters[name] * factor for name, factor in given.items()}
    return replace(base, parameters={**base.parameters, **values})


def command(seed, seconds=40.0, steps=5, power=15.0):
    """Random steps of J_eq, held."""
    random = np.random.default_rng(seed)
    times = np.concatenate([[0.0], np.sort(random.uniform(0.0, 0.9 * seconds, steps)), [seconds]])
    return module_input(times, np.append(random.uniform(-power, power, steps + 1), 0.0))


def recording(truth, source, rate=20.0, noise=0.0, delay=0.0, seed=0, channels=tuple(NOISE), rtol=1e-7):
    """What sensors of a robot like `truth` show under an input."""
    random = np.random.default_rng(seed)
    exact = replace(truth, parameters={**truth.parameters, 'solver.rtol': rtol})
    times = np.arange(int(source.times[-1] * rate)) / rate
    seen = simulate(Model(exact), source, np.unique(np.maximum(times - delay, 0.0)))
    index = len(seen.time) - len(times) + np.arange(len(times))
    measured = {
        name: seen[CHANNEL_COLUMNS[name]][np.maximum(index, 0)] + noise * NOISE[name] * random.normal(size=len(times))
        for name in channels
    }
    return Recording(f'run{seed}', truth.system, times, measured, source)


def dataset(truth, seeds, noise=0.0, seconds=40.0, **options):
    """Several such recordings."""
    runs = tuple(recording(truth, command(seed, seconds), noise=noise, seed=seed, **options) for seed in seeds)
    return Dataset(runs, dict(NOISE))
