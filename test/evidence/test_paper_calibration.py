"""The paper's calibration of a wire from isotherms."""

from pathlib import Path

import numpy as np
import pytest
from simulated_data import config, scaled

from sma_sim import Dataset, Model, Recording, UserError, simulate, wire_input
from sma_sim.evidence.data.tables import read_columns
from sma_sim.evidence.estimation.paper_calibration import calibrate_as_the_paper

REFERENCE = Path(__file__).resolve().parents[3] / 'shared' / 'reference'
NOISE = {'stress': 5e5}


def isotherm(truth, T_E, seed, spread=0.0):
    """A slow loop at one temperature; `spread` [Pa] shifts sigma_MW."""
    source = wire_input([0, 750, 1300, 1600, 2100], [0, 0.075, 0.02, 0.05, 0.0], 0.0, T_E)
    times = np.arange(0.0, 2100.0, 5.0)
    here = scaled(truth, wire__sigma_MW0=1.0 + spread / truth.parameters['wire.sigma_MW0'])
    stress = simulate(Model(here), source, times)['stress_Pa']
    noise = 5e5 * np.random.default_rng(seed).normal(size=len(times))
    return Recording(f'{T_E:g}K', 'wire', times, {'stress': stress + noise}, source)


def test_parameters_come_back_from_three_temperatures():
    truth = scaled(config(system='wire'), wire__E_A=1.1, wire__E_M=0.92, wire__dsigma=1.1, wire__sigma_T=0.9)
    runs = Dataset(tuple(isotherm(truth, T, k) for k, T in enumerate((292.0, 315.0, 338.0))), NOISE)
    found = calibrate_as_the_paper(runs, config(system='wire'))
    for name in ('wire.E_A', 'wire.dsigma', 'wire.sigma_MW0', 'wire.sigma_T'):
        assert found.config.parameters[name] == pytest.approx(truth.parameters[name], rel=0.02), name
    assert found.first.uncertainty is not None
    for interval in found.first.uncertainty.intervals:
        if interval.name in ('wire.E_M', 'wire.eps_T'):  # together: the loop ends in the plateau
            assert interval.low < truth.parameters[interval.name] < interval.high
    assert found.config.parameters['wire.T0'] == 323.0
    assert found.slopes == pytest.approx([truth.parameters['wire.sigma_T']] * 2, rel=0.02)
    assert found.dsigma_spread < 1.05
    cold, *warm = found.loops  # the cold one goes further than E_M and eps_T are known, which depend on their priors
    assert max(loop.rmse for loop in warm) < 1.1 * NOISE['stress'] and cold.rmse < 2.0 * NOISE['stress']


def test_one_slope_that_does_not_fit_is_seen():
    """A wire whose transformation stress is not a line over temperature."""
    truth = config(system='wire')
    runs = Dataset(tuple(isotherm(truth, T, k, s) for k, (T, s) in enumerate(((292, 0), (315, 8e6), (338, 0)))), NOISE)
    found = calibrate_as_the_paper(runs, truth)
    assert found.slopes[0] > 2.4e6 > 1.85e6 > found.slopes[1]
    assert max(loop.rmse for loop in found.loops) > 3.0 * NOISE['stress']


def test_temperatures_that_are_missing_are_said():
    one = isotherm(config(system='wire'), 300.0, 0)
    with pytest.raises(UserError, match='isotherms at 315 K'):
        calibrate_as_the_paper(Dataset((one,), NOISE), config(system='wire'))


@pytest.mark.skipif(not REFERENCE.is_dir(), reason='the reference trajectories are not here')
def test_reference_isotherms_give_the_papers_values():
    """MAS trajectories, fitted by the hybrid model: it sees the stresses where MAS begins to transform."""
    runs = []
    for T_E in (292, 315, 338):
        seen = read_columns(REFERENCE / f'wire_isotherm_{T_E}K_mas.csv', ['time_s', 'strain', 'stress_Pa'])
        corners = np.flatnonzero(np.abs(np.diff(seen['strain'], 2)) > 1e-9) + 1
        at = np.unique(np.concatenate([[0], corners, [len(seen['time_s']) - 1]]))
        source = wire_input(seen['time_s'][at], seen['strain'][at], 0.0, float(T_E))
        runs.append(Recording(f'{T_E}K', 'wire', seen['time_s'], {'stress': seen['stress_Pa']}, source))
    start = scaled(config(system='wire'), wire__E_A=0.9, wire__sigma_T=1.1)
    found = calibrate_as_the_paper(Dataset(tuple(runs), NOISE), start)
    near = {'wire.E_A': 0.02, 'wire.E_M': 0.02, 'wire.eps_T': 0.01, 'wire.sigma_T': 0.01, 'wire.sigma_MW0': 0.01}
    for name, rel in near.items():
        assert found.config.parameters[name] == pytest.approx(config().parameters[name], rel=rel), name
    assert max(loop.rmse for loop in found.loops) < 2e6
