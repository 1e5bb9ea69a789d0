"""Structures as parts: every one keeps its energy, moves as its equations say, and joins without an edit of the package."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from sma_sim import Config, Input, Model, find_structures, read_config, simulate
from sma_sim.model.effects.meaning import acts_on
from sma_sim.model.layout import O_DL, O_EPS, O_F, O_J, O_STRAIN, O_V, O_X, InputPoint, SystemState
from sma_sim.model.material import internal_energy
from sma_sim.model.parameters import BeamConstants
from sma_sim.model.structures.beam import inclined_wire_length, stiffness_forces
from sma_sim.model.structures.discovery import package_structures
from sma_sim.model.structures.structure import Structure, numbers, record
from sma_sim.model.system import flow
from sma_sim.solver.fixed_rate import FixedRateRun
from sma_sim.solver.model import new_findings

EXAMPLE = Path(__file__).resolve().parents[2] / 'examples' / 'own_structure'
ROCKER = find_structures([EXAMPLE])['rocker']
MOVING = {
    name: found
    for name, found in (*package_structures().items(), ('rocker', ROCKER))
    if found.coordinates and not found.drives
}
HEATING = {'spatial': 8.0, 'module': 12.0, 'stack': 12.0, 'lever': 1.2, 'rocker': 1.2, 'slider': 1.2, 'coil': 4.0}


def model_of(name, kind='hybrid', effects=(), **parameters):
    """A model of a structure at its defaults, some parameters changed (``slider__k=...``)."""
    changed = {key.replace('__', '.'): value for key, value in parameters.items()}
    own = ROCKER if name == 'rocker' else None
    values = MOVING[name].default_values | changed
    return Model(Config(values, name, kind, tuple(effects), own_structure=own))


def command_of(name, duration=30.0):
    """Heating on and off again, of an antagonistic pair on both sides."""
    structure, J = MOVING[name], HEATING[name]
    levels = [0.0, J, -0.8 * J, 0.0] if structure.antagonistic else [0.0, J, 0.5 * J, 0.0]
    times = np.array([0.0, 0.1, 0.4, 0.7, 1.0]) * duration
    columns = np.column_stack([[*levels, 0.0]] * len(structure.commands) + [np.full(5, 298.0)])
    return Input(times, columns, (False,) * columns.shape[1], structure.input_columns)


def states(model, seed, count=20):
    """Random states in mode 3, in which the wires are strained as at work."""
    random, p = np.random.default_rng(seed), model.compiled
    scales = np.array([c.size(model.constants) for c in model.structure.coordinates])
    for _ in range(count):
        y = np.zeros(len(model.scales))
        y[: p.coordinates] = random.uniform(-1.0, 1.0, p.coordinates) * scales
        y[p.coordinates : 2 * p.coordinates] = random.uniform(-1.0, 1.0, p.coordinates) * scales
        y[p.first_T : p.first_T + p.wires] = random.uniform(300.0, 360.0, p.wires)
        x = random.uniform(0.2, 0.8, p.wires)
        if p.mas:
            y[p.first_x : p.first_x + p.wires] = x
        yield y, x


def evaluated(model, y, x, u):
    """dy/dt and what the flow finds on its way."""
    p = model.compiled
    dy, obs = np.zeros(len(y)), new_findings(p)
    flow(0.0, SystemState(y, np.full(p.wires, 3), x), InputPoint(u, np.zeros_like(u)), p, dy, obs)
    return dy, obs


def energy_of(model, y, x, u):
    """Energy of the wires and of the structure [J]."""
    p, structure = model.compiled, model.structure
    _, obs = evaluated(model, y, x, u)
    pose = record('Pose', structure.coordinate_names)
    n = p.coordinates
    wires = sum(
        internal_energy(obs[i, O_EPS] - obs[i, O_STRAIN] - p.wire.eps_T * obs[i, O_X], y[p.first_T + i], obs[i, O_X], p.wire)
        for i in range(p.wires)
    )
    return p.wire.n * wires + structure.energy(pose(*y[:n]), pose(*y[n : 2 * n]), model.constants)


@pytest.mark.parametrize('kind', ['hybrid', 'mas'])
@pytest.mark.parametrize('name', sorted(name for name, found in MOVING.items() if found.energy))
def test_first_law(name, kind):
    """What is stored changes by heating, heat lost to the air, and friction alone."""
    model = model_of(name, kind)
    p, structure, w = model.compiled, model.structure, model.compiled.wire
    pose = record('Pose', structure.coordinate_names)
    n, u = p.coordinates, np.zeros(len(structure.input_columns))
    u[-1] = 298.0
    for y, x in states(model, 1):
        dy, obs = evaluated(model, y, x, u)
        h = 3e-2 / max(1e-3, np.abs(dy / model.scales).max())
        ends = {k: energy_of(model, y + k * h * dy, x, u) for k in (-2, -1, 1, 2)}
        stored = (8.0 * (ends[1] - ends[-1]) - (ends[2] - ends[-2])) / (12.0 * h)
        T = y[p.first_T : p.first_T + p.wires]
        heat = w.n * sum(obs[:, O_J] - w.lambda_ * w.surface * (T - 298.0))
        q, v, rest = pose(*y[:n]), pose(*y[n : 2 * n]), pose(*np.zeros(n))
        friction = [
            a - b for a, b in zip(*(numbers(structure.forces(q, s, model.constants)) for s in (v, rest)), strict=True)
        ]
        size = abs(heat) + abs(obs[:, O_F] @ obs[:, O_V]) + abs(np.dot(friction, v)) + 1e-6
        assert stored == pytest.approx(heat + np.dot(friction, v), abs=1e-6 * size)


@pytest.mark.parametrize('name', sorted(MOVING))
def test_wires_pull_along_the_gradient_of_their_lengths(name):
    model = model_of(name)
    structure, n = model.structure, model.compiled.coordinates
    pose = record('Pose', structure.coordinate_names)
    for y, x in states(model, 2, 5):
        _, obs = evaluated(model, y, x, np.full(len(structure.input_columns), 298.0))
        own = n // structure.segments  # a wire pulls on the coordinates of its own segment
        per_segment = structure.wires // structure.segments
        for j, coordinate in enumerate(structure.coordinates):
            h = 1e-4 * coordinate.size(model.constants)
            ends = [y[:n] + s * h * (np.arange(n) == j) for s in (1.0, -1.0)]
            up, down = (np.array(numbers(structure.lengths(pose(*end), model.constants))) for end in ends)
            mine = np.arange(structure.wires) // per_segment == j // own
            assert np.where(mine, obs[:, O_DL + j % own], 0.0) == pytest.approx((up - down) / (2.0 * h), rel=1e-6, abs=1e-9)


def planar_beam():
    """The planar beam with three bundles: one on the side of +y, two together half as far on the other."""
    spatial = package_structures()['spatial']

    def lengths(q, p):
        sine, cosine = math.sin(q.alpha), math.cos(q.alpha)
        one = inclined_wire_length(q.U_x, q.U_y, sine, cosine, -1.0, p)
        two = inclined_wire_length(q.U_x, q.U_y, sine, cosine, 0.5, p)
        return one[0], two[0], two[0]

    def gradients(q, p):
        sine, cosine = math.sin(q.alpha), math.cos(q.alpha)
        one = inclined_wire_length(q.U_x, q.U_y, sine, cosine, -1.0, p)
        two = inclined_wire_length(q.U_x, q.U_y, sine, cosine, 0.5, p)
        return one[1], one[2], one[3], two[1], two[2], two[3], two[1], two[2], two[3]

    def forces(q, v, p):
        F_x, F_y, M = stiffness_forces(q.U_x, q.U_y, q.alpha, p)
        return -F_x - p.b_x * v.U_x, -F_y - p.b_y * v.U_y, -M - p.b_alpha * v.alpha

    def constants(values):
        p = spatial.constants_of(spatial.default_values)
        shared = {name: getattr(p, name) for name in BeamConstants._fields if hasattr(p, name)}
        return BeamConstants(W=2.0 * p.r, J_H=p.J_bend, **shared)

    return Structure(
        name='planar',
        title='beam',
        coordinates=tuple(spatial.coordinates[k] for k in (0, 1, 3)),
        wires=3,
        lengths=lengths,
        gradients=gradients,
        forces=forces,
        inertia=lambda p: (p.m_H, p.m_H, p.J_H),
        constants=constants,
    )


def test_spatial_reduces_to_the_planar_beam():
    """One bundle idle, the others mirrored: lengths and forces are the planar beam's, and nothing leaves the plane."""
    spatial, planar = package_structures()['spatial'], planar_beam()
    p, b = spatial.default_constants, planar.default_constants
    random = np.random.default_rng(6)
    for _ in range(50):
        q = random.uniform(-1.0, 1.0, 3) * [1e-4, 4e-3, 0.3]
        v, F = random.uniform(-1.0, 1.0, 3) * [1e-3, 0.1, 2.0], random.uniform(0.0, 30.0, 2)[[0, 1, 1]]
        whole, flat = record('Pose', spatial.coordinate_names), record('Pose', planar.coordinate_names)
        poses = [[whole(s[0], s[1], 0.0, s[2], 0.0, 0.0), flat(*s)] for s in (q, v)]
        slopes = np.array(spatial.gradients(poses[0][0], p)).reshape(3, 6)
        found = np.array(spatial.forces(poses[0][0], poses[1][0], p)) - F @ slopes
        h, forward = 1e-4 * np.array([1e-4, 4e-3, 0.3]), np.zeros((3, 3))
        for j in range(3):
            ends = [planar.lengths(flat(*(q + s * h[j] * (np.arange(3) == j))), b) for s in (1.0, -1.0)]
            forward[:, j] = (np.array(ends[0]) - ends[1]) / (2.0 * h[j])
        expected = np.array(planar.forces(poses[0][1], poses[1][1], b)) - F @ forward
        assert found[[0, 1, 3]] == pytest.approx(expected, rel=1e-6, abs=1e-6)
        assert np.abs(found[[2, 4, 5]]).max() < 1e-9
        assert spatial.lengths(poses[0][0], p) == pytest.approx(planar.lengths(poses[0][1], b), abs=1e-15)


