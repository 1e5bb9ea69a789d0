"""Predictions at the samples of a recording, weights, delays, starts, sampled commands."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from simulated_data import NOISE, command, config, recording, scaled

from sma_sim import (
    Config,
    Dataset,
    FitOptions,
    Model,
    Nuisance,
    Recording,
    UserError,
    module_input,
    predict,
    simulate,
    wire_input,
)
from sma_sim.evidence.data.tables import read_columns
from sma_sim.evidence.estimation import run_tangents
from sma_sim.evidence.estimation.calibrate import SEARCH_RTOL, problem_for
from sma_sim.evidence.estimation.executors import PickledConfig
from sma_sim.evidence.estimation.residuals import error_over_noise, fit_data, step_limit, weighted_residuals
from sma_sim.evidence.estimation.run_tangents import LOOSER, TangentTask, linearized_by_tangents
from sma_sim.model.material import sigma_A, sigma_M
from sma_sim.model.parameters import wire_constants
from sma_sim.solver.simulate import SimulationError

REFERENCE = Path(__file__).resolve().parents[3] / 'shared' / 'reference'


def test_prediction_is_the_simulation():
    truth = config(solver__rtol=1e-7)
    run = recording(truth, command(1))
    shown = predict(truth, run)
    for name, measured in run.channels.items():
        np.testing.assert_allclose(shown[name], measured, rtol=1e-12)


@pytest.mark.parametrize('model', ['hybrid', 'mas'])
@pytest.mark.parametrize('step_limited', [False, True])
def test_residuals_are_those_of_the_prediction(model, step_limited):
    """To the last bit, of a run, and of one that gives tangents where these need no other tolerance."""
    truth, nuisance = config(model), Nuisance(0.03, (0.2, 0.7))
    run = fit_data(recording(truth, command(1), noise=1.0), NOISE, step_limited=step_limited)
    shown = predict(truth, run, nuisance)
    expected = (np.array([shown[name] for name in run.channels]) - run.measured) * run.weight
    assert np.array_equal(weighted_residuals(truth, run, nuisance), expected)
    point = PickledConfig(truth), nuisance
    found = linearized_by_tangents(TangentTask(run, point, (point,), -1, 0.0, ()))
    assert found is not None and np.array_equal(found[0], expected)


@pytest.mark.parametrize(('steeper', 'is_one'), [(1e9, True), (1e60, False)])
def test_a_tangent_that_the_smallest_step_would_pass_is_none(steeper, is_one, monkeypatch):
    """Where a run is as good as a jump: differences of finite steps tell then where to go."""
    truth, nuisance = config(), Nuisance(0.0, (0.2, 0.7))
    run, point = fit_data(recording(truth, command(1, 8.0), rate=4.0), NOISE), (PickledConfig(truth), nuisance)
    moved = PickledConfig(scaled(truth, beam__E=1.0 + 1e-6)), nuisance
    whole = run_tangents.sensitivities_of

    def exploding(task):
        found = whole(task)
        return replace(found, tangents=steeper * found.tangents)

    monkeypatch.setattr(run_tangents, 'sensitivities_of', exploding)
    assert (linearized_by_tangents(TangentTask(run, point, (moved,), -1, 0.0, ())) is not None) == is_one


@pytest.mark.parametrize('delay', [0.03, 0.5])
def test_delay_shows_the_state_before(delay):
    truth = config(solver__rtol=1e-7)
    run = recording(truth, command(2), delay=delay)
    shown = predict(truth, run, Nuisance(delay=delay))
    for name, measured in run.channels.items():
        np.testing.assert_allclose(shown[name], measured, rtol=1e-6, atol=1e-3 * NOISE[name])


def test_negative_delay_looks_ahead():
    truth, run = config(), recording(config(), command(3))
    ahead = predict(truth, run, Nuisance(delay=-0.05))['alpha']
    np.testing.assert_allclose(ahead[:-1], predict(truth, run)['alpha'][1:], atol=1e-6)


@pytest.mark.parametrize('model', ['hybrid', 'mas'])
def test_start_spans_the_hysteresis(model):
    """Start 0 is on sigma_A, 1 on sigma_M, in each wire."""
    given = config(model, solver__rtol=1e-7)
    wire = wire_constants(given.parameters)
    run = recording(given, module_input([0, 0.2], [0, 0]))
    for start, stress in (((0.0, 0.0), sigma_A), ((1.0, 1.0), sigma_M)):
        shown = predict(given, run, Nuisance(start=start))
        for channel in ('F_1', 'F_2'):
            assert shown[channel][0] == pytest.approx(wire.n * wire.section * stress(298.0, wire), rel=1e-6)
    mixed = predict(given, run, Nuisance(start=(0.0, 1.0)))
    assert mixed['F_1'][0] > mixed['F_2'][0] + 1.0


def test_missing_samples_do_not_count():
    truth = config()
    run = recording(truth, command(4), noise=1.0)
    holes = {name: np.where(np.arange(len(v)) % 3 == 0, np.nan, v) for name, v in run.channels.items()}
    del holes['F_2']
    prepared = fit_data(replace(run, channels=holes), NOISE)
    residuals = weighted_residuals(truth, prepared)
    assert prepared.channels == ('U_x', 'U_y', 'alpha', 'F_1')
    assert prepared.samples == sum(int(np.isfinite(v).sum()) for v in holes.values())
    assert (residuals[:, ::3] == 0.0).all()
    for error in error_over_noise(residuals, prepared).values():
        assert error == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize('fraction', [0.2, 0.9])
def test_sampled_commands_may_have_switched_before_their_row(fraction):
    """A command sampled at 10 Hz; the truth switches a known part of the interval before each row."""
    rate, rows = 10.0, np.arange(201) / 10.0
    level = np.select([rows < 3.0, rows < 8.0, rows < 14.0], [0.0, 12.0, -9.0], 5.0)
    truth = module_input(
        [0.0, 3.0 - fraction / rate, 8.0 - fraction / rate, 14.0 - fraction / rate, 20.0], [0.0, 12.0, -9.0, 5.0, 5.0]
    )
    given = config(solver__rtol=1e-7)
    made = recording(given, truth)
    sampled = replace(made, source=module_input(rows, level), exact_commands=False)
    shown = predict(given, sampled, Nuisance(switches=(fraction,) * 3))
    late = predict(given, sampled)
    for name, measured in made.channels.items():
        np.testing.assert_allclose(shown[name], measured, rtol=1e-6, atol=1e-4 * NOISE[name])
        assert np.abs(late[name] - measured).max() > NOISE[name]


@pytest.mark.parametrize('told', [0, 1, 2])
def test_changes_that_are_known_stay_beside_those_that_were_only_sampled(told):
    """The second of three rows that tell when the command changed was lost, say: its level must not be."""
    fraction, instants, levels = 0.3, np.array([3.0, 8.0, 14.0]), np.array([0.0, 12.0, -9.0, 5.0])
    exact = instants - 0.1 * fraction * (np.arange(3) != told)
    given = config(solver__rtol=1e-7)
    made = recording(given, module_input([0.0, *exact, 20.0], [*levels, levels[-1]]))
    source = module_input([0.0, *np.sort([*(instants - 0.1), *instants]), 20.0], [*np.repeat(levels, 2)[:-1], levels[-1]])
    run = replace(made, source=source, exact_commands=False, known_changes=(instants[told],))
    assert fit_data(run, NOISE).groups == 2
    shown = predict(given, run, Nuisance(switches=(fraction,) * 2))
    for name, measured in made.channels.items():
        np.testing.assert_allclose(shown[name], measured, rtol=1e-6, atol=1e-4 * NOISE[name])


def test_strain_stays_where_it_was_when_sampled_heating_moves():
    rows = np.arange(101) / 10.0
    source = wire_input(rows, 0.02 + 0.002 * rows, np.where(rows < 5.0, 0.0, 0.3))
    run = Recording('wire', 'wire', rows[1:], {'stress': np.zeros(100)}, source, exact_commands=False)
    given = config(system='wire', solver__rtol=1e-7)
    moved = wire_input(
        np.insert(rows, 50, 4.95),
        np.insert(0.02 + 0.002 * rows, 50, 0.0299),
        np.insert(np.where(rows < 5.0, 0.0, 0.3), 50, 0.3),
    )
    expected = simulate(Model(given), moved, rows[1:])['stress_Pa']
    np.testing.assert_allclose(predict(given, run, Nuisance(switches=(0.5,)))['stress'], expected, rtol=1e-6)


def test_many_sampled_changes_share_one_fraction():
    rows = np.arange(101) / 10.0
    run = recording(config(), module_input(rows, np.sin(rows)))
    assert fit_data(replace(run, exact_commands=False), NOISE).groups == 1
    assert fit_data(run, NOISE).groups == 0


def test_what_is_missing_is_said():
    run = recording(config(), command(5))
    with pytest.raises(UserError, match='channel F_2.*noise_std'):
        fit_data(run, {name: noise for name, noise in NOISE.items() if name != 'F_2'})
    with pytest.raises(UserError, match='no channel'):
        fit_data(replace(run, channels={}), NOISE)
    with pytest.raises(UserError, match="no channel 'stress'; it may have U_x"):
        replace(run, channels={'stress': run.channels['F_1']})
    pulled = Recording('pulled', 'wire', np.arange(3.0), {'strain': np.zeros(3)}, wire_input([0.0, 2.0], [0.0, 0.01]))
    with pytest.raises(UserError, match='no channel strain'):  # another bench of a wire has it
        weighted_residuals(Config(system='wire'), fit_data(pulled, {'strain': 1.0}))


@pytest.mark.skipif(not REFERENCE.is_dir(), reason='the reference trajectories are not here')
@pytest.mark.parametrize('model', ['hybrid', 'mas'])
def test_reference_is_predicted(model):
    given = read_columns(REFERENCE / 'module_random_a_input.csv', ['time_s', 'J_eq_W'])
    columns = {'U_x': 'U_x_m', 'U_y': 'U_y_m', 'alpha': 'alpha_rad'}
    seen = read_columns(REFERENCE / f'module_random_a_{model}.csv', ['time_s', *columns.values()])
    source = module_input(given['time_s'], given['J_eq_W'])
    inside = seen['time_s'] <= source.times[-1]
    run = Recording('random_a', 'module', seen['time_s'][inside], {k: seen[c][inside] for k, c in columns.items()}, source)
    start = config(model, initial__x_M_1=0.561235873, initial__x_M_2=0.561235873)
    prepared = fit_data(run, NOISE)
    errors = error_over_noise(weighted_residuals(start, prepared), prepared)
    assert max(errors.values()) < 0.1


def test_parameters_that_take_no_end_of_steps_are_given_up():
    """A martensite stiffer than austenite: the beam rings for ever. Ordinary ones reach the end however small the error."""
    run = recording(config(), command(3), rate=10.0)
    for rtol in (1e-4, 1e-6, 1e-9):
        assert np.isfinite(predict(config(solver__rtol=rtol), run)['U_y']).all()
    with pytest.raises(SimulationError, match='step limit reached'):
        predict(scaled(config(), wire__E_A=0.18, wire__eps_T=0.46), fit_data(run, NOISE, step_limited=True))
    assert step_limit(run.source, step_limited=False) > 10 * step_limit(
        run.source, step_limited=True
    )  # a model that was chosen may ring


@pytest.mark.parametrize('kinetics', ['hybrid', 'mas'])
@pytest.mark.parametrize('noise', [1.0, 0.03])
def test_errors_of_the_solver_stay_hidden_in_the_noise_of_a_search(kinetics, noise):
    """Else a fit takes them for an effect: recordings of a node have no noise but a ten-thousandth of their range."""
    channels = ('alpha', 'U_y', 'F_1')
    run = recording(config(kinetics), command(1), 20.0, 0.0, channels=channels)
    dataset = Dataset((run,), {name: noise * NOISE[name] for name in channels})
    problem = problem_for(dataset, config(kinetics), FitOptions(free=('beam.E',)), 1)
    rtol = problem.config.parameters['solver.rtol']
    shown = predict(config(kinetics, solver__rtol=rtol), run)
    errors = [np.sqrt(np.mean((shown[name] - run.channels[name]) ** 2)) / dataset.noise_std[name] for name in channels]
    assert SEARCH_RTOL <= rtol <= SEARCH_RTOL * LOOSER[kinetics] and max(errors) < 0.05
    if noise == 1.0:
        assert rtol == SEARCH_RTOL * LOOSER[kinetics]
