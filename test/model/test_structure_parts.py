"""What follows from the declaration of a structure: channels, columns, noise, drawings, limits of joints, effects on it."""

import math

import numpy as np
import pytest

from sma_sim import Coordinate, Effect, Parameter, Structure, UserError, read_config
from sma_sim.compiler.compile import reachable
from sma_sim.compiler.effect_kernels import kernel_types, outputs_of, own_kernels, pose_fields, returns_tuple
from sma_sim.compiler.fields_read import can_share, fields_read, uses_time
from sma_sim.compiler.kernel_text import OneKernel, parameter_of_channel
from sma_sim.compiler.structure_kernels import new_effects
from sma_sim.model.effects.conversion import converted, effect_on, pull_of, rounded, size_of
from sma_sim.model.effects.discovery import EffectError, find_effects
from sma_sim.model.effects.meaning import POSE, acting_coordinates, acts_on, channel_slots, is_tried
from sma_sim.model.kinetics import mas_rate, transition_rates
from sma_sim.model.layout import RANGE
from sma_sim.model.parameters import BEAM_PARAMETERS, beam_constants, wire_constants
from sma_sim.model.structures.beam_links import beam_links
from sma_sim.model.structures.checks import fault_of
from sma_sim.model.structures.discovery import package_structures
from sma_sim.model.structures.drawing import SPACING, Sketch, axis_of, projected
from sma_sim.model.structures.module import STRUCTURE as MODULE
from sma_sim.model.structures.series import in_series
from sma_sim.model.structures.structure import MAX_WIRES, numbers, record
from sma_sim.model.system import update_flow
from sma_sim.solver.effect_table import channel_codes, channel_scales, state_scales, states_together
from sma_sim.solver.integrate import integrate

FOUND = package_structures()
EFFECTS = find_effects()
PLAIN = {'lengths': lambda q, p: 0.1 - q.x, 'forces': lambda q, v, p: -q.x, 'inertia': lambda p: 1.0}


def one_coordinate(wires=1, **fields):
    """A spring that some wires pull along x."""
    given = PLAIN | {'lengths': lambda q, p: tuple([0.1 - q.x] * wires) if wires > 1 else 0.1 - q.x}
    coordinate = Coordinate('x', 'm', 0.004, **fields.pop('coordinate', {}))
    return Structure('one', 'spring', (coordinate,), wires, **(given | fields))


@pytest.mark.parametrize('name', sorted(FOUND))
def test_channels_columns_and_inputs_belong_together(name):
    structure = FOUND[name]
    suffixes = [''] if structure.wires == 1 else [f'_{i + 1}' for i in range(structure.wires)]
    shown = list(structure.coordinate_names) or ['stress']
    shown += [f'F{s}' for s in suffixes] if structure.coordinates else []
    shown += [] if structure.drives and structure.drives[-1].unit == 'K' else [f'T{s}' for s in suffixes]
    assert list(structure.channels) == shown + [f'R{s}' for s in suffixes]
    units = {'F': '_N', 'T': '_K', 'R': '_ohm', 'stress': '_Pa'}
    for channel, column in zip(structure.channels, structure.channel_columns, strict=True):
        of = {c.name: c for c in structure.coordinates}.get(channel)
        unit = units.get(channel.partition('_')[0], '') if of is None else '' if of.unit == '-' else f'_{of.unit}'
        assert column == channel + unit
    assert structure.resistance_columns == tuple(f'R{s}_ohm' for s in suffixes)
    states = [f'{kind}{s}{unit}' for kind, unit in (('x_M', ''), ('mode', ''), ('T', '_K')) for s in suffixes]
    assert list(structure.sampled_columns) == [*structure.channel_columns, *states]
    commands = structure.wires // 2 if structure.antagonistic else structure.wires
    assert len(structure.commands) == commands and structure.input_columns[-1] == 'T_E_K'
    assert len(structure.input_columns) == len(structure.drives) + commands + 1
    imposed = [d.column for d in structure.drives] or [f'{c}_W' for c in structure.commands]
    assert list(structure.needed_columns) == imposed
    assert structure.has_one_command == (commands == 1 and not structure.drives)
    imposed = {drive.name for drive in structure.drives}
    assert structure.is_quasi_static == (imposed == {'stress', 'T'})
    assert structure.imposed_temperature == (len(structure.loads) if imposed & {'T', 'T_1'} else -1)
    assert len(structure.initial) == max(0, structure.wires - 2)
    assert len(channel_codes(structure)) == len(set(channel_codes(structure))) == len(channel_scales(structure))


