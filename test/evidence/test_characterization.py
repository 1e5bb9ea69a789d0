"""One wire in several kinds of tests: a map tells them apart, one fit takes them all, pages and sheets show them."""

import csv
from pathlib import Path

import numpy as np
import pytest
import yaml

from sma_sim import Config, Dataset, Input, Model, Recording, UserError, read_config, read_dataset, simulate, wire_input
from sma_sim.cli.main import main
from sma_sim.evidence.estimation.calibrate import FitOptions, calibrate
from sma_sim.evidence.estimation.curve_features import CurveFeatures, isothermal_features, median_slope, starting_values
from sma_sim.evidence.estimation.prepared_fit import started_from_curves
from sma_sim.evidence.residual_analysis.compare import compare
from sma_sim.evidence.residual_analysis.wire_tests import characterization

ALLOY = {
    'E_A': 6e10,
    'E_M': 3.5e10,
    'eps_T': 0.045,
    'sigma_T': 6.5e6,
    'T0': 330.0,
    'sigma_MW0': 1.5e8,
    'dsigma': 1.5e8,
    'c_V': 470.0,
    'lambda': 120.0,
    'r0': 2.5e-4,
    'l0': 0.2,
    'n': 1.0,
}
MAP = """\
system: wire
tests:
  - files: isobaric/*.csv
    bench: {control: stress, temperature: prescribed}
    time_s: {path: temperature_C, rate: 0.1667}
    T_K: {column: temperature_C, offset: 273.15}
    stress_Pa: {column: stress_MPa, scale: 1.0e+6}
    strain: strain
  - files: pulls/*.csv
    bench: {control: strain, temperature: prescribed}
    strain: {column: strain_percent, scale: 0.01}
    stress_Pa: {column: stress_MPa, scale: 1.0e+6}
    T_K: {column: temperature_C, offset: 273.15}
  - files: blocked/*.csv
    strain: {value: 0.02}
    J_W: power
    stress_Pa: {column: stress_MPa, scale: 1.0e+6}
    T_K: {column: temperature_C, offset: 273.15}
  - files: dsc/*.csv
    bench: {control: stress, temperature: balance}
    stress_Pa: {value: 0.0}
    J_W: {value: 0.0}
    T_E_K: {column: furnace_C, offset: 273.15}
    T_K: {column: specimen_C, offset: 273.15}
"""
KINDS = ('isobaric', 'pulls', 'blocked', 'dsc')
GEOMETRY = ['wire.l0=0.2', 'wire.r0=2.5e-4', 'wire.n=1', 'wire.c_V=450', 'wire.lambda=100']
SMOOTH = 'smooth_transformation:width_A=3e7,width_M=3e7,start_A=2,end_A=2,start_M=2,end_M=2'


def on_bench(control, temperature):
    """The true wire, which transforms gradually, on a bench."""
    words = [f'wire.{name}={value}' for name, value in ALLOY.items()]
    options = ['system=wire', f'bench.control={control}', f'bench.temperature={temperature}']
    return Model(read_config(words=[*options, *words], effects=[SMOOTH]))


def recorded(model, times, *imposed):
    """A run under imposed columns, in a room of 298 K where they leave that open."""
    structure = model.structure
    columns = (*imposed, 298.0)[: len(structure.input_columns)]
    values = np.column_stack([np.broadcast_to(column, times.shape) for column in columns])
    linear = tuple(k < len(structure.drives) for k in range(values.shape[1]))
    return simulate(model, Input(times, values, linear, structure.input_columns), times)


def write(path, **columns):
    """A table of a laboratory."""
    path.parent.mkdir(exist_ok=True)
    rows = zip(*(np.round(column, 7) for column in columns.values()), strict=True)
    path.write_text('\n'.join([','.join(columns), *(','.join(map(str, row)) for row in rows), '']))


