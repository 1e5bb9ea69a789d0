"""Parts of the solver by themselves, in plain Python: which steps are tried, when a run is given up, inputs, matrices."""

from types import SimpleNamespace

import numpy as np
import pytest

from sma_sim import Input, UserError, module_input, wire_input
from sma_sim.solver import integrate as integration
from sma_sim.solver.fixed_rate import first_steps, held_inputs, steps_per_sample
from sma_sim.solver.inputs import input_between, inputs_at, regular_times, requested_times, segments
from sma_sim.solver.integrate import (
    C_BURST,
    C_DWELL,
    C_H,
    C_LAST_JUMP,
    C_WINDOW,
    C_WIRES,
    COMPLETED,
    N_CHATTER,
    N_JUMPS,
    N_REJECTED,
    N_SIZE,
    N_STEPS,
    N_WINDOW,
    NOT_FINITE,
    PER_WIRE_CONTROLS,
    RATE_NOT_FINITE,
    STALLED,
    STEP_LIMIT,
    STEP_UNDERFLOW,
    Limits,
    Run,
    accepted_step,
    is_stalled,
    of_wire,
    record_jump,
    tighten_rates,
)
from sma_sim.solver.linear import eliminate, elimination, invert, invert_shifted, multiply, solve_eliminated, solve_shifted
from sma_sim.solver.paper_experiments import RandomRuns, SineResponse, random_steps
from sma_sim.solver.stepper import ORDER, Segment
from sma_sim.solver.tangent_algebra import (
    add_combination,
    add_flow,
    clear,
    copy_matrix,
    interpolate,
    interpolation,
    solve_for_all,
    subtract_product,
)

FREE = Limits(np.inf, 1000, 1e-6)


def new_state(wires=2, states=3):
    control = np.zeros(C_WIRES + PER_WIRE_CONTROLS * wires)
    control[C_WIRES + C_LAST_JUMP :: PER_WIRE_CONTROLS] = -1.0
    return Run(SimpleNamespace(y=np.zeros(states)), control, np.zeros(N_SIZE, dtype=np.int64), np.zeros((states, states)))


def tried(monkeypatch, errors, h, end=1.0, mas=False, limits=FREE):
    """The steps that are tried from time 0 where they have these errors, then what `accepted_step` says, and the run."""
    run, lengths, left = new_state(), [], list(errors)

    def step_with_error(step, *_):
        lengths.append(step.h)
        return left.pop(0)

    monkeypatch.setattr(integration, 'rosenbrock_step', step_with_error)
    segment = Segment(0.0, end, np.zeros(2), np.zeros(2), False)
    found = accepted_step(0.0, h, run, segment, SimpleNamespace(mas=mas, imposed_T=-1, coordinates=0), None, limits)
    return lengths, found, run


@pytest.mark.parametrize(
    ('h', 'first'), [(0.3, 0.3), (0.6, 0.6), (0.61, 0.5), (0.9999985, 0.5), (0.9999995, 1.0), (1.0, 1.0), (7.0, 1.0)]
)
def test_the_last_two_steps_of_a_stretch_share_it(monkeypatch, h, first):
    lengths, (status, made), run = tried(monkeypatch, [1.0], h)
    assert lengths == [first] == [made] and status == COMPLETED and run.count[N_STEPS] == 1
    assert run.control[C_H] == pytest.approx(max(0.9 * first, 0.0))


