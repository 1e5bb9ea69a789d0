"""Intervals, correlated residuals, and what the data do not determine: each equivalence known from the equations."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from simulated_data import NOISE, command, config, dataset, recording, scaled

from sma_sim import Dataset, FitOptions, calibrate, module_input, predict
from sma_sim.evidence.estimation import uncertainty
from sma_sim.evidence.estimation.free_parameters import FreeParameter, choose_free
from sma_sim.evidence.estimation.overdispersion import autocorrelation_time
from sma_sim.evidence.estimation.plausibility import reported_covariance
from sma_sim.evidence.estimation.problem import reduced_in_turn
from sma_sim.evidence.estimation.run_estimates import ReducedRun
from sma_sim.evidence.estimation.uncertainty import JACOBIAN_RTOL, RunInformation, interval, long_run, unidentified
from sma_sim.solver.simulate import SimulationError

S = 1.1  # how far an equivalence is followed
STRESS = dict.fromkeys(
    ('wire__E_A', 'wire__E_M', 'wire__sigma_T', 'wire__sigma_MW0', 'wire__dsigma', 'wire__c_V', 'wire__lambda'), 1.0 / S
)
SHIFT = 10.0  # [K]
# What is changed, what must be held when all of it is free, and whether the kinetics take part.
EQUIVALENT = {
    'rho c_V': ({'wire__rho': S, 'wire__c_V': 1.0 / S}, 'wire.rho'),
    'T0 sigma_MW0': ({'wire__T0': (323.0 + SHIFT) / 323.0, 'wire__sigma_MW0': 1.0 + 2.13e6 * SHIFT / 121.35e6}, 'wire.T0'),
    'n r0 lambda': ({'wire__n': S**2, 'wire__r0': 1.0 / S, 'wire__lambda': 1.0 / S}, 'wire.n'),
    'n stresses': ({'wire__n': S, **STRESS, 'wire__V_L': S}, 'wire.n'),
    'r0 stresses': ({'wire__r0': S**0.5, **STRESS, 'wire__lambda': S**-0.5, 'wire__V_L': S}, 'wire.r0'),
}


@pytest.mark.parametrize('model', ['hybrid', 'mas'])
@pytest.mark.parametrize('which', EQUIVALENT)
def test_equivalences_change_nothing_and_are_never_fitted_jointly(which, model):
    changes, held = EQUIVALENT[which]
    given = config(model, solver__rtol=1e-7)
    run = recording(given, command(1, seconds=20.0))
    same = predict(scaled(given, **changes), run)
    for name, noise in NOISE.items():
        np.testing.assert_allclose(same[name], run.channels[name], atol=2e-3 * noise, rtol=1e-6)
    names = [name.replace('__', '.') for name in changes if model == 'mas' or name != 'wire__V_L']
    free, reasons = choose_free(given, names)
    assert [reason.name for reason in reasons] == [held] and reasons[0].reason
    assert held not in [parameter.name for parameter in free]
    free, reasons = choose_free(given, [name for name in names if name != held])
    assert len(free) == len(names) - 1 and not reasons


def test_parameters_without_effect_are_held():
    free, held = choose_free(config('hybrid'), ['wire.V_L', 'wire.omega_x', 'wire.E_A'])
    assert [parameter.name for parameter in free] == ['wire.E_A']
    assert {one.name for one in held} == {'wire.V_L', 'wire.omega_x'}
    assert 'wire.V_L' in [one.name for one in choose_free(config('mas'))[0]]
    assert [one.name for one in choose_free(config(system='wire'), ['beam.E'])[1]] == ['beam.E']


def test_an_interval_wider_than_the_fit_could_go_is_no_knowledge():
    one = FreeParameter('wire.c_V', 380.0, 0.5, -5.0, 5.0, True, 'J/(kg K)')
    wide, narrow = interval(one, 0.3, 3.0, True), interval(one, 0.3, 0.1, True)
    assert not wide.seen and (wide.low, wide.high) == (one.value(-5.0), one.value(5.0))
    assert narrow.seen and narrow.low < one.value(0.3) < narrow.high


def test_intervals_of_a_model_that_runs_at_the_tolerance_of_the_fit_only(monkeypatch):
    """As one may at the edge of what can be run: they are nearly the same."""
    data, options = (
        dataset(config('hybrid'), [1], 1.0, 20.0, rate=5.0),
        FitOptions(free=('beam.E',), kinetics='hybrid', starts=1),
    )
    (known,) = calibrate(data, config(), options).uncertainty.intervals

    def stopping(problem, *words, **more):
        if problem.config.parameters['solver.rtol'] == JACOBIAN_RTOL:
            raise SimulationError('the beam is unstable')
        return reduced_in_turn(problem, *words, **more)

    monkeypatch.setattr(uncertainty, 'reduced_in_turn', stopping)
    (found,) = calibrate(data, config(), options).uncertainty.intervals
    assert found.std != known.std and found.std == pytest.approx(known.std, rel=0.02)


def with_other_length(given, stretch):
    """Parameters under x -> 1 - s (1 - x), which keeps x = 1 (docs/explanation/calibration.md)."""
    wire = given.parameters
    eps_T = (1.0 + wire['wire.eps_T']) / stretch - 1.0
    s = wire['wire.eps_T'] / (eps_T * stretch)
    E_M = wire['wire.E_M'] * stretch
    d = (1.0 / wire['wire.E_M'] - 1.0 / wire['wire.E_A']) / (stretch * s)
    changed = {
        'wire.l0': wire['wire.l0'] * stretch,
        'wire.eps_T': eps_T,
        'wire.E_M': E_M,
        'wire.E_A': 1.0 / (1.0 / E_M - d),
        'wire.c_V': wire['wire.c_V'] / stretch,
        'wire.lambda': wire['wire.lambda'] / stretch,
        **{f'initial.x_M_{i}': 1.0 - s * (1.0 - wire[f'initial.x_M_{i}']) for i in (1, 2)},
    }
    return replace(given, parameters={**wire, **changed})


@pytest.mark.parametrize('seed', range(5))
def test_derivatives_that_explode_leave_variances(seed):
    """Of numbers that differ by more than rounding errors can tell, no variance of any parameter is negative."""
    free, random = choose_free(config('mas'))[0], np.random.default_rng(seed)
    problem = SimpleNamespace(free=free, shared=free, delay=0.0, runs=(), robust=False, indices=list)
    n, runs, reduced = len(free), [], []
    for size in (0.0, 1e67, 0.0):
        jacobian = 1e3 * random.normal(size=(n, 1, 40)) * 10.0 ** random.uniform(-3.0, 0.0, (n, 1, 1))
        jacobian[:, 0, -3:] += size * np.outer(random.normal(size=n), random.normal(size=3))
        hessian = np.einsum('uck,vck->cuv', jacobian, jacobian)
        equations = SimpleNamespace(indices=np.arange(n))
        runs.append(RunInformation(equations, hessian, np.array([6e4]), jacobian[:, 0] * random.normal(size=40), {'T': 5.0}))
        reduced.append(ReducedRun('', hessian[0], np.zeros(n)))
    known = uncertainty.uncertainty(problem, np.zeros(n), runs)
    assert all(np.isfinite(one.std) and one.std > 0.0 for one in known.intervals)
    assert np.diag(known.correlation) == pytest.approx(1.0)
    assert (np.diag(reported_covariance(free, known)) > 0.0).all()
    assert all((run.alone(np.zeros(n))[1] > 0.0).all() for run in reduced)


def test_hybrid_wires_that_never_empty_do_not_show_their_length():
    """While no wire is all austenite, other l0, eps_T, moduli, c_V and lambda together change nothing."""
    given = config(solver__rtol=1e-7, initial__x_M_1=0.56, initial__x_M_2=0.56)
    other = with_other_length(given, 0.999)
    run = recording(given, module_input([0, 5, 10, 20], [6, 0, -6, 0]))
    same = predict(other, run)
    for name, noise in NOISE.items():
        np.testing.assert_allclose(same[name], run.channels[name], atol=2e-3 * noise, rtol=1e-6)
    names = ('wire.l0', 'wire.eps_T', 'wire.E_A', 'wire.E_M', 'wire.c_V', 'wire.lambda')
    noisy = recording(given, run.source, noise=1.0)
    found = calibrate(Dataset((noisy,), NOISE), config(), FitOptions(free=names, kinetics='hybrid', starts=1))
    assert found.uncertainty is not None
    along = np.array([parameter.coordinate(other.parameters[parameter.name]) for parameter in choose_free(given, names)[0]])
    along /= np.linalg.norm(along)
    least_known = found.uncertainty.directions[-1]
    assert least_known.std > 4.5  # the bounds of the fit: 5
    assert abs(np.array([least_known.weights[name] for name in names]) @ along) > 0.98
    assert {'wire.l0', 'wire.eps_T'} <= set(' '.join(found.uncertainty.unseen).split())
    for estimate in found.uncertainty.intervals:
        assert estimate.high / estimate.low > 1.15 and estimate.low < given.parameters[estimate.name] < estimate.high
        assert not estimate.seen or estimate.name in ('wire.c_V', 'wire.lambda')


def test_data_at_rest_tell_nothing_of_heat():
    runs = Dataset((recording(config(), module_input([0, 20], [0, 0]), noise=1.0),), NOISE)
    names = ('wire.c_V', 'wire.lambda', 'beam.E', 'beam.b_alpha')
    found = calibrate(runs, config(), FitOptions(free=names, kinetics='hybrid', starts=1))
    assert found.uncertainty is not None
    seen = {one.name: one.seen for one in found.uncertainty.intervals}
    assert seen == {'wire.c_V': False, 'wire.lambda': False, 'beam.E': True, 'beam.b_alpha': False}
    assert set(found.uncertainty.unseen) == {f'{name} has no visible effect' for name, each in seen.items() if not each}
    for estimate in found.uncertainty.intervals:
        assert estimate.seen or estimate.high / estimate.low > 100.0


def test_intervals_hold_the_truth():
    truth = scaled(config('hybrid'), wire__sigma_T=1.05, wire__lambda=0.93, beam__E=1.08, wire__dsigma=0.94)
    names = ('wire.sigma_T', 'wire.lambda', 'wire.sigma_MW0', 'wire.dsigma', 'wire.c_V', 'beam.E', 'beam.b_alpha')
    inside = []
    for seed in range(4):
        runs = dataset(truth, [10 * seed + 1], noise=1.0)
        found = calibrate(runs, config(), FitOptions(free=names, kinetics='hybrid', starts=1))
        assert found.uncertainty is not None
        for estimate in found.uncertainty.intervals:
            inside.append(estimate.low <= truth.parameters[estimate.name] <= estimate.high)
            assert estimate.seen and estimate.high / estimate.low < 1.6
    assert np.mean(inside) > 0.8


FREE = tuple(FreeParameter(name, 1.0, 0.5, -5.0, 5.0, True, '-') for name in ('a', 'b', 'c'))


@pytest.mark.parametrize(
    ('vector', 'words'),
    [
        ((1.0, 1.0, 0.0), 'a and b only as their ratio'),
        ((0.0, 1.0, -1.0), 'b and c only as their product'),
        ((0.0, 0.0, 1.0), 'c has no visible effect'),
        ((1.0, -2.0, 0.0), 'b and a only together: moving b by +10 %, a by -5 % changes next to nothing'),
    ],
)
def test_unseen_directions_in_words(vector, words):
    unknown = np.array([vector]).T / np.linalg.norm(vector)
    assert unidentified(FREE, unknown) == [words]


def test_two_unseen_directions_are_taken_apart():
    """Any rotation of two directions gives the same sentences."""
    plane = np.array([[1.0, 1.0, 0.0], [0.0, 0.0, 1.0]]).T / [np.sqrt(2.0), 1.0]
    turn = np.array([[0.8, -0.6], [0.6, 0.8]])
    assert set(unidentified(FREE, plane @ turn)) == {'c has no visible effect', 'a and b only as their ratio'}


@pytest.mark.parametrize('memory', [0.0, 0.6, 0.9])
def test_autocorrelation_time_of_an_autoregressive_series(memory):
    series = autoregressive(memory, 40_000)
    assert autocorrelation_time(series) == pytest.approx((1.0 + memory) / (1.0 - memory), rel=0.15)


@pytest.mark.parametrize('memory', [0.0, 0.9])
def test_long_run_covariance_of_scores(memory):
    """A constant sensitivity and AR(1) residuals: the variance of their sum."""
    series = autoregressive(memory, 40_000)
    expected = len(series) * (1.0 + memory) / (1.0 - memory)
    assert long_run(series[None, :], autocorrelation_time(series))[0, 0] == pytest.approx(expected, rel=0.25)


def autoregressive(memory, count):
    """AR(1) of variance 1."""
    random = np.random.default_rng(3)
    series = np.zeros(count)
    for k, kick in enumerate(random.normal(size=count) * np.sqrt(1.0 - memory**2)):
        series[k] = memory * series[k - 1] + kick
    return series