def test_a_loaded_spatial_beam_is_the_cantilever_of_textbooks():
    """Tip deflections F L^3/(3 E I), F L^2/(2 E I), F L/(E A), slopes M L/(E I), M L/(G J); h is the radius."""
    structure = package_structures()['spatial']
    values = structure.default_values
    L, E, h, nu = (values[f'spatial.{name}'] for name in ('L', 'E', 'h', 'nu'))
    area_moment, A, G = math.pi * h**4 / 4.0, math.pi * h**2, E / (2.0 * (1.0 + nu))
    pose, rest = record('Pose', structure.coordinate_names), np.zeros(6)
    by_pose = np.array([structure.forces(pose(*row), pose(*rest), structure.default_constants) for row in 1e-6 * np.eye(6)])
    flexibility = -np.linalg.inv(by_pose / 1e-6)  # symmetric
    U_x, U_y, U_z, alpha, beta, gamma = range(6)
    assert flexibility[U_x, U_x] == pytest.approx(L / (E * A))
    assert flexibility[gamma, gamma] == pytest.approx(L / (G * 2.0 * area_moment))
    for across, turned in ((U_y, alpha), (U_z, beta)):
        assert flexibility[across, across] == pytest.approx(L**3 / (3.0 * E * area_moment))
        assert abs(flexibility[across, turned]) == pytest.approx(L**2 / (2.0 * E * area_moment))
        assert flexibility[turned, across] == pytest.approx(flexibility[across, turned])
        assert flexibility[turned, turned] == pytest.approx(L / (E * area_moment))
    J_bend, J_twist = structure.default_constants.J_bend, structure.default_constants.J_twist
    disc = values['spatial.m_H'] * values['spatial.r'] ** 2
    assert (J_bend, J_twist) == pytest.approx((disc / 4.0, disc / 2.0))


