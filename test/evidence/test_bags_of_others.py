"""Bags of other recorders: which of their commands were in force, and which time base their messages have."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.rosbag2 import StoragePlugin, Writer
from test_bags import MILLISECOND, joint_state, number, pair

from sma_sim.cli.main import main
from sma_sim.evidence.data.recordings import read_dataset
from sma_sim.evidence.data.rosbag.commands import UNLIMITED, CommandLimits, ambient_refusal, in_force
from sma_sim.evidence.data.rosbag.interface import FLOAT64, FLOAT64_ARRAY, JOINT_STATE, TEMPERATURE
from sma_sim.evidence.data.rosbag.reader import read_bag
from sma_sim.evidence.data.rosbag.salvage import repair
from sma_sim.evidence.data.rosbag.writer import BagWriter, typestore
from sma_sim.model.errors import UserError
from sma_sim.model.structures.discovery import known_structures

SECOND = 10**9
LATE = 2 * MILLISECOND  # of the recorder


def celsius(value):
    types = typestore().types
    header = types['std_msgs/msg/Header'](stamp=types['builtin_interfaces/msg/Time'](sec=0, nanosec=0), frame_id='')
    message = types[TEMPERATURE](header=header, temperature=value, variance=0.0)
    return bytes(typestore().serialize_cdr(message, TEMPERATURE))


def bag(path, commands, seconds, topic='/J_eq', kind=FLOAT64, encode=number, log_of=lambda stamp: stamp, ambient=()):
    """Joint states at 100 Hz, commands and ambient temperatures (time [s], value); `log_of` a stamp [ns] is its log time."""
    rows = [(round(t * SECOND), topic, encode(value)) for t, value in commands]
    rows += [(round(t * SECOND), '/ambient_temperature', celsius(value)) for t, value in ambient]
    for k in range(round(100 * seconds) + 1):
        stamp = 10 * k * MILLISECOND
        rows.append((stamp, '/joint_states', joint_state(stamp + SECOND, [1e-5 * k, 0.0, 1e-4 * math.sin(0.1 * k)])))
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connections = {
            '/joint_states': writer.add_connection('/joint_states', JOINT_STATE, typestore=typestore()),
            topic: writer.add_connection(topic, kind, typestore=typestore()),
        }
        if ambient:
            connections['/ambient_temperature'] = writer.add_connection(
                '/ambient_temperature', TEMPERATURE, typestore=typestore()
            )
        for stamp, name, cdr in sorted(rows, key=lambda row: log_of(row[0])):
            writer.write(connections[name], log_of(stamp) + 100 * SECOND, cdr)
    return path


def changes_in(columns, name='J_eq_W'):
    """Times [s] and values where a command changes."""
    at = np.flatnonzero(np.diff(columns[name], prepend=np.nan) != 0.0)
    return columns['time_s'][at], columns[name][at]


COMMANDS = st.lists(
    st.tuples(st.integers(1, 400), st.sampled_from([0.0, 5.0, -9.0, 12.5, -40.0, math.nan, math.inf])),
    min_size=1,
    max_size=12,
    unique_by=lambda command: command[0],
)


@settings(max_examples=200, deadline=None)
@given(commands=COMMANDS, J_max=st.sampled_from([3.0, 10.0, 30.0]), timeout=st.sampled_from([0.0, 0.495, 0.995]))
def test_commands_are_in_force_as_in_the_node(commands, J_max, timeout):
    """Messages at steps of 10 ms, timeouts between two steps, to the node's own class and to the reader."""
    pytest.importorskip('rclpy', reason='rclpy is not installed')
    from sma_sim.ros.command import Command

    quiet = SimpleNamespace(warning=lambda *_, **__: None)
    node, by_step = Command(SimpleNamespace(get_logger=lambda: quiet), J_max, timeout), dict(commands)
    expected = []
    for step in range(600):
        if step in by_step:
            node.receive(SimpleNamespace(data=by_step[step]))
        expected.append(node.at(step / 100)[0])
    when = np.array(sorted(by_step), np.int64) * 10 * MILLISECOND
    J = np.array([[by_step[step] if math.isfinite(by_step[step]) else np.nan] for step in sorted(by_step)])
    times, powers = in_force(when, J, CommandLimits(J_max, timeout), 6 * SECOND)
    last = np.searchsorted(times, np.arange(600) * 10 * MILLISECOND, side='right') - 1
    assert [0.0 if k < 0 else powers[k, 0] for k in last] == expected


