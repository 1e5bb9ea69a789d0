"""Noise that grows with the reading or with its speed: told from the samples, and counted in the weight of each."""

import csv
from dataclasses import replace

import numpy as np
import pytest
from simulated_data import NOISE, command, config, recording

from sma_sim import Dataset, Recording, module_input, read_dataset
from sma_sim.evidence.data.readings import with_noise_of_readings
from sma_sim.evidence.data.recording import CHANNEL_COLUMNS
from sma_sim.evidence.data.varying_noise import differences, integrals, varying_noise
from sma_sim.evidence.estimation.residuals import fit_data
from sma_sim.evidence.set_up.faults import Fault, corrected
from sma_sim.solver.inputs import inputs_at

STD = 0.05


def in_motion(seed, std=STD, growth=0.0, jitter=0.0, rows=4000, rate=50.0):
    """Readings of what follows a command that is held between its steps: its speed bends at each."""
    random = np.random.default_rng(seed)
    times = np.linspace(0.0, rows / rate, 13)
    levels = random.uniform(-10.0, 10.0, 13)
    fine = np.arange(20 * rows) / (20.0 * rate)
    targets = levels[np.searchsorted(times, fine, side='right') - 1]
    shown, now = np.empty(len(fine)), 0.0
    for k, target in enumerate(targets):
        now += (target - now) / (20.0 * rate * 1.5)
        shown[k] = now
    time = fine[::20]
    read = np.interp(time + jitter * random.standard_normal(rows), fine, shown)
    read += np.hypot(std, growth * read) * random.standard_normal(rows)
    return Recording(f'run{seed}', 'module', time, {'F_1': read}, module_input(times, levels))


@pytest.mark.parametrize('growth', [0.01, 0.03])
def test_noise_that_grows_with_the_reading_is_told(growth):
    found = varying_noise([in_motion(seed, growth=growth) for seed in range(3)], 'F_1')
    assert found is not None and found.jitter == 0.0
    assert found.growth == pytest.approx(growth, rel=0.15) and found.std == pytest.approx(STD, rel=0.1)


@pytest.mark.parametrize('jitter', [0.01, 0.03])
def test_noise_of_a_clock_that_jitters_is_told(jitter):
    found = varying_noise([in_motion(seed, jitter=jitter) for seed in range(3)], 'F_1')
    assert found is not None and found.growth == 0.0
    assert found.jitter == pytest.approx(jitter, rel=0.3) and found.std == pytest.approx(STD, rel=0.1)


def test_bends_at_steps_of_the_command_are_no_noise():
    assert varying_noise([in_motion(seed) for seed in range(3)], 'F_1') is None
    assert varying_noise([in_motion(seed, std=0.005) for seed in range(3)], 'F_1') is None


def test_too_few_samples_tell_nothing():
    run = in_motion(0, growth=0.1, rows=20)
    assert varying_noise([run], 'F_1') is None
    assert len(differences(run, np.full(20, np.nan))[0]) == 0


def test_differences_take_away_what_moves_like_a_polynomial_at_uneven_times():
    run = in_motion(0)
    time = np.sort(run.time + 0.003 * np.random.default_rng(0).uniform(-1.0, 1.0, len(run.time)))
    uneven = Recording('a', 'module', time, {'F_1': time**4}, run.source)
    assert np.sqrt(differences(uneven, time**4)[0]).max() < 1e-8 * np.ptp(time**4)


def test_integrals_of_a_command_are_those_of_its_parts():
    held = module_input([0.0, 1.0, 3.0], [2.0, -1.0, 5.0])
    np.testing.assert_allclose(integrals(held, np.array([0.5, 1.0, 2.0, 4.0]))[0], [1.0, 2.0, 1.0, 5.0])
    linear = module_input([0.0, 2.0], [0.0, 4.0], linear=True)
    np.testing.assert_allclose(integrals(linear, np.array([0.0, 2.0]))[0], [0.0, 4.0])


def written(folder, seed, growth):
    """A file with the readings of a robot whose load cells scatter by a part of what they read."""
    run = recording(config(), command(seed), rate=50.0, noise=1.0, seed=seed)
    random, names = np.random.default_rng(seed), list(run.channels)
    shown = {
        name: values * (1.0 + growth * (name[0] == 'F') * random.standard_normal(len(values)))
        for name, values in run.channels.items()
    }
    commands = inputs_at(run.source, run.time)['J_eq_W']
    with (folder / f'{run.name}.csv').open('w', newline='') as file:
        table = csv.writer(file)
        table.writerow(['time_s', 'J_eq_W', *(CHANNEL_COLUMNS[name] for name in names)])
        table.writerows(zip(run.time, commands, *(shown[name] for name in names), strict=True))