@pytest.mark.parametrize('kind', ['hybrid', 'mas'])
def test_a_spatial_run_is_that_of_the_planar_beam(kind):
    """One bundle idle, the others heated alike: the same motion to 1e-9 m and rad, which the tolerance limits."""
    spatial, file = package_structures()['spatial'], Path(__file__)
    planar = replace(planar_beam(), files=(file,))
    times, levels = np.array([0.0, 1.0, 6.0, 8.0]), np.array([0.0, 9.0, 4.0, 4.0])
    values, runs = spatial.default_values | {'solver.rtol': 1e-9}, []
    for name, own in (('spatial', None), ('planar', planar)):
        columns = np.column_stack([0.0 * levels, levels, levels, np.full(4, 298.0)])
        command = Input(times, columns, (False,) * 4, spatial.input_columns)
        config = Config(
            {key: value for key, value in values.items() if own is None or 'spatial' not in key},
            name,
            kind,
            own_structure=own,
        )
        runs.append(simulate(Model(config), command, np.arange(0.0, 8.0, 0.1)))
    whole, flat = runs
    assert whole.completed and flat.completed and np.ptp(whole['alpha_rad']) > 0.02
    for name in ('U_x_m', 'U_y_m', 'alpha_rad'):
        assert whole[name] == pytest.approx(flat[name], rel=0.0, abs=1e-9 if name != 'U_x_m' else 1e-11)
    for name in ('T_1_K', 'T_2_K', 'T_3_K', 'x_M_1', 'x_M_2', 'F_1_N', 'F_2_N', 'F_3_N'):
        assert whole[name] == pytest.approx(flat[name], rel=1e-8)
    assert max(np.abs(whole[name]).max() for name in ('U_z_m', 'beta_rad', 'gamma_rad')) < 1e-9


