"""One standard test that every effect passes, and what is special to a port."""

import math
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from flows import MODES, Point, active, admitted, called, make_model, neutral
from scipy.integrate import quad

from sma_sim import Effect, Input, Parameter, UserError, find_effects, simulate
from sma_sim.compiler.effect_kernels import native_effect
from sma_sim.model.automaton import TO_AUSTENITE, TO_MARTENSITE
from sma_sim.model.effects.meaning import acting_coordinates, acts_on
from sma_sim.model.effects.ports import CHANNELS, PORT_NAMES, PORT_OUTPUTS, State, call_kernel
from sma_sim.model.layout import O_DX, O_S_A, O_S_M, O_SIGMA, O_X
from sma_sim.model.material import stress
from sma_sim.model.parameters import BeamConstants, WireConstants, beam_constants, wire_constants
from sma_sim.model.program_parameters import DEFAULTS
from sma_sim.model.structures.discovery import package_structures
from sma_sim.model.structures.module import STRUCTURE as MODULE
from sma_sim.model.transformation import offsets

NAMES = sorted(find_effects())


def systems_of(name):
    """Which of the paper's two systems an effect has a meaning in."""
    effect = find_effects()[name]
    return [system for system in ('module', 'wire') if acts_on(effect, package_structures()[system])]


MEANT_FOR = [(name, system) for name in NAMES for system in systems_of(name)]
COMMAND = Input(
    np.array([0.0, 1.0, 8.0, 14.0, 20.0]),
    np.column_stack([[0.0, 12.0, -10.0, 4.0, 0.0], np.full(5, 298.0)]),
    (False, False),
)
PULL = Input(
    np.array([0.0, 4.0, 6.0, 8.0, 10.0]),
    np.array([[0, 0.1, 298], [0.06, 0.4, 298], [0.03, 0, 298], [0.05, 0, 298], [0, 0, 298.0]]),
    (True, False, False),
)
SAMPLES = {'module': np.arange(0.0, 20.0, 0.05), 'wire': np.arange(0.0, 10.0, 0.02)}
PAGE = Path(__file__).resolve().parents[2] / 'docs' / 'reference' / 'effects.md'
# Where an effect shows: wires that run out of martensite, wires that would push.
CONDITIONS = {
    'pretension_mismatch': {'wire__l0': 99e-3},
    **dict.fromkeys(('functional_fatigue', 'r_phase_strain', 'transformation_plasticity'), {'wire__l0': 99e-3}),
    'slack': {'wire__sigma_MW0': 45e6},
    'clamp_slip': {'wire__l0': 99e-3},
}
LIBRARY = {
    'actuation': 'driver_lag driver_deadband driver_saturation power_gain_mismatch power_scale resistance_feedback',
    'wire_heat': 'natural_convection radiation ambient_heating ambient_drift thermal_crosstalk latent_heat_scale '
    'heat_capacity_difference',
    'wire_strain': 'thermal_expansion pretension_mismatch attachment_compliance functional_fatigue '
    'stress_dependent_transformation_strain r_phase_strain transformation_plasticity grip_toe clamp_slip',
    'transformation_stress': 'clausius_clapeyron_mismatch polycrystal smooth_transformation r_phase nucleation_peak '
    'temperature_gradient',
    'wire_force': 'guide_friction slack',
    'structure_force': 'gravity beam_creep beam_nonlinearity joint_friction',
    'sensing': 'sensor_bias sensor_gain sensor_lag sensor_misalignment thermometer_lag sensor_crosstalk sensor_drift '
    'sensor_jump clock_skew',
}
SEEN = {'module': ('alpha_rad', 'U_y_m', 'T_1_K', 'F_2_N'), 'wire': ('stress_Pa', 'T_K')}


def run(system, kind, effects, rtol=1e-5, **parameters):
    model = make_model(system, kind, effects, solver__rtol=rtol, **parameters)
    return simulate(model, COMMAND if system == 'module' else PULL, SAMPLES[system])


