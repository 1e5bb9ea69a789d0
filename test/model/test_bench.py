"""A wire on a bench that imposes its stress, its temperature or both: closed forms, starts, files, starts of fits."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sma_sim import FitOptions, Input, Model, UserError, calibrate, diagnose, read_config, read_dataset, simulate
from sma_sim.cli.main import main
from sma_sim.evidence.estimation.curve_features import isobaric_tests
from sma_sim.evidence.estimation.prepared_fit import started_from_curves
from sma_sim.model.material import latent_heat

EXAMPLE = Path(__file__).resolve().parents[2] / 'examples' / 'real' / 'isobaric'
ALLOY = [
    'wire.E_A=6e10',
    'wire.E_M=4e10',
    'wire.eps_T=0.04',
    'wire.sigma_T=6e6',
    'wire.T0=420',
    'wire.sigma_MW0=1e8',
    'wire.dsigma=1.2e8',
    'wire.n=1',
]
SMOOTH = 'smooth_transformation:width_A=1e8,width_M=1.5e8,start_A=2,end_A=3,start_M=4,end_M=5'
ORIENTED = 'stress_dependent_transformation_strain:deficit=0.8,k=1e8,sigma_crit=2e7'


def bench(control, temperature, *words, effects=(), kind='hybrid'):
    """A model of a wire on a bench."""
    options = ['system=wire', f'bench.control={control}', f'bench.temperature={temperature}', f'model={kind}']
    return Model(read_config(words=[*options, *ALLOY, *words], effects=effects))


def isobar(model, stress, low=300.0, high=620.0, rows=801):
    """Heating and cooling at one stress, as slowly as isobaric tests are."""
    times = np.linspace(0.0, 4000.0, rows)
    T = low + (high - low) * (1.0 - np.abs(times / 2000.0 - 1.0))
    values = np.column_stack([np.full(rows, stress), T, np.zeros(rows), np.full(rows, 298.0)])
    run = simulate(model, Input(times, values, (True, True, False, False), model.structure.input_columns), times)
    assert run.completed
    return T, run


@pytest.mark.parametrize('kind', ['hybrid', 'mas'])
@pytest.mark.parametrize('stress', [7e6, 1e8, 3e8])
def test_isobar_is_the_closed_form(stress, kind):
    """At constant stress T(x_M) follows from sigma = sigma_A + s_A and sigma_M + s_M, strain from x_M and H(sigma)."""
    model = bench('stress', 'prescribed', 'wire.V_L=5e-22', 'wire.omega_x=1e4', effects=[SMOOTH, ORIENTED], kind=kind)
    T, run = isobar(model, stress)
    x = np.linspace(0.0, 1.0, 4001)
    middle = 420.0 + (stress - 1e8) / 6e6
    heating = middle + 10.0 - 0.5 * 1.5e8 / 6e6 * (x**4 - (1.0 - x) ** 5)
    cooling = middle - 10.0 - 0.5 * 1e8 / 6e6 * (x**3 - (1.0 - x) ** 2)
    first = np.arange(len(T)) <= len(T) // 2
    expected = np.where(first, np.interp(T, heating[::-1], x[::-1]), np.interp(T, cooling[::-1], x[::-1]))
    H = 0.04 * (1.0 - 0.8 * np.exp(-max(stress - 2e7, 0.0) / 1e8))
    strain = stress * (expected / 4e10 + (1.0 - expected) / 6e10) + H * expected
    near = 2e-3 if kind == 'hybrid' else 3e-2  # MAS wires transform before sigma_A, by thermal activation
    assert run['x_M'] == pytest.approx(expected, abs=near)
    assert run['strain'] == pytest.approx(strain, abs=near * 0.05)
    assert np.ptp(run['x_M']) == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize('kind', ['hybrid', 'mas'])
def test_without_hardening_strain_jumps_at_one_temperature(kind):
    """Stress and temperature imposed: all of it transforms within a fraction of a kelvin beyond sigma_M and sigma_A."""
    T, run = isobar(bench('stress', 'prescribed', 'wire.V_L=5e-22', kind=kind), 2e8)
    middle, half = 420.0 + 1e8 / 6e6, 0.5 * 1.2e8 / 6e6
    turns = np.flatnonzero(np.diff(run['x_M'] > 0.5))
    assert T[turns] == pytest.approx([middle + half, middle - half], abs=1.5)
    inside = (run['x_M'] > 0.02) & (run['x_M'] < 0.98)
    assert inside.sum() <= 6
    assert np.ptp(run['strain']) == pytest.approx(0.04 + 2e8 * (1 / 4e10 - 1 / 6e10), rel=1e-3)


@pytest.mark.parametrize('kind', ['hybrid', 'mas'])
def test_under_a_dead_weight_latent_heat_sets_the_rate(kind):
    """Heat into a wire that transforms under a constant stress: T stays at sigma_M(T) = sigma, dx_M/dt = -J/L_x.

    A MAS wire transforms some kelvins before that, by thermal activation, and at a temperature that hardly moves.
    """
    words = ['wire.lambda=0', 'initial.x_M_1=1', 'environment.T_E=300', 'wire.V_L=5e-22', 'solver.rtol=1e-6']
    model = bench('stress', 'balance', *words, kind=kind)
    J, stress = 0.2, 2e8
    times = np.array([0.0, 12.0])
    values = np.column_stack([np.full(2, stress), np.full(2, J), np.full(2, 300.0)])
    run = simulate(model, Input(times, values, (True, False, False), model.structure.input_columns), 100.0)
    assert run.completed
    moving = (run['x_M'] < 0.95) & (run['x_M'] > 0.05)
    plateau = 420.0 + (stress - 1e8 + 0.6e8) / 6e6
    assert moving.sum() > 20
    T, near = run['T_K'][moving], 0.05 if kind == 'hybrid' else 1.5
    assert np.abs(T - plateau).max() < near and np.ptp(T) < near
    rate = np.gradient(run['x_M'], run.time)[moving][2:-2]
    assert rate == pytest.approx(
        -J / latent_heat(T.mean(), stress, model.compiled.wire), rel=2e-3 if kind == 'hybrid' else 0.02
    )


def test_load_and_wire_are_in_balance_while_nothing_jumps():
    model = bench('stress', 'prescribed', effects=[SMOOTH])
    _, run = isobar(model, 1e8)
    section = model.compiled.wire.section
    assert run['F_N'] / section == pytest.approx(1e8, rel=2e-3)


def test_a_specimen_at_a_set_temperature_is_stretched():
    """Isothermal tensile test: sigma = sigma_A on the way up, E_A before; heat does not matter."""
    model = bench('strain', 'prescribed', 'initial.x_M_1=0')
    assert model.structure.channels == ('stress', 'R')
    times = np.array([0.0, 100.0])
    values = np.column_stack([[0.0, 0.03], [450.0, 450.0], np.zeros(2), np.full(2, 298.0)])
    run = simulate(model, Input(times, values, (True, True, False, False), model.structure.input_columns), 10.0)
    sigma_A = 1e8 + 6e6 * 30.0 + 0.6e8
    strain = 3e-4 * run.time
    assert run['stress_Pa'] == pytest.approx(np.minimum(6e10 * strain, sigma_A), rel=1e-6, abs=1.0)
    assert run['T_K'] == pytest.approx(450.0)


def test_options_choose_the_bench():
    assert read_config(words=['system=wire']).system == 'wire'
    assert read_config(words=['system=wire', 'bench.control=stress']).system == 'wire_under_load'
    both = read_config(words=['system=wire_under_load', 'bench.temperature=prescribed'])
    assert both.system == 'wire_under_load_at_T' and both.parameters['bench.lag'] == 1e-4
    with pytest.raises(UserError, match='bench.control.*expected one of strain, stress'):
        read_config(words=['system=wire', 'bench.control=force'])
    with pytest.raises(UserError, match='unknown parameter bench.control'):
        read_config(words=['bench.control=stress'])


def write_levels(folder, levels, effects=(), noise=2e-5):
    """Isobaric tests of the alloy as a laboratory writes them."""
    random = np.random.default_rng(4)
    for stress in levels:
        T, run = isobar(bench('stress', 'prescribed', effects=effects), stress, rows=401)
        strain = run['strain'] + noise * random.standard_normal(len(T))
        rows = [f'{t - 273.15:.3f},{e:.7f},{stress / 1e6:.2f}' for t, e in zip(T, strain, strict=True)]
        (folder / f'{stress / 1e6:g}MPa.csv').write_text('\n'.join(['temperature_C,strain,stress_MPa', *rows, '']))


def test_starts_come_from_the_curves(tmp_path):
    """Transformation temperatures by tangents, and the parameters that follow, near those of the wire."""
    levels = [5e7, 1.5e8, 3e8]
    write_levels(tmp_path, levels, [SMOOTH])
    config = read_config(EXAMPLE / 'config.yaml')
    dataset = read_dataset([tmp_path], config.system, 298.0, EXAMPLE / 'map.yaml')
    tests = isobaric_tests(dataset)
    assert [test.stress for test in tests] == levels
    for test in tests:
        middle = 420.0 + (test.stress - 1e8) / 6e6
        assert test.cooling.low < test.cooling.high < middle + 5.0 < test.heating.high
        assert test.heating.steepest == pytest.approx(middle + 10.0, abs=8.0)
        assert test.recovered == pytest.approx(0.04, abs=0.005)
    started, _ = started_from_curves(dataset, config)
    for name, value in (('sigma_T', 6e6), ('E_A', 6e10), ('eps_T', 0.04), ('dsigma', 1.2e8)):
        assert started.parameters[f'wire.{name}'] == pytest.approx(value, rel=0.35)
    kept, _ = started_from_curves(dataset, read_config(EXAMPLE / 'config.yaml', ['wire.eps_T=0.05']))
    assert kept.parameters['wire.eps_T'] == 0.05


def test_fit_of_isobaric_tests_from_the_command_line(tmp_path, capsys):
    write_levels(tmp_path, [5e7, 2e8])
    words = ['--config', str(EXAMPLE / 'config.yaml'), '--map', str(EXAMPLE / 'map.yaml'), '--model', 'hybrid']
    assert main(['compare', str(tmp_path), *words]) == 0
    out = capsys.readouterr()
    assert 'transformation temperatures by tangents' in out.out and 'T_E_K' not in out.err


def test_a_map_without_a_pace_is_refused(tmp_path, capsys):
    write_levels(tmp_path, [5e7])
    wrong = tmp_path / 'map.yaml'
    wrong.write_text((EXAMPLE / 'map.yaml').read_text().replace('rate: 0.1667', 'speed: 1'))
    assert main(['compare', str(tmp_path / '50MPa.csv'), '--config', str(EXAMPLE / 'config.yaml'), '--map', str(wrong)]) != 0
    assert 'expected' in capsys.readouterr().err


def test_temperatures_in_celsius_are_refused(tmp_path, capsys):
    (tmp_path / 'in.csv').write_text('time_s,stress_Pa,T_K\n0,1e8,20\n100,1e8,90\n')
    words = ['--system', 'wire_under_load_at_T', '--input', str(tmp_path / 'in.csv'), '--out', str(tmp_path / 'out.csv')]
    assert main(['simulate', *words]) == 2
    assert 'column T_K: expected kelvin' in capsys.readouterr().err and not (tmp_path / 'out.csv').exists()


def test_two_configurations_start_from_one_table_of_temperatures(tmp_path, capsys):
    write_levels(tmp_path, [5e7])
    config = str(EXAMPLE / 'config.yaml')
    words = ['--config', config, '--config', config, '--map', str(EXAMPLE / 'map.yaml'), '--model', 'hybrid']
    assert main(['compare', str(tmp_path / '50MPa.csv'), *words]) == 0
    assert capsys.readouterr().out.count('transformation temperatures by tangents') == 1


def test_a_fit_and_a_diagnosis_start_from_the_curves_without_being_told(monkeypatch):
    """The Python functions begin where the commands do; what is only compared stays as it is."""
    config = read_config(EXAMPLE / 'config.yaml')
    dataset = read_dataset([EXAMPLE / 'nitico' / '50MPa.csv'], 'wire_under_load_at_T', 298.15, EXAMPLE / 'map.yaml')
    expected = started_from_curves(dataset, config)[0].parameters
    options = FitOptions(free=('wire.eps_T',), kinetics='hybrid', starts=1, intervals=False)
    found = calibrate(dataset, config, options).config.parameters
    assert {name: found[name] for name in ('wire.T0', 'wire.sigma_T', 'wire.E_A')} == {
        name: expected[name] for name in ('wire.T0', 'wire.sigma_T', 'wire.E_A')
    }
    asked = []

    def caught(start, *rest):
        asked.append(start.config.parameters)
        raise UserError('far enough')

    monkeypatch.setattr('sma_sim.evidence.diagnosis.diagnose.search_effects', caught)
    with pytest.raises(UserError, match='far enough'):
        diagnose(dataset, config)
    assert asked == [expected]
    as_it_is = calibrate(dataset, config, replace(options, free=()))
    assert as_it_is.config.parameters['wire.T0'] == config.parameters['wire.T0'] != expected['wire.T0']