def test_the_next_step_is_made_from_the_error(monkeypatch):
    """0.9 error^(-1/4) of the last, between limits; one that a stretch has cut keeps what was planned."""
    for error, factor in ((1.0, 0.9), (0.2, 0.9 * 0.2 ** (-1.0 / ORDER)), (0.0, 5.0)):
        _, _, run = tried(monkeypatch, [error], 0.1)
        assert run.control[C_H] == pytest.approx(0.1 * factor)
    _, _, run = tried(monkeypatch, [0.0], 0.1, mas=True)
    assert run.control[C_H] == pytest.approx(0.1 * 2.5)
    lengths, (status, made), run = tried(monkeypatch, [16.0, 1e9, 1.0], 0.1)
    assert lengths == pytest.approx([0.1, 0.045, 0.15 * 0.045]) and (status, made) == (COMPLETED, lengths[-1])
    assert run.count[N_STEPS] == 3 and run.count[N_REJECTED] == 2
    lengths, _, run = tried(monkeypatch, [16.0, 4.0, 1.0], 0.1, mas=True)  # falls with the second power, as over a front
    order = np.log(4.0) / np.log(1.0 / 0.45)
    assert lengths == pytest.approx([0.1, 0.045, 0.9 * 4.0 ** (-1.0 / order) * 0.045])
    assert run.control[C_H] == pytest.approx(5.0 * lengths[-1])
    run = new_state()
    run.control[C_H] = 0.7
    monkeypatch.setattr(integration, 'rosenbrock_step', lambda *_: 1.0)
    segment = Segment(0.0, 0.2, np.zeros(2), np.zeros(2), False)
    accepted_step(0.0, 0.7, run, segment, SimpleNamespace(mas=False, imposed_T=-1, coordinates=0), None, FREE)
    assert run.control[C_H] == 0.7  # though 0.2 were made
    accepted_step(0.0, 0.1, run, segment, SimpleNamespace(mas=False, imposed_T=-1, coordinates=0), None, FREE)
    assert run.control[C_H] == pytest.approx(0.09)


def test_reasons_to_give_up(monkeypatch):
    assert tried(monkeypatch, [1.0], 0.1, limits=Limits(np.inf, 0, 1e-6))[1][0] == STEP_LIMIT
    assert tried(monkeypatch, [2.0] * 5, 0.1, limits=Limits(np.inf, 3, 1e-6))[1][0] == STEP_LIMIT
    lengths, (status, _), _ = tried(monkeypatch, [1e9] * 50, 0.1)
    assert status == STEP_UNDERFLOW and 1e-15 < lengths[-1] < 1e-13
    assert tried(monkeypatch, [np.inf] * 50, 0.1)[1][0] == RATE_NOT_FINITE
    run = new_state()
    run.state.y[1] = np.nan
    segment = Segment(0.0, 1.0, np.zeros(2), np.zeros(2), False)
    monkeypatch.setattr(integration, 'rosenbrock_step', lambda *_: np.inf)
    assert accepted_step(0.0, 0.1, run, segment, SimpleNamespace(mas=False), None, FREE)[0] == NOT_FINITE


def test_a_run_is_stalled_when_a_window_of_steps_leads_nowhere():
    """The first window begins with the first step; steps of the least length are just long enough."""
    for length, stalled in ((0.99e-6, True), (1.01e-6, False)):
        run, said = new_state(), []
        for k in range(40_002):
            said.append(is_stalled(5.0 + k * length, run, FREE))
        assert said.index(True) == 20_000 if stalled else not any(said)
    run.control[C_WINDOW] = 3.0
    assert not is_stalled(7.0, new_state(), FREE)
    for end, stalled in ((20_000.0, False), (19_999.0, True)):  # no longer than they must be in the mean
        run = new_state()
        run.count[N_WINDOW], run.control[C_WINDOW] = 20_000, 0.0
        assert is_stalled(end, run, Limits(np.inf, 1000, 1.0)) == stalled
        assert run.control[C_WINDOW] == end and run.count[N_WINDOW] == 1


def test_before_a_run_is_given_up_its_rates_are_resolved_once(monkeypatch):
    work, run = SimpleNamespace(weight=np.ones(7)), new_state()
    moving = SimpleNamespace(coordinates=2, mas=False)
    assert tighten_rates(run, moving, work) and work.weight.tolist() == [1.0, 1.0, 0.01, 0.01, 1.0, 1.0, 1.0]
    assert not tighten_rates(run, moving, work) and work.weight[2] == 0.01
    assert not tighten_rates(new_state(), SimpleNamespace(coordinates=0), work)
    monkeypatch.setattr(integration, 'is_stalled', lambda *_: True)
    assert tried(monkeypatch, [1.0], 0.1)[1][0] == STALLED


