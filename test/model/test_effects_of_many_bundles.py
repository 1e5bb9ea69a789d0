"""Effects on structures with any number of bundles, and in space: parameters for each, and what all sensors see."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from test_structures import MOVING, evaluated, model_of, states

from sma_sim import Input, UserError, default_parameters, effects, find_effects, read_config, simulate
from sma_sim.evidence.model_selection.candidates import candidates_for
from sma_sim.evidence.model_selection.variants import scopes_of
from sma_sim.model.config import Config
from sma_sim.model.effects.conversion import effect_on
from sma_sim.model.effects.discovery import ActiveEffect
from sma_sim.model.layout import O_J, O_STRAIN
from sma_sim.solver.effect_table import channel_codes
from sma_sim.solver.model import Model

HEATED = np.array([2.0, 5.0, 3.0, 298.0])


def spatial(*effects, **parameters):
    return Model(read_config(words=['system=spatial', *(f'{k}={v}' for k, v in parameters.items())], effects=effects))


def findings(model, u=HEATED):
    y, x = next(states(model, 4, 1))
    return evaluated(model, y, x, u)


def test_power_of_each_bundle():
    plain = findings(spatial())[1][:, O_J]
    one = findings(spatial('power_gain_mismatch:ratio=1,gain_2=0.85'))[1][:, O_J]
    assert one == pytest.approx(plain * [1.0, 0.85, 1.0], rel=1e-12)
    every = findings(spatial('power_gain_mismatch:ratio=1.44,gain_2=0.9,gain_3=1.1'))[1][:, O_J]
    assert every == pytest.approx(plain * [1.2, 0.9 / 1.2, 1.1 / 1.2], rel=1e-12)


def test_clamps_of_some_bundles_slip():
    strain = findings(spatial('clamp_slip:delta=0.001,delta_2=0.002,delta_3=0.003,t_slip=0'))[1][:, O_STRAIN]
    assert strain == pytest.approx([0.0005, 0.001, 0.0015], rel=1e-12)
    effects = {name: effect_on(find_effects()['clamp_slip'], MOVING[name]) for name in ('slider', 'module')}
    assert [p.name for p in effects['slider'].parameters] == ['delta', 't_slip', 'w']
    assert [p.name for p in effects['module'].parameters] == ['delta', 't_slip', 'w', 'delta_2']
    assert not scopes_of(effect_on(find_effects()['clamp_slip'], MOVING['module']))


def test_length_of_each_bundle():
    strain = findings(spatial('pretension_mismatch:delta=0.004,extra_3=0.001'))[1][:, O_STRAIN]
    assert strain == pytest.approx([0.002, -0.002, -0.001], abs=1e-15)


@pytest.mark.parametrize(
    ('name', 'parameter', 'value'),
    [('power_gain_mismatch', 'ratio', 1.3), ('pretension_mismatch', 'delta', 0.006), ('gravity', 'g_y', -5.0)],
)
def test_parameters_of_two_bundles_and_a_plane_mean_what_they_did(name, parameter, value):
    """By name in a file, and as an effect that is declared for the module."""
    by_name = spatial(f'{name}:{parameter}={value}')
    found = find_effects()[name]
    values = tuple(value if p.name == parameter else p.neutral for p in found.parameters)
    declared = Model(Config(default_parameters('spatial'), 'spatial', 'hybrid', (ActiveEffect(found, values),)))
    for first, second in zip(findings(by_name), findings(declared), strict=True):
        assert (first == second).all()
    assert [p.name for p in find_effects()[name].parameters] == {
        'power_gain_mismatch': ['ratio'],
        'pretension_mismatch': ['delta'],
        'gravity': ['g_y', 'g_x'],
    }[name]


def test_gravity_has_every_direction_of_the_frame():
    names = {
        system: [p.name for p in effect_on(find_effects()['gravity'], MOVING[system]).parameters]
        for system in ('module', 'spatial', 'stack')
    }
    assert names == {'module': ['g_y', 'g_x'], 'spatial': ['g_y', 'g_x', 'g_z'], 'stack': ['g_y', 'g_x']}
    plain = findings(spatial())[0]
    pulled = findings(spatial('gravity:g_y=1,g_x=2,g_z=-9.81'))[0]
    assert pulled[6:9] - plain[6:9] == pytest.approx([2.0, 1.0, -9.81], rel=1e-6)
    with pytest.raises(UserError, match='g_z'):
        read_config(effects=['gravity:g_z=1'])
    called = read_config(words=['system=spatial'], effects=[effects.gravity(g_z=-9.81), effects.clamp_slip(delta_3=0.01)])
    assert called.effects[0].values[2] == -9.81 and called.effects[1].values[-1] == 0.01
    with pytest.raises(UserError, match='no parameter delta_1'):
        effects.clamp_slip(delta_1=0.01)


def space_cases():
    random, structure = np.random.default_rng(0), MOVING['spatial']
    for _ in range(10):
        q = random.normal(size=6) * [1e-4, 3e-3, 3e-3, 0.2, 0.2, 0.1]
        yield q, SimpleNamespace(**dict(zip(structure.coordinate_names, q, strict=True))), structure.default_constants


def test_a_camera_that_is_turned_in_space():
    """Displacements and angles are those of the pose in its frame, by rotations of SciPy."""
    kernel, angles = dict(find_effects()['sensor_misalignment'].kernels)['spatial'], (0.3, -0.2, 0.1)
    p = SimpleNamespace(theta=angles[0], theta_y=angles[1], theta_x=angles[2])
    codes = channel_codes(MOVING['spatial'])[:6]
    for q, state, constants in space_cases():
        camera, plate = Rotation.from_euler('ZYX', angles), Rotation.from_euler('ZYX', q[3:])
        seen = [*camera.inv().apply(q[:3]), *(camera.inv() * plate).as_euler('ZYX')]
        assert [kernel(SimpleNamespace(**vars(state), channel=code), constants, p) for code in codes] == pytest.approx(
            seen, abs=1e-12
        )
    flat = SimpleNamespace(U_x=1e-4, U_y=3e-3, U_z=0.0, alpha=0.2, beta=0.0, gamma=0.0)
    plane = SimpleNamespace(theta=0.3, theta_y=0.0, theta_x=0.0)
    for code, value in ((0, flat.U_x), (1, flat.U_y), (2, flat.alpha)):
        here = SimpleNamespace(**vars(flat), channel=code, value=value)
        assert kernel(here, None, plane) == pytest.approx(find_effects()['sensor_misalignment'].kernel(here, None, plane))


def test_a_beam_that_bends_in_two_planes_pulls_down_the_slope_of_its_energy():
    kernel, p = dict(find_effects()['beam_nonlinearity'].kernels)['spatial'], SimpleNamespace(b=4.0, c=0.8)

    def energy(q, b):
        x, weight = np.polynomial.legendre.leggauss(12)
        x, weight = 0.5 * b.L * (1.0 + x), 0.5 * b.L * weight
        curved, shortening = 0.0, 0.0
        for tip, slope in ((q[1], q[3]), (q[2], -q[4])):
            A = np.linalg.solve([[b.L**2, b.L**3], [2 * b.L, 3 * b.L**2]], [tip, slope])
            curved = curved + (2 * A[0] + 6 * A[1] * x) ** 2
            shortening += 0.5 * ((2 * A[0] * x + 3 * A[1] * x**2) ** 2 @ weight)
        hard = b.k_y * b.L**3 / 12.0 * p.b * b.L**2 / 4.0 * (curved**2 @ weight)
        return hard + 0.5 * b.k_x * ((q[0] + p.c * shortening) ** 2 - q[0] ** 2)

    for q, state, constants in space_cases():
        steps = np.diag([1e-7, 1e-6, 1e-6, 1e-5, 1e-5, 1e-5])
        slopes = [(energy(q + d, constants) - energy(q - d, constants)) / (2.0 * d.sum()) for d in steps]
        found = np.array(kernel(state, constants, p))
        assert found == pytest.approx(-np.array(slopes), abs=1e-6 * np.abs(found).max())


def test_gravity_of_a_stack_is_that_of_its_parameters():
    """Every module carries the weight of those beyond it."""
    found, values = find_effects()['gravity'], (-9.0, 3.0)
    by_effect = model_of('stack', effects=[ActiveEffect(effect_on(found, MOVING['stack']), values)])
    by_parameters = model_of('stack', stack__g_y=-9.0, stack__g_x=3.0)
    plain = model_of('stack')
    u = np.array([3.0, -4.0, 5.0, 298.0])
    for y, x in states(plain, 3, 5):
        first, second, without = (evaluated(model, y, x, u)[0] for model in (by_effect, by_parameters, plain))
        assert first == pytest.approx(second, rel=1e-9, abs=1e-9 * np.abs(second - without).max())
        assert np.abs(second - without).max() > 1.0
    assert 'stack.g_x' in effect_on(found, MOVING['stack']).same_as


@pytest.mark.parametrize('system', ['module', 'spatial'])
def test_force_sensors_that_see_their_neighbours(system):
    """All of a kind at once are multiplied by a matrix with c beside its diagonal."""
    c, d, structure = 0.06, 0.02, MOVING[system]
    found = find_effects()['sensor_crosstalk']
    truth, rich = model_of(system), model_of(system, effects=[ActiveEffect(found, (c, d))])
    columns = [(f'F_{i + 1}_N', f'T_{i + 1}_K') for i in range(structure.wires)]
    source = Input(
        np.array([0.0, 6.0]),
        np.tile([*range(1, len(structure.commands) + 1), 298.0], (2, 1)),
        (False,) * len(structure.input_columns),
        structure.input_columns,
    )
    before, after = (simulate(model, source, np.linspace(0.0, 6.0, 31)) for model in (truth, rich))
    for kind, part in ((0, c), (1, d)):
        names = [pair[kind] for pair in columns]
        true = np.array([before[name] for name in names])
        matrix = np.full((len(names), len(names)), part) + (1.0 - part) * np.eye(len(names))
        assert np.array([after[name] for name in names]) == pytest.approx(matrix @ true, rel=1e-6)
    assert [scope.name for scope in scopes_of(find_effects()['sensor_crosstalk'])] == ['F_1', 'F_2', 'T_1', 'T_2']


def test_one_force_sensor_alone_sees_the_others():
    one = read_config(effects=['sensor_crosstalk@F_2:F=0.1'])
    run = simulate(Model(one), Input(np.array([0.0, 2.0]), np.tile([5.0, 298.0], (2, 1)), (False, False)), 5.0)
    bare = simulate(Model(read_config()), Input(np.array([0.0, 2.0]), np.tile([5.0, 298.0], (2, 1)), (False, False)), 5.0)
    assert run['F_1_N'] == pytest.approx(bare['F_1_N']) and run['T_1_K'] == pytest.approx(bare['T_1_K'])
    assert run['F_2_N'] == pytest.approx(bare['F_2_N'] + 0.1 * bare['F_1_N'], rel=1e-6)


def test_every_thermometer_lags():
    """One for each bundle, however many there are."""
    found = effect_on(find_effects()['thermometer_lag'], MOVING['spatial'])
    assert found.channels == ('T_1', 'T_2', 'T_3')


def test_zeros_of_every_force_sensor_drift():
    found = effect_on(find_effects()['sensor_drift'], MOVING['spatial'])
    names = [p.name for p in found.parameters]
    assert names == ['U_x', 'U_y', 'U_z', 'alpha', 'beta', 'gamma', 'F_1', 'F_2', 'F_3', 'k']
    assert [p.unit for p in found.parameters][2:7] == ['m/s', 'rad/s', 'rad/s', 'rad/s', 'N/s']
    shown = spatial('sensor_drift:F_3=0.5,F_1=0,F_2=0,U_x=0,U_y=0,U_z=0,alpha=0,beta=1e-3,gamma=0')
    source = Input(np.array([0.0, 4.0]), np.tile(HEATED, (2, 1)), (False,) * 4, shown.structure.input_columns)
    run, bare = (simulate(model, source, np.linspace(0.0, 4.0, 9)) for model in (shown, spatial()))
    assert run['F_3_N'] - bare['F_3_N'] == pytest.approx(0.5 * run.time, abs=1e-3)
    assert run['beta_rad'] - bare['beta_rad'] == pytest.approx(1e-3 * run.time, abs=1e-6)
    assert run['F_2_N'] == pytest.approx(bare['F_2_N'], abs=1e-3)


def test_dry_friction_of_a_rail_is_named_as_the_parameter_that_it_is():
    slider, lever = (effect_on(find_effects()['joint_friction'], MOVING[name]) for name in ('slider', 'lever'))
    assert 'slider.F_c' in slider.phrase and slider.same_as == 'slider.F_c with slider.v_c'
    low, high = slider.parameters[1].realistic
    assert low < MOVING['slider'].default_values['slider.v_c'] < high
    assert lever.phrase == 'dry friction of the joints' and not lever.same_as
    friction = ActiveEffect(effect_on(find_effects()['joint_friction'], MOVING['slider']), (0.3, 1e-3))
    by_effect, by_parameter = model_of('slider', effects=[friction]), model_of('slider', slider__F_c=0.3, slider__v_c=1e-3)
    for y, x in states(by_effect, 5, 5):
        first, second = (evaluated(model, y, x, np.array([1.0, 298.0]))[0] for model in (by_effect, by_parameter))
        assert first == pytest.approx(second, rel=1e-9)


def test_candidates_are_what_can_act():
    names = {
        system: {c.name for c in candidates_for(read_config(words=[f'system={system}']))}
        for system in ('module', 'spatial', 'slider', 'stack', 'lever', 'wire')
    }
    for system in ('module', 'spatial', 'stack', 'lever'):
        assert {'sensor_crosstalk', 'power_gain_mismatch', 'pretension_mismatch', 'clock_skew'} <= names[system]
    assert not {'sensor_crosstalk', 'power_gain_mismatch', 'gravity'} & (names['slider'] | names['wire'])
    assert 'gravity' in names['spatial'] & names['stack'] and 'gravity' not in names['lever']
    prescribed = candidates_for(read_config(words=['system=wire', 'bench.temperature=prescribed']))
    heating = {'driver_saturation', 'driver_deadband', 'ambient_drift', 'heat_capacity_difference'}
    assert heating <= names['wire'] and not heating & {candidate.name for candidate in prescribed}
    isobaric = ['system=wire', 'bench.temperature=prescribed', 'bench.control=stress']
    timed = {'sensor_drift', 'sensor_jump', 'clamp_slip', 'clock_skew'}
    assert timed <= {candidate.name for candidate in prescribed}
    assert not timed & {candidate.name for candidate in candidates_for(read_config(words=isobaric))}
