"""What was imposed is taken without the noise of its sensor, a load cell or a thermocouple."""

import numpy as np
import pytest
from isobaric_runs import BENCH, isobaric_tests

from sma_sim import read_config, read_dataset
from sma_sim.evidence.data.imposed import without_noise
from sma_sim.evidence.estimation.curve_features import isobaric_tests as evaluated

ROWS = 1200


def zigzag():
    """A temperature [K] that goes up and down twice."""
    return 300.0 + 100.0 * (1.0 - np.abs(np.linspace(0.0, 4.0, ROWS) % 2.0 - 1.0))


def test_a_level_that_varies_by_noise_is_constant():
    given = 1e8 + 3e6 * np.random.default_rng(0).normal(size=ROWS)
    given[5] = np.nan
    level, noise, error, _ = without_noise(given)
    assert np.isnan(level[5]) and np.nanmax(level) == np.nanmin(level) == pytest.approx(np.nanmean(given))
    assert noise == pytest.approx(3e6, rel=0.1) and error == pytest.approx(noise / np.sqrt(ROWS - 1))


@pytest.mark.parametrize('std', [1.0, 4.0])
def test_ramps_keep_their_turns_and_lose_the_noise(std):
    found, noise, error, _ = without_noise(zigzag() + std * np.random.default_rng(1).normal(size=ROWS))
    assert noise == pytest.approx(std, rel=0.1)
    assert np.sqrt(np.mean((found - zigzag()) ** 2)) < min(0.3 * std, 3.0 * error)


def test_a_step_of_a_load_is_no_noise():
    step = np.where(np.arange(ROWS) < 500, 1e8, 1.5e8)
    found, *_ = without_noise(step + 3e6 * np.random.default_rng(2).normal(size=ROWS))
    assert np.sqrt(np.mean((found - step) ** 2)) < 3e6 and np.abs((found - step)[600:]).max() < 1e6