def test_a_spatial_run_stays_in_its_plane_where_it_should():
    model = model_of('spatial')
    columns = np.column_stack([[0.0, 0.0, 0.0], [0.0, 9.0, 0.0], [0.0, 9.0, 0.0], [298.0] * 3])
    command = Input(np.array([0.0, 1.0, 8.0]), columns, (False,) * 4, model.structure.input_columns)
    run = simulate(model, command, 20.0)
    assert run.completed and run['alpha_rad'].max() - run['alpha_rad'].min() > 0.02
    assert max(np.abs(run[name]).max() for name in ('U_z_m', 'beta_rad', 'gamma_rad')) < 1e-9
    assert run['F_2_N'] == pytest.approx(run['F_3_N'], abs=1e-6)


def wire_rates(eps, T, x, J, c):
    """Stress, dT/dt and dx_M/dt of a wire with MAS kinetics: written from the paper's equations."""
    volume = math.pi * c['r0'] ** 2 * c['l0']
    d = 1.0 / c['E_M'] - 1.0 / c['E_A']
    sigma = (eps - c['eps_T'] * x) / (x / c['E_M'] + (1.0 - x) / c['E_A'])
    middle = c['sigma_MW0'] + c['sigma_T'] * (T - c['T0'])
    s_A, s_M = middle + 0.5 * c['dsigma'], middle - 0.5 * c['dsigma']
    concave = (c['eps_T'] + s_M / c['E_M'] - s_A / c['E_A']) / (s_A - s_M)
    thermal = c['V_L'] / (1.380649e-23 * T)
    to_M = c['omega_x'] * math.exp(-thermal * 0.5 * max(s_A - sigma, 0.0) ** 2 * (1.0 / c['E_A'] + concave))
    to_A = c['omega_x'] * math.exp(-thermal * 0.5 * max(sigma - s_M, 0.0) ** 2 * (1.0 / c['E_M'] + concave))
    dx = to_M * (1.0 - x) - to_A * x
    latent = T * (d * middle + c['eps_T']) * c['sigma_T'] + 0.5 * d * (sigma**2 - middle**2) + c['eps_T'] * (sigma - middle)
    capacity = c['rho'] * c['c_V'] + T * d * c['sigma_T'] ** 2 * (1.0 - x)
    loss = c['lambda'] * 2.0 * math.pi * c['r0'] * c['l0'] * (T - 298.0)
    return sigma, (J - loss + volume * latent * dx) / (volume * capacity), dx


def slider_rates(_, y, J, c):
    """dy/dt of a slider, y = (position, speed, T, x_M)."""
    position, speed, T, x = y
    sigma, dT, dx = wire_rates((c['L'] - position) / c['l0'] - 1.0, T, x, J, c)
    pull = math.pi * c['r0'] ** 2 * sigma - c['k'] * (position + c['x_0']) - c['b'] * speed
    return [speed, (pull - c['m'] * c['g'] * math.sin(c['incline'])) / c['m'], dT, dx]


def lever_rates(_, y, J, c):
    """dy/dt of a lever, y = (angle, its rate, T_1, T_2, x_M of both)."""
    angle, rate, *wires = y
    first = wire_rates((c['L'] - c['r'] * angle) / c['l0'] - 1.0, wires[0], wires[2], max(J, 0.0), c)
    second = wire_rates((c['L'] + c['r'] * angle) / c['l0'] - 1.0, wires[1], wires[3], max(-J, 0.0), c)
    pull = math.pi * c['r0'] ** 2 * c['r'] * (first[0] - second[0]) - c['k'] * angle - c['b'] * rate
    weight = c['m'] * c['g'] * c['a'] * math.sin(angle - c['vertical'])
    return [rate, (pull - weight) / c['J'], first[1], second[1], first[2], second[2]]


