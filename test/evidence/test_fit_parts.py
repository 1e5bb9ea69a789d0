"""Parts of a fit, each against what it must be: coordinates, ports, rows of an input, weights, workers, normal equations."""

import signal
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from threading import Event, Lock

import numpy as np
import pytest
from simulated_data import NOISE, config, dataset
from systems import active

from sma_sim import Config, Dataset, Input, Recording, make_challenge, module_input, simulate, wire_input
from sma_sim.challenge import robot
from sma_sim.cli import init
from sma_sim.evidence.estimation import executors, homogeneity, residuals
from sma_sim.evidence.estimation.executors import PickledConfig
from sma_sim.evidence.estimation.free_parameters import choose_free, free_parameter
from sma_sim.evidence.estimation.held_out_prediction import INITIAL_GUESSES, mean_error, pooled_error
from sma_sim.evidence.estimation.injection_points import STIFFNESS, ports_of, small_force
from sma_sim.evidence.estimation.interruption import stoppable
from sma_sim.evidence.estimation.levenberg_marquardt import bounded_step
from sma_sim.evidence.estimation.problem import (
    HUBER_CORNER,
    START,
    EvaluationTask,
    LinearizedRun,
    NormalEquations,
    accumulated,
    evaluate,
    normal_equations,
    robust_cost,
    robust_weights,
)
from sma_sim.evidence.estimation.residuals import (
    SOLVER_NOISE,
    Nuisance,
    error_over_noise,
    fit_data,
    sampled_changes,
    step_limit,
    weighted_residuals,
    with_switches,
    without_repeats,
)
from sma_sim.evidence.estimation.uncertainty import Interval
from sma_sim.evidence.latent_input import sensitivities
from sma_sim.evidence.latent_input.sensitivities import knot_grid
from sma_sim.model.effects.ports import CHANNELS
from sma_sim.model.parameters import Parameter
from sma_sim.model.program_parameters import DEFAULTS
from sma_sim.model.structures.module import STRUCTURE as MODULE
from sma_sim.solver.simulate import STOPPED


def recording(values=(0.0, 0.0, 5.0, 5.0, 2.0), **more):
    times = np.arange(len(values), dtype=float)
    source = module_input(times, list(values))
    return Recording('run', 'module', times, {'alpha': np.array([0.0, 0.1, np.nan, 0.2, 0.3])}, source, **more)


@pytest.mark.parametrize(
    'declared', [DEFAULTS['wire.c_V'], Parameter('g', 1.5, 'm/s^2', (-40.0, 40.0), '', neutral=0.0, realistic=(-10.0, 10.0))]
)
def test_coordinates_of_a_parameter(declared):
    """z = 0 at the middle of the prior, one in z is one standard deviation, and the bounds of the value bound z."""
    free = free_parameter('name', declared.default, declared)
    assert free.value(0.0) == declared.default and free.low < 0.0 < free.high
    for z in (-1.3, 0.0, 2.0):
        assert free.coordinate(free.value(z)) == pytest.approx(z, abs=1e-12)
    std = np.log(free.value(1.0) / free.value(0.0)) if free.log else free.value(1.0) - free.value(0.0)
    assert std == pytest.approx(free.scale) and free.log == (declared.neutral is None)
    low, high = declared.bounds
    assert low * (1 - 1e-12) <= free.value(free.low) or not free.log
    assert free.value(free.high) <= high * (1 + 1e-12)


def test_parameters_of_active_effects_are_free_within_their_bounds():
    free, held = choose_free(Config(effects=(active('gravity'),)), ['effects.gravity.g_y', 'wire.E_A'])
    assert [parameter.name for parameter in free] == ['effects.gravity.g_y', 'wire.E_A'] and not held
    assert [parameter.log for parameter in free] == [False, True]


def test_parameters_of_channels_that_nothing_measures_are_not_free():
    sensed = Config(effects=(active('sensor_drift'), active('gravity')))
    free, held = choose_free(sensed, None, ('alpha', 'F_1'))
    of_effects = [one.name.removeprefix('effects.') for one in free if one.name.startswith('effects.')]
    assert of_effects == [f'sensor_drift.{name}' for name in ('alpha', 'F_1', 'k')] + ['gravity.g_y', 'gravity.g_x']
    assert not held
    free, held = choose_free(sensed, ['wire.E_A', 'effects.sensor_drift.stress'], ('alpha',))
    assert [one.name for one in free] == ['wire.E_A'] and [one.reason for one in held] == ['no stress is measured']


