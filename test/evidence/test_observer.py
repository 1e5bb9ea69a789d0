"""The observer: derivatives of its runs, honest intervals, late and missing messages, every structure, the command."""

import csv
import dataclasses

import numpy as np
import pytest

import sma_sim.effects
from sma_sim import Config, Model, UserError, read_dataset
from sma_sim.cli.main import main
from sma_sim.evidence.state_estimation import observer as filters
from sma_sim.observer import Observer
from sma_sim.solver import propagation
from sma_sim.solver.columns import sample_columns
from sma_sim.solver.fixed_rate import FixedRateRun
from sma_sim.solver.integrate import PER_WIRE, WIRE_COLUMNS
from sma_sim.solver.propagation import DELTA, FRACTION_SCALE, Propagation, run_at_rest
from sma_sim.solver.simulate import copy_of_run

RATE = 25.0  # [Hz]
POSE = ('U_x', 'U_y', 'alpha')
FORCES = ('F_1', 'F_2')
OFF = {'wire.lambda': 1.1, 'wire.c_V': 0.9, 'wire.sigma_MW0': 1.08, 'wire.sigma_T': 0.92, 'wire.E_A': 1.1, 'beam.E': 0.92}


def truth_of(config, heating, seconds, seed=0):
    """Samples of a robot at RATE under (J, from when) [W, s]: channels with noise, and T and x_M (k, wires)."""
    model, random = Model(config), np.random.default_rng(seed)
    where, run = sample_columns(model.structure), FixedRateRun(model, RATE, np.array([0.0, 298.0]))
    rows = []
    for k in range(int(seconds * RATE)):
        rows.append(run.sample.copy())
        J = [J for J, since in heating if since <= k / RATE][-1]
        run.step(np.append(np.atleast_1d(J), 298.0))
    rows = np.array(rows)
    noise = [config.parameters[f'check.noise_{name}'] for name in model.structure.channels]
    shown = rows[:, where.sensed] + noise * random.standard_normal((len(rows), len(noise)))
    of_wires = rows[:, where.wires].reshape(len(rows), model.wires, PER_WIRE)
    T, x_M = (of_wires[:, :, WIRE_COLUMNS.index(name)] for name in ('T', 'x_M'))
    return dict(zip(model.structure.channels, shown.T, strict=True)), T, x_M


def observed(config, channels, heating, names, order=None):
    """Estimates at all samples, told in an order."""
    one, found = Observer(config), []
    for k in order if order is not None else range(len(channels['alpha'])):
        J = [J for J, since in heating if since <= k / RATE][-1]
        found.append(one.update(k / RATE, J, {name: channels[name][k] for name in names}))
    return one, found


@pytest.fixture(scope='module')
def robot():
    """A robot that differs from the model: what it shows, T and x_M."""
    nominal = Config().parameters
    true = Config({name: factor * nominal[name] for name, factor in OFF.items()}, kinetics='mas')
    return truth_of(true, HEATING, 20.0)


HEATING = ((0.0, 0.0), (11.0, 1.0), (3.0, 7.0), (-9.0, 11.0), (0.0, 17.0))


HISTORIES = (  # heating, and when an observer starts [s]
    (((9.0, 0.0),), 9.0),
    (((13.0, 0.0), (-10.0, 4.0)), 6.5),
    (((-8.0, 0.0), (9.0, 5.0)), 5.6),
    (((11.0, 0.0), (0.0, 5.0), (6.0, 7.5)), 5.1),
)


def test_no_wire_is_colder_than_its_surroundings_leave_it():
    """Beside a robot whose bundles are exchanged, which moves against its commands: transforming takes 25 K at most."""
    heating = ((0.0, 0.0), (19.0, 0.4), (-19.0, 1.9), (19.0, 3.4))
    channels, _, _ = truth_of(Config(), heating, 4.4)
    told = tuple((-J, since) for J, since in heating)
    observer, found = observed(Config(), channels, told, POSE)
    assert min(one.T.min() for one in found) > 298.0 - 25.0
    assert max(one.T_std.max() for one in found[-25:]) > 20.0  # which a guard does not heat
    p, state = observer.state.model.compiled, observer.state.run.state
    assert state.y[p.first_T : p.first_T + p.wires].min() > 298.0 - 25.0


