"""What a fit makes of recordings: unknowns of each and their order, zeros, inputs, words."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from systems import active

from sma_sim import Config, Dataset, Recording, module_input, predict, wire_input
from sma_sim.evidence.estimation.fit_result import FitResult, OtherStart
from sma_sim.evidence.estimation.free_parameters import (
    BOUND_STDS,
    FreeParameter,
    choose_free,
    default_names,
    under_nuisance_priors,
    with_nuisance_names,
    with_prior_std,
)
from sma_sim.evidence.estimation.held_out_prediction import (
    RunFit,
    nuisances_of,
    point_with,
)
from sma_sim.evidence.estimation.problem import (
    DEFAULT_STEP,
    DELAY,
    START,
    SWITCH,
    Problem,
    differences_apart,
    gathered,
)
from sma_sim.evidence.estimation.recording_differences import AMBIENT_STD, RecordingDifference, with_differences, zeros_of
from sma_sim.evidence.estimation.residuals import (
    MAX_SWITCHES,
    ZERO_LIMIT,
    ZERO_STDS,
    Nuisance,
    baseline,
    compared,
    effective_input,
    fit_data,
    held_until,
    offsets,
    planned_run,
    strain_zero,
)
from sma_sim.evidence.estimation.uncertainty import GAUSS_95, Interval, ambient_differences
from sma_sim.solver.beginning import AT_REST, Beginning
from sma_sim.words.fit_remarks import starts_sentence
from sma_sim.words.nuisances import nuisance_data, nuisance_sentences, offset_sentences

TIMES = np.linspace(2.0, 6.0, 81)


def module_run(name='run', commands=(0.0, 5.0, 5.0, 2.0), **more):
    """Samples from 2 to 6 s beside a command that begins at 2.5 s."""
    random = np.random.default_rng(3)
    source = module_input(2.5 + 1.0 * np.arange(len(commands)), list(commands))
    channels = {'alpha': random.normal(size=81), 'F_1': random.normal(size=81)}
    return fit_data(Recording(name, 'module', TIMES, channels, source, **more), {'alpha': 0.5, 'F_1': 2.0})


def problem_of(count=2, **more):
    free, _ = choose_free(Config(), ['wire.E_A', 'wire.lambda'])
    runs = tuple(module_run(f'run{k}', exact_commands=k % 2 == 0) for k in range(count))
    return Problem(Config(), runs, free, **more)


def test_every_unknown_has_its_place():
    """Shared ones, then each run's: two starts, two switches where the command was sampled, its ambient temperature."""
    problem = problem_of()
    problem = replace(problem, runs=(replace(problem.runs[0], ambient_std=2.0), problem.runs[1]))
    names = [unknown.name for unknown in problem.unknowns]
    assert names == ['wire.E_A', 'wire.lambda', 'delay', 'start', 'start', 'ambient', 'start', 'start', 'switch', 'switch']
    assert [at.tolist() for at in problem.indices()] == [[0, 1, 2, 3, 4, 5], [0, 1, 2, 6, 7, 8, 9]]
    z = np.linspace(-0.5, 0.4, 10)
    first, second = (problem.nuisance(run, z[at]) for run, at in zip(problem.runs, problem.indices(), strict=True))
    assert first.delay == second.delay == DELAY.value(z[2]) == problem.delay_at(z)
    assert first.start == (START.value(z[3]), START.value(z[4])) and first.switches == () and not first.unknown_zero
    assert first.ambient == pytest.approx(2.0 * z[5]) and second.ambient == 0.0
    assert second.start == (START.value(z[6]), START.value(z[7]))
    assert second.switches == (SWITCH.value(z[8]), SWITCH.value(z[9]))
    low, high = problem.limits()
    assert (low[3], high[3], low[5], high[5]) == (-1.0, 1.0, -5.0, 5.0) and problem.samples == 4 * 81
    starts, switches = ([one.value(end) for end in (low[k], high[k])] for k, one in ((3, START), (8, SWITCH)))
    assert starts == [0.0, 1.0] and 0.0 < switches[0] < 1e-3 and 1.0 - 1e-3 < switches[1] < 1.0  # a part of an interval
    assert problem.values(z) == {free.name: free.value(x) for free, x in zip(problem.free, z, strict=False)}
    assert problem.fitted(z).parameters['wire.E_A'] == problem.free[0].value(z[0])
    assert not problem.robust and problem.tempering == 1.0  # plain squares, unless another loss is asked for
    known = replace(problem, delay=0.02)
    assert known.delay_at(z) == 0.02
    assert len(known.unknowns) == 9 and known.shared == problem.free
    assert known.weighted(3.0).runs[0].weight == pytest.approx(3.0 * problem.runs[0].weight)


