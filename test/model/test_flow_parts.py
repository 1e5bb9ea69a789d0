"""Whatever evaluates a part of the flow finds what the whole flow has: for one state, for guards, for samples, for a step.

In plain Python at random states, with and without effects on every port.
"""

import numpy as np
import pytest
from scipy.optimize import brentq
from systems import active, evaluate, make_model, random_state

from sma_sim import Config, Model
from sma_sim.model.effects.conversion import effect_on
from sma_sim.model.effects.discovery import ActiveEffect
from sma_sim.model.errors import UserError
from sma_sim.model.layout import O_DX, O_S_A, O_S_M, O_SIGMA, O_STRAIN, O_X, Evaluation, InputPoint, SystemState
from sma_sim.model.material import compliance
from sma_sim.model.structures.discovery import package_structures
from sma_sim.model.system import (
    EVERYTHING,
    PER_WIRE_BITS,
    STRESS_1,
    commanded_heating,
    depends_on,
    guard,
    update_flow,
    update_guards,
)
from sma_sim.solver.columns import sample_columns, sampled_numbers
from sma_sim.solver.effect_table import as_on
from sma_sim.solver.integrate import observe
from sma_sim.solver.model import new_findings
from sma_sim.solver.sampling import needed_for, sample_numbers
from sma_sim.solver.simulate import new_run, new_work
from sma_sim.solver.stepper import TIME_STEP, Segment, flow_at, input_at, linearize_flow

MANY = ('driver_lag', 'natural_convection', 'thermal_crosstalk', 'r_phase_strain', 'smooth_transformation', 'guide_friction')
SETS = {
    'bare': (),
    'heat': ('natural_convection',),
    'strain': ('thermal_expansion',),
    'sensor': ('sensor_lag',),
    'force': ('guide_friction',),
    'many': MANY,
}
CASES = [(s, k, e) for s in ('module', 'wire') for k in ('hybrid', 'mas') for e in SETS]


def model_with(system, kind, effects):
    return make_model(system, kind, [active(name) for name in SETS[effects]])


def states(model, seed=3, count=6):
    random = np.random.default_rng(seed)
    for k in range(count):
        yield random_state(model, random, None if k < 3 else (3, 4, 5)[k % 3])


@pytest.mark.parametrize(('system', 'kind', 'effects'), CASES)
def test_what_does_not_depend_on_a_state_stays(system, kind, effects):
    """After one state has moved, what is said to depend on it makes the evaluation that of the whole flow."""
    model = model_with(system, kind, effects)
    p, random = model.compiled, np.random.default_rng(4)
    for state in states(model, count=4):
        at = SystemState(state.y, state.mode, state.x_frozen)
        point = InputPoint(state.u, state.du)
        for j in range(len(state.y)):
            found = Evaluation(state.dy.copy(), state.obs.copy())
            kept = state.y[j]
            state.y[j] += 1e-3 * model.scales[j] * random.uniform(0.5, 1.0)
            update_flow(0.0, at, point, p, found, depends_on(j, at, p))
            whole = Evaluation(np.zeros_like(state.dy), new_findings(p))
            update_flow(0.0, at, point, p, whole, EVERYTHING)
            state.y[j] = kept
            assert found.dy == pytest.approx(whole.dy, rel=1e-12, abs=0.0, nan_ok=True)


@pytest.mark.parametrize(('system', 'kind', 'effects'), CASES)
def test_guards_are_those_of_the_whole_flow(system, kind, effects):
    model = model_with(system, kind, effects)
    p = model.compiled
    for state in states(model):
        found = Evaluation(np.zeros_like(state.dy), new_findings(p))
        update_guards(0.0, SystemState(state.y, state.mode, state.x_frozen), InputPoint(state.u, state.du), p, found)
        for i in range(p.wires):
            of_mode = {1: (0,), 2: (1,), 3: (0, 1), 4: (2, 4), 5: (3, 5)}[int(state.mode[i])]
            for which in of_mode if not p.mas else (0, 1):
                assert guard(which, i, p, found.obs) == pytest.approx(guard(which, i, p, state.obs), rel=1e-12, abs=1e-300)


