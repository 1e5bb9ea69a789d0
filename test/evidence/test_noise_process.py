"""Noise that a filter in a sensor has smoothed: told at rest, and not taken for something that a model lacks."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.fft import dct
from scipy.ndimage import uniform_filter1d
from simulated_data import NOISE, command, config, recording

from sma_sim import Dataset, FitOptions, find_effects
from sma_sim.evidence.data.noise_process import NoiseProcess, process_of
from sma_sim.evidence.diagnosis.diagnose import diagnose
from sma_sim.evidence.estimation.calibrate import problem_for
from sma_sim.evidence.estimation.noise_at_rest import noise_at_rest, with_noise_of
from sma_sim.evidence.estimation.residuals import weighted_residuals
from sma_sim.evidence.model_selection.candidates import with_effect
from sma_sim.evidence.model_selection.nominal_fit import DiagnosisRequest
from sma_sim.evidence.search.score import spectra_of_noise, unlisted_evidence

INTERVAL = 0.05


def smoothed(random, count, memory=0.8, white=0.0):
    """Noise of variance 1 with a memory from sample to sample, beside white noise."""
    found, steps = np.zeros(count), random.normal(size=count)
    for k in range(1, count):
        found[k] = memory * found[k - 1] + np.sqrt(1.0 - memory**2) * steps[k]
    return found + white * random.normal(size=count)


@pytest.mark.parametrize(('memory', 'white'), [(0.5, 0.0), (0.9, 0.0), (0.9, 1.0)])
def test_a_process_is_told_from_stretches_without_their_moving_mean(memory, white):
    random, rows = np.random.default_rng(1), 100
    whole = [smoothed(random, 400, memory, white) for _ in range(20)]
    found = process_of([(one - uniform_filter1d(one, rows))[rows // 2 : -rows // 2] for one in whole], INTERVAL, rows)
    assert found.std == pytest.approx(np.hypot(1.0, white), rel=0.1)
    assert found.at_zero == pytest.approx((1.0 + memory) / (1.0 - memory) + white**2, rel=0.3)


def test_white_noise_is_white():
    random = np.random.default_rng(2)
    found = [process_of([random.normal(size=150) for _ in range(10)], INTERVAL) for _ in range(100)]
    assert sum(one is not None for one in found) <= 4
    assert process_of([random.normal(size=50)], INTERVAL) is None and process_of([np.zeros(500)], INTERVAL) is None


@pytest.mark.parametrize('every', [1, 4])
def test_its_spectrum_is_that_of_its_samples_and_of_every_few_of_them(every):
    random, process = np.random.default_rng(3), NoiseProcess(np.array([0.8]), 1.0 - 0.64, INTERVAL)
    powers = [dct(smoothed(random, 800 * every)[::every], norm='ortho') ** 2 for _ in range(200)]
    expected, shown = process.spectrum(800, every * INTERVAL), np.mean(powers, axis=0)
    low = slice(5, 100)
    assert shown[low].mean() == pytest.approx(expected[low].mean(), rel=0.05)
    assert expected.min() == 1.0  # no less than the noise that was stated


def test_what_vibrates_is_no_noise_of_a_filter():
    random, time = np.random.default_rng(4), INTERVAL * np.arange(2000)
    found = process_of([np.sin(2.0 * np.pi * 2.0 * time) + random.normal(size=2000)], INTERVAL)
    assert not found.is_low_pass and process_of([smoothed(random, 2000)], INTERVAL).is_low_pass


def test_a_slow_swing_has_no_memory():
    """Hum of the mains, whose alias by 50 Hz swings at 0.3 Hz: it counted as noise eleven times as large as stated."""
    random, time, rows = np.random.default_rng(5), 0.02 * np.arange(500), 100
    hum = [1.5 * np.sin(2.0 * np.pi * (50.3 * time + random.random())) + random.normal(size=500) for _ in range(5)]
    memory = [smoothed(random, 400, 0.9) for _ in range(20)]
    found = [
        process_of([(one - uniform_filter1d(one, rows))[rows // 2 : -rows // 2] for one in some], 0.02, rows)
        for some in (hum, memory)
    ]
    assert found[0] is None and found[1].std == pytest.approx(1.0, rel=0.1)


def filtered(seeds, truth, white=0.0, memory=0.8):
    """Recordings of a robot whose sensors have smoothed their noise, some of it white."""
    runs = []
    for seed in seeds:
        run, random = recording(truth, command(seed, 200.0), noise=0.0, seed=seed), np.random.default_rng(seed)
        noisy = {
            name: values + NOISE[name] * smoothed(random, len(values), memory, white)
            for name, values in run.channels.items()
        }
        runs.append(replace(run, channels=noisy))
    return Dataset(tuple(runs), dict(NOISE))


def test_noise_at_rest_explains_what_no_list_has():
    truth = config('hybrid')
    problem = problem_for(filtered((1, 2, 3), truth), truth, FitOptions(), 1)
    left = [weighted_residuals(truth, run) for run in problem.runs]
    processes = noise_at_rest(problem, left)
    assert processes.keys() == set(NOISE)
    assert np.mean([one.std for one in processes.values()]) == pytest.approx(1.0, rel=0.1)
    known = unlisted_evidence(left, of_noise=spectra_of_noise(with_noise_of(problem, processes), left))
    assert unlisted_evidence(left) > 500.0 and known < 5.0


def test_noise_a_little_larger_than_stated_is_nothing_unlisted():
    truth = config('hybrid')
    data = filtered((1, 2, 3), truth, memory=0.0)
    stated = replace(data, noise_std={name: std / 1.15 for name, std in NOISE.items()})
    problem = problem_for(stated, truth, FitOptions(), 1)
    left = [weighted_residuals(truth, run) for run in problem.runs]
    assert unlisted_evidence(left) > 5.0 and unlisted_evidence(left, of_noise=spectra_of_noise(problem, left)) < 0.0


def test_a_memory_that_rests_hardly_tell_is_nothing_unlisted():
    """White noise beside a part whose memory is a seventh of the means over rests: six of ten robots lacked something."""
    truth, known, first = config('hybrid'), [], []
    for seeds in ((1, 2, 3), (4, 5, 6), (7, 8, 9)):
        data = filtered(seeds, truth, 1.0, 0.85)
        problem = problem_for(
            replace(data, noise_std={name: 1.4 * std for name, std in NOISE.items()}), truth, FitOptions(), 1
        )
        left = [weighted_residuals(truth, run) for run in problem.runs]
        spectra = spectra_of_noise(with_noise_of(problem, noise_at_rest(problem, left)), left)
        known.append(unlisted_evidence(left, of_noise=spectra))
        first.append(unlisted_evidence(left, of_noise=[[one[:1] for one in run] for run in spectra]))
        slow = [rows + 1.5 * np.sin(2.0 * np.pi * run.time / 40.0) for rows, run in zip(left, problem.runs, strict=True)]
        assert unlisted_evidence(slow, of_noise=spectra) > 20.0
    assert max(known) < 3.0 < max(first)


def test_what_moves_in_several_channels_is_no_noise_of_any():
    """As of a robot that moves where its model rests: it counted as a noise 19 times as large as stated."""
    truth, random = config('hybrid'), np.random.default_rng(3)
    problem = problem_for(filtered((1, 2), truth), truth, FitOptions(), 1)
    left = [weighted_residuals(truth, run) for run in problem.runs]
    moving = [rows + np.outer(np.linspace(1.0, 3.0, len(rows)), 9.0 * smoothed(random, rows.shape[1], 0.9)) for rows in left]
    assert noise_at_rest(problem, left).keys() == set(NOISE) and not noise_at_rest(problem, moving)


def test_a_robot_that_lacks_nothing_lacks_nothing_beside_filtered_sensors():
    """The noise is said to be more than what was stated; that it is correlated was an unlisted effect, with certainty."""
    request = DiagnosisRequest(
        kinetics='hybrid', options=FitOptions(free=('beam.E', 'wire.E_A'), kinetics='hybrid', starts=1)
    )
    found = diagnose(filtered((4, 5, 6), config('hybrid'), 1.0), config('hybrid'), request=request)
    assert found.verdict == 'none' and found.posterior.unlisted < 0.1
    assert {fault.kind for fault in found.set_up} == {'noise'}


@pytest.mark.slow
def test_an_effect_is_found_beside_filtered_sensors():
    truth = with_effect(config('hybrid'), find_effects()['gravity'], {'g_y': 2.0})
    request = DiagnosisRequest(kinetics='hybrid')
    found = diagnose(filtered((7, 8, 9), truth, 0.5), config('hybrid'), request=request)
    assert found.effects == ('gravity',) and found.posterior.effects['gravity'] > 0.9
