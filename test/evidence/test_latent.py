"""The missing input: it is recovered over time, the port is named, nothing is seen where nothing is missing."""

import json
from contextlib import redirect_stdout
from dataclasses import replace
from io import StringIO

import numpy as np
import pytest
from simulated_data import NOISE, config, dataset

from sma_sim import Config
from sma_sim.challenge.files import write_challenge
from sma_sim.challenge.make import RecordingPlan, make_challenge
from sma_sim.cli import latent as latent_command
from sma_sim.cli.main import main
from sma_sim.evidence.estimation import executors
from sma_sim.evidence.estimation.calibrate import FitOptions
from sma_sim.evidence.estimation.executors import PickledConfig
from sma_sim.evidence.estimation.injection_points import ports_of
from sma_sim.evidence.estimation.residuals import Nuisance, fit_data, weighted_residuals
from sma_sim.evidence.latent_input.hypotheses import confounding_reason, hypotheses_of
from sma_sim.evidence.latent_input.inference import (
    Prior,
    SufficientStatistics,
    best_prior,
    covariance_root,
    posterior_estimate,
    schur_complement,
    squares_in_gaps,
)
from sma_sim.evidence.latent_input.latent_search import LatentRequest, estimate_latent_inputs
from sma_sim.evidence.latent_input.sensitivities import (
    KnotResponseTask,
    binned,
    initialized,
    input_effect,
    knot_grid,
    knot_responses,
    run_segments,
    time_function_at,
    with_rows_at_knots,
)
from sma_sim.report.html.latent_page import quantity
from sma_sim.solver.beginning import AT_REST, Beginning
from sma_sim.words.json_values import finite
from sma_sim.words.latent_input import latent_data, ranking_rows, verdict_sentences

STRUCTURE = config('mas').structure
WARM = Beginning((12.0, 3.0), (2e-4, 1e-3, 0.01), (0.0, 1e-3, 0.0))
BY_NAME = {port.name: port for port in ports_of(config('mas'), STRUCTURE.channels)}


@pytest.fixture(scope='module')
def command(tmp_path_factory):
    """A robot on a shaking table, what `sma-sim latent` found, its exit code, its words, and the folder of its files."""
    case = make_challenge(7, kinds=['shaking_table'], forces=True, plan=RecordingPlan(duration=20.0, rate=10.0))
    home, found = tmp_path_factory.mktemp('latent'), []
    write_challenge(case, home / 'case')

    def kept(*arguments):
        found.append(estimate_latent_inputs(*arguments))
        return found[-1]

    words = ['latent', 'case', '--config', 'case/nominal.yaml', '--model', 'mas', '--json', 'found.json', '-o', 'p.html']
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(StringIO()) as said:
        patch.chdir(home)
        patch.setattr(latent_command, 'estimate_latent_inputs', kept)
        code = main(words)
    return case, found[0], code, said.getvalue(), home


@pytest.fixture(scope='module')
def shaken(command):
    """The robot, and what was found."""
    return command[:2]


def test_a_force_that_shakes_the_plate_is_found_over_time(shaken):
    case, found = shaken
    best = found.findings[0]
    assert found.verdict == 'force_U_y' and found.error > 1.3 and best.error < 1.1
    hidden = {name: value for name, (value, _) in case.answer.effects[0].parameters.items()}
    assert {estimate.run for estimate in best.inputs} == {'run1', 'run2'}
    for estimate in best.inputs:
        truth = hidden['F_0'] * np.sin(2.0 * np.pi * hidden['f'] * estimate.time)
        assert np.corrcoef(estimate.mean, truth)[0, 1] > 0.95
        assert np.mean(np.abs(estimate.mean - truth) < 1.5 * estimate.band) > 0.8


def test_with_nothing_missing_no_port_is_named():
    case = make_challenge(8, effects=0, forces=True, plan=RecordingPlan(duration=20.0, rate=10.0))
    found = estimate_latent_inputs(case.dataset, case.nominal, request=LatentRequest('mas'))
    assert found.verdict == 'none' and found.indistinguishable == {} and found.probability < 0.05
    assert next(iter(verdict_sentences(found))).startswith('none')


