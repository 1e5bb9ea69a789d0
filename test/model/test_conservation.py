"""First and second law, in every mode, for both models (docs/explanation/physics.md, section 3)."""

import numpy as np
import pytest
from flows import MODES, Point, active, admitted, make_model

from sma_sim import Input, simulate
from sma_sim.model.layout import O_DEPS, O_DX, O_EPS, O_J, O_SIGMA, O_STRAIN, O_X
from sma_sim.model.material import gamma, internal_energy, sigma_MW

POINTS = 30
CASES = [('hybrid', mode) for mode in MODES] + [('mas', 3)]


def energy(p, y, obs, wire):
    """Internal energy of one wire [J]."""
    x = obs[wire, O_X]
    return internal_energy(obs[wire, O_EPS] - obs[wire, O_STRAIN] - p.wire.eps_T * x, y[p.first_T + wire], x, p.wire)


def power_in(point, wire, extra=0.0):
    """Mechanical power, heating and convection of one wire [W]."""
    p, obs = point.p, point.obs
    work = p.wire.volume * obs[wire, O_SIGMA] * obs[wire, O_DEPS]
    return work + obs[wire, O_J] - p.wire.lambda_ * p.wire.surface * (point.y[p.first_T + wire] - point.u[-1]) + extra


def points(model, mode):
    random = np.random.default_rng(7)
    made = (Point(model, random, mode) for _ in range(20 * POINTS))
    kept = [point for point in made if admitted(point)][:POINTS]
    assert len(kept) == POINTS
    return kept


@pytest.mark.parametrize('system', ['module', 'wire'])
@pytest.mark.parametrize(('kind', 'mode'), CASES)
@pytest.mark.parametrize('effects', [(), ('polycrystal',)])
def test_first_law_at_every_state(system, kind, mode, effects):
    model = make_model(system, kind, [active(name) for name in effects])
    h = 1e-7
    for point in points(model, mode):
        p = point.p
        for wire in range(p.wires):
            _, before = point.along(-h)
            y_before = point.y - h * point.evaluate()[0]
            low = energy(p, y_before, before, wire)
            _, after = point.along(h)
            y_after = point.y + h * point.evaluate()[0]
            high = energy(p, y_after, after, wire)
            point.evaluate()
            gain = (high - low) / (2.0 * h)
            terms = abs(gain) + abs(power_in(point, wire)) + 1e-2
            assert gain == pytest.approx(power_in(point, wire), abs=1e-6 * terms)


@pytest.mark.parametrize(('kind', 'mode'), CASES)
def test_second_law(kind, mode):
    for point in points(make_model('module', kind), mode):
        w = point.p.wire
        for wire in range(2):
            T = point.y[point.p.first_T + wire]
            drive = gamma(point.obs[wire, O_SIGMA], w) - gamma(sigma_MW(T, w), w)
            flows = kind == 'mas' or (mode == 4) == (point.obs[wire, O_DX] >= 0.0)  # else the automaton leaves the mode
            assert not flows or drive * point.obs[wire, O_DX] >= 0.0


@pytest.mark.parametrize('kind', ['hybrid', 'mas'])
def test_first_law_over_a_run(kind):
    """A wire that is drawn, heated and released: U gains what came in, to 1e-6 of the energy exchanged."""
    times = np.array([0.0, 2.0, 3.0, 5.0, 6.0, 8.0])
    values = np.array([[0.0, 0, 298], [0.06, 0.3, 298], [0.05, 0.3, 310], [0.02, 0, 310], [0.05, 0, 298], [0.01, 0, 298]])
    source = Input(times, values.astype(float), (True, False, False))
    model = make_model('wire', kind, solver__rtol=1e-9)
    w = model.compiled.wire
    jumps = [jump.t for jump in simulate(model, source, times[:1]).jumps]
    edges = np.unique(np.concatenate([np.linspace(0.0, 8.0, 1601), times, jumps]))
    nodes, weights = np.polynomial.legendre.leggauss(4)
    half = np.diff(edges) / 2.0
    inside = ((edges[:-1] + edges[1:]) / 2.0)[:, None] + half[:, None] * nodes
    run = simulate(model, source, inside.ravel())
    held = np.searchsorted(times, run.time, side='right') - 1
    rate = np.diff(values[:, 0]) / np.diff(times)
    work = w.volume * run['stress_Pa'] * rate[held]
    power = work + values[held, 1] - w.lambda_ * w.surface * (run['T_K'] - values[held, 2])
    weight = (half[:, None] * weights).ravel()
    ends = simulate(model, source, np.array([0.0, 8.0]))
    strain = values[[0, -1], 0]
    U = [internal_energy(strain[k] - w.eps_T * ends['x_M'][k], ends['T_K'][k], ends['x_M'][k], w) for k in (0, 1)]
    assert U[1] - U[0] == pytest.approx(float(weight @ power), abs=1e-6 * float(weight @ np.abs(power)))


def test_energy_does_not_jump():
    """x_M, T and strain are continuous at every jump, so U is; and the stress with them."""
    J_eq = np.array([12.0, -9.0, 3.0, 0.0])
    source = Input(np.array([0.0, 5.0, 20.0, 30.0]), np.column_stack([J_eq, np.full(4, 298.0)]), (False, False))
    model = make_model(solver__rtol=1e-7)
    taken = simulate(model, source, np.array([0.0])).jumps
    jumps = [jump.t for jump in taken if jump.t not in source.times]
    assert len(jumps) > 5
    h = 1e-9
    run = simulate(model, source, np.sort(np.concatenate([np.array(jumps) - h, np.array(jumps) + h])))
    for name in ('x_M_1', 'x_M_2', 'T_1_K', 'T_2_K', 'F_1_N', 'F_2_N'):
        before, after = run[name][::2], run[name][1::2]
        assert after == pytest.approx(before, rel=1e-6)