def coil_rates(_, y, J, c):
    """dy/dt of a coil, y = (stroke, speed, T, x_M): its force by differences of the energy-equivalent strain."""
    stroke, speed, T, x = y
    extension, h = c['delta_0'] - stroke, 1e-6
    ends = [equivalent_strain(extension + s * h, c) for s in (1.0, 0.0, -1.0)]
    sigma, dT, dx = wire_rates(ends[1], T, x, J, c)
    force = math.pi * c['r0'] ** 2 * c['l0'] * sigma * (ends[0] - ends[2]) / (2.0 * h)
    pull = force - c['k'] * (stroke + c['x_0']) - c['b'] * speed
    return [speed, (pull - c['m'] * c['g'] * math.sin(c['incline'])) / c['m'], dT, dx]


def equivalent_strain(extension, c):
    """The root of 2 U/(E Om), U being the elastic energy G J dt^2/2 + E I dc^2/2 per length of a helix, with G = E/3."""
    first, now = (math.asin(h / c['l0']) for h in (c['h_0'], c['h_0'] + extension))
    around = 2.0 * math.cos(first) / c['D']  # 2 pi N/l0
    twist, bend = (around * (f(now) - f(first)) for f in (math.sin, math.cos))
    return math.copysign(c['r0'] * math.sqrt(twist**2 / 6.0 + bend**2 / 4.0), extension)  # J = A r^2/2, I = A r^2/4


@pytest.mark.parametrize(
    ('name', 'rates', 'column', 'starts'),
    [
        ('coil', coil_rates, 'stroke_m', ('T_K', 'x_M')),
        ('slider', slider_rates, 'position_m', ('T_K', 'x_M')),
        ('lever', lever_rates, 'angle_rad', ('T_1_K', 'T_2_K', 'x_M_1', 'x_M_2')),
    ],
)
def test_against_an_independent_solution(name, rates, column, starts):
    """SciPy's LSODA on the equations above, from the same start: the coordinate agrees to 1e-6 m, or 1e-5 rad."""
    model = model_of(name, 'mas', solver__rtol=1e-8)
    command, times = command_of(name, 6.0), np.linspace(0.0, 6.0, 61)
    run = simulate(model, command, times)
    assert run.completed and np.ptp(run[column]) > 0.5 * model.scales[0]
    constants = {
        key.rpartition('.')[2]: value
        for key, value in model.config.parameters.items()
        if key.startswith(('wire.', f'{name}.'))
    }
    first = simulate(model, command, times[:1])
    y, found = [first[column][0], 0.0, *(first[start][0] for start in starts)], []
    for start, end, J in zip(command.times[:-1], command.times[1:], command.values[:-1, 0], strict=True):
        asked = np.append(times[(times >= start) & (times < end)], end)
        part = solve_ivp(rates, (start, end), y, 'LSODA', asked, rtol=1e-8, atol=1e-12, args=(J, constants))
        y, found = part.y[:, -1], found + part.y[0, :-1].tolist()
    assert run[column][:-1] == pytest.approx(np.array(found), abs=1e-6 if column.endswith('_m') else 1e-5)


def two_wire_slider_rates(_, y, J, c):
    """dy/dt of a slider between two wires, y = (position, speed, T_1, T_2, x_M of both); `J` heats both."""
    position, speed, *wires = y
    first = wire_rates((c['L'] - position) / c['l0'] - 1.0, wires[0], wires[2], J[0], c)
    second = wire_rates((c['L'] + position) / c['l0'] - 1.0, wires[1], wires[3], J[1], c)
    pull = math.pi * c['r0'] ** 2 * (first[0] - second[0]) - c['k'] * (position + c['x_0'])
    braking = c['b'] * speed + c['F_c'] * math.tanh(speed / c['v_c']) + c['m'] * c['g'] * math.sin(c['incline'])
    return [speed, (pull - braking) / c['m'], first[1], second[1], first[2], second[2]]


