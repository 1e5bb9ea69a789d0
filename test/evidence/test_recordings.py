"""From files to datasets: what is read, under which names, how the command's switching is understood."""

import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_recordings import RATE, cells_of, module_columns, text_of, write_recording

from sma_sim.evidence.data.assemble import outliers, saturated
from sma_sim.evidence.data.recordings import read_dataset, read_recording
from sma_sim.evidence.data.rosbag.run_writer import write_mcap
from sma_sim.evidence.data.rosbag.salvage import open_bag
from sma_sim.evidence.data.rosbag.writer import BagWriter
from sma_sim.evidence.data.tables import write_columns
from sma_sim.evidence.data.train_test_split import hold_out_last
from sma_sim.evidence.estimation.residuals import sampled_changes
from sma_sim.model.errors import UserError
from sma_sim.solver.inputs import inputs_at
from sma_sim.words.repair_notes import grouped_notes

ROOT = Path(__file__).resolve().parents[2]
MAPS = ROOT / 'examples' / 'maps'
SHARED = ROOT.parent / 'shared'
WIRE = SHARED / 'measured' / 'nitinol_wire' / 'csv'
needs_shared = pytest.mark.skipif(not (SHARED / 'measured').is_dir(), reason='no measured data here')


def early_notes(tmp_path, columns):
    (recording,) = read_recording(write_recording(tmp_path / 'run.csv', columns), 'module', 298.0)
    return [note for note in recording.notes if 'earlier ones were not recorded' in note]


def test_a_robot_that_moves_before_its_first_command_is_told(tmp_path):
    """The recorder heard of the controller late: what is not recorded passes for missing physics."""
    columns = module_columns()
    assert early_notes(tmp_path, columns) == []
    first = columns['time_s'][np.argmax(columns['J_eq_W'] != 0.0)]
    columns['J_eq_W'][columns['time_s'] < first + 1.5] = 0.0
    (note,) = early_notes(tmp_path, columns)
    assert 'T_1' in note and f'first command is at {first + 1.5:.6g} s' in note
    begun = float(re.search(r'in motion from (\S+) s', note)[1])
    assert first < begun < first + 0.5


@pytest.mark.parametrize('shape', ['drifts', 'cools from the first sample on', 'is late by a delay'])
def test_what_moves_before_a_command_for_another_reason_is_not_told(tmp_path, shape):
    columns = module_columns()
    t, first = columns['time_s'], columns['time_s'][np.argmax(columns['J_eq_W'] != 0.0)]
    if shape == 'drifts':
        columns['U_y_m'] += 0.05 * np.ptp(columns['U_y_m']) * t / first
    elif shape == 'cools from the first sample on':
        columns['T_1_K'] += 60.0 * np.exp(-t / 1.0)
    else:
        columns['J_eq_W'] = np.where(t < first + 0.15, 0.0, columns['J_eq_W'])
    assert early_notes(tmp_path, columns) == []


def test_a_piece_of_a_pull_is_told(tmp_path):
    """A pull from zero stress begins as every model does, and one from a small preload; a piece of it does not."""
    time = np.arange(200.0)
    strain = 3e-4 * np.minimum(time, 200.0 - time)
    stress = 5e8 * np.tanh(strain / 0.01) + 4e7
    pull = {'time_s': time, 'strain': strain, 'stress_Pa': stress, 'T_K': np.full(200, 298.0)}
    write_recording(tmp_path / 'pull.csv', pull)
    write_recording(tmp_path / 'piece.csv', {name: values[120:] for name, values in pull.items()})
    for system in ('wire', 'wire_at_T'):
        assert not [note for note in read_dataset([tmp_path / 'pull.csv'], system).notes if 'every model begins' in note]
        both = read_dataset([tmp_path / 'pull.csv', tmp_path / 'piece.csv'], system)
        (told,) = [note for note in both.notes if 'every model begins' in note]
        assert told.startswith('stress begins at 532 MPa in piece: ') and 'give the recording whole' in told
    for path in tmp_path.iterdir():  # a stress that is imposed is none that is measured
        assert not [note for note in read_dataset([path], 'wire_under_load').notes if 'first pull' in note]