def test_rooms_are_told_by_their_differences_to_the_first():
    """Whose own is none; what all have in common widens nothing, and of two covariances the larger variance counts."""
    problem = problem_of()
    problem = replace(problem, runs=tuple(replace(run, ambient_std=2.0) for run in problem.runs))
    first, second = (at[-1] for at in problem.indices())
    z, common, own = np.zeros(len(problem.unknowns)), np.zeros((11, 11)), np.zeros((11, 11))
    z[[first, second]] = 0.5, -1.0
    common[np.ix_([first, second], [first, second])] = 9.0
    own[second, second] = 0.25
    assert all(one.value == one.low == one.high == 0.0 for one in [ambient_differences(problem, z, (common, own))['run0']])
    found = ambient_differences(problem, z, (common, own))['run1']
    reach = GAUSS_95 * 2.0 * 0.5
    assert (found.low, found.value, found.high) == pytest.approx((-3.0 - reach, -3.0, -3.0 + reach))
    assert ambient_differences(problem_of(), z, (common, own)) == {}


def test_what_one_run_was_found_to_be_comes_back_as_its_unknowns():
    problem = problem_of()
    run = replace(problem.runs[1], ambient_std=2.0)
    alone = replace(problem, runs=(run,))
    part = np.array([0.0, 0.0, 0.4, 0.1, -0.2, 0.3, -0.4, 0.7])
    found = problem.nuisance(run, part)
    fit = RunFit('run1', found.start, (0.3, 0.6), found.switches, {}, 1.0, ambient=found.ambient, ambient_std=2.0)
    assert point_with(alone, part[:3], (fit,)) == pytest.approx(part)
    warm = replace(problem, runs=(replace(run, beginning_std=Beginning((40.0, 20.0), (0.5,), (2.0,))),))
    own = np.array([*part, 0.5, 1.0, -2.0, 0.5])
    initial = warm.nuisance(warm.runs[0], own)
    assert initial == replace(found, beginning=Beginning((20.0, 20.0), (-1.0,), (1.0,))) and len(warm.unknowns) == len(own)
    moving = replace(fit, beginning=initial.beginning)
    assert point_with(warm, part[:3], (moving,)) == pytest.approx(own)
    assert point_with(warm, part[:3], (fit,)) == pytest.approx([*part, 0.0, 0.0, 0.0, 0.0])  # of a fit at rest
    assert nuisances_of(found.delay, (moving,))['run1'] == initial
    again = nuisances_of(found.delay, (fit, replace(fit, name='still', quasi_static=True)))
    assert again['run1'] == found
    assert again['still'] == replace(found, delay=0.0, unknown_zero=True)
    known = replace(problem, runs=problem.runs[1:2])
    assert point_with(known, part[:3], (replace(fit, ambient_std=0.0),)) == pytest.approx(part[:7])


@pytest.mark.parametrize('kinetics', ['hybrid', 'mas'])
def test_predictions_begin_as_they_are_told(kinetics):
    """Without a start, each wire begins with the fraction that the configuration says, or where cooling leads it."""
    config, run = Config({'initial.x_M_1': 0.8}, kinetics=kinetics), module_run()
    still, warm = (predict(config, run, Nuisance(beginning=one)) for one in (AT_REST, Beginning((30.0, 0.0))))
    assert warm['T_1'][0] == pytest.approx(still['T_1'][0] + 30.0) and warm['F_1'][0] > still['F_1'][0]
    turned = predict(config, run, Nuisance(beginning=Beginning(pose=(0.0, 0.0, 0.02))))
    assert turned['alpha'][0] == pytest.approx(still['alpha'][0] + 0.02)
    hardly = predict(config, run, Nuisance(beginning=Beginning((1e-9, 0.0))))
    assert hardly['F_1'][0] == pytest.approx(still['F_1'][0], rel=1e-6)


