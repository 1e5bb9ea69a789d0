"""The node over real DDS, as a plain rclpy client sees it."""

import math
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import yaml

from sma_sim import Config, Input, Model
from sma_sim.model.given import flatten, read_yaml
from sma_sim.model.program_parameters import DEFAULTS, SETTINGS
from sma_sim.solver.fixed_rate import simulate_fixed_rate

ros_client = pytest.importorskip('ros_client', reason='rclpy is not installed', exc_type=ImportError)
from sensor_msgs.msg import JointState, Temperature  # noqa: E402
from std_msgs.msg import Float64, Float64MultiArray, UInt8MultiArray  # noqa: E402

ROOT = Path(__file__).resolve().parents[2]
TOPICS = (
    (JointState, 'joint_states'),
    (JointState, 'wire_states'),
    (Float64MultiArray, 'wire_forces'),
    (UInt8MultiArray, 'wire_modes'),
    (Temperature, 'wire_1/temperature'),
    (Temperature, 'wire_2/temperature'),
    (Float64MultiArray, 'phase_fractions'),
    (Float64, 'J_eq_applied'),
)


def alphas(simulation):
    return np.array([message.position[2] for message in simulation.seen['joint_states']])


def stamp(message):
    return message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec


def test_topics_and_bit_identical_replay():
    words = ('--params-file', 'config/module.yaml', '-p', 'node.stamps_follow_clock:=false')  # an overrun moves no stamp
    with ros_client.Simulation(*words, topics=TOPICS) as one:
        seen = one.seen
        command = one.publisher(Float64, 'J_eq')
        one.until(lambda: all(seen[topic] for _, topic in TOPICS), ros_client.FIRST_MESSAGE)
        command.publish(Float64(data=12.0))
        one.until(lambda: seen['J_eq_applied'][-1].data == 12.0)
        one.until(lambda: abs(alphas(one)[-1]) > math.radians(1.0))
        code, log = one.stop()
    assert code == 0, log
    joints, wires = seen['joint_states'][-1], seen['wire_states'][-1]
    assert list(joints.name) == ['U_x', 'U_y', 'alpha'] and list(wires.name) == ['wire_1', 'wire_2']
    assert len(joints.velocity) == len(joints.effort) == 3
    assert joints.effort[0] < -20.0  # both bundles pull the plate towards the clamp
    assert all(0.095 < length < 0.105 for length in wires.position)
    assert list(seen['wire_forces'][-1].data) == pytest.approx(list(wires.effort), rel=0.05)
    assert 'wire_1' in seen['wire_forces'][-1].layout.dim[0].label
    assert seen['wire_1/temperature'][-1].temperature > seen['wire_2/temperature'][-1].temperature > 24.0
    assert set(seen['wire_modes'][-1].data) <= {1, 2, 3, 4, 5}
    assert np.diff([stamp(m) for m in seen['joint_states']]) == pytest.approx(0.01, abs=1e-6)
    assert_replays(seen, float(re.search(r'simulated time 0 has the stamp ([0-9.]+)', log).group(1)))


