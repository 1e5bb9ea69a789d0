"""Modules in series: the energy that they keep, the pose in which they rest, and one of them against the module."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import minimize

from sma_sim import Config, Input, Model, UserError, module_input, read_config, simulate
from sma_sim.cli.main import main
from sma_sim.model.structures.stack import accelerations, stack_of
from sma_sim.model.structures.structure import record
from sma_sim.solver.linear import DENSE, eliminate, solve_eliminated
from sma_sim.solver.series import elimination_of, far_rates, jacobian_pattern

HEATED = 12.0  # [W] bends a module by 0.1 rad


def stack(modules, kind='hybrid', **parameters):
    """A model of so many modules, some parameters changed (``stack__g_x=...``)."""
    changed = {key.replace('__', '.'): value for key, value in parameters.items()}
    return Model(Config({'stack.modules': float(modules), **changed}, 'stack', kind))


def commands(model, times, levels):
    """Commands (k, modules), or (k,) for all modules alike."""
    count = len(model.structure.commands)
    levels = np.broadcast_to(np.asarray(levels, float).reshape(len(times), -1), (len(times), count))
    columns = np.column_stack([levels, np.full(len(times), 298.0)])
    return Input(np.asarray(times, float), columns, (False,) * (count + 1), model.structure.input_columns)


@pytest.mark.parametrize('kind', ['hybrid', 'mas'])
def test_a_stack_of_one_is_the_module(kind):
    times, levels = [0.0, 5.0, 12.0, 20.0, 31.0, 40.0], [0.0, 12.0, -9.0, 14.0, -15.0, 0.0]
    module = simulate(Model(Config(kinetics=kind)), module_input(times, levels), 20.0)
    one = stack(1, kind)
    run = simulate(one, commands(one, times, levels), 20.0)
    for column, values in module.columns.items():
        renamed = column.replace('U_x', 'U_x_1').replace('U_y', 'U_y_1').replace('alpha', 'alpha_1')
        assert np.array_equal(run[renamed], values), column
    assert run.steps == module.steps and run.jumps == module.jumps


def plates(q, L):
    """Where each plate is, and how far it is turned: (modules, 3), composed with rotation matrices."""
    place, turn, found = np.zeros(2), np.eye(2), []
    angle = 0.0
    for x, y, alpha in q.reshape(-1, 3):
        place = place + turn @ [L + x, y]
        angle += alpha
        turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
        found.append([*place, angle])
    return np.array(found)


def potential_energy(q, x, c):
    """Bent beams, strained wires at constant phase fractions `x`, and the height of the plates [J]."""
    bending = c['beam.E'] * math.pi * c['beam.h'] ** 4 / 4.0
    axial, L = c['beam.E'] * math.pi * c['beam.h'] ** 2, c['beam.L']
    volume = c['wire.n'] * math.pi * c['wire.r0'] ** 2 * c['wire.l0']
    total = 0.0
    for k, (u, w, alpha) in enumerate(q.reshape(-1, 3)):
        total += 0.5 * axial / L * u**2
        total += bending / L**3 * (6.0 * w**2 - 6.0 * L * w * alpha + 2.0 * L**2 * alpha**2)
        for side in (1.0, -1.0):
            foot = np.array([0.0, side * 0.5 * c['plate.W']])
            held = np.array([L + u, w]) + 0.5 * side * c['plate.W'] * np.array([-math.sin(alpha), math.cos(alpha)])
            fraction = x[2 * k + (0 if side > 0.0 else 1)]
            strain = np.linalg.norm(held - foot) / c['wire.l0'] - 1.0 - c['wire.eps_T'] * fraction
            total += 0.5 * volume * strain**2 / (fraction / c['wire.E_M'] + (1.0 - fraction) / c['wire.E_A'])
    where = plates(q, L)
    return total - c['plate.m_H'] * float((where[:, :2] @ [c['stack.g_x'], c['stack.g_y']]).sum())


@pytest.mark.parametrize('kind', ['hybrid', 'mas'])
@pytest.mark.parametrize('gravity', [(9.81, 0.0), (-9.81, 0.0), (3.0, -9.0)])
def test_a_stack_settles_where_its_potential_energy_is_least(kind, gravity):
    model = stack(3, kind, stack__g_x=gravity[0], stack__g_y=gravity[1], solver__rtol=1e-7)
    command = commands(model, [0.0, 2.0, 62.0], [[0.0] * 3, [HEATED, -6.0, 9.0], [HEATED, -6.0, 9.0]])
    run = simulate(model, command, np.array([0.0, 62.0]))
    scales, n = model.scales[:9], len(model.structure.coordinates)
    for at in (0, 1):
        q = np.array([run[c.column][at] for c in model.structure.coordinates])
        x = [run[f'x_M_{i + 1}'][at] for i in range(6)]

        def energy(u, x=x):
            return potential_energy(u * scales, x, model.config.parameters)

        least = minimize(energy, np.zeros(n), method='BFGS', jac='3-point', options={'gtol': 1e-11, 'maxiter': 2000})
        # the MAS kinetics still creep, against the damping
        assert q / scales == pytest.approx(least.x, abs=2e-4 if kind == 'hybrid' or at == 0 else 3e-3)
        assert energy(q / scales) == pytest.approx(least.fun, abs=1e-9 if kind == 'hybrid' or at == 0 else 1e-7)
    assert abs(run['alpha_1_rad'][1]) > 0.04
    if gravity[1]:
        assert abs(run['U_y_1_m'][0]) > 1e-3


def mass_matrix(model, q):
    """M(q) from the kinetic energy, which is a quadratic form of the rates."""
    structure, p, n = model.structure, model.constants, len(q)
    pose = record('Pose', structure.coordinate_names)
    still = structure.energy(pose(*q), pose(*np.zeros(n)), p)

    def kinetic(v):
        return structure.energy(pose(*q), pose(*v), p) - still

    ones = np.eye(n)
    squares = [kinetic(one) for one in ones]
    return np.array([[kinetic(a + b) - squares[i] - squares[j] for j, b in enumerate(ones)] for i, a in enumerate(ones)])


def test_accelerations_are_those_of_lagranges_equations():
    """M(q) a + dM/dt v - grad (v M v/2) + grad V = Q for any pose, rates and forces; M(q) from the energy."""
    model = Model(stack(4, stack__g_x=-7.0, stack__g_y=4.0).config.variant({'beam.E': 1e-3}))
    random, p, pose = np.random.default_rng(8), model.constants, record('Pose', model.structure.coordinate_names)
    n, h = 12, 1e-5
    for _ in range(5):
        q = random.uniform(-1.0, 1.0, (4, 3)) * [0.02, 0.03, 1.2]
        v, Q = random.uniform(-1.0, 1.0, (4, 3)) * [0.3, 0.3, 4.0], random.uniform(-1.0, 1.0, (4, 3)) * [1.0, 1.0, 0.05]
        a = np.array([accelerations(k, q, v, Q, p) for k in range(4)]).ravel()
        at, rate = q.ravel(), v.ravel()
        slopes = [mass_matrix(model, at + s * h * rate) for s in (1.0, -1.0)]
        turning = (slopes[0] - slopes[1]) / (2.0 * h) @ rate
        lagrangian = np.zeros(n)
        for j in range(n):
            ends = [pose(*(at + s * h * (np.arange(n) == j))) for s in (1.0, -1.0)]
            weights = [model.structure.energy(end, pose(*np.zeros(n)), p) for end in ends]
            moving = [
                model.structure.energy(end, pose(*rate), p) - weight for end, weight in zip(ends, weights, strict=True)
            ]
            lagrangian[j] = ((moving[0] - moving[1]) - (weights[0] - weights[1])) / (2.0 * h)
        forces = mass_matrix(model, at) @ a + turning - lagrangian
        assert forces == pytest.approx(Q.ravel(), abs=1e-6)


@pytest.mark.slow
def test_free_undamped_motion_keeps_its_energy():
    """Three soft beams without damping or wires that swing far under gravity."""
    still = dict.fromkeys(('beam__b_x', 'beam__b_y', 'beam__b_alpha'), 0.0)
    model = stack(3, stack__g_x=9.81, beam__E=2e6, plate__W=0.1, **still)
    structure, p, pose = model.structure, model.constants, record('Pose', model.structure.coordinate_names)

    def rates(_, y):
        q, v = y[:9], y[9:]
        forces = np.array(structure.forces(pose(*q), pose(*v), p)).reshape(3, 3)
        parts = [accelerations(k, q.reshape(3, 3), v.reshape(3, 3), forces, p) for k in range(3)]
        return np.concatenate([v, np.ravel(parts)])

    start = np.array([[0.0, 0.03, 0.8], [0.0, 0.02, 0.6], [0.0, -0.02, -0.4]]).ravel()
    run = solve_ivp(rates, (0.0, 0.5), np.concatenate([start, np.zeros(9)]), 'DOP853', rtol=1e-10, atol=1e-11)
    energies = np.array([structure.energy(pose(*y[:9]), pose(*y[9:]), p) for y in run.y.T])
    assert run.success and np.ptp(run.y[2]) > 1.0
    assert np.ptp(energies) < 1e-8 * np.ptp([structure.energy(pose(*y[:9]), pose(*np.zeros(9)), p) for y in run.y.T])


def test_ten_modules_hang():
    """Whole steps of Newton's method from the straight pose lead away from this equilibrium."""
    model = stack(
        10,
        stack__g_x=7.894433660685721,
        stack__g_y=-0.9043158102648388,
        beam__E=1614836273.9584188,
        beam__b_x=2.253178665061274,
        beam__b_y=1.8620020191337914,
        beam__b_alpha=1.712762868914699,
        plate__m_H=0.009334409401023272,
    )
    run = simulate(model, commands(model, [0.0, 1.0], [0.0, 0.0]), 10.0)
    assert run.completed and -0.03 < run['alpha_1_rad'][0] < -0.02 and abs(run['alpha_10_rad'][0]) < 1e-3
    assert np.ptp(run['alpha_1_rad']) < 1e-5


