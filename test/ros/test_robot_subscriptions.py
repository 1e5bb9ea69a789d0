"""What the live check makes of messages that arrive between two samples of the robot."""

import threading
import time

import numpy as np
import pytest

ros_client = pytest.importorskip('ros_client', reason='rclpy is not installed', exc_type=ImportError)
import rclpy  # noqa: E402
from rclpy.qos import QoSProfile  # noqa: E402
from sensor_msgs.msg import JointState  # noqa: E402
from std_msgs.msg import Float64  # noqa: E402

from sma_sim import Config  # noqa: E402
from sma_sim.ros.messages import stamp_of  # noqa: E402
from sma_sim.ros.qos import LATEST  # noqa: E402
from sma_sim.ros.robot_subscriptions import RobotSubscriptions, Sample  # noqa: E402


def joint_states_to(node):
    """A publisher of joint_states to a node that has subscribed to them, and the executor in which it hears them."""
    publisher = node.create_publisher(JointState, 'joint_states', 10)
    executor = rclpy.executors.SingleThreadedExecutor(context=node.context)
    executor.add_node(node)
    end = time.monotonic() + ros_client.REACTION
    while publisher.get_subscription_count() == 0:
        assert time.monotonic() < end
        executor.spin_once(timeout_sec=0.05)
    return publisher, executor


def wait_for(intake, count, executor):
    """Until so many samples wait to be taken."""
    end = time.monotonic() + ros_client.REACTION
    while intake.waiting < count:
        assert time.monotonic() < end
        executor.spin_once(timeout_sec=0.05)


def test_stamps_of_commands_come_from_their_arrival_between_two_samples():
    """Also for those that come late: they take effect at once, and are counted."""
    with ros_client.listener(ros_client.any_domain()) as node:
        intake = RobotSubscriptions(node, Config())
        publisher = node.create_publisher(Float64, 'J_eq', 10)
        executor = rclpy.executors.SingleThreadedExecutor(context=node.context)
        executor.add_node(node)
        half = 10**12  # [ns] between two samples here, so that an instant of the test is nothing
        nothing = np.zeros((3, 3))

        def changes_at(before, now):
            """The changes of a command that arrives now; samples are (arrival from now on, stamp) [ns]."""
            samples = [Sample(time.time_ns() + after, stamp, nothing) for after, stamp in (before, now)]
            publisher.publish(Float64(data=3.0))
            end = time.monotonic() + ros_client.REACTION
            while not (changes := intake.changes(*samples)):
                assert time.monotonic() < end
                executor.spin_once(timeout_sec=0.05)
            return changes

        end = time.monotonic() + ros_client.REACTION
        while publisher.get_subscription_count() == 0:
            assert time.monotonic() < end
            executor.spin_once(timeout_sec=0.05)
        between = changes_at((-half, 5_000), (half, 25_000))
        assert [(change.column, change.value) for change in between] == [(0, 3.0)]
        assert between[0].stamp == pytest.approx(15_000, abs=200)
        assert 'commands later than check.latency' not in intake.rejected()
        assert changes_at((half, 40_000), (2 * half, 50_000))[0].stamp == 40_000
        assert intake.rejected()['commands later than check.latency'] == 1


@pytest.mark.parametrize(('max_delay', 'taken'), [({}, [1, 2, 3, 4, 5]), ({'max_delay': 0.02}, [5])])
def test_a_node_that_acts_takes_the_last_of_samples_that_are_late(max_delay, taken):
    """A controller that answers every sample in turn, slower than they come, acts on a robot of long ago."""
    with ros_client.listener(ros_client.any_domain()) as node:
        intake = RobotSubscriptions(node, Config(), 0.0, **max_delay)
        publisher, executor = joint_states_to(node)
        for stamp in range(1, 6):
            message = JointState(name=['U_x', 'U_y', 'alpha'], position=[0.0, 0.0, 0.0])
            message.header.stamp = stamp_of(stamp)
            publisher.publish(message)
        wait_for(intake, 5, executor)
        time.sleep(0.1)
        assert [sample.stamp for sample in intake.ready()] == taken
        assert intake.skipped() == {'samples skipped': 5 - len(taken)}
        assert len(intake.overload()) == (len(taken) < 5) and not intake.overload()


