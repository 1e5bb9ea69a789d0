"""The node `sma_guard` between a controller and a robot, over real DDS: this client plays controller, robot and observer."""

import json
import subprocess
import sys
import time
from contextlib import ExitStack

import numpy as np
import pytest

ros_client = pytest.importorskip('ros_client', reason='rclpy is not installed', exc_type=ImportError)
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus  # noqa: E402
from sensor_msgs.msg import JointState, Temperature  # noqa: E402
from std_msgs.msg import Float64, Float64MultiArray, MultiArrayDimension, MultiArrayLayout, UInt8MultiArray  # noqa: E402

from sma_sim import Config, Model  # noqa: E402
from sma_sim.ros.command import GUARDED_TIMEOUT  # noqa: E402
from sma_sim.ros.guard_node import POLL_PERIOD, WireGuard  # noqa: E402
from sma_sim.ros.messages import stamp_of  # noqa: E402

GUARD = 'sma_sim.ros.guard_main'
TOPICS = ((Float64, 'J_eq'), (DiagnosticArray, '/diagnostics'))
PARTS = ('controller', 'robot', 'observer')


CONTROLLER = """
import rclpy, time
from std_msgs.msg import Float64
rclpy.init()
publisher = rclpy.create_node('controller').create_publisher(Float64, 'J_eq_requested', 10)
while True:
    publisher.publish(Float64(data=4.0))
    time.sleep(0.02)
"""
MODULES = {'robot': 'sma_sim.ros.main', 'observer': 'sma_sim.ros.observer_main', 'guard': GUARD}


class World:
    """Everything about a guard that is not the guard."""

    def __init__(self, one):
        self.one, self.asked, self.T, self.variance, self.dead = one, 6.0, 60.0, 1.0, set()
        self.request = one.node.create_publisher(Float64, 'J_eq_requested', 10)
        self.joints = one.node.create_publisher(JointState, 'joint_states', 10)
        self.temperatures = [one.node.create_publisher(Temperature, f'estimated/wire_{i}/temperature', 10) for i in (1, 2)]
        self.arrays = [
            one.node.create_publisher(Float64MultiArray, f'estimated/{name}', 10)
            for name in ('phase_fractions', 'wire_stresses')
        ]
        self.modes = one.node.create_publisher(UInt8MultiArray, 'estimated/wire_modes', 10)
        one.until(lambda: self.modes.get_subscription_count() > 0, ros_client.FIRST_MESSAGE)
        one.until(lambda: self.request.get_subscription_count() > 0)

    def say(self):
        """One message of everybody who lives."""
        stamp = self.one.node.get_clock().now().to_msg()
        if 'robot' not in self.dead:
            message = JointState(name=['U_x', 'U_y', 'alpha'], position=[-5e-5, 0.0, 0.0])
            message.header.stamp = stamp
            self.joints.publish(message)
        if 'observer' not in self.dead:
            for publisher, T in zip(self.temperatures, (self.T, 25.0), strict=True):
                message = Temperature(temperature=T, variance=self.variance)
                message.header.stamp = stamp
                publisher.publish(message)
            for publisher, data in zip(self.arrays, ([0.3, 0.5, 0.03, 0.03], [1e8, 8e7, 1e6, 1e6]), strict=True):
                publisher.publish(Float64MultiArray(data=data))
            self.modes.publish(UInt8MultiArray(data=[5, 3]))
        if 'controller' not in self.dead:
            self.request.publish(Float64(data=self.asked))

    def until(self, condition):
        end = time.monotonic() + ros_client.REACTION
        while not condition():
            assert self.one.process.poll() is None, self.one.process.stdout.read()
            assert time.monotonic() < end, 'waited in vain'
            self.say()
            self.one.executor.spin_once(timeout_sec=0.01)

    def until_in_force(self, J):
        """Until this command comes out, however long what was sent before takes."""
        del self.one.seen['J_eq'][:]
        self.until(lambda: self.one.seen['J_eq'] and self.one.seen['J_eq'][-1].data == pytest.approx(J))


def status(one):
    """The last that sma_guard said of itself."""
    found = [s for m in one.seen['/diagnostics'] for s in m.status if s.name.endswith('sma_guard')]
    return found[-1] if found else DiagnosticStatus()


def values(one):
    return {pair.key: pair.value for pair in status(one).values}


