"""Laws that can be written down in one line: kernels of effects, shapes of the beam, rows of a sample, the start."""

import math
from dataclasses import replace

import numpy as np
import pytest
from systems import COMBINATIONS, active, evaluate, make_model, random_state, raw_run

from sma_sim import Model, find_effects, module_input, simulate, wire_input
from sma_sim.model.automaton import AUSTENITE, INNER, MARTENSITE
from sma_sim.model.effects.library import polycrystal
from sma_sim.model.effects.ports import S_CHANNEL, S_POSE, S_STRAIN, S_T_OTHER, S_VALUE, S_X, S_X_OTHER, State
from sma_sim.model.layout import O_S_A, O_S_M, O_SIGMA, O_X
from sma_sim.model.structures.geometry import shape_of
from sma_sim.solver.integrate import C_DWELL, FIRST_DWELL, N_CHATTER, N_JUMPS, of_wire, record_jump
from sma_sim.solver.simulate import new_run, new_work

BEAM, WIRE = make_model().constants, make_model().compiled.wire
FIELDS = dict.fromkeys(State._fields, 0.0)


def values(name, memory=None, constants=WIRE, part='kernel', state=FIELDS, **parameters):
    """What the kernel (or the rate) of an effect returns."""
    effect = find_effects()[name]
    declared = (*effect.parameters, *(q for q, *_ in effect.each_bundle))
    p = type('P', (), {q.name: parameters.get(q.name, q.default) for q in declared})
    given = (State(**{**FIELDS, **state}), constants, p)
    return np.array(getattr(effect, part)(*given, *(() if memory is None else (memory,))))


def test_mismatched_gains_have_the_ratio_and_keep_the_product():
    left, right = (values('power_gain_mismatch', state={'J': 3.0, 'wire': wire}, ratio=1.44) for wire in (0.0, 1.0))
    assert left / right == pytest.approx(1.44) and left * right == pytest.approx(9.0)


@pytest.mark.parametrize('theta', [-0.4, 0.1])
def test_a_turned_camera_keeps_lengths_and_sees_the_angle_against_itself(theta):
    U_x, U_y = 2e-3, -5e-3
    pose = {'U_x': U_x, 'U_y': U_y}
    x, y, alpha = (
        values('sensor_misalignment', state={**pose, 'value': value, 'channel': float(channel)}, theta=theta)
        for channel, value in enumerate((U_x, U_y, 0.3))
    )
    assert complex(x, y) == pytest.approx(complex(U_x, U_y) * np.exp(-1j * theta))
    assert alpha == pytest.approx(0.3 - theta)


def test_warm_air_settles_where_it_gives_off_what_it_takes():
    """Theta = R Q with the heat Q that all wires of the bundle give to it, [K] = [K/W] [W]."""
    R, T, T_E = 2.0, 360.0, 298.0
    memory = type('M', (), {})
    conductance = WIRE.n * WIRE.lambda_ * WIRE.surface
    memory.Theta = R * conductance * (T - T_E) / (1.0 + R * conductance)
    state = {'T': T, 'T_E': T_E}
    assert values('ambient_heating', memory, part='rate', state=state, R=R, tau=10.0) == pytest.approx(0.0, abs=1e-12)
    assert values('ambient_heating', memory, state=state) == pytest.approx(WIRE.lambda_ * WIRE.surface * memory.Theta)


def test_a_current_source_heats_by_the_resistance():
    """dJ/J = r dx + a dT about half martensite at T0."""

    def heat(x, T):
        return float(values('resistance_feedback', state={'J': 2.0, 'x': x, 'T': T}, r=0.2, a=1e-3))

    assert heat(0.5, WIRE.T0) == 2.0
    assert heat(1.0, WIRE.T0) / heat(0.0, WIRE.T0) == pytest.approx(1.1 / 0.9)
    assert heat(0.5, WIRE.T0 + 100.0) == pytest.approx(2.2) and heat(0.5, WIRE.T0 - 100.0) == pytest.approx(1.8)