def test_a_wire_follows_surroundings_that_get_warmer():
    observer = Observer(Config())
    found = [observer.update(k / RATE, 0.0, dict.fromkeys(POSE, 0.0), 298.0 if k < 50 else 318.0) for k in range(55)]
    assert abs(found[50].T - 298.0).max() < 3.0 and found[-1].T.max() < 313.0


def observed_from(begin, config, channels, heating, names):
    """Estimates of an observer that starts beside a running robot, at all samples from `begin` [s] on."""
    one, found = Observer(config), []
    for k in range(int(begin * RATE), len(next(iter(channels.values())))):
        J = [J for J, since in heating if since <= k / RATE][-1]
        found.append(one.update(k / RATE, J, {name: channels[name][k] for name in names}))
    return found


@pytest.mark.parametrize('kinetics', ['hybrid', 'mas'])
@pytest.mark.parametrize('names', [POSE, POSE + FORCES])
def test_a_robot_that_is_hot_at_the_start_is_known_within_two_seconds(kinetics, names):
    """Robots whose parameters are all off, each way; intervals hold from the first sample on."""
    nominal, errors, stds = Config(kinetics=kinetics), [], []
    for seed, (heating, begin) in enumerate(HISTORIES):
        way = 1.0 if seed % 2 else -1.0
        true = Config({name: nominal.parameters[name] * factor**way for name, factor in OFF.items()}, kinetics='mas')
        channels, T, _ = truth_of(true, heating, begin + 4.0, seed)
        found = observed_from(begin, nominal, channels, heating, names)
        assert T[len(T) - len(found)].max() > 315.0
        errors.append([e.T - t for e, t in zip(found, T[len(T) - len(found) :], strict=True)][:100])
        stds.append([e.T_std for e in found][:100])
        assert 'F_1' in names or stds[-1][0].max() > nominal.parameters['guard.T_std_max']  # nothing is heated
    error, within = np.array(errors), np.abs(errors) < 1.96 * np.array(stds)
    assert np.sqrt(np.mean(error[:, 50:] ** 2)) < 3.0
    assert within[:, 0].mean() > 0.8 and within[:, 1:50].mean() > 0.9 and within[:, 50:].mean() > 0.9


def test_a_hot_wire_is_not_taken_for_a_cold_one_where_the_pose_is_that_of_rest():
    """Where a robot passes its pose of rest, the first sample tells nothing, and those after it do."""
    config, heating = Config(), ((-5.0, 0.0), (6.0, 5.0))
    channels, T, _ = truth_of(config, heating, 12.0)
    begin = next(k for k in range(int(5.0 * RATE), len(T)) if channels['alpha'][k] > -5e-4)
    assert abs(channels['alpha'][begin]) < 2e-3 and T[begin, 0] > 310.0
    found = observed_from(begin / RATE, config, channels, heating, POSE)
    assert found[0].T_std[0] > 5.0
    for e, true in zip(found, T[begin:], strict=True):
        assert abs(e.T[0] - true[0]) < 3.0 * e.T_std[0]
    assert abs(found[int(RATE)].T[0] - T[begin + int(RATE), 0]) < 3.0


def test_pure_austenite_may_be_hotter_than_where_it_transforms():
    """The force of such a wire says nothing of its temperature, which only the heating tells, after a second."""
    config, heating = Config(system='slider'), ((0.9, 0.0),)
    channels, T, x_M = truth_of(config, heating, 8.0)
    begin = int(5.0 * RATE)
    assert x_M[begin, 0] < 1e-3 and T[begin, 0] > 330.0
    found = observed_from(5.0, config, channels, heating, ('position', 'F'))
    assert found[0].T_std[0] > 50.0
    assert abs(found[-1].T[0] - T[-1, 0]) < 2.0 and found[-1].T_std[0] < 0.3 * (T[-1, 0] - 298.0)  # as power is known