def test_a_search_that_was_stopped_at_once_says_nothing_of_ports(shaken, monkeypatch):
    _, found = shaken

    def interrupted(futures):
        raise KeyboardInterrupt

    monkeypatch.setattr(executors, 'wait', interrupted)
    request = LatentRequest(options=FitOptions(free=('beam.E',), kinetics='mas', starts=1, intervals=False))
    stopped = estimate_latent_inputs(dataset(config('mas'), [4, 5], noise=1.0, rate=5.0), config('mas'), request=request)
    assert stopped.config.parameters['solver.rtol'] == config('mas').parameters['solver.rtol']  # that which was asked for
    assert list(verdict_sentences(stopped)) == ['stopped early, before any port was evaluated']
    assert (stopped.verdict, finite(latent_data(stopped))['probability'], stopped.interrupted) == ('stopped', None, True)
    assert 'probability' not in stopped.facts() and quantity(stopped) == 'not known, stopped early'
    assert list(verdict_sentences(replace(found, interrupted=True)))[-1] == 'stopped early'


def test_recordings_that_do_not_begin_at_rest_are_said_to(shaken):
    """What is left of a motion before them passes for an input."""
    _, found = shaken
    (said,) = [line for line in verdict_sentences(replace(found, in_motion=True)) if 'do not begin at rest' in line]
    assert '--in-motion' in said and not any('at rest' in line for line in verdict_sentences(found))
    assert latent_data(replace(found, in_motion=True))['in_motion'] and not latent_data(found)['in_motion']


def without_beginning(recording, cut):
    """What was recorded of a run from a time on, at which it is in motion."""
    source, later = recording.source, recording.time >= cut
    times = np.array([cut, *source.times[source.times > cut]])
    values = source.values[np.searchsorted(source.times, times, side='right') - 1]
    channels = {name: row[later] for name, row in recording.channels.items()}
    moved = replace(source, times=times - cut, values=values)
    return replace(recording, time=recording.time[later] - cut, channels=channels, source=moved)


@pytest.mark.slow
def test_an_input_is_found_in_recordings_that_begin_in_motion():
    """With wires that are warm from before; taken to begin at rest, these pass for an input of their own."""
    case = make_challenge(7, kinds=['shaking_table'], forces=True, plan=RecordingPlan(duration=30.0, rate=10.0))
    cut = tuple(without_beginning(one, 10.0) for one in case.dataset.recordings)
    still, moving = (
        estimate_latent_inputs(
            replace(case.dataset, recordings=tuple(replace(one, in_motion=said) for one in cut)),
            case.nominal,
            request=LatentRequest('mas'),
        )
        for said in (False, True)
    )
    assert still.in_motion and not moving.in_motion
    assert moving.verdict == 'force_U_y' and moving.findings[0].error < 1.1 < moving.error


def test_the_data_of_the_answer(shaken):
    _, found = shaken
    data = json.loads(json.dumps(latent_data(found)))
    assert data['verdict'] == 'force_U_y' and data['ports'][0]['name'] == 'force_U_y'
    course = data['ports'][0]['courses'][0]
    assert len(course['time_s']) == len(course['mean']) == len(course['band_95'])
    assert [row[0] for row in ranking_rows(found)] == [finding['name'] for finding in data['ports']]
    assert 'force on the plate across the beam' in next(iter(verdict_sentences(found)))


@pytest.mark.parametrize('name', ['force_U_x', 'moment_alpha', 'heat_1', 'strain_2', 'stress_1', 'power_2', 'stiffness'])
@pytest.mark.parametrize('model', [pytest.param('hybrid', marks=pytest.mark.slow), 'mas'])
def test_responses_add_up(name, model):
    """The response to an input is about the sum of those to its knots: what the linear model rests on."""
    start = config(model, solver__rtol=1e-9)
    run = fit_data(dataset(start, [4], noise=1.0, rate=10.0).recordings[0], NOISE)
    grid, port = knot_grid(run, 10), BY_NAME[name]
    fixed_run, nuisance = initialized(
        replace(run, source=with_rows_at_knots(run.source, grid.knots)), Nuisance(start=(0.3, 0.3))
    )

    def response(values):
        with_input = replace(start, effects=(input_effect(port, grid, 1e-2 * port.probe * values, STRUCTURE),))
        return binned(
            weighted_residuals(with_input, fixed_run, nuisance) - weighted_residuals(start, fixed_run, nuisance),
            run,
            grid,
        )

    knots = np.eye(len(grid.knots))
    both = response(knots[3] + 0.5 * knots[4])
    apart = response(knots[3]) + 0.5 * response(knots[4])
    assert np.abs(both).max() > 1e-4
    assert np.linalg.norm(both - apart) < 0.1 * np.linalg.norm(both)


