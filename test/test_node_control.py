"""Pausing, stepping, resetting, and the schedule of the steps."""

import math

import pytest

ros_client = pytest.importorskip('ros_client', reason='rclpy is not installed', exc_type=ImportError)
from diagnostic_msgs.msg import DiagnosticArray  # noqa: E402
from sensor_msgs.msg import JointState, Temperature  # noqa: E402
from std_msgs.msg import Float64  # noqa: E402
from std_srvs.srv import SetBool, Trigger  # noqa: E402

from sma_sim.ros import schedule  # noqa: E402


def stamp(message):
    return message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec


def call(one, kind, name, **fields):
    client = one.node.create_client(kind, f'/sma_module_sim/{name}')
    one.until(client.service_is_ready)
    future = client.call_async(kind.Request(**fields))
    one.until(future.done)
    return future.result()


def test_pause_step_and_reset():
    topics = ((JointState, 'joint_states'), (Temperature, 'wire_1/temperature'), (Float64, 'J_eq_applied'))
    with ros_client.Simulation('-p', 'node.publish_rate:=1000.0', topics=topics) as one:
        seen, heat = one.seen['joint_states'], one.seen['wire_1/temperature']
        one.until(lambda: seen, ros_client.FIRST_MESSAGE)
        assert not call(one, Trigger, 'step').success
        command = one.node.create_publisher(Float64, 'J_eq', 10)
        one.until(lambda: command.get_subscription_count() == 1)
        command.publish(Float64(data=12.0))
        one.until(lambda: heat[-1].temperature > 40.0)
        assert call(one, SetBool, 'pause', data=True).message == 'paused'
        assert call(one, SetBool, 'pause', data=True).message == 'paused (as before)'
        assert call(one, Trigger, 'step').success
        before = stamp(seen[-1])
        for _ in range(3):
            assert call(one, Trigger, 'step').success
        one.until(lambda: stamp(seen[-1]) > before + 0.0025)
        assert stamp(seen[-1]) == pytest.approx(before + 0.003, abs=1e-6)
        assert call(one, Trigger, 'reset').success
        one.until(lambda: heat[-1].temperature == pytest.approx(298.0 - 273.15))
        assert call(one, SetBool, 'pause', data=False).message == 'running'
        count = len(seen)
        one.until(lambda: len(seen) > count + 50)
        assert heat[-1].temperature == pytest.approx(298.0 - 273.15)
        assert one.stop()[0] == 0


def test_as_fast_as_possible_and_diagnostics():
    topics = ((JointState, 'joint_states'), (DiagnosticArray, '/diagnostics'))
    with ros_client.Simulation('-p', 'node.real_time_factor:=0.0', topics=topics) as one:
        one.until(lambda: one.seen['/diagnostics'], ros_client.FIRST_MESSAGE)
        status = one.seen['/diagnostics'][-1].status[0]
        values = {value.key: value.value for value in status.values}
        assert status.name == '/sma_module_sim' and status.message == 'running'
        assert values['overruns'] == '0' and values['rejected commands'] == '0'
        assert float(values['real-time factor']) > 0.0 and math.isfinite(float(values['simulated time [s]']))
        assert one.stop()[0] == 0


class Clock:
    """A clock that only moves when told to, or when someone sleeps."""

    def __init__(self):
        self.now, self.slept = 100.0, []

    def monotonic(self):
        return self.now

    def sleep(self, duration):
        self.slept.append(duration)
        self.now += duration


@pytest.fixture
def clock(monkeypatch):
    made = Clock()
    monkeypatch.setattr(schedule, 'time', made)
    return made


def test_schedule_keeps_its_rate_and_makes_up_for_small_delays(clock):
    plan = schedule.Schedule(rate=100.0, factor=2.0)
    for _ in range(10):
        assert plan.wait() == 0.0
    assert clock.now == pytest.approx(100.05)
    clock.now += 0.012
    for _ in range(10):
        assert plan.wait() == 0.0
    assert clock.now == pytest.approx(100.1) and plan.overruns == 0


def test_schedule_never_answers_an_overrun_with_a_burst(clock):
    plan = schedule.Schedule(rate=100.0, factor=1.0)
    clock.now += 5.0
    assert plan.wait() == pytest.approx(4.99)
    begin = clock.now
    for _ in range(10):
        plan.wait()
    assert clock.now - begin == pytest.approx(0.1) and plan.overruns == 1


def test_no_waiting_at_factor_zero(clock):
    plan = schedule.Schedule(rate=1000.0, factor=0.0)
    assert [plan.wait() for _ in range(100)] == [0.0] * 100 and clock.slept == []
