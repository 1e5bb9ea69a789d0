"""Calibration: known parameters come back, models are told apart, work is spread, wrong use is said."""

import os
import pickle
import shutil
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import threadpoolctl
from simulated_data import NOISE, config, dataset, recording, scaled

import sma_sim.evidence.estimation.executors as executors
from sma_sim import (
    Config,
    Dataset,
    FitOptions,
    Model,
    Recording,
    UserError,
    calibrate,
    evaluate_held_out,
    find_effects,
    module_input,
    read_config,
    simulate,
    wire_input,
)
from sma_sim.challenge.make import RecordingPlan, make_challenge
from sma_sim.evidence.estimation import levenberg_marquardt
from sma_sim.evidence.estimation.dask_cluster import dask_executor
from sma_sim.evidence.estimation.executors import PickledConfig, workers_of
from sma_sim.evidence.estimation.free_parameters import choose_free
from sma_sim.evidence.model_selection.candidates import with_effect
from sma_sim.model.effects.discovery import ActiveEffect

OFF = {
    'wire__sigma_T': 1.08,
    'wire__c_V': 0.9,
    'wire__lambda': 1.12,
    'wire__sigma_MW0': 0.95,
    'wire__dsigma': 1.07,
    'beam__E': 0.93,
    'beam__b_alpha': 1.1,
}
NAMES = tuple(name.replace('__', '.') for name in OFF)
QUICK = FitOptions(free=NAMES, kinetics='hybrid', starts=1, intervals=False)
FEW = FitOptions(free=('wire.lambda', 'beam.E'), kinetics='hybrid', starts=1, intervals=False)


@pytest.fixture(scope='module')
def small():
    """One short run with two parameters off."""
    return dataset(scaled(config(), wire__lambda=1.1, beam__E=0.95), [1], noise=1.0, rate=5.0)


@pytest.mark.parametrize('model', [pytest.param('hybrid', marks=pytest.mark.slow), 'mas'])
def test_noise_free_data_give_the_parameters_back(model):
    truth = scaled(config(model, initial__x_M_1=0.565, initial__x_M_2=0.565), **OFF)
    found = calibrate(dataset(truth, [1, 2], rate=8.0), config(model), replace(QUICK, model=model))
    for name in NAMES:
        assert found.values[name] == pytest.approx(truth.parameters[name], rel=1e-3), name
    assert found.error < 0.01
    assert abs(found.delay) < 1e-5


def test_a_held_out_run_that_cannot_be_made_is_infinitely_far_off(small):
    (fit,) = evaluate_held_out(config(wire__l0=0.06), small)
    assert fit.error == np.inf and set(fit.channel_errors.values()) == {np.inf}


def test_the_more_probable_model_is_chosen_and_predicts():
    truth = scaled(config('mas'), wire__E_A=0.9, wire__V_L=1.1, **OFF)
    runs = dataset(truth, [1, 2, 3], noise=1.0, rate=25.0)
    options = FitOptions(free=(*NAMES, 'wire.E_A'), starts=1, intervals=False)
    found = calibrate(Dataset(runs.recordings[:2], NOISE), config(), options)
    assert found.config.simulated_kinetics == 'mas'
    assert found.kinetics['mas'] > 0.99
    out = Dataset(runs.recordings[2:], NOISE)
    assert evaluate_held_out(found.config, out, found.delay)[0].error < 1.1
    hybrid = calibrate(Dataset(runs.recordings[:2], NOISE), config(), replace(options, model='hybrid'))
    assert evaluate_held_out(hybrid.config, out, hybrid.delay)[0].error < 1.3


def test_delay_and_starts_are_nuisances():
    truth = config(initial__x_M_1=0.55, initial__x_M_2=0.55)
    found = calibrate(dataset(truth, [4], noise=1.0, delay=0.12), config(), FEW)
    assert found.delay == pytest.approx(0.12, abs=2e-3)
    assert found.runs[0].x_M == pytest.approx((0.55, 0.55), abs=2e-3)
    assert found.config.parameters['initial.x_M_1'] == found.runs[0].x_M[0]


def test_sampled_commands_find_their_instants():
    """Commands known at 5 Hz only: without their instants the error is well above the noise."""
    exact = dataset(config(), [6], noise=1.0)
    run = exact.recordings[0]
    rows = np.arange(0.0, 40.2, 0.2)
    held = np.searchsorted(run.source.times, rows, side='right') - 1
    sampled = replace(run, source=replace(run.source, times=rows, values=run.source.values[held]), exact_commands=False)
    found = calibrate(Dataset((sampled,), NOISE), config(), FEW)
    late = calibrate(Dataset((replace(sampled, exact_commands=True),), NOISE), config(), FEW)
    assert found.error < 1.1 < 1.5 < late.error
    instants = [t for t in run.source.times[1:] if t < 39.0]
    row = np.ceil(np.array(instants) / 0.2) * 0.2
    assert row - 0.2 * np.array(found.runs[0].switches[: len(row)]) == pytest.approx(instants, abs=0.02)