def test_whoever_is_silent_turns_the_heating_off(tmp_path):
    """Silence is told apart from a busy machine: half a second of it."""
    file = tmp_path / 'guard.json'
    words = ('-p', 'guard.silence:=0.5', '-p', f'guard.counters:={file}')
    with ros_client.Simulation(*words, topics=TOPICS, module=GUARD) as one:
        world = World(one)
        world.until_in_force(6.0)
        for part in PARTS:
            world.dead = {part}
            world.until_in_force(0.0)
            world.until(lambda part=part: f'the {part} is silent' in status(one).message)
            assert status(one).level == DiagnosticStatus.WARN
            world.dead = set()
            world.until_in_force(6.0)
        code, log = one.stop()
        assert code == 0 and 'Traceback' not in log, log
        assert all(f'the {part} is silent' in log for part in PARTS)
    counts = json.loads(file.read_text())
    assert all(counts['interventions'][f'the {part} is silent'] >= 1 for part in PARTS)


def test_what_is_taken_away_is_said_with_its_reason():
    with ros_client.Simulation('-p', 'guard.T_max:=350.0', '-p', 'guard.silence:=2.0', topics=TOPICS, module=GUARD) as one:
        world = World(one)
        world.until_in_force(6.0)
        world.asked, world.T = 25.0, 70.0
        world.until(lambda: 0.0 < one.seen['J_eq'][-1].data < 24.0)
        world.until(lambda: 'T of wire 1 would be' in status(one).message)
        assert int(values(one)['interventions: temperature']) >= 1
        assert 0.0 < float(values(one)['part of the command in force']) < 1.0
        world.T, world.asked = 30.0, float('nan')
        world.until_in_force(0.0)
        world.until(lambda: 'expected a finite number' in status(one).message)
        world.asked, world.variance = 6.0, 900.0
        world.until(lambda: 'T of wire 1 is known to 30.0 K only' in status(one).message)
        assert one.seen['J_eq'][-1].data == 0.0
        world.variance = float('nan')
        world.until_in_force(0.0)
        world.variance = 1.0
        world.until_in_force(6.0)
        del one.seen['J_eq'][:]
        code, log = one.stop()
        for _ in range(20):
            one.executor.spin_once(timeout_sec=0.05)
        assert code == 0 and 'guard.T_max 350 K' in log and 'Traceback' not in log, log
        assert one.seen['J_eq'][-1].data == 0.0  # the last that a robot hears


@pytest.mark.parametrize(('kind', 'topic'), [(Float64, 'J_eq'), (JointState, 'J_eq_stamped')])
def test_nothing_is_heated_while_another_node_commands_past_the_guard(kind, topic):
    """What it cannot limit it does not add to."""
    with ros_client.Simulation('-p', 'guard.silence:=2.0', topics=TOPICS, module=GUARD) as one:
        world = World(one)
        world.until_in_force(6.0)
        other = one.node.create_publisher(kind, topic, 10)
        world.until_in_force(0.0)
        world.until(lambda: f'another node publishes {topic} past the guard' in status(one).message)
        assert '-r J_eq:=J_eq_requested' in status(one).message
        one.node.destroy_publisher(other)
        world.until_in_force(6.0)
        assert one.stop()[0] == 0


def messages(at, T=40.0, behind=0.0):
    """One message of everybody, by who says it and topic, with the stamp `at` [s]; the observer's is of so long before."""
    arrays = {'phase_fractions': [0.3, 0.5, 0.03, 0.03], 'wire_stresses': [1e8, 8e7, 1e6, 1e6]}
    joints = JointState(name=['U_x', 'U_y', 'alpha'], position=[-5e-5, 0.0, 0.0])
    joints.header.stamp = stamp_of(round(1e9 * at))
    temperatures = {f'estimated/wire_{i}/temperature': Temperature(temperature=T, variance=1.0) for i in (1, 2)}
    for message in temperatures.values():
        message.header.stamp = stamp_of(round(1e9 * (at - behind)))
    return {
        'controller': {'J_eq_requested': Float64(data=6.0)},
        'robot': {'joint_states': joints},
        'observer': temperatures
        | {f'estimated/{name}': Float64MultiArray(data=data) for name, data in arrays.items()}
        | {'estimated/wire_modes': UInt8MultiArray(data=[5, 3])},
    }


@pytest.mark.parametrize('part', PARTS)
def test_zero_follows_the_last_message_of_a_part_within_the_silence_and_one_look(part):
    """In times that are given, not those of a clock; 0.2 s are asked for."""
    config = Config()
    bound = config.parameters['guard.silence'] + POLL_PERIOD
    assert bound <= 0.2 and GUARDED_TIMEOUT + 1.0 / config.parameters['node.integration_rate'] <= 0.2
    with ros_client.listener(ros_client.any_domain()) as node:
        guard, dead_at, last, off_at = WireGuard(node, config, False), 100.5, 0.0, None
        for k in range(500):
            now = 100.0 + k * POLL_PERIOD
            for who, said in messages(now).items() if k % 5 == 0 else ():
                for topic, message in said.items() if who != part or now < dead_at else ():
                    guard.hear(topic, message, now)
                    last = now if who == part else last
            J_eq = guard.look(now).J_eq
            assert J_eq in ((0.0,), (6.0,))
            assert off_at is None or J_eq == (0.0,)
            off_at = now if off_at is None and J_eq == (0.0,) else off_at
        assert off_at is not None and dead_at < off_at <= last + bound + 1e-9


