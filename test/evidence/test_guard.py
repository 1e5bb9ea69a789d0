"""The guard: no wire beyond its limits, no more taken away than that needs, zero where nothing is known."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sma_sim import Config, Model, UserError
from sma_sim.evidence.state_estimation.heat_balance import heat_balance
from sma_sim.guard import Counters, Guard
from sma_sim.observer import Estimate, Observer
from sma_sim.solver.columns import sample_columns
from sma_sim.solver.fixed_rate import FixedRateRun
from sma_sim.solver.integrate import PER_WIRE, WIRE_COLUMNS

RATE = 50.0  # [Hz]
T_MAX = 350.0  # [K]


def estimate(T=(320.0, 300.0), x_M=(0.3, 0.5), stress=(1e8, 8e7), strain=(0.04, 0.045), std=(2.0, 0.03, 1e6), time=0.0):
    variances = np.repeat(np.square(std), 2)
    return Estimate(
        time, np.array(T), np.array(x_M), np.array(stress), np.array([3, 3]), np.diag(variances), np.array(strain), 1.0
    )


def guarded(asked, config, known=True, seed=0, factors=None, heated_to=None, driver=None):
    """T and stress of the wires (k, wires), decisions and alpha of a robot whose guard knows its state, or observes it.

    `factors` of its parameters by name. Where it is `heated_to` a temperature [K], both start beside the running robot. Its
    `driver` makes power of a command [W].
    """
    values = {name: factor * config.parameters[name] for name, factor in (factors or {}).items()}
    robot = Model(Config(values, kinetics='mas'))
    where = sample_columns(robot.structure)
    run, guard, random = FixedRateRun(robot, RATE, np.array([0.0, 298.0])), Guard(config), np.random.default_rng(seed)
    while heated_to is not None and run.sample[where.wires][::PER_WIRE].max() < heated_to:
        run.step(np.array([asked[0], 298.0]))
    observer, rows, decisions, J = Observer(config), [], [], 0.0
    for k, wanted in enumerate(asked):
        of_wires = run.sample[where.wires].reshape(-1, PER_WIRE).T
        T, x_M, stress, length = (of_wires[WIRE_COLUMNS.index(name)] for name in ('T', 'x_M', 'sigma', 'length'))
        if known:
            strain = length / robot.wire.l0 - 1.0
            seen = Estimate(k / RATE, T, x_M, stress, np.array([3, 3]), np.zeros((6, 6)), strain, 1.0)
        else:
            noise = [config.parameters[f'check.noise_{name}'] for name in robot.structure.channels[:5]]
            shown = run.sample[where.sensed][:5] + noise * random.standard_normal(5)
            seen = observer.update(k / RATE, J, dict(zip(robot.structure.channels[:5], shown.tolist(), strict=True)))
        decisions.append(guard.limit(wanted, seen, k / RATE))
        (J,) = decisions[-1].J_eq
        observer.update(k / RATE, J)
        rows.append((T.copy(), stress.copy(), run.shown('alpha')))
        run.step(np.array([driver(J) if driver else J, 298.0]))
    T, stress, alpha = (np.array(part) for part in zip(*rows, strict=True))
    return T, stress, decisions, alpha


@pytest.mark.parametrize('known', [True, False])
def test_full_power_stops_below_the_limit_and_stays_near_it(known):
    config = Config({'guard.T_max': T_MAX})
    asked = [0.0] * 25 + [30.0] * 250
    T, _, decisions, _ = guarded(asked, config, known)
    assert T.max() < T_MAX + 0.5
    assert T[-1, 0] > T_MAX - (2.0 if known else 12.0)
    assert decisions[-1].kind == 'temperature' and 0.2 < decisions[-1].scale < 0.6
    assert 'T of wire 1 would be' in decisions[-1].reason and 'guard.T_max 350 K' in decisions[-1].reason


@pytest.mark.parametrize('factor', [0.87, 1.0, 1.15])
@pytest.mark.parametrize('J', [25.0, -12.0])
def test_a_guard_that_starts_beside_a_hot_robot_lets_nothing_burn(J, factor):
    """Full request at T_max - 1 K, from the first moment on, with parameters that are known to 15 %."""
    config = Config({'guard.T_max': T_MAX, 'observer.parameter_std': 0.15})
    off = {'wire.sigma_T': factor, 'wire.lambda': 1.0 / factor, 'wire.sigma_MW0': factor}
    T, _, decisions, _ = guarded([J] * 150, config, known=False, factors=off, heated_to=T_MAX - 1.0)
    assert T_MAX - 1.0 < T[0].max() < T_MAX + 4.0  # what the step before had done
    assert T[1:].max() < max(T[0].max(), T_MAX + 2.0) and T[10:].max() < T_MAX + 2.0
    assert decisions[0].scale < 0.3 and decisions[-1].scale > 0.1  # and it may move again


@pytest.mark.parametrize(
    ('driver', 'scale'), [(lambda J: 1.4 * J, 1.0), (lambda J: J * (1.0 + 0.4 * (J / 25.0) ** 2), 0.87)]
)
def test_nothing_burns_with_a_driver_that_gives_40_percent_more_than_it_is_asked_for(driver, scale):
    """At any command, or at full power; the latter on a robot whose T - T_E is larger than it looks. It was 6 and 12 K."""
    config = Config({'guard.T_max': T_MAX + 10.0, 'observer.parameter_std': 0.15})
    off = {f'wire.{name}': scale for name in ('sigma_T', 'lambda', 'c_V')}
    asked = [0.0] * 25 + ([25.0] * 50 + [0.0] * 25 + [-25.0] * 75) * 2
    T, _, _, _ = guarded(asked, config, known=False, factors=off, driver=driver)
    assert T_MAX < T.max() < T_MAX + 10.0


@pytest.mark.parametrize(('measured', 'above'), [(5, 10.0), (3, 35.0)], ids=['pose and forces', 'pose'])
def test_sensors_that_are_stuck_do_not_let_a_wire_burn_for_long(measured, above):
    """They show a robot at rest under full power: with forces a wire hardly passes the limit, with the pose alone for a
    moment."""
    config = Config({'guard.T_max': 360.0})
    robot, random = Model(config), np.random.default_rng(0)
    rest = FixedRateRun(robot, RATE, np.array([0.0, 298.0])).sample[sample_columns(robot.structure).sensed]
    names = robot.structure.channels[:measured]
    noise = np.array([config.parameters[f'check.noise_{name}'] for name in names])
    observer, guard, J, T, found = Observer(config), Guard(config), 0.0, np.array([298.0]), []
    for k in range(200):
        shown = rest[:measured] + noise * random.standard_normal(measured)
        seen = observer.update(k / RATE, J, dict(zip(names, shown.tolist(), strict=True)))
        (J,) = guard.limit(25.0 if k > 20 else 0.0, seen, k / RATE).J_eq
        observer.update(k / RATE, J)
        T, of_each_watt = heat_balance(robot.wire, T, 298.0, 1.0 / RATE)
        T = T + of_each_watt * J / robot.wire.n
        found.append(T[0])
    assert 320.0 < max(found) < 360.0 + above and max(found[-100:]) < 345.0


def test_no_wire_gets_too_hot_while_the_next_estimate_does_not_come():
    """The heat balance of a wire that does not transform, under commands that are judged anew with the last estimate."""
    w, guard = Model(Config()).wire, Guard(Config({'guard.T_max': T_MAX, 'guard.margin': 0.0}))
    cooling, T, dt, seen, J = w.lambda_ * w.surface, [335.0], 0.002, estimate((335.0, 300.0)), []
    decay = np.exp(-cooling * dt / (w.volume * w.rho * w.c_V))
    for k in range(75):
        J += guard.limit(30.0, seen, k * dt).J_eq
        T.append(T[-1] * decay + (298.0 + J[-1] / (w.n * cooling)) * (1.0 - decay))
    assert T_MAX - 1.5 < max(T) < T_MAX + 0.01 and J[0] > 2.0 * J[-1] > 0.0
    (again,) = guard.limit(30.0, estimate((335.0, 300.0), time=0.15), 0.15).J_eq
    assert again == pytest.approx(J[0])


def test_stress_stops_below_its_limit():
    limit = 1.5e8
    T, stress, decisions, _ = guarded([30.0] * 250, Config({'guard.stress_max': limit, 'guard.T_max': 500.0}))
    assert 0.95 * limit < stress.max() < 1.02 * limit
    assert decisions[-1].kind == 'stress'


def test_safe_commands_pass_as_they_are():
    asked = [0.0, 6.0, -6.0] * 40
    _, _, decisions, _ = guarded(asked, Config({'guard.T_max': 420.0}), known=False)
    assert [decision.J_eq[0] for decision in decisions] == asked
    assert {decision.kind for decision in decisions} == {''}


@settings(max_examples=200, deadline=None)
@given(
    J=st.floats(-100.0, 100.0),
    T=st.tuples(st.floats(290.0, 500.0), st.floats(290.0, 500.0)),
    stress=st.tuples(st.floats(0.0, 8e8), st.floats(0.0, 8e8)),
    std=st.floats(0.0, 40.0),
)
def test_nothing_is_ever_added(J, T, stress, std):
    (allowed,) = (decision := Guard(Config()).limit(J, estimate(T, stress=stress, std=(std, 0.0, 1e6)), 0.0)).J_eq
    assert 0.0 <= decision.scale <= 1.0 and abs(allowed) <= abs(J) and allowed * J >= 0.0
    assert (decision.scale == 1.0) == (decision.kind == '') and bool(decision.reason) == bool(decision.kind)


def test_less_is_asked_for_less_is_taken_away():
    """The part that is let through leads to the limit itself: no smaller part is needed."""
    guard = Guard(Config({'guard.T_max': T_MAX, 'guard.margin': 0.0}))
    (most,) = guard.limit(30.0, estimate((345.0, 300.0)), 0.0).J_eq
    assert guard.limit(0.999 * most, estimate((345.0, 300.0)), 0.0).scale == 1.0
    assert guard.limit(2.0 * most, estimate((345.0, 300.0)), 0.0).J_eq[0] == pytest.approx(most)
    assert guard.limit(-30.0, estimate((345.0, 300.0)), 0.0).scale == 1.0  # the other wire is cold


@pytest.mark.parametrize(
    ('asked', 'seen', 'at', 'kind'),
    [
        (float('nan'), estimate(), 0.0, 'a command that a robot refuses'),
        (float('inf'), estimate(), 0.0, 'a command that a robot refuses'),
        (5.0, None, 0.0, 'no estimate'),
        (5.0, estimate(), 0.5, 'no estimate'),
        (5.0, estimate(T=(float('nan'), 300.0)), 0.0, 'no estimate'),
        (5.0, estimate(strain=(float('nan'), 0.04)), 0.0, 'no estimate'),
        (5.0, estimate(std=(25.0, 0.01, 1e6)), 0.0, 'uncertain estimate'),
        (5.0, estimate(std=(float('nan'), 0.01, 1e6)), 0.0, 'uncertain estimate'),
        (5.0, estimate(std=(2.0, 0.01, float('nan'))), 0.0, 'no estimate'),
        (5.0, estimate(T=(420.0, 300.0)), 0.0, 'temperature'),
        (5.0, estimate(stress=(6e8, 1e8)), 0.0, 'stress'),
        (-5.0, estimate(stress=(6e8, 1e8)), 0.0, ''),
        (5.0, estimate(strain=(0.12, 0.04)), 0.0, 'strain'),
    ],
)
def test_zero_where_nothing_is_known_or_a_limit_is_passed(asked, seen, at, kind):
    guard = Guard(Config())
    decision = guard.limit(asked, seen, at)
    assert decision.kind == kind
    assert decision.J_eq == ((0.0,) if kind else (asked,))
    assert guard.counters.interventions == ({kind: 1} if kind else {})
    guard.limit(asked, seen, at)
    assert sum(guard.counters.interventions.values()) == bool(kind)  # one that lasts is counted once


def of_wires(config, T):
    """An estimate of wires that are all as hot as this [K]."""
    wires = config.structure.wires
    alike = {name: np.full(wires, value) for name, value in (('T', T), ('x_M', 0.5), ('stress', 8e7), ('strain', 0.04))}
    return dataclasses.replace(estimate(), **alike, covariance=np.zeros((3 * wires, 3 * wires)))


@pytest.mark.parametrize('system', ['slider', 'spatial'])
def test_a_command_that_the_robot_refuses_is_zero_and_not_the_one_before(system):
    """A robot keeps its last good command where it refuses one."""
    config = Config(system=system)
    guard, wires = Guard(config), config.structure.wires
    assert guard.limit([5.0] * wires, of_wires(config, 320.0), 0.0).J_eq == (5.0,) * wires
    decision = guard.limit([5.0] * (wires - 1) + [-1.0], of_wires(config, 320.0), 0.01)
    assert decision.J_eq == (0.0,) * wires and decision.kind == 'a command that a robot refuses'
    assert 'expected no negative number' in decision.reason


def test_a_wire_that_is_beyond_a_limit_is_told_whatever_is_commanded():
    guard = Guard(Config({'guard.T_max': T_MAX, 'guard.stress_max': 2e8, 'guard.strain_max': 0.06}))
    assert guard.limit(0.0, estimate(T=(351.0, 300.0)), 0.0).kind == ''  # there is nothing to take away
    assert guard.passed(estimate(T=(351.0, 300.0))) == ['T of wire 1 is 351.0 K, beyond guard.T_max 350 K']
    assert guard.passed(estimate(T=(349.9, 300.0), stress=(1e8, 2.1e8), strain=(0.061, 0.045))) == [
        'stress of wire 2 is 210.0 MPa, beyond guard.stress_max 200 MPa',
        'strain of wire 1 is 6.1 %, beyond guard.strain_max 6 %',
    ]


def test_cycles_are_counted_and_end_the_heating_of_a_worn_wire():
    guard = Guard(Config({'guard.cycles_max': 3.0}))
    assert guard.limit(1.0, estimate(x_M=(np.nan, np.nan), time=-1.0), -1.0).J_eq == (0.0,)  # and no turn to count from
    x = 0.45 + 0.25 * np.sin(np.linspace(0.0, 2.0 * np.pi * 3.0, 600))  # three cycles of wire 1, small ones of wire 2
    small = 0.5 + 0.04 * np.sin(np.linspace(0.0, 60.0, 600))
    for k, pair in enumerate(zip(x, small, strict=True)):
        last = guard.limit(1.0, estimate(x_M=pair, time=k / RATE), k / RATE)
    assert guard.counters.cycles == [3.0, 0.0]
    assert last.kind == 'cycles' and last.J_eq == (0.0,)
    assert guard.limit(-1.0, estimate(time=12.0), 12.0).J_eq == (-1.0,)


def test_counters_survive_a_restart(tmp_path):
    file = tmp_path / 'guard.json'
    guard = Guard(Config(), Counters.read(file, 2))
    guard.limit(5.0, None, 0.0)
    guard.counters.cycles[1] = 7.5
    guard.counters.save(file)
    again = Guard(Config(), Counters.read(file, 2))
    again.limit(5.0, None, 0.0)
    assert again.counters.interventions == {'no estimate': 2} and again.counters.cycles == [0.0, 7.5]
    counts, cycles = ('{}', '{"a": "b"}', '{"a": Infinity}'), ('[1.0]', '[0, 0]', '[0, 0]')
    wrong = [f'{{"interventions": {a}, "cycles": {b}}}' for a, b in zip(counts, cycles, strict=True)]
    for text in ('{', '[]', *wrong):
        file.write_text(text)
        with pytest.raises(UserError, match='guard.counters'):
            Counters.read(file, 2)


def test_a_structure_with_a_command_for_each_wire():
    config = Config({'guard.T_max': T_MAX}, system='spatial')
    wires = config.structure.wires
    cold = estimate()
    seen = dataclasses.replace(
        cold,
        T=np.array([348.0] + [300.0] * (wires - 1)),
        x_M=np.full(wires, 0.5),
        stress=np.full(wires, 8e7),
        strain=np.full(wires, 0.04),
        covariance=np.zeros((3 * wires, 3 * wires)),
    )
    decision = Guard(config).limit([20.0] * wires, seen, 0.0)
    assert decision.kind == 'temperature' and len(set(decision.J_eq)) == 1 and 0.0 < decision.scale < 1.0
    assert Guard(config).limit([0.0, *[20.0] * (wires - 1)], seen, 0.0).scale == 1.0
    with pytest.raises(UserError, match=f'expected {wires} number'):
        Guard(config).limit(20.0, seen, 0.0)
