"""The cause of a deviation while a robot runs: named, with its instant and probability; none where nothing has changed."""

import json

import numpy as np
import pytest

import sma_sim
from sma_sim.challenge.draw import named_truth
from sma_sim.evidence.monitoring import live_diagnosis
from sma_sim.evidence.monitoring.causes import causes_for
from sma_sim.evidence.monitoring.live_criteria import BIN, SPAN
from sma_sim.evidence.monitoring.live_diagnosis import CHANGE, INSTANTS, LiveDiagnosis
from sma_sim.evidence.monitoring.live_model import ComparedSample, InputChange
from sma_sim.evidence.monitoring.past import Prior, Window, continued, shifted
from sma_sim.evidence.search.prior import UNLISTED
from sma_sim.solver.inputs import Input

NOISE = {'U_x': 2e-6, 'U_y': 2e-5, 'alpha': 3.5e-4}
CONFIG = sma_sim.Config(kinetics='mas')
T_E = CONFIG.parameters['environment.T_E']
SWITCHES = [(0.0, 0.0), (5.0, 8.0), (22.0, -7.0), (45.0, 5.0), (58.0, 0.0), (70.0, -9.0), (85.0, 6.0), (105.0, 0.0)]
ONSET, END, RATE = 60.0, 120.0, 10.0


def cause(name):
    return next(one for one in causes_for(CONFIG) if one.name == name)


def command(begin, end, warmer=0.0):
    """The input from `begin` to `end`, its time beginning anew."""
    before = [value for t, value in SWITCHES if t <= begin][-1]
    rows = [(0.0, before), *((t - begin, value) for t, value in SWITCHES if begin < t < end), (end - begin, 0.0)]
    values = np.column_stack([[value for _, value in rows], np.full(len(rows), T_E + warmer)])
    return Input(np.array([t for t, _ in rows]), values, (False, False))


def shown(*runs):
    columns = CONFIG.structure.channel_columns
    return np.vstack(
        [
            np.column_stack([run[name] if name in run.columns else np.full(len(run.time), np.nan) for name in columns])
            for run in runs
        ]
    )


def followed(name='', amounts=None, seed=0, end=END, off=None, effects=()):
    """A live diagnosis that has heard until `end` of a robot on which a cause, or `effects`, begin at ONSET, and whose model
    is `off`."""
    changed = cause(name) if name else None
    base = sma_sim.Model(CONFIG)
    model = sma_sim.Model(CONFIG.variant(effects=effects) if changed is None else changed.in_config(CONFIG, amounts))
    times = np.arange(0.0, END, 1.0 / RATE)
    early, late = times[times < ONSET], times[times >= ONSET]
    first = sma_sim.simulate(base, command(0.0, ONSET), early)
    state = sma_sim.simulate(base, command(0.0, ONSET), [ONSET]).state
    after = command(ONSET, END, changed.ambient(amounts) if changed else 0.0)
    start = continued(model, base, shifted(state, ONSET), after.values[0])
    truth = shown(first, sma_sim.simulate(model, after, late - ONSET, initial_state=start))
    known = CONFIG.variant({key: factor * CONFIG.parameters[key] for key, factor in (off or {}).items()})
    predicted = shown(sma_sim.simulate(sma_sim.Model(known), command(0.0, END), times))
    channels = CONFIG.structure.channels
    std = np.array([NOISE.get(channel, np.nan) for channel in channels])
    measured = truth + std * np.random.default_rng(seed).standard_normal(truth.shape)
    found = LiveDiagnosis(known, causes_for(known), np.where(np.isnan(std), 1.0, std))
    found.start(10**9, (0.0, T_E))
    before = -1.0
    for k, t in enumerate(times[times < end]):
        changes = [InputChange(round(1e9 * (1.0 + at)), 0, value) for at, value in SWITCHES if before < at <= t]
        found.add(ComparedSample(round(1e9 * (1.0 + t)), changes, measured[k]), predicted[k], True)
        before = t
        if off and t in (30.0, 40.0, 50.0):
            assert not found.evaluate().has_changed
    return found