@pytest.mark.parametrize('power', [0.0, 9.0])
def test_recordings_that_do_not_begin_at_rest_are_told(tmp_path, power):
    """As pieces of a long one do, whose wires are warm from before: a model begins at rest, and lacks an effect then."""
    columns = module_columns()
    for name in ('T_1_K', 'T_2_K'):
        columns[name] -= columns[name][0] - columns['T_E_K'][0]
    write_recording(tmp_path / 'run1.csv', columns)
    t = columns['time_s']
    warm = {name: values.copy() for name, values in columns.items()}
    for name, size in (('T_1_K', 60.0), ('alpha_rad', 0.5 * np.ptp(columns['alpha_rad'])), ('U_x_m', 0.0)):
        warm[name] += size * np.exp(-t / 1.0)
    warm['J_eq_W'][0] = power
    write_recording(tmp_path / 'run2.csv', warm)
    assert not [note for note in read_dataset([tmp_path / 'run1.csv']).notes if 'begins at rest' in note]
    both = read_dataset([tmp_path / 'run1.csv', tmp_path / 'run2.csv'])
    told = [note for note in both.notes if 'every model begins at rest' in note]
    assert any(re.match(r'alpha of run2 begins [\d.]+ deg above run1: ', note) for note in told)
    assert any(re.match(r'T_1 of run2 begins [\d.]+ K above that of the air: ', note) for note in told)
    assert not any(note.startswith(('U_x', 'U_y', 'T_2')) for note in told)
    own = [note for note in both.recordings[1].notes if 'in motion at the first sample' in note]
    assert len(own) == (power == 0.0) and all('T_1' in note and 'alpha' in note for note in own)


def test_a_copy_is_no_second_measurement(tmp_path):
    """It would make intervals too narrow, and be predicted by itself where one of both is held out."""
    columns = module_columns()
    write_recording(tmp_path / 'run1.csv', columns)
    (tmp_path / 'run1 copy.csv').write_text((tmp_path / 'run1.csv').read_text())
    again = {name: values + 1e-6 * np.sin(values) * (name != 'time_s') for name, values in columns.items()}
    write_recording(tmp_path / 'run2.csv', again)
    dataset = read_dataset(tmp_path)
    assert [one.name for one in dataset.recordings] == ['run1 copy', 'run2']
    assert 'run1 is a copy of run1 copy, sample by sample: left out' in dataset.notes
    one, other = dataset.recordings
    split = [replace(dataset, recordings=(recording,)) for recording in (one, replace(one, name='run9'), other)]
    with pytest.raises(UserError, match='run9 is a copy of run1 copy, which is fitted: it would be predicted by itself'):
        hold_out_last(*split[:2])
    assert hold_out_last(split[0], split[2])[1].recordings == (other,)


def with_switching_rows(columns, times, values):
    """The same measurement under a command that switches at `times`, each with a row of its own without measured cells."""
    rows = len(columns['time_s'])
    sampled = {name: column.copy() for name, column in columns.items()}
    place = np.searchsorted(times, columns['time_s'], side='right')
    sampled['J_eq_W'] = np.concatenate([[0.0], values])[place]
    extra = {name: np.full(len(times), np.nan) for name in columns}
    extra |= {'time_s': np.asarray(times), 'J_eq_W': np.asarray(values), 'T_E_K': np.full(len(times), 298.0)}
    joined = {name: np.concatenate([sampled[name], extra[name]]) for name in columns}
    order = np.argsort(joined['time_s'], kind='stable')
    assert len(order) == rows + len(times)
    return {name: column[order] for name, column in joined.items()}


def test_exact_switching(tmp_path):
    """Rows without measured cells say when the command changed; they are no samples."""
    columns = with_switching_rows(module_columns(), [2.0071, 5.5, 8.1234], [5.0, -3.0, 0.0])
    (recording,) = read_recording(write_recording(tmp_path / 'run.csv', columns), 'module', 298.0)
    assert recording.exact_commands and len(recording.time) == 600
    assert not any('repeat' in note or 'missing' in note for note in recording.notes)
    changes = recording.source.times[1:][np.diff(recording.source.values[:, 0]) != 0.0]
    assert list(changes) == [2.0071, 5.5, 8.1234]
    assert (recording.source.times[0], recording.source.times[-1]) == (0.0, 599 / RATE)