@pytest.mark.parametrize('names', [POSE, POSE + FORCES])
def test_a_robot_at_rest_is_known_to_be_cold_at_once(robot, names):
    channels, _, _ = robot
    first = observed_from(0.0, Config(), channels, HEATING, names)[0]
    assert np.abs(first.T - 298.0).max() < 1.0 and first.T_std.max() < (1.5 if 'F_1' in names else 10.0)


@pytest.mark.parametrize('kinetics', ['hybrid', 'mas'])
def test_the_derivatives_of_a_run_are_those_of_runs_beside_it(kinetics, monkeypatch):
    """Over transformations, their beginnings and ends, in states, fractions, a parameter, power and T_E; exact runs."""
    monkeypatch.setattr(propagation, 'TOLERANCE', 1e-7)
    monkeypatch.setattr(propagation, 'POSE_TOLERANCE', 1e-7)
    config = Config(kinetics=kinetics)
    moved = Model(config.variant({'wire.E_A': config.parameters['wire.E_A'] * (1.0 + DELTA)}))
    one = Propagation(Model(config), [moved])
    run = run_at_rest(one.model, 298.0)
    one.advance(run, np.array([0.0, 1.0]), np.array([[9.0, 0.0, 298.0]]))
    times, inputs = np.array([1.0, 1.3, 1.6]), np.array([[1.0, 6.0, 298.0], [7.0, 2.0, 298.0]])
    step, at = 1e-3, one.unknowns

    def ended(change=None, factor=1.0, T_E=0.0, by=one):
        beside = copy_of_run(one.model, run)
        if change is not None:
            change(beside.state)
        by.advance(beside, times, inputs * [factor, 1.0, 1.0] + [0.0, 0.0, T_E])
        return np.append(beside.state.y / one.scales, beside.state.x_frozen / FRACTION_SCALE)

    def between(make):
        """The central difference of what `make` gives for a change."""
        return (make(step) - make(-step)) / (2.0 * step)

    def shifted(name, j, unit):
        def change(amount):
            def move(state):
                getattr(state, name)[j] += amount * unit

            return ended(move)

        return change

    def stiffer(amount):
        values = {'wire.E_A': config.parameters['wire.E_A'] * (1.0 + amount)}
        return ended(by=Propagation(Model(config.variant(values)), []))

    end = copy_of_run(one.model, run)
    found = one.advance(end, times, inputs)
    changes = {j: shifted('y', j, one.scales[j]) for j in (1, 2, *range(6, at.states.stop))} | {
        at.parameters.start: stiffer,
        at.heating.start: lambda amount: ended(factor=1.0 + amount),
        at.T_E: lambda amount: ended(T_E=amount),
    }
    if kinetics == 'hybrid':
        changes[at.fractions.start + 1] = shifted('x_frozen', 1, FRACTION_SCALE)
    smooth = [1, 2, 6, 7, *range(8, at.states.stop)]  # what does not vibrate
    for j, make in changes.items():
        difference = between(make)
        size = max(np.abs(difference[smooth]).max(), 0.05)
        assert np.abs(difference[smooth] - found[smooth, j]).max() < 0.05 * size, j