def test_where_nothing_changes_nothing_is_said():
    found = followed().evaluate()
    assert not found.has_changed and found.since is None and found.findings[0].name == 'nothing'
    assert 'nothing has changed' in str(found) and found.error == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize(
    ('name', 'amounts'),
    [
        ('gravity', {'g_y': -2.0}),
        pytest.param('wire.lambda', {'wire.lambda': 0.1}, marks=pytest.mark.slow),
        pytest.param('joint_friction', {'M_c': 0.005}, marks=pytest.mark.slow),
        pytest.param('sensor_jump', {'alpha': 0.002}, marks=pytest.mark.slow),
        pytest.param('T_E', {'T_E': 3.0}, marks=pytest.mark.slow),
        pytest.param('lost_wires', {'part': 0.1}, marks=pytest.mark.slow),
    ],
)
def test_what_begins_is_named_with_its_instant_and_size(name, amounts):
    found = followed(name, amounts).evaluate()
    best = found.findings[0]
    least = 0.6 if name == 'wire.lambda' else 0.9  # natural convection with a small exponent is nearly that
    assert (best.name, found.has_changed) == (name, True) and best.probability > least
    assert found.is_of_robot == (name != 'T_E')
    assert ONSET - 10.0 <= found.since / 1e9 - 1.0 <= ONSET + 10.0
    assert found.left < 1.15 < found.error
    ((parameter, amount),) = amounts.items()
    if parameter != 'T_E':
        config = cause(name).values(CONFIG, amounts)
        full = next(one for one in config if one.endswith(parameter))
        assert best.values[full] == pytest.approx(config[full], rel=0.2)
    data = json.loads(json.dumps(found.as_data()))
    assert data['causes'][0]['is_listed'] == (name not in ('T_E', 'lost_wires'))
    assert data['changed'] and sum(data['probabilities'].values()) == pytest.approx(1.0)
    assert 'changed since about' in str(found)


def test_rivals_are_fitted_before_they_are_compared():
    """A few seconds of much more cooling look alike whatever cools: none of these causes is ruled out, nor certain."""
    found = followed('wire.lambda', {'wire.lambda': 0.4}, end=80.0).evaluate()
    alike = {one.name: one.probability for one in found.findings if one.name in ('wire.lambda', 'natural_convection')}
    assert found.has_changed and len(alike) == 2 and sum(alike.values()) > 0.5
    assert max(one.probability for one in found.findings) < 0.99
    assert found.left < 1.1 and 'changed since' in str(found)


def test_a_cause_starts_from_the_valley_that_is_deepest():
    """The room gets warmer while the wires cool: the cost has a valley there, and another one at the next command."""
    found = followed('T_E', {'T_E': 1.5}, end=80.0)
    assert found.evaluate().has_changed
    part, fitted = found._leading
    best = next(one for one in fitted if one.cause.name == 'T_E')
    late = found._at(part, best, 0.5 * best.amounts, best.onset + 12.0)
    start = found._from_best_instant(part, late, INSTANTS)
    assert late.cost > best.cost + 50.0 and start.cost < best.cost + 20.0
    assert start.onset == pytest.approx(best.onset, abs=1.5) and start.amounts == pytest.approx(best.amounts, rel=0.2)


def test_the_shape_of_a_law_is_fitted():
    """Other exponents than the one that causes are probed with are convection too, and no other law."""
    found = followed('natural_convection', {'k': 60.0, 'm': 0.1}).evaluate()
    best, true = found.findings[0], cause('natural_convection').values(CONFIG, {'k': 60.0, 'm': 0.1})
    assert best.name == 'natural_convection' and best.probability > 0.9 and found.left < 1.1
    assert best.values['effects.natural_convection.m'] == pytest.approx(true['effects.natural_convection.m'], abs=0.05)


def test_a_change_is_looked_for_further_back_until_it_begins_within(monkeypatch):
    monkeypatch.setattr(live_diagnosis, 'EARLIER', 0.5)
    found = followed('gravity', {'g_y': -2.0}, end=80.0)
    verdict = found.evaluate()
    part, fitted = found._leading
    assert part.window.begin < ONSET < part.window.begin + fitted[0].onset + 2.0
    assert verdict.findings[0].name == 'gravity' and abs(verdict.since / 1e9 - 1.0 - ONSET) < 2.0
    compared, begins = found._compared, []
    monkeypatch.setattr(found, '_compared', lambda *given: (begins.append(given[0].window.begin), compared(*given))[1])
    found.evaluate()
    assert begins == [part.window.begin]  # from there at once


def test_causes_start_from_where_the_last_evaluation_has_left_them_too(monkeypatch):
    found = followed('gravity', {'g_y': -2.0}, end=80.0)
    first = found.evaluate()
    monkeypatch.setattr(found, '_started', lambda *_: [])
    again = found.evaluate()
    assert again.findings[0].name == first.findings[0].name == 'gravity'
    assert again.findings[0].values == pytest.approx(first.findings[0].values, rel=0.01, abs=1e-3)