def test_exact_switching_in_complete_rows(tmp_path):
    """Also where those rows repeat the measured cells: they do not fit in the regular grid."""
    columns = with_switching_rows(module_columns(noise=False), [2.0071, 5.513, 8.1234], [5.0, -3.0, 0.0])
    for name, values in columns.items():
        known = np.isfinite(values)
        columns[name] = np.interp(columns['time_s'], columns['time_s'][known], values[known])
    (recording,) = read_recording(write_recording(tmp_path / 'run.csv', columns), 'module', 298.0)
    assert recording.exact_commands


def test_sampled_commands(tmp_path):
    """Changes in rows of the regular grid: somewhere in the interval before, whose row is kept in the input."""
    columns = module_columns()
    (recording,) = read_recording(write_recording(tmp_path / 'run.csv', columns), 'module', 298.0)
    assert not recording.exact_commands and any('uncertain within its interval' in note for note in recording.notes)
    for row in np.flatnonzero(np.diff(columns['J_eq_W']) != 0.0) + 1:
        assert np.isin(columns['time_s'][[row - 1, row]], recording.source.times).all()
    assert len(recording.source.times) < 20
    assert np.array_equal(inputs_at(recording.source, columns['time_s'])['J_eq_W'], columns['J_eq_W'])


def test_a_lost_sample_at_a_change_does_not_make_switching_exact(tmp_path):
    """A closed loop commands at every sample; some rows have no measured cells."""
    columns = module_columns()
    columns['J_eq_W'] = 5.0 * np.sin(columns['time_s'])
    for name in list(columns)[3:]:
        columns[name][::40] = np.nan
    (recording,) = read_recording(write_recording(tmp_path / 'run.csv', columns), 'module', 298.0)
    assert not recording.exact_commands


@needs_shared
def test_switching_of_the_known_files():
    for file in sorted((SHARED / 'measured' / 'module').glob('*/run*.csv')):
        (recording,) = read_recording(file, 'module', 298.0)
        assert recording.exact_commands and len(recording.time) == 5000, file
    for file in sorted((SHARED / 'reference').glob('module_*_[hm]*.csv')):
        (recording,) = read_recording(file, 'module', 298.0)
        assert not recording.exact_commands and len(recording.time) == 2000, file


@needs_shared
def test_clean_files_have_no_outliers():
    """Fast dynamics are no outliers: steps of the heating, transformation, loads of a tensile machine."""
    for file in [*(SHARED / 'measured' / 'module').glob('*/run*.csv'), *(SHARED / 'reference').glob('module_*_[hm]*.csv')]:
        for recording in read_recording(file, 'module', 298.0):
            assert not any('outlier' in note for note in recording.notes), file
    for file in (SHARED / 'reference').glob('wire_*_[hm]*.csv'):
        for recording in read_recording(file, 'wire', 298.0):
            assert not any('outlier' in note for note in recording.notes), file
    for file in WIRE.glob('electric_*.csv'):
        for recording in read_recording(file, 'wire', 298.0, MAPS / 'nitinol_electric.yaml'):
            assert not any('outlier' in note for note in recording.notes), file


@pytest.mark.parametrize(('switched', 'seen'), [(29.865, True), (20.0, False)])
def test_a_step_of_the_last_sample_is_kept_where_the_command_has_just_changed(tmp_path, switched, seen):
    """Nothing follows that would tell it from a spike, but the command does."""
    columns = {name: column[:300] for name, column in module_columns().items()}
    time = columns['time_s'] = 0.1 * np.arange(300.0)
    columns['J_eq_W'] = 5.0 * (time >= switched)
    columns['F_1_N'] = 8.7 + 0.05 * np.random.default_rng(0).normal(size=300)
    columns['F_1_N'][-1] += 1.8
    (recording,) = read_recording(write_recording(tmp_path / 'run.csv', columns), 'module', 298.0)
    assert np.isfinite(recording.channels['F_1'][-1]) == seen
    assert any('F_1_N: 1 outliers' in note for note in recording.notes) != seen


