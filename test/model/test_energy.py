"""First and second law, for both models, both systems, bare and with effects.

Along every flow dU/dt = f v + J - lambda A_s (T - T_E) + heat of effects, with U of material.internal_energy; a jump
does not change U; the dissipated power (Gamma(sigma) - Gamma(sigma_MW)) dx_M/dt is never negative.
"""

from itertools import pairwise

import numpy as np
import pytest
from systems import COMBINATIONS, active, evaluate, make_model, random_state, raw_run

from sma_sim import Input
from sma_sim.model.layout import O_DEPS, O_DL, O_DX, O_EPS, O_F, O_J, O_S_A, O_SIGMA, O_STRAIN, O_V, O_X
from sma_sim.model.material import gamma, internal_energy, latent_heat, sigma_MW
from sma_sim.solver.inputs import segments

COMPLEX_STEP = 1e-30  # derivatives of rational functions by complex steps are exact to rounding
ENERGETIC = [(), ('natural_convection',), ('ambient_heating',), ('natural_convection', 'ambient_heating'), ('polycrystal',)]


def modes_of(kind):
    return (1, 2, 3, 4, 5) if kind == 'hybrid' else (3,)


def energy_rate(state, i, p, strain_rate=0.0):
    """dU/dt of wire i [W] by the chain rule along the flow."""
    w, o, step = p.wire, state.obs[i], 1j * COMPLEX_STEP
    T = state.y[p.first_T + i] + step * state.dy[p.first_T + i]
    x = o[O_X] + step * o[O_DX]
    eps = o[O_EPS] - o[O_STRAIN] + step * (o[O_DEPS] - strain_rate)
    return internal_energy(eps - w.eps_T * x, T, x, w).imag / COMPLEX_STEP


def power(state, i, p):
    """What flows into wire i [W] without the heat of effects, and the sum of the magnitudes."""
    o, w = state.obs[i], p.wire
    T, T_E = state.y[p.first_T + i], state.u[-1]
    terms = [w.section * o[O_SIGMA] * o[O_V], o[O_J], -w.lambda_ * w.surface * (T - T_E)]
    return sum(terms), sum(abs(term) for term in terms)


def effect_heat(state, i, p, names, model):
    """Heat of natural_convection and ambient_heating, written down again here."""
    w, T, T_E = p.wire, state.y[p.first_T + i], state.u[-1]
    heat = 0.0
    if 'natural_convection' in names:
        heat -= 40.0 * w.surface * abs(T - T_E) ** 0.25 * (T - T_E)
    if 'ambient_heating' in names:
        heat += w.lambda_ * w.surface * state.y[len(model.scales) - p.wires + i]
    return heat


@pytest.mark.parametrize('names', ENERGETIC, ids=lambda names: '+'.join(names) or 'bare')
@pytest.mark.parametrize(('system', 'kind'), COMBINATIONS)
def test_first_law_at_every_state(system, kind, names):
    model = make_model(system, kind, [active(name) for name in names])
    p, random = model.compiled, np.random.default_rng(1)
    for mode in modes_of(kind):
        for _ in range(20):
            state = random_state(model, random, mode)
            for i in range(p.wires):
                into, size = power(state, i, p)
                into += effect_heat(state, i, p, names, model)
                # what is exchanged inside the wire is part of the scale: latent heat dwarfs the power in modes 4 and 5
                size += abs(latent_heat(state.y[p.first_T + i], state.obs[i, O_SIGMA], p.wire) * state.obs[i, O_DX])
                assert energy_rate(state, i, p) == pytest.approx(into, abs=1e-12 * size)


@pytest.mark.parametrize('kind', ['hybrid', 'mas'])
def test_first_law_of_the_whole_module(kind):
    """Wires, beam and plate together: heat in, friction out (the interconnection preserves power)."""
    model = make_model('module', kind)
    p, b, random = model.compiled, model.constants, np.random.default_rng(2)
    stiffness = np.array([[b.k_x, 0, 0], [0, b.k_y, -b.k_ya], [0, -b.k_ya, b.k_a]])
    mass, damping = np.array([b.m_H, b.m_H, b.J_H]), np.array([b.b_x, b.b_y, b.b_alpha])
    for _ in range(50):
        s = random_state(model, random)
        q, dq, ddq = s.y[:3], s.y[3:6], s.dy[3:6]
        structure = dq @ stiffness @ q + dq @ (mass * ddq)
        wires = p.wire.n * sum(energy_rate(s, i, p) for i in range(2))
        heat = p.wire.n * sum(power(s, i, p)[0] - p.wire.section * s.obs[i, O_SIGMA] * s.obs[i, O_V] for i in range(2))
        size = abs(dq * mass * ddq).sum() + abs(wires) + abs(heat)
        assert structure + wires == pytest.approx(heat - damping @ dq**2, abs=1e-12 * size)
        forces = s.obs[:, O_DL : O_DL + 3].T @ s.obs[:, O_F]
        assert forces @ dq == pytest.approx(s.obs[:, O_F] @ s.obs[:, O_V], abs=1e-12 * abs(forces * dq).sum())