def test_quantile_of_the_grains():
    """From -1/2 to 1/2, odd about the middle, and with no corner at its ends."""
    q, h = polycrystal.quantile, 1e-6
    assert q(0.0) == pytest.approx(-0.5) and q(0.5) == 0.0 and q(1.0) == pytest.approx(0.5)
    for x in (-0.1, 0.2, 0.7, 1.2):
        assert q(1.0 - x) == pytest.approx(-q(x)) and q(x + h) > q(x)
    for end in (0.0, 1.0):
        assert (q(end + h) - q(end)) / h == pytest.approx((q(end) - q(end - h)) / h, rel=1e-3)


def test_nonlinear_beam_in_pure_bending_and_in_pure_shortening():
    """A moment that grows by 1 + b (L kappa)^2; a force that is gone where the beam has shortened by U_x = -c S."""
    a, b = 0.2, 5.0
    arc = {'U_y': BEAM.L * a / 2, 'alpha': a}
    F = values('beam_nonlinearity', constants=BEAM, state=arc, b=b, c=0.0)
    assert F[2] == pytest.approx(-BEAM.k_a / 4.0 * b * a**3) and F[1] == pytest.approx(0.0, abs=1e-9)
    tilted = {'U_y': 3e-3, 'alpha': -0.1}
    S = 0.6 * 9e-6 / BEAM.L + 0.1 * 3e-4 + BEAM.L * 0.01 / 15.0
    F = values('beam_nonlinearity', constants=BEAM, state={**tilted, 'U_x': -S}, b=0.0, c=1.0)
    assert F[0] == pytest.approx(-BEAM.k_x * S) and F[1:] == pytest.approx(0.0, abs=1e-9)


def test_forces_of_the_nonlinear_beam_have_a_potential():
    """dF_i/dq_j = dF_j/dq_i."""
    names, q, h = ('U_x', 'U_y', 'alpha'), np.array([1e-4, 4e-3, -0.2]), (1e-7, 1e-7, 1e-6)

    def force(at):
        return values('beam_nonlinearity', constants=BEAM, state=dict(zip(names, at, strict=True)), b=7.0, c=0.6)

    slopes = np.array([(force(q + d) - force(q - d)) / (2.0 * d.max()) for d in np.diag(h)])
    assert slopes == pytest.approx(slopes.T, rel=1e-6)


def test_drawn_shape_of_the_beam():
    """A cantilever: fixed and straight at its root, at the tip where and as the plate is; wires keep their distance."""
    U_x, U_y, alpha = -1e-3, 8e-3, 0.25
    shape = shape_of(U_x, U_y, alpha, BEAM, points=20_001)
    x, y = shape.beam.T
    assert (x[0], y[0]) == (0.0, 0.0) and (x[-1], y[-1]) == pytest.approx((BEAM.L + U_x, U_y))
    slope = np.gradient(y, np.linspace(0.0, BEAM.L, len(y)), edge_order=2)
    assert slope[0] == pytest.approx(0.0, abs=1e-6) and slope[-1] == pytest.approx(alpha, rel=1e-6)
    tops = [wire[1] for wire in shape.wires]
    assert math.dist(*tops) == pytest.approx(BEAM.W) and np.mean(tops, axis=0) == pytest.approx([BEAM.L + U_x, U_y])
    along = shape.plate[1] - shape.plate[0]
    assert along @ [math.cos(alpha), math.sin(alpha)] == pytest.approx(0.0, abs=1e-15)


def test_fields_of_the_state_are_where_their_names_say():
    fields = State._fields
    where = {'x': S_X, 'x_other': S_X_OTHER, 'T_other': S_T_OTHER, 'U_x': S_POSE, 'value': S_VALUE}
    where |= {'channel': S_CHANNEL, 'strain': S_STRAIN}
    assert {name: fields.index(name) for name in where} == where and len(fields) == S_POSE + 6


@pytest.mark.parametrize('kind', ['hybrid', 'mas'])
def test_each_wire_sees_the_other(kind):
    model = make_model('module', kind, [active('thermal_crosstalk')])
    state = random_state(model, np.random.default_rng(2))
    seen = model.compiled.effects.s
    assert state.obs[0, O_X] != state.obs[1, O_X]
    assert seen[:, S_X] == pytest.approx(state.obs[:, O_X]) and seen[:, S_X_OTHER] == pytest.approx(state.obs[::-1, O_X])
    T = state.y[model.compiled.first_T :][:2]
    assert seen[:, S_T_OTHER] == pytest.approx(T[::-1])