def test_samples_before_the_input_show_its_beginning():
    """A sample shows the state a delay earlier; the input may end before the last."""
    run = module_run()
    for delay in (0.0, 0.3, -0.5):
        source, asked, index = planned_run(run, Nuisance(delay=delay))
        shown = asked[index]
        assert shown == pytest.approx(np.maximum(TIMES - delay, 2.5)) and (np.diff(asked) > 0.0).all()
        assert source is run.source
    assert held_until(run.source, 5.5) is run.source
    assert held_until(run.source, 9.0).times.tolist() == [2.5, 3.5, 5.5, 9.0]


@pytest.mark.parametrize('side', [-1, 0, 1])
def test_power_that_is_lost_on_one_side_heats_nothing(side):
    source = module_input([0.0, 1.0, 2.0, 3.0], [4.0, -3.0, 0.0, 2.0], 300.0)
    acted = effective_input(source, side, 1.5)
    assert acted.values[:, 0].tolist() == [0.0 if np.sign(J) == side else J for J in (4.0, -3.0, 0.0, 2.0)]
    assert (acted.values[:, 1] == 301.5).all() and source.values[0].tolist() == [4.0, 300.0]
    assert effective_input(source, 0, 0.0) is source


def test_many_sampled_changes_share_one_fraction():
    few, many = (
        module_run(commands=np.arange(1.0 + count), exact_commands=False) for count in (MAX_SWITCHES, MAX_SWITCHES + 1)
    )
    assert (few.groups, many.groups) == (MAX_SWITCHES, 1) and len(many.changed) == MAX_SWITCHES + 1


def test_offsets_are_least_squares_under_their_priors_and_no_more_than_twice_these():
    """Of each channel a zero and a drift, beside what is shown; missing samples do not count."""
    random, run = np.random.default_rng(4), module_run()
    weight = run.weight.copy()
    weight[0, 20:50] = 0.0
    run = replace(run, weight=weight, zero_std=(0.3, 5.0), drift_std=(0.0, 2.0))
    shown = run.measured + random.normal(size=run.measured.shape) / np.where(run.weight > 0, run.weight, 1.0)
    shown -= np.array([[0.2], [1.0]]) + np.array([[0.0], [1.5]]) * (TIMES - 4.0) / 4.0
    found = offsets(run, shown)
    for k in range(2):
        stds = np.array([run.zero_std[k], run.drift_std[k]])
        shapes = np.column_stack([np.ones(81), (TIMES - 4.0) / 4.0]) * stds
        A = np.vstack([shapes * run.weight[k][:, None], np.eye(2)])
        b = np.append((run.measured - shown)[k] * run.weight[k], [0.0, 0.0])
        assert found[k] == pytest.approx(stds * np.linalg.lstsq(A, b, rcond=None)[0])
    line = found[:, :1] + found[:, 1:] * (TIMES - 4.0) / 4.0
    assert baseline(run, shown) == pytest.approx(line)
    assert compared(run, shown, None) == pytest.approx((shown + line - run.measured) * run.weight)
    far = offsets(run, run.measured - np.array([[100.0], [-1000.0]]))
    assert far[:, 0] == pytest.approx([ZERO_STDS * 0.3, -ZERO_STDS * 5.0])
    plain = replace(run, zero_std=(), drift_std=())
    assert compared(plain, shown, Nuisance()) == pytest.approx((shown - run.measured) * run.weight)


def test_a_gauges_zero_is_the_mean_difference_within_its_limit():
    run = module_run()
    run = replace(run, channels=('strain', 'F_1'), weight=run.weight.copy())
    run.weight[0, :40] = 0.0
    for offset in (0.4e-3, 5e-3, -5e-3):
        shown = run.measured[0] - offset - 1e-4 * np.sin(np.arange(81.0))
        expected = float(np.clip((run.measured[0] - shown)[40:].mean(), -ZERO_LIMIT, ZERO_LIMIT))
        assert strain_zero(run, shown) == pytest.approx(expected)
        both = np.array([shown, run.measured[1] + 2.0])
        residuals = compared(run, both, Nuisance(unknown_zero=True))
        assert residuals[0] == pytest.approx((shown + expected - run.measured[0]) * run.weight[0])
        assert residuals[1] == pytest.approx(1.0)
    assert strain_zero(module_run(), shown) == 0.0


