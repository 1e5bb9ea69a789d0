"""The estimate of the noise of a channel: exact enough under dynamics, steps, outliers, held and quantised samples."""

import json
from pathlib import Path

import numpy as np
import pytest
from made_recordings import NOISE, module_columns, write_recording

from sma_sim import module_input, simulate
from sma_sim.evidence.data.noise import estimate_noise
from sma_sim.evidence.data.recording import CHANNEL_COLUMNS
from sma_sim.evidence.data.recordings import read_dataset, read_recording
from sma_sim.solver.model import Model
from sma_sim.words.repair_notes import grouped_notes

MEASURED = Path(__file__).resolve().parents[3] / 'shared' / 'measured' / 'module'
STD = NOISE | {'alpha_rad': np.radians(0.02)}


@pytest.fixture(scope='module')
def run():
    """A simulated run of 100 s at 50 Hz with steps of the command."""
    source = module_input([0.0, 5.0, 25.0, 27.313, 31.0, 45.0, 65.007, 100.0], [0.0, 12.0, 0.0, -9.0, 14.0, -14.0, 3.0, 0.0])
    trajectory = simulate(Model(), source, 50.0)
    return trajectory.time, trajectory.columns


@pytest.mark.parametrize('name', list(STD))
def test_white_noise_on_a_simulated_run(run, name):
    time, columns = run
    for seed in range(8):
        noisy = columns[name] + STD[name] * np.random.default_rng(seed).normal(size=len(time))
        assert estimate_noise(time, noisy).std == pytest.approx(STD[name], rel=0.1)


def test_no_bias(run):
    """Over all channels and seeds the mean is within 1 %: dynamics do not add to it."""
    time, columns = run
    ratios = [
        estimate_noise(time, columns[name] + std * np.random.default_rng([seed, k]).normal(size=len(time))).std / std
        for k, (name, std) in enumerate(STD.items())
        for seed in range(20)
    ]
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.01)


def test_noise_free_run_shows_next_to_none(run):
    time, columns = run
    for name, std in STD.items():
        assert estimate_noise(time, columns[name]).std < 1e-3 * std


def test_outliers_gaps_and_missing_cells_do_not_count(run):
    time, columns = run
    random = np.random.default_rng(3)
    noisy = columns['alpha_rad'] + 3.5e-4 * random.normal(size=len(time))
    noisy[random.integers(0, len(time), 100)] += 1.0
    noisy[random.integers(0, len(time), 200)] = np.nan
    keep = np.ones(len(time), dtype=bool)
    keep[1000:2000] = False
    assert estimate_noise(time[keep], noisy[keep]).std == pytest.approx(3.5e-4, rel=0.1)


@pytest.mark.parametrize('step', [0.1, 0.5, 1.0])
def test_quantised(step):
    """Rounding adds step^2/12 to the variance."""
    time = np.arange(5000) / 50.0
    exact = 20.0 * np.sin(time)
    values = np.round((exact + np.random.default_rng(1).normal(size=5000)) / step) * step
    noise = estimate_noise(time, values)
    assert noise.std == pytest.approx(np.sqrt(1.0 + step**2 / 12.0), rel=0.1)
    assert noise.step == pytest.approx(step) and not noise.quantised


def test_resolution_dominates():
    time = np.arange(5000) / 50.0
    values = np.round((300.0 + 5.0 * np.sin(0.1 * time) + 0.02 * np.random.default_rng(1).normal(size=5000)) / 0.5) * 0.5
    noise = estimate_noise(time, values)
    assert noise.quantised and noise.step == pytest.approx(0.5) and noise.std == pytest.approx(0.5 / np.sqrt(12.0), rel=0.15)


@pytest.mark.parametrize('times', [2, 3, 5])
def test_held_samples(times):
    """A sensor slower than the recording repeats its values; the noise is that of the values."""
    time = np.arange(6000) / 50.0
    slow = 20.0 * np.sin(0.5 * time[::times]) + np.random.default_rng(2).normal(size=len(time[::times]))
    noise = estimate_noise(time, np.repeat(slow, times)[:6000])
    assert noise.held and noise.std == pytest.approx(1.0, rel=0.1)


def test_too_few_samples():
    assert estimate_noise(np.arange(10.0), np.arange(10.0)) is None


def test_long_records_are_looked_at_in_places():
    time = np.arange(1_000_000) / 50.0
    assert estimate_noise(time, np.random.default_rng(0).normal(size=len(time))).std == pytest.approx(1.0, rel=0.02)