def test_noise_that_looks_like_a_change_for_a_while_dates_none():
    times, random = BIN * np.arange(400) + 0.5 * BIN, np.random.default_rng(3)
    means = random.standard_normal((400, 2))
    means[:, 0] += np.where(times < 20.0, 0.8 * np.sin(0.4 * times), 0.0) + np.where(times > 60.0, 6.0, 0.0)
    window = Window(0.0, times, means, np.ones_like(means), (0.0,), (), np.zeros((400, 0, 2)))
    nothing = Prior(np.zeros((0, 0)), np.zeros(0))
    assert 0.0 < window.before(20.0).smooth_evidence() < UNLISTED - CHANGE
    assert window.onset(nothing, UNLISTED - CHANGE) == pytest.approx(60.0, abs=1.0)
    assert window.onset(nothing) <= window.onset(nothing, UNLISTED - CHANGE)


OFF = {
    'wire.lambda': 1.04,
    'wire.sigma_T': 0.97,
    'wire.E_A': 1.03,
    'wire.sigma_MW0': 1.02,
    'beam.E': 0.96,
    'wire.eps_T': 1.03,
}


def test_a_model_that_is_some_per_cent_off_is_no_change():
    """Its parameters are told by the first minutes; the check of the channels has left it since."""
    one = followed(off=OFF)
    found = one.evaluate()
    assert not found.has_changed and found.error == pytest.approx(1.0, abs=0.1)
    uncalibrated = one._past.window()
    assert uncalibrated.error > 3.0


@pytest.mark.slow
def test_what_begins_is_named_beside_a_model_that_is_off():
    found = followed('gravity', {'g_y': -2.0}, off=OFF).evaluate()
    assert found.findings[0].name == 'gravity' and found.findings[0].probability > 0.9
    assert found.left < 1.15 and abs(found.since / 1e9 - 1.0 - ONSET) < 10.0


def test_a_change_that_is_in_no_list_is_said_to_be_so():
    """A force sensor's zero wanders as no cause does."""
    found = followed()
    past = found._past
    for number, total in past._sums.items():
        t = number * 0.25
        total[2] += 6.0 * past._counts[number][2] * max(0.0, np.sin(0.7 * max(0.0, t - ONSET)) ** 3)
    verdict = found.evaluate()
    assert verdict.has_changed and verdict.findings[0].name == 'not listed'


@pytest.mark.slow
def test_a_law_of_another_shape_is_named_and_its_shape_fitted():
    """Friction that grows with another function of the speed than the library's."""
    friction = named_truth('joint_friction').active({'M_c': 0.004, 'w_c': 0.0022})
    verdict = followed(effects=friction).evaluate()
    assert verdict.findings[0].name == 'joint_friction' and verdict.left < 1.1 < 0.5 * verdict.error
    assert sum(one.probability for one in verdict.findings) == pytest.approx(1.0)


@pytest.mark.slow
def test_a_command_is_proposed_that_tells_the_leading_causes_apart():
    found = followed('gravity', {'g_y': -2.0})
    assert found.deciding_command((10.0, -10.0)) is None  # nothing was compared yet
    found.evaluate()
    proposed = found.deciding_command((10.0, -10.0))
    assert proposed.between[0] == 'gravity' and proposed.decides and proposed.rows[-1][1] == 0.0
    assert all(abs(value) <= 10.0 for _, value in proposed.rows)
    assert json.loads(json.dumps(proposed.as_data()))['decides']


def test_only_the_last_minutes_are_kept():
    found = followed()
    stamp = round(1e9 * (1.0 + END))
    sample = ComparedSample(stamp, [], np.full(len(found._noise), np.nan))
    for k in range(40):
        later = sample._replace(stamp=stamp + round(1e10 * (k + 1)), measured=np.zeros(len(found._noise)))
        found.add(later, np.zeros(len(found._noise)), True)
        found.evaluate()
    assert found._past.window().end - found._past._begin < SPAN + 20.0
    assert found._past._changes == []


def test_a_start_forgets_and_too_little_says_nothing():
    found = followed()
    found.start(0, (0.0, T_E))
    assert found.evaluate() is None
    assert followed('gravity', {'g_y': -2.0}).evaluate(is_stopped=lambda: True) is None


def test_an_effect_with_states_of_its_own_goes_on_from_the_same_pose():
    """What the robot was before is kept; the states of the effect begin at rest."""
    base, effect = sma_sim.Model(CONFIG), cause('driver_lag')
    model = sma_sim.Model(effect.in_config(CONFIG, {'tau': 0.5}))
    state = sma_sim.simulate(base, command(0.0, 30.0), [30.0]).state
    moved = continued(model, base, state, np.array([0.0, T_E]))
    n = len(state.state.y)
    assert len(moved.state.y) > n and np.array_equal(moved.state.y[:n], state.state.y)
    assert continued(base, base, state, np.array([0.0, T_E])) is state
