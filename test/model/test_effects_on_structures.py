"""Every effect on every structure where it has a meaning: nothing at its neutral values, the first law, something else."""

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from test_structures import MOVING, command_of, evaluated, model_of, states

from sma_sim import Input, UserError, find_effects, read_config, simulate
from sma_sim.cli.main import main
from sma_sim.evidence.estimation.injection_points import small_force
from sma_sim.model.effects.conversion import effect_on, pull_of
from sma_sim.model.effects.discovery import ActiveEffect, effects_on
from sma_sim.model.effects.effect import kind_of
from sma_sim.model.effects.meaning import acts_on
from sma_sim.model.layout import O_DEPS, O_DX, O_EPS, O_F, O_J, O_RATIO, O_SIGMA, O_STRAIN, O_V, O_X
from sma_sim.model.material import internal_energy, latent_heat
from sma_sim.model.structures.discovery import package_structures
from sma_sim.model.structures.structure import numbers, record
from sma_sim.model.system import extra_capacity, extra_heat

KINDS = ('hybrid', 'mas')
CASES = [
    (name, system)
    for system, on in sorted(MOVING.items())
    for name, one in sorted(find_effects().items())
    if acts_on(one, on)
]
# Where an effect shows: wires that run out of martensite, wires that would push, a load that creep leaves above the plateau.
CONDITIONS = {
    'pretension_mismatch': {'wire__l0': 99e-3},
    **dict.fromkeys(('functional_fatigue', 'r_phase_strain', 'transformation_plasticity'), {'wire__l0': 99e-3}),
    'slack': {'wire__sigma_MW0': 45e6},
    'clamp_slip': {'wire__l0': 99e-3},
    ('clamp_slip', 'slider'): {'wire__l0': 95.7e-3},
    ('beam_creep', 'slider'): {'slider__x_0': 0.035},
    ('functional_fatigue', 'slider'): {'wire__l0': 95.7e-3},
    ('transformation_plasticity', 'slider'): {'wire__l0': 95.7e-3},
    ('slack', 'slider'): {'slider__x_0': -0.008, 'slider__incline': 0.0, 'initial__x_M_1': 0.0},
}
DURATION = 12.0


def command(system):
    """Heating on and off again, of several wires not alike."""
    source, count = command_of(system, DURATION), len(MOVING[system].commands)
    return replace(source, values=source.values * np.append(np.resize([1.0, 0.5, 0.2], count), 1.0))


def conditions(name, system):
    return {**CONDITIONS.get(name, {}), **CONDITIONS.get((name, system), {})}


def effect_of(name, system, neutral=False):
    """An effect as it is on a structure, at its neutral values or its defaults."""
    found = effect_on(find_effects()[name], MOVING[system])
    values = (p.neutral if neutral and p.neutral is not None else p.default for p in found.parameters)
    return ActiveEffect(found, tuple(values))


@cache
def nominal_run(system, kind, changed):
    return simulate(model_of(system, kind, **dict(changed)), command(system), 20.0)


@pytest.mark.parametrize(('name', 'system'), CASES)
def test_neutral_values_change_nothing(name, system):
    """At random states the rates of the structure, of temperatures and fractions are the same to rounding."""
    for kind in KINDS:
        bare, still = model_of(system, kind), model_of(system, kind, [effect_of(name, system, neutral=True)])
        u = np.full(len(bare.structure.input_columns), 298.0)
        u[:-1] = 0.5
        for y, x in states(bare, 5, 3):
            padded = np.concatenate([y, np.zeros(len(still.scales) - len(y))])
            expected, shown = evaluated(bare, y, x, u)[0], evaluated(still, padded, x, u)[0][: len(y)]
            assert np.abs(shown - expected).max() <= 1e-12 * np.abs(expected).max()


@pytest.mark.parametrize(('name', 'system'), CASES)
def test_realistic_values_change_a_run(name, system):
    """And the run comes to its end."""
    changed = conditions(name, system)
    for kind in KINDS:
        bare = nominal_run(system, kind, tuple(changed.items()))
        model = model_of(system, kind, [effect_of(name, system)], **changed)
        run = simulate(model, command(system), 20.0)
        assert run.completed and run.chattering <= bare.chattering + 3
        scales = dict(zip(model.structure.channel_columns, sizes(model), strict=True))
        assert max(np.abs(run[column] - bare[column]).max() / size for column, size in scales.items()) > 2e-3


def sizes(model):
    """A usual change of every channel."""
    coordinates = [coordinate.size(model.constants) for coordinate in model.structure.coordinates]
    return [*coordinates, *[1.0] * model.wires, *[10.0] * model.wires, *[0.5] * model.wires]