def of_slider(T, asked):
    """One message of everybody about a slider, by topic, of a wire that is so hot [K]."""
    joints = JointState(name=['position'], position=[0.0])
    joints.header.stamp = stamp_of(10**11)
    temperature = Temperature(temperature=T - 273.15, variance=1.0)
    temperature.header.stamp = joints.header.stamp
    return {
        'J_requested': asked,
        'joint_states': joints,
        'estimated/wire_1/temperature': temperature,
        'estimated/phase_fractions': Float64MultiArray(data=[0.5, 0.03]),
        'estimated/wire_stresses': Float64MultiArray(data=[1e8, 1e6]),
        'estimated/wire_modes': UInt8MultiArray(data=[3]),
    }


def heating_of(*J, sizes=(), offset=0):
    dimensions = [MultiArrayDimension(size=size) for size in sizes]
    return Float64MultiArray(data=J, layout=MultiArrayLayout(dim=dimensions, data_offset=offset))


@pytest.mark.parametrize(
    ('asked', 'words'),
    [
        (heating_of(-1.0), 'J_requested = -1 W, expected no negative number'),
        (heating_of(float('nan')), 'J_requested = nan W, expected a finite number'),
        (heating_of(1.0, 1.0), 'J_requested = 1, 1 W, expected one number [W], got 2'),
        (heating_of(1.0, sizes=(3,)), 'got a layout of the sizes [3] and the offset 0'),
        (heating_of(1.0, offset=1), 'got a layout of the sizes [] and the offset 1'),
    ],
)
def test_a_command_that_the_robot_would_refuse_turns_the_heating_off(asked, words):
    """Passed on it would leave the one before in force, which heats until the robot's own timeout."""
    with ros_client.listener(ros_client.any_domain()) as node:
        guard, now = WireGuard(node, Config(system='slider'), False), 100.0
        for message, J in ((heating_of(2.0, sizes=(1,)), 2.0), (asked, 0.0)):
            for topic, said in of_slider(320.0, message).items():
                guard.hear(topic, said, now)
            decision = guard.look(now)
            assert decision.J_eq == (J,)
        assert decision.kind == 'a command that a robot refuses' and words in decision.reason


def test_a_robot_that_does_not_obey_is_told(monkeypatch):
    """Nothing is asked for, so that nothing is taken away; and yet the wire is hot."""
    with ros_client.listener(ros_client.any_domain()) as node:
        guard, said = WireGuard(node, Config({'guard.T_max': 360.0}, system='slider'), False), []
        monkeypatch.setattr(guard._diagnostics, 'publish', lambda message, warn, values: said.append((message, warn)))
        for now, T in ((100.0, 359.0), (100.01, 540.6)):
            for topic, message in of_slider(T, heating_of(0.0)).items():
                guard.hear(topic, message, now)
            assert guard.look(now).J_eq == (0.0,)
            guard._diagnose()
        assert said == [
            ('all that is asked for is in force', False),
            (
                'all that is asked for is in force; T of wire 1 is 540.6 K, beyond guard.T_max 360 K, at J = 0 W: does the '
                'robot obey it?',
                True,
            ),
        ]


def test_less_is_let_through_while_the_next_estimate_does_not_come():
    config = Config({'guard.T_max': 350.0})
    with ros_client.listener(ros_client.any_domain()) as node:
        guard, allowed = WireGuard(node, config, False), []
        for k in range(70):
            now = 100.0 + k * POLL_PERIOD
            for who, said in messages(now, T=60.0).items() if k % 5 == 0 else ():
                for topic, message in said.items() if who != 'observer' or k == 0 else ():
                    guard.hear(topic, Float64(data=25.0) if who == 'controller' else message, now)
            allowed.append(guard.look(now).J_eq[0])
        assert all(np.diff(allowed) <= 0.0) and 2.0 < allowed[-1] < 0.6 * allowed[0]


@pytest.mark.parametrize(('behind', 'J_eq'), [(0.02, 6.0), (0.14, 6.0), (0.16, 0.0), (10.0, 0.0)])
def test_an_estimate_of_long_ago_is_none(behind, J_eq):
    """An observer with too little of a processor publishes all the same, of a time that is over."""
    with ros_client.listener(ros_client.any_domain()) as node:
        guard = WireGuard(node, Config({'guard.T_max': 450.0}), False)
        for k in range(100):
            now = 100.0 + 0.01 * k
            for said in messages(now, behind=behind).values():
                for topic, message in said.items():
                    guard.hear(topic, message, now)
            decision = guard.look(now)
        assert decision.J_eq == (J_eq,) and ('the observer is behind' in decision.reason) == (J_eq == 0.0)


