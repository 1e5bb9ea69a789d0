"""When steps are due: on the computer's clock and on /clock, after delays, pauses and jumps."""

import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed', exc_type=ImportError)
from sma_sim.ros import schedule  # noqa: E402


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
    plan = schedule.WallSchedule(rate=100.0, factor=2.0)
    for _ in range(10):
        assert plan.wait() == schedule.Due(1)
    assert clock.now == pytest.approx(100.05)
    clock.now += 0.012
    for _ in range(10):
        assert plan.wait() == schedule.Due(1)
    assert clock.now == pytest.approx(100.1) and plan.overruns == 0


def test_schedule_never_answers_an_overrun_with_a_burst(clock):
    plan = schedule.WallSchedule(rate=100.0, factor=1.0)
    clock.now += 5.0
    due = plan.wait()
    assert due.steps == 1 and due.moved == pytest.approx(4.99)
    begin = clock.now
    for _ in range(10):
        plan.wait()
    assert clock.now - begin == pytest.approx(0.1) and plan.overruns == 1 and plan.lost == pytest.approx(4.99)


def test_the_anchor_of_the_stamps_follows_the_clock_after_an_overrun_and_a_restart(clock):
    plan = schedule.WallSchedule(100.0, 1.0, lambda: round(clock.now * 1e9))
    steps = 0

    def behind():
        """The clock less the stamp of the end of the last step [s]."""
        return clock.now - (plan.anchor / 1e9 + steps / 100.0)

    for _ in range(10):
        steps += plan.wait().steps
    assert behind() == pytest.approx(0.0)
    clock.now += 5.0
    steps = plan.wait().steps  # since the anchor
    assert plan.overruns == 1 and behind() == pytest.approx(0.0)
    clock.now += 3.0
    plan.restart()
    steps = plan.wait().steps
    assert plan.overruns == 1 and behind() == pytest.approx(0.0)


def test_stamps_are_right_although_the_thread_is_interrupted_while_it_reads_the_clocks(clock):
    interruptions = [0.0]

    def now():
        clock.now += interruptions.pop() if interruptions else 0.0
        return round(clock.now * 1e9)

    plan = schedule.WallSchedule(100.0, 1.0, now)
    interruptions.append(0.005)
    plan.restart()
    steps = plan.wait().steps
    assert clock.now == pytest.approx(plan.anchor / 1e9 + steps / 100.0)
    clock.now += 5.0
    interruptions.append(0.005)
    steps = plan.wait().steps  # after an overrun, since the anchor
    steps += plan.wait().steps
    assert plan.overruns == 1 and clock.now == pytest.approx(plan.anchor / 1e9 + steps / 100.0)


def test_fast_steps_are_made_together(clock):
    plan = schedule.WallSchedule(rate=20_000.0, factor=1.0)
    assert sum(plan.wait().steps for _ in range(100)) == 2000 and clock.now == pytest.approx(100.1)


def test_slow_steps_do_not_keep_the_node_from_listening(clock):
    plan = schedule.WallSchedule(rate=1.0, factor=1.0)
    steps = [plan.wait().steps for _ in range(100)]
    assert max(clock.slept) <= schedule.MAX_WAIT and sum(steps) == pytest.approx(clock.now - 100.0, abs=1.0)


def test_no_waiting_at_factor_zero(clock):
    plan = schedule.WallSchedule(rate=1000.0, factor=0.0)
    assert all(plan.wait().steps > 0 for _ in range(100)) and clock.slept == []


class Stage:
    """A clock of ROS that the test moves [ns]."""

    def __init__(self):
        self.now = 0

    def __call__(self):
        return self.now


def test_another_clock_sets_the_pace(clock):
    other = Stage()
    plan = schedule.ClockSchedule(1000.0, other, clock.sleep)
    assert plan.wait() == schedule.Due(0)  # not heard of yet
    other.now = 50 * 10**9
    assert plan.wait() == schedule.Due(0) and plan.anchor == other.now
    steps = 0
    for _ in range(40):  # a clock with a coarse beat
        other.now += 25_000_000
        steps += plan.wait().steps
    assert steps == 1000 and plan.overruns == 0
    assert plan.wait() == schedule.Due(0)


def test_a_clock_that_jumps(clock):
    other = Stage()
    other.now = 50 * 10**9
    plan = schedule.ClockSchedule(1000.0, other, clock.sleep)
    other.now = 20 * 10**9
    assert plan.wait() == schedule.Due(0, back=30.0) and plan.anchor == other.now
    other.now += 10_000_000
    assert plan.wait().steps == 10
    other.now += 100 * 10**9  # forward: left behind, not run after
    assert plan.wait() == schedule.Due(0, moved=100.0) and plan.overruns == 1
    other.now += 5_000_000
    assert plan.wait().steps == 5


def test_recent_growth_is_forgotten_and_the_total_is_not_needed_again(clock):
    recent = schedule.RecentCount(10.0)
    assert recent(0) == 0 and recent(3) == 3
    clock.now += 6.0
    assert recent(3) == 3 and recent(4) == 4
    clock.now += 6.0
    assert recent(4) == 1
    clock.now += 6.0
    assert recent(4) == 0


def test_the_speed_counts_from_where_it_began(clock):
    speed = schedule.Speed(100.0)
    clock.now += 2.0
    assert speed.since_last(101.0) == pytest.approx(0.5)
    clock.now += 1.0
    assert speed.since_last(103.0) == pytest.approx(2.0)