def test_noise_of_a_coordinate_is_a_hundredth_of_its_usual_change():
    plain, sensed = one_coordinate(), one_coordinate(2, coordinate={'sensor_scale': 0.07})
    assert [(p.default, p.unit) for p in (plain.noise['check.noise_x'], sensed.noise['check.noise_x'])] == [
        (4e-5, 'm'),
        (7e-4, 'm'),
    ]
    assert plain.noise['check.noise_F'].default == 0.05 and plain.noise['check.noise_T'].default == 1.0
    assert sensed.noise['check.noise_R_2'].default == 0.01 and 'check.noise_F_1' not in sensed.noise  # the module's


def test_what_cannot_be_a_structure():
    for wrong, words in (
        ({'wires': 0}, 'expected 1 to'),
        ({'wires': MAX_WIRES + 1}, 'expected 1 to'),
        ({'antagonistic': True}, 'of 2 wires, got 1'),
        ({'inertia': None}, 'need lengths, forces and inertia'),
        ({'lengths': None}, 'need lengths'),
    ):
        with pytest.raises(ValueError, match=words):
            one_coordinate(**wrong)
    assert one_coordinate(MAX_WIRES).wires == MAX_WIRES
    assert one_coordinate(inertia=None, accelerations=lambda q, v, f, p: f.x).accelerations


def test_springs_of_their_own():
    """Those that hold nothing else and are held by nothing else."""

    def stiffness(q, p, part):
        return part * (2.0 * q.a + q.b), part * (q.a + 3.0 * q.b + 0.7), part * 4.0 * q.c, 0.0

    coordinates = tuple(Coordinate(name, 'm', 0.01, joint=name != 'c') for name in 'abcd')
    held = Structure(
        'held',
        'springs',
        coordinates,
        1,
        lengths=lambda q, p: 0.1 - q.a,
        stiffness=stiffness,
        forces=lambda q, v, p: tuple(-x for x in stiffness(q, p, 1.0)),
        inertia=lambda p: (1.0,) * 4,
    )
    assert held.sprung == (2,) and one_coordinate().sprung == ()
    assert acting_coordinates(('spring',), held) == () and acting_coordinates(('joint',), held) == (0, 1, 3)
    assert acting_coordinates(('coordinate',), held) == (0, 1, 2, 3)
    assert MODULE.sprung == (0,) and FOUND['lever'].sprung == (0,)


def test_segments_in_series_repeat_what_one_is():
    part = one_coordinate(
        coordinate={'motion': 'stroke', 'force': 'push', 'description': 'of it'}, stiffness=lambda q, p, part: part * q.x
    )
    three = in_series(part, 3, 'piece', name='three', accelerations=lambda k, q, v, f, p: f[k, 0])
    assert three.coordinate_names == ('x_1', 'x_2', 'x_3') and three.segments == three.wires == 3
    last = three.coordinates[2]
    assert (last.motion, last.force, last.description) == ('stroke_3', 'push (piece 3)', 'of it (piece 3)')
    q = record('Pose', three.coordinate_names)(0.01, 0.02, 0.03)
    assert three.lengths(q, None) == pytest.approx((0.09, 0.08, 0.07)) and three.forces(q, q, None) == (-0.01, -0.02, -0.03)
    assert three.stiffness(q, None, 0.5) == (0.005, 0.01, 0.015) and three.title == 'spring'


@pytest.mark.parametrize('name', ['lever', 'slider', 'spatial', 'slider_2', 'module', 'coil'])
def test_the_pull_of_bundles_is_their_sections_times_the_longest_arm(name):
    """n pi r0^2 |dl/dq| at rest [N/Pa], of a coil n Om deps/dl |dl/dq|, by which forces of effects are converted."""
    structure = FOUND['slider'].of_size(2) if name == 'slider_2' else FOUND[name]
    values = structure.default_values
    section = values['wire.n'] * math.pi * values['wire.r0'] ** 2
    p, n = structure.default_constants, len(structure.coordinates)
    slopes = np.array(numbers(structure.gradients(record('Pose', structure.coordinate_names)(*[0.0] * n), p)))
    arms = np.abs(slopes.reshape(structure.wires, n)).max(axis=0)
    lengths = numbers(structure.lengths(record('Pose', structure.coordinate_names)(*[0.0] * n), p))
    arms *= structure.strains(lengths[:1], values)[0][1]
    for j in range(n):
        if arms[j] > 1e-9:
            assert pull_of(structure, j, values) == pytest.approx(section * arms[j], rel=1e-3)