def test_a_wire_that_jumps_often_waits_and_is_forgiven():
    """More than 16 jumps in a millisecond: each further one doubles the wait; a quiet time ends it, of this wire alone."""
    run, jumps = new_state(), np.zeros((5, 3))
    dwell, burst = of_wire(1, C_DWELL), of_wire(1, C_BURST)
    waits = []
    for _ in range(20):
        record_jump(2.0, 1, 6, run, jumps)
        waits.append(run.control[dwell])
    assert waits == [0.0] * 16 + [1e-5, 2e-5, 4e-5, 8e-5] and run.count[N_CHATTER] == 4
    assert run.count[N_JUMPS] == 20 and (jumps == [2.0, 1.0, 6.0]).all()
    assert run.control[of_wire(0, C_BURST)] == run.control[of_wire(0, C_DWELL)] == 0.0
    record_jump(2.001, 1, 6, run, jumps)
    assert run.control[burst] == pytest.approx(1.0 + 20.0 * np.exp(-1.0)) and run.control[dwell] == waits[-1]
    record_jump(3.0, 1, 6, run, jumps)
    assert run.control[burst] == pytest.approx(1.0) and run.control[dwell] == 0.0
    assert run.control[of_wire(1, C_LAST_JUMP)] == 3.0 and run.control[of_wire(0, C_LAST_JUMP)] == -1.0
    run.control[dwell] = 0.5
    record_jump(3.0, 1, 6, run, jumps)
    assert run.control[burst] == 2.0 and run.control[dwell] == 0.5  # two at once are no quiet time


@pytest.mark.parametrize('linear', [(False, False), (True, False), (True, True)])
def test_stretches_of_an_input_say_the_same_as_its_rows(linear):
    """At every time, with fewer rows where nothing changes, and more where a linear column passes through zero."""
    random = np.random.default_rng(6)
    for count in (1, 2, 3, 30):
        values = random.integers(-2, 3, (count, 2)).astype(float)
        source = Input(np.cumsum(random.uniform(0.1, 1.0, count)), values, linear)
        times, starts, slopes = segments(source)
        assert (times[0], times[-1]) == (source.times[0], source.times[-1]) and (np.diff(times) > 0.0).all()
        asked = np.unique(np.concatenate([np.linspace(times[0], times[-1], 97), times]))
        at = np.searchsorted(times, asked, side='right') - 1
        shown = starts[at] + slopes[at] * (asked - times[at])[:, None]
        expected = inputs_at(source, asked)
        assert (expected.pop('time_s') == asked).all() and list(expected) == ['J_eq_W', 'T_E_K']
        assert shown == pytest.approx(np.column_stack(list(expected.values())), abs=1e-9)
        ends = starts[:-1] + slopes[:-1] * np.diff(times)[:, None]
        assert (starts[:-1] * ends > -1e-9)[:, np.array(linear)].all()  # no linear column changes its sign within
        same = (
            (slopes[1:-1] == 0.0).all(axis=1) & (slopes[:-2] == 0.0).all(axis=1) & (starts[1:-1] == starts[:-2]).all(axis=1)
        )
        assert not same.any()
    held = module_input([0.0, 1.0, 2.0, 3.0], [4.0, 4.0, 4.0, 5.0])
    assert segments(held)[0].tolist() == [0.0, 3.0] and segments(module_input([0.0, 1.0], [2.0, 2.0]))[0].tolist() == [
        0.0,
        1.0,
    ]