def test_every_channel_is_shown_by_one_sensor_of_its_system():
    """Seven on the module, two on the wire."""
    module, wire = Config(), Config(system='wire')
    assert [port.name for port in ports_of(module, CHANNELS) if port.hook == 'sensing'] == [
        f'sense_{c}' for c in CHANNELS[:7]
    ]
    assert [port.name for port in ports_of(wire, CHANNELS) if port.hook == 'sensing'] == [f'sense_{c}' for c in CHANNELS[7:]]
    assert [port.name for port in ports_of(module, ('alpha',)) if port.hook == 'sensing'] == ['sense_alpha']
    assert [port.name for port in ports_of(wire, ()) if port.component == 1] == []


def test_rows_that_change_nothing_are_left_out_of_held_inputs_only():
    held = module_input([0.0, 1.0, 2.0, 3.0, 4.0], [1.0, 1.0, 2.0, 2.0, 2.0])
    assert without_repeats(held).times.tolist() == [0.0, 2.0, 4.0]
    sloped = Input(held.times, held.values, (True, False))
    assert without_repeats(sloped).times.tolist() == held.times.tolist()


def test_weights_of_samples():
    """One over noise, the solver's own error added in quadrature; nothing for a missing sample."""
    run = fit_data(recording(), {'alpha': 0.02})
    assert run.weight.tolist() == [pytest.approx([50.0, 50.0, 0.0, 50.0, 50.0])] and run.samples == 4
    floor = 0.02 / (SOLVER_NOISE * 0.15)
    assert fit_data(recording(), {'alpha': 0.02}, floor=floor).weight[0, 0] == pytest.approx(50.0 / np.sqrt(2.0))
    assert error_over_noise(np.array([[3.0, -3.0, 0.0, 3.0, 3.0]]), run) == {'alpha': pytest.approx(3.0)}


def test_sampled_commands_changed_between_their_row_and_the_one_before():
    changed, interval = sampled_changes(recording(exact_commands=False))
    assert (changed.tolist(), interval.tolist()) == ([2.0, 4.0], [1.0, 1.0])
    run = fit_data(recording(exact_commands=False), {'alpha': 0.02})
    moved = with_switches(run, [0.25, 0.5])
    assert run.groups == 2 and moved.times.tolist() == [0.0, 1.75, 3.5, 4.0]
    assert moved.values[:, 0].tolist() == [0.0, 5.0, 2.0, 2.0]


def test_longer_runs_may_take_more_steps_and_chosen_models_more_again():
    short, long = (module_input([0.0, 1.0, end], [0.0, 1.0, 1.0]) for end in (2.0, 102.0))
    assert step_limit(long, True) - step_limit(short, True) == 20 * 100
    assert step_limit(long, False) == 20 * step_limit(long, True)
    slow = module_input([0.0, 1.0, 5002.0], [0.0, 1.0, 1.0])
    assert step_limit(slow, True, samples=5000) == step_limit(slow, True) == step_limit(short, True) + 20 * 5000
    assert step_limit(slow, True, samples=80) == step_limit(short, True) + 20 * 158  # one sample each minute


@pytest.mark.parametrize('others, runs', [((), 3), (('sensor_lag',), 5)])
def test_points_that_differ_in_what_sensors_show_share_a_run(others, runs, monkeypatch):
    given, made = fit_data(recording(), {'alpha': 1e-3}), list[int]()
    base = Config(effects=[active(name) for name in others])
    sensed = [active('sensor_bias', alpha=0.01), active('sensor_drift', alpha=0.02), active('gravity', g_y=-9.81)]
    configs = [base, *(replace(base, effects=(*base.effects, one)) for one in sensed), base.variant({'wire.c_V': 500.0})]
    alone = [weighted_residuals(config, given) for config in configs]
    run_all = residuals.channels_of_all
    monkeypatch.setattr(
        residuals, 'channels_of_all', lambda models, *more: made.append(len(models)) or run_all(models, *more)
    )
    together = evaluate(EvaluationTask(given, tuple((PickledConfig(config), Nuisance()) for config in configs)))
    assert len(made) == runs and sum(made) == len(configs)
    for one, other in zip(together, alone, strict=True):
        assert np.array_equal(one, other)
    assert np.abs(alone[1] - alone[0]).max() > 1.0


