"""Effects in one wire, one coordinate or one channel only, and with a state that both wires share."""

import math
import pickle
import sys
from pathlib import Path

import numpy as np
import pytest
from flows import Point, active, make_model

from sma_sim import Effect, Parameter, UserError, find_effects, read_config, simulate
from sma_sim.compiler.effect_kernels import native_effect
from sma_sim.evidence.estimation.executors import PickledConfig
from sma_sim.model.effects.discovery import ActiveEffect, with_scopes
from sma_sim.model.effects.meaning import acts_on
from sma_sim.model.effects.scope import law_name
from sma_sim.model.parameter_file import parameter_file
from sma_sim.model.structures.discovery import package_structures
from sma_sim.solver.inputs import module_input

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / 'benchmarks'))
from other_form_truths import FORMS  # noqa: E402

COMMAND = module_input([0.0, 1.0, 8.0, 14.0, 20.0], [0.0, 12.0, -10.0, 4.0, 0.0])
SAMPLES = np.arange(0.0, 20.0, 0.1)
NOISE = {'U_x_m': 2e-6, 'U_y_m': 1e-5, 'alpha_rad': 3.5e-4, 'T_1_K': 0.1, 'T_2_K': 0.1}
MODULE = package_structures()['module']
BY_WIRE = [  # slack: not only in wires that would push
    name
    for name, one in find_effects().items()
    if one.port in ('wire_heat', 'wire_strain', 'wire_force')
    and acts_on(one, MODULE)
    and name not in ('slack', 'clamp_slip')  # the latter has a parameter for each bundle
]


def in_scope(name, **values):
    """An effect in a scope, NAME@SCOPE, at its defaults but for `values`."""
    found = with_scopes(find_effects(), [name])[name]
    return ActiveEffect(found, tuple(values.get(p.name, p.default) for p in found.parameters))


def form(name, **values):
    """The effect of a truth that is written apart."""
    truth = FORMS[name].truth
    return list(truth.active({p.name: values[p.name] for p in truth.parameters}))


def shown(effects):
    """What a module with these effects does."""
    run = simulate(make_model(effects=effects, solver__rtol=1e-7), COMMAND, SAMPLES)
    assert run.completed
    return run


def assert_same(effects, others, noise_part=0.02):
    """Both change the motion by more than the noise, and by the same."""
    first, second, nothing = shown(effects), shown(others), shown([])
    assert max(np.abs(first[name] - nothing[name]).max() / std for name, std in NOISE.items()) > 2.0
    for name, std in NOISE.items():
        assert first[name] == pytest.approx(second[name], abs=noise_part * std)


@pytest.mark.parametrize('name', sorted(BY_WIRE))
def test_an_effect_in_one_wire_leaves_the_other_alone(name):
    for scope, acting, other in (('wire_1', 0, 1), ('wire_2', 1, 0)):
        start = Point(make_model('module', 'mas'), np.random.default_rng(2))
        found = {}
        for words, effects in (('none', []), ('both', [active(name)]), ('one', [in_scope(f'{name}@{scope}')])):
            point = Point(make_model('module', 'mas', effects), np.random.default_rng(3))
            point.y[: len(start.y)], point.u[:] = start.y, start.u
            point.y[len(start.y) :] = point.model.scales[len(start.y) :]
            point.t = 10.0  # where what depends on time shows
            rates, values = point.evaluate()
            found[words] = np.column_stack([values, rates[point.p.first_T : point.p.first_T + 2]])
        assert np.array_equal(found['one'][acting], found['both'][acting])
        assert np.array_equal(found['one'][other], found['none'][other])
        assert not np.array_equal(found['one'], found['none'])


def test_a_driver_that_lags_in_one_wire_passes_the_other_on():
    assert_same([in_scope('driver_lag@wire_1', tau=0.8)], form('wire_1_lag', tau=0.8))


def test_creep_in_rotation_is_a_hinge_that_relaxes():
    beam = make_model().constants
    assert_same([in_scope('beam_creep@rotation', phi=0.1, tau=6.0)], form('hinge_creep', c=0.1 * beam.k_a, tau=6.0))


def test_creep_in_stretch_is_a_spring_along_the_beam_that_relaxes():
    beam = make_model().constants
    assert_same([in_scope('beam_creep@stretch', phi=0.2, tau=6.0)], form('stretch_creep', c=0.2 * beam.k_x, tau=6.0))


def test_a_cubic_beam_in_rotation_is_a_cubic_moment():
    beam = make_model().constants
    assert_same([in_scope('beam_nonlinearity@rotation', b=1.5, c=0.0)], form('hinge_cubic', c=8.8 * 1.5 * beam.k_a))


def test_air_that_both_wires_share():
    """tau = C/G; the mean of both bundles warms it, so that R is twice that of the room."""
    shared, own = [in_scope('ambient_heating@shared', R=1.0, tau=20.0)], [active('ambient_heating', [1.0, 20.0])]
    assert_same(shared, form('shared_air', G=2.0, C=40.0))
    assert np.abs(shown(shared)['T_2_K'] - shown(own)['T_2_K']).max() > 1.0


def test_a_sensor_that_lags_in_one_channel():
    late, nothing, one = shown([active('sensor_lag', [0.5])]), shown([]), shown([in_scope('sensor_lag@alpha', tau=0.5)])
    assert one['alpha_rad'] == pytest.approx(late['alpha_rad'], abs=1e-6)
    assert one['U_y_m'] == pytest.approx(nothing['U_y_m'], abs=1e-8)