@pytest.fixture(scope='module')
def campaign(tmp_path_factory):
    """Isobaric, isothermal, blocked-force and calorimetric tests of one wire, and their map."""
    folder, random = tmp_path_factory.mktemp('campaign'), np.random.default_rng(1)
    (folder / 'map.yaml').write_text(MAP)
    times = np.linspace(0.0, 4000.0, 301)
    there_and_back = 1.0 - np.abs(times / 2000.0 - 1.0)
    for stress in (5e7, 2e8):
        T = 285.0 + 140.0 * there_and_back
        run = recorded(on_bench('stress', 'prescribed'), times, stress, T, 0.0)
        strain = run['strain'] + 1e-4 + 2e-5 * random.normal(size=len(T))
        write(
            folder / 'isobaric' / f'{stress / 1e6:.0f}MPa.csv',
            temperature_C=T - 273.15,
            strain=strain,
            stress_MPa=np.full(len(T), stress / 1e6),
        )
    for T in (335.0, 350.0):
        strain = 0.05 * there_and_back
        run = recorded(on_bench('strain', 'prescribed'), times, strain, T, 0.0)
        write(
            folder / 'pulls' / f'{T:.0f}K.csv',
            time_s=times,
            strain_percent=100.0 * strain,
            stress_MPa=run['stress_Pa'] / 1e6 + 0.5 * random.normal(size=len(times)),
            temperature_C=np.full(len(times), T - 273.15),
        )
    times = np.arange(0.0, 60.0, 0.25)
    power = np.where((times > 5.0) & (times < 30.0), 2.0, 0.0)
    run = recorded(on_bench('strain', 'balance'), times, 0.02, power)
    write(
        folder / 'blocked' / 'heated.csv',
        time_s=times,
        power=power,
        stress_MPa=run['stress_Pa'] / 1e6 + 0.5 * random.normal(size=len(times)),
        temperature_C=run['T_K'] - 273.15 + 0.1 * random.normal(size=len(times)),
    )
    times = np.arange(0.0, 900.0, 3.0)
    furnace = 270.0 + 90.0 * (1.0 - np.abs(times / 450.0 - 1.0))
    run = recorded(on_bench('stress', 'balance'), times, 0.0, 0.0, furnace)
    write(
        folder / 'dsc' / 'no_load.csv',
        time_s=times,
        furnace_C=furnace - 273.15,
        specimen_C=run['T_K'] - 273.15 + 0.02 * random.normal(size=len(times)),
    )
    return folder


def words_of(campaign):
    """The command line for a campaign."""
    folders = [str(campaign / name) for name in KINDS]
    return [
        *folders,
        '--system',
        'wire',
        '--map',
        str(campaign / 'map.yaml'),
        '--model',
        'hybrid',
        '--starts',
        '1',
        *(word for one in GEOMETRY for word in ('--set', one)),
    ]


def dataset_of(campaign):
    """Its recordings."""
    folders = [campaign / name for name in KINDS]
    return read_dataset(folders, 'wire', 298.0, campaign / 'map.yaml')


def test_one_fit_takes_all_kinds_of_tests(campaign):
    dataset = dataset_of(campaign)
    assert [run.system for run in dataset.recordings] == [
        'wire_under_load_at_T',
        'wire_under_load_at_T',
        'wire_at_T',
        'wire_at_T',
        'wire',
        'wire_under_load',
    ]
    start = read_config(words=['system=wire', *GEOMETRY], effects=['smooth_transformation:width_A=2e7,width_M=2e7'])
    found = calibrate(dataset, start, FitOptions(kinetics='hybrid', starts=1))
    assert found.error < 1.15 and found.config.system == 'wire'
    for name, within in (('E_A', 0.03), ('E_M', 0.05), ('eps_T', 0.02), ('sigma_T', 0.02), ('c_V', 0.02), ('lambda', 0.02)):
        assert found.values[f'wire.{name}'] == pytest.approx(ALLOY[name], rel=within)
    zeros = {run.name: run.zero for run in found.runs if run.quasi_static}
    assert zeros == pytest.approx({'200MPa': 1e-4, '50MPa': 1e-4}, abs=1e-4)
    features = characterization(compare(dataset, found.config))
    assert [test.measured.stress for test in features.isobaric] == [5e7, 2e8] and len(features.isothermal) == 2
    for test in features.isobaric:
        assert test.model is not None
        assert test.model.temperatures == pytest.approx(test.measured.temperatures, abs=3.0)
    assert features.slopes == pytest.approx((6.5e6, 6.5e6), rel=0.05)