def test_workers_of_an_executor(monkeypatch):
    with ThreadPoolExecutor(3) as threads:
        assert executors.workers_of(threads) == 3
    monkeypatch.setattr(executors.os, 'cpu_count', lambda: 6)
    assert executors.workers_of(object()) == 6
    monkeypatch.setattr(executors.os, 'cpu_count', lambda: None)
    assert executors.workers_of(object()) == 1


def test_guesses_of_a_start_lie_within_the_hysteresis():
    assert all(0.0 <= START.value(guess) <= 1.0 for guess in INITIAL_GUESSES)


def test_pooled_error_is_the_root_of_the_mean_square():
    assert mean_error({'a': 3.0, 'b': 4.0}) == pytest.approx(np.sqrt(12.5)) and np.isnan(mean_error({}))
    assert np.isnan(pooled_error([])[0])


def test_transformation_stress_of_a_run_is_taken_at_its_temperature(monkeypatch):
    """sigma_MW = sigma_MW0 + sigma_T (T - T0)."""
    known = [Interval(name, 1.2e8, 0.01, 1.1e8, 1.3e8, True, True, 'Pa') for name in homogeneity.STRESS_NAMES]
    result = type('Result', (), {'uncertainty': type('U', (), {'intervals': known})})
    monkeypatch.setattr(homogeneity, 'calibrate', lambda *given: result)
    run = Recording(
        'run', 'module', np.arange(2.0), {'alpha': np.zeros(2)}, module_input([0.0, 1.0], [0.0, 0.0], [313.0, 313.0])
    )
    stress = homogeneity.run_stress(Config(), Dataset((run,), {'alpha': 1.0}), run, False, None)
    assert stress is not None and stress.temperature == 313.0
    assert stress.sigma_MW == pytest.approx(np.array([1.2e8, 1.1e8, 1.3e8]) - 10.0 * 2.13e6)
    assert homogeneity.cochran_p([(1.0, 0.0, 2.0), (1.0, 0.5, 1.5)]) == pytest.approx(1.0)
    assert homogeneity.cochran_p([(0.0, -1.0, 1.0), (9.0, 8.0, 10.0)]) < 1e-6


def test_runs_on_one_straight_line_agree_whatever_their_temperatures(monkeypatch):
    """Each run on its own gives the same sigma_MW0; a heated run is left out, and one alone says nothing."""

    def isotherm(name, T_E, J=0.0):
        source = wire_input([0.0, 1.0], [0.0, 0.01], [J, J], [T_E, T_E])
        return Recording(name, 'wire', np.arange(2.0), {'stress': np.zeros(2)}, source)

    def fit(dataset, *_):
        """What the runs say; `odd` lies 5 MPa above the others, three times its interval."""
        middle = 1.25e8 if dataset.recordings[0].name == 'odd' else 1.2e8
        known = [
            Interval(name, middle, 0.01, middle - 1e6, middle + 1e6, True, True, 'Pa') for name in homogeneity.STRESS_NAMES
        ]
        return type('Result', (), {'uncertainty': type('U', (), {'intervals': known})})

    monkeypatch.setattr(homogeneity, 'calibrate', fit)
    runs = (isotherm('warm', 330.0), isotherm('cold', 300.0), isotherm('heated', 340.0, 1.0))
    wire = Config(system='wire')
    found = homogeneity.homogeneity_test(wire, Dataset(runs, {'stress': 1e5}))
    assert found is not None and [run.name for run in found.runs] == ['cold', 'warm']
    assert found.p_line == pytest.approx(1.0) and found.p_width == pytest.approx(1.0)
    assert 'rises by 2.13 MPa/K from 300 to 330 K' in found.sentences[1] and 'fits all runs' in found.sentences[1]
    held_out = Dataset((isotherm('odd', 315.0),), {'stress': 1e5})
    found = homogeneity.homogeneity_test(wire, Dataset(runs, {'stress': 1e5}), held_out)
    assert found is not None and [run.held_out for run in found.runs] == [False, True, False]
    assert found.p_line < 1e-6 and 'does not fit all runs' in found.sentences[0]
    assert homogeneity.homogeneity_test(wire, Dataset(runs[1:], {'stress': 1e5})) is None


