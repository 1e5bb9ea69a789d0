"""Readings that a converter, an encoder or a logger rounds: their mean, their noise, how they are recognised and fitted."""

import csv
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from simulated_data import NOISE, command, config, recording

from sma_sim import FitOptions, Recording, UserError, compare, read_dataset
from sma_sim.evidence.data.recording import CHANNEL_COLUMNS
from sma_sim.evidence.data.rounding import Rounding, grid_of, rounding_of
from sma_sim.evidence.estimation.calibrate import problem_for
from sma_sim.evidence.estimation.problem import linearize, residuals_at
from sma_sim.evidence.estimation.residuals import fit_data, weighted_residuals
from sma_sim.evidence.set_up.faults import Fault

STEP, ORIGIN = 0.08, 0.013


def rounded(values, std, seed=0, step=STEP, origin=ORIGIN):
    noisy = values + std * np.random.default_rng(seed).standard_normal(np.shape(values))
    return step * np.rint((noisy - origin) / step) + origin


def in_motion(seed, rows=5000):
    """A quantity that goes from rest to rest, over tens of steps of a resolution of 0.08."""
    random = np.random.default_rng(seed)
    levels = np.repeat(random.uniform(-4.0, 4.0, 12), -(-rows // 12))[:rows]
    values = np.zeros(rows)
    for k in range(1, rows):
        values[k] = values[k - 1] + (levels[k] - values[k - 1]) / 75.0
    return values


@pytest.mark.parametrize('std', [0.15, 0.25, 0.4])
def test_mean_slope_and_noise_are_those_of_many_readings(std):
    known = Rounding(STEP, ORIGIN, std * STEP)
    values = np.linspace(0.0, STEP, 9)
    shown = np.array([rounded(np.full(400_000, one), known.std, k) for k, one in enumerate(values)])
    np.testing.assert_allclose(shown.mean(axis=1), known.expected(values), atol=4.0 * STEP * 0.5 / np.sqrt(400_000))
    there = np.random.default_rng(1).uniform(0.0, 50.0 * STEP, 400_000)
    assert np.std(rounded(there, known.std) - known.expected(there)) == pytest.approx(known.noise_std, rel=5e-3)
    delta = 1e-6 * STEP
    slopes = (known.expected(values + delta) - known.expected(values - delta)) / (2.0 * delta)
    np.testing.assert_allclose(known.slope(values), slopes, rtol=1e-6)


def test_noise_far_above_the_step_leaves_nothing_of_the_rounding():
    known, values = Rounding(STEP, ORIGIN, STEP), np.linspace(0.0, 1.0, 50)
    np.testing.assert_allclose(known.expected(values), values, atol=1e-9)
    assert known.noise_std == pytest.approx(STEP * np.sqrt(1.0 + 1.0 / 12.0))


@pytest.mark.parametrize('std', [0.25, 0.3, 0.45])
def test_step_origin_and_noise_are_told_from_readings(std):
    found = rounding_of([rounded(in_motion(seed), std * STEP, seed) for seed in range(3)])
    assert found is not None and found.step == pytest.approx(STEP, rel=1e-9)
    assert abs((found.origin - ORIGIN + STEP / 2.0) % STEP - STEP / 2.0) < 1e-9
    assert found.std == pytest.approx(std * STEP, rel=0.06)


def test_what_is_smooth_a_staircase_or_on_no_grid_is_not_rounded():
    noisy = in_motion(0) + 0.02 * np.random.default_rng(0).standard_normal(5000)
    assert rounding_of([noisy]) is None
    assert rounding_of([rounded(in_motion(0), 0.03 * STEP)]) is None  # its rows repeat a value
    assert rounding_of([rounded(in_motion(0), 2.0 * STEP)]) is None
    assert rounding_of([np.sinh(rounded(in_motion(0), 0.25 * STEP))]) is None
    assert rounding_of([np.full(100, np.nan)]) is None and rounding_of([]) is None
    assert grid_of(np.array([1.0, 1.0, 1.0, 1.0])) is None


def test_what_no_rounding_is_is_refused():
    with pytest.raises(UserError, match='expected a step above 0'):
        Rounding(0.0, 0.0, 1.0)
    run = recording(config(), command(1))
    with pytest.raises(UserError, match="no channel 'T_1' was measured"):
        Recording('a', 'module', run.time, run.channels, run.source, rounding={'T_1': Rounding(1.0, 0.0, 0.2)})


def test_a_sign_a_unit_and_an_exchange_are_those_of_the_rounding_too():
    first, second = Rounding(STEP, ORIGIN, 0.02), Rounding(0.2, 0.1, 0.05)
    turned = Fault('sign', ('F_1',)).in_rounding({'F_1': first, 'F_2': second})
    values = np.linspace(-1.0, 1.0, 30)
    np.testing.assert_allclose(turned['F_1'].expected(-values), -first.expected(values))
    assert turned['F_2'] == second
    scaled = Fault('unit', ('F_1',), factor=1000.0).in_rounding({'F_1': first})
    np.testing.assert_allclose(scaled['F_1'].expected(1000.0 * values), 1000.0 * first.expected(values))
    assert Fault('swap', ('F_1', 'F_2')).in_rounding({'F_1': first}) == {'F_2': first}
    assert Fault('outliers', ('F_1',)).in_rounding({'F_1': first}) == {'F_1': first}


@pytest.fixture(scope='module')
def dataset(tmp_path_factory):
    """Runs of a robot whose pose and forces are written with steps of four times their noise."""
    folder = tmp_path_factory.mktemp('rounded')
    for seed in (1, 2, 3):
        run = recording(config(), command(seed), noise=1.0, seed=seed)
        held = np.searchsorted(run.source.times, run.time, side='right') - 1
        names = [CHANNEL_COLUMNS[name] for name in run.channels]
        shown = [4.0 * NOISE[name] * np.rint(values / (4.0 * NOISE[name])) for name, values in run.channels.items()]
        with (folder / f'run{seed}.csv').open('w', newline='') as file:
            rows = csv.writer(file)
            rows.writerow(['time_s', 'J_eq_W', *names])
            rows.writerows(zip(run.time, run.source.values[held, 0], *shown, strict=True))
    return read_dataset(folder)


def test_files_of_a_logger_that_rounds_keep_their_rows_and_say_so(dataset):
    for run in dataset.recordings:
        assert all(np.isfinite(values).all() for values in run.channels.values())
        for name, found in run.rounding.items():
            assert found.step == pytest.approx(4.0 * NOISE[name], rel=1e-6)
            assert found.std == pytest.approx(NOISE[name], rel=0.12)
            assert dataset.noise_std[name] == pytest.approx(found.noise_std)
            assert dataset.resolution[name] == found.step
    assert dataset.recordings[0].rounding.keys() == dataset.channels
    assert any('which fits allow for' in note for note in dataset.notes)


def test_the_model_that_made_them_leaves_what_noise_leaves(dataset):
    """Over stretches of a second, whose errors of rounding are alike, too: a mean of n rows leaves 1/sqrt(n)."""
    exact = [replace(run, source=command(seed)) for seed, run in enumerate(dataset.recordings, 1)]
    runs = [fit_data(run, dataset.noise_std) for run in exact]
    left = np.concatenate([weighted_residuals(config(), run) for run in runs], axis=1)
    rate = round(1.0 / float(np.median(np.diff(runs[0].time))))
    means = left[:, : left.shape[1] // rate * rate].reshape(len(left), -1, rate).mean(axis=2) * np.sqrt(rate)
    assert np.mean(means**2) == pytest.approx(1.0, abs=0.15) and np.mean(left**2) == pytest.approx(1.0, abs=0.1)
    assert all(
        error == pytest.approx(1.0, abs=0.1)
        for error in compare(replace(dataset, recordings=exact), config()).errors.values()
    )


def test_tangents_are_those_of_readings(dataset):
    pool = ThreadPoolExecutor(1)
    problem = problem_for(dataset, config(), FitOptions(free=('beam.E', 'wire.E_A'), kinetics='hybrid'), 1)
    z = np.zeros(len(problem.unknowns))
    linear = linearize(problem, z, pool)
    step = np.zeros(len(z))
    step[0] = 1e-5
    above, below = residuals_at(problem, z + step, pool), residuals_at(problem, z - step, pool)
    for run, up, down in zip(linear, above, below, strict=True):
        slope = (up - down) / (2.0 * step[0])
        scale = np.abs(slope).max()
        np.testing.assert_allclose(run.jacobian[0], slope, atol=2e-3 * scale)
