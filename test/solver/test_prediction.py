"""What a model does under a heating to come, and its derivatives in the levels of that heating."""

import numpy as np
import pytest

from sma_sim import Config, Model, UserError
from sma_sim.observer import Observer
from sma_sim.solver.columns import sample_columns
from sma_sim.solver.fixed_rate import FixedRateRun
from sma_sim.solver.prediction import Prediction

T_E, BOTH = 298.0, np.ones(2)
EDGES, TIMES = (0.0, 0.1, 0.3, 0.6), (0.1, 0.2, 0.3, 0.45, 0.6)
LEVELS = np.array([9.0, -2.0, 3.0])
ALPHA = 2


@pytest.fixture(scope='module')
def warm():
    """The module while both wires transform."""
    run = FixedRateRun(Model(Config()), 50.0, np.array([0.0, T_E]))
    for J in (-8.0, 10.0):
        run.step(np.array([J, T_E]), 40)
    return run


def test_a_prediction_is_what_the_model_does_then(warm):
    predicted = Prediction(warm.model, EDGES, TIMES, 1e-5).samples(warm.time, warm.run, LEVELS, BOTH, T_E)
    beside = FixedRateRun(warm.model, 50.0, np.array([0.0, T_E]))
    for J in (-8.0, 10.0):
        beside.step(np.array([J, T_E]), 40)
    for J, steps in zip(LEVELS, (5, 10, 15), strict=True):
        beside.step(np.array([J, T_E]), steps)
    where = sample_columns(warm.model.structure)
    assert predicted[-1, where.pose] == pytest.approx(beside.sample[where.pose], rel=1e-3)
    assert predicted[-1, where.wires] == pytest.approx(beside.sample[where.wires], rel=1e-2, abs=1e-3)


@pytest.mark.parametrize('gains', [BOTH, np.array([1.1, 0.9])])
def test_derivatives_are_those_of_differences(warm, gains):
    prediction = Prediction(warm.model, EDGES, TIMES, 1e-6)
    here = warm.time, warm.run
    samples, derivatives = prediction.with_derivatives(*here, LEVELS, gains, T_E)
    assert samples[:, ALPHA] == pytest.approx(prediction.samples(*here, LEVELS, gains, T_E)[:, ALPHA], rel=1e-6)
    for j in range(3):
        step = 1e-3 * np.eye(3)[j]
        ends = [prediction.samples(*here, LEVELS + side * step, gains, T_E) for side in (1.0, -1.0)]
        expected = (ends[0] - ends[1])[:, ALPHA] / 2e-3
        assert derivatives[:, ALPHA, j] == pytest.approx(expected, rel=2e-2, abs=1e-7)
    assert not derivatives[0, ALPHA, 1:].any()  # later levels do not act on what is before


def test_a_prediction_leaves_the_run_where_it_is(warm):
    before = [part.copy() for part in warm.run.state]
    Prediction(warm.model, EDGES, TIMES, 1e-3).with_derivatives(warm.time, warm.run, LEVELS, BOTH, T_E)
    assert all(np.array_equal(*parts) for parts in zip(before, warm.run.state, strict=True))


def test_a_prediction_that_follows_another_model_is_the_one_of_that_model(warm):
    """As an observer learns parameters; what was prepared for the model before is not used any more."""
    other = Model(Config().variant({'wire.lambda': 1.2 * Config().parameters['wire.lambda']}))
    here = warm.time, warm.run, LEVELS, BOTH, T_E
    one = Prediction(warm.model, EDGES, TIMES, 1e-3)
    before = one.with_derivatives(*here)
    one.follow(other)
    anew = Prediction(other, EDGES, TIMES, 1e-3).with_derivatives(*here)
    assert all(np.array_equal(*parts) for parts in zip(one.with_derivatives(*here), anew, strict=True))
    assert not np.array_equal(before[0], anew[0])


def test_state_of_an_observer_goes_on_as_its_forecast():
    observer = Observer(Config())
    observer.update(0.0, 10.0)
    for k in range(1, 51):
        observer.update(0.02 * k, None, {'alpha': 8e-4 * k, 'U_x': -6e-5})
    state = observer.state
    prediction = Prediction(state.model, (0.0, 0.5), (0.25, 0.5), 1e-5)
    rows = prediction.samples(state.time, state.run, np.array([10.0]), state.gains, state.T_E)
    first = sample_columns(state.model.structure).wires.start
    forecast = observer.forecast(10.0, [1.25, 1.5])
    assert rows[:, first] == pytest.approx([one.T[0] for one in forecast], abs=1.0)
    assert state.time == 1.0 and state.gains.shape == state.T_std.shape == (2,)


@pytest.mark.parametrize('system', ['spatial', 'wire'])
def test_what_one_command_does_not_move_is_refused(system):
    with pytest.raises(UserError, match=f'system = {system}'):
        Prediction(Model(Config(system=system)), EDGES, TIMES, 1e-3)