@pytest.mark.parametrize('kinetics', ['hybrid', 'mas'])
def test_forces_and_pose_tell_the_temperature(robot, kinetics):
    channels, T, x_M = robot
    config = Config(kinetics=kinetics)
    one, found = observed(config, channels, HEATING, (*POSE, *FORCES))
    error = np.array([e.T for e in found]) - T
    alone = np.array([e.T for e in observed(config, channels, HEATING, ())[1]]) - T
    assert np.sqrt(np.mean(error**2)) < min(2.0, 0.6 * np.sqrt(np.mean(alone**2)))
    assert np.mean(np.abs(error) < 1.96 * np.array([e.T_std for e in found])) > 0.9
    assert np.abs(np.array([e.x_M for e in found]) - x_M).max() < 0.06
    assert 0.2 < found[-1].inconsistency < 3.0 and one.restarts == 0
    value, std = one.parameters['wire.sigma_MW0']
    assert abs(value / config.parameters['wire.sigma_MW0'] - 1.08) < 2.0 * std / value < 0.1


def test_the_pose_alone_does_so_less_well(robot):
    channels, T, _ = robot
    found = observed(Config(), channels, HEATING, POSE)[1]
    error = np.array([e.T for e in found]) - T
    assert np.sqrt(np.mean(error**2)) < 4.0
    assert np.mean(np.abs(error) < 1.96 * np.array([e.T_std for e in found])) > 0.9


def test_nothing_is_learned_of_what_no_measurement_tells(robot):
    """The transformation strain acts on pose and forces as a scale of x_M does: a filter that is sure of it is wrong."""
    channels, _, _ = robot
    one, found = observed(Config(), channels, HEATING, (*POSE, *FORCES))
    value, std = one.parameters['wire.eps_T']
    assert std / value > 0.08
    assert found[-1].x_M_std.min() > 0.03


def test_the_scale_of_temperatures_stays_as_uncertain_as_the_parameters_that_have_it():
    """sigma_T, c_V and lambda that are all off by the same factor: neither forces nor heating tell, however often the filter
    linearises anew; what it says of T - T_E is what is known of that factor."""
    nominal, heating = Config().parameters, ((0.0, 0.0), (8.0, 0.5))
    true = Config({f'wire.{name}': 1.15 * nominal[f'wire.{name}'] for name in ('sigma_T', 'c_V', 'lambda')}, kinetics='mas')
    channels, T, _ = truth_of(true, heating, 9.0)
    _, found = observed(Config({'observer.parameter_std': 0.15}), channels, heating, (*POSE, *FORCES))
    for k in range(int(1.5 * RATE), len(T)):
        assert found[k].T_std[0] > 0.9 * 0.15 / np.sqrt(3.0) * (found[k].T[0] - 298.0)
        assert abs(found[k].T[0] - T[k, 0]) < 2.0 * found[k].T_std[0]


def test_a_new_run_begins_where_measured_forces_say():
    """Where a run began, forces were 10 times their noise beside the estimate, in robots whose dsigma is off: a filter took
    it for information about the scale of temperatures."""
    nominal, heating = Config().parameters, ((0.0, 0.0), (8.0, 0.5))
    factors = {'wire.sigma_MW0': 1.15, 'wire.dsigma': 0.85}
    channels, _, _ = truth_of(Config({n: f * nominal[n] for n, f in factors.items()}, kinetics='mas'), heating, 2.0)
    one, _ = observed(Config({'observer.parameter_std': 0.15}), channels, heating, (*POSE, *FORCES))
    at = one._shown[one._forces]
    for belief in one._beliefs[-1]:
        before, after = (one._seen(each)[0][at] for each in (belief, one._run_anew(belief)))
        assert np.abs(after - before).max() < 0.2 * nominal['check.noise_F_1']


def test_the_scale_of_stresses_stays_as_uncertain_as_the_parameters_that_have_it(robot):
    """Without forces nothing tells a factor of sigma_MW0, sigma_T, dsigma and the stiffness of the beam."""
    one, found = observed(Config(), robot[0], HEATING, POSE)
    for k in range(int(2.0 * RATE), len(found), 5):
        assert (found[k].stress_std > 0.1 / np.sqrt(4.0) * found[k].stress).all()
    value, std = one.parameters['beam.E']
    assert std > 0.1 / np.sqrt(4.0) * value