def test_guards_are_positive_where_they_are_violated():
    model = make_model()
    p, obs = model.compiled, new_findings(model.compiled)
    obs[1, [O_SIGMA, O_S_A, O_S_M, O_X, O_DX]] = [1.5e8, 1.2e8, 1.1e8, 0.3, -2.0]
    height = p.wire.dsigma
    expected = (0.3e8 / height, -0.4e8 / height, -0.7, -0.3, 2.0, -2.0)
    assert [guard(which, 1, p, obs) for which in range(6)] == pytest.approx(expected)


@pytest.mark.parametrize(('system', 'kind', 'effects'), CASES)
def test_samples_of_some_numbers_are_those_of_whole_rows(system, kind, effects):
    """Each number alone, and channels by twos: only what they show is evaluated."""
    model = model_with(system, kind, effects)
    p, work, where = model.compiled, new_work(model), sample_columns(model.structure)
    everything = sampled_numbers(None, model.structure)
    for state in states(model, count=3):
        segment = Segment(0.0, 1.0, state.u, state.du, False)
        at = SystemState(state.y, state.mode, state.x_frozen)
        row, whole = np.zeros(where.size), np.zeros(len(everything))
        observe(0.0, at, segment, p, work, row)
        sample_numbers(0.0, at, segment, p, work, everything, EVERYTHING, whole)
        assert (whole[: p.channels] == row[where.sensed]).all()
        wires = row[where.wires].reshape(p.wires, -1)
        assert (whole[p.channels : p.channels + 2 * p.wires] == np.concatenate([wires[:, 1], wires[:, 7]])).all()
        for numbers in (*everything[:, None], everything[[0, -1]], everything[[p.channels - 1, 0]]):
            fresh, some = new_work(model), np.zeros(len(numbers))
            sample_numbers(0.0, at, segment, p, fresh, numbers, needed_for(numbers, p), some)
            assert some == pytest.approx(whole[numbers], rel=1e-13, abs=0.0, nan_ok=True)


@pytest.mark.parametrize(('system', 'kind', 'effects'), [case for case in CASES if case[2] in ('bare', 'many')])
def test_a_linearised_flow_is_the_derivative_of_the_whole_one(system, kind, effects):
    """In every state, and in time where the input moves."""
    model = model_with(system, kind, effects)
    p, work = model.compiled, new_work(model)
    for state in states(model, count=3):
        du = state.du + 0.01 * (np.arange(len(state.u)) == 0)
        segment = Segment(2.0, 3.0, state.u, du, True)
        at = SystemState(state.y, state.mode, state.x_frozen)

        def flow(y, t=2.5, at=at, segment=segment):
            found = Evaluation(np.zeros(len(y)), new_findings(p))
            flow_at(t, SystemState(y, at.mode, at.x_frozen), segment, p, new_work(model), found)
            return found.dy

        linearize_flow(2.5, at, segment, p, work, False)
        here = flow(state.y)
        assert work.first.dy == pytest.approx(here, rel=1e-12, abs=0.0)
        for j in range(len(state.y)):
            step = work.increment[j] * (np.arange(len(state.y)) == j)
            column = (flow(state.y + step) - here) / ((state.y + step)[j] - state.y[j])
            assert work.jacobian[:, j] == pytest.approx(column, rel=1e-9, abs=1e-9 * np.abs(column).max() + 1e-300)
        assert work.f_t == pytest.approx((flow(state.y, 2.5 + TIME_STEP) - here) / TIME_STEP, rel=1e-9, abs=1e-12)
        again = new_work(model)
        flow_at(2.5, at, segment, p, again, again.first)
        linearize_flow(2.5, at, segment._replace(moving=False), p, again, True)
        assert (again.jacobian == work.jacobian).all() and not again.f_t.any()
        input_at(2.75, segment, again.u)
        assert again.u == pytest.approx(state.u + 0.75 * du)