def random_input(system, random):
    times = np.concatenate([[0.0], np.cumsum(random.uniform(0.5, 4.0, 8))])
    T_E = random.uniform(290, 310)
    if system == 'module':
        J_eq, linear = random.uniform(-18, 18, 9), bool(random.integers(2))
        return Input(times, np.column_stack([J_eq, np.full(9, T_E)]), (linear, False))
    strain = np.concatenate([[0.03], random.uniform(0.0, 0.07, 8)])
    return Input(times, np.column_stack([strain, random.uniform(0, 1.2, 9), np.full(9, T_E)]), (True, False, False))


def test_library_is_complete():
    for port, names in LIBRARY.items():
        for name in names.split():
            assert find_effects()[name].port == port


@pytest.mark.parametrize('name', NAMES)
def test_declaration(name):
    effect = find_effects()[name]
    assert effect.name == name and effect.equation and effect.source and effect.description
    assert any(p.neutral is not None for p in effect.parameters)
    row = next(line for line in PAGE.read_text().splitlines() if line.startswith(f'| `{name}` |'))
    assert f'| {effect.port} |' in row and row.endswith(f'| {effect.signature} | {", ".join(effect.confused_with)} |')
    assert effect.signature and effect.confused_with and set(effect.systems) <= set(package_structures())
    assert effect.energy or effect.port in ('actuation', 'sensing')
    for p in effect.parameters:
        low, high = p.bounds
        assert p.unit and p.description and low <= p.default <= high
        assert p.neutral is None or low <= p.neutral <= high
        assert p.realistic is not None and low <= p.realistic[0] < p.realistic[1] <= high


@pytest.mark.parametrize('name', NAMES)
def test_what_it_is_confused_with(name):
    """Parameters and effects that exist; of two effects each names the other."""
    for other in find_effects()[name].confused_with:
        assert other == 'delay' or other in DEFAULTS or name in find_effects()[other].confused_with, other