@pytest.mark.parametrize(('name', 'system'), CASES)
def test_first_law(name, system):
    """What wires and structure store changes by heat, by friction, and by what the effect says that it takes or gives."""
    for kind in KINDS:
        model = model_of(system, kind, [effect_of(name, system)])
        if model.structure.energy is None:
            continue
        u = np.full(len(model.structure.input_columns), 298.0)
        u[:-1] = 0.4
        random = np.random.default_rng(7)
        for y, x in states(model, 6, 4):
            first = model.compiled.first_x + (model.wires if model.compiled.mas else 0)
            y[first:] = model.scales[first:] * random.uniform(0.1, 0.9, len(y) - first)
            check_balance(model, y, x, u)


def check_balance(model, y, x, u):
    """Stored power against what flows in, at one state: of every wire (one of its bundle), and of the structure."""
    p, w = model.compiled, model.compiled.wire
    dy, obs = evaluated(model, y, x, u)
    heat, capacities = zip(*((extra_heat(i, obs[i, O_DX], y, p), extra_capacity(p)) for i in range(p.wires)), strict=True)
    first, acting = p.drives + 1, int(p.structure.effects[p.drives])
    added = p.structure.effects[first : first + acting * p.coordinates].reshape(acting, p.coordinates).copy()
    strain_rates = rates_of_strain(model, y, x, u, dy)
    for i in range(p.wires):
        T, x_M, sigma = y[p.first_T + i], obs[i, O_X], obs[i, O_SIGMA]
        at = (obs[i, O_EPS] - obs[i, O_STRAIN] - w.eps_T * x_M, T, x_M)
        along = (obs[i, O_DEPS] - strain_rates[i] - w.eps_T * obs[i, O_DX], dy[p.first_T + i], obs[i, O_DX])
        stored = internal_energy(*(a + 1e-30j * b for a, b in zip(at, along, strict=True)), w).imag / 1e-30
        force = w.section * sigma * obs[i, O_RATIO]
        powers = np.array(
            [
                force * obs[i, O_V],
                obs[i, O_J],
                -w.lambda_ * w.surface * (T - 298.0),
                heat[i],
                -w.volume * sigma * strain_rates[i],
                -capacities[i] * dy[p.first_T + i],
            ]
        )
        exchanged = np.abs([*powers, latent_heat(T, sigma, w) * obs[i, O_DX]]).sum()
        assert stored == pytest.approx(powers.sum(), abs=1e-6 * exchanged)
    n, zero = p.coordinates, np.zeros(p.coordinates)
    q, v, a = y[:n], y[n : 2 * n], dy[n : 2 * n]
    # the energy is quadratic in the rates: any step is exact
    h = [step / np.abs(part / model.scales[k : k + n]).max() for step, k, part in ((1e-3, 0, v), (1.0, n, a))]
    stored = slope_of(lambda s: structure_energy(model, q + s * v, v), h[0])
    stored += slope_of(lambda s: structure_energy(model, q, v + s * a), h[1])
    friction = np.array(forces_at(model, q, v)) - forces_at(model, q, zero)
    powers = np.array([*(-obs[:, O_F] * obs[:, O_V]), *(friction * v), *(added @ v)])
    assert stored == pytest.approx(powers.sum(), abs=1e-6 * np.abs([*powers, *(forces_at(model, q, zero) * v)]).sum())


def slope_of(function, h):
    """Derivative at 0 by central differences of fourth order."""
    return (8.0 * (function(h) - function(-h)) - (function(2.0 * h) - function(-2.0 * h))) / (12.0 * h)


def rates_of_strain(model, y, x, u, dy):
    """Rate of the strain that effects add to every wire; it does not depend on the rates of the coordinates."""
    n, along = model.compiled.coordinates, dy.copy()
    along[n : 2 * n] = 0.0
    h = 1e-4 / np.abs(along / model.scales).max()
    return slope_of(lambda s: evaluated(model, y + s * along, x, u)[1][:, O_STRAIN], h)


def structure_energy(model, q, v):
    pose = record('Pose', model.structure.coordinate_names)
    return model.structure.energy(pose(*q), pose(*v), model.constants)


def forces_at(model, q, v):
    pose = record('Pose', model.structure.coordinate_names)
    return np.array(numbers(model.structure.forces(pose(*q), pose(*v), model.constants)))


