"""Joint states that say nothing new of the robot: stamps that stand still, positions that are missing or no numbers."""

import math

import numpy as np
import pytest

ros_client = pytest.importorskip('ros_client', reason='rclpy is not installed', exc_type=ImportError)
pytest.importorskip('trajectory_msgs.msg', reason='trajectory_msgs is not installed', exc_type=ImportError)

from sma_sim import Config  # noqa: E402
from sma_sim.ros import check_node, controller_node, observer_node  # noqa: E402
from sma_sim.ros.check_node import ModelCheck  # noqa: E402
from sma_sim.ros.controller_node import ModelController  # noqa: E402
from sma_sim.ros.observer_node import WireObserver  # noqa: E402
from sma_sim.ros.robot_subscriptions import Sample  # noqa: E402
from sma_sim.solver.fixed_rate import FixedRateRun  # noqa: E402
from sma_sim.solver.model import Model  # noqa: E402

REPEATS = 'joint_states whose stamp repeats'


class Law:
    """A law that always commands 12 W, and knows only numbers."""

    coordinate = 'alpha'

    def __init__(self, _):
        pass

    def observe(self, *_):
        """Nothing is learned."""

    def step(self, _, measurements, __):
        assert math.isfinite(measurements['alpha'])
        return 12.0


class Beside:
    """A node of ours in this process, by a clock of its own: samples are given to it, messages are kept."""

    def __init__(self, monkeypatch, module, make, config):
        self.now, self.said = 1000.0, []
        monkeypatch.setattr(module.time, 'monotonic', lambda: self.now)
        self.rest = FixedRateRun(Model(Config()), 1000.0, np.array([0.0, 298.0]))
        self.rest = [self.rest.shown(name) for name in ('U_x', 'U_y', 'alpha')]
        self.runner = make(config)
        monkeypatch.setattr(self.runner._diagnostics, 'publish', lambda *words, **more: self.said.append((*words, more)))

    def sample(self, stamp, *position, wait=0.01):
        """A sample with a stamp [s], after a while [s]; without a position that of the robot at rest."""
        self.now += wait
        joints = np.full((3, 3), math.nan)
        joints[0] = position or self.rest
        self.runner._robot._ready_at = self.now  # as `follow` has it
        self.runner._take(Sample(round(1e9 * self.now), round(1e9 * stamp), joints))

    def status(self):
        """What it says of itself now: the words, and whether they are a warning."""
        self.runner._diagnose()
        words, more = self.said[-1]
        return words, more['warn']

    def value(self, key):
        """A value of its diagnostics."""
        self.status()
        return self.said[-1][1]['values'].get(key)


@pytest.fixture
def node():
    with ros_client.listener(ros_client.any_domain()) as one:
        yield one


@pytest.fixture
def controller(monkeypatch, node):
    monkeypatch.setattr(controller_node, 'LAWS', {'predictive': Law})
    config = Config(settings={'control.hold': True})
    beside = Beside(monkeypatch, controller_node, lambda given: ModelController(node, given, False), config)
    beside.sent = []
    monkeypatch.setattr(beside.runner._command, 'publish', lambda message: beside.sent.append(message.data))
    for k in range(100):
        beside.sample(7.0 + 0.01 * k)
    assert set(beside.sent) == {12.0} and beside.status()[0] == 'following'
    return beside


def test_a_stamp_that_stands_still_is_no_start_of_the_controller(controller):
    for _ in range(300):
        controller.sample(7.99)
    zero = controller.sent.index(0.0)
    assert set(controller.sent[:zero]) == {12.0} and controller.sent[zero:] == [0.0]
    assert controller.status() == (f'waiting for joint_states; {REPEATS}: heating off', True)
    assert controller.value(REPEATS) == 300 and controller.value('starts') == 1
    controller.sample(8.0)
    controller.sample(8.02)
    assert controller.sent[-1] == 12.0 and controller.status() == ('following', False)


def test_a_stamp_that_repeats_now_and_then_changes_nothing(controller):
    for k in range(100):
        controller.sample(8.0 + 0.01 * k)
        controller.sample(8.0 + 0.01 * k)
    assert set(controller.sent) == {12.0} and controller.status() == ('following', False)