def test_hubers_function_is_smooth_at_its_corner_and_weighs_what_is_beyond():
    c = HUBER_CORNER
    below, above = (robust_cost(np.array([[r]]), True) for r in (c * (1 - 1e-6), c * (1 + 1e-6)))
    assert (above - below) / (2e-6 * c) == pytest.approx(c, rel=1e-4) and below == pytest.approx(0.5 * c * c, rel=1e-4)
    assert robust_cost(np.array([[3.0 * c]]), False) == pytest.approx(4.5 * c * c)
    assert robust_weights(np.array([0.0, c, 4.0 * c])) == pytest.approx([1.0, 1.0, 0.5])


def test_normal_equations_of_a_line():
    """The step of an undamped quadratic model is that of least squares; a bound holds it."""
    random = np.random.default_rng(0)
    jacobian, residuals = random.normal(size=(2, 1, 30)), random.normal(size=(1, 30))
    part = normal_equations(LinearizedRun(np.array([0, 1]), residuals, jacobian), robust=False)
    assert part.cost == pytest.approx(0.5 * (residuals**2).sum())
    cost, gradient, hessian = accumulated([part], np.zeros(2), 1.0)
    assert cost == part.cost and hessian == pytest.approx(part.hessian + np.eye(2))
    wide = np.full(2, 1e3)
    A = np.vstack([jacobian[:, 0].T, np.eye(2)])
    expected = np.linalg.lstsq(A, np.append(-residuals[0], [0.0, 0.0]), rcond=None)[0]
    assert bounded_step(gradient, hessian, 0.0, -wide, wide) == pytest.approx(expected)
    shorter = bounded_step(gradient, hessian, 1e3, -wide, wide)
    assert np.linalg.norm(shorter) < 0.1 * np.linalg.norm(expected)
    limit = 0.5 * np.abs(expected)
    assert (np.abs(bounded_step(gradient, hessian, 0.0, -limit, limit)) <= limit).all()


def test_each_run_adds_to_its_own_unknowns():
    parts = [NormalEquations(np.array(at), 1.0, np.ones(2), np.ones((2, 2))) for at in ([0, 1], [0, 2])]
    cost, gradient, hessian = accumulated(parts, np.zeros(3), 1.0)
    assert cost == 2.0 and gradient.tolist() == [2.0, 1.0, 1.0]
    assert hessian.tolist() == [[3.0, 1.0, 1.0], [1.0, 2.0, 0.0], [1.0, 0.0, 2.0]]


def test_probes_of_what_may_be_missing_are_small_parts_of_what_is_there():
    """Of springs 2 %, else 1 % of the pull at a usual stress; of sensors 1/75 of angles and a tenth of what else changes."""
    slider = Config(system='slider')
    structure, values = slider.structure, slider.parameters
    ports = {port.name: port for port in ports_of(slider, structure.channels)}
    size = structure.coordinates[0].size(structure.constants_of(values))
    force = ports['force_position']
    assert force.probe == pytest.approx(0.02 * values['slider.k'] * size) and (force.unit, force.component) == ('N', 0)
    free = replace(slider, parameters={**values, 'slider.k': 0.0})
    pull = 1e8 * values['wire.n'] * np.pi * values['wire.r0'] ** 2
    assert small_force(free, 0) == pytest.approx(0.01 * pull, rel=1e-6)
    probes = {port.column: port.probe for port in ports.values() if port.hook == 'sensing'}
    assert probes == pytest.approx({'position_m': 0.1 * size, 'F_N': 0.2, 'T_K': 1.0})
    module = {port.name: port for port in ports_of(Config(), CHANNELS)}
    alpha = MODULE.coordinates[2].sensor_size(MODULE.default_constants)
    assert module['sense_alpha'].probe == pytest.approx(alpha / 75.0) and module['sense_U_x'].unit == 'm'
    assert module['stiffness'].component == STIFFNESS < 0 and module['stiffness'].variable == 'alpha'
    for port in module.values():
        wire = port.name[-1] if port.hook not in ('sensing', 'structure_force') else ''
        assert not wire or (port.component, port.name) == (int(wire) - 1, f'{port.group}_{wire}')
    assert module['force_U_x'].component == 0 and (module['moment_alpha'].unit, module['force_U_y'].unit) == ('N m', 'N')