def test_spikes_of_measured_inputs(tmp_path):
    """Strain and ambient temperature are measured too; a command may well be a single pulse."""
    time = np.arange(300.0)
    columns = {'time_s': time, 'strain': 1e-4 * time, 'J_W': 1.0 * (time == 150.0), 'T_E_K': np.full(300, 298.0)}
    columns |= {'stress_Pa': 1e6 * time}
    columns['strain'][100], columns['T_E_K'][200] = 0.4, 1900.0
    (recording,) = read_recording(write_recording(tmp_path / 'pull.csv', columns), 'wire', 298.0)
    assert recording.source.values[:, 0] == pytest.approx(1e-4 * time) and (recording.source.values[:, 2] == 298.0).all()
    assert recording.source.values[:, 1].sum() == 1.0
    assert 'strain: 1 outliers, the first at 100 s: interpolated' in recording.notes
    assert 'T_E_K: 1 outliers, the first at 200 s: the value before holds' in recording.notes


def test_shuffled_rows_with_exact_switching(tmp_path):
    columns = with_switching_rows(module_columns(), [2.0071, 5.513, 8.1234], [5.0, -3.0, 0.0])
    order = np.random.default_rng(0).permutation(603)
    path = write_recording(tmp_path / 'run.csv', {name: column[order] for name, column in columns.items()})
    (recording,) = read_recording(path, 'module', 298.0)
    assert recording.exact_commands and len(recording.time) == 600
    changes = recording.source.times[1:][np.diff(recording.source.values[:, 0]) != 0.0]
    assert list(changes) == [2.0071, 5.513, 8.1234]