def test_parameters_of_effects_keep_their_size_beside_the_pull_and_the_usual_change():
    lever, slider = FOUND['lever'], FOUND['slider']
    values = lever.default_values
    ratio = size_of(lever, 0, values) / 0.15
    for quantity, unit, factor, expected in (
        ('change', 'rad', ratio, 'rad'),
        ('rate', 'rad/s', ratio, 'rad/s'),
        ('1/change^2', '1/rad^2', ratio**-2, '1/rad^2'),
        ('force', 'N m', pull_of(lever, 0, values) / pull_of(MODULE, 2, MODULE.default_values), 'N m'),
        ('', 's', 1.0, 's'),
    ):
        given = Parameter('k', 3.0, unit, (0.0, 50.0), '', neutral=0.0, realistic=(1.0, 7.0), quantity=quantity)
        found = converted(given, lever, 0, values)
        scale = rounded if quantity else float
        assert (found.default, found.unit, found.neutral) == (scale(3.0 * factor), expected, 0.0)
        assert found.bounds == (0.0, scale(50.0 * factor)) and found.realistic == (scale(factor), scale(7.0 * factor))
    force = converted(
        Parameter('k', 3.0, 'N m s', (0.0, 1.0), '', neutral=0.0, quantity='force'),
        slider,
        0,
        slider.default_values,
    )
    assert force.unit == 'N s' and force.realistic is None
    assert (
        converted(
            Parameter('k', 3.0, '1/rad^2', (0.0, 1.0), '', neutral=0.0, quantity='1/change^2'),
            slider,
            0,
            slider.default_values,
        ).unit
        == '1/m^2'
    )
    assert (rounded(1.2345e-5), rounded(-987.0), rounded(0.0)) == (1.2e-5, -990.0, 0.0)


@pytest.mark.parametrize('name', sorted(EFFECTS))
def test_an_effect_acts_where_it_has_a_meaning(name):
    """Heat where there is a heat balance, forces on coordinates that have what they need, sensors on channels."""
    effect = EFFECTS[name]
    for structure in FOUND.values():
        acts = not effect.systems or bool({structure.family, structure.original} & {*effect.systems})
        acts &= structure.strain is None or not effect.straight
        acts &= structure.wires >= effect.wires
        acts &= not (effect.port in ('actuation', 'wire_heat') and structure.imposed_temperature >= 0)
        if 'stiffness' in effect.needs or 'gravity' in effect.needs:
            need = structure.stiffness if 'stiffness' in effect.needs else structure.gravity
            acts &= need is not None
        if effect.needs:
            acts &= bool(acting_coordinates(effect.needs, structure))
        slots = channel_slots(effect, structure)
        count = sum(slot >= 0 for slot in slots)
        assert [slot for slot in slots if slot >= 0] == list(range(count)) and len(slots) == len(structure.channels)
        assert count == 0 or effect.port == 'sensing'
        if effect.port == 'sensing':
            acts &= count > 0 or effect.clock is not None
            if set(POSE) <= set(effect.channels):
                assert all(slots[k] >= 0 for k in range(len(structure.coordinates)))
        assert acts_on(effect, structure) == acts
        single = effect.tried == 'single wire' and structure.wires == 1
        timed = effect.tried == 'timed' and {drive.name for drive in structure.drives} != {'stress', 'T'}
        assert is_tried(effect, structure) == (acts and (effect.tried == 'everywhere' or single or timed))


def test_states_of_effects_are_there_once_for_each_place():
    lever, wire = FOUND['lever'], FOUND['wire']
    creep, lag, sensed = (EFFECTS[name] for name in ('beam_creep', 'driver_lag', 'sensor_lag'))
    assert len(state_scales(lag, MODULE)) == 2 * len(lag.states) and len(state_scales(lag, wire)) == len(lag.states)
    on_lever = effect_on(EFFECTS['sensor_lag'], lever)
    count = sum(slot >= 0 for slot in channel_slots(on_lever, lever))
    scales = channel_scales(lever)
    assert state_scales(on_lever, lever) == [
        scales[k] * s for k, slot in enumerate(channel_slots(on_lever, lever)) if slot >= 0 for s in sensed.scale
    ]
    assert count >= 1 and states_together(on_lever, lever) == len(sensed.states)
    if creep.needs:
        acting = acting_coordinates(creep.needs, MODULE)
        assert states_together(creep, MODULE) == len(creep.states) * len(acting)
        assert state_scales(creep, MODULE) == [channel_scales(MODULE)[j] * s for j in acting for s in creep.scale]