def own_law(name, port, parameters, kernel, values, **more):
    """An effect that is written apart, at values."""
    effect = Effect(name, port, '', '', tuple(Parameter(p, 0.0, '-', (-1e9, 1e9), '') for p in parameters), kernel, **more)
    return [ActiveEffect(effect, values)]


def test_another_form_multiplies_the_law_of_a_wire():
    """The friction of guides as another function of the speed, in one wire: a kernel that is written out does the same."""
    form_1, form_2, width = 0.3, -0.4, 2e-4
    scoped = in_scope('guide_friction@wire_2_form_v', mu=0.2, v_s=1e-4, form_1=form_1, form_2=form_2, form_width=width)
    written = own_law(
        'written_friction', 'wire_force', ('mu', 'v_s', 'a', 'b', 'c'),
        lambda s, w, p: s.wire * s.F * (math.exp(p.mu * math.tanh(s.v / p.v_s)) - 1.0)
        * math.exp(p.a * math.tanh(s.v / p.c) + p.b * s.v**2 / (s.v**2 + p.c**2)),
        (0.2, 1e-4, form_1, form_2, width),
    )  # fmt: skip
    assert_same([scoped], written, 1e-2)  # of the noise: rounding shifts the instant of a reversal


def test_another_form_multiplies_the_law_of_a_joint():
    scoped = in_scope('joint_friction@form_dq', M_c=0.05, w_s=5e-3, form_1=-0.2, form_2=0.4, form_width=0.01)
    written = own_law(
        'written_joint', 'structure_force', ('M', 'w', 'a', 'b', 'c'),
        lambda s, b, p: (0.0, 0.0, -p.M * math.tanh(s.dalpha / p.w)
        * math.exp(p.a * math.tanh(s.dalpha / p.c) + p.b * s.dalpha**2 / (s.dalpha**2 + p.c**2))),
        (0.05, 5e-3, -0.2, 0.4, 0.01),
    )  # fmt: skip
    assert_same([scoped], written, 1e-3)


def test_another_form_counts_temperatures_from_the_surroundings():
    scoped = in_scope('natural_convection@form_T', k=40.0, m=0.25, form_1=0.5, form_2=0.0, form_width=30.0)
    written = own_law(
        'written_convection', 'wire_heat', ('k', 'm', 'a', 'c'),
        lambda s, w, p: -p.k * w.surface * abs(s.T - s.T_E) ** p.m * (s.T - s.T_E)
        * math.exp(p.a * math.tanh((s.T - s.T_E) / p.c)),
        (40.0, 0.25, 0.5, 30.0),
    )  # fmt: skip
    assert_same([scoped], written, 1e-3)


@pytest.mark.parametrize('name', ['guide_friction@form_v', 'joint_friction@form_dq', 'polycrystal@wire_1_form_x'])
def test_the_form_that_is_declared_is_the_neutral_one(name):
    effect = find_effects()[name.partition('@')[0]]
    law = in_scope(law_name(name)) if '@' in law_name(name) else active(effect.name, [p.default for p in effect.parameters])
    for column, values in shown([in_scope(name)]).columns.items():
        assert np.array_equal(values, shown([law])[column])


def test_a_law_has_other_forms_in_what_it_reads():
    with pytest.raises(UserError, match='another form needs a field that its law depends on .*v.*, not T'):
        shown([in_scope('guide_friction@form_T')])
    with pytest.raises(UserError, match='unknown scope .form_u.'):
        read_config(effects=['guide_friction@form_u'])


def test_scopes_compile_nothing():
    found = find_effects()['natural_convection']
    for scope in (*found.scopes, found.scopes[0].of('T')):
        assert native_effect(found.in_scope(scope)) is native_effect(found)


def test_a_state_that_begins_in_the_wire_is_not_shared():
    found = find_effects()['latent_heat_scale']
    assert all(not scope.shared for scope in found.scopes)
    (shared,) = [scope for scope in find_effects()['ambient_heating'].scopes if scope.shared]
    with pytest.raises(UserError, match='wires can share states of wire_heat that begin at zero'):
        native_effect(found.in_scope(shared))


def test_a_scope_survives_its_parameter_file(tmp_path):
    config = read_config(effects=['natural_convection@wire_1:k=30', 'gravity', 'guide_friction@form_v:mu=0.2,form_2=0.1'])
    file = tmp_path / 'robot.yaml'
    file.write_text(parameter_file(config))
    again = read_config(file)
    assert [(active.effect.name, active.values) for active in again.effects] == [
        (one.effect.name, one.values) for one in config.effects
    ]
    assert again.effects[0].effect.scope.name == 'wire_1' and again.effects[0].values[0] == 30.0
    assert again.effects[0].effect.phrase == 'heat lost by natural convection, in wire 1 only'


def test_a_scope_reaches_other_processes():
    config = read_config(effects=['natural_convection@wire_2:k=30'])
    sent = pickle.loads(pickle.dumps(PickledConfig(config))).config
    assert sent.effects[0].effect == config.effects[0].effect


@pytest.mark.parametrize(
    ('word', 'message'),
    [
        ('beam_creep@wire_1', 'unknown scope .wire_1. of effect beam_creep .*expected one of stretch, deflection, rotation'),
        ('gravety@wire_1', 'unknown effect gravety@wire_1'),
    ],
)
def test_an_unknown_scope_is_refused(word, message):
    with pytest.raises(UserError, match=message):
        read_config(effects=[word])