def test_commands_that_a_robot_refuses_clips_and_times_out(tmp_path, capsys):
    path = bag(tmp_path / 'bag', [(1.0, 5.0), (2.0, math.nan), (3.0, 9.0), (8.0, -1.0), (8.5, math.inf)], 12.0)
    limits = CommandLimits(J_max=6.0, timeout=2.0)
    columns, notes = read_bag(path, None, known_structures()['module'], limits, found := []), found
    times, powers = changes_in(columns)
    assert powers.tolist() == [0.0, 5.0, 6.0, 0.0, -1.0, 0.0]
    assert times == pytest.approx([0.0, 1.0, 3.0, 5.0, 8.0, 10.0], abs=1e-3)
    assert notes == [
        'J_eq: 2 commands refused (not finite, or not one number for each wire), the first at 2 s: '
        'the one before stays in force',
        'J_eq: 1 commands beyond node.J_max = 6 W, the first at 3 s: clipped',
        'J_eq: no command for node.command_timeout = 2 s, 2 times, the first at 5 s: '
        'heating off until the next one (0: the robot has no timeout)',
    ]
    dataset = read_dataset([path], 'module', 298.0, noise_std={'alpha': 1e-4, 'U_x': 1e-6, 'U_y': 1e-6}, limits=limits)
    assert set(notes) <= set(dataset.recordings[0].notes)
    words = ['--set', 'node.J_max=6', '--set', 'node.command_timeout=2']
    assert main(['simulate', '--input', str(path), '--out', str(tmp_path / 'out.csv'), *words]) == 0
    said = capsys.readouterr().err
    assert all(note in said for note in notes)
    simulated = np.genfromtxt(tmp_path / 'out.csv', delimiter=',', names=True)
    assert set(simulated['J_eq_W']) == {0.0, 5.0, 6.0, -1.0}


def test_nothing_is_said_of_commands_that_are_in_order(tmp_path):
    path = bag(tmp_path / 'bag', [(k / 50, 5.0 * math.sin(k)) for k in range(100)], 3.0)
    read_bag(path, None, None, CommandLimits(), notes := [])
    assert notes == []


def test_a_command_of_several_wires_is_refused_as_a_whole(tmp_path):
    commands = [
        (1.0, [1.0, 2.0, 3.0]),
        (2.0, [4.0, math.nan, 1.0]),
        (3.0, [4.0, 1.0]),
        (4.0, [1.0, -1.0, 0.0]),
        (5.0, [9.0] * 3),
    ]
    path = bag(tmp_path / 'bag', commands, 6.0, '/J', FLOAT64_ARRAY, pair)
    columns = read_bag(path, None, known_structures()['spatial'], UNLIMITED, notes := [])
    assert changes_in(columns, 'J_1_W')[1].tolist() == [0.0, 1.0, 9.0]
    assert changes_in(columns, 'J_3_W')[1].tolist() == [0.0, 3.0, 9.0]
    assert len(notes) == 1 and notes[0].startswith('J: 3 commands refused')


@pytest.mark.parametrize(
    ('told', 'T_E', 'left'),
    [
        ([(0.5, 30.0), (1.0, 298.0), (2.0, math.nan), (3.0, 40.0)], [30.0, 40.0], 'the one before stays in force'),
        ([(1.0, 298.0), (2.0, 299.0)], None, 'environment.T_E counts'),
    ],
)
def test_an_ambient_temperature_in_kelvin_is_refused_as_a_robot_does(tmp_path, told, T_E, left):
    path = bag(tmp_path / 'bag', [(0.1, 0.0)], 4.0, ambient=told)
    columns = read_bag(path, None, None, UNLIMITED, notes := [])
    assert ('T_E_K' in columns) == (T_E is not None)
    assert T_E is None or np.unique(columns['T_E_K']) == pytest.approx(np.add(T_E, 273.15))
    assert notes == [
        'ambient_temperature: 2 messages refused, the first at 1 s: 298 deg C, expected -123.15 deg C to less than 150; '
        f'298 K are 24.85 deg C (where it is so hot, set environment.T_E, in kelvin); {left}'
    ]


