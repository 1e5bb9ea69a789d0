"""The noise of a strain gauge is not motion: an input of fewer straight stretches gives the same stress."""

from dataclasses import replace

import numpy as np
import pytest
from isobaric_runs import BENCH, isobaric_tests
from simulated_data import command, config, recording

from sma_sim import Model, Recording, read_config, simulate, wire_input
from sma_sim.evidence.estimation.residuals import corners, fit_data, predict, simplified_input

NOISE = {'stress': 1e6}
RAMP = (np.array([0.0, 800.0, 1600.0]), np.array([0.0, 0.04, 0.0]))


def wire_recording(jitter, seed=0):
    """A wire that is drawn and let go, its strain logged each second by a gauge with noise; switched on half way."""
    time = np.arange(1601.0)
    strain = np.interp(time, *RAMP) + jitter * np.random.default_rng(seed).normal(size=len(time))
    source = wire_input(time, strain, np.where(time < 500.0, 0.0, 0.01))
    stress = simulate(Model(config(system='wire')), wire_input(*RAMP), time)['stress_Pa']
    return Recording('pull', 'wire', time, {'stress': stress}, source)


def test_jitter_costs_no_stretches_and_changes_no_stress():
    run = wire_recording(1e-5)
    prepared = fit_data(run, NOISE)
    assert len(prepared.source.times) < 0.3 * len(run.source.times)
    whole = replace(prepared, source=run.source)
    model = config(system='wire')
    apart = predict(model, prepared)['stress'] - predict(model, whole)['stress']
    assert np.sqrt(np.mean(apart**2)) < 0.5 * NOISE['stress']


def test_rows_that_switch_the_heating_stay():
    assert 500.0 in simplified_input(wire_recording(1e-5), NOISE).times


@pytest.mark.parametrize('noise', [1e6, 1e4])
def test_what_is_left_out_is_within_the_noise_of_the_stress(noise):
    """A gauge that is far noisier than the load cell moves the stress, and is believed."""
    run = wire_recording(1e-4)
    kept = simplified_input(run, {'stress': noise})
    apart = np.interp(run.source.times, kept.times, kept.values[:, 0]) - run.source.values[:, 0]
    assert np.abs(apart).max() <= 2.0 * noise / 6e10 * (1.0 + 1e-9)


@pytest.mark.parametrize(('column', 'noise', 'widest'), [(0, 4e4, 1e5), (1, 0.04, 0.1)])
def test_an_imposed_stress_or_temperature_is_kept_to_what_moves_no_strain(column, noise, widest):
    """To 0.1 MPa or 0.1 K, though four standard deviations of its own noise are more."""
    (run,) = isobaric_tests(read_config(words=BENCH), (1e8,)).recordings
    noisy = run.source.values.copy()
    noisy[:, column] += noise * np.random.default_rng(5).normal(size=len(noisy))
    kept = simplified_input(replace(run, source=replace(run.source, values=noisy)), {'strain': 1e-4})
    assert len(kept.times) < 0.8 * len(noisy)
    apart = np.interp(run.source.times, kept.times, kept.values[:, column]) - noisy[:, column]
    assert np.abs(apart).max() <= widest * (1.0 + 1e-9)


def test_a_strain_without_noise_keeps_its_corners():
    kept = simplified_input(wire_recording(0.0), NOISE)
    assert set(RAMP[0]) <= set(kept.times) and len(kept.times) < 10


def test_a_module_keeps_its_commands():
    run = recording(config(), command(1))
    assert simplified_input(run, {}) is run.source


def test_a_polyline_passes_all_points_within_the_width():
    random = np.random.default_rng(3)
    time = np.sort(random.uniform(0.0, 10.0, 400))
    values = np.cumsum(random.normal(size=400))
    keep = corners(time, values, 1.5)
    assert keep[0] and keep[-1] and keep.sum() < 300
    assert np.abs(np.interp(time, time[keep], values[keep]) - values).max() <= 1.5