def test_a_hardening_spring_and_one_with_play_balance_the_wires():
    """At rest: r (F_1 - F_2) is what the springs and the weight take, of a cubic spring and of one with a dead zone."""
    c, b, kept = 3.0, 0.4, {'solver__rtol': 1e-8}
    held = Input(np.array([0.0, 60.0]), np.array([[1.0, 298.0]] * 2), (False, False), ('J_eq_W', 'T_E_K'))
    for name, value, moment in (
        ('cubic_stiffness', c, lambda k, q: k * q + c * k * q**3),
        ('backlash', b, lambda k, q: k * (q - 0.5 * b)),
    ):
        found = effect_on(find_effects()[name], MOVING['lever'])
        model = model_of('lever', 'hybrid', [ActiveEffect(found, (value,))], **kept)
        p, run = model.constants, simulate(model, held, np.array([59.0]))
        q = run['angle_rad'][0]
        assert q > 0.3
        taken = moment(p.k, q) + p.m * p.g * p.a * np.sin(q)
        assert p.r * (run['F_1_N'][0] - run['F_2_N'][0]) == pytest.approx(taken, rel=1e-4)


def test_heat_that_three_bundles_exchange_is_kept():
    """Each gives to each of the others in proportion to their difference; of all together nothing is lost."""
    G, w = 0.05, model_of('spatial').compiled.wire
    found = find_effects()['thermal_crosstalk']
    bare, rich = model_of('spatial', 'mas'), model_of('spatial', 'mas', [ActiveEffect(found, (G,))])
    for y, x in states(bare, 8, 3):
        y[bare.compiled.first_x :] = 0.0  # austenite: no latent heat
        T, u = y[bare.compiled.first_T :][:3], np.full(4, 298.0)
        heat = [extra_heat(i, 0.0, y, rich.compiled) for i in range(3) if evaluated(rich, y, x, u)]
        expected = [G * w.l0 * sum(other - own for other in T) for own in T]
        assert heat == pytest.approx(expected, rel=1e-9) and sum(heat) == pytest.approx(0.0, abs=1e-12)


def test_air_that_three_bundles_share():
    """One state for all, which the mean of what they give warms; it is the same for each."""
    structure = MOVING['spatial']
    shared = effects_on(find_effects(), ['ambient_heating@shared'], structure)['ambient_heating@shared']
    model = model_of('spatial', 'hybrid', [ActiveEffect(shared, (1.0, 20.0))])
    p, w, u = model.compiled, model.compiled.wire, np.array([0.0, 0.0, 0.0, 298.0])
    for y, x in states(model, 9, 3):
        y[-3:] = 5.0
        dy, _ = evaluated(model, y, x, u)
        warmth = w.n * w.lambda_ * w.surface * (y[p.first_T : p.first_T + 3] - 298.0 - 5.0)
        assert dy[-3:] == pytest.approx([(warmth.mean() - 5.0) / 20.0] * 3, rel=1e-9)


def test_parameters_have_the_units_of_the_coordinate():
    """Numbers of a rotation of the module, converted by the pull of the wires and a usual change; rounded."""
    structure = MOVING['slider']
    friction, bias = (effect_on(find_effects()[name], structure) for name in ('joint_friction', 'sensor_bias'))
    assert [(p.name, p.unit, p.default) for p in friction.parameters] == [('M_c', 'N', 0.4), ('w_s', 'm/s', 3.3e-5)]
    thick = MOVING['slider'].default_values | {'wire.r0': 0.25e-3}
    assert effect_on(find_effects()['joint_friction'], structure, thick).parameters[0].default == pytest.approx(4.4)
    assert [(p.name, p.unit) for p in bias.parameters] == [('position', 'm')] and bias.channels == ('position',)
    assert [scope.name for scope in friction.scopes] == ['position']
    config = read_config(words=['system=slider'], effects=['joint_friction@position:M_c=0.1', 'sensor_bias:position=1e-4'])
    assert [active.values[0] for active in config.effects] == [0.1, 1e-4]
    with pytest.raises(UserError, match='expected 0 to 2000 N'):
        read_config(words=['system=slider'], effects=['joint_friction:M_c=3e3'])
    assert effect_on(find_effects()['beam_creep'], structure).phrase == 'creep of the springs'
    assert effect_on(find_effects()['gravity'], MOVING['module']) is find_effects()['gravity']


@pytest.mark.parametrize('system', ['slider', 'lever', 'spatial', 'wire_under_load'])
def test_sensors_are_off_by_a_part_of_the_usual_change(system):
    """That of the module: of U_y for what is no angle, of alpha for angles; gains are the same everywhere."""
    structure, module = package_structures()[system], package_structures()['module']
    bias, gain = (find_effects()[name] for name in ('sensor_bias', 'sensor_gain'))
    own, declared = effect_on(bias, structure).parameters, {p.name: p for p in bias.parameters}
    usual = {c.name: c.sensor_size(module.default_constants) for c in module.coordinates}
    assert [p.name for p in own] == list(structure.coordinate_names)
    for found, coordinate in zip(own, structure.coordinates, strict=True):
        like = declared['alpha' if coordinate.unit == 'rad' else 'U_y']
        factor = coordinate.sensor_size(structure.default_constants) / usual[like.name]
        assert found.unit == coordinate.unit and found.default == pytest.approx(factor * like.default, rel=0.05)
        assert found.realistic == pytest.approx([factor * x for x in like.realistic], rel=0.05)
        assert found.bounds == pytest.approx([factor * x for x in like.bounds], rel=0.05)
        assert coordinate.name in found.description
    plain = gain.parameters[1]
    for found in effect_on(gain, structure).parameters:
        assert (found.default, found.bounds, found.realistic) == (plain.default, plain.bounds, plain.realistic)


