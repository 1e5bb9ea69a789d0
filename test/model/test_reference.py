"""The model against trajectories of an independent implementation (when they are at hand)."""

from pathlib import Path

import numpy as np
import pytest

from sma_sim import Config, Input, Model, default_parameters, simulate

REFERENCE = Path(__file__).resolve().parents[3] / 'shared' / 'reference'
pytestmark = pytest.mark.skipif(not REFERENCE.is_dir(), reason='reference trajectories are not on this machine')


def table(name):
    return np.genfromtxt(REFERENCE / name, delimiter=',', names=True)


@pytest.mark.parametrize('kind', ['hybrid', 'mas'])
@pytest.mark.parametrize('case', ['steps', 'random_a', 'random_b'])
def test_module(case, kind):
    command, expected = table(f'module_{case}_input.csv'), table(f'module_{case}_{kind}.csv')
    parameters = default_parameters() | {'initial.x_M_1': 0.561235873, 'initial.x_M_2': 0.561235873}
    ambient = np.full(len(command), 298.0)
    source = Input(command['time_s'], np.column_stack([command['J_eq_W'], ambient]), (False, False))
    run = simulate(Model(Config(parameters, 'module', kind)), source, expected['time_s'])
    assert run.completed
    assert np.degrees(np.abs(run['alpha_rad'] - expected['alpha_rad'])).max() < 1e-3
    assert np.abs(run['U_x_m'] - expected['U_x_m']).max() < 1e-8
    assert np.abs(run['U_y_m'] - expected['U_y_m']).max() < 2e-7
    for name in ('T_1_K', 'T_2_K'):
        assert np.abs(run[name] - expected[name]).max() < 5e-3
    for wire in (1, 2):
        if kind == 'mas':
            assert np.abs(run[f'x_M_{wire}'] - expected[f'x_M_{wire}']).max() < 2e-5
        else:
            moving = np.abs(np.gradient(run[f'x_M_{wire}'], run.time)) > 1e-5
            assert np.mean(run[f'mode_{wire}'][moving] == expected[f'mode_{wire}'][moving]) > 0.995


@pytest.mark.parametrize('case', ['slow', 'fast_selfheating', 'powered'])
def test_wire_hybrid(case):
    command, expected = table(f'wire_{case}_input.csv'), table(f'wire_{case}_hybrid.csv')
    values = np.column_stack([command['strain'], command['J_W'], command['T_E_K']])
    source = Input(command['time_s'], values, (True, False, False))
    run = simulate(Model(Config(system='wire')), source, expected['time_s'])
    error = run['stress_Pa'] - expected['stress_Pa'][: len(run.time)]
    assert run.completed
    assert np.sqrt(np.mean(error**2)) < 0.02e6
    assert {1, 2, 3, 4, 5} >= set(run['mode'])


@pytest.mark.parametrize('temperature', [292, 315, 338])
def test_wire_isotherm_mas(temperature):
    expected = table(f'wire_isotherm_{temperature}K_mas.csv')
    strain = np.array([0.0, 0.075, 0.02, 0.05, 0.0])
    times = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(strain))) / 1e-4])
    # an isotherm: the wire is kept at ambient temperature by a very large cooling coefficient
    parameters = default_parameters() | {'wire.lambda': 1e6}
    values = np.column_stack([strain, np.zeros(5), np.full(5, float(temperature))])
    run = simulate(Model(Config(parameters, 'wire', 'mas')), Input(times, values, (True, False, False)), expected['time_s'])
    error = run['stress_Pa'] - expected['stress_Pa'][: len(run.time)]
    assert np.sqrt(np.mean(error**2)) < 0.05e6