def test_a_supply_that_gives_way_is_not_taken_for_hotter_wires():
    """Full power that is 14 W and not 25 W, in bursts: the observer took the wires to have more heat capacity and a smaller
    sigma_T, and was 9 K off, of 50 K above the room; the innovations tell that power fluctuates."""
    bursts = [(J, since) for k in range(6) for J, since in ((25.0, 0.5 + k), (8.0, 0.8 + k))]
    heating = ((0.0, 0.0), *bursts, (8.0, 6.5))
    true = Config(kinetics='mas', effects=[sma_sim.effects.driver_saturation(r=0.6, p=2.0)])
    channels, T, _ = truth_of(true, heating, 9.5)
    found = observed(Config(), channels, heating, (*POSE, *FORCES))[1]
    error = np.array([e.T for e in found]) - T
    assert np.sqrt(np.mean(error**2)) < 7.5 and abs(error[-1, 0]) < 5.0


def beside(nominal, factors):
    """T and x_M of a robot whose parameters have other factors, and the largest RMSE of a channel beside it over noise."""
    config = Config({name: factor * nominal.parameters[name] for name, factor in factors.items()} | {'wire.T0': 298.0})
    (shown, *states), (usual, _, _) = (truth_of(one, HEATING, 12.0) for one in (config, nominal))
    noise = {name: nominal.parameters[f'check.noise_{name}'] for name in ('alpha', *FORCES)}
    return states, max(np.sqrt(np.mean((shown[name] - usual[name]) ** 2)) / std for name, std in noise.items())


def test_pose_and_forces_do_not_tell_the_scale_of_temperatures():
    """But for the latent heat, a robot whose sigma_T, c_V and lambda are all larger looks the same; not with one of them."""
    nominal, s = Config({'wire.T0': 298.0}), 1.1
    (T, _), difference = beside(nominal, {'wire.sigma_T': s, 'wire.c_V': s, 'wire.lambda': s})
    usual = truth_of(nominal, HEATING, 12.0)[1]
    assert np.allclose((T[-10:, 1] - 298.0) / (usual[-10:, 1] - 298.0), 1.0 / s, rtol=0.03)
    for name in ('sigma_T', 'c_V', 'lambda'):
        assert beside(nominal, {f'wire.{name}': s})[1] > 3.0 * difference


def test_pose_and_forces_do_not_tell_the_scale_of_fractions():
    nominal, s = Config({'wire.T0': 298.0}), 1.1
    E_A, E_M = (nominal.parameters[f'wire.{name}'] for name in ('E_A', 'E_M'))
    softer = 1.0 / (E_M / E_A + s * (1.0 - E_M / E_A))  # with which 1/E_M - 1/E_A is s times as large
    (_, x_M), difference = beside(nominal, {'wire.eps_T': s, 'wire.E_M': softer})
    assert difference < 1.0
    assert np.allclose(x_M / truth_of(nominal, HEATING, 12.0)[2], 1.0 / s, rtol=0.01)


@pytest.mark.parametrize('by_dsigma', [True, False])
def test_an_estimate_that_is_carried_to_where_it_is_stays(by_dsigma):
    one = Observer(Config())
    for k in range(60):
        one.update(k / RATE, 6.0, {'F_1': 16.0 + 0.1 * k})
    size, free = one._size, one._free
    mean, root = np.zeros(size), np.random.default_rng(1).standard_normal((size, size))
    mean[one._temperatures], mean[one._fractions] = 320.0 / one._scales[one._temperatures], 4.0
    mean[one._at.parameters] = 0.5
    told = np.array([True, True])
    coordinates = dataclasses.replace(one._coordinates, by_dsigma=by_dsigma)
    carried = coordinates.mean(mean, mean, 300.0, told)
    covariance = coordinates.covariance(root @ root.T, mean, carried, 300.0, told)
    assert np.allclose(carried, mean, atol=1e-9) and np.allclose(covariance, root @ root.T, atol=1e-6)
    assert [one.name for one in free].count('wire.E_M') == 1