@pytest.mark.parametrize(('max_delay', 'times'), [({}, [7.0, 7.01, 3.0]), ({'max_delay': 1e3}, [7.0, 7.01, 7.0])])
def test_the_time_of_a_node_that_acts_goes_on_where_the_clock_is_set(max_delay, times):
    """The wires of a robot do not jump with its clock. The stamps stay what they are."""
    with ros_client.listener(ros_client.any_domain()) as node:
        intake = RobotSubscriptions(node, Config(), 0.0, **max_delay)
        publisher, executor = joint_states_to(node)
        stamps = [7.0, 7.01, 3.0, 3.01]
        for count, stamp in enumerate(stamps, 1):
            message = JointState(name=['U_x', 'U_y', 'alpha'], position=[0.0, 0.0, 0.0])
            message.header.stamp = stamp_of(round(1e9 * stamp))
            publisher.publish(message)
            wait_for(intake, count, executor)
        samples = list(intake.ready())
        assert [1e-9 * sample.stamp for sample in samples] == pytest.approx(stamps)
        # from the third on, by when it arrived
        passed = [1e-9 * (sample.arrival - samples[2].arrival) for sample in samples]
        seen = [1e-9 * sample.time for sample in samples]
        assert seen[:2] == pytest.approx(times[:2]) and seen[3] - seen[2] == pytest.approx(0.01)
        assert seen[2] == pytest.approx(times[2] - (passed[1] if max_delay else 0.0), abs=0.02)


class Robots:
    """What robots publish to a `RobotSubscriptions`, and the inputs that it takes to be in force."""

    def __init__(self, node):
        self.node, self.intake = node, RobotSubscriptions(node, Config(), 0.0)
        self.joints, self.executor = joint_states_to(node)
        self.count, self.before = 0, None

    def publisher(self, kind, topic, quality=LATEST):
        made = self.node.create_publisher(kind, topic, quality)
        self.until(lambda: made.get_subscription_count() > 0)
        return made

    def until(self, condition):
        end = time.monotonic() + ros_client.REACTION
        while not condition():
            assert time.monotonic() < end
            self.executor.spin_once(timeout_sec=0.02)

    def changes(self):
        """By column, what has changed until the next sample, which is heard after all that was sent before."""
        self.count += 1
        message = JointState(name=['U_x', 'U_y', 'alpha'], position=[0.0, 0.0, 0.0])
        message.header.stamp = stamp_of(10**7 * self.count)
        for _ in range(20):
            self.executor.spin_once(timeout_sec=0.01)
        self.joints.publish(message)
        wait_for(self.intake, 1, self.executor)
        (now,) = self.intake.ready()
        changed = {change.column: change.value for change in self.intake.changes(self.before, now)}
        self.before = now
        return changed

    def look(self):
        """Once around the loop of a node, with its diagnostics."""
        stop = threading.Event()
        self.intake.follow(stop, lambda _: None, stop.set, 0.01)


def test_what_is_asked_for_counts_again_where_nobody_says_any_more_what_is_in_force():
    """A simulator that was tried first, and a robot that publishes no J_eq_applied on the same topics."""
    with ros_client.listener(ros_client.any_domain()) as node:
        robots = Robots(node)
        asked = robots.publisher(Float64, 'J_eq', 10)
        applied, ambient = (robots.publisher(Float64, topic) for topic in ('J_eq_applied', 'T_E_applied'))
        applied.publish(Float64(data=0.0))
        ambient.publish(Float64(data=310.0))
        assert robots.changes() == {0: 0.0, 1: 310.0}
        assert robots.intake.heating_followed == 'J_eq_applied'
        asked.publish(Float64(data=20.0))
        robots.look()
        assert robots.changes() == {}
        for publisher in (applied, ambient):
            node.destroy_publisher(publisher)
        robots.until(lambda: node.count_publishers('J_eq_applied') + node.count_publishers('T_E_applied') == 0)
        robots.look()
        asked.publish(Float64(data=20.0))
        assert robots.changes() == {0: 20.0, 1: 298.0}
        assert robots.intake.heating_followed == 'J_eq'


@pytest.mark.parametrize('quality', [LATEST, QoSProfile(depth=1)])
def test_a_robot_that_was_silent_is_believed_as_far_as_it_says_again_what_is_in_force(quality):
    """DDS takes a program that was killed for alive for another 20 s: it says nothing, as one that keeps nothing here."""
    with ros_client.listener(ros_client.any_domain()) as node:
        robots = Robots(node)
        asked = robots.publisher(Float64, 'J_eq', 10)
        applied = robots.publisher(Float64, 'J_eq_applied', quality)
        applied.publish(Float64(data=5.0))
        assert robots.changes() == {0: 5.0}
        time.sleep(1.0)
        robots.changes()
        again = quality is LATEST
        if again:
            robots.until(lambda: robots.intake.heating_followed == 'J_eq_applied')
        asked.publish(Float64(data=20.0))
        assert robots.changes() == {0: 5.0 if again else 20.0}