def test_what_may_be_missing_on_benches():
    """No heat where the temperature is set, no force where the strain is; nothing over time in an isobaric test."""
    wire, at_T, isobaric = (
        [port.group for port in ports_of(Config(system=name), ('stress', 'R'))]
        for name in ('wire', 'wire_at_T', 'wire_under_load_at_T')
    )
    assert wire == ['heat', 'strain', 'stress', 'power', 'sense_stress'] and at_T == ['strain', 'stress', 'sense_stress']
    assert isobaric == []
    probes = {port.group: port.probe for port in ports_of(Config(system='wire'), ('stress',))}
    assert probes == {'heat': 0.02, 'strain': 1e-4, 'stress': 5e5, 'power': 0.02, 'sense_stress': 1e6}


HEAT = next(port for port in ports_of(Config(), ('alpha',)) if port.name == 'heat_1')


@pytest.mark.parametrize(
    ('where', 'work'),
    [
        (robot, lambda _: make_challenge(5)),
        (residuals, lambda run: residuals.simulated(Config(), run)),
        (sensitivities, lambda run: sensitivities.run_segments(HEAT, Config(), run, Nuisance(), knot_grid(run))),
        (init, lambda _: init.when_heated(Config())),
    ],
    ids=['challenge', 'residuals', 'latent', 'init'],
)
def test_ctrl_c_within_a_run_ends_the_work_that_needs_it(where, work, monkeypatch):
    """What it cut short is no broken robot, no model that cannot be simulated, and no state to go on from."""
    run = fit_data(dataset(config('mas'), [4], rate=5.0).recordings[0], NOISE)
    stopped = replace(simulate(Config(), module_input([0.0, 0.1], [0.0, 0.0]), 10.0), reason=STOPPED, completed=False)
    monkeypatch.setattr(where, 'simulate', lambda *_, **options: stopped)
    with pytest.raises(KeyboardInterrupt):
        work(run)


def test_the_first_interrupt_asks_for_an_end_and_the_second_interrupts():
    before = signal.getsignal(signal.SIGINT)
    with stoppable() as stop:
        with stoppable() as inner:
            assert inner is stop and not stop.is_set()
        signal.raise_signal(signal.SIGINT)
        assert stop.is_set()
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is before
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with stoppable() as ignored:
            signal.raise_signal(signal.SIGINT)
            assert not ignored.is_set()
    finally:
        signal.signal(signal.SIGINT, before)
    with ThreadPoolExecutor(1) as pool:
        assert pool.submit(signal_in_thread).result() is before


def signal_in_thread():
    """In another thread than the main one nothing changes."""
    with stoppable():
        return signal.getsignal(signal.SIGINT)


def test_jobs_answer_in_their_order_and_so_many_run_at_once():
    running, most, lock = [0], [0], Lock()

    def job(k):
        with lock:
            running[0] += 1
            most[0] = max(most[0], running[0])
        time.sleep(0.01)
        with lock:
            running[0] -= 1
        return k

    jobs = [partial(job, k) for k in range(6)]
    for at_once, expected in ((1, 1), (3, 3), (None, 6)):
        most[0] = 0
        assert executors.run_in_threads(jobs, Event(), at_once) == list(range(6)) and most[0] <= expected
    assert executors.run_in_threads([], Event()) == []
    client = type('Client', (), {'nthreads': lambda _: {'a': 4, 'b': 2}})()
    assert executors.workers_of(type('Cluster', (), {'_client': client})()) == 6