@pytest.mark.parametrize('shape', ['step', 'ramp', 'peak', 'decay', 'square', 'exponential', 'noise', 'rest'])
@pytest.mark.parametrize('std', [0.0, 0.01])
def test_fast_shapes_are_no_outliers(shape, std):
    time = np.arange(1000) / RATE
    k = np.arange(1000) - 500
    values = {
        'step': (k > 0) * 1.0,
        'ramp': np.clip(k / 3.0, 0.0, 1.0),
        'peak': np.maximum(1.0 - np.abs(k) / 4.0, 0.0),
        'decay': np.where(k >= 0, 0.5 ** np.maximum(k, 0), 0.0),
        'square': (k // 10 % 2) * 1.0,
        'exponential': 1.0 - np.exp(-np.maximum(k, 0) / 2.0),
        'noise': np.random.default_rng(5).standard_t(8, 1000),
        'rest': np.zeros(1000),
    }[shape]
    noisy = values + std * np.random.default_rng(0).normal(size=1000)
    assert not outliers(time, noisy).any()


def test_different_rates(tmp_path):
    """A slow thermometer is not a thermometer that loses samples."""
    columns = module_columns()
    slow = np.arange(600) % 5 != 0
    for name in ('T_1_K', 'T_2_K'):
        columns[name][slow] = np.nan
    (recording,) = read_recording(write_recording(tmp_path / 'run.csv', columns), 'module', 298.0)
    assert any('different rates' in note and 'alpha 50 Hz' in note and 'T_1 10 Hz' in note for note in recording.notes)
    assert not any('samples missing' in note for note in recording.notes)
    assert np.isfinite(recording.channels['T_1']).sum() == 120 and np.isfinite(recording.channels['alpha']).all()


def test_gaps_are_counted_and_placed(tmp_path):
    columns = {name: np.delete(column, slice(100, 150)) for name, column in module_columns().items()}
    (recording,) = read_recording(write_recording(tmp_path / 'run.csv', columns), 'module', 298.0)
    assert any('50 samples missing in 1 gap, the longest of 1.02 s from 1.98 s on' in note for note in recording.notes)


def test_columns_that_are_not_used_are_said(tmp_path):
    columns = module_columns()
    columns = {('alpha_deg' if name == 'alpha_rad' else name): column for name, column in columns.items()} | {
        'mode_1': np.ones(600)
    }
    (recording,) = read_recording(write_recording(tmp_path / 'run.csv', columns), 'module', 298.0)
    assert 'columns not used: alpha_deg' in recording.notes and 'not measured: alpha' in recording.notes


def test_the_other_system_is_recognised(tmp_path):
    path = write_recording(tmp_path / 'run.csv', module_columns())
    with pytest.raises(UserError, match='is it the recording of a module'):
        read_recording(path, 'wire', 298.0)
    with pytest.raises(UserError, match="expected one of module, wire, .*, got 'robot'"):
        read_recording(path, 'robot', 298.0)


def test_a_folder_stands_for_its_recordings(tmp_path):
    for k, name in enumerate(('b', 'a', 'c')):
        columns = module_columns()
        write_recording(tmp_path / f'{name}.csv', columns | {'F_1_N': columns['F_1_N'] + 0.01 * k})
    (tmp_path / 'commands.csv').write_text('time_s,J_eq_W\n0,1\n1,2\n')
    (tmp_path / 'readme.txt').write_text('no recording')
    dataset = read_dataset([tmp_path, tmp_path / 'a.csv'], 'module', 298.0)
    assert [recording.name for recording in dataset.recordings] == ['a', 'b', 'c'] and dataset.system == 'module'
    assert any('commands.csv: nothing measured in it' in note for note in dataset.notes)
    assert any('a.csv was given twice' in note for note in dataset.notes)
    said = grouped_notes([dataset])
    assert all(any('b' in line and line.endswith(f': {note}') for line in said) for note in dataset.recordings[1].notes)


def test_bags_of_a_folder(tmp_path):
    """Two bag files in a folder are two recordings; one that breaks off is read as far as it goes, and that is said."""
    columns = with_switching_rows(module_columns(), [2.0071, 5.513], [5.0, 0.0])
    write_mcap(tmp_path / 'a.mcap', columns)
    plain = BagWriter(tmp_path / 'killed')
    numbers = {}
    for message in open_bag(tmp_path / 'a.mcap').messages():
        if message.topic not in numbers:
            numbers[message.topic] = plain.add(message.topic, message.kind)
        plain.write(numbers[message.topic], message.log_time, message.cdr)
        if message.log_time >= 7 * 10**9:
            break
    plain.flush()
    dataset = read_dataset([tmp_path], 'module', 298.0)
    assert [recording.name for recording in dataset.recordings] == ['a', 'killed']
    assert any(note.startswith('killed: the bag breaks off') for note in grouped_notes([dataset]))
    assert dataset.recordings[0].time[-1] > 11.0 and 6.9 < dataset.recordings[1].time[-1] < 7.1
    for recording in dataset.recordings:
        assert recording.exact_commands and np.isfinite(recording.channels['alpha']).all()
        changes = recording.source.times[1:][np.diff(recording.source.values[:, 0]) != 0.0]
        assert changes == pytest.approx([2.0071, 5.513] if changes[0] > 2.0 else [1.0, 2.0071, 5.513], abs=1e-8)


def test_rows_before_the_first_command_are_left_out(tmp_path):
    columns = module_columns()
    columns['J_eq_W'][:30] = np.nan
    (recording,) = read_recording(write_recording(tmp_path / 'run.csv', columns), 'module', 298.0)
    assert recording.time[0] == 30 / RATE and '30 rows before the first command: left out' in recording.notes


def test_a_map_converts(tmp_path):
    """Laboratory units and back: the same recording."""
    columns = module_columns()
    plain = read_dataset([write_recording(tmp_path / 'plain.csv', columns)], 'module', 298.0)
    foreign = {
        't_ms': columns['time_s'] * 1e3,
        'power_mW': columns['J_eq_W'] * 1e3,
        'room_C': columns['T_E_K'] - 273.15,
        'x_mm': columns['U_x_m'] * 1e3,
        'y_mm': columns['U_y_m'] * 1e3,
        'angle_deg': np.degrees(columns['alpha_rad']),
        'F_1_N': columns['F_1_N'],
        'wire_1_C': columns['T_1_K'] - 273.15,
        'wire_2_C': columns['T_2_K'] - 273.15,
    }
    path = write_recording(tmp_path / 'foreign.csv', foreign)
    mapped = read_dataset([path], 'module', 300.0, MAPS / 'module_degrees.yaml')
    one, two = plain.recordings[0], mapped.recordings[0]
    assert two.time == pytest.approx(one.time, abs=1e-9) and set(two.channels) == set(one.channels) - {'F_2'}
    for channel, values in two.channels.items():
        assert values == pytest.approx(one.channels[channel], rel=1e-6, abs=1e-9)
        assert mapped.noise_std[channel] == pytest.approx(plain.noise_std[channel], rel=1e-3)
    assert two.source.values == pytest.approx(one.source.values)


def test_a_map_with_constants_and_one_column_twice(tmp_path):
    (tmp_path / 'map.yaml').write_text(
        'T_E_K: {column: chamber_C, offset: 273.15}\nT_K: {column: chamber_C, offset: 273.15}\nJ_W: {value: 0.25}\n'
        'stress_Pa: {column: MPa, scale: 1e6}\nstrain: elongation\n'
    )
    lines = [f'{k},{0.001 * k},{k},{30 + 0.1 * k}' for k in range(50)]
    (tmp_path / 'pull.csv').write_text('\n'.join(['time_s,elongation,MPa,chamber_C', *lines]) + '\n')
    (recording,) = read_recording(tmp_path / 'pull.csv', 'wire', 298.0, tmp_path / 'map.yaml')
    assert recording.source.linear == (True, False, False) and recording.exact_commands
    assert recording.source.values[:, 1] == pytest.approx(0.25)
    assert recording.source.values[:, 2] == pytest.approx(303.15 + 0.1 * np.arange(50))
    assert recording.channels['stress'] == pytest.approx(1e6 * np.arange(50)) and recording.channels['T'][3] == 303.45


@needs_shared
def test_the_isotherms_of_a_real_wire():
    dataset = read_dataset(sorted(WIRE.glob('stress_strain_*.csv')), 'wire', 298.0, MAPS / 'nitinol_isotherm.yaml')
    names = [recording.name for recording in dataset.recordings]
    assert names == ['stress_strain_0C', 'stress_strain_100C', *(f'stress_strain_40C#{k}' for k in (1, 2, 3))]
    for recording in dataset.recordings:
        assert np.nanmedian(recording.channels['T']) == pytest.approx(
            {'0': 273.6, '1': 373.2, '4': 313.4}[recording.name[14]], abs=1.0
        )
        assert 0.003 < np.ptp(recording.source.values[:, 0]) < 0.06 and recording.source.linear[0]
        assert 1e7 < np.nanmax(recording.channels['stress']) < 1e9
    assert 5e5 < dataset.noise_std['stress'] < 3e6 and any('resolution 0.1' in note for note in dataset.notes)


@needs_shared
def test_the_electric_runs_of_a_real_wire():
    dataset = read_dataset(sorted(WIRE.glob('electric_*.csv')), 'wire', 298.0, MAPS / 'nitinol_electric.yaml')
    sizes = {recording.name: len(recording.time) for recording in dataset.recordings}
    assert len(sizes) == 9 and sizes['electric_T21s_duty50_phase50#1'] == 150
    assert all(size > 1000 for name, size in sizes.items() if not name.endswith('#1'))
    for recording in dataset.recordings:
        assert recording.source.values[:, 0].max() < 0.045 and recording.source.values[0, 2] == 294.15
        assert any('the time of the one before' in note for note in recording.notes)
        if recording.source.values[:, 1].any():
            assert not recording.exact_commands


MEMORY = """
import resource, sys
from dataclasses import replace
from pathlib import Path
from sma_sim.evidence.data.rosbag.salvage import open_bag
from sma_sim.evidence.data.rosbag.run_writer import write_mcap
from sma_sim.evidence.data.rosbag.writer import BagWriter
from sma_sim.evidence.data.recordings import read_recording
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
(recording,) = read_recording(Path(sys.argv[1]), 'module', 298.0)
after = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
print(len(recording.time), 1024 * (after - before), *recording.notes, sep='|')
"""


@pytest.mark.slow
@pytest.mark.parametrize('shuffled', [False, True])
def test_memory_of_a_million_rows(tmp_path, shuffled):
    """At most about twice the size of the numbers, in order or not."""
    path, rows = tmp_path / 'long.csv', 1_000_000
    header, block = cells_of(module_columns(50_000))
    order = np.random.default_rng(0).permutation(50_000) if shuffled else np.arange(50_000)
    text = [','.join(block[k][1:]) for k in order]
    with path.open('w') as file:
        file.write(','.join(header) + '\n')
        for part in range(rows // 50_000):
            file.writelines(f'{(50_000 * part + k) / RATE:.2f},{line}\n' for k, line in zip(order, text, strict=True))
    done = subprocess.run([sys.executable, '-c', MEMORY, str(path)], capture_output=True, text=True, timeout=600, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    count, more, *notes = done.stdout.split('|')
    assert int(count) == rows and (not shuffled or 'not in the order of time' in notes[0])
    assert int(more) < 2.2 * 8 * rows * len(header)


def test_text_of_is_what_the_reader_expects(tmp_path):
    """A row of nothing but commas between others is a row without a time."""
    header, rows = cells_of(module_columns(100))
    rows.insert(50, [''] * len(header))
    (tmp_path / 'run.csv').write_text(text_of(header, rows))
    (recording,) = read_recording(tmp_path / 'run.csv', 'module', 298.0)
    assert len(recording.time) == 100 and '1 row without a time: dropped' in recording.notes


def test_every_second_row_of_a_file_that_tells_when_commands_change(tmp_path):
    """Rows of some changes are lost: of these only samples tell, the others stay exact."""
    instants = [2.0071, 4.0071, 5.513, 8.1234]
    columns = with_switching_rows(module_columns(), instants, [5.0, 2.0, -3.0, 0.0])
    half = {name: values[::2] for name, values in columns.items()}
    (recording,) = read_recording(write_recording(tmp_path / 'run.csv', half), 'module', 298.0)
    told = np.isin(instants, half['time_s'])
    assert told.any() and not told.all() and not recording.exact_commands
    changed, interval = sampled_changes(recording)
    assert len(changed) == np.count_nonzero(~told) and not np.isin(changed, instants).any()
    assert np.all(interval < 2.1 / RATE) and np.isin(np.array(instants)[told], recording.source.times).all()
    assert any(f'{len(changed)} of 4 changes' in note for note in recording.notes)


def ramps(top, rest=0):
    """Up and down by 6 K a minute, as of a sensor that shows two decimals and stops at `top`; `rest` rows before."""
    time = 60.0 * np.arange(80 + rest)
    shape = np.concatenate([np.zeros(rest), np.arange(40.0), np.arange(40.0, 0.0, -1.0)])
    return time, np.round(np.minimum(300.0 + 6.0 * shape + 0.7 * np.sin(time), top), 2)


def test_a_sensor_at_the_end_of_its_range_is_noticed():
    time, shown = ramps(480.0)
    stopped = saturated(time, shown)
    assert stopped.sum() == (shown == 480.0).sum() > 15
    assert (saturated(time, -shown) == stopped).all()
    shown[stopped.argmax() + 3] = np.nan
    assert saturated(time, shown).sum() == stopped.sum() - 1


@pytest.mark.parametrize(
    'shown',
    [
        ramps(1000.0)[1],  # a peak
        ramps(1000.0, rest=60)[1],  # at rest before it is heated
        np.round(3.0 * np.sin(np.arange(200.0) / 20.0), 1),  # round peaks of a coarse sensor
        np.repeat(np.round(300.0 + 50.0 * np.sin(np.arange(40.0) / 3.0), 1), 5),  # one that is read slower than it is logged
        np.maximum(np.round(5.0 * np.sin(np.arange(200.0) / 10.0), 2), 0.0),  # the force of a wire that is slack
        np.round(1.0 - np.exp(-np.minimum(np.arange(340.0), 700.0 - 2.0 * np.arange(340.0)) / 10.0), 2),  # comes to rest
    ],
)
def test_what_rests_or_turns_is_no_end_of_a_range(shown):
    assert not saturated(np.arange(len(shown), dtype=float), shown).any()


def test_rows_of_a_sensor_at_the_end_of_its_range_are_missing(tmp_path):
    time, shown = ramps(480.0)
    file = tmp_path / 'run.csv'
    columns = {
        'time_s': time,
        'stress_Pa': np.full(80, 1.5e8),
        'J_W': 0.01 * time / 60.0,
        'T_E_K': np.full(80, 298.0),
        'strain': 1e-3 * np.sin(time),
        'T_K': shown,
    }
    write_columns(file, columns)
    (recording,) = read_dataset([file], 'wire_under_load', 298.0).recordings
    assert np.isnan(recording.channels['T']).sum() == (shown == 480.0).sum()
    assert np.isfinite(recording.channels['strain']).all()
    assert any('its sensor stops at 480' in note for note in recording.notes)