def test_robust_loss_bears_outliers():
    runs = dataset(config(), [5], noise=1.0)
    random = np.random.default_rng(0)
    wild = {
        name: np.where(random.random(len(v)) < 0.03, v + 300.0 * NOISE[name], v)
        for name, v in runs.recordings[0].channels.items()
    }
    spoilt = Dataset((replace(runs.recordings[0], channels=wild),), NOISE)
    plain, robust = (calibrate(spoilt, config(), replace(FEW, robust=each)) for each in (False, True))
    error = {name: abs(robust.values[name] / config().parameters[name] - 1.0) for name in FEW.free}
    assert max(error.values()) < 2e-3
    assert abs(plain.values['wire.lambda'] / 450.0 - 1.0) > 3.0 * error['wire.lambda']


def test_wire_from_its_test_bench():
    """Loops of one wire at two temperatures, in stress and temperature."""
    truth = scaled(config(system='wire'), wire__E_A=1.1, wire__E_M=0.9, wire__dsigma=1.1, wire__sigma_T=0.9)
    runs = []
    for T_E in (315.0, 335.0):
        source = wire_input([0, 60, 120, 180], [0, 0.075, 0.02, 0.05], [0, 0, 0.2, 0.2], T_E)
        times = np.arange(0.0, 180.0, 0.5)
        seen = simulate(Model(scaled(truth, solver__rtol=1e-2)), source, times)
        runs.append(Recording(f'{T_E} K', 'wire', times, {'stress': seen['stress_Pa'], 'T': seen['T_K']}, source))
        assert seen.completed
    found = calibrate(
        Dataset(tuple(runs), {'stress': 1e5, 'T': 0.1}),
        config(system='wire'),
        FitOptions(kinetics='hybrid', starts=1, intervals=False),
    )
    for name in ('wire.E_A', 'wire.E_M', 'wire.eps_T', 'wire.sigma_T', 'wire.dsigma', 'wire.sigma_MW0', 'wire.c_V'):
        assert found.values[name] == pytest.approx(truth.parameters[name], rel=1e-3), name


def test_ctrl_c_keeps_the_best_so_far(small, monkeypatch):
    waits = iter([KeyboardInterrupt, None])

    def interrupted(futures):
        if next(waits, None) is KeyboardInterrupt:
            raise KeyboardInterrupt

    monkeypatch.setattr(executors, 'wait', interrupted)
    told = []
    found = calibrate(small, config(), FEW, progress=lambda label, iteration, cost: told.append((label, cost)))
    assert found.interrupted and not found.converged
    assert set(found.values) == set(FEW.free) and np.isfinite(found.error)
    assert told and told[0][0] == 'hybrid, start 1'


def test_further_starts_are_reported(small):
    found = calibrate(small, config(), replace(FEW, starts=3))
    assert len(found.other_starts) == 2
    assert all(other.same and other.excess < 2.0 for other in found.other_starts)


def test_a_start_that_is_damped_less_passes_a_valley_that_holds_the_first():
    case = make_challenge(1, 0, None, (), False, plan=RecordingPlan(duration=60.0, rate=10.0))
    training = replace(case.dataset, recordings=case.dataset.recordings[:2])
    found = calibrate(training, case.nominal, FitOptions(kinetics='mas', intervals=False))
    assert found.other_starts[0].excess > 10.0 and found.error < 1.005  # 1.009 where the first start leads


def test_bounds_are_reported(small):
    """A beam that is far stiffer than the prior reaches."""
    start = scaled(config(), beam__L=1.0, wire__V_L=1.0, beam__E=1.0 / 13.0)
    found = calibrate(small, start, replace(FEW, free=('beam.E',)))
    assert found.at_bound == ('beam.E',)


def test_linear_algebra_keeps_to_its_thread_with_any_executor():
    def threads():
        return {library['num_threads'] for library in threadpoolctl.threadpool_info() if library['user_api'] == 'blas'}

    with threadpoolctl.threadpool_limits(2, 'blas'), ThreadPoolExecutor(1) as own:
        assert threads() == {2}
        for executor in (None, own):
            with executors.executor_or_threads(executor):
                assert threads() == {1}
        assert threads() == {2}


@pytest.mark.parametrize('kind', ['threads', 'processes'])
def test_executors_agree(small, kind):
    expected = calibrate(small, config(), FEW)
    with ThreadPoolExecutor(3) if kind == 'threads' else ProcessPoolExecutor(2) as executor:
        found = calibrate(small, config(), FEW, executor)
    assert found.values == expected.values


def test_dask_cluster(small):
    """A real local cluster with workers in processes of their own."""
    distributed = pytest.importorskip('distributed')
    expected = calibrate(small, config(), FEW)
    with (
        distributed.LocalCluster(n_workers=1, threads_per_worker=2, processes=True, dashboard_address=None) as cluster,
        dask_executor(cluster.scheduler_address) as executor,
    ):
        assert workers_of(executor) == 2
        found = calibrate(small, config(), FEW, executor)
    assert found.values == expected.values


