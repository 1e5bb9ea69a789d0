"""The electrical resistance of a wire as a channel: simulated, read, fitted, compared."""

import numpy as np
import pytest
from systems import make_model

from sma_sim import FitOptions, Input, Model, calibrate, module_input, read_config, read_dataset, simulate
from sma_sim.cli.main import main
from sma_sim.evidence.data.tables import read_columns, read_header, write_columns
from sma_sim.evidence.estimation.free_parameters import RESISTIVITY_NAMES, choose_free
from sma_sim.solver.inputs import inputs_at

RHO = {'A': (8.9e-7, 2e-4), 'M': (1.02e-6, 3e-4)}  # of the configuration: [ohm m] at 293.15 K, [1/K]


def closed_form(strain, x, T, r0=75e-6, l0=95.7e-3):
    """rho_e l^2/V with the volume V of the wire, phases in series."""
    rho = {phase: value * (1.0 + slope * (T - 293.15)) for phase, (value, slope) in RHO.items()}
    return (x * rho['M'] + (1.0 - x) * rho['A']) * (l0 * (1.0 + strain)) ** 2 / (np.pi * r0**2 * l0)


@pytest.mark.parametrize('kind', ['hybrid', 'mas'])
def test_resistance_is_that_of_phase_temperature_and_strain(kind):
    source = Input(
        np.array([0.0, 4.0, 8.0]),
        np.array([[0.0, 0.0, 298.0], [0.05, 0.3, 298.0], [0.01, 0.0, 298.0]]),
        (True, False, False),
    )
    times = np.linspace(0.0, 8.0, 81)
    run = simulate(make_model('wire', kind), source, times)
    expected = closed_form(np.interp(times, source.times, source.values[:, 0]), run['x_M'], run['T_K'])
    assert run['R_ohm'] == pytest.approx(expected, rel=1e-9) and np.ptp(run['R_ohm']) > 0.3
    assert 'R_ohm' not in run.columns  # files have it where it is asked for
    alone = simulate(make_model('wire', kind), source, times, channels=('R',))
    assert alone['R_ohm'] == pytest.approx(expected, rel=1e-9)


def test_every_bundle_has_its_own():
    """A heated wire of a module contracts to austenite, which has less resistance; the other one is drawn."""
    command = module_input([0.0, 1.0, 8.0], [0.0, 14.0, 14.0])
    run = simulate(make_model(), command, np.linspace(0.0, 8.0, 41))
    assert run['R_1_ohm'][-1] < run['R_1_ohm'][0] - 0.05 and run['R_2_ohm'][-1] > run['R_2_ohm'][0] + 0.01
    sensed = simulate(make_model(), command, np.linspace(0.0, 8.0, 41), channels=('R_2', 'alpha'))
    assert np.array_equal(sensed['R_2_ohm'], run['R_2_ohm'])


def isothermal(folder, config, temperatures=(330.0, 360.0), noise=2e-3):
    """Tensile tests whose resistance is recorded, in milliohm."""
    random, paths = np.random.default_rng(5), []
    times = np.array([0.0, 60.0, 120.0])
    for T in temperatures:
        source = Input(
            times,
            np.column_stack([[0.0, 0.06, 0.0], np.full(3, T), np.zeros(3), np.full(3, 298.0)]),
            (True, True, False, False),
            config.structure.input_columns,
        )
        run = simulate(Model(config), source, np.linspace(0.0, 120.0, 241))
        shown = {'milliohm': 1e3 * (run['R_ohm'] + noise * random.normal(size=241))}
        shown['stress_Pa'] = run['stress_Pa'] + 1e5 * random.normal(size=241)
        paths.append(folder / f'{T:g}.csv')
        write_columns(paths[-1], inputs_at(source, run.time) | shown)
    (folder / 'map.yaml').write_text('R_ohm: {column: milliohm, scale: 1.0e-3}\n')
    return paths


def test_self_sensing_data_are_fitted(tmp_path):
    """Resistivities and their slopes come back within their intervals, and only where a resistance is there."""
    words = ['system=wire', 'bench.temperature=prescribed', 'initial.x_M_1=0', 'model=hybrid']
    config = read_config(words=words)
    true = ['wire.resistivity_A=8.2e-7', 'wire.resistivity_M=9.6e-7', 'wire.resistivity_T_A=5e-4']
    paths = isothermal(tmp_path, read_config(words=[*words, *true]))
    dataset = read_dataset(paths, config.structure.name, 298.0, tmp_path / 'map.yaml', {'R': 2e-3, 'stress': 1e5})
    assert dataset.channels == {'R', 'stress'}
    free, _ = choose_free(config, None, dataset.channels)
    assert set(RESISTIVITY_NAMES) <= {p.name for p in free}
    found = calibrate(dataset, config, FitOptions(None, 'hybrid', starts=1))
    assert found.error == pytest.approx(1.0, abs=0.1)
    truth = dict(zip(RESISTIVITY_NAMES, (8.2e-7, 9.6e-7, 5e-4, 3e-4), strict=True))
    for interval in found.uncertainty.intervals:
        if interval.name in truth:
            width = interval.high - interval.low
            assert interval.low - width < truth[interval.name] < interval.high + width
    assert found.values['wire.resistivity_A'] == pytest.approx(8.2e-7, rel=0.02)


def test_resistivities_stay_where_no_resistance_is_measured():
    config = read_config()
    free, fixed = choose_free(config, ['wire.E_A', 'wire.resistivity_A'], {'alpha'})
    assert [p.name for p in free] == ['wire.E_A'] and 'no resistance is measured' in fixed[0].reason
    thickness, _ = choose_free(
        config,
        ['wire.r0', *(f'wire.{n}' for n in ('E_A', 'E_M', 'sigma_T', 'sigma_MW0', 'dsigma', 'c_V', 'lambda'))],
        {'alpha', 'R_1'},
    )
    assert 'wire.r0' in [p.name for p in thickness]  # a resistance shows the section of a wire of known resistivity


def test_files_have_it_where_it_is_asked_for(tmp_path, capsys):
    (tmp_path / 'in.csv').write_text('time_s,strain,J_W,T_E_K\n0,0.03,0,298\n5,0.03,0.3,298\n10,0.03,0,298\n')
    words = ['simulate', '--system', 'wire', '--input', str(tmp_path / 'in.csv'), '--rate', '10']
    for name, more in (('plain.csv', []), ('with.csv', ['--resistance']), ('with.mcap', ['--resistance'])):
        assert main([*words, '--out', str(tmp_path / name), *more]) == 0
    columns = read_columns(tmp_path / 'with.csv', ['R_ohm'])
    assert 'R_ohm' not in read_header(tmp_path / 'plain.csv') and len(columns['R_ohm']) == 101
    for name in ('with.csv', 'with.mcap'):
        (recording,) = read_dataset([tmp_path / name], 'wire', 298.0).recordings
        assert recording.channels['R'] == pytest.approx(columns['R_ohm'], rel=1e-6)


def test_milliohm_are_refused_with_what_converts_them(tmp_path, capsys):
    (tmp_path / 'r.csv').write_text('time_s,strain,T_K,R_ohm\n0,0,330,4900\n1,0.01,330,5000\n2,0.02,330,5100\n')
    assert main(['compare', str(tmp_path / 'r.csv'), '--system', 'wire_at_T']) == 2
    error = capsys.readouterr().err
    assert 'column R_ohm: expected ohm of a wire' in error and 'R_ohm: {column: R_ohm, scale: 0.001}' in error