def test_some_unknowns_are_moved_apart_from_tangents():
    """Effects at their lower bounds: upwards, or down from a closed bound."""
    config = Config(effects=(active('natural_convection', k=0.0), active('gravity')))
    free, _ = choose_free(config, ['wire.E_A', 'effects.natural_convection.k', 'effects.gravity.g_y'])
    run = replace(module_run(), ambient_std=3.0)
    problem = Problem(config, (run,), free)
    k = free[1]
    for at in (k.low, k.low + 0.5 * DEFAULT_STEP, k.low + 2.0 * DEFAULT_STEP):
        part = np.array([0.0, at, 0.0, 0.0, 0.0, 0.0, 0.5])
        moved = {j: (step, config.config, nuisance) for j, step, config, nuisance in differences_apart(problem, part, run)}
        assert set(moved) == ({1} if at < k.low + DEFAULT_STEP else set())
        for step, there, nuisance in moved.values():
            assert step == pytest.approx(DEFAULT_STEP) and nuisance.ambient == pytest.approx(1.5)
            assert there.effects[0].values[0] == pytest.approx(k.value(at + DEFAULT_STEP))
    closed = replace(problem, free=(free[0], replace(k, high=k.low + 0.01), free[2]))
    for at, step in ((k.low, 0.01), (k.low + 0.01, -0.01)):
        part = np.array([0.0, at, 0.0, 0.0, 0.0, 0.0, 0.0])
        assert differences_apart(closed, part, run)[0][1] == pytest.approx(step)


def test_dealt_out_points_come_back_in_their_order():
    points = list(range(11))
    for pieces in (1, 2, 4):
        futures = [SimpleNamespace(result=lambda k=k, n=pieces: points[k::n]) for k in range(pieces)]
        assert gathered(futures, 11) == points


@pytest.mark.parametrize('log', [True, False])
def test_a_known_spread_is_the_prior_within_the_bounds_of_the_value(log):
    one = FreeParameter('effects.e.p', 2.0, 0.5, -3.0, 4.0, log, '-')
    for std in (0.01, 0.5, 3.0):
        found = with_prior_std(one, std)
        slope = (found.value(1e-6) - found.value(-1e-6)) / 2e-6
        assert slope == pytest.approx(std) and (found.center, found.name) == (2.0, 'effects.e.p')
        assert -BOUND_STDS <= found.low < 0.0 < found.high <= BOUND_STDS
        for end, bound in ((found.low, one.value(one.low)), (found.high, one.value(one.high))):
            assert abs(end) == BOUND_STDS or found.value(end) == pytest.approx(bound)
    assert with_prior_std(one, 3.0).low > -BOUND_STDS


def test_a_map_decides_which_parameters_of_its_effects_are_fitted():
    dataset = Dataset((), {}, nuisances={'power_scale': {'k': 0.05}, 'sensor_lag': {}})
    config = Config(effects=(active('power_scale'), active('gravity')))
    assert with_nuisance_names(('wire.E_A',), dataset, config) == ('wire.E_A', 'effects.power_scale.k')
    assert with_nuisance_names((), dataset, config) == () and with_nuisance_names(None, dataset, config) is None
    names = ['wire.E_A', 'effects.power_scale.k', 'effects.gravity.g_y', 'effects.sensor_lag.tau']
    free = [FreeParameter(name, 1.0, 0.5, -5.0, 5.0, False, '-') for name in names]
    kept = under_nuisance_priors(free, dataset)
    assert [one.name for one in kept] == names[:3] and [one.scale for one in kept] == [0.5, 0.05, 0.5]


def test_what_belongs_to_the_bench_is_said_for_each_recording():
    runs = (
        RunFit('a', (), (), (), {}, 1.0, zeros={'F_1': 0.125}, drifts={'T_1': 2.0}),
        RunFit('b', (), (), (), {}, 1.0, zeros={'F_1': -0.5}),
    )
    config = Config(effects=(active('power_scale', k=1.1), active('gravity', g_x=1.0, g_y=9.81)))
    known = SimpleNamespace(intervals=(Interval('effects.power_scale.k', 1.1, 0.1, 0.9, 1.3, False, True, '-'),))
    found = SimpleNamespace(runs=runs, config=config, uncertainty=known, delay=0.01)
    assert offset_sentences(found) == [
        'zero of F_1, estimated for each recording [SI]: a 0.125, b -0.5',
        'drift of T_1, estimated for each recording [SI]: a 2',
    ]
    said = nuisance_sentences(found, ('gravity',))
    assert 'power_scale, k 1.1 (0.9 to 1.3)' in said[0] and 'gravity' not in said[0] and len(said) == 3
    assert 'g_y 9.81 m/s^2' in nuisance_sentences(replace_uncertainty(found), ('power_scale',))[0]
    assert nuisance_sentences(found, ('gravity', 'power_scale')) == offset_sentences(found)
    data = nuisance_data(found, ('gravity',))
    assert data == {
        'delay': 0.01,
        'effects': {'power_scale': {'k': 1.1}},
        'zeros': {'a': {'F_1': 0.125}, 'b': {'F_1': -0.5}},
        'drifts': {'a': {'T_1': 2.0}},
    }