def test_kernels_are_compiled_for_a_structure_where_they_read_its_coordinates():
    lever = FOUND['lever']
    assert pose_fields(lever) == ('angle', 'dangle')
    assert pose_fields(Structure('s', 's', (Coordinate('T', 'm', 0.1),), 1, **(PLAIN | {'lengths': lambda q, p: 0.1}))) == (
        'T_',
        'dT',
    )
    for name, effect in EFFECTS.items():
        assert own_kernels(effect, MODULE) == bool(effect.needs or any(each.numbers(2) for each in effect.each_bundle))
        if not effect.needs and not effect.by_channel and effect.port == 'wire_heat':
            assert not own_kernels(effect, lever), name
        if effect.by_channel or effect.port == 'structure_force':
            assert own_kernels(effect_on(effect, lever), lever), name
    wire = FOUND['wire']
    state = kernel_types(effect_on(EFFECTS['sensor_bias'], wire), wire).state
    assert {'value', *POSE} <= {*state._fields}  # of a structure without coordinates it is zero


def test_limits_of_joints_bear_what_the_wires_can_pull():
    """n section E_A eps_T on every wire, along dl/dq; of the lever on both sides."""
    lever = FOUND['lever']
    values, w = lever.default_values, wire_constants(lever.default_values)
    force = w.n * w.section * w.E_A * w.eps_T
    (joint, *_) = Sketch(lever, values).tree.joints
    assert joint.motion.effort == pytest.approx(2.0 * values['lever.r'] * force, rel=1e-6)
    assert (joint.motion.lower, joint.motion.upper, joint.motion.velocity) == pytest.approx((-2.0, 2.0, 2.0))
    spatial = FOUND['spatial']
    motions = [joint.motion for joint in Sketch(spatial, spatial.default_values).tree.joints if joint.motion]
    assert all(motion.effort > 0.0 and motion.lower == -motion.upper for motion in motions)
    assert [motion.upper for motion in motions[3:]] == pytest.approx([10.0 * 0.15] * 3)  # of their usual change


def test_the_modules_links_bear_its_plate_and_their_wires():
    values = MODULE.default_values | {'plate.W': 0.02, 'plate.m_H': 0.05, 'beam.L': 0.2}
    b, tree, w = beam_constants(values), beam_links(values), wire_constants(values)
    plate = next(link for link in tree.links if link.name == 'plate')
    assert plate.mass == 0.05 and plate.inertia[2] == pytest.approx(0.02**2 * 0.05 / 12.0)
    assert plate.inertia[0] == pytest.approx(plate.inertia[1] + plate.inertia[2])  # a thin plate
    motions = {joint.motion.coordinate: joint.motion for joint in tree.joints if joint.motion}
    force = w.n * w.section * w.E_A * w.eps_T
    assert [motions[name].effort for name in POSE] == pytest.approx([2.0 * force, 2.0 * force, force * b.W])
    assert [motions[name].damping for name in POSE] == [b.b_x, b.b_y, b.b_alpha]
    assert [motions[name].upper for name in POSE] == pytest.approx([0.02, 0.1, 0.5 * math.pi])
    assert all(motion.lower == -motion.upper == -motion.velocity for motion in motions.values())
    ends = {joint.child: joint.origin for joint in tree.joints if joint.child.startswith('wire')}
    assert ends == {f'wire_{i}{end}': (0.0, y, 0.0) for i, y in ((1, 0.01), (2, -0.01)) for end in ('', '_plate')}
    assert next(joint.origin for joint in tree.joints if joint.child == 'tip_x') == (0.2, 0.0, 0.0)