def test_a_slider_between_two_wires_with_friction():
    """Columns J_1_W and J_2_W; against SciPy's LSODA on the equations above."""
    model = model_of(
        'slider', 'mas', slider__wires=2.0, slider__x_0=0.0, slider__F_c=0.05, slider__v_c=5e-3, solver__rtol=1e-8
    )
    assert model.structure.input_columns == ('J_1_W', 'J_2_W', 'T_E_K')
    levels, ends, times = [(1.2, 0.0), (0.0, 1.2)], [0.0, 1.5, 3.0], np.linspace(0.0, 2.99, 40)
    values = np.array([[*level, 298.0] for level in (*levels, levels[-1])])
    run = simulate(model, Input(np.array(ends), values, (False,) * 3, model.structure.input_columns), times)
    assert run.completed and np.ptp(run['position_m']) > 5e-4
    c = {
        key.rpartition('.')[2]: value
        for key, value in model.config.parameters.items()
        if key.startswith(('wire.', 'slider.'))
    }
    y, found = [run[name][0] for name in ('position_m', 'T_1_K', 'T_2_K', 'x_M_1', 'x_M_2')], []
    y.insert(1, 0.0)
    for J, start, end in zip(levels, ends[:-1], ends[1:], strict=True):
        asked = np.append(times[(times >= start) & (times < end)], end)
        part = solve_ivp(two_wire_slider_rates, (start, end), y, 'LSODA', asked, rtol=1e-8, atol=1e-11, args=(J, c))
        y, found = part.y[:, -1], found + part.y[0, :-1].tolist()
    assert run['position_m'] == pytest.approx(np.array(found), abs=1e-6)


@pytest.mark.parametrize('name', sorted(set(MOVING) - {'module'}))
def test_runs_do_not_depend_on_how_they_are_made(name):
    """Fixed steps and adaptive ones agree; each kind of kinetics comes to its end and moves."""
    command = command_of(name)
    for kind in ('hybrid', 'mas'):
        model = model_of(name, kind)
        run = simulate(model, command, 10.0)
        assert run.completed and not run.notes
        column, scale = model.structure.coordinates[0].column, model.scales[0]
        assert np.ptp(run[column]) > 0.5 * scale
        fixed = FixedRateRun(model, 1000.0, command.values[0])
        for t in range(1000):
            fixed.step(command.values[np.searchsorted(command.times, t / 1000.0 + 1e-9, 'right') - 1])
        assert fixed.sample[0] == pytest.approx(run[column][10], abs=1e-3 * scale)


def fitting(structure, values):
    """How much longer the wires have to be for a structure whose lengths differ from their defaults."""
    pose = record('Pose', structure.coordinate_names)(*[0.0] * len(structure.coordinates))
    lengths = [
        numbers(structure.lengths(pose, structure.constants_of(of)))[0]
        for of in (structure.default_values | values, structure.default_values)
    ]
    return lengths[0] / lengths[1]


def test_random_parameters_of_every_structure():
    """No parameters within a quarter of the defaults, lengths among them, make a run fail."""
    random = np.random.default_rng(4)
    for name, found in sorted(MOVING.items()):
        for turn in range(12):
            values = {
                key: value * (1.0 + random.uniform(-0.25, 0.25))
                for key, value in found.default_values.items()
                if key in found.declared and key != found.size_name
            }
            for key, parameter in found.declared.items():
                if key in values:
                    values[key] = min(max(values[key], parameter.bounds[0]), parameter.bounds[1])
            values['wire.l0'] = found.default_values['wire.l0'] * fitting(found, values)
            changed = {key.replace('.', '__'): value for key, value in values.items()}
            run = simulate(model_of(name, 'mas' if turn % 2 else 'hybrid', **changed), command_of(name), 5.0)
            assert run.completed, (name, values, run.reason)


OWN_EFFECT = """
from sma_sim import Effect, Parameter
EFFECT = Effect(
    name='oil', port='structure_force', equation='F = -c v', source='a test', systems=('slider',),
    parameters=(Parameter('c', 3.0, 'N s/m', (0.0, 100.0), 'more damping', '', 0.0, (0.1, 10.0)),),
    kernel=lambda s, b, p: -p.c * s.dposition * b.m / b.m,
)
"""


def test_an_effect_on_a_structure_reads_its_coordinates_and_constants(tmp_path):
    """A damper as an effect of one's own moves the slider as its own damping does."""
    (tmp_path / 'oil.py').write_text(OWN_EFFECT)
    effect = read_config(words=[f'effects.paths={tmp_path}', 'system=slider'], effects=['oil']).effects
    command = command_of('slider', 6.0)
    with_effect = simulate(model_of('slider', effects=effect, slider__b=1.0), command, 20.0)
    damped = simulate(model_of('slider', slider__b=4.0), command, 20.0)
    assert with_effect['position_m'] == pytest.approx(damped['position_m'], abs=1e-8)
    assert not acts_on(effect[0].effect, MOVING['module'])