def test_times_of_samples():
    source = wire_input([1.0, 2.0, 3.05], [0.0, 0.01, 0.0])
    assert regular_times(source, 10.0) == pytest.approx(1.0 + 0.1 * np.arange(21))
    assert requested_times(source, 1.0).tolist() == [1.0, 2.0, 3.0]
    exact = regular_times(module_input([0.0, 0.3], [0.0, 0.0]), 10.0)  # 0.3 * 10 is less than 3
    assert len(exact) == 4 and exact[-1] == 0.3
    assert requested_times(source, np.array([1.0, 3.05])).tolist() == [1.0, 3.05] and len(requested_times(source, [])) == 0
    for wrong in ([0.9, 2.0], [2.0, 3.1], [1.5, 1.5], [[1.0, 2.0]]):
        with pytest.raises(UserError):
            requested_times(source, np.array(wrong))
    between = input_between(source, 1.0, 2.0)
    assert between.times.tolist() == [1.0, 2.0] and between.linear == source.linear and len(between.values) == 2


def test_rows_take_effect_at_the_first_step_that_begins_with_them_or_later():
    assert first_steps(np.array([0.0, 0.1, 0.101, 0.19999999, 0.2]), 10.0).tolist() == [0, 1, 2, 2, 2]
    source = module_input([0.2, 0.45, 0.46, 0.8], [1.0, 2.0, 3.0, 4.0])
    first, inputs = held_inputs(source, 10.0)
    assert first == 2 and inputs[:, 0].tolist() == [1.0, 1.0, 1.0, 3.0, 3.0, 3.0]
    assert held_inputs(module_input([0.5], [7.0]), 10.0)[1].tolist() == [[7.0, 298.0]]
    assert steps_per_sample(1000.0, 100.0) == 10 == steps_per_sample(100.0, 10.0) and steps_per_sample(1.0, 1.0) == 1
    for rates in ((1000.0, 300.0), (100.0, 1000.0)):
        with pytest.raises(UserError):
            steps_per_sample(*rates)


def test_inverses_and_shifted_equations_are_those_of_numpy():
    """Also where rows must be exchanged; coordinates change by their rates alone."""
    random = np.random.default_rng(7)
    for n, first in ((1, 0), (2, 0), (5, 0), (6, 2)):
        for _ in range(5):
            A = random.normal(size=(n, n)) * (random.random((n, n)) < 0.8) + 1e-3 * np.eye(n)
            A[first, first] = 0.0 if n > 1 else 1.0
            A[first, -1], A[-1, first] = 2.0, -3.0
            block, before, pivot = A[first:, first:].copy(), A[first:, :first].copy(), np.zeros(n, dtype=np.int64)
            assert invert(A, pivot, first)
            assert A[first:, first:] == pytest.approx(np.linalg.inv(block))
            assert A[first:, :first] == pytest.approx(np.linalg.inv(block) @ before)
            b, x = random.normal(size=n), np.full(n, 9.0)
            multiply(A, b, x, first)
            assert x[first:] == pytest.approx((A @ b)[first:]) and (x[:first] == 9.0).all()
    for coordinates in (0, 2, 3):
        n, shift = 2 * coordinates + 2, 40.0
        J = random.normal(size=(n, n))
        J[:coordinates] = 0.0
        J[np.arange(coordinates), coordinates + np.arange(coordinates)] = 1.0
        A, b, x = np.zeros((n, n)), random.normal(size=n), np.zeros(n)
        assert invert_shifted(J, shift, coordinates, A, np.zeros(n, dtype=np.int64))
        solve_shifted(A, b, x, coordinates)
        assert x == pytest.approx(np.linalg.solve(shift * np.eye(n) - J, b))
        many, found = random.normal(size=(n, 3)), np.full((n, 3), 9.0)
        solve_for_all(A, many, found, coordinates)
        assert found == pytest.approx(np.linalg.solve(shift * np.eye(n) - J, many))


@pytest.mark.parametrize('wrong', [0.0, np.nan, np.inf])
def test_what_cannot_be_inverted_is_said(wrong):
    pivot, order = np.zeros(3, dtype=np.int64), np.arange(3)
    A = np.diag([1.0, wrong, 2.0])
    assert not invert(A.copy(), pivot, 0) and not invert(A.copy(), pivot, 1) and invert(A.copy(), pivot, 2)
    e = elimination(np.eye(3, dtype=bool), order, np.zeros(0, dtype=bool))
    assert not eliminate(-A, 0.0, np.zeros((3, 3)), e)
    assert eliminate(np.zeros((3, 3)), 2.0, np.zeros((3, 3)), e)
    assert not invert_shifted(np.eye(3) - A, 1.0, 0, np.zeros((3, 3)), pivot)