def test_the_beam_is_that_of_textbooks_whatever_its_size():
    """k_y = 12 E I/L^3 and so on, with I = pi h^4/4; the plate's moment of inertia is m W^2/12."""
    random = np.random.default_rng(11)
    values = {f'beam.{p.name}': p.default * random.uniform(0.5, 2.0) for p in BEAM_PARAMETERS}
    values |= {'plate.W': 0.03, 'plate.m_H': 0.2}
    b, L = beam_constants(values), values['beam.L']
    EI, EA = (values['beam.E'] * math.pi * x for x in (values['beam.h'] ** 4 / 4.0, values['beam.h'] ** 2))
    assert b[4:8] == pytest.approx((EA / L, 12.0 * EI / L**3, 6.0 * EI / L**2, 4.0 * EI / L))
    assert pytest.approx(0.2 * 0.03**2 / 12.0) == b.J_H
    wire = wire_constants(MODULE.default_values)
    assert wire.section == pytest.approx(math.pi * wire.r0**2) and wire.volume == pytest.approx(wire.section * wire.l0)
    assert wire.surface == pytest.approx(2.0 * math.pi * wire.r0 * wire.l0) and wire.d == pytest.approx(
        1 / wire.E_M - 1 / wire.E_A
    )


def test_wires_without_a_drawing_lie_side_by_side():
    for wires in (1, 2, 4):
        structure = one_coordinate(wires)
        sketch = Sketch(structure, structure.default_values)
        lengths = [0.1 + 0.01 * i for i in range(wires)]
        lines = sketch.lines({'x': 0.0}, lengths)
        assert [line[1][0] - line[0][0] for line in lines.wires] == pytest.approx(lengths)
        heights = [line[0][1] for line in lines.wires]
        assert sum(heights) == pytest.approx(0.0) and np.diff(heights) == pytest.approx([-SPACING * 0.1] * (wires - 1))
        ends = [line[-1] for line in lines.wires]
        (joined,) = lines.bodies
        if wires == 1:
            assert np.mean(joined, axis=0) == pytest.approx(ends[0]) and joined[0][1] < ends[0][1] < joined[1][1]
        else:
            assert list(joined) == (ends if wires == 2 else [*ends, ends[0]])


def test_axes_of_coordinates_that_tell_none():
    counts = {'rad': 0, '': 0}
    units = ['m', 'rad', 'm', '-', 'rad', 'rad', 'm', 'rad']
    axes = [axis_of(Coordinate(f'q{k}', unit, 1.0), counts) for k, unit in enumerate(units)]
    assert axes == ['x', 'z', 'y', 'z', 'y', 'x', 'x', 'z']
    assert axis_of(Coordinate('q', 'm', 1.0, axis='y'), counts) == 'y' and counts == {'rad': 4, '': 4}
    x, y = projected([(1.0, 2.0, 0.0), (1.0, 2.0, 10.0)])
    assert (x[0], y[0]) == (1.0, 2.0) and x[1] > x[0] and y[1] > y[0]


def test_a_sensors_effect_in_one_channel_acts_there_alone():
    for name in ('sensor_lag', 'sensor_bias', 'sensor_gain'):
        found = EFFECTS[name]
        for scope in found.scopes:
            slots = channel_slots(found.in_scope(scope), MODULE)
            assert [slot >= 0 for slot in slots] == [channel == scope.channel for channel in MODULE.channels]


@pytest.mark.parametrize('name', sorted(EFFECTS))
def test_wires_share_states_of_heat_that_begin_alike(name):
    effect = EFFECTS[name]
    shared = [scope for scope in effect.scopes if scope.shared]
    assert can_share(effect) == (effect.port == 'wire_heat' and len(effect.states) > 0 and effect.start is None)
    assert bool(shared) == (effect.port == 'wire_heat' and len(effect.states) > 0)
    assert uses_time(effect) == any('t' in fields_read(kernel) for kernel in (effect.kernel, effect.rate))


@pytest.mark.parametrize('name', ['sensor_bias', 'sensor_gain'])
@pytest.mark.parametrize('system', ['module', 'wire', 'spatial', 'lever', 'slider'])
def test_each_channel_has_its_own_parameter(name, system):
    """The source that kernels are compiled from, evaluated for the number by which each channel is known."""
    structure = FOUND[system]
    effect = effect_on(EFFECTS[name], structure)
    text = parameter_of_channel(effect, structure)
    codes = dict(zip(structure.channels, channel_codes(structure), strict=True))
    own = [p.name for p in effect.parameters]
    sensed = [channel for channel in own if channel in codes]
    assert sensed == [c for c, slot in zip(structure.channels, channel_slots(effect, structure), strict=True) if slot >= 0]
    for channel in sensed:
        s_ = [float(codes[channel])] * 30
        assert eval(text, {'p_': [f'of {p}' for p in own], 's_': s_}) == f'of {channel}'


