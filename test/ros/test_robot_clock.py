"""The clock of a robot, read between its samples by that of this computer."""

import numpy as np
import pytest

from sma_sim import Config, Model
from sma_sim.guard import Guard
from sma_sim.observer import Observer
from sma_sim.ros.robot_clock import FIRST_AHEAD, WINDOW, RobotClock
from sma_sim.solver.fixed_rate import FixedRateRun


def heard(clock, stamps, arrivals):
    """Jumps that the clock tells of for samples."""
    return [clock.hear(float(stamp), float(arrival)) for stamp, arrival in zip(stamps, arrivals, strict=True)]


@pytest.mark.parametrize('pace', [1.0, 3.0, 20.0])
def test_the_pace_of_a_robot_is_told_by_its_samples(pace):
    """However long each was on its way; the time is that of the quickest, which is 1 ms of this computer's clock."""
    clock, random = RobotClock(), np.random.default_rng(1)
    made = np.arange(0.0, 3.0, 0.01)
    arrivals = np.maximum.accumulate(made + 1e-3 + 0.004 * random.random(len(made)))
    assert not any(heard(clock, 50.0 + pace * made, arrivals))
    assert clock.pace == pytest.approx(pace, rel=0.01)
    assert clock.at(arrivals[-1] + 0.1) == pytest.approx(50.0 + pace * (arrivals[-1] + 0.099), abs=0.004 * pace)


def test_a_robot_that_is_slower_than_a_clock_counts_as_one():
    clock, made = RobotClock(), np.arange(0.0, 3.0, 0.01)
    assert not any(heard(clock, 0.3 * made, made)) and clock.pace == 1.0
    assert clock.at(made[-1] + 0.1) >= 0.3 * (made[-1] + 0.1)


@pytest.mark.parametrize('jump', [-500.0, -5.0, -0.3, 0.06, 0.3, 1.0, 5.0, 500.0])
def test_a_clock_that_is_set_is_told_once(jump):
    clock, made = RobotClock(), np.arange(0.0, 4.0, 0.01)
    jumps = heard(clock, 1000.0 + made + jump * (made >= 2.0), made)
    assert np.flatnonzero(jumps).tolist() == [200] and jumps[200] == pytest.approx(jump, abs=1e-6)
    assert clock.pace == pytest.approx(1.0) and clock.at(5.0) == pytest.approx(1005.0 + jump)


@pytest.mark.parametrize('at_once', [0.02, 0.08, 0.3])
def test_time_that_a_simulator_makes_at_once_is_no_jump(at_once):
    """It follows a clock that moves rarely, by as many steps as that asks for, and shows each; a tenth of them is lost."""
    clock, made = RobotClock(), np.arange(0.0, 4.0, 0.01)
    arrivals = np.ceil((made + 1e-9) / at_once) * at_once + 1e-4 * np.arange(len(made))
    kept = np.random.default_rng(2).random(len(made)) > 0.1
    assert not any(heard(clock, made[kept], arrivals[kept]))


def test_a_robot_that_goes_on_at_another_pace_is_followed():
    clock, made = RobotClock(), np.arange(0.0, 3.0, 0.01)
    stamps = np.where(made < 1.0, made, 1.0 + 20.0 * (made - 1.0))
    assert sum(heard(clock, stamps, made)) < 1.0 and clock.pace == pytest.approx(20.0, rel=0.01)
    assert clock.at(made[-1]) == pytest.approx(stamps[-1], abs=0.1)


def test_what_an_interruption_has_held_back_is_no_jump():
    """A network that was down for two seconds and then brings some of what was sent, all at once."""
    clock, made = RobotClock(), np.arange(0.0, 8.0, 0.01)
    arrivals = np.where((made > 2.0) & (made < 4.0), 4.0, made)
    kept = (made < 2.5) | (made > 3.5)
    assert not any(heard(clock, 70.0 + made[kept], arrivals[kept]))
    assert clock.at(8.0) == pytest.approx(78.0)
    assert clock.hear(79.0 + FIRST_AHEAD, 8.0) == pytest.approx(1.0 + FIRST_AHEAD)  # held back is nothing any more


def test_a_pause_of_the_robot_is_no_jump():
    """A simulator that stands still: its stamps go on from where they were."""
    clock, made = RobotClock(), np.arange(0.0, 3.0, 0.01)
    arrivals = made + 10.0 * (made > 1.5)
    assert not any(heard(clock, made, arrivals))
    assert clock.pace == pytest.approx(1.0) and clock.at(arrivals[-1] + WINDOW) == pytest.approx(made[-1] + WINDOW)


@pytest.mark.parametrize('ahead', [0.1, 0.3])
def test_no_wire_burns_behind_a_guard_where_a_clock_is_set_ahead(ahead):
    """A wire at its limit does not cool in time that has not passed; heating was off as the clock was set."""
    limit, first = 360.0, np.array([0.0, 298.0])
    config = Config({'guard.T_max': limit, 'observer.parameter_std': 0.01})
    observer, guard, clock = Observer(config), Guard(config), RobotClock()
    run, J, set_by, T = FixedRateRun(Model(Config(kinetics='mas')), 50.0, first), 0.0, 0.0, []
    for k in range(200):
        stamp = 1000.0 + k / 50.0 + ahead * (k >= 150)
        set_by += clock.hear(stamp, 7.0 + k / 50.0)
        estimate = observer.update(stamp - set_by, J, {'alpha': run.shown('alpha')})
        J = guard.limit(0.0 if k == 149 else 25.0, estimate, stamp - set_by).J_eq[0]
        observer.update(stamp - set_by, J)
        run.step(np.array([J, 298.0]))
        T.append(run.shown('T_1'))
    assert limit - 8.0 < max(T[:149]) < limit and max(T) < limit