@pytest.mark.parametrize('kind', ['hybrid', 'mas'])
def test_a_run_begins_at_rest(kind):
    """Nothing moves, temperatures are those of the air, and extra states are where they stay."""
    model = make_model('module', kind, [active(name) for name in ('driver_lag', 'sensor_lag', 'beam_creep')])
    p, u = model.compiled, np.array([9.0, 305.0])
    run = new_run(model, u, new_work(model))
    still = Evaluation(np.zeros_like(run.state.y), new_findings(p))
    update_flow(0.0, run.state, InputPoint(np.array([0.0, 305.0]), np.zeros(2)), p, still, EVERYTHING)
    rates = np.abs(still.dy / model.scales)
    assert rates[: p.first_T].max() < 1e-6  # MAS wires at sigma_A transform at once, which heats them
    assert (run.state.y[p.first_T : p.first_T + p.wires] == 305.0).all() and np.isin(run.state.mode, (1, 2, 3)).all()
    assert p.mas or rates.max() < 1e-6


@pytest.mark.parametrize('names', [('attachment_compliance', 'r_phase_strain'), ('r_phase_strain', 'attachment_compliance')])
@pytest.mark.parametrize('more', [(), ('thermal_expansion',)])
def test_strains_in_series_carry_one_stress(names, more):
    """Each as its own law has it at the stress that the wire has left, which is solved for by another method."""
    values = {
        'attachment_compliance': {'C': 2e-4},
        'r_phase_strain': {'eps_R': 8e-3, 'T_R': 330.0, 'w': 9.0, 'sigma_R': 5e7},
    }
    model = make_model('wire', 'mas', [active(name, **values.get(name, {})) for name in (*names, *more)])
    p, w = model.compiled, model.compiled.wire
    alone = make_model('wire', 'mas', [active(name) for name in more]) if more else None
    for state in states(model, count=6):
        T, x, eps = state.y[p.first_T], state.y[p.first_x], 0.035 + 0.3 * state.u[0]
        state.u[0] = eps
        found, without = (
            evaluate(one, state.y, state.u, state.du, state.mode, state.x_frozen).obs[0] if one else None
            for one in (model, alone)
        )
        first = 0.0 if without is None else without[O_STRAIN]  # what does not depend on stress
        c, r = 2e-4 * w.section / w.l0, 1.0 / (1.0 + np.exp((T - 330.0) / 9.0))

        def strain(sigma, c=c, r=r, x=x, first=first):
            return first + c * sigma + 8e-3 * (1.0 - x) * r * max(sigma, 0.0) / (max(sigma, 0.0) + 5e7)

        def missed(sigma, eps=eps, x=x, strain=strain):
            return eps - strain(sigma) - w.eps_T * x - sigma * compliance(x, w)

        sigma = brentq(missed, -1e10, 1e10, xtol=1e-4, rtol=1e-14)
        assert found[O_SIGMA] == pytest.approx(sigma, rel=1e-7, abs=10.0)
        assert found[O_STRAIN] == pytest.approx(strain(sigma), rel=1e-7, abs=1e-12)


@pytest.mark.parametrize('system', ['module', 'lever', 'slider', 'spatial', 'wire'])
def test_offsets_by_channel_reach_the_coordinates_in_the_same_unit(system):
    """Of the module's declaration a coordinate in m takes U_y's, one in rad alpha's; a structure's own stay as they are."""
    structure = package_structures()[system]
    given = active('sensor_bias', U_x=1.0, U_y=2.0, alpha=3.0, stress=4.0)
    found = as_on(given, structure)
    if system == 'module':
        assert found.values == given.values
    else:
        units = {c.name: c.unit for c in structure.coordinates} or {'stress': 'Pa'}
        assert [p.name for p in found.effect.parameters] == [*units]
        assert found.values == tuple({'m': 2.0, 'rad': 3.0, 'Pa': 4.0}[unit] for unit in units.values())
        own = ActiveEffect(effect_on(given.effect, structure), tuple(range(len(units))))
        assert as_on(own, structure).values == own.values
    lag, gravity = active('sensor_lag'), active('gravity')
    assert as_on(lag, structure) is lag
    in_space = (0.0,) if system == 'spatial' else ()  # it has one direction more there
    assert as_on(gravity, structure).values == (*gravity.values, *in_space)


