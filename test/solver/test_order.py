"""The stepper's order: of its coefficients, of steps, of the dense output, of event times."""

import numpy as np
import pytest
from systems import make_model, raw_run, rest_state, smooth_state

from sma_sim import Input
from sma_sim.compiler.compile import package_compiler
from sma_sim.model.layout import SystemState
from sma_sim.solver import rosenbrock
from sma_sim.solver.rosenbrock import ROS34PW2, RosenbrockMethod
from sma_sim.solver.simulate import new_work
from sma_sim.solver.stepper import ORDER, Segment, Step, dense, linearize_flow, prepare_dense, rosenbrock_step

METHODS = [value for value in vars(rosenbrock).values() if isinstance(value, RosenbrockMethod)]
HALVINGS = np.array([1, 2, 4, 8])
LINEAR_STRAIN, HELD_POWER = (True, False, False), (False, False)


# Coefficients


def untransformed(method):
    """alpha, beta = alpha + Gamma, and Gamma of the textbook form (Hairer and Wanner, equation IV.7.25)."""
    Gamma = np.linalg.inv(np.eye(6) / method.gamma - method.C)
    alpha = method.a @ Gamma
    return alpha, alpha + Gamma, Gamma


def residuals(method, u_weights, theta=1.0):
    """Order conditions of orders 1, 2, 3, 3, 4, 4, 4, 4 at a fraction of the step (Hairer and Wanner, table IV.7.1)."""
    alpha, beta, Gamma = untransformed(method)
    b, a_i, b_i = u_weights @ Gamma, alpha.sum(1), beta.sum(1)
    return np.array(
        [
            b.sum() - theta,
            b @ b_i - theta**2 / 2,
            b @ a_i**2 - theta**3 / 3,
            b @ beta @ b_i - theta**3 / 6,
            b @ a_i**3 - theta**4 / 4,
            b @ (a_i * (alpha @ b_i)) - theta**4 / 8,
            b @ beta @ a_i**2 - theta**4 / 12,
            b @ beta @ beta @ b_i - theta**4 / 24,
        ]
    )


@pytest.mark.parametrize('method', METHODS, ids=lambda method: method.name)
def test_coefficients(method):
    alpha, _, Gamma = untransformed(method)
    result, embedded = method.a[5] + np.eye(6)[5], method.a[5]
    assert np.diag(Gamma) == pytest.approx(method.gamma, abs=1e-13)
    assert method.c == pytest.approx(alpha.sum(1), abs=1e-13)
    assert method.d == pytest.approx(Gamma.sum(1), abs=1e-13)
    assert method.order == 4
    assert np.abs(residuals(method, result)).max() < 1e-13
    assert np.abs(residuals(method, embedded)[:4]).max() < 1e-13
    assert np.abs(residuals(method, embedded)[4:]).max() > 1e-3  # else it would estimate no error
    for theta in (0.2, 0.5, 0.9):
        between = theta * result + theta * (1 - theta) * (method.H[0] + theta * method.H[1])
        assert np.abs(residuals(method, between, theta)[:4]).max() < 1e-13


@pytest.mark.parametrize('method', METHODS, ids=lambda method: method.name)
def test_l_stability(method):
    """|R(z)| <= 1 on the imaginary axis and R(infinity) = 0."""
    _, beta, Gamma = untransformed(method)
    b = (method.a[5] + np.eye(6)[5]) @ Gamma

    def R(z):
        return 1 + z * b @ np.linalg.solve(np.eye(6) - z * beta, np.ones(6))

    assert max(abs(R(1j * w)) for w in np.geomspace(1e-3, 1e5, 400)) <= 1.0 + 1e-12
    assert abs(R(-1e8)) < 1e-6


def test_steps_over_rows_are_of_order_3_with_any_matrix():
    """The conditions of W-methods (Hairer and Wanner, section IV.7), of order 2 of what estimates the error, L-stability."""
    method = ROS34PW2
    Gamma = np.linalg.inv(np.eye(4) / method.gamma - method.C)
    alpha = method.a @ Gamma
    u = method.a[3] + np.eye(4)[3]
    b, embedded, a_i, g_i = u @ Gamma, (u - method.error) @ Gamma, alpha.sum(1), Gamma.sum(1)
    conditions = [(b.sum(), 1), (b @ a_i, 1 / 2), (b @ g_i, 0), (b @ a_i**2, 1 / 3), (b @ alpha @ a_i, 1 / 6)]
    conditions += [(b @ alpha @ g_i, 0), (b @ Gamma @ a_i, 0), (b @ Gamma @ g_i, 0)]
    conditions += [(embedded.sum(), 1), (embedded @ a_i, 1 / 2), (embedded @ g_i, 0)]
    for found, expected in conditions:
        assert found == pytest.approx(expected, abs=1e-13)
    assert abs(embedded @ a_i**2 - 1 / 3) > 1e-2  # else it would estimate no error

    def R(z):
        return 1 + z * b @ np.linalg.solve(np.eye(4) - z * (alpha + Gamma), np.ones(4))

    assert max(abs(R(1j * w)) for w in np.geomspace(1e-3, 1e5, 400)) <= 1.0 + 1e-12 and abs(R(-1e8)) < 1e-6


# Steps


def fixed_steps(model, start, duration, count, theta=None):
    """The state after equal steps; with theta, the dense output at that fraction of the only step."""
    work, y, h = new_work(model), start.y.copy(), duration / count
    segment = Segment(0.0, duration, start.u, start.du, bool((start.du != 0).any()))
    state = SystemState(y, start.mode, start.x_frozen)
    compiled = package_compiler().function
    linear, step, prepare, output = (compiled(f) for f in (linearize_flow, rosenbrock_step, prepare_dense, dense))
    for k in range(count):
        linear(k * h, state, segment, model.compiled, work, False)
        step(Step(k * h, h), state, segment, model.compiled, work)
        if theta is not None:
            prepare(work)
            output(theta, y, work)
            return work.y_dense.copy()
        y[:] = work.y_new
    return y