@pytest.mark.parametrize('system', ['wire', 'module'])
def test_rate_of_an_algebraic_fraction(system):
    """dx_M/dt in modes 4 and 5 is the derivative of x_M(eps, T) along the flow."""
    model = make_model(system)
    random, h = np.random.default_rng(3), 1e-4
    for mode in (4, 5):
        for _ in range(20):
            s = random_state(model, random, mode)
            scale = h / max(1.0, np.abs(s.dy / model.scales).max(), np.abs(s.du).max() * 100)
            ends = [
                evaluate(model, s.y + sign * scale * s.dy, s.u + sign * scale * s.du, s.du, s.mode, s.x_frozen)
                for sign in (-1, 1)
            ]
            numerical = (ends[1].obs[:, O_X] - ends[0].obs[:, O_X]) / (2 * scale)
            assert numerical == pytest.approx(s.obs[:, O_DX], rel=1e-5, abs=1e-5 * np.abs(s.obs[:, O_DX]).max())


def test_thermal_expansion_leaves_out_what_it_says():
    """Its heat -Om sigma de/dt is not in the balance, and it is below 1 % of the latent heat on a full run."""
    model = make_model('module', 'hybrid', [active('thermal_expansion')])
    p, random = model.compiled, np.random.default_rng(4)
    for mode in (3, 4, 5):
        s = random_state(model, random, mode)
        for i in range(2):
            expansion = 11e-6 * s.dy[p.first_T + i]
            missing = energy_rate(s, i, p, expansion) - power(s, i, p)[0]
            assert missing == pytest.approx(-p.wire.volume * s.obs[i, O_SIGMA] * expansion, rel=1e-6)
    run = raw_run(model, heating_and_cooling(), np.linspace(0.0, 40.0, 4001))
    for wire in run.wires:
        latent = np.abs(latent_heat(wire['T'], wire['sigma'], p.wire) * wire['dx_M']).sum()
        thermoelastic = np.abs(p.wire.volume * wire['sigma'] * 11e-6 * np.gradient(wire['T'], 0.01)).sum()
        assert 0.0 < thermoelastic < 0.01 * latent


def heating_and_cooling():
    J_eq = [0.0, 12.0, -9.0, 0.0, 0.0]
    return Input(np.array([0.0, 1.0, 11.0, 25.0, 40.0]), np.column_stack([J_eq, np.full(5, 298.0)]), (False, False))


def random_wire_input(random):
    """Strain cycles, pulses of heat and steps of the ambient temperature."""
    times = np.concatenate([[0.0], np.cumsum(random.uniform(0.5, 3.0, 8))])
    strain = random.uniform(0.005, 0.065, 9)
    strain[0] = 0.03
    values = np.column_stack([strain, random.uniform(0, 1.5, 9), random.uniform(290, 310, 9)])
    return Input(times, values, (True, False, False))


def random_module_input(random):
    times = np.concatenate([[0.0], np.cumsum(random.uniform(0.5, 5.0, 8))])
    values = np.column_stack([random.uniform(-20, 20, 9), random.uniform(290, 310, 9)])
    return Input(times, values, (bool(random.integers(2)), False))


def quadrature(breaks):
    """Nodes and weights that integrate what is smooth between breaks, finer after each of them, and their ends."""
    x, weight = np.polynomial.legendre.leggauss(8)
    grading = np.unique(np.concatenate([np.geomspace(1e-6, 1.0, 60), np.linspace(0.0, 1.0, 300)]))
    edges = np.concatenate([a + (b - a) * grading[:-1] for a, b in pairwise(breaks) if b > a] + [[breaks[-1]]])
    half = 0.5 * np.diff(edges)
    return (edges[:-1, None] + half[:, None] * (1 + x)).ravel(), (half[:, None] * weight).ravel()


def energy(wire, w):
    """U of a wire at its samples."""
    return internal_energy(wire['length'] / w.l0 - 1.0 - w.eps_T * wire['x_M'], wire['T'], wire['x_M'], w)


def dissipation(wire, w):
    """Dissipated power density of a wire at its samples."""
    return (gamma(wire['sigma'], w) - gamma(sigma_MW(wire['T'], w), w)) * wire['dx_M']


