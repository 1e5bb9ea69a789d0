"""Values that a coarse or slow sensor repeats are one measurement."""

import numpy as np
import pytest

from sma_sim import Dataset, FitOptions, Recording, calibrate, read_config, read_dataset, wire_input
from sma_sim.evidence.data.noise import noise_by_channel
from sma_sim.evidence.data.repeated_values import without_repeated_values
from sma_sim.evidence.estimation.residuals import fit_data

STEP = 0.25
WARMING = wire_input([0.0, 70.0], [0.0, 0.0], [1.0, 1.0])


def slow_warming(seed=0):
    """A temperature [K] that rises by 7 K in 70 s, sampled at 50 Hz, and where it is measured."""
    time = np.arange(0.0, 70.0, 0.02)
    return time, 302.0 + 7.0 * (1.0 - np.exp(-time / 25.0)) + 0.02 * np.random.default_rng(seed).normal(size=len(time))


def thinned(dataset):
    return without_repeated_values(dataset, noise_by_channel(dataset.recordings))


def dataset_of(time, T, noise=0.07):
    recording = Recording('a', 'wire', time, {'T': T}, WARMING)
    return Dataset((recording,), {'T': noise})


def test_of_a_coarse_resolution_the_middle_of_each_step_counts():
    time, T = slow_warming()
    found = thinned(dataset_of(time, STEP * np.round(T / STEP)))
    (recording,) = found.recordings
    kept = np.isfinite(recording.channels['T'])
    assert 20 < kept.sum() < 400 and recording.time[0] == time[0] and recording.time[-1] == time[-1]
    errors = recording.channels['T'][kept] - np.interp(recording.time[kept], time, T)
    assert np.sqrt(np.mean(errors**2)) < 1.4 * STEP / np.sqrt(12.0)
    assert 'count, the others repeat them (the resolution of 0.25 K' in found.notes[-1]


def test_of_a_slow_sensor_each_reading_counts_when_it_is_new():
    time, T = slow_warming()
    read = np.arange(len(time)) // 7 * 7
    (recording,) = thinned(dataset_of(time, T[read])).recordings
    kept = np.isfinite(recording.channels['T'])
    assert np.array_equal(recording.time[kept], time[::7]) and np.array_equal(recording.channels['T'][kept], T[::7])


def test_a_rest_that_comes_again_has_the_same_error_of_rounding():
    """Ten visits to one rest tell as much of it as one; a value that is read once keeps its noise."""
    time = np.arange(0.0, 70.0, 0.02)
    T = np.where(time % 7.0 < 3.5, 300.1, 303.1 + 0.01 * time)
    (recording,) = thinned(dataset_of(time, STEP * np.round(T / STEP))).recordings
    values, stds = recording.channels['T'], recording.sample_std['T']
    rest = values == 300.0
    assert rest.sum() == 10 and stds[rest] == pytest.approx(0.07 * np.sqrt(10.0))
    assert np.sum(1.0 / stds[rest] ** 2) == pytest.approx(1.0 / 0.07**2)


@pytest.mark.parametrize('noise', [0.02, 0.3])
def test_noise_that_hides_the_resolution_keeps_every_row(noise):
    time, T = slow_warming()
    T = T + noise * np.random.default_rng(1).normal(size=len(T))
    given = dataset_of(time, STEP * np.round(T / STEP) if noise > STEP else T, noise)
    assert thinned(given) == given


@pytest.mark.parametrize('phase', range(4))
def test_a_channel_of_lower_rate_keeps_its_share_of_thinned_samples(phase):
    """At least every fourth sample of a channel that is measured at every fourth instant, whatever its phase."""
    time, T = slow_warming()
    sparse = np.where(np.arange(len(time)) % 4 == phase, T, np.nan)
    recording = Recording('a', 'wire', time, {'T': sparse, 'stress': T * 1e5}, WARMING)
    data = fit_data(recording, {'T': 0.1, 'stress': 1e4}, every=4)
    counts = dict(zip(data.channels, np.count_nonzero(data.weight, axis=1), strict=True))
    assert counts['T'] >= np.isfinite(sparse).sum() / 4
    assert len(time) / 4 <= counts['stress'] <= len(time) / 4 + counts['T']


def test_intervals_do_not_shrink_with_rows_that_repeat(tmp_path):
    """A thermometer of 0.25 K tells as much of lambda at 100 Hz as at 10 Hz."""
    widths = []
    for rate in (10.0, 100.0):
        time = np.arange(0.0, 60.0, 1.0 / rate)
        T = 298.0 + 6.0 * (1.0 - np.exp(-time / 20.0))
        rows = [f'{t:.3f},0,0.02,{STEP * round(v / STEP):.2f}' for t, v in zip(time, T, strict=True)]
        file = tmp_path / f'{rate:g}.csv'
        file.write_text('\n'.join(['time_s,strain,J_W,T_K', *rows, '']))
        found = calibrate(
            read_dataset([file], 'wire', 298.0),
            read_config(words=['system=wire']),
            FitOptions(free=('wire.lambda',), kinetics='hybrid'),
        )
        (interval,) = found.uncertainty.intervals
        widths.append(interval.std)
    assert widths[1] > 0.7 * widths[0]