@pytest.mark.parametrize(
    'given', [zigzag(), zigzag()[::40] + np.tile([0.0, 1.0], ROWS // 80), np.full(ROWS, 5.0), np.arange(3.0)]
)
def test_what_seldom_turns_back_stays_as_it_is(given):
    found, noise, *_ = without_noise(given)
    assert (found == given).all() and noise == 0.0


def legs(start, *ways):
    """Temperatures [K] of ways with so many rows to so many kelvin each."""
    values = [start]
    for rows, end in ways:
        values += np.linspace(values[-1], end, rows + 1)[1:].tolist()
    return np.array(values)


@pytest.mark.parametrize('rows', [2, 3, 5, 8, 12])
@pytest.mark.parametrize('std', [0.3, 2.0])
def test_a_fast_cooling_of_few_rows_is_no_noise(rows, std):
    """After a slow heating, between holds, there and back, and in cycles; and the slow rows lose their noise as before."""
    coolings = (
        legs(300.0, (300, 400.0), (rows, 300.0)),
        legs(400.0, (200, 400.0), (rows, 300.0), (200, 300.0)),
        legs(400.0, (150, 400.0), (rows, 340.0), (rows, 400.0), (150, 400.0)),
        legs(300.0, *[(100, 400.0), (rows, 300.0), (100, 300.0)] * 3),
    )
    for seed, truth in enumerate(coolings):
        found, noise, _, _ = without_noise(truth + std * np.random.default_rng(seed).normal(size=len(truth)))
        assert np.abs(found - truth).max() < 10.0 * std
        assert noise == pytest.approx(std, rel=0.3)
        slow = np.append(np.abs(np.diff(truth)) <= 1.0, False)
        assert np.sqrt(np.mean((found - truth)[slow] ** 2)) < 0.7 * std


@pytest.mark.parametrize('sparse', [legs(300.0, *[(6, 400.0), (4, 300.0)] * 5), legs(300.0, (12, 400.0), (8, 300.0))])
def test_a_sparse_test_is_taken_as_measured(sparse):
    given = sparse + np.random.default_rng(0).normal(size=len(sparse))
    assert (without_noise(given).values == given).all()


@pytest.mark.parametrize('rows', [30, 40, 60])
@pytest.mark.parametrize('std', [0.5, 1.0, 2.0])
def test_noise_below_the_steps_is_known_though_it_stays(rows, std):
    """By how many steps go back; none where they only differ, or where it is a motion that turns."""
    truth = legs(300.0, *[(rows, 500.0), (rows, 300.0)] * 12)
    given = truth + std * np.random.default_rng(rows).normal(size=len(truth))
    found = without_noise(given)
    assert (found.values == given).all() and found.noise == 0.0
    assert found.error == pytest.approx(std, rel=0.2)
    uneven = np.concatenate([[300.0], 300.0 + np.cumsum(np.random.default_rng(0).uniform(1.0, 5.0, 60))])
    for exact in (truth, uneven, np.concatenate([uneven, uneven[::-1]])):
        assert without_noise(exact).error < 1e-9


def test_noise_that_differs_along_a_test_is_noise():
    """Of an infrared thermometer, which is worse where it is warm; and rare spikes of one row are no motion."""
    truth, random = zigzag(), np.random.default_rng(4)
    noise = np.where(truth > 350.0, 2.0, 0.5) * random.normal(size=ROWS)
    assert np.sqrt(np.mean((without_noise(truth + noise).values - truth) ** 2)) < 0.3
    spiked = 1e8 + 1e6 * random.normal(size=ROWS)
    spiked[[100, 500]] += 9e6
    level = without_noise(spiked)
    assert np.ptp(level.values) == 0.0 and level.single == (100, 500)


def test_a_file_with_a_fast_cooling(tmp_path):
    """Neither is the cooling smoothed away, nor a single row taken as noise in silence."""
    truth, random = legs(300.0, (300, 400.0), (5, 300.0), (300, 300.0)), np.random.default_rng(5)
    time, T = np.arange(len(truth)), truth + 0.5 * random.normal(size=len(truth))
    T[450] += 4.0
    columns = np.column_stack([time, T, np.full(len(T), 1e8), 1e-2 + 1e-5 * random.normal(size=len(T))])
    np.savetxt(tmp_path / 'run.csv', columns, delimiter=',', header='time_s,T_K,stress_Pa,strain', comments='')
    (run,) = read_dataset([tmp_path], read_config(words=BENCH).structure.name).recordings
    assert np.abs(run.source.values[:, 1] - truth).max() < 4.0
    (note,) = (note for note in run.notes if 'single rows' in note)
    assert note.startswith('T_K: ') and 'at 450 s' in note and 'record several rows' in note


def test_a_noisy_load_cell_changes_nothing_of_isobaric_tests(tmp_path):
    """Load cell +-3 MPa: the same temperatures by tangents, the same load for the model, and a note."""
    truth, random = read_config(words=BENCH), np.random.default_rng(3)
    given = isobaric_tests(truth, (1e8, 2e8))
    for run, stress in zip(given.recordings, (1e8, 2e8), strict=True):
        T = np.interp(run.time, run.source.times, run.source.values[:, 1])
        columns = np.column_stack([run.time, T, stress + 3e6 * random.normal(size=len(T)), run.channels['strain']])
        np.savetxt(tmp_path / f'{run.name}.csv', columns, delimiter=',', header='time_s,T_K,stress_Pa,strain', comments='')
    dataset = read_dataset([tmp_path], truth.structure.name)
    for run in dataset.recordings:
        assert any('which the wire has not felt: taken as constant' in note for note in run.notes)
        assert np.ptp(run.source.values[:, 0]) == 0.0
    for measured, known in zip(evaluated(dataset), evaluated(given), strict=True):
        assert measured.stress == pytest.approx(known.stress, rel=0.01)
        assert measured.temperatures == pytest.approx(known.temperatures, abs=0.1)
