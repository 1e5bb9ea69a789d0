"""Tests of many cycles in one file: cycles are found, evaluated one by one, and their drift is told and fitted."""

from threading import Event

import numpy as np
import pytest
from isobaric_runs import BENCH
from test_curve_features import COLD, COOLING, HEATING, HOT, way

from sma_sim import FitOptions, Input, Model, Recording, calibrate, compare, read_config, read_dataset, simulate
from sma_sim.evidence.data.quasi_static import FIRST_CYCLES, cycles, first_cycles, turning_rows
from sma_sim.evidence.estimation.calibrate import multistart_search
from sma_sim.evidence.estimation.curve_features import isobaric_features
from sma_sim.evidence.estimation.executors import executor_or_threads
from sma_sim.evidence.estimation.prepared_fit import prepare
from sma_sim.evidence.estimation.residuals import Nuisance, fit_data, weighted_residuals
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.model_selection.score_tests import ScoreTests
from sma_sim.evidence.residual_analysis.wire_tests import characterization
from sma_sim.evidence.search import propose
from sma_sim.evidence.search.components import catalogue_for
from sma_sim.report.html.characterization import characterization_section
from sma_sim.report.html.page import Grid, Table
from sma_sim.words.wire_tests import characterization_data, shown_cycles
from sma_sim.words.wire_tests import tests_as_text as as_text

COUNT, DRIFT, RATCHET = 12, -0.5, 1e-4  # cycles; what each moves the transformation by [K] and leaves behind


def drifting_cycles(rows=400):
    """Cycles of straight lines, each beginning with cooling."""
    down = np.linspace(HOT, COLD, rows)
    T, strain = [], []
    for k in range(COUNT):
        for ends, points in ((COOLING, down), (HEATING, down[::-1])):
            T.append(points)
            strain.append(way(*(end + k * DRIFT for end in ends), points) + k * RATCHET)
    return np.concatenate(T), np.concatenate(strain)