@pytest.mark.parametrize('kind', ['hybrid', 'mas'])
def test_columns_of_a_sample_belong_together(kind):
    """A strain that grows by 0.1 1/s: length, speed, and a force that is the stress over all sections."""
    model, times = make_model('wire', kind), np.linspace(0.02, 0.06, 5)
    wire = raw_run(model, wire_input([0.0, 0.1], [0.02, 0.03], [0.2, 0.2]), times).wires[0]
    w = model.compiled.wire
    assert wire['length'] == pytest.approx(w.l0 * (1.02 + 0.1 * times)) and wire['v'] == pytest.approx(0.1 * w.l0)
    assert wire['F'] == pytest.approx(w.n * w.section * wire['sigma']) and wire['J'] == pytest.approx(0.2)


@pytest.mark.parametrize('T_E', [298.0, 340.0, 400.0])
@pytest.mark.parametrize('requested', [0.0, 0.4, 1.0])
@pytest.mark.parametrize(('system', 'kind'), COMBINATIONS)
def test_a_start_lies_within_the_hysteresis(system, kind, requested, T_E):
    """sigma_M <= sigma <= sigma_A, but for wires that have no martensite, or no austenite, left to turn."""
    usual = make_model(system, kind)
    initial = {f'initial.x_M_{i + 1}': requested for i in range(usual.wires)}
    model = Model(replace(usual.config, parameters={**usual.config.parameters, **initial}))
    first = np.array([0.0, T_E] if system == 'module' else [0.02, 0.0, T_E])
    p = model.compiled
    run = new_run(model, first, new_work(model))
    state = run.state
    obs = evaluate(model, state.y, first, np.zeros(len(first)), state.mode, state.x_frozen).obs
    slack = 1e-6 * p.wire.dsigma
    for i in range(p.wires):
        x, sigma = state.x_frozen[i], obs[i, O_SIGMA]
        assert state.mode[i] == (AUSTENITE if x == 0.0 else MARTENSITE if x == 1.0 else INNER)
        assert x == 1.0 or sigma <= obs[i, O_S_A] + slack
        assert x == 0.0 or sigma >= obs[i, O_S_M] - slack


@pytest.mark.parametrize(
    ('system', 'channel', 'column', 'offset'),
    [('module', 'U_x', 'U_x_m', 3e-5), ('module', 'alpha', 'alpha_rad', 0.02), ('wire', 'stress', 'stress_Pa', 4e6)],
)
def test_an_offset_is_what_its_sensor_shows_more(system, channel, column, offset):
    source = module_input([0.0, 0.02], [9.0, 0.0]) if system == 'module' else wire_input([0.0, 0.02], [0.02, 0.03])
    none = {name: 0.0 for name in ('U_x', 'U_y', 'alpha', 'stress')}
    shown, biased = (
        simulate(
            make_model(system, 'hybrid', [active('sensor_bias', **{**none, channel: value})]), source, [0.0, 0.01, 0.02]
        )
        for value in (0.0, offset)
    )
    assert biased[column] - shown[column] == pytest.approx(offset)
    others = [name for name in shown.columns if name != column and not name.startswith('true')]
    assert all((biased[name] == shown[name]).all() for name in others)


def test_jumps_in_a_burst_make_a_wire_wait_and_single_ones_do_not():
    model = make_model('wire')
    for interval, waits in ((1.0, False), (1e-7, True)):
        run = new_run(model, np.array([0.02, 0.0, 298.0]), new_work(model))
        log = np.zeros((40, 3))
        for k in range(40):
            record_jump(1.0 + k * interval, 0, 1, run, log)
        assert run.count[N_JUMPS] == 40 and log[39] == pytest.approx([1.0 + 39 * interval, 0, 1])
        assert (run.control[of_wire(0, C_DWELL)] >= FIRST_DWELL) == waits and (run.count[N_CHATTER] > 0) == waits
        record_jump(100.0, 0, 1, run, log)
        assert run.control[of_wire(0, C_DWELL)] == 0.0