@pytest.mark.parametrize('name', NAMES)
@pytest.mark.parametrize('system', ['module', 'wire'])
@pytest.mark.parametrize('kind', ['hybrid', 'mas'])
def test_neutral_is_the_bare_model_to_rounding(name, system, kind):
    """At random states, in every mode: the same rates of the bare model's states."""
    random = np.random.default_rng(3)
    bare, rich = make_model(system, kind), make_model(system, kind, [neutral(name)])
    for mode in MODES if kind == 'hybrid' else (3,):
        for _ in range(5):
            point = Point(bare, random, mode)
            expected = point.evaluate()[0].copy()
            other = Point(rich, np.random.default_rng(4), mode)
            other.y[len(point.y) :] = 0.0
            other.y[: len(point.y)], other.x[:], other.u[:], other.du[:] = point.y, point.x, point.u, point.du
            shown = other.evaluate()[0][: len(point.y)]
            assert shown == pytest.approx(expected, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize('name', NAMES)
@pytest.mark.parametrize('system', ['module', 'wire'])
@pytest.mark.parametrize('kind', ['hybrid', 'mas'])
def test_runs_in_every_system_and_changes_it(name, system, kind):
    where = CONDITIONS.get(name, {})
    bare, still, rich = (run(system, kind, effects, **where) for effects in ([], [neutral(name)], [active(name)]))
    assert rich.completed and rich.chattering == 0
    changed = []
    for column, tolerance in zip(SEEN[system], (2e-5, 2e-7, 5e-3, 2e-2) if system == 'module' else (1e5, 5e-3), strict=True):
        assert np.isfinite(rich[column]).all()
        assert still[column] == pytest.approx(bare[column], abs=tolerance)
        changed.append(np.abs(rich[column] - bare[column]).max() > 3.0 * tolerance)
    assert any(changed) == (system in systems_of(name))


@pytest.mark.parametrize(('name', 'system'), MEANT_FOR)
@pytest.mark.parametrize('kind', ['hybrid', 'mas'])
def test_random_commands_at_both_ends_of_the_realistic_range(name, system, kind):
    effect = find_effects()[name]
    for seed in range(4):
        random = np.random.default_rng(seed)
        source = random_input(system, random)
        values = [p.realistic[random.integers(2)] for p in effect.parameters]
        model = make_model(system, kind, [active(name, values)], **CONDITIONS.get(name, {}))
        rich = simulate(model, source, np.linspace(0.0, source.times[-1], 200), max_steps=60_000)
        assert rich.completed and rich.chattering == 0, (values, rich.reason)
        assert all(np.isfinite(column).all() for column in rich.columns.values())


@pytest.mark.parametrize('name', NAMES)
def test_native_kernel_is_the_python_one(name):
    effect = find_effects()[name]
    parameters = make_model().config.parameters
    constants = (beam_constants if effect.port == 'structure_force' else wire_constants)(parameters)
    random = np.random.default_rng(5)
    channel = CHANNELS.index('U_y' if 'U_y' in effect.channels else (*effect.channels, 'F_1')[0])
    s = State(*random.uniform(0.1, 0.9, len(State._fields)))._replace(channel=float(channel))
    p = SimpleNamespace(**{q.name: q.default for q in effect.parameters})
    places = len(acting_coordinates(effect.needs, MODULE)) if effect.needs else 1
    memory = random.uniform(0.1, 0.9, (places, max(len(effect.states), 1)))
    named = {name: memory[:, k] if effect.needs else memory[0, k] for k, name in enumerate(effect.states)}
    values = np.array([*(q.default for q in effect.parameters), *effect.scope.mask])
    arrays = [np.array(s), np.array(constants), values, memory, np.zeros(8)]
    native = native_effect(effect)
    counts = (PORT_OUTPUTS[PORT_NAMES.index(effect.port)], memory.size, memory.size)
    for address, role, count in zip(native.addresses, ('kernel', 'rate', 'start'), counts, strict=True):
        if getattr(effect, role) is None:
            assert address == 0
            continue
        call_kernel(address, *(array.ctypes.data for array in arrays))
        expected = np.atleast_1d(called(effect, role, s, constants, p, named))
        assert arrays[-1][:count] == pytest.approx(np.pad(expected, (0, count - len(expected))), rel=1e-12)


STRESS_EFFECTS = [n for n in NAMES if find_effects()[n].port in ('wire_strain', 'transformation_stress')]


@pytest.mark.parametrize('name', STRESS_EFFECTS)
@pytest.mark.parametrize('mode', [TO_MARTENSITE, TO_AUSTENITE])
def test_transforming_wire_stays_on_its_stress(name, mode):
    """sigma = sigma_A (or sigma_M) with what the effect adds; dx_M/dt is the derivative of x_M along the flow."""
    random, h, count = np.random.default_rng(9), 1e-7, 0
    declared = find_effects()[name].parameters
    for upper in (False, True):
        values = [p.realistic[1] if upper and p.neutral is not None else p.default for p in declared]
        model = make_model('wire', 'hybrid', [active(name, values)])
        for _ in range(40):
            point = Point(model, random, mode)
            if not admitted(point):
                continue
            count += 1
            level = O_S_A if mode == TO_MARTENSITE else O_S_M
            assert point.obs[0, O_SIGMA] == pytest.approx(point.obs[0, level], abs=5.0)
            assert point.obs[0, O_S_A] > point.obs[0, O_S_M]
            dx = point.obs[0, O_DX]
            if find_effects()[name].states and (dx > 0.0) != (mode == TO_MARTENSITE):
                continue  # rates of memory are linear in dx_M/dt for the sign that the mode allows
            slope = (point.along(h)[1][0, O_X] - point.along(-h)[1][0, O_X]) / (2 * h)
            assert dx == pytest.approx(slope, rel=1e-4, abs=1e-4)
    assert count > 20


@pytest.mark.parametrize('name', STRESS_EFFECTS)
def test_stress_falls_with_the_fraction(name):
    """d(sigma - sigma_A - s)/dx_M < 0 over the realistic range: x_M is unique in modes 4 and 5."""
    effect = find_effects()[name]
    for end in (0, 1):
        model = make_model('wire', 'hybrid', [active(name, [p.realistic[end] for p in effect.parameters])])
        point = Point(model, np.random.default_rng(1))
        gap = []
        for x in np.linspace(0.0, 1.0, 51):
            strain, s_A, s_M = offsets(0, 320.0, x, point.y, point.p)
            gap.append([stress(0.05 - strain, x, point.p.wire) - s for s in (s_A, s_M)])
        assert (np.diff(gap, axis=0) < 0.0).all()


@pytest.mark.parametrize('name', [name for name in STRESS_EFFECTS if find_effects()[name].gradual])
def test_gradual_transformation_has_no_corner_where_a_phase_ends(name):
    """A step may try fractions a little outside 0 to 1: there strain and stresses go straight on."""
    effect = find_effects()[name]
    given = [
        p.default * (1.0 + 0.15 * k) if p.unit == '-' and p.neutral is None else p.default
        for k, p in enumerate(effect.parameters)
    ]
    model, h = make_model('wire', 'hybrid', [active(name, given)]), 1e-5
    point = Point(model, np.random.default_rng(2))
    slopes = []
    for end in (0.0, 1.0):
        before, at, after = (np.array(offsets(0, 320.0, end + k * h, point.y, point.p)) for k in (-1, 0, 1))
        slopes.append(((at - before) / h, (after - at) / h))
    size = np.abs(slopes).max(axis=(0, 1)) + [1e-4, 1e5, 1e5]
    for below, above in slopes:
        assert (np.abs(above - below) < 0.02 * size).all()


def fatigue():
    """Strain that grows with all transformation so far: memory on the strain port, driven by |dx_M/dt|."""
    return Effect(
        name='fatigue',
        port='wire_strain',
        equation='e = a z, dz/dt = |dx_M/dt|',
        source='a test',
        parameters=(
            Parameter('a', 2e-3, '-', (0.0, 0.1), 'strain per transformation', neutral=0.0, realistic=(1e-5, 1e-2)),
        ),
        states=('z',),
        scale=(1.0,),
        kernel=fatigue_strain,
        rate=fatigue_rate,
        energy='does not enter',
    )


def fatigue_strain(s, w, p, m):
    return p.a * m.z


def fatigue_rate(s, w, p, m):
    return (abs(s.dx),)


@pytest.mark.parametrize('mode', [TO_MARTENSITE, TO_AUSTENITE])
def test_memory_that_grows_with_transformation_enters_its_rate(mode):
    one = active('fatigue', found={'fatigue': fatigue()})
    random, h, count = np.random.default_rng(2), 1e-7, 0
    for _ in range(80):
        point = Point(make_model('wire', 'hybrid', [one]), random, mode)
        dx = point.obs[0, O_DX]
        if not admitted(point) or (dx > 0.0) != (mode == TO_MARTENSITE):
            continue  # the rate of the memory is linear in dx_M/dt for the sign that the mode allows
        count += 1
        slope = (point.along(h)[1][0, O_X] - point.along(-h)[1][0, O_X]) / (2 * h)
        assert dx == pytest.approx(slope, rel=1e-5, abs=1e-5)
    assert count > 10


def test_memory_accumulates_over_a_run():
    one = active('fatigue', found={'fatigue': fatigue()})
    tired, fresh = run('wire', 'hybrid', [one], 1e-7), run('wire', 'hybrid', [], 1e-7)
    travelled = np.abs(np.diff(tired['x_M'])).sum()
    assert travelled > 0.5
    w = make_model('wire').compiled.wire
    strain = np.interp(SAMPLES['wire'][-1], PULL.times, PULL.values[:, 0])
    x, sigma = tired['x_M'][-1], tired['stress_Pa'][-1]
    elastic = sigma * (x / w.E_M + (1 - x) / w.E_A)
    assert strain - w.eps_T * x - elastic == pytest.approx(2e-3 * travelled, rel=1e-2)
    assert np.abs(tired['x_M'] - fresh['x_M']).max() > 0.01


def test_natural_convection_cools_and_gravity_bends():
    hot, cooled = run('module', 'hybrid', []), run('module', 'hybrid', [active('natural_convection')])
    assert cooled['T_1_K'].max() < hot['T_1_K'].max() - 1.0
    heavy = simulate(make_model('module', 'hybrid', [active('gravity')]), COMMAND, np.array([0.0]))
    assert heavy['U_y_m'][0] < -1e-5


def test_sensor_lag_shows_the_past_only():
    truth, shown = run('module', 'hybrid', [], 1e-7), run('module', 'hybrid', [active('sensor_lag', [0.2])], 1e-7)
    assert shown['T_1_K'] == pytest.approx(truth['T_1_K'], abs=1e-2)
    lagging, state = [], truth['alpha_rad'][0]
    fine = simulate(make_model(solver__rtol=1e-7), COMMAND, np.arange(0.0, 19.9, 0.001))['alpha_rad']
    for value in fine:  # the filter's equation, in small steps
        lagging.append(state)
        state += 0.001 / 0.2 * (value - state)
    assert shown['alpha_rad'][:398] == pytest.approx(np.array(lagging[::50]), abs=2e-4)


def heat_taken(lag):
    """Heat [J] that a wire without losses has taken 1 s after 0.2 W were switched on."""
    source = Input(np.array([0.0, 1.0]), np.array([[0.0, 0.2, 298.0], [0.0, 0.2, 298.0]]), (True, False, False))
    model = make_model('wire', 'hybrid', [lag], wire__lambda=0.0, initial__x_M_1=0.0, solver__rtol=1e-8)
    end, w = simulate(model, source, np.array([1.0]))['T_K'][0], model.compiled.wire
    return (end - 298.0) * w.volume * (w.rho * w.c_V + 0.5 * (298.0 + end) * w.d * w.sigma_T**2)


def test_driver_lag_is_a_first_order_filter_of_the_heating():
    tau = 0.3
    heat = 0.2 * (1.0 - tau * (1.0 - math.exp(-1.0 / tau)))
    assert heat_taken(active('driver_lag', [tau, 0.0])) == pytest.approx(heat, rel=1e-5)


@pytest.mark.parametrize('tau', [0.0, 0.1])
def test_driver_of_limited_rate_takes_its_time(tau):
    rise = 3.0  # [s/W]
    g = rise / (tau + 0.005 * rise)  # sinh(g (J - P)) decays at the rate g/rise
    lacking = quad(lambda t: math.asinh(math.sinh(0.2 * g) * math.exp(-g * t / rise)) / g, 0.0, 1.0)[0]
    assert heat_taken(active('driver_lag', [tau, rise])) == pytest.approx(0.2 - lacking, rel=1e-5)


def test_driver_of_limited_rate_lags_without_a_limit():
    assert heat_taken(active('driver_lag', [0.3, 1e-4])) == pytest.approx(
        heat_taken(active('driver_lag', [0.3, 0.0])), rel=1e-4
    )


def named(name, **other):
    return Parameter(name, 0.5, 'W', (0.0, 1.0), 'a power', neutral=0.0, **other)


@pytest.mark.parametrize(
    ('change', 'message'),
    [
        ({'port': 'wire_heating'}, 'expected one of actuation, wire_heat'),
        ({'states': ('z',)}, 'states need a rate and one scale each'),
        ({'states': ('z',), 'rate': len, 'scale': (0.0,)}, 'usual changes of the states, more than 0'),
        ({'port': 'sensing'}, 'expected one of misalignment, gain'),
        ({'parameters': (named('lambda'),)}, "parameter 'lambda': a word of Python"),
        ({'parameters': (named('a.b'),)}, "parameter 'a.b': expected a name of letters, digits and _, without a group"),
        ({'parameters': (named('k', realistic=(2.0, 3.0)),)}, 'realistic 2 to 3 W; expected a part of its bounds, 0 to 1'),
        ({'parameters': (named('k', realistic=(0.1, 0.2)),)}, 'default 0.5 W; expected a realistic one, 0.1 to 0.2'),
    ],
)
def test_wrong_declarations_are_refused(change, message):
    words = {'name': 'x', 'port': 'wire_heat', 'equation': '', 'source': '', 'parameters': (), 'kernel': lambda s, w, p: 0.0}
    with pytest.raises((UserError, ValueError), match=message):
        Effect(**(words | change))


def test_ports_and_channels_are_those_of_the_contract():
    wire_ports = ('wire_heat', 'wire_strain', 'transformation_stress', 'wire_force')
    assert ('actuation', *wire_ports, 'structure_force', 'sensing') == PORT_NAMES
    assert CHANNELS == ('U_x', 'U_y', 'alpha', 'F_1', 'F_2', 'T_1', 'T_2', 'stress', 'T')
    assert WireConstants._fields[-5:] == ('section', 'surface', 'volume', 'd', 'area') and 'k_ya' in BeamConstants._fields