def test_known_parameters_make_narrow_intervals(robot):
    channels, T, _ = robot
    nominal = Config().parameters
    values = {name: factor * nominal[name] for name, factor in OFF.items()}
    stds = {f'wire.{name}': 0.005 * nominal[f'wire.{name}'] for name in ('lambda', 'sigma_MW0', 'sigma_T', 'eps_T', 'c_V')}
    known = observed(Config(values, priors=stds), channels, HEATING, POSE)[1]
    unknown = observed(Config(), channels, HEATING, POSE)[1]
    at = int(6.0 * RATE)
    assert known[at].T_std[0] < 0.6 * unknown[at].T_std[0]
    assert np.sqrt(np.mean((np.array([e.T for e in known]) - T) ** 2)) < 1.5


def test_late_messages_count_as_if_they_were_in_time(robot):
    channels, _, _ = robot
    count = int(4.0 * RATE)
    order = np.arange(count)
    for k in range(3, count - 8, 9):
        order[k : k + 5] = order[k : k + 5][::-1]
    cut = {name: values[:count] for name, values in channels.items()}
    _, in_time = observed(Config(), cut, HEATING, POSE)
    late, _ = observed(Config(), cut, HEATING, POSE, order.tolist())
    assert late.too_late == 0
    assert np.array_equal(late.estimate.mean, in_time[-1].mean)
    assert np.array_equal(late.estimate.covariance, in_time[-1].covariance)


def test_what_is_too_late_is_counted_and_changes_nothing():
    one = Observer(Config())
    for k in range(40):
        one.update(0.05 * k, 5.0, {'alpha': 0.0})
    before = one.estimate.mean
    one.update(0.05 * 39 - 2.0 * filters.WINDOW + 0.1, 0.0, {'alpha': 0.3})
    assert one.too_late == 1 and np.array_equal(one.estimate.mean, before)


def test_what_is_told_without_an_estimate_counts_the_same():
    one, other = Observer(Config()), Observer(Config())
    for k in range(30):
        one.tell(0.04 * k, 8.0, {'F_1': 16.0 + 0.1 * k})
        other.update(0.04 * k, 8.0, {'F_1': 16.0 + 0.1 * k})
    assert np.array_equal(one.estimate.mean, other.estimate.mean) and one.parameters == other.parameters


def test_missing_values_leave_the_prediction(robot):
    channels, T, _ = robot
    one, other = Observer(Config()), Observer(Config())
    for k in range(30):
        one.update(k / RATE, 8.0, {'alpha': np.nan, 'F_1': channels['F_1'][k] if k % 3 == 0 else np.nan})
        other.update(k / RATE, 8.0, {'F_1': channels['F_1'][k]} if k % 3 == 0 else None)
    assert np.array_equal(one.estimate.mean, other.estimate.mean)
    ahead = one.forecast(8.0, [one.time + 0.1, one.time + 0.4])
    assert np.array_equal(one.estimate.mean, other.estimate.mean)  # a forecast changes nothing
    assert np.allclose(ahead[-1].mean, one.predict(one.time + 0.4, 8.0).mean, rtol=1e-3)


@pytest.mark.parametrize(('at', 'until'), [(40, 41), (70, 80)])
def test_an_outlier_moves_little(at, until):
    """Nor does it decide between hypotheses of the start, of which there are two for two seconds."""
    one, other = Observer(Config()), Observer(Config())
    for k in range(until):
        one.update(k / RATE, 6.0, {'F_1': 16.0 + 0.1 * k})
        other.update(k / RATE, 6.0, {'F_1': 16.0 + 0.1 * k if k != at else 1000.0})
    assert np.abs(one.estimate.T - other.estimate.T).max() < 2.0