def test_samples_count_by_their_own_noise(tmp_path):
    for seed in range(2):
        written(tmp_path, seed, 0.05)
    for stated in (None, {'F_1': NOISE['F_1']}):
        dataset = read_dataset(tmp_path, noise_std=stated)
        assert any(
            note.startswith('noise of F_1: beside that, ') and note.endswith('% of the reading') for note in dataset.notes
        )
        run = dataset.recordings[0]
        assert {*run.sample_std} == {'F_1', 'F_2'}
        expected = np.hypot(NOISE['F_1'], 0.05 * run.channels['F_1'])
        assert np.median(run.sample_std['F_1'] / expected) == pytest.approx(1.0, abs=0.1)
        assert dataset.noise_std['F_1'] == pytest.approx(np.sqrt(np.mean(expected**2)), rel=0.2)
        weight = fit_data(run, dataset.noise_std).weight[list(run.channels).index('F_1')]
        assert weight.max() > 2.0 * weight.min()


def test_a_part_of_the_size_that_a_map_states_is_not_added_twice(tmp_path):
    for seed in range(2):
        written(tmp_path, seed, 0.05)
    mapping = tmp_path / 'map.yaml'
    mapping.write_text('F_1_N: {column: F_1_N, relative_std: 0.05}\n')
    dataset = read_dataset(sorted(tmp_path.glob('*.csv')), mapping=mapping, noise_std={'F_1': NOISE['F_1']})
    assert not any(note.startswith('noise of F_1: beside') for note in dataset.notes)
    assert any(note.startswith('noise of F_2: beside') for note in dataset.notes)


def test_the_noise_of_samples_goes_along_with_what_is_corrected():
    run = in_motion(0)
    run = replace(run, channels={'F_1': run.channels['F_1'], 'F_2': 2.0 * run.channels['F_1']})
    run = replace(run, sample_std={'F_1': np.full(len(run.time), 0.1)})
    dataset = Dataset((run,), {'F_1': 0.1, 'F_2': 0.2})

    def after(fault):
        return corrected(dataset, [fault]).recordings[0].sample_std

    assert after(Fault('unit', ('F_1',), 1000.0))['F_1'] == pytest.approx(100.0)
    assert after(Fault('sign', ('F_1',)))['F_1'] == pytest.approx(0.1)
    assert {*after(Fault('swap', ('F_1', 'F_2')))} == {'F_2'}
    assert after(Fault('noise', ('F_1',), 3.0))['F_1'] == pytest.approx(0.3)


def test_recordings_that_come_from_no_file_are_understood_alike():
    runs = tuple(in_motion(seed, growth=0.03) for seed in range(3))
    stated = Dataset(runs, {'F_1': STD})
    found = with_noise_of_readings(stated)
    assert {*found.recordings[0].sample_std} == {'F_1'} and found.noise_std['F_1'] > STD
    assert found.notes[-1].startswith('noise of F_1: beside that, 3')
    assert with_noise_of_readings(found) is found
    gaps = [replace(one, channels={'F_1': np.where(one.time % 7.0 < 1.0, np.nan, one.channels['F_1'])}) for one in runs]
    assert with_noise_of_readings(Dataset(tuple(gaps), {'F_1': STD})).noise_std['F_1'] > STD
    covered = Dataset(runs, {'F_1': 10.0})  # a noise that is stated so large has room for all of it
    assert with_noise_of_readings(covered) is covered
    same = Dataset(tuple(in_motion(seed) for seed in range(3)), {'F_1': STD})
    assert with_noise_of_readings(same) is same
    step = 4.0 * STD
    coarse = [replace(one, channels={'F_1': step * np.rint(one.channels['F_1'] / step)}) for one in same.recordings]
    rounded = with_noise_of_readings(Dataset(tuple(coarse), {'F_1': STD}))
    assert rounded.recordings[1].rounding['F_1'].std == pytest.approx(STD, rel=0.1)
    assert rounded.resolution == pytest.approx({'F_1': step}) and not rounded.recordings[0].sample_std
    assert rounded.noise_std['F_1'] == pytest.approx(rounded.recordings[0].rounding['F_1'].noise_std)
    assert with_noise_of_readings(rounded) is rounded
    step = 8.0 * STD
    coarse = [replace(one, channels={'F_1': step * np.rint(one.channels['F_1'] / step)}) for one in same.recordings]
    thinned = with_noise_of_readings(Dataset(tuple(coarse), {'F_1': STD}))
    assert np.isfinite(thinned.recordings[0].channels['F_1']).sum() < 0.3 * len(same.recordings[0].time)
    assert thinned.noise_std['F_1'] > STD and {*thinned.resolution} == {'F_1'}