def heated(config, pace, behind, asked, seconds):
    """Temperatures [K] of a wire that does not transform, heating in force [W] and the last decision, behind a guard whose
    observer is so many seconds of the robot behind; its clock is `pace` times as fast. Commands act one look later."""
    w = Model(config).wire
    cooling, dt = w.lambda_ * w.surface, pace * POLL_PERIOD
    decay = np.exp(-cooling * dt / (w.volume * w.rho * w.c_V))
    T, J, every = [298.0], [0.0], max(round(0.01 / dt), 1)
    with ros_client.listener(ros_client.any_domain()) as node:
        guard = WireGuard(node, config, False)
        for k in range(round(seconds / dt)):
            now, past = 100.0 + k * POLL_PERIOD, max(k - round(behind / dt), 0)
            said = messages(50.0 + dt * k, T[past] - 273.15, dt * (k - past))
            for who, by_topic in said.items() if k % every == 0 else ():
                for topic, message in by_topic.items():
                    guard.hear(topic, Float64(data=asked(k * dt)) if who == 'controller' else message, now)
            T.append(T[-1] * decay + (298.0 + J[-1] / (w.n * cooling)) * (1.0 - decay))
            decision = guard.look(now)
            J += decision.J_eq
    return np.array(T), np.array(J), decision


@pytest.mark.parametrize(('pace', 'behind'), [(1.0, 0.0), (1.0, 0.12), (3.0, 0.12), (3.0, 0.3), (8.0, 0.12)])
def test_limits_hold_in_the_time_of_a_robot_that_is_faster_than_a_clock(pace, behind):
    """Also where its observer is behind and the command changes meanwhile."""
    config = Config({'guard.T_max': 350.0, 'guard.margin': 0.0})
    T, J, _ = heated(config, pace, behind, lambda t: 25.0 if t % 0.3 < 0.2 else 2.0, 6.0)
    assert 340.0 < T.max() < 350.5 and J.max() > 15.0


def test_a_robot_that_is_too_fast_to_be_guarded_is_not_heated():
    T, _, decision = heated(Config(), 40.0, 0.0, lambda t: 25.0, 60.0)
    assert T[-1] == pytest.approx(298.0, abs=0.1)
    assert 'its time passes 40.0 times as fast as a clock' in decision.reason


class Processes(ros_client.Simulation):
    """Robot, observer, guard and controller, each a process of its own, and a client that listens."""

    def __init__(self, words):
        self.words = words
        super().__init__(*words, topics=((Float64, 'J_eq'), (Float64, 'J_eq_applied')), module=MODULES['robot'])
        self.parts = {'robot': self.process}
        for part in ('observer', 'guard', 'controller'):
            self.start(part)

    def start(self, part):
        command = ['-c', CONTROLLER] if part == 'controller' else ['-m', MODULES[part], '--ros-args', *self.words]
        environment = {'PYTHONPATH': str(ros_client.ROOT), **self.environment}
        self.parts[part] = subprocess.Popen(
            [sys.executable, *command], env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        self.process = self.parts['robot']

    def kill(self, part):
        self.parts[part].kill()
        self.parts[part].wait()

    def wait_for(self, topic, heating, patience=ros_client.REACTION):
        """Until the last that was heard is heating, or none."""
        end = time.monotonic() + patience
        while not self.seen[topic] or (self.seen[topic][-1].data != 0.0) != heating:
            assert time.monotonic() < end, f'{topic}: waited {patience} s in vain'
            self.executor.spin_once(timeout_sec=0.01)


def test_power_is_zero_whichever_process_is_killed(record_property):
    """With the longer silences of a busy machine. How long it took is in the report of the test, and no assertion."""
    words = ['-p', 'guard.silence:=0.5', '-p', 'node.command_timeout:=0.5', '-p', 'guard.T_max:=450.0']
    with Processes(words) as one, ExitStack() as stack:
        stack.callback(lambda: [process.kill() for process in one.parts.values()])
        for part in ('controller', 'observer', 'robot', 'guard'):
            del one.seen['J_eq'][:]
            one.wait_for('J_eq', True, ros_client.FIRST_MESSAGE)
            one.wait_for('J_eq_applied', True)
            began = time.monotonic()
            one.kill(part)
            one.wait_for('J_eq_applied' if part == 'guard' else 'J_eq', False)
            record_property(f'zero after the {part} was killed [s]', time.monotonic() - began)
            if part == 'robot':
                one.kill('observer')  # a robot that starts at rest is another one
                del one.seen['J_eq_applied'][:]
            for stopped in {'robot': ('robot', 'observer'), 'guard': ()}.get(part, (part,)):
                one.start(stopped)