@pytest.mark.parametrize('system', ['lever', 'slider', 'spatial'])
def test_other_structures(system):
    config = Config(system=system)
    structure = config.structure
    J = tuple(2.0 / (1 + k) for k in range(len(structure.commands)))
    heating = ((tuple(0.0 for _ in J), 0.0), (J, 1.0))
    off = Config({'wire.lambda': 1.1 * config.parameters['wire.lambda']}, system=system, kinetics='mas')
    channels, T, _ = truth_of(off, heating, 8.0)
    one = Observer(config)
    for k in range(len(T)):
        now = heating[k >= RATE][0]
        found = one.update(k / RATE, now, {name: channels[name][k] for name in channels if name[0] not in 'TR'})
    assert found.T.shape == found.modes.shape == (structure.wires,)
    assert (np.abs(found.T - T[-1]) < 3.0 * found.T_std + 1.0).all(), (found.T, T[-1], found.T_std)


@pytest.mark.parametrize(
    ('make', 'words'),
    [
        (lambda: Observer(Config(system='wire')), 'derivatives of its runs are not known'),
        (lambda: Observer(Config()).update(0.0, 1.0, {'alfa': 0.0}), "no channel of system 'module'"),
        (lambda: Observer(Config()).update(0.0, (1.0, 2.0)), 'expected 1 finite number'),
        (lambda: Observer(Config()).update(0.0, float('nan')), 'expected 1 finite number'),
        (lambda: Observer(Config()).update(0.0, 1.0, {'alpha': float('inf')}), 'expected a finite number'),
        (lambda: Observer(Config()).update(float('nan')), 'expected a finite time'),
        (lambda: Observer(Config()).estimate, 'has no measurement yet'),
        (lambda: Observer(Config()).update(0.0, 1.0, {'alpha': None}), 'measurements: expected a mapping from a text to'),
        (
            lambda: Observer(Config()).update(0.0, 1.0, None, 25.0),
            '25 deg C are 298.15 K',
        ),
    ],
)
def test_what_cannot_be_observed_is_said(make, words):
    with pytest.raises(UserError, match=words):
        make()


def test_the_command_writes_estimates_and_a_figure(tmp_path, capsys):
    command = tmp_path / 'command.csv'
    command.write_text('time_s,J_eq_W,T_E_K\n0,0,298\n1,11,298\n6,0,298\n')
    run = tmp_path / 'run.csv'
    assert main(['simulate', '--input', str(command), '--out', str(run), '--rate', '20', '--set', 'wire.lambda=480']) == 0
    noise = [f'--noise={name}={std}' for name, std in (('U_x', 2e-6), ('U_y', 1e-5), ('alpha', 3e-4), ('F_1', 0.05))]
    words = [*noise, '--noise=F_2=0.05', '--without', 'T_1', '--without', 'T_2']
    assert main(['observe', str(run), *words]) == 0
    out = tmp_path / 'run_estimated.csv'
    assert str(out) in capsys.readouterr().out and out.with_suffix('.png').stat().st_size > 10_000
    with out.open() as file, run.open() as truth:
        found, true = list(csv.DictReader(file)), [row for row in csv.DictReader(truth) if row['T_1_K']]
    assert len(found) == len(true)
    expected = [
        'time_s',
        'J_eq_W',
        'T_E_K',
        'T_1_K',
        'T_1_std_K',
        'x_M_1',
        'x_M_1_std',
        'stress_1_Pa',
        'stress_1_std_Pa',
        'mode_1',
    ]
    assert list(found[0])[:10] == expected
    dataset = read_dataset([tmp_path])  # estimates lie beside what was measured, and are no recording
    assert [one.name for one in dataset.recordings] == ['run']
    assert f'{out}: nothing measured in it, left out' in dataset.notes
    with pytest.raises(UserError, match='x_M_1_std says that sma-sim observe estimated'):
        read_dataset([out])
    error = [abs(float(row['T_1_K']) - float(other['T_1_K'])) for row, other in zip(found, true, strict=True)]
    assert max(error) < 6.0
    assert main(['observe', str(run), '--without', 'T_3']) == 2
    assert 'no channel T_3' in capsys.readouterr().err
