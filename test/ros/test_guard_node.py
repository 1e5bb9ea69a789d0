"""The node `sma_guard` between a controller and a robot, over real DDS: this client plays controller, robot and observer."""

import json
import time

import pytest

ros_client = pytest.importorskip('ros_client', reason='rclpy is not installed', exc_type=ImportError)
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus  # noqa: E402
from sensor_msgs.msg import JointState, Temperature  # noqa: E402
from std_msgs.msg import Float64, Float64MultiArray, UInt8MultiArray  # noqa: E402

GUARD = 'sma_sim.ros.guard_main'
TOPICS = ((Float64, 'J_eq'), (DiagnosticArray, '/diagnostics'))
PARTS = ('controller', 'robot', 'observer')


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
        world.until(lambda: 'not a finite number' in status(one).message)
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
