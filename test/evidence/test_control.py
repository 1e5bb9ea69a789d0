"""Controllers with a model: the inversion against its closed form, limits, what a better model is worth."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import lsq_linear

from sma_sim import Config, Model, PhysicsWarning, UserError, effects
from sma_sim.control import PI, Feedforward, FeedforwardPI, PredictiveController
from sma_sim.evidence.control.plan import constrained_least_squares
from sma_sim.evidence.state_estimation.uncertain import least_cooling
from sma_sim.model.covariance import ParameterCovariance
from sma_sim.model.material import fraction_at_stress, heat_capacity, latent_heat
from sma_sim.model.parameters import wire_constants
from sma_sim.solver.fixed_rate import FixedRateRun

RATE, T_E = 50.0, 298.0  # [Hz], [K]
DEGREE = np.pi / 180.0


def wave(times):
    """Two sines [rad]; both bundles have to contract and to cool."""
    return DEGREE * (1.0 - np.exp(-times)) * (2.5 * np.sin(times / 2.0) + 1.5 * np.sin(times / 1.2))


@pytest.mark.parametrize(('gains', 'words'), [((1.0, 0.0, -5.0), 'expected the largest output'), ((1.0, np.nan, 5.0), 'ki')])
def test_a_limit_does_not_turn_the_output_round(gains, words):
    with pytest.raises(UserError, match=words):
        PI(*gains)


def test_what_no_controller_can_follow_is_said():
    law = FeedforwardPI(Config())
    with pytest.raises(UserError, match='target: expected a function; got 0.05'):
        law.step(0.0, {'alpha': 0.0}, 0.05)
    with pytest.raises(UserError, match='target of alpha: expected radians up to pi, got 5, which looks like degrees'):
        law.step(0.0, {'alpha': 0.0}, lambda times: 5.0 + 0.0 * times)
    with pytest.raises(UserError, match='T_E = 25: expected kelvin'):
        law.observe(0.0, None, None, 25.0)


@pytest.mark.parametrize('time', [np.inf, np.nan, 1.7e9, -1.0])
def test_a_jump_of_the_clock_is_said(time):
    """The model went on period by period up to it: for decades, or for ever."""
    law = FeedforwardPI(Config())
    law.step(0.0, {'alpha': 0.0}, lambda times: 0.0 * times)
    with pytest.raises(UserError, match='expected seconds that go on by 60 at most'):
        law.step(time, {'alpha': 0.0}, lambda times: 0.0 * times)


@pytest.mark.parametrize(
    ('given', 'words'),
    [((np.nan, 0.1), 'error = nan: expected a finite'), (('a', 0.1), 'error: expected a num'), ((0.1, -0.1), 'dt = -0.1')],
)
def test_what_is_no_error_for_a_time_is_said(given, words):
    with pytest.raises(UserError, match=words):
        PI(1.0, 1.0, 1.0)(*given)


def test_a_measurement_in_degrees_is_said_at_the_first_step():
    with pytest.warns(PhysicsWarning, match='measurements, alpha: expected radians up to pi, got 4'):
        FeedforwardPI(Config()).step(0.0, {'alpha': 4.0}, lambda times: 0.0 * times)


def test_a_target_is_a_function():
    with pytest.raises(UserError, match='target: expected a function; got 0.02'):
        Feedforward(Config()).step(0.02)


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 10_000))
def test_constrained_least_squares_is_that_of_another_method_within_bounds(seed):
    random = np.random.default_rng(seed)
    A, b = random.standard_normal((9, 4)), random.standard_normal(9)
    low, high = np.sort(random.standard_normal((2, 4)), axis=0)
    x = constrained_least_squares(A, b, np.vstack([np.eye(4), -np.eye(4)]), np.concatenate([high, -low]))
    assert x == pytest.approx(lsq_linear(A, b, (low, high)).x, abs=1e-6)


def test_what_cannot_be_kept_is_told():
    A, b = np.eye(2), np.ones(2)
    assert constrained_least_squares(A, b, np.array([[1.0, 0.0], [-1.0, 0.0]]), np.array([-1.0, -1.0])) is None
    assert constrained_least_squares(A, b, np.array([[1.0, 1.0]]), np.array([1.0])) == pytest.approx([0.5, 0.5])
    assert constrained_least_squares(A, b, np.array([[0.0, 0.0]]), np.array([-1.0])) == pytest.approx([1.0, 1.0])


def closed_form_power(x, v, model, dt):
    """J [W] of a slider's wire that transforms to austenite, at the middles of the steps of its positions x (k,) [m].

    Spring and damping give the force, this the stress, which is sigma_M(T); length and stress give x_M; J is what is left
    of the heat balance.
    """
    w, p = model.wire, model.constants
    sigma = (p.k * (x + p.x_0) + p.b * v + p.m * p.g * np.sin(p.incline)) / (w.n * w.section)
    T = w.T0 + (sigma + 0.5 * w.dsigma - w.sigma_MW0) / w.sigma_T
    eps = (p.L - x) / w.l0 - 1.0
    x_M = np.array([fraction_at_stress(*one, w) for one in zip(eps, sigma, strict=True)])
    middle = [0.5 * (one[1:] + one[:-1]) for one in (T, sigma, x_M)]
    stored = [
        heat_capacity(T_k, x_k, w) * rate_T - latent_heat(T_k, sigma_k, w) * rate_x
        for T_k, sigma_k, x_k, rate_T, rate_x in zip(*middle, np.diff(T) / dt, np.diff(x_M) / dt, strict=True)
    ]
    return w.n * (np.array(stored) + w.lambda_ * w.surface * (middle[0] - T_E)), x_M


def test_power_is_that_of_the_closed_form_while_a_wire_contracts():
    config = Config({'control.horizon': 0.6}, system='slider')
    feedforward = Feedforward(config)
    model = feedforward.model
    start = feedforward.value

    def target(times):
        return start + 4e-4 * np.clip(times - 1.0, 0.0, 4.0) ** 2 / 4.0

    J = np.array([feedforward.step(target) for _ in range(250)])
    t = np.arange(250) / RATE
    x, v = target(t), np.gradient(target(t), t)
    expected, x_M = closed_form_power(x, v, model, 1.0 / RATE)
    moving = slice(150, 240)
    assert ((x_M > 0.05) & (x_M < 0.95))[moving].all()
    assert J[:-1][moving] == pytest.approx(expected[moving], rel=0.03)


def test_model_follows_where_wires_can():
    feedforward, errors, J = Feedforward(Config()), [], []
    for _ in range(400):
        errors.append(feedforward.value - wave(np.array([feedforward.time]))[0])
        J.append(feedforward.step(wave))
    assert np.sqrt(np.mean(np.square(errors))) < 0.1 * DEGREE
    assert max(np.abs(J)) <= 30.0 and min(J) < 0.0 < max(J)


def test_no_wire_cools_faster_than_its_surroundings_let_it():
    """A slider with one wire goes back at once: nothing is heated, and the rest is physics."""
    feedforward = Feedforward(Config(system='slider'))
    start, J = feedforward.value, []
    for _ in range(200):
        J.append(feedforward.step(lambda times: start + 2e-3 * (times < 3.0)))
    assert min(J) >= 0.0 and max(J[:150]) > 0.1
    assert J[145] == pytest.approx(0.0, abs=1e-3)  # it is left to cool before the target turns
    assert max(J[150:170]) == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize(('name', 'limit'), [('guard.T_max', 335.0), ('guard.stress_max', 1.3e8), ('node.J_max', 4.0)])
def test_limits_are_kept_by_the_model(name, limit):
    feedforward, seen = Feedforward(Config({name: limit}, settings={'control.behind_guard': True})), []
    for _ in range(250):
        J = feedforward.step(lambda times: 8.0 * DEGREE * np.minimum(times, 1.0))
        T, stress = feedforward.temperatures.max(), feedforward.stresses.max()
        seen.append({'guard.T_max': T, 'guard.stress_max': stress, 'node.J_max': abs(J)}[name])
    assert 0.97 * limit < max(seen) < 1.003 * limit


def followed(controller, robot, steps=400, seed=0):
    """RMSE [rad] of a robot under a controller, with noise of its sensors; its hottest wire [K]."""
    random, run = np.random.default_rng(seed), FixedRateRun(robot, RATE, np.array([0.0, T_E]))
    noise, errors, T = {'U_x': 2e-6, 'U_y': 1e-5, 'alpha': 3.5e-4}, [], []
    p = robot.compiled
    for k in range(steps):
        t = k / RATE
        seen = {name: run.shown(name) + std * random.standard_normal() for name, std in noise.items()}
        J = controller.step(t, seen, wave)
        controller.observe(t, J)
        errors.append(run.shown('alpha') - wave(np.array([t]))[0])
        T.append(run.run.state.y[p.first_T : p.first_T + 2].max())
        run.step(np.array([J, T_E]))
    return float(np.sqrt(np.mean(np.square(errors)))), max(T)


class PIAlone:
    """The PI controller of the examples, with their gains."""

    def __init__(self):
        self.law = PI(1000.0, 800.0, 30.0)

    def step(self, time, measurements, target):
        return self.law(float(target(np.array([time]))[0]) - measurements['alpha'], 1.0 / RATE)

    def observe(self, time, J_eq):
        pass


def test_a_better_model_is_seen_in_the_tracking_error():
    """A robot with MAS kinetics; the nominal model leaves out its weight, the better one knows the power."""
    config = Config()
    off = {
        name: config.parameters[f'wire.{name}'] * factor
        for name, factor in (('sigma_MW0', 1.07), ('lambda', 0.9), ('eps_T', 1.05), ('sigma_T', 0.93))
    }
    values, weight = {f'wire.{name}': value for name, value in off.items()}, [effects.gravity(g_y=-9.81)]
    robot = Model(Config(values, kinetics='mas', effects=weight))
    improved = Config({**values, 'observer.gain_std': 0.0, 'observer.gain_change_std': 0.0}, effects=weight)
    alone = followed(PIAlone(), robot)[0]
    assert followed(PredictiveController(config), robot)[0] < 0.5 * alone
    assert followed(PredictiveController(improved), robot)[0] < 0.3 * alone
    assert followed(FeedforwardPI(improved), robot)[0] < 0.5 * alone


@pytest.mark.parametrize('ahead', [0.3, pytest.param(3.0, marks=pytest.mark.slow)])
@pytest.mark.parametrize('law', [FeedforwardPI, PredictiveController])
def test_no_wire_burns_where_a_clock_is_set_ahead(law, ahead):
    """The robot stands still for a while that its stamps say has passed; the feedback makes up for it within the limit."""
    limit, robot = 360.0, Model(Config(kinetics='mas'))
    controller, run = law(Config({'guard.T_max': limit})), FixedRateRun(robot, RATE, np.array([0.0, T_E]))
    places, T, errors = slice(robot.compiled.first_T, robot.compiled.first_T + 2), [], []
    for k in range(600):
        t = k / RATE + ahead * (k >= 330)
        target = 0.06 * np.sin(2.0 * np.pi * (t + np.array([0.0])) / 8.0)[0]
        J = controller.step(t, {'alpha': run.shown('alpha')}, lambda times: 0.06 * np.sin(2.0 * np.pi * times / 8.0))
        controller.observe(t, J)
        run.step(np.array([J, T_E]))
        T.append(run.run.state.y[places].max())
        errors.append(abs(run.shown('alpha') - target))
    assert max(T) < limit
    assert max(errors[550:]) < 3.0 * max(errors[200:330]) + 1e-3


@pytest.mark.parametrize('law', [FeedforwardPI, PredictiveController])
def test_any_command_may_stay_in_force_for_ever(law):
    """On 97.7 % of the robots of which no more is known than priors say; behind a guard, which judges it anew, on fewer."""
    limit, std, far, random, w = 350.0, 0.1, 0.15, np.random.default_rng(3), wire_constants(Config().parameters)
    u, (cooled, gain, change, other) = Config().parameters, random.standard_normal((4, 10_000))
    power = 1.0 + u['observer.gain_change_std'] * change + u['observer.power_std'] * other
    warming = power * np.exp(u['observer.gain_std'] * gain - std * cooled) / (w.n * w.lambda_ * w.surface)  # [K/W]

    def beyond(behind_guard, by_driver=warming):
        given = {'guard.T_max': limit, 'observer.parameter_std': std}
        controller = law(Config(given, settings={'control.behind_guard': behind_guard}))
        J = [controller.step(k / RATE, {'alpha': -0.01}, lambda times: far * np.cos(5.0 * times)) for k in range(60)]
        return np.mean(T_E + max(map(abs, J)) * by_driver > limit)

    assert 0.01 < beyond(False) < 0.025 < beyond(True)
    assert beyond(False, 1.4 / (w.n * w.lambda_ * w.surface)) == 0.0


def test_power_that_is_measured_leaves_more_of_it():
    """Nothing is taken away twice: a fit that has left lambda has it for a watt of the command."""
    measured = {'observer.gain_std': 0.0, 'observer.gain_change_std': 0.0, 'observer.power_std': 1e-6}
    w = wire_constants(Config().parameters)
    fitted = ParameterCovariance(('wire.lambda',), np.array([[1e-4]]))
    assert least_cooling(Config(measured)) == pytest.approx(w.n * w.lambda_ * w.surface * np.exp(-0.2), rel=2e-3)
    known = Config({**measured, 'observer.gain_std': 0.2}).with_covariance(fitted)
    assert least_cooling(known) == pytest.approx(w.n * w.lambda_ * w.surface * np.exp(-0.02), rel=2e-3)


@pytest.mark.parametrize('part', [0.5, 1.0])
def test_nothing_winds_up_while_a_guard_takes_power_away(part):
    """A robot that stays 2 mrad behind its model: the integral grows by 1.6 W/s where all that is asked for is in force."""
    controller, J = FeedforwardPI(Config(settings={'control.behind_guard': True})), []
    for k in range(200):
        J.append(controller.step(k / RATE, {'alpha': controller.feedforward.value - 2e-3}, lambda times: 0.02 + 0.0 * times))
        controller.observe(k / RATE, part * J[-1])
    assert J[-1] - J[-51] == pytest.approx(1.6 if part == 1.0 else 0.0, abs=0.2)


@pytest.mark.parametrize('make', [Feedforward, PredictiveController])
def test_structures_that_one_command_does_not_move_are_refused(make):
    with pytest.raises(UserError, match='spatial'):
        make(Config(system='spatial'))


def test_unknown_coordinate_is_refused():
    with pytest.raises(UserError, match='control.coordinate'):
        Feedforward(Config(settings={'control.coordinate': 'alhpa'}))


@pytest.mark.parametrize('measurements', [{}, {'U_y': 0.0}, {'alpha': np.nan}, {'alpha': np.inf}])
def test_feedback_without_a_finite_coordinate_is_refused(measurements):
    with pytest.raises(UserError, match='measurements: alpha (= (nan|inf): |is missing; )expected a finite number'):
        FeedforwardPI(Config()).step(0.0, measurements, lambda times: 0.0 * times)
