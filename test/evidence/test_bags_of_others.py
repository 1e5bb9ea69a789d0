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
from sma_sim.evidence.data.rosbag.writer import typestore
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