def test_the_command_writes_the_page_and_the_sheet(campaign, tmp_path, capsys):
    page, sheet = tmp_path / 'fit.html', tmp_path / 'sheet.csv'
    assert main(['fit', *words_of(campaign), '--hold-out', '350K', '--report', str(page), '--sheet', str(sheet)]) == 0
    out = capsys.readouterr().out
    assert 'plateau stresses of isothermal tests' in out and 'transformation temperatures by tangents' in out
    text = page.read_text()
    for words in ('Transformation temperatures', 'Plateau stresses', 'Phase diagram', 'Stress over strain'):
        assert words in text
    rows = {row['name']: row for row in csv.DictReader(sheet.open())}
    fitted = rows['wire.sigma_T']
    assert float(fitted['low']) < float(fitted['value']) < float(fitted['high'])
    assert fitted['unit'] == 'Pa/K' and fitted['status'] == 'fitted'
    assert rows['wire.rho']['status'] == 'kept' and rows['wire.rho']['low'] == ''
    assert 'beam.E' not in rows


@pytest.mark.parametrize('suffix', ['md', 'yaml'])
def test_sheets_of_other_formats_hold_the_same(campaign, tmp_path, suffix):
    sheet = tmp_path / f'sheet.{suffix}'
    words = ['fit', *words_of(campaign), '--free', 'wire.eps_T', '--sheet', str(sheet)]
    assert main(words) == 0
    text = sheet.read_text()
    assert 'wire.eps_T' in text and 'transformation strain' in text
    if suffix == 'yaml':
        assert yaml.safe_load(text)['wire.eps_T']['status'] == 'fitted'


def test_a_sheet_of_an_unknown_format_is_refused_before_the_fit(campaign, tmp_path, capsys):
    assert main(['fit', *words_of(campaign), '--sheet', str(tmp_path / 'sheet.xls')]) == 2
    assert 'expected a name that ends in .yaml, .csv, .md' in capsys.readouterr().err


def changed_map(campaign, tmp_path, old, new):
    """The map with a mistake."""
    path = tmp_path / 'map.yaml'
    assert old in MAP
    path.write_text(MAP.replace(old, new))
    return read_dataset([campaign / 'pulls'], 'wire', 298.0, path)


def test_mistakes_in_a_campaigns_map_are_named(campaign, tmp_path):
    for old, new, words in (
        ('control: strain,', 'control: force,', 'bench.control: strain or stress'),
        ('bench: {control: strain, temperature: prescribed}', 'bench: fixed', 'expected bench'),
        ('pulls/*.csv', 'pulled/*.csv', 'belongs to none of the tests'),
        ('- files: pulls/*.csv', '- file: pulls/*.csv', 'a list of entries with files'),
        ('strain: {column: strain_percent', 'stain: {column: strain_percent', 'unknown column stain'),
    ):
        with pytest.raises(UserError, match=words):
            changed_map(campaign, tmp_path, old, new)


def test_plateaus_of_a_loop_in_closed_form():
    """Two straight lines and a plateau: 60 GPa up to 300 MPa, flat over 4 %, back on a plateau at 120 MPa."""
    up = np.linspace(0.0, 0.05, 400)
    loading = np.minimum(6e10 * up, 3e8) + np.where(up > 0.045, 3e10 * (up - 0.045), 0.0)
    down = np.linspace(0.05, 0.0, 400)
    unloading = np.minimum(np.maximum(4.5e8 - 6e10 * (0.05 - down), 1.2e8), 6e10 * down)
    strain, stress = np.concatenate([up, down]), np.concatenate([loading, unloading])
    found = isothermal_features('a', np.full(len(strain), 320.0), strain, stress)
    assert found is not None
    assert (found.loading, found.unloading) == pytest.approx((3e8, 1.2e8), rel=0.01)
    assert found.martensite_modulus == pytest.approx(3e10, rel=0.05)
    softer = 3e8 * (1.0 / 3e10 - 1.0 / 6e10)  # of the plateau's strain, elastic
    shown = starting_values(CurveFeatures((), (found,)))
    assert shown['wire.E_M'] == found.martensite_modulus and shown['wire.eps_T'] == pytest.approx(0.04 - softer, abs=0.004)
    within = isothermal_features('b', np.full(len(strain), 320.0), strain, np.minimum(stress, 3e8))
    assert within is not None and np.isnan(within.martensite_modulus)  # the plateau has not ended
    assert found.modulus == pytest.approx(6e10, rel=0.05) and found.plateau_strain == pytest.approx(0.04, abs=0.004)
    assert isothermal_features('elastic', np.full(400, 320.0), up, 6e10 * up) is None
    assert isothermal_features('drifting', np.linspace(320.0, 330.0, 800), strain, stress) is None