class Travelling(ThreadPoolExecutor):
    """Threads whose tasks and results are pickled, as those of a cluster are; keeps the size of results [bytes]."""

    def __init__(self):
        super().__init__(2)
        self.sizes = []

    def submit(self, work, *arguments):
        return super().submit(self._work, pickle.dumps((work, arguments)))

    def _work(self, task):
        work, arguments = pickle.loads(task)
        made = pickle.dumps(work(*arguments))
        self.sizes.append(len(made))
        return pickle.loads(made)


def test_runs_of_a_campaign_send_what_their_derivatives_sum_to(small, monkeypatch):
    """Where derivatives are too large to be kept: neither they nor residuals travel, nor wait in the memory."""
    monkeypatch.setattr(levenberg_marquardt, 'MAX_KEPT', 0)
    options = replace(FEW, intervals=False)
    with Travelling() as executor:
        found = calibrate(small, config(), options, executor)
    assert found.values == calibrate(small, config(), options).values
    size = 8 * len(small.recordings[0].time)  # of one channel of residuals
    assert len(executor.sizes) > 10 and np.mean([one < size for one in executor.sizes]) > 0.9


def test_a_worker_reads_a_configuration_once_for_all_runs(tmp_path):
    """And again after a file of it was edited."""
    example = Path(__file__).resolve().parents[2] / 'examples' / 'own_effect' / 'harness.py'
    file = Path(shutil.copy(example, tmp_path))
    harness = ActiveEffect(find_effects(tmp_path)['harness'], (0.2, 0.0, 0.0))
    given = PickledConfig(config().variant(effects=(harness,)))
    first, again = (pickle.loads(pickle.dumps(given)) for _ in range(2))
    assert again is first and first.config.effects[0].values == harness.values
    os.utime(file, ns=(0, 0))
    assert pickle.loads(pickle.dumps(given)) is not first


def test_no_scheduler_is_said():
    pytest.importorskip('distributed')
    with pytest.raises(UserError, match='no Dask scheduler answers'), dask_executor('tcp://127.0.0.1:9'):
        pass


def test_effects_travel_by_name_and_are_fitted():
    given = read_config(effects=['gravity', 'natural_convection:k=2'])
    parcel = PickledConfig(given)
    unpack, arguments = parcel.__reduce__()
    again = unpack(*arguments).config
    assert [active.values for active in again.effects] == [active.values for active in given.effects]
    free, _ = choose_free(given)
    assert {'effects.natural_convection.k'} <= {parameter.name for parameter in free}
    truth = read_config(effects=['natural_convection:k=3'])
    start = read_config(effects=['natural_convection:k=1'])
    found = calibrate(dataset(truth, [1, 2]), start, replace(FEW, free=('effects.natural_convection.k',)))
    assert found.values['effects.natural_convection.k'] == pytest.approx(3.0, rel=1e-3)
    assert found.config.effects[0].values[0] == found.values['effects.natural_convection.k']


@pytest.mark.parametrize(
    ('change', 'message'),
    [
        ({'free': ('wire.E_B',)}, 'did you mean wire.E_'),
        ({'model': 'maas'}, 'expected one of hybrid, mas, auto'),
        ({'starts': 0}, 'expected a whole number, 1 or more'),
    ],
)
def test_wrong_options_are_said(small, change, message):
    with pytest.raises(UserError, match=message):
        calibrate(small, config(), replace(FEW, **change))


def test_wrong_datasets_are_said(small):
    with pytest.raises(UserError, match='no recording'):
        calibrate(Dataset(()), config(), FEW)
    with pytest.raises(UserError, match='recording of a module'):
        calibrate(small, config(system='wire'), FEW)


def test_a_start_has_several_optima():
    """The right parameters predict all three runs: the third from near sigma_A, where the middle does not lead."""
    made = make_challenge(1089, 0)
    truth = Config(dict(made.robot.parameters), 'module', 'mas')
    assert all(fit.error < 1.05 for fit in evaluate_held_out(truth, made.dataset))


def test_a_softening_beam_is_recovered():
    """b = -0.3, within its realistic range, from where the beam is linear."""
    effect = find_effects()['beam_nonlinearity']
    truth, start = (with_effect(config(), effect, {'b': b, 'c': 0.0}) for b in (-0.3, 0.0))
    run = recording(truth, module_input([0.0, 8.0, 16.0, 20.0], [25.0, -25.0, 8.0, 0.0]), noise=1.0)
    fit = calibrate(
        Dataset((run,), NOISE), start, FitOptions(free=('effects.beam_nonlinearity.b',), kinetics='hybrid', starts=1)
    )
    assert fit.uncertainty is not None
    (interval,) = fit.uncertainty.intervals
    assert interval.seen and interval.std < 0.01  # one draw of noise: three standard deviations, not its 95 % interval
    assert interval.value == pytest.approx(-0.3, abs=3.0 * interval.std)