@pytest.mark.parametrize('name', ['moment_alpha', 'heat_1', 'strain_2'])
@pytest.mark.parametrize('model', ['hybrid', 'mas'])
@pytest.mark.parametrize('beginning', [AT_REST, WARM], ids=['at rest', 'warm'])
def test_what_an_input_cannot_reach_is_not_simulated_again(name, model, beginning):
    """From the state of the model at an earlier knot a response is what it is from the beginning of the run."""
    run = fit_data(dataset(config(model), [4], noise=1.0, rate=10.0).recordings[0], NOISE)
    grid, port = knot_grid(run, 30), BY_NAME[name]
    fixed_run, nuisance = initialized(
        replace(run, source=with_rows_at_knots(run.source, grid.knots)),
        Nuisance(delay=0.03, start=(0.3, 0.3), beginning=beginning),
    )
    start = config(model)
    parts = run_segments(port, start, fixed_run, nuisance, grid)
    part = parts[3]
    assert part.affected.sum() < 0.7 * len(run.time) and parts[0].affected.all()
    shown = knot_responses(KnotResponseTask(part, fixed_run, grid, PickledConfig(start), nuisance, port))

    def from_the_beginning(values):
        return weighted_residuals(
            replace(start, effects=(input_effect(port, grid, port.probe * values, STRUCTURE),)), fixed_run, nuisance
        )

    for k, knot in enumerate(part.knots):
        hat = np.arange(len(grid.knots)) == knot
        whole = from_the_beginning(hat) - from_the_beginning(0.0 * hat)
        assert np.abs(whole).max() > 0.0
        assert shown[k] == pytest.approx(binned(whole, run, grid), rel=1e-6, abs=1e-9)


def test_a_time_function_goes_through_its_values():
    run = fit_data(dataset(config(), [4], noise=1.0, rate=10.0).recordings[0], NOISE)
    grid = knot_grid(run, 10)
    values = np.random.default_rng(1).normal(size=len(grid.knots))
    assert time_function_at(grid, values, grid.knots) == pytest.approx(values, abs=1e-9)
    middle = grid.knots[:-1] + 0.5 * grid.spacing
    assert time_function_at(grid, values, middle) == pytest.approx(0.5 * (values[1:] + values[:-1]))


def linear_case(random, strength):
    """Rows of S and J, and residuals that a smooth input of a strength leaves, with shifts of what was fitted."""
    t = np.arange(40.0)
    rows = np.vstack([np.exp(-0.5 * ((np.arange(400) / 10.0 - t[:, None]) / 1.5) ** 2), random.normal(size=(3, 400))])
    u = strength * np.sin(t / 4.0)
    r = random.normal(size=400) - u @ rows[:40] - np.array([0.5, -1.0, 0.3]) @ rows[40:]
    smooth = np.exp(-np.abs(t[:, None] - t) / 5.0)
    return rows, r, u, smooth


def products(rows, r):
    return SufficientStatistics(rows @ rows.T, rows @ r, float(r @ r), len(r))


def test_inference_recovers_an_input_and_prefers_the_smooth_prior():
    rows, r, u, smooth = linear_case(np.random.default_rng(2), 3.0)
    whole = products(rows, r)
    gram, share = schur_complement(whole, 40)
    score = share @ whole.score[40:] - whole.score[:40]
    prior = best_prior(gram, score, {'rough': np.eye(40), 'smooth': smooth}, mixed=False)
    assert prior.description == 'smooth' and prior.log_evidence > 50.0 and 5.0 < prior.dof < 40.0
    found = posterior_estimate(whole, prior)
    assert np.mean(np.abs(found.u - u) < 2.0 * found.std) > 0.8
    assert found.squares < 1.2 * 400
    gaps = [products(rows[:, k::5], r[k::5]) for k in range(5)]
    without, with_it = squares_in_gaps(whole, gaps, prior)
    assert with_it < 1.3 * 400 < without