def test_elimination_in_any_order_solves_what_has_its_pattern():
    random = np.random.default_rng(8)
    for _ in range(20):
        n = int(random.integers(2, 9))
        pattern = (random.random((n, n)) < 0.3) | np.eye(n, dtype=bool)
        e = elimination(pattern, random.permutation(n), np.zeros(0, dtype=bool))
        J, A, b = random.normal(size=(n, n)) * pattern, np.full((n, n), np.nan), random.normal(size=n)
        x = b.copy()
        assert eliminate(J, 20.0, A, e)
        solve_eliminated(A, e, x)
        assert x == pytest.approx(np.linalg.solve(20.0 * np.eye(n) - J, b))


def test_products_of_tangents_are_those_of_matrices():
    random = np.random.default_rng(9)
    f, s, r, y = (random.normal(size=size) for size in ((4, 7), (4, 3), (3, 3), (4, 3)))
    total = f @ np.vstack([s, r])
    found = y.copy()
    add_flow(f, s, r, found)
    assert found == pytest.approx(y + total)
    subtract_product(f, s, r, found)
    assert found == pytest.approx(y)
    stages, table = random.normal(size=(6, 4, 3)), random.normal(size=(6, 6))
    add_combination(2.0, table, 4, 3, stages, found)
    assert found == pytest.approx(y + 2.0 * np.tensordot(table[4, :3], stages[:3], 1))
    copy_matrix(found, s)
    assert (found == s).all()
    clear(found)
    assert not found.any()
    for theta in (0.0, 0.3, 0.5, 1.0):  # a parabola through three nodes is the parabola
        shape = random.normal(size=(3, 2, 2))
        nodes = np.array([shape[0] + t * (shape[1] + t * shape[2]) for t in (0.0, 0.5, 1.0)])
        at = np.full((2, 2), 7.0)
        interpolate(interpolation(theta), nodes, 1, at)
        assert at[0] == pytest.approx((shape[0] + theta * (shape[1] + theta * shape[2]))[0]) and (at[1] == 7.0).all()


def test_random_steps_of_the_papers_experiment():
    """Amplitudes and lengths within their limits, up to the end of the run, whose last row is no step."""
    amplitudes, lengths = [], []
    for seed in range(40):
        source = random_steps(np.random.default_rng(seed))
        assert (source.times[0], source.times[-1]) == (0.0, 100.0) and source.values[-1, 0] == source.values[-2, 0]
        amplitudes += list(source.values[:, 0])
        lengths += list(np.diff(source.times)[:-1])
    assert -15.0 <= min(amplitudes) < -14.0 and 14.0 < max(amplitudes) <= 15.0  # [W]
    assert 2.0 <= min(lengths) < 2.5 and 17.5 < max(lengths) <= 18.0  # [s]


def test_figures_of_the_papers_experiments():
    gap = np.array([[1.0, -3.0], [2.0, 0.0]])
    runs = RandomRuns({'alpha_rad': gap}, (), (None, {'hybrid': {'alpha_rad': np.array([-1.0, 4.0, 2.0])}}))
    assert runs.difference_of('alpha_rad') == pytest.approx((1.5, np.sqrt(3.5), 3.0)) and runs.swing == 5.0
    phase = np.linspace(0.0, 2.0 * np.pi, 201)
    loop = {'hybrid': np.sin(phase - 0.1), 'mas': np.sin(phase - 0.3)}
    sine = SineResponse(np.sin(phase), loop)
    assert sine.width('hybrid') == pytest.approx(2.0 * np.sin(0.1)) and sine.width('mas') == pytest.approx(2.0 * np.sin(0.3))
    assert sine.largest_difference == pytest.approx(2.0 * np.sin(0.1), rel=1e-3)