def test_forces_of_effects_add_up_as_long_as_there_is_room():
    """For 64 of them on one structure; more are refused."""
    random, found = np.random.default_rng(2), {}
    state = random_state(make_model('module'), random, 3)
    for count in (0, 1, 2, 64):
        model = Model(Config().variant(effects=(active('gravity'),) * count))
        found[count] = evaluate(model, state.y, state.u, state.du, state.mode, state.x_frozen).dy
    one = found[1] - found[0]
    assert np.abs(one[3:6]).max() > 1.0 and not one[:3].any()
    for count in (2, 64):
        assert found[count] - found[0] == pytest.approx(count * one, rel=1e-9, abs=1e-6)
    with pytest.raises(UserError, match='65 effects act on the .*: expected at most 64'):
        new_work(Model(Config().variant(effects=(active('gravity'),) * 65)))


@pytest.mark.parametrize(
    ('effect', 'wires'),
    [
        ('', 'own'),
        ('natural_convection', 'own'),
        ('guide_friction', 'all'),
        ('sensor_lag', 'own'),
        ('thermal_expansion', 'all'),
        ('smooth_transformation', 'all'),
        ('driver_lag', 'own'),
        ('gravity', 'own'),
    ],
)
def test_samples_evaluate_what_they_show(effect, wires):
    """Nothing for a pose or a temperature, the stress of a wire for its force; everything where an effect adds to these."""
    model = make_model('module', 'hybrid', [active(effect)] if effect else [])
    p, known = model.compiled, list(model.structure.channels)
    stress = {0: STRESS_1, 1: STRESS_1 << PER_WIRE_BITS}
    for i in (0, 1):
        force, resistance = known.index(f'F_{i + 1}'), known.index(f'R_{i + 1}')
        assert needed_for(np.array([force]), p) == (stress[i] if wires == 'own' else EVERYTHING)
        assert needed_for(np.array([p.channels + i]), p) == (stress[i] if wires == 'own' else EVERYTHING)
        assert needed_for(np.array([p.channels + 2 + i]), p) == (stress[i] if wires == 'own' else EVERYTHING)
        assert needed_for(np.array([resistance]), p) == (stress[i] if wires == 'own' else EVERYTHING)
    lagging = effect == 'sensor_lag'  # of the pose
    assert needed_for(np.array([known.index('alpha')]), p) == (EVERYTHING if lagging else 0)
    assert needed_for(np.array([known.index('T_1')]), p) == 0
    state, shown = next(states(model)), np.array([known.index('U_y'), known.index('T_2')])
    work, row, still = new_work(model), np.zeros(2), Segment(0.0, 1.0, state.u, state.du, False)
    work.sample.obs[:] = np.nan
    at, needed = SystemState(state.y, state.mode, state.x_frozen), needed_for(shown, p)
    sample_numbers(0.0, at, still, p, work, shown, needed, row)
    assert np.isnan(work.sample.obs).all() == (needed == 0) and row[1] == state.y[p.first_T + 1]
    both = needed_for(np.array([known.index('alpha'), p.channels, p.channels + 1]), p)
    assert both == (EVERYTHING if wires == 'all' or lagging else stress[0] | stress[1])


@pytest.mark.parametrize(
    ('system', 'command', 'heated'),
    [
        ('module', [8.0], [8.0, 0.0]),
        ('module', [-8.0], [0.0, 8.0]),
        ('lever', [-4.0], [0.0, 4.0]),
        ('slider', [6.0], [6.0]),
        ('slider', [-6.0], [0.0]),
        ('spatial', [1.0, -2.0, 3.0], [1.0, 0.0, 3.0]),
        ('stack', [1.0, -2.0, 3.0], [1.0, 0.0, 0.0, 2.0, 3.0, 0.0]),
    ],
)
def test_the_wires_of_a_bundle_share_its_power(system, command, heated):
    """Of an antagonistic pair one is heated, by the sign; no bundle is cooled."""
    model = Model(Config({'wire.n': 4.0}, system))
    assert [commanded_heating(i, np.array([*command, 298.0]), model.compiled) for i in range(model.wires)] == [
        power / 4.0 for power in heated
    ]