def test_nothing_is_commanded_by_stamps_that_are_not_filled_in(monkeypatch, node):
    monkeypatch.setattr(controller_node, 'LAWS', {'predictive': Law})
    config = Config(settings={'control.hold': True})
    beside = Beside(monkeypatch, controller_node, lambda given: ModelController(node, given, False), config)
    sent = []
    monkeypatch.setattr(beside.runner._command, 'publish', lambda message: sent.append(message.data))
    for _ in range(300):
        beside.sample(0.0)
    assert not sent and beside.status() == (f'waiting for a target; {REPEATS}: heating off', True)


def test_without_its_coordinate_the_controller_turns_the_heating_off_and_does_not_end(controller):
    sent = controller.sent
    controller.sample(8.0, 0.0, 0.0, math.nan)
    for k in range(1, 30):
        controller.sample(8.0 + 0.01 * k)
    assert set(sent) == {12.0} and controller.status() == ('following', False)  # one sample is nothing
    count = len(sent)
    for k in range(300):
        controller.sample(8.3 + 0.01 * k, 0.0, 0.0, math.nan)
    assert sent[count:] == [0.0]
    assert controller.status() == ('waiting for joint_states; joint_states without alpha: heating off', True)
    controller.sample(11.3)
    controller.sample(11.32)
    assert sent[-1] == 12.0 and controller.status() == ('following', False)


def test_the_observer_says_that_stamps_stand_still_and_counts_a_measurement_once(monkeypatch, node):
    beside = Beside(monkeypatch, observer_node, lambda given: WireObserver(node, given, False), Config())
    for _ in range(300):
        beside.sample(0.0)
    words, warn = beside.status()
    assert warn and 'the stamps of joint_states have stood still for 3 s: is header.stamp filled in?' in words
    assert beside.value('samples') == 1 and beside.value(REPEATS) == 299
    beside.sample(0.01)
    assert beside.status() == ('observing', False)


def test_the_observer_takes_joints_that_come_one_by_one_with_one_stamp(monkeypatch, node):
    beside = Beside(monkeypatch, observer_node, lambda given: WireObserver(node, given, False), Config())
    beside.sample(1.0, beside.rest[0], math.nan, math.nan)
    beside.sample(1.0, math.nan, math.nan, beside.rest[2])
    assert beside.value('samples') == 2 and not beside.value(REPEATS)


@pytest.fixture
def check(monkeypatch, node):
    config = Config({'check.burn_in': 1.0, 'check.window': 1.0, 'check.diagnosis_period': 0.0})
    beside = Beside(monkeypatch, check_node, lambda given: ModelCheck(node, given, False), config)
    yield beside
    beside.runner.close()


def follow(beside, begin, end, *position):
    """Samples between two times [s], 100 a second."""
    for k in range(round(100.0 * begin), round(100.0 * end)):
        beside.sample(0.01 * k, *position)


def test_a_check_that_has_compared_nothing_says_so(check):
    follow(check, 7.0, 17.0, math.nan, math.nan, math.nan)
    words, warn = check.status()
    assert warn and words.startswith('comparing; nothing was compared for 10 s although joint_states arrive: ')
    assert check.value('verdict on the model') == 'none yet'


def test_a_check_that_compares_nothing_any_more_has_no_verdict(check):
    follow(check, 7.0, 10.0)
    assert check.status() == ('comparing; the model follows the measurement', False)
    for _ in range(400):
        check.sample(9.99)
    words, warn = check.status()
    assert warn and 'nothing was compared for 4 s' in words and 'follows' not in words
    assert check.value('verdict on the model') == 'none yet'
    follow(check, 10.0, 11.5)
    assert check.status() == ('comparing; the model follows the measurement', False)


def test_a_channel_that_has_left_and_is_not_measured_any_more_is_not_back(check):
    away = (*check.rest[:2], check.rest[2] + 0.1)
    follow(check, 7.0, 11.0, *away)
    assert 'has left the measurement: normalized RMSE alpha 286 over' in check.status()[0]
    follow(check, 11.0, 16.0, *check.rest[:2], math.nan)
    words, warn = check.status()
    assert warn and 'has left the measurement: normalized RMSE alpha not measured any more over' in words
    follow(check, 16.0, 19.0)
    assert check.status() == ('comparing; the model follows the measurement', False)