def orders(errors):
    return np.log2(np.array(errors[:-1]) / np.array(errors[1:]))


def model_of(name):
    """The model of a problem."""
    if name == 'viscous mas wire':  # slow kinetics, a hysteresis so high that no barrier vanishes (kinks of order 2)
        return make_model('wire', 'mas', wire__V_L=2e-27, wire__omega_x=0.3, wire__dsigma=2e8)
    return make_model('wire') if name.startswith('wire') else make_model('module', solver__rtol=1e-10)


def problem(name):
    """A state on a smooth stretch, and a number of steps for 1 s."""
    model = model_of(name)
    if name.startswith('wire'):
        return rest_state(model, T=310.0, u=[0.03, 1.0, 298.0], du=[0.01, 0.0, 0.0], mode=int(name[-1]), x=0.4), 3
    if name == 'viscous mas wire':
        return rest_state(model, T=310.0, u=[0.033, 0.2, 298.0], du=[0.0, 0.0, 0.0], mode=3, x=0.4), 4
    return smooth_state(model, J_eq=10.0, after=1.0), 4


PROBLEMS = ['wire in mode 3', 'wire in mode 4', 'wire in mode 5', 'viscous mas wire', 'module in modes 5 and 4']


@pytest.mark.parametrize('name', PROBLEMS)
def test_order_of_steps(name, interpreted):
    """The stated order, on the paper's stiff module too; as plain Python, for which nothing is compiled."""
    start, count = problem(name)

    def errors_of_steps():
        model = model_of(name)
        exact = fixed_steps(model, start, 1.0, 32 * count)
        return [np.abs((fixed_steps(model, start, 1.0, int(n) * count) - exact) / model.scales).max() for n in HALVINGS]

    errors = interpreted(errors_of_steps)
    assert ORDER == 4
    assert orders(errors).mean() == pytest.approx(4.0, abs=0.4)
    assert errors[-1] < 1e-4


@pytest.mark.parametrize('name', PROBLEMS)
@pytest.mark.parametrize('theta', [0.3, 0.7])
def test_order_of_the_dense_output(name, theta, interpreted):
    """Order 3: the error within one step falls with h^4."""
    start, count = problem(name)

    def error(h):
        model = model_of(name)
        exact = fixed_steps(model, start, theta * h, 40)
        return np.abs((fixed_steps(model, start, h, 1, theta) - exact) / model.scales).max()

    errors = interpreted(lambda: [error(0.5 / count / n) for n in HALVINGS])
    assert orders(errors).mean() > (2.9 if name.startswith('module') else 3.4)  # stiffness costs half an order


# Events


def test_time_of_an_event_on_a_straight_line():
    """Austenite at rest, strain linear: sigma reaches sigma_A at a known time, exactly, whatever the step."""
    model = make_model('wire', initial__x_M_1=0.0, solver__rtol=0.1)
    sigma_A = 121.35e6 + 2.13e6 * (298.0 - 323.0) + 6.15e6
    for rate in (1e-4, 1e-2, 1.0):
        expected = sigma_A / 12.3e9 / rate
        end = 0.04 / rate
        source = Input(np.array([0.0, end]), np.array([[0.0, 0.0, 298.0], [0.04, 0.0, 298.0]]), LINEAR_STRAIN)
        jumps = raw_run(model, source, []).jumps
        assert jumps[0, 0] == pytest.approx(expected, rel=1e-8)  # the guard's tolerance is 1e-9 of dsigma


def heated_martensite(max_step):
    """Time at which sigma_M(T) passes the constant stress of a heated wire of martensite; closed form and computed."""
    model = make_model('wire', initial__x_M_1=1.0, solver__rtol=0.1)
    w, strain, J, T_E = model.compiled.wire, 0.0815, 0.5, 298.0
    T_jump = 323.0 + (7.8e9 * (strain - 0.067) + 6.15e6 - 121.35e6) / 2.13e6
    T_end = T_E + J / (w.lambda_ * w.surface)
    time_constant = w.volume * w.rho * w.c_V / (w.lambda_ * w.surface)
    expected = -time_constant * np.log((T_end - T_jump) / (T_end - T_E))
    source = Input(np.array([0.0, 2.0]), np.array([[strain, J, T_E]] * 2), LINEAR_STRAIN)
    jumps = raw_run(model, source, [], max_step=max_step).jumps
    assert T_E < T_jump < T_end
    return jumps[0, 0], expected


def test_order_of_event_times():
    """Against the closed form T = T_end + (T_E - T_end) exp(-t/t_c) of a wire in mode 2."""
    errors = []
    for max_step in 0.08 / HALVINGS:
        found, expected = heated_martensite(max_step)
        errors.append(abs(found - expected))
    assert orders(errors).mean() > 3.0
    assert errors[-1] < 1e-8


def test_samples_between_steps():
    """Samples between steps are as good as the steps: a loose run sampled finely against a tight one."""
    source = Input(np.array([0.0, 5.0, 10.0]), np.array([[10.0, 298.0], [-5.0, 298.0], [0.0, 298.0]]), HELD_POWER)
    times = np.linspace(0.0, 10.0, 2001)
    loose, tight = (raw_run(make_model('module', solver__rtol=rtol), source, times) for rtol in (1e-4, 1e-9))
    assert np.abs(loose.pose - tight.pose).max(axis=0) == pytest.approx(0.0, abs=2e-4)
    assert np.degrees(np.abs(loose.pose[:, 2] - tight.pose[:, 2]).max()) < 0.01