def assert_replays(seen, epoch):
    """From the step on at which the command took effect, an offline run gives the same alpha, bit for bit."""
    steps = np.array([round((stamp(message) - epoch) * 1000.0) for message in seen['joint_states']])
    alpha = np.array([message.position[2] for message in seen['joint_states']])
    heated = [message for message in seen['wire_1/temperature'] if message.temperature > 298.0 - 273.15 + 1e-6]
    first = round((stamp(heated[0]) - epoch) * 1000.0)

    def is_replayed(late):
        begin = (first - 1 - late) / 1000.0
        if begin <= 0.0:
            return False
        times, values = np.array([0.0, begin, steps[-1] / 1000.0]), np.array([[0.0, 298.0], [12.0, 298.0], [12.0, 298.0]])
        run = simulate_fixed_rate(Model(Config()), Input(times, values, (False, False)), 1000.0, 100.0)
        return np.array_equal(run['alpha_rad'][steps // 10], alpha)

    # The command came at one of the ten steps between two samples, or earlier where samples of the temperature were lost.
    assert any(is_replayed(late) for late in range(50))


def test_jumps_are_published_between_samples():
    topics = ((UInt8MultiArray, 'wire_modes'), (JointState, 'joint_states'))
    with ros_client.Simulation('-p', 'node.publish_rate:=1.0', topics=topics) as one:
        command = one.publisher(Float64, 'J_eq')
        one.until(lambda: one.seen['joint_states'], ros_client.FIRST_MESSAGE)
        command.publish(Float64(data=12.0))
        one.until(lambda: len(one.seen['wire_modes']) > len(one.seen['joint_states']) + 1)
        assert one.stop()[0] == 0


def test_bad_commands_are_refused_or_clipped():
    topics = ((Float64, 'J_eq_applied'), (JointState, 'joint_states'))
    with ros_client.Simulation('-p', 'node.J_max:=9.0', '-p', 'node.command_timeout:=1.0', topics=topics) as one:
        applied = one.seen['J_eq_applied']
        command = one.publisher(Float64, 'J_eq')
        one.until(lambda: applied, ros_client.FIRST_MESSAGE)
        for data in (5.0, math.nan, -math.inf, -50.0):
            command.publish(Float64(data=data))
        one.until(lambda: len(applied) > 1 and applied[-1].data == -9.0)
        one.until(lambda: applied[-1].data == 0.0)
        code, log = one.stop()
    assert code == 0
    assert {message.data for message in applied} <= {0.0, 5.0, -9.0}
    assert 'J_eq = nan W refused' in log
    assert 'J_eq = -50 W clipped to node.J_max = 9 W' in log
    assert 'no command for node.command_timeout = 1 s: heating is off' in log


def test_ambient_temperature_and_namespace():
    topics = ((Temperature, 'wire_2/temperature'),)
    with ros_client.Simulation('-r', '__ns:=/left', topics=topics, namespace='/left') as one:
        ambient = one.publisher(Temperature, 'ambient_temperature')
        seen = one.seen['wire_2/temperature']
        one.until(lambda: seen, ros_client.FIRST_MESSAGE)
        assert seen[0].temperature == pytest.approx(298.0 - 273.15)
        for refused in (298.0, -400.0):
            ambient.publish(Temperature(temperature=refused))
        ambient.publish(Temperature(temperature=40.0))
        one.until(lambda: abs(seen[-1].temperature - 40.0) < 0.5)
        code, log = one.stop()
    assert code == 0 and max(message.temperature for message in seen) < 41.0
    assert 'ambient_temperature = 298.0 deg C refused: ' in log and '298 K are 24.85 deg C' in log


def test_sensing_effect_shows_both_poses(tmp_path):
    file = tmp_path / 'lag.yaml'
    lag = {'active': ['sensor_lag'], 'sensor_lag': {'tau': 0.5}}
    file.write_text(yaml.safe_dump({'/**': {'ros__parameters': {'effects': lag}}}))
    topics = ((JointState, 'joint_states'), (JointState, 'true_joint_states'))
    with ros_client.Simulation('--params-file', str(file), topics=topics) as one:
        command = one.publisher(Float64, 'J_eq')
        one.until(lambda: one.seen['true_joint_states'], ros_client.FIRST_MESSAGE)
        command.publish(Float64(data=12.0))
        one.until(lambda: one.seen['true_joint_states'][-1].position[2] > 0.02)
        true = one.seen['true_joint_states'][-1]
        one.until(lambda: stamp(one.seen['joint_states'][-1]) >= stamp(true))
        shown = next(m for m in one.seen['joint_states'] if stamp(m) == stamp(true))
        assert 0.0 < shown.position[2] < 0.9 * true.position[2]
        assert one.stop()[0] == 0


@pytest.mark.parametrize(
    ('words', 'message'),
    [
        (['-p', 'wire.E_X:=1e9'], 'unknown parameter wire.E_X'),
        (['-p', 'system:=cantilever'], "system = 'cantilever' (given to the node): expected one of "),
        pytest.param(
            ['-p', 'node.steps_per_call:=1.5'],
            'node.steps_per_call = 1.5: expected a whole number of steps',
            marks=pytest.mark.slow,
        ),
        pytest.param(
            ['-p', 'node.publish_rate:=300.0'],
            '300 samples per second do not divide 1000 steps per second',
            marks=pytest.mark.slow,
        ),
        (['--params-file', '/nowhere.yaml'], '/nowhere.yaml'),
        pytest.param(['-p', 'wire.E_A'], 'wire.E_A', marks=pytest.mark.slow),
        (['-p', 'beam.L:=0.05'], 'check wire.l0 = 0.0957 m against beam.L = 0.05 m'),
    ],
)
def test_wrong_parameters_stop_the_node(words, message):
    command = [sys.executable, '-m', 'sma_sim.ros.main', '--ros-args', *words]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=120)
    assert done.returncode == 2, done.stderr
    assert message in done.stderr
    assert 'Traceback' not in done.stderr


@pytest.mark.parametrize(
    ('content', 'message'),
    [
        ('/other_node:\n  ros__parameters:\n    model: mas\n', 'has nothing for this node'),
        ('/**:\n  ros__parameters:\n    wire:\n      E_A:\n', 'wire.E_A = None'),
    ],
)
def test_wrong_parameter_files_stop_the_node(tmp_path, content, message):
    (tmp_path / 'robot.yaml').write_text(content)
    test_wrong_parameters_stop_the_node(['--params-file', str(tmp_path / 'robot.yaml')], message)


def test_ctrl_c_ends_the_first_compilation(tmp_path):
    environment = os.environ | {'XDG_CACHE_HOME': str(tmp_path), 'PYTHONUNBUFFERED': '1', 'ROS_DOMAIN_ID': '103'}
    process = subprocess.Popen(
        [sys.executable, '-m', 'sma_sim.ros.main'], cwd=ROOT, env=environment, stderr=subprocess.PIPE, text=True
    )
    assert any('compiling' in line for line in process.stderr)
    with ros_client.listener(environment['ROS_DOMAIN_ID']) as listener:
        end = time.monotonic() + 4.0
        while time.monotonic() < end:  # a node that compiles would answer nothing: it is not there yet
            assert 'sma_module_sim' not in listener.get_node_names()
            time.sleep(0.1)
    process.send_signal(signal.SIGINT)
    _, log = process.communicate(timeout=60)
    assert process.returncode == 0 and 'Traceback' not in log and 'running' not in log, log


def test_module_yaml_has_every_parameter_at_its_default():
    given = flatten(read_yaml(ROOT / 'config' / 'module.yaml'))
    for name, parameter in DEFAULTS.items():
        assert given[name] == parameter.default or math.isnan(given[name]) and math.isnan(parameter.default), name
    assert {name: given[name] for name in SETTINGS} == {name: setting.default for name, setting in SETTINGS.items()}
    others = {'system', 'model', 'effects.active', 'effects.paths', 'structures.paths'}
    assert set(given) - set(DEFAULTS) - set(SETTINGS) == others | {'check.noise_R_1', 'check.noise_R_2'}


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_step_response_stopped_before_anything_came(tmp_path, number):
    words = [sys.executable, str(ROOT / 'examples' / 'step_response.py'), 'step.csv']
    environment = os.environ | {'ROS_DOMAIN_ID': '102', 'PYTHONUNBUFFERED': '1'}
    with subprocess.Popen(
        words, cwd=tmp_path, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    ) as example:
        first = example.stdout.readline()
        example.send_signal(number)
        log, _ = example.communicate(timeout=60)
    assert 'waiting' in first and log == 'stopped before a joint state came: nothing is written\n', log
    assert example.returncode == 1 and not list(tmp_path.iterdir())


def test_step_response_example(tmp_path):
    """The README's first five minutes: node, step, file, picture."""
    with ros_client.Simulation(topics=((JointState, 'joint_states'),)) as one:
        one.until(lambda: one.seen['joint_states'], ros_client.FIRST_MESSAGE)
        words = [sys.executable, str(ROOT / 'examples' / 'step_response.py'), '--ros-args', '--log-level', 'warn']
        done = subprocess.run(words, cwd=tmp_path, env=one.environment, capture_output=True, text=True, timeout=60)
        assert done.returncode == 0, done.stderr
        assert one.stop()[0] == 0
    table = np.genfromtxt(tmp_path / 'step.csv', delimiter=',', names=True)
    assert np.degrees(table['alpha_rad']).max() > 2.0 and table['T_1_K'].max() > 330.0
    words = [sys.executable, '-m', 'sma_sim.cli.main', 'plot', 'step.csv']
    assert subprocess.run(words, cwd=tmp_path, env=one.environment | {'PYTHONPATH': str(ROOT)}).returncode == 0
    assert (tmp_path / 'step.png').stat().st_size > 10_000