@pytest.mark.parametrize(
    ('temperature', 'accepted'),
    [(-123.1, True), (25.0, True), (149.9, True), (150.0, False), (298.0, False), (-123.2, False), (3000.0, False)],
)
def test_a_number_that_can_be_kelvin_is_no_ambient_temperature_in_celsius(temperature, accepted):
    reason = ambient_refusal(temperature)
    assert (reason == '') == accepted and ('K are' in reason) == (150.0 <= temperature <= 2000.0)


def test_what_a_robot_has_applied_needs_no_rules(tmp_path):
    path = bag(tmp_path / 'bag', [(1.0, 50.0), (9.0, 0.0)], 12.0, '/J_eq_applied')
    columns = read_bag(path, None, None, CommandLimits(J_max=6.0, timeout=2.0), notes := [])
    assert changes_in(columns)[1].tolist() == [0.0, 50.0, 0.0] and notes == []


def wall_clock(factor):
    return lambda stamp: round(stamp / factor)


def pausing(stamp):
    """Real time until 4 s, a pause of 2 s, then simulated time three times as fast."""
    return stamp if stamp < 4 * SECOND else 6 * SECOND + (stamp - 4 * SECOND) // 3


@pytest.mark.parametrize('log_of', [wall_clock(3.0), wall_clock(0.25), wall_clock(1.0001), pausing])
@pytest.mark.parametrize('burst', [1, 7])
def test_commands_of_a_recorder_with_another_clock(tmp_path, log_of, burst):
    """Its log times are late by up to 2 ms, and joint states come `burst` at a time."""
    late = np.random.default_rng(3).integers(0, LATE, 10_000)

    def log(stamp):
        if stamp % (10 * MILLISECOND) == 0:  # a joint state, with the last of its burst
            stamp += (-(stamp // (10 * MILLISECOND)) % burst) * 10 * MILLISECOND
        return log_of(stamp) + int(late[stamp // MILLISECOND % len(late)])

    commanded = np.array([1.003, 2.507, 3.899, 4.403, 6.601, 8.209])
    path = bag(tmp_path / 'bag', [(t, float(k + 1)) for k, t in enumerate(commanded)], 9.0, '/J_eq_applied', log_of=log)
    times, powers = changes_in(read_bag(path))
    assert powers.tolist() == [0.0, *range(1, 7)]
    assert times[1:] == pytest.approx(commanded, abs=0.01 + 0.01 * burst)


def test_another_rate_of_the_clock_is_said(tmp_path):
    path = bag(tmp_path / 'bag', [(1.0, 5.0)], 3.0, '/J_eq_applied', log_of=wall_clock(3.0))
    read_bag(path, notes=(notes := []))
    words = (
        'the stamps advance 3 s per second of the log times: J_eq_applied, which have none, get those that belong to their'
    )
    assert notes == [f'{words} log times']


def test_what_a_bag_has_in_place_of_joints_and_commands_is_named(tmp_path):
    other = bag(tmp_path / 'joints', [(1.0, [1.0])], 3.0, '/J', FLOAT64_ARRAY, pair)
    with pytest.raises(UserError, match='expected messages joint_states of the joints position, got U_x, U_y, alpha; name'):
        read_dataset(other, 'slider')
    heated = bag(tmp_path / 'heater', [(1.0, 1.0)], 3.0, '/heater/power')
    with pytest.raises(UserError, match='on /J or /J_applied, got /heater/power, /joint_states; publish or remap'):
        read_dataset(heated, 'slider')


def stamped(names, efforts):
    """A stamped command whose header is not filled in."""
    types = typestore().types
    header = types['std_msgs/msg/Header'](stamp=types['builtin_interfaces/msg/Time'](sec=0, nanosec=0), frame_id='')
    none = np.zeros(0)
    message = types[JOINT_STATE](header=header, name=names, position=none, velocity=none, effort=np.array(efforts))
    return bytes(typestore().serialize_cdr(message, JOINT_STATE))


def written(path, rows):
    """A bag of rows (log time [s], topic, type, message)."""
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connections = {}
        for t, topic, kind, cdr in sorted(rows, key=lambda row: row[0]):
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=typestore())
            writer.write(connections[topic], round((100.0 + t) * SECOND), cdr)
    return path


def joint_states(count, names):
    """Rows of joint states at 100 Hz, of which the last joint moves."""
    still = [0.0] * (len(names) - 1)
    return [
        (0.01 * k, '/joint_states', JOINT_STATE, joint_state(SECOND + 10 * k * MILLISECOND, [*still, 1e-4 * k], names))
        for k in range(count)
    ]


def clock_set_back(path, by, at=6.0):
    """Joint states at 50 Hz, 12 s long, with alpha 1e-3 times the true time; J_eq is 12 W from 2 s on, -6 W from 8 s on."""
    rows = [(t, '/J_eq', FLOAT64, number(value)) for t, value in ((0.0, 0.0), (2.0, 12.0), (8.0, -6.0))]
    for k in range(601):
        stamp = k * 20 * MILLISECOND - (round(by * SECOND) if 0.02 * k > at else 0)
        rows.append((0.02 * k, '/joint_states', JOINT_STATE, joint_state(50 * SECOND + stamp, [0.0, 0.0, 2e-5 * k])))
    return written(path, rows)


@pytest.mark.parametrize('by', [3.0, 3.01, 7.01, 40.0])
def test_a_clock_that_is_set_back_begins_another_session(tmp_path, by):
    """Samples are never mixed, whether or not the stamps of both sessions make one grid."""
    path = clock_set_back(tmp_path / 'run', by)
    first, second = read_dataset([path]).recordings
    assert [first.name, second.name] == ['run#1', 'run#2'] and len(first.time) + len(second.time) == 601
    np.testing.assert_allclose(np.diff(first.channels['alpha']), 2e-5, rtol=1e-9)
    np.testing.assert_allclose(np.diff(second.channels['alpha']), 2e-5, rtol=1e-9)
    np.testing.assert_allclose(second.channels['alpha'], 1e-3 * (second.time + by), rtol=1e-9)
    times, powers = second.source.times, np.asarray(second.source.values)[:, 0]
    assert powers[0] == 12.0 and times[np.argmax(powers < 0.0)] == pytest.approx(8.0 - by, abs=0.021)
    assert sum('2 sessions' in note for note in first.notes) == 1
    with pytest.raises(UserError, match=r'stamps go back 1 time, first by .* expected one run|Expected one run'):
        read_bag(path)


def test_a_clock_that_is_set_back_by_little_drops_samples_until_it_has_caught_up(tmp_path):
    (only,) = read_dataset([clock_set_back(tmp_path / 'run', 0.13)]).recordings
    assert (np.diff(only.channels['alpha']) > 0.0).all() and len(only.time) == 601 - 6
    assert any('the clock jumps back by 0.11 s' in note for note in only.notes)


def test_a_table_of_two_periods_that_make_one_grid_is_not_sorted(tmp_path):
    """What `bag convert` writes of such a bag."""
    path = clock_set_back(tmp_path / 'run', 3.01)
    assert main(['bag', 'convert', str(path), str(tmp_path / 'run.csv')]) == 0
    dataset = read_dataset([tmp_path / 'run.csv'])
    assert [len(one.time) for one in dataset.recordings] == [301, 300]


def test_a_bag_with_two_clocks_is_refused(tmp_path):
    rows = [(0.0, '/J_eq', FLOAT64, number(0.0))]
    for k in range(400):
        stamp = SECOND + (k // 2 + 100 * (k % 2)) * 20 * MILLISECOND
        rows.append((0.01 * k, '/joint_states', JOINT_STATE, joint_state(stamp, [0.0, 0.0, 1e-4 * k])))
    with pytest.raises(UserError, match='are two mixed in this file'):
        read_dataset([written(tmp_path / 'two', rows)])


def test_commands_with_a_stamp_count_as_those_without(tmp_path):
    """As they arrive; those that a robot refuses are refused here."""
    states = joint_states(401, ('U_x', 'U_y', 'alpha'))
    commands = [(0.0, '/J_eq', FLOAT64, number(0.0)), (2.0, '/J_eq', FLOAT64, number(-3.0))]
    with_stamp = [(1.0, ['J_eq'], [12.0]), (1.5, ['other'], [1.0]), (3.0, [], [5.0]), (3.5, ['J_eq'], [math.nan])]
    commands += [(t, '/J_eq_stamped', JOINT_STATE, stamped(names, efforts)) for t, names, efforts in with_stamp]
    notes = []
    columns = read_bag(written(tmp_path / 'both', [*states, *commands]), notes=notes)
    times, values = changes_in(columns)
    np.testing.assert_allclose(times, [0.0, 1.0, 2.0, 3.0], atol=1e-6)
    assert list(values) == [0.0, 12.0, -3.0, 5.0] and '2 commands refused' in notes[0]
    columns = read_bag(written(tmp_path / 'stamped', [*states, *commands[2:]]))
    assert list(changes_in(columns)[1]) == [0.0, 12.0, 5.0]


def test_stamped_commands_of_several_wires_tell_the_structure(tmp_path):
    command = stamped(['J_1', 'J_2', 'J_3'], [1.0, 2.0, 3.0])
    names = list(known_structures()['spatial'].coordinate_names)
    states = joint_states(50, names)
    columns = read_bag(written(tmp_path / 'spatial', [*states, (0.1, '/J_stamped', JOINT_STATE, command)]))
    assert [columns[f'J_{i}_W'][-1] for i in (1, 2, 3)] == [1.0, 2.0, 3.0]


def test_joints_that_come_one_by_one_with_one_stamp_are_one_sample(tmp_path):
    rows = [(0.0, '/J_eq', FLOAT64, number(0.0))]
    for k in range(100):
        at = SECOND + 10 * k * MILLISECOND
        rows += [(0.01 * k + 1e-5 * i, '/joint_states', JOINT_STATE, joint_state(at, [value * k], [name]))
                 for i, (name, value) in enumerate((('U_x', 1e-5), ('alpha', 1e-4)))]  # fmt: skip
    (recording,) = read_dataset([written(tmp_path / 'split', rows)]).recordings
    assert list(recording.channels) == ['U_x', 'alpha'] and len(recording.time) == 100
    np.testing.assert_allclose(recording.channels['alpha'], 1e-4 * np.arange(100), atol=1e-12)


def test_a_bag_with_wrong_bytes_names_its_cure(tmp_path, capsys):
    path = bag(tmp_path / 'damaged', [(0.0, 0.0), (1.0, 5.0)], 30.0)
    (file,) = path.glob('*.mcap')
    whole = file.read_bytes()
    at = whole.index(b'\x05r\0\0\0\0\0\0\0', len(whole) // 4)  # a message of 114 bytes
    file.write_bytes(whole[: at + 7] + b'\xff\xff' + whole[at + 9 :])
    for words in (
        ['bag', 'info', str(path)],
        ['compare', str(path)],
        ['bag', 'convert', str(path), str(tmp_path / 'a.csv')],
    ):
        assert main(words) == 2
        said = capsys.readouterr().err
        assert 'is damaged (' in said and f'`sma-sim bag repair {path}` writes what can be read' in said, said


def test_nothing_is_left_of_a_bag_that_could_not_be_written(tmp_path, monkeypatch):
    """The disk is full when its metadata are written, or when a message is."""
    path = bag(tmp_path / 'run', [(0.0, 0.0)], 1.0)
    for method in ('write_metadata', 'write'):
        with monkeypatch.context() as full:

            def fail(*_):
                raise OSError(28, 'No space left on device')

            full.setattr(BagWriter, method, fail)
            with pytest.raises(UserError, match='No space left on device'):
                repair(path, tmp_path / 'whole')
        assert not (tmp_path / 'whole').exists()
    assert repair(path, tmp_path / 'whole') == 102


@pytest.mark.parametrize(
    ('header', 'row', 'words'),
    [
        ('time_s,J_eq', '0,1', 'no column J_eq_W (rename J_eq; the unit is part of the name)'),
        ('time_s,J_eq_mW', '0,1', 'J_eq_mW multiplied by 0.001'),
        ('time_s,J_eq_W', '0,', "got 'nothing'; write the number that holds there, or delete the row"),
    ],
)
def test_what_cannot_be_converted_names_its_cure(tmp_path, capsys, header, row, words):
    (tmp_path / 'run.csv').write_text(f'{header}\n{row}\n1,2\n')
    assert main(['bag', 'convert', str(tmp_path / 'run.csv'), str(tmp_path / 'run.mcap')]) == 2
    assert words in capsys.readouterr().err


def test_a_bag_is_not_converted_to_a_bag(tmp_path, capsys):
    path = bag(tmp_path / 'run', [(0.0, 0.0)], 1.0)
    assert main(['bag', 'convert', str(path), str(tmp_path / 'again.mcap')]) == 2
    assert f'{path} is a bag: expected a CSV file' in capsys.readouterr().err