@pytest.mark.parametrize('seed', range(3))
@pytest.mark.parametrize(('system', 'kind'), COMBINATIONS)
def test_first_law_over_random_runs(system, kind, seed):
    """Energy at the end less energy at the start is what was exchanged, to 1e-6 of its magnitude."""
    random = np.random.default_rng(seed)
    source = random_wire_input(random) if system == 'wire' else random_module_input(random)
    model = make_model(system, kind, solver__rtol=1e-9)
    w = model.compiled.wire
    jumps = raw_run(model, source, [0.0]).jumps[:, 0]
    breaks = np.unique(np.concatenate([segments(source)[0], jumps]))  # heating has a kink where J_eq changes sign
    nodes, weights = quadrature(breaks)
    run = raw_run(model, source, np.concatenate([[0.0], nodes, [breaks[-1]]]))
    T_E = source.values[np.searchsorted(source.times, nodes, side='right') - 1, -1]
    for wire in run.wires:
        inner = {name: column[1:-1] for name, column in wire.items()}
        powers = np.array([w.section * inner['sigma'] * inner['v'], inner['J'], -w.lambda_ * w.surface * (inner['T'] - T_E)])
        exchanged = (np.abs(powers) @ weights).sum()
        change = energy(wire, w)[-1] - energy(wire, w)[0]
        assert change == pytest.approx((powers @ weights).sum(), abs=1e-6 * exchanged)


@pytest.mark.parametrize('system', ['wire', 'module'])
def test_jumps_keep_energy_and_fraction(system):
    random = np.random.default_rng(7)
    source = random_wire_input(random) if system == 'wire' else random_module_input(random)
    model = make_model(system, solver__rtol=1e-7)
    w = model.compiled.wire
    jumps = raw_run(model, source, [0.0]).jumps
    inside = jumps[(jumps[:, 0] > 1e-3) & (jumps[:, 0] < source.times[-1] - 1e-3)]
    assert len(inside) > 3
    apart = 1e-9
    times = np.sort(np.concatenate([inside[:, 0] - apart, inside[:, 0] + apart]))
    run = raw_run(model, source, times)
    for t, i, _ in inside:
        before, after = np.searchsorted(times, [t - apart, t + apart])
        wire = run.wires[int(i)]
        assert wire['mode'][before] != wire['mode'][after]
        assert abs(wire['x_M'][after] - wire['x_M'][before]) < 1e-7
        # 2 ns of at most 100 W
        assert abs(energy(wire, w)[after] - energy(wire, w)[before]) < 2 * apart * 100.0 + 1e-12 * abs(energy(wire, w)[0])


@pytest.mark.parametrize(('system', 'kind'), COMBINATIONS)
def test_second_law_over_runs(system, kind):
    for seed in range(4):
        random = np.random.default_rng(seed)
        source = random_wire_input(random) if system == 'wire' else random_module_input(random)
        model = make_model(system, kind)
        w = model.compiled.wire
        run = raw_run(model, source, np.linspace(0.0, source.times[-1], 3000))
        for wire in run.wires:
            dissipated = dissipation(wire, w)
            assert dissipated.max() > 0.0
            # a MAS fraction leaves [0, 1] by as much as the tolerance allows, and is pushed back
            assert dissipated.min() >= -1e-7 * dissipated.max()


def test_second_law_at_every_transforming_state():
    model = make_model('module')
    p, random = model.compiled, np.random.default_rng(5)
    for mode, sign in ((4, 1.0), (5, -1.0)):
        for _ in range(30):
            s = random_state(model, random, mode)
            for i in range(2):
                T = s.y[p.first_T + i]
                assert sign * (gamma(s.obs[i, O_SIGMA], p.wire) - gamma(sigma_MW(T, p.wire), p.wire)) > 0.0


def test_mas_transforms_towards_the_lower_energy():
    model = make_model('wire', 'mas')
    p, random = model.compiled, np.random.default_rng(6)
    transforming = 0
    for _ in range(300):
        s = random_state(model, random)
        # close to the edges of the hysteresis, where rates are not zero
        s.u[0] = s.u[0] + (s.obs[0, O_S_A] - random.uniform(0, 1) * p.wire.dsigma - s.obs[0, O_SIGMA]) / 1e10
        s = evaluate(model, s.y, s.u, s.du, s.mode, s.x_frozen)
        drive = gamma(s.obs[0, O_SIGMA], p.wire) - gamma(sigma_MW(s.y[0], p.wire), p.wire)
        assert drive * s.obs[0, O_DX] >= 0.0
        transforming += s.obs[0, O_DX] != 0.0
    assert transforming > 30