def test_dataset_estimates_and_says_so(tmp_path):
    for k in range(3):
        write_recording(tmp_path / f'run{k}.csv', module_columns(1500, k))
    dataset = read_dataset([tmp_path], 'module', 298.0)
    for channel in ('U_x', 'U_y', 'alpha', 'F_1', 'F_2', 'T_1', 'T_2'):
        assert dataset.noise_std[channel] == pytest.approx(NOISE[CHANNEL_COLUMNS[channel]], rel=0.1)
        assert any(note.startswith(f'noise of {channel}: ') and 'estimated' in note for note in dataset.notes)
    assert set(dataset.notes) <= set(grouped_notes([dataset]))


def test_who_overrides_whom(tmp_path):
    """The argument before meta.json before the estimate; the case of the names does not matter."""
    write_recording(tmp_path / 'run.csv', module_columns())
    (tmp_path / 'meta.json').write_text(json.dumps({'noise_std': {'f_1': 0.5, 'ALPHA': 0.01}}))
    dataset = read_dataset([tmp_path], 'module', 298.0, noise_std={'alpha': 0.02})
    assert dataset.noise_std['F_1'] == 0.5 and dataset.noise_std['alpha'] == 0.02
    assert dataset.noise_std['F_2'] == pytest.approx(0.05, rel=0.3)


def test_folders_that_differ(tmp_path):
    for name, std in (('a', 3.0), ('b', 4.0)):
        (tmp_path / name).mkdir()
        write_recording(tmp_path / name / 'run.csv', module_columns(600, int(std)))
        (tmp_path / name / 'meta.json').write_text(json.dumps({'noise_std': {'F_1': std}}))
    dataset = read_dataset([tmp_path / 'a', tmp_path / 'b'], 'module', 298.0)
    assert dataset.noise_std['F_1'] == pytest.approx(np.sqrt(12.5))
    assert any('F_1: its root mean square' in note for note in dataset.notes)
    assert [recording.name for recording in dataset.recordings] == ['a/run', 'b/run']


@pytest.mark.parametrize(('noise', 'expected'), [(0.02, 0.29), (0.3, 0.42)])
def test_noise_below_a_coarse_resolution_shows_where_the_signal_moves_fast(noise, expected):
    """In steps of the resolution: rounding alone, 1/sqrt(12), or with noise that rests hide."""
    time = np.arange(0.0, 100.0, 0.05)
    signal = np.where(time % 20.0 < 10.0, 60.0 * np.sin(0.6 * (time % 10.0)), 0.2)
    found = estimate_noise(time, np.round(signal + noise * np.random.default_rng(3).normal(size=len(time))))
    assert found.step == 1.0 and found.quantised and found.std == pytest.approx(expected, rel=0.15)


def test_readings_that_a_logger_takes_twice_now_and_then_are_old():
    """A sensor at 45 Hz in a log at 50 Hz; not what chance makes equal, nor what is equal at rest without noise."""
    random, time = np.random.default_rng(5), np.arange(0.0, 60.0, 0.02)
    values = np.sin(time) + 0.01 * random.normal(size=len(time))
    old = values[np.floor(np.arange(len(time)) * 0.9 + 0.05).astype(int)]
    assert (found := estimate_noise(time, old)).held and found.std == pytest.approx(0.01, rel=0.1)
    assert not estimate_noise(time, np.round(values, 3)).held
    assert not estimate_noise(time, np.where(time % 20.0 < 10.0, np.sin(time), 0.5)).held


def test_invisible_and_unknown_noise(tmp_path):
    columns = module_columns(noise=False) | {'F_2_N': np.full(600, 7.0)}
    dataset = read_dataset([write_recording(tmp_path / 'run.csv', columns)], 'module', 298.0)
    span = np.ptp(columns['alpha_rad'])
    assert dataset.noise_std['alpha'] == pytest.approx(1e-4 * span, rel=1e-6)
    assert dataset.noise_std['F_2'] == 0.01
    assert any('F_2: 0.01 N assumed' in note for note in dataset.notes)
    assert 'F_2' not in dataset.channels  # how far its only value is from the force nobody knows
    assert any('F_2 never changes and is left out' in note for note in dataset.notes)
    stated = read_dataset([tmp_path / 'run.csv'], 'module', 298.0, noise_std={'F_2': 0.02})
    assert 'F_2' in stated.channels and not any('never changes' in note for note in stated.notes)


@pytest.mark.skipif(not MEASURED.is_dir(), reason='no measured data here')
@pytest.mark.parametrize('case', ['e91', 'e92', 'e93'])
def test_against_the_stated_noise(case):
    stated = json.loads((MEASURED / case / 'meta.json').read_text())['noise_std']
    for number in (1, 2, 3):
        (recording,) = read_recording(MEASURED / case / f'run{number}.csv', 'module', 298.0)
        for name, std in stated.items():
            channel = name.replace('f_', 'F_')
            assert estimate_noise(recording.time, recording.channels[channel]).std == pytest.approx(std, rel=0.1)
