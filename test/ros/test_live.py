"""The model beside a robot, without ROS: prediction at given stamps, running error, departure."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sma_sim import Config, Input, Model, read_config
from sma_sim.evidence.monitoring.live_model import (
    Announcements,
    ComparedSample,
    DepartureDetector,
    InputChange,
    LiveHistory,
    LiveModel,
    RunningError,
)
from sma_sim.model.structures.module import STRUCTURE
from sma_sim.solver.columns import sample_columns
from sma_sim.solver.fixed_rate import simulate_fixed_rate

RATE, EPOCH = 1000.0, 1_700_000_000_123_456_789
NAMES = ('U_x_m', 'U_y_m', 'alpha_rad', 'F_1_N', 'F_2_N', 'T_1_K', 'T_2_K')
J_EQ, T_E = 0, 1  # columns of the input

SENSED = sample_columns(STRUCTURE).sensed.start


def after(seconds):
    return EPOCH + round(seconds * 1e9)


def test_prediction_is_the_offline_run_bit_for_bit():
    model = Model(Config())
    live = LiveModel(model, RATE, EPOCH, (0.0, 298.0))
    told = (
        InputChange(after(0.2905), J_EQ, 12.0),
        InputChange(after(0.5), T_E, 305.0),
        InputChange(after(1.991), J_EQ, -3.0),
    )
    changes = dict(zip((30, 50, 200), told, strict=True))  # by the sample before which they come
    rows = [live.advance(after(0.01 * k), [changes[k]] if k in changes else []).copy() for k in range(301)]
    times = np.array([0.0, 0.291, 0.5, 1.991, 3.0])  # a change takes effect at the next step
    values = np.array([[0.0, 298.0], [12.0, 298.0], [12.0, 305.0], [-3.0, 305.0], [-3.0, 305.0]])
    run = simulate_fixed_rate(model, Input(times, values, (False, False)), RATE, 100.0)
    for column, name in enumerate(NAMES):
        assert np.array_equal(np.array(rows)[:, SENSED + column], run[name]), name


def history_of(model, span, seconds):
    """A model's own past, as a check adds it: a step of the command each second; and the rows of the model."""
    live, history = LiveModel(model, RATE, EPOCH, (0.0, 298.0)), LiveHistory(span)
    history.start(EPOCH, [0.0, 298.0])
    rows = []
    for k in range(1, 100 * seconds + 1):
        changes = [InputChange(after(0.01 * k - 0.003), J_EQ, 3.0 * (k // 100))] if k % 100 == 0 else []
        rows.append(live.advance(after(0.01 * k), changes).copy())
        history.add(ComparedSample(after(0.01 * k), changes, rows[-1][SENSED : SENSED + 7].copy()))
    return live, history, np.array(rows)


def test_another_model_is_put_beside_the_same_past():
    """The same model gives the same rows to the last bit, and goes on alike; one with an effect is that of its own run."""
    model = Model(Config())
    live, history, rows = history_of(model, 100.0, 4)
    again, shown = history.beside(model, RATE)
    assert np.array_equal(np.array([row for _, row in shown]), rows, equal_nan=True)
    assert np.array_equal(again.advance(after(5.0), []), live.advance(after(5.0), []), equal_nan=True)
    heavier = Model(read_config(effects=['gravity']))
    other, shown = history.beside(heavier, RATE)
    _, _, alone = history_of(heavier, 100.0, 4)
    assert np.array_equal(np.array([row for _, row in shown]), alone, equal_nan=True)
    assert abs(alone - rows)[:, SENSED + 1].max() > 1e-5


def test_a_long_past_is_kept_for_a_span_only():
    """What is older is forgotten; another model begins there from rest, under the command that was in force."""
    model = Model(Config())
    _, history, rows = history_of(model, 2.0, 6)
    live, shown = history.beside(model, RATE)
    assert len(shown) == 201 and shown[0][0].stamp == after(4.0) and live.begin == after(3.99)
    assert live.advance(after(6.0), [])[0] != pytest.approx(rows[-1][0], rel=1e-9)  # it was not at rest


def test_a_late_change_takes_effect_now_and_stamps_need_not_fit_the_steps():
    model = Model(Config())
    live = LiveModel(model, RATE, EPOCH, (0.0, 298.0))
    live.advance(after(0.5003), [])
    row = live.advance(after(1.0004), [InputChange(after(0.1), J_EQ, 12.0)]).copy()
    assert np.array_equal(live.advance(after(1.0001), []), row, equal_nan=True)  # the same step
    times, values = np.array([0.0, 0.5, 1.0]), np.array([[0.0, 298.0], [12.0, 298.0], [12.0, 298.0]])
    run = simulate_fixed_rate(model, Input(times, values, (False, False)), RATE, 1000.0)
    assert row[SENSED + 2] == run['alpha_rad'][-1]


def test_the_order_of_changes_counts_when_they_share_a_step():
    live = LiveModel(Model(Config()), RATE, EPOCH, (0.0, 298.0))
    on_and_off = [InputChange(after(0.1), J_EQ, 12.0), InputChange(after(0.1), J_EQ, 0.0)]
    assert live.advance(after(0.5), on_and_off)[SENSED + 5] == pytest.approx(298.0)


STEPS_AND_RATIOS = st.tuples(st.floats(0.001, 3.0), st.one_of(st.floats(-1e3, 1e3), st.just(float('nan'))))


@given(st.lists(STEPS_AND_RATIOS, min_size=1, max_size=300), st.floats(0.01, 20.0))
def test_running_error_is_that_of_its_window(steps, window):
    error, times = RunningError(window, 2), np.cumsum([step for step, _ in steps])
    ratios = np.array([[value, 1.0] for _, value in steps])
    for k, (t, ratio) in enumerate(zip(times, ratios, strict=True)):
        now = error.add(t, ratio)
        inside = ratios[: k + 1][times[: k + 1] > t - window]
        there = inside[~np.isnan(inside[:, 0]), 0]
        assert now[1] == pytest.approx(1.0)
        assert np.isnan(now[0]) if len(there) == 0 else now[0] == pytest.approx(np.sqrt(np.mean(there**2)))


def departures(ratios, threshold=3.0, window=5.0):
    """Whether the model has left, sample by sample at 100 Hz."""
    error, departure, left = RunningError(window, 1), DepartureDetector(threshold, window, 1), []
    for k, ratio in enumerate(ratios):
        departure.update(k / 100.0, error.add(k / 100.0, np.array([ratio])))
        left.append(bool(departure.left[0]))
    return np.array(left)


def test_noise_and_outliers_are_no_departure():
    ratios = np.random.default_rng(1).standard_normal(6000)
    ratios[3000] = 1e6
    ratios[4500] = np.inf
    assert not departures(ratios).any()


def test_an_error_that_stays_is_a_departure_until_it_is_gone():
    ratios = np.random.default_rng(2).standard_normal(6000)
    ratios[1000:3000] += 6.0
    left = departures(ratios)
    assert not left[:1500].any()
    assert left[1800:3000].all()
    assert not left[3500:].any()


def test_a_channel_that_is_no_longer_measured_stays_as_it_was_until_it_is_again():
    away, silent, near = np.full(1200, 9.0), np.full(700, np.nan), np.zeros(600)
    assert departures(np.concatenate([away, silent]))[-1]
    assert departures(np.concatenate([away, silent, away[:50]]))[1200:].all()
    assert not departures(np.concatenate([away, silent, near]))[-1]
    assert not departures(np.concatenate([near, away[:50], silent, away[:50]])).any()


STATES = st.lists(st.tuples(st.floats(0.0, 30.0), st.sampled_from(['left', 'follows', 'between'])), max_size=60)


@given(STATES)
def test_a_model_that_is_away_is_said_once_in_a_period(states):
    """However channels leave and come back; what is said last is how it is, or a period has not passed."""
    announcements, now, said = Announcements(10.0), 0.0, []
    for after_last, state in states:
        now += after_last
        due = announcements.due(now, state == 'left', state == 'follows')
        said += [(now, due)] if due else []
        assert due in {'left': ('left', ''), 'follows': ('follows', 'back', ''), 'between': ('',)}[state]
        if state == 'follows':
            assert said[-1][1] in ('follows', 'back')
        if state == 'left':
            assert now - max(t for t, words in said if words == 'left') < 10.0
    warnings = [t for t, words in said if words == 'left']
    assert all(later - earlier >= 10.0 for earlier, later in zip(warnings, warnings[1:], strict=False))
    assert all(words != before for (_, words), (_, before) in zip(said[1:], said, strict=False) if words != 'left')


def test_a_model_that_starts_anew_is_said_to_follow_again():
    announcements = Announcements(10.0)
    assert [announcements.due(t, False, True) for t in (0.0, 1.0)] == ['follows', '']
    announcements.restart()
    assert announcements.due(2.0, False, True) == 'follows'