@pytest.mark.parametrize('name', sorted(package_structures()))
def test_sensors_have_parameters_of_the_channels_of_their_structure_alone(name):
    """Of each channel one; the module's declaration has that of the load cell of a single wire beside its own."""
    structure = package_structures()[name]
    if name == 'module':
        return
    for one in find_effects().values():
        if one.by_channel and acts_on(one, structure):
            own = effect_on(one, structure)
            of_channels = {p.name for p in own.parameters} - {p.name for p in own.shared_parameters}
            assert of_channels in ({*own.channels}, {kind_of(c) or c for c in own.channels}), one.name
            assert own.shared_parameters == one.shared_parameters


def test_a_drift_ends_on_the_bench_of_a_module_too():
    """k is the last parameter on every bench, however many channels come before it."""
    config = read_config(words=['system=module', 'bench.temperature=prescribed'], effects=['sensor_drift:alpha=1e-3,k=0.2'])
    bare = read_config(words=['system=module', 'bench.temperature=prescribed'])
    columns, times = bare.structure.input_columns, np.linspace(0.0, 20.0, 5)
    source = Input(np.array([0.0, 20.0]), np.full((2, len(columns)), 298.0), (False,) * len(columns), columns)
    shown, truth = (simulate(one, source, times)['alpha_rad'] for one in (config, bare))
    assert shown - truth == pytest.approx(1e-3 * (1.0 - np.exp(-0.2 * times)) / 0.2, rel=1e-6, abs=1e-9)


def test_effects_of_a_structure_are_listed(capsys):
    assert main(['effects', '--system', 'lever', '--json']) == 0
    listed = {one['name']: one for one in json.loads(capsys.readouterr().out)}
    assert {'joint_friction', 'backlash', 'beam_creep'} <= set(listed) and 'gravity' not in listed
    assert 'lever' in listed['backlash']['systems'] and 'module' not in listed['backlash']['systems']
    assert main(['effects', 'sensor_bias', '--system', 'spatial']) == 0
    told = capsys.readouterr().out
    assert 'U_z      offset of U_z' in told and 'acts on: ' in told and 'slider' in told
    assert main(['effects', '--system', 'sldier']) == 2
    assert 'did you mean slider' in capsys.readouterr().err


def slopes_at_rest(structure, function, constants, at):
    """Derivatives of a function of the pose in one coordinate, where all are zero."""
    pose, h = record('Pose', structure.coordinate_names), 1e-3 * structure.coordinates[at].size(constants)
    ends = [pose(*(side * h * (j == at) for j in range(len(structure.coordinates)))) for side in (1.0, -1.0)]
    forward, back = (np.array(numbers(function(end))) for end in ends)
    return (forward - back) / (2.0 * h)


@pytest.mark.parametrize('system', sorted(MOVING))
def test_small_forces_move_a_coordinate_by_a_part_of_its_usual_change(system):
    """What a bundle pulls with is its section times the slope of its length; a spring yields by force over stiffness."""
    config = model_of(system).config
    structure, values = config.structure, config.parameters
    constants = structure.constants_of(values)
    section, sprung = values['wire.n'] * np.pi * values['wire.r0'] ** 2, 0
    rest = record('Pose', structure.coordinate_names)(*np.zeros(len(structure.coordinates)))
    for at, coordinate in enumerate(structure.coordinates):
        arm = np.abs(slopes_at_rest(structure, lambda q: structure.lengths(q, constants), constants, at)).max()
        lengths = numbers(structure.lengths(rest, constants))
        arm *= structure.strains(lengths[:1], values)[0][1]  # 1 of a straight wire
        pull = pull_of(structure, at, values)
        assert pull == pytest.approx(section * arm if arm > 1e-9 else section, rel=1e-4), coordinate.name
        stiffness = -slopes_at_rest(structure, lambda q: structure.forces(q, rest, constants), constants, at)[at]
        force = small_force(config, at)
        if stiffness > 0.0:
            sprung += 1
            assert 1e-3 < force / stiffness / coordinate.size(constants) < 0.5
        else:
            assert 1e-3 * pull < force / 1e8 < 0.5 * pull  # of the usual stress of a wire, 100 MPa
    assert sprung or system in ('lever', 'slider', 'rocker', 'coil')