def test_the_state_that_a_driven_kernel_returns_is_counted():
    """One number for one, a tuple for more; on wire_strain the strain alone will do."""
    for port, outputs, may_be_one in (
        ('wire_heat', 2, True),  # the heat, and a heat capacity
        ('transformation_stress', 2, False),
        ('wire_strain', 3, True),
    ):
        for count in (1, 2, 3):
            value = (lambda s, w, p, n=count: (0.5,) * n) if count > 1 else (lambda s, w, p: 0.5)
            effect = Effect('odd', port, 'e', 'a test', (), value, stage='')
            kinds = kernel_types(effect, None)
            one = OneKernel('value', value, outputs_of(effect, kinds), False)
            if count == outputs or (count == 1 and may_be_one):
                assert returns_tuple(effect, one, kinds) == (count > 1)
            else:
                with pytest.raises(EffectError, match=f'returns {count} numbers, port {port} takes'):
                    returns_tuple(effect, one, kinds)
        singular = OneKernel('value', lambda s, w, p: 1.0 / (s.T - s.T), outputs, False)
        assert returns_tuple(effect, singular, kinds) == (outputs > 1 and not may_be_one)


def test_a_wire_moves_to_another_bench_with_what_it_is():
    config = read_config(words=['system=wire', 'wire.E_A=1.3e10'], effects=['natural_convection:k=33'])
    under_load = config.on_bench('wire_under_load')
    assert (under_load.system, under_load.parameters['wire.E_A']) == ('wire_under_load', 1.3e10)
    assert under_load.parameters['bench.lag'] == 1e-4 and under_load.parameters['initial.x_M_1'] == 0.0
    assert under_load.effects[0].values[0] == 33.0 and config.on_bench('wire') is config
    assert under_load.effects[0].effect.structure.name == 'wire_under_load'
    assert (
        config.variant({'effects.natural_convection.m': 1.0 + 1e-7}).on_bench('wire_under_load').effects[0].values[1] > 1.0
    )
    back = under_load.on_bench('wire')
    assert back.parameters['wire.E_A'] == 1.3e10 and math.isnan(back.parameters['initial.x_M_1'])


def test_data_that_name_folders_are_asked_for_only_where_something_is_missing():
    recorded = {'effects.paths': ['/nowhere'], 'effects.active': ['gravity']}
    assert read_config(recorded=recorded).effects[0].effect.name == 'gravity'
    with pytest.raises(UserError, match='the effect strange is needed, but only data name its folder'):
        read_config(recorded=recorded | {'effects.active': ['gravity', 'strange']})
    with pytest.raises(UserError, match='unknown effect strange'):
        read_config(recorded={'effects.active': ['strange']})
    with pytest.raises(UserError, match='the structure odd is needed, but only data name its folder'):
        read_config(recorded={'structures.paths': ['/nowhere'], 'system': 'odd'})


def test_all_segments_of_a_series_are_asked_for_at_first():
    """Behind the drives, the count and the forces of effects: from the first, up to behind the last, twice; then forces."""
    stack = FOUND['stack']
    room = new_effects(stack)
    asked = room[-len(stack.coordinates) - RANGE : -len(stack.coordinates)]
    assert asked.tolist() == [0.0, 3.0, 0.0, 3.0] and np.count_nonzero(room) == 2
    assert not new_effects(MODULE).any() and len(new_effects(MODULE)) < len(room)


def test_what_is_compiled_with_a_function_is_all_that_it_calls():
    found = reachable(integrate)
    assert {integrate, mas_rate, transition_rates, update_flow} <= found
    assert all(function.__module__.startswith('sma_sim.') for function in found)
    assert reachable(transition_rates) == {transition_rates} and reachable(mas_rate) == {mas_rate, transition_rates}
    assert reachable(mas_rate, integrate) == found


def test_a_fault_of_a_declaration_names_the_structure():
    assert fault_of(one_coordinate()) == ''
    assert fault_of(one_coordinate(fitted=('wire.x',))) == (
        "structure 'one': fitted names wire.x, which is no parameter; its own are none"
    )
    for value, said in ((-0.1, '-0.1 N; expected 0 to 2'), (2.1, '2.1 N; expected 0 to 2'), (0.0, ''), (2.0, '')):
        found = fault_of(one_coordinate(parameters=(Parameter('k', value, 'N', (0.0, 2.0), 'a force', source='a test'),)))
        assert found == (f"structure 'one': parameter k: default {said}" if said else '')