def test_a_campaign_starts_from_both_kinds_of_features(campaign):
    dataset = dataset_of(campaign)
    started, features = started_from_curves(dataset, read_config(words=['system=wire', 'wire.dsigma=1e8']))
    assert len(features.isobaric) == 2 and len(features.isothermal) == 2
    for name, within in (('E_A', 0.2), ('eps_T', 0.2), ('sigma_T', 0.1)):
        assert started.parameters[f'wire.{name}'] == pytest.approx(ALLOY[name], rel=within)
    assert started.parameters['wire.dsigma'] == 1e8  # what the user states stays
    assert not CurveFeatures(()) and np.isnan(median_slope([(300.0, 1e8)]))


def test_only_a_wire_has_tests_to_characterize():
    assert not characterization(compare_of_module())


def compare_of_module():
    """A comparison of the module with itself."""
    import sma_sim

    command = sma_sim.module_input([0.0, 2.0, 4.0], [0.0, 10.0, 0.0])
    run = sma_sim.simulate(sma_sim.Model(), command, 4.0)
    recording = sma_sim.Recording('run1', 'module', run.time, {'alpha': run['alpha_rad']}, command)
    return compare(sma_sim.Dataset((recording,), {'alpha': 3.5e-4}), sma_sim.Config(), nuisances=False)


EXAMPLE = Path(__file__).resolve().parents[2] / 'examples' / 'real' / 'isobaric'


def test_measured_transformation_temperatures_rise_with_stress():
    """Of the shipped campaign: every temperature rises with stress, and heating follows cooling."""
    config = read_config(EXAMPLE / 'config.yaml')
    dataset = read_dataset([EXAMPLE / 'nitihf'], config.system, 298.0, EXAMPLE / 'map.yaml')
    tests = started_from_curves(dataset, config)[1].isobaric
    table = np.array([test.temperatures for test in tests])
    assert len(tests) == 6 and (np.diff(table[1:], axis=0) > 0.0).all()
    assert all(test.hysteresis > 5.0 for test in tests)


def test_what_belongs_to_one_bench_is_left_out_on_the_others(campaign, tmp_path):
    """A scale of power, stated for all tests, is fitted where something is heated."""
    path = tmp_path / 'map.yaml'
    path.write_text(MAP + 'nuisances:\n  power_scale: {k: 0.1}\n')
    options = FitOptions(free=('wire.eps_T',), kinetics='hybrid', starts=1, intervals=False)
    for kinds, expected in ((['pulls'], {'wire.eps_T'}), (['blocked'], {'wire.eps_T', 'effects.power_scale.k'})):
        dataset = read_dataset([campaign / kind for kind in kinds], 'wire', 298.0, path)
        found = calibrate(dataset, read_config(words=['system=wire', *GEOMETRY]), options)
        assert set(found.values) == expected


def test_isothermal_tests_are_compared_with_the_model_as_it_is():
    """Only a fit starts from their plateaus: else a comparison would not be of the values that were given."""
    model = Config(system='wire')
    source = wire_input([0.0, 400.0, 800.0], [0.0, 0.06, 0.0], 0.0, 310.0)
    run = simulate(Model(model), source, np.linspace(0.0, 800.0, 401))
    dataset = Dataset((Recording('loop', 'wire', run.time, {'stress': run['stress_Pa']}, source),), {'stress': 1e5})
    assert started_from_curves(dataset, model, is_fitted=False)[0] is model
    started, features = started_from_curves(dataset, model)
    assert features.isothermal and started.parameters['wire.T0'] == pytest.approx(310.0)