def test_each_cycle_is_evaluated_and_the_drift_is_told():
    T, strain = drifting_cycles()
    found = isobaric_features('whole', np.full(len(T), 2e8), T, strain)
    assert found is not None and len(found.cycles) == COUNT
    for k, one in enumerate(found.cycles):
        assert one.temperatures == pytest.approx(np.array([*COOLING, *HEATING]) + k * DRIFT, abs=0.5)
        assert one.recovered == pytest.approx(0.03, abs=1e-4) and not one.cycles
    rise = found.cycles[-1].hottest_strain - found.cycles[0].hottest_strain
    assert rise == pytest.approx((COUNT - 1) * (RATCHET + 1e-5 * DRIFT), abs=2e-5)
    assert found.temperatures == found.cycles[COUNT // 2].temperatures
    *_, last, words = as_text([found])
    assert last.startswith('whole 12 ') and words.startswith('whole: 12 cycles, from the first to the last M_f -5.')
    assert shown_cycles(100) == [0, 1, 4, 9, 19, 49, 99] and shown_cycles(3) == [0, 1, 2] and shown_cycles(1) == [0]


def test_inner_loops_holds_and_halves_are_no_cycles():
    T = np.concatenate(
        [
            np.linspace(300, 400, 101),
            np.linspace(400, 380, 21),
            np.linspace(380, 400, 21),
            np.full(30, 400.0),
            np.linspace(400, 300, 101),
            np.linspace(300, 360, 61),
        ]
    )
    rows = turning_rows(T)
    assert T[rows].tolist() == [300.0, 400.0, 300.0, 360.0]
    (heating, cooling), *rest = cycles(T, np.arange(float(len(T))))
    assert not rest and heating[1][0] == 0.0 and heating[1][-1] == cooling[1][0] and cooling[0][-1] == 300.0
    assert turning_rows(np.full(5, 1.0)) == [0] and turning_rows(np.empty(0)) == [] and cycles(T[:101], T[:101]) == []


def many_cycles(hottest, stress=2e8, system='wire_under_load_at_T', J=0.0):
    """A test whose cycles go up to the `hottest` temperatures [K], one after the other, under a stress [Pa] (each)."""
    T = np.concatenate([[300.0], *(np.linspace([310.0, hot - 10.0], [hot, 300.0], 10).T.ravel() for hot in hottest)])
    time, structure = np.arange(len(T)) * 20.0, read_config(words=['system=' + system]).structure
    drives = [np.broadcast_to(stress, T.shape), T] if structure.is_quasi_static else [np.broadcast_to(stress, T.shape)]
    columns = np.column_stack([*drives, np.full(len(T), J) * (time > time[-2]), np.full(len(T), 298.0)])
    source = Input(time, columns, (*[True] * len(drives), False, False), structure.input_columns)
    return Recording('whole', structure.name, time, {'strain': 1e-4 * T}, source, sample_std={'strain': 1e-5 * T})


def test_a_search_takes_the_first_of_many_cycles_that_repeat():
    first = first_cycles(many_cycles([400.0] * 98))
    assert len(cycles(first.source.values[:, 1], first.time)) == FIRST_CYCLES
    assert first.source.times[-1] == first.time[-1] and len(first.sample_std['strain']) == len(first.time)
    assert first.channels['strain'] == pytest.approx(1e-4 * first.source.values[:, 1])
    growing = first_cycles(many_cycles([400.0] * 40 + [450.0] + [440.0] * 40))
    assert len(cycles(growing.source.values[:, 1], growing.time)) == 41 and growing.source.values[:, 1].max() == 450.0


@pytest.mark.parametrize(
    'other',
    [
        many_cycles([400.0] * FIRST_CYCLES),
        many_cycles([400.0] * 40, np.repeat([1e8, 2e8], [401, 400])),  # two levels, each of many cycles
        many_cycles([400.0] * 40, J=0.1),
        many_cycles([400.0] * 40, system='wire_under_load'),
    ],
    ids=['few', 'levels', 'heated', 'in air'],
)
def test_other_tests_are_searched_whole(other):
    assert first_cycles(other) is other


FATIGUE = {'eps_r': 3e-3, 'sigma_r': 4e7, 'z_r': 10.0}
EFFECTS = ('smooth_transformation', 'functional_fatigue')


def fatiguing_wire(folder, rows, noise, seed, fatigue=FATIGUE):
    """A wire that fatigues."""
    effects = [EFFECTS[0], f'{EFFECTS[1]}:' + ','.join(f'{k}={v}' for k, v in fatigue.items())]
    return cycled_wire(folder, effects, rows, noise, seed)


def cycled_wire(folder, effects, rows, noise, seed, count=COUNT):
    """A wire, cycles of so many rows each way in one file whose thermometer has a noise [K]; time was not noted."""
    truth = read_config(words=[*BENCH, 'wire.T0=385', 'wire.sigma_MW0=2e8'], effects=effects)
    random = np.random.default_rng(seed)
    down = np.linspace(560.0, 310.0, rows)
    T = np.concatenate([np.concatenate([down, down[::-1]]) for _ in range(count)])
    times = np.concatenate([[0.0], np.cumsum(np.maximum(np.abs(np.diff(T)) / 0.5, 1e-3))])
    values = np.column_stack([np.full(len(T), 2e8), T, 0.0 * T, np.full(len(T), 298.0)])
    structure = truth.structure
    source = Input(times, values, (True, True, False, False), structure.input_columns)
    strain = simulate(Model(truth), source, times)['strain']
    columns = np.column_stack([T - 273.15 + noise * random.normal(size=len(T)), strain + 3e-5 * random.normal(size=len(T))])
    np.savetxt(folder / 'whole.csv', columns, delimiter=',', header='T_C,strain', comments='')
    (folder / 'map.yaml').write_text(
        'system: wire\ntime_s: {path: T_C, rate: 0.5}\nT_K: {column: T_C, offset: 273.15}\nstrain: strain\n'
        'stress_Pa: {value: 2.0e+8}\n'
    )
    return truth, read_dataset([folder / 'whole.csv'], structure.name, mapping=folder / 'map.yaml')


@pytest.fixture(scope='module')
def whole_file(tmp_path_factory):
    """A file with many rows, so that the noise of the thermometer can be taken out."""
    truth, dataset = fatiguing_wire(tmp_path_factory.mktemp('cycles'), 120, 3.0, 4)
    return truth, FATIGUE, dataset


def root_mean_square(values):
    return float(np.sqrt(np.mean(values**2)))


def test_rows_of_few_are_as_uncertain_as_they_are_steep(tmp_path):
    """The noise of the thermometer is too fast to be taken out: it shows where the wire transforms, and nowhere else."""
    truth, dataset = fatiguing_wire(tmp_path, 40, 2.0, 11)
    (recording,) = dataset.recordings
    assert recording.imposed_std['T_K'] == pytest.approx(2.0, rel=0.15)
    run = fit_data(recording, dataset.noise_std)
    (residuals,) = weighted_residuals(truth, run, Nuisance(unknown_zero=True))
    strain = recording.channels['strain']
    part = (strain - strain.min()) / np.ptp(strain)
    steep = (part > 0.3) & (part < 0.7)
    assert root_mean_square(residuals[steep]) < 2.0 and root_mean_square(residuals[~steep]) < 1.0


@pytest.mark.parametrize('seed', [1, 2, 3])
@pytest.mark.parametrize('spread', [1e7, 3e7])
def test_rows_of_a_narrow_branch_are_as_uncertain_as_the_thermometer_leaves_them(tmp_path, seed, spread):
    """Grains of a polycrystal that transform within about as few kelvin as the rows are apart: a row before the
    branch may lie on it."""
    truth, dataset = cycled_wire(tmp_path, [f'polycrystal:spread={spread}'], 80, 1.0, seed)
    (recording,) = dataset.recordings
    (residuals,) = weighted_residuals(truth, fit_data(recording, dataset.noise_std), Nuisance(unknown_zero=True))
    std = recording.sample_std['strain']
    assert np.abs(residuals).max() < 6.0
    assert 0.5 < root_mean_square(residuals[std > 2.0 * std.min()]) < 1.3


@pytest.mark.parametrize('spread', [2e7, 6e7, 1.2e8])
def test_rows_of_one_cycle_are_no_more_certain_than_thermocouples_where_they_are_steep(tmp_path, spread):
    """Too few rows go back to tell the noise of the thermometer, 1 K."""
    truth, dataset = cycled_wire(tmp_path, [f'polycrystal:spread={spread}'], 66, 1.0, 5, count=1)
    (recording,) = dataset.recordings
    assert 'T_K' not in recording.imposed_std
    (residuals,) = weighted_residuals(truth, fit_data(recording, dataset.noise_std), Nuisance(unknown_zero=True))
    assert np.abs(residuals).max() < 6.0


@pytest.mark.parametrize('seed', [11, 12])
def test_noise_of_a_thermometer_in_sparse_rows_is_no_effect(tmp_path, seed):
    """Beside the true effects others promised a hundred nats, a peak of nucleation among them, by what the noise left where
    the wire transforms."""
    truth, dataset = fatiguing_wire(tmp_path, 40, 2.0, seed, {'eps_r': 2e-3, 'sigma_r': 4e7, 'z_r': 20.0})
    with executor_or_threads(None) as pool:
        context = SearchContext(pool, Event(), lambda line: None)
        fit = multistart_search(prepare(dataset, truth, 'hybrid'), FitOptions(starts=1), context)
        promised = propose.listed(ScoreTests(fit.problem, fit.z, context.pool), catalogue_for(fit, context), set(EFFECTS))
    assert fit.values_of('functional_fatigue')['eps_r'] == pytest.approx(2e-3, rel=0.15)
    assert max((one.promise for one in promised), default=0.0) < 5.0


def test_fatigue_over_the_cycles_is_fitted(whole_file):
    """Known with sigma_T only is by how much the plateaus sink: at one stress temperature and stress are one."""
    truth, fatigue, dataset = whole_file
    start = read_config(words=[*BENCH[:4], 'wire.T0=385', 'wire.sigma_MW0=2e8', 'wire.sigma_T=8e6'], effects=EFFECTS)
    found = calibrate(dataset, start, FitOptions(starts=1))
    values = dict(zip(fatigue, found.config.effects[1].values, strict=True))
    assert found.error < 1.3 and values['eps_r'] == pytest.approx(fatigue['eps_r'], rel=0.1)
    sunk = values['sigma_r'] / found.config.parameters['wire.sigma_T']
    assert sunk == pytest.approx(fatigue['sigma_r'] / truth.parameters['wire.sigma_T'], rel=0.3)


def test_report_shows_cycles_measured_and_of_the_model(whole_file):
    truth, fatigue, dataset = whole_file
    tests = characterization(compare(dataset, truth))
    (one,) = tests.isobaric
    assert len(one.measured.cycles) == len(one.model.cycles) == COUNT
    for measured, model in zip(one.measured.cycles, one.model.cycles, strict=True):
        assert measured.temperatures == pytest.approx(model.temperatures, abs=4.0)
    assert len(characterization_data(tests)['isobaric']['whole']['measured']['cycles']) == COUNT
    section = characterization_section(tests, truth)
    (table,) = [block for block in section.blocks if isinstance(block, Table) and block.caption == 'Cycles of whole']
    assert [row[0] for row in table.rows] == ['1', '2', '5', '10', '12', 'drift']
    assert float(table.rows[-1][5]) == pytest.approx(100.0 * fatigue['eps_r'] * (1.0 - np.exp(-2.4)), abs=0.1)
    captions = [plot.caption for block in section.blocks if isinstance(block, Grid) for plot in block.plots]
    assert sum(caption.startswith('whole: ') for caption in captions) == 2