def test_the_evidence_is_that_of_the_gaussian():
    """Against the density of the residuals with everything integrated out."""
    rows, r, _, smooth = linear_case(np.random.default_rng(3), 1.0)
    whole = products(rows, r)
    gram, share = schur_complement(whole, 40)
    prior = best_prior(gram, share @ whole.score[40:] - whole.score[:40], {'smooth': smooth}, mixed=False)

    def log_density(covariance):
        return -0.5 * (np.linalg.slogdet(covariance)[1] + r @ np.linalg.solve(covariance, r))

    nothing = np.eye(400) + rows[40:].T @ rows[40:]
    something = nothing + rows[:40].T @ prior.root @ prior.root.T @ rows[:40]
    assert prior.log_evidence == pytest.approx(log_density(something) - log_density(nothing), rel=1e-6)


def test_gaps_of_noise_are_not_predicted_by_an_input():
    rows, r, _, smooth = linear_case(np.random.default_rng(4), 0.0)
    gaps = [products(rows[:, k::5], r[k::5]) for k in range(5)]
    without, with_it = squares_in_gaps(products(rows, r), gaps, Prior('rough', 3.0 * covariance_root(smooth), 0.0, 0.0))
    assert with_it > without


def test_hypotheses_and_reasons():
    by_name = {hypothesis.name: hypothesis for hypothesis in hypotheses_of(ports_of(config('mas'), ('U_x', 'U_y', 'alpha')))}
    assert {'heat', 'heat_1', 'power', 'sense_alpha', 'force_U_y'} <= set(by_name) and 'sense_F_1' not in by_name
    assert [port.name for port in by_name['stress'].ports] == ['stress_1', 'stress_2']
    assert 'sum of all heat' in confounding_reason(by_name['heat_1'], by_name['power_1'], True)
    assert confounding_reason(by_name['moment_alpha'], by_name['stress'], True) == ''
    assert 'no force is measured' in confounding_reason(by_name['moment_alpha'], by_name['stress'], False)
    assert [found.name for found in hypotheses_of(ports_of(Config(system='wire'), ('stress',)))] == [
        'heat_1',
        'strain_1',
        'stress_1',
        'power_1',
        'sense_stress',
    ]


@pytest.mark.slow
def test_what_is_left_is_simulated_and_tells_the_port():
    """A cap of the power: around the fit that it biases, heat and stress promise too much.

    No temperature is measured: heat over time, whatever it comes from, may imitate it nearly, and is said to then.
    """
    case = make_challenge(8, kinds=['supply_limit'], plan=RecordingPlan(duration=20.0, rate=10.0))
    found = estimate_latent_inputs(case.dataset, case.nominal)
    best, *others = found.findings
    assert found.error > 2.0 and found.verdict == 'power' and best.error < 1.2
    told_apart = [finding for finding in others if finding.name not in found.indistinguishable]
    assert set(found.indistinguishable) <= {'heat'} and all(finding.error > 1.08 * best.error for finding in told_apart)
    assert 0.7 < found.held_out / found.error < 1.3  # a few parameters predict gaps as well as they fit, the cap acts in few
    assert all(finding.error > 1.15 for finding in others if not finding.name.startswith('heat')) and set(
        best.parameters
    ) >= {'wire.lambda', 'beam.E'}
    limit, _ = case.answer.effects[0].parameters['P_max']
    runs = {recording.name: recording.source for recording in case.dataset.recordings}
    rest, true = [], []
    for estimate in best.inputs:
        source = runs[estimate.run]
        command = source.values[np.searchsorted(source.times, estimate.time, side='right') - 1, 0]
        command = np.maximum(command if estimate.port.component == 0 else -command, 0.0)
        lost = (1.0 + (command / limit) ** 4) ** -0.25 - 1.0
        heated = command > 0.2 * limit  # but for a factor of all power, which is as well one of lambda and c_V
        rest.append((estimate.mean - lost)[heated])
        true.append(lost[heated])
    assert np.std(np.concatenate(rest)) < 0.5 * np.std(np.concatenate(true))


@pytest.mark.slow
def test_a_calibrated_model_is_taken_as_it_is(shaken):
    case, fitted = shaken
    found = estimate_latent_inputs(case.dataset, fitted.config, request=LatentRequest(kinetics='mas', fit=False))
    assert found.verdict == 'force_U_y' and found.config.parameters['beam.E'] == fitted.config.parameters['beam.E']


def test_command(command):
    _, _, code, said, home = command
    assert code == 0 and 'force_U_y: a missing force' in said
    assert json.loads((home / 'found.json').read_text())['verdict'] == 'force_U_y'
    assert 'The missing quantity over time' in (home / 'p.html').read_text()