def replace_uncertainty(found):
    return SimpleNamespace(**{**vars(found), 'uncertainty': None})


def test_differences_between_recordings_are_those_of_their_runs():
    recording = Recording('x', 'module', TIMES, {'alpha': np.zeros(81)}, module_input([2.0, 6.0], [1.0, 1.0]))
    zero = zeros_of({'alpha': 0.2})
    room, lost = RecordingDifference('room', ambient=True), RecordingDifference('lost', unpowered_side=-1, recordings=('x',))
    (found,) = with_differences(Dataset((recording,), {'alpha': 1.0}), (zero, room, lost)).recordings
    assert (found.zero_std, found.ambient_std, found.unpowered_side) == ({'alpha': 0.2}, AMBIENT_STD, -1)
    run = fit_data(recording, {'alpha': 1.0})
    for difference in (zero, room, lost):
        run = difference.in_run(run)
    again = fit_data(found, {'alpha': 1.0})
    assert (run.zero_std, run.drift_std, run.ambient_std, run.unpowered_side) == ((0.2,), (0.0,), AMBIENT_STD, -1)
    assert (again.zero_std, again.drift_std, again.ambient_std, again.unpowered_side) == ((0.2,), (0.0,), AMBIENT_STD, -1)
    assert (
        lost.in_recording(replace(recording, name='y')).unpowered_side
        == 0
        == lost.in_run(replace(run, name='y', unpowered_side=0)).unpowered_side
    )


def test_findings_are_the_effects_that_were_not_there_from_the_start():
    config = Config(effects=(active('power_scale'), active('gravity', g_x=1.0, g_y=2.0)))
    free, _ = choose_free(config, ['wire.E_A', 'effects.gravity.g_x', 'effects.gravity.g_y'])
    fit = FitResult(Problem(config, (module_run(),), free, nominal_effects=('power_scale',)), np.zeros(6), 1.0)
    assert fit.effects == ('gravity',) and fit.values_of('gravity') == pytest.approx({'g_x': 1.0, 'g_y': 2.0})
    assert fit.values_of('power_scale') == {} and fit.delay == 0.0
    near, far = OtherStart(0.1, {}, True), OtherStart(9.0, {}, False)
    assert starts_sentence(()) == '' and starts_sentence((near, near)) == 'all 3 starting points led to the same minimum'
    assert starts_sentence((near, far)).startswith('2 of 3 starting points')


def test_what_is_fitted_when_nothing_is_asked_for():
    """No lengths; kinetics of MAS; resistivities where one is measured; no heat where the temperature is imposed."""
    hybrid, mas = (set(default_names(Config(kinetics=model))) for model in ('hybrid', 'mas'))
    assert mas - hybrid == {'wire.V_L'} and {'wire.E_A', 'wire.lambda', 'beam.E'} <= hybrid
    assert not hybrid & {'wire.r0', 'beam.L', 'plate.W', 'wire.resistivity_A'}
    with_R = set(default_names(Config(), ('alpha', 'R_1')))
    assert {name for name in with_R - hybrid} == {f'wire.resistivity_{x}' for x in ('A', 'M', 'T_A', 'T_M')}
    assert len(choose_free(Config(), ['wire.resistivity_A'], ('alpha',))[1]) == 1
    assert not choose_free(Config(), ['wire.resistivity_A'], ('R_2',))[1]
    run = fit_data(
        Recording('w', 'wire', TIMES, {'stress': np.zeros(81)}, wire_input([2.0, 6.0], [0.0, 0.01])), {'stress': 1e6}
    )
    assert len(Problem(Config(system='wire'), (run,), (), delay=0.0).unknowns) == 1