@pytest.mark.slow
def test_random_stacks_come_to_their_end():
    random = np.random.default_rng(3)
    for turn in range(10):
        model = stack(
            random.integers(1, 8),
            'mas' if turn % 2 else 'hybrid',
            stack__g_x=random.uniform(-10.0, 10.0),
            stack__g_y=random.uniform(-2.0, 2.0),
            beam__E=random.uniform(1.6e9, 2.5e9),
            beam__b_y=random.uniform(1.0, 3.0),
            plate__m_H=random.uniform(5e-3, 1.5e-2),
        )
        levels = random.uniform(-1.2, 1.2, (5, len(model.structure.commands))) * HEATED
        run = simulate(model, commands(model, [0.0, 4.0, 9.0, 15.0, 20.0], levels), 5.0)
        assert run.completed and not run.notes, (turn, run.reason, run.notes)


def test_the_number_of_modules_is_a_parameter(tmp_path, capsys):
    assert stack(5).structure.commands == ('J_eq_1', 'J_eq_2', 'J_eq_3', 'J_eq_4', 'J_eq_5')
    assert stack(5).structure.channels[-1] == 'R_10' and stack(5).structure.coordinate_names[-1] == 'alpha_5'
    assert read_config(words=['system=stack']).structure == Model(Config(system='stack')).structure
    config = read_config(words=['system=stack', 'stack.modules=2', 'initial.x_M_4=0.3'])
    assert config.parameters['initial.x_M_4'] == 0.3 and config.system == 'stack'
    for words, message in (
        (['stack.modules=2.5'], 'stack.modules = 2.5: expected a whole number from 1 to 10'),
        (['stack.modules=11'], 'expected 1 to 10'),
        (['stack.modules=2', 'initial.x_M_5=0.3'], 'unknown parameter initial.x_M_5'),
        (['initial.x_M_6=1.3'], 'expected 0 to 1'),
    ):
        with pytest.raises(UserError, match=message):
            read_config(words=['system=stack', *words])
    out, command = tmp_path / 'two.yaml', tmp_path / 'c.csv'
    assert main(['init', '--system', 'stack', '--set', 'stack.modules=2', '--out', str(out), '--no-questions']) == 0
    assert read_config(out).structure.wires == 4 and 'x_M_4' in out.read_text()
    command.write_text('time_s,J_eq_1_W,J_eq_2_W\n0,0,0\n2,12,-8\n12,0,0\n20,0,0\n')
    data = tmp_path / 'two.csv'
    words = ['--config', str(out)]
    assert main(['simulate', '--input', str(command), '--out', str(data), *words]) == 0
    header = data.read_text().splitlines()[0]
    assert header.startswith('time_s,J_eq_1_W,J_eq_2_W,T_E_K,U_x_1_m,U_y_1_m,alpha_1_rad,U_x_2_m')
    assert main(['compare', str(data), *words, '--noise', 'alpha_2=1e-4']) == 0
    assert 'alpha_2' in capsys.readouterr().out
    assert main(['simulate', '--input', str(command), '--out', str(tmp_path / 'x.csv'), '--system', 'stack']) == 2
    assert 'J_eq_3_W' in capsys.readouterr().err


