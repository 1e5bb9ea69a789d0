"""Measured-like files of a module or a wire whose parameters are known, made by the simulator and seeded noise."""

import json
from dataclasses import replace

import numpy as np

from sma_sim import Model, default_parameters, module_input, read_config, simulate, wire_input
from sma_sim.evidence.data.tables import write_columns
from sma_sim.solver.inputs import inputs_at

NOISE = {'U_x_m': 2e-6, 'U_y_m': 1e-5, 'alpha_rad': 3.5e-4, 'F_1_N': 0.05, 'F_2_N': 0.05, 'stress_Pa': 1e6}
CHANNELS = {'U_x': 2e-6, 'U_y': 1e-5, 'alpha': 3.5e-4, 'F_1': 0.05, 'F_2': 0.05, 'stress': 1e6}


def truth(system='module', model='hybrid', effects=(), **factors):
    """The paper's values, some of them multiplied (group__name=factor)."""
    config = read_config(words=[f'system={system}', f'model={model}'], effects=effects)
    values = {name.replace('__', '.'): factor for name, factor in factors.items()}
    changed = {name: factor * default_parameters()[name] for name, factor in values.items()}
    return replace(config, parameters={**config.parameters, **changed})


def write_run(path, config, source, rate=20.0, seed=0):
    """One run as a file of the contract."""
    random = np.random.default_rng(seed)
    run = simulate(Model(config), source, rate)
    shown = {
        name: column + NOISE[name] * random.normal(size=len(column)) for name, column in run.columns.items() if name in NOISE
    }
    write_columns(path, inputs_at(source, run.time) | shown)
    return path


def write_module_runs(folder, config, count=3, seconds=30.0):
    """Runs of a module under random steps of its command; meta.json has the noise."""
    for k in range(count):
        random = np.random.default_rng(10 + k)
        times = 0.05 * np.round(20.0 * np.sort(random.uniform(0.5, seconds - 4.0, 5)))
        source = module_input([0.0, *times, seconds], [*random.uniform(-14.0, 14.0, 6), 0.0])
        write_run(folder / f'run{k + 1}.csv', config, source, seed=k)
    (folder / 'meta.json').write_text(json.dumps({'noise_std': {name: CHANNELS[name] for name in list(CHANNELS)[:5]}}))
    return folder


def write_isotherm(path, config, T_E, seed=0):
    """A slow loop of a wire at one temperature."""
    source = wire_input([0.0, 400.0, 800.0], [0.0, 0.06, 0.0], T_E=T_E)
    return write_run(path, config, source, rate=1.0, seed=seed)