def test_sizes_have_names_of_their_own():
    """A recording of two modules has other channels than one of five."""
    assert stack_of(3).name == stack_of(3).family == 'stack'
    assert stack_of(2).name == 'stack_2' and stack_of(2).family == 'stack'


@pytest.mark.parametrize('kind', ['hybrid', 'mas'])
def test_a_step_is_solved_as_with_dense_equations(kind, monkeypatch):
    """The Jacobian of one segment at a time and the elimination in its order give the steps of a full Jacobian and LU."""
    model = stack(4, kind, stack__g_x=-9.81)
    command = commands(model, [0.0, 3.0, 9.0, 15.0], [[0.0] * 4, [12.0, -8.0, 10.0, 3.0], [-9.0, 0.0, 6.0, 12.0], [0.0] * 4])
    sparse = simulate(model, command, 10.0)
    monkeypatch.setattr('sma_sim.solver.simulate.elimination_of', lambda *_: DENSE)
    dense = simulate(model, command, 10.0)
    assert sparse.steps == pytest.approx(dense.steps, rel=0.02)
    for coordinate, scale in zip(model.structure.coordinates, model.scales, strict=False):
        assert sparse[coordinate.column] == pytest.approx(dense[coordinate.column], abs=2e-4 * scale)


def test_elimination_solves_sparse_equations():
    """Against numpy, for every kind of kinetics and size; effects, which may couple anything, are left to dense LU."""
    random = np.random.default_rng(9)
    for kind in ('hybrid', 'mas'):
        for modules in (2, 3, 7):
            model = stack(modules, kind)
            n = len(model.scales)
            plan = elimination_of(model.compiled, model.structure, n)
            pattern = jacobian_pattern(model.compiled, far_rates(model.structure), n)
            jacobian = np.where(pattern, random.uniform(-1.0, 1.0, (n, n)), 0.0)
            factors, b = np.full((n, n), np.nan), random.uniform(-1.0, 1.0, n)
            expected = np.linalg.solve(5.0 * np.sqrt(n) * np.eye(n) - jacobian, b)
            assert eliminate(jacobian, 5.0 * np.sqrt(n), factors, plan)
            solve_eliminated(factors, plan, b)
            assert b == pytest.approx(expected, rel=1e-10, abs=1e-14)
            assert len(plan.entries) < 0.6 * n**2 and far_rates(model.structure).tolist() == [False, False, True]
            assert not eliminate(jacobian, np.nan, factors, plan)
    friction = read_config(words=['system=stack'], effects=['natural_convection'])
    friction = Model(friction)
    assert len(elimination_of(friction.compiled, friction.structure, 24).order) == 0
