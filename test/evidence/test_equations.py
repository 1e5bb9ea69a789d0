"""Equations of what nobody listed: terms, the files made of them, and the search that finds them."""

import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from threading import Event
from types import SimpleNamespace

import numpy as np
import pytest
from simulated_data import command, config

from sma_sim import Effect, Parameter, find_effects, simulate
from sma_sim.challenge.draw import named_truth
from sma_sim.challenge.make import RecordingPlan, challenge_with, make_challenge
from sma_sim.evidence.data.train_test_split import hold_out_last
from sma_sim.evidence.diagnosis.diagnose import diagnose
from sma_sim.evidence.estimation.calibrate import FitOptions, problem_for
from sma_sim.evidence.estimation.prepared_fit import prepare
from sma_sim.evidence.estimation.problem import start_point
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.model_selection.candidates import with_effect
from sma_sim.evidence.model_selection.nominal_fit import nominal_fit
from sma_sim.evidence.search.beam import search
from sma_sim.evidence.search.equations import has_terms, proposal_of, stabilities
from sma_sim.evidence.search.posterior import posterior_of
from sma_sim.evidence.symbolic_regression.formula import Formula
from sma_sim.evidence.symbolic_regression.locations import locations_for
from sma_sim.evidence.symbolic_regression.term_fits import (
    LinearizedFit,
    TermFit,
    TermTrial,
    VisitedRanges,
    grid_of,
    peak_frequencies,
    shape_grid,
    with_own_responses,
)
from sma_sim.evidence.symbolic_regression.terms import factor, per_unit, times
from sma_sim.evidence.symbolic_regression.universal_term import universal_term
from sma_sim.evidence.symbolic_regression.visited_states import VisitedStates, kernel_fields, term_values
from sma_sim.model.config import read_config
from sma_sim.solver.model import Model

CHANNELS = ('U_x', 'U_y', 'alpha')
LOCATIONS = {location.name: location for location in locations_for(config(), CHANNELS)}
SHAPES = {
    'threshold': 0.02,
    'width': 0.03,
    'wavenumber': 80.0,
    'phase': 0.5,
    'instant': 9.0,
    'time_constant': 4.0,
    'frequency': 0.1,
    'fixed': 1.5,
}
TIMES = np.linspace(0.0, 30.0, 121)

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / 'benchmarks'))
from other_form_truths import FORMS  # noqa: E402


def fit_of(location, term, coefficient):
    """A term with some shapes; thresholds of temperature lie above the ambient one."""
    chosen = next(candidate for candidate in LOCATIONS[location].terms if candidate.name == term)
    shapes = tuple(SHAPES[s.grid] * (1.0 if s.of != 'T' else 400.0 if s.grid == 'width' else 16000.0) for s in chosen.shapes)
    return TermFit(LOCATIONS[location], chosen, shapes, coefficient, 0.0, tuple((0.5 * s, 2.0 * s) for s in shapes))


def shown(model):
    result = simulate(Model(model), command(3, 30.0), TIMES)
    assert result.completed
    return np.array([result['U_y_m'] / 1e-3, result['alpha_rad'] / 0.15])


# Formulas for the nightly tests: each compiles its own effect.
NIGHTLY = (
    ('moment_alpha', 'alpha_wave', 3e-3),
    ('force_U_y', 'oscillation', 0.05),
    ('heat_2', 'T_bump', 0.05),
    ('power', 'J_above', -0.2),
    ('stress_1', 'T_above', 1e5),
    ('sense_U_y', 'settling', 1e-4),
)


@pytest.mark.parametrize(
    ('location', 'term', 'coefficient'),
    [
        ('moment_alpha', 'hinge_leaking', -5e-3),
        ('stiffness', 'slow_mean_temperature', 3e-3),
        ('heat', 'dT_switched', -1e-3),
        ('power_1', 'supply_sag', -0.05),
        ('stress', 'accumulated_transformation', -1e6),
        ('sense_alpha', 'play', 1.0),
        *(pytest.param(*one, marks=pytest.mark.slow) for one in NIGHTLY),
    ],
)
def test_a_formula_in_a_file_is_the_term_that_was_fitted(location, term, coefficient):
    """The universal term and the file come from one text; they must do the same, and nothing with a coefficient of 0."""
    fit = fit_of(location, term, coefficient)
    formula, chooser = Formula((fit,)), universal_term(fit.location.hook, bool(fit.term.rate), config().structure)
    nominal = config()
    compiled = with_effect(nominal, chooser.effect, chooser.values(fit.location, fit.term, coefficient, fit.shapes))
    values = {p.name: p.default for p in formula.parameters}
    written = with_effect(nominal, formula.load(), values)
    neutral = with_effect(nominal, formula.load(), {**values, 'c': 0.0})
    there = shown(compiled)
    assert np.abs(there - shown(nominal)).max() > 1e-3
    assert shown(written) == pytest.approx(there, abs=2e-3 * np.abs(there - shown(nominal)).max() + 1e-6)
    assert shown(neutral) == pytest.approx(shown(nominal), abs=1e-4)


def test_every_term_makes_a_file_that_loads():
    for location in locations_for(config(), (*CHANNELS, 'F_1')):
        for term in location.terms:
            fit = TermFit(
                location, term, tuple(0.5 for _ in term.shapes), -1.2e-3, 0.0, tuple((0.1, 0.9) for _ in term.shapes)
            )
            formula = Formula((fit,))
            effect = formula.load()
            assert isinstance(effect, Effect) and effect.port == location.hook and effect.equation == formula.equation
            strength, *shapes = effect.parameters
            assert strength.neutral == 0.0 and strength.default == -1.2e-3 and all(p.neutral is None for p in shapes)
            assert all(p.bounds[0] < p.default < p.bounds[1] and p.unit and 'unit' not in p.unit for p in effect.parameters)


def test_a_formula_whose_shape_ended_at_its_limit_makes_a_file():
    """Limits are written to fewer digits than values: they may not pass one by that."""
    location, slowest = LOCATIONS['moment_alpha'], 1.0 / 29.975
    (term,) = (one for one in location.terms if one.name == 'oscillation')
    for frequency, limits in ((slowest, (slowest, 2.0)), (2.0003, (0.1, 2.0003))):
        fit = TermFit(location, term, (frequency, 0.5), 1e-3, 0.0, (limits, (-6.0, 9.0)))
        by_name = {p.name: p for p in Formula((fit,)).load().parameters}
        assert by_name['f'].bounds[0] <= by_name['f'].default <= by_name['f'].bounds[1]


def test_a_formula_of_several_terms_keeps_their_names_apart():
    terms = [fit_of('moment_alpha', name, 1e-3) for name in ('hinge_leaking', 'hinge_relaxing', 'alpha_well')]
    effect = Formula(tuple(terms)).load()
    names = [p.name for p in effect.parameters]
    assert names[:3] == ['c_1', 'c_2', 'c_3'] and len(set(names)) == len(names) and effect.states == ('z_1', 'z_2')
    assert np.isfinite(shown(with_effect(config(), Formula(tuple(terms)).load(), {}))).all()


def test_units_of_coefficients():
    assert per_unit('W', 'K') == 'W/K' and per_unit('-', '-') == '-' and per_unit('-', 'K') == '1/K'
    of_unit = {term.unit: term for term in LOCATIONS['moment_alpha'].terms}
    units = [
        times(of_unit[one], replace(of_unit['-'], unit=other)).unit for one, other in (('rad', 's'), ('-', 'K'), ('-', '-'))
    ]
    assert per_unit('N m', units[0]) == 'N m/(rad s)' and units[1:] == ['K', '-']
    assert factor('s.T - s.T_E') == '(s.T - s.T_E)' and factor('max(0.0, s.t - p.t_0)') == 'max(0.0, s.t - p.t_0)'


def test_terms_along_a_run_are_those_of_the_simulator():
    """The state of a slow average, integrated at the samples, beside the exact answer to a step of temperature."""
    term = next(term for term in LOCATIONS['stress'].terms if term.name == 'slow_T')
    time = np.linspace(0.0, 20.0, 201)
    hot = {'T_E_K': np.full(201, 298.0), 'alpha_rad': 0 * time, 'U_x_m': 0 * time, 'U_y_m': 0 * time, 'J_eq_W': 0 * time}
    hot |= {
        f'{kind}_{k}{unit}': np.full(201, value)
        for k in (1, 2)
        for kind, unit, value in (('T', '_K', 308.0), ('F', '_N', 1.0), ('x_M', '', 0.5))
    }
    states = VisitedStates(0, kernel_fields(time, hot, config(), 0))
    assert term_values(term, (4.0,), states) == pytest.approx(10.0 * (1.0 - np.exp(-time / 4.0)), abs=0.1)


def test_a_term_that_overflows_is_not_tried():
    """A rate grows exponentially with the temperature, which is anything where a model is wrong."""
    activated = next(term for term in LOCATIONS['stress'].terms if term.name == 'activated')
    ones = np.ones(3)
    states = VisitedStates(0, {'t': np.arange(3.0), 'T': 900.0 * ones, 'T_E': 300.0 * ones})
    squares = [np.mean(term_values(activated, shapes, states) ** 2) for shapes in ((0.5,), (60.0,))]
    assert squares[0] == np.inf and squares[1] < np.inf


def test_effects_on_the_structure_see_the_temperatures(tmp_path):
    """Alone too: no effect on the wires has put them there before."""
    (tmp_path / 'warm.py').write_text(
        'from sma_sim import Effect, Parameter\n'
        "EFFECT = Effect(name='warm', port='structure_force', equation='', source='', systems=('module',),\n"
        "    parameters=(Parameter('c', 1e-5, 'N m/K', (-1.0, 1.0), '', '', 0.0),),\n"
        '    kernel=lambda s, b, p: (0.0, 0.0, p.c * (s.T + s.T_other - 2.0 * s.T_E)))\n'
    )
    warm = with_effect(config(), find_effects([tmp_path])['warm'], {'c': 2e-5})
    moved = np.abs(shown(warm) - shown(config()))
    assert moved[1, 0] < 1e-6 < 1e-3 < moved[1].max() and isinstance(Parameter, type)


@pytest.mark.parametrize(('tried', 'coefficient'), [(2.0, 0.1), (2.0, -0.1), (0.5, 3.0)])
def test_the_best_terms_count_by_their_own_responses(tried, coefficient):
    """At the strength that was found, if that is less than the one tried. That of every wire is the sum over the wires; what
    cannot be run alone, and what a sensor shows, stays as it was."""
    residuals = np.array([3.0, -1.0, 2.0, 0.5])
    at = min(tried, coefficient, key=abs)
    own = {('heat_1', at): [1.0, 0.0, 0.5, 0.0], ('heat_2', at): [0.0, -1.0, 0.5, 1.0], ('strain_1', at): None}
    asked = []

    def responses(location, trials):
        asked.extend((location.name, trial.coefficient) for trial in trials)
        return [None if own[name] is None else np.array(own[name]) for name in asked[len(asked) - len(trials) :]]

    linearized = SimpleNamespace(
        locations=tuple(LOCATIONS[name] for name in ('heat_1', 'heat_2', 'strain_1', 'sense_alpha')),
        responses=responses,
        projection=SimpleNamespace(products=lambda rows, vector: (rows @ vector, (rows**2).sum(axis=1))),
        projected_residuals=residuals,
    )
    names = ('heat', 'heat_1', 'strain_1', 'sense_alpha')
    fits = [replace(fit_of(name, 'constant', coefficient), error_reduction=7.0, tried=tried) for name in names]
    every, one, strain, sensor = with_own_responses(linearized, fits)
    for fit, response in ((every, np.add(own['heat_1', at], own['heat_2', at])), (one, np.array(own['heat_1', at]))):
        best = np.linalg.lstsq(response[:, None], -residuals, rcond=None)[0][0]
        assert fit.coefficient == pytest.approx(at * best)
        assert residuals @ residuals - fit.error_reduction == pytest.approx(np.sum((residuals + best * response) ** 2))
        assert fit.limits == fits[0].limits
    assert [strain, sensor] == fits[2:] and len(asked) == len(set(asked)) == 3


@pytest.fixture(scope='module')
def ripple():
    """A moment that is periodic in the angle, on short runs, and the equation of the best model for it."""
    case = make_challenge(seed=4, kinds=['harness_ripple'], plan=RecordingPlan(duration=25.0, rate=10.0))
    training, _ = hold_out_last(case.dataset, None)
    with ThreadPoolExecutor(2) as pool:
        context = SearchContext(pool, Event(), variants=False, kinetics=('mas',))
        nominal = nominal_fit(prepare(training, case.nominal, 'mas'), FitOptions(starts=1), context)
        book = search([nominal], context)
        posterior = posterior_of(book)
        assert has_terms(posterior.best), posterior.best.names
        return case, nominal, posterior, proposal_of(posterior.best, nominal, book, posterior, context)


def test_the_equation_of_a_hidden_effect_is_found(ripple):
    case, nominal, posterior, proposal = ripple
    assert nominal.error > 1.1 and posterior.unlisted > 0.99
    assert proposal.formula.location.name == 'moment_alpha' and proposal.formula.variables == ('alpha',)
    assert proposal.fit.error < 1.1 < proposal.error_before
    values = proposal.fit.values_of(proposal.effect)
    true = {name: value for name, (value, _) in case.answer.effects[0].parameters.items()}
    scale = proposal.fit.values['beam.E'] / case.robot.parameters['beam.E']  # of all forces, which only the priors tell
    assert abs(values['c']) == pytest.approx(scale * true['M_0'], rel=0.1)
    assert 2.0 * np.pi / values['k'] == pytest.approx(true['period'], rel=0.05)


@pytest.mark.slow
def test_a_law_is_found_that_two_effects_imitate_where_the_parameters_lie_elsewhere():
    """Stresses that rise by g (T - T_E)^2: an R-phase and another latent heat do the same, at parameters that mean nothing
    without them, where responses to terms mean nothing."""
    case = challenge_with((FORMS['curved_slopes'].truth,), 481, True)
    found = diagnose(case.dataset, case.nominal)
    assert found.verdict == 'unknown_effect' and found.posterior.unlisted > 0.99
    assert found.proposal.formula.name in ('proposed_stress_T_square', 'proposed_stress_T_abs')


@pytest.mark.slow
def test_a_law_is_found_beside_another_equation_that_leaves_nothing():
    """Convection in proportion to x_M: resistance that depends on the state, with another heat capacity, leaves nothing, and
    was named with 0.99. So does power in proportion to x_M, 31 nats behind; the law itself is seen from where that leads."""
    case = challenge_with([named_truth('fraction_convection')], 224322, True, RecordingPlan(3, 60.0, 20.0))
    found = diagnose(case.dataset, case.nominal)
    assert found.verdict == 'unknown_effect' and found.posterior.unlisted > 0.99
    assert found.proposal.formula.name == 'proposed_heat_x_dT'


def test_the_choice_is_as_firm_as_the_data(ripple):
    """Of fits that leave the same none is firmer; one that leaves twice as much is never chosen."""
    _, nominal, _, proposal = ripple
    assert sum(fit.stability for fit in proposal.ranking) == pytest.approx(1.0)
    assert proposal.by_variable['alpha'] > 0.9 and proposal.stability > 0.3
    with ThreadPoolExecutor(2) as pool:
        assert stabilities([proposal.fit, nominal, proposal.fit], pool) == pytest.approx([0.5, 0.0, 0.5])
        assert stabilities([nominal], pool) == pytest.approx([1.0])


def test_the_proposal_as_a_file_runs(ripple, tmp_path):
    *_, proposal = ripple
    values = proposal.fit.values_of(proposal.effect)
    file = proposal.write(tmp_path / 'effects', values, 'a test')
    (tmp_path / 'better.yaml').write_text(f'effects:\n  paths: [effects]\n  active: [{file.stem}]\n')
    read = read_config(tmp_path / 'better.yaml')
    assert read.effects[0].effect.source == 'a test'
    assert read.effects[0].values == pytest.approx(list(values.values()), rel=1e-5)
    assert np.abs(shown(read) - shown(config())).max() > 1e-3


def test_the_quantity_is_drawn_over_its_variable(ripple):
    *_, proposal = ripple
    plot = proposal.plot
    assert (plot.variable, plot.variable_unit, plot.unit) == ('alpha', 'rad', 'N m')
    for run in plot.runs:
        within = np.abs(run.quantity - run.formula) <= 3.0 * run.std + 0.1 * np.abs(run.formula).max()
        assert within.mean() > 0.9


def test_friction_is_tried_against_the_motion_where_it_cannot_drive():
    """Friction with the wrong sign is unstable; half of it and all of it change the same."""
    runs = hold_out_last(
        make_challenge(seed=4, kinds=['gravity'], plan=RecordingPlan(duration=20.0, rate=5.0)).dataset, None
    )[0]
    friction = next(term for term in LOCATIONS['force_U_y'].terms if term.name == 'slide_friction')
    with ThreadPoolExecutor(1) as pool:
        problem = problem_for(runs, config('mas'), FitOptions(free=('beam.E',), starts=1), 1)
        linearized = LinearizedFit(problem, start_point(problem), pool)
        trials = [TermTrial(friction, (3e-4,), c) for c in (0.1, -0.1, -0.05)]
        drives, brakes, half = linearized.responses(LOCATIONS['force_U_y'], trials)
        assert linearized._changes(LOCATIONS['force_U_y'], trials[:1]) == [None]
    assert np.array_equal(drives, -brakes) and np.linalg.norm(brakes) > 1.0
    assert np.linalg.norm(brakes - 2.0 * half) < 0.2 * np.linalg.norm(brakes)


def test_a_constant_variable_has_no_thresholds():
    """The temperature of an isotherm, the power of a wire that nobody heats: no threshold can be found in them."""
    still, moving = np.full(50, 300.0), np.linspace(290.0, 340.0, 50)
    step = next(term for term in LOCATIONS['heat'].terms if term.shapes and {shape.of for shape in term.shapes} == {'T'})
    for values, count in ((still, 0), (moving, 1)):
        ranges = VisitedRanges([VisitedStates(0, {'T': values})], 10.0, ())
        assert min(len(shape_grid(step, ranges)), 1) == count


@pytest.mark.parametrize(('periods', 'samples', 'is_found'), [(1.0, 81, False), (6.0, 81, True), (55.0, 81, False)])
def test_an_oscillation_comes_again_in_a_run_and_is_sampled_twice_a_period(periods, samples, is_found):
    time = np.linspace(0.0, 4800.0, samples)
    run, residuals = SimpleNamespace(time=time), np.sin(2.0 * np.pi * periods * time / time[-1])[None]
    found = peak_frequencies(SimpleNamespace(runs=[run]), [SimpleNamespace(residuals=residuals)])
    assert all(2.0 <= f * time[-1] <= 0.5 * samples for f in found)
    assert any(abs(f * time[-1] - periods) < 0.3 for f in found) == is_found
    shape = next(shape for term in LOCATIONS['heat'].terms for shape in term.shapes if shape.grid == 'frequency')
    assert grid_of(shape, VisitedRanges([], time[-1], found))[1][0] == pytest.approx(2.0 / time[-1])


def test_effect_files_are_loaded_by_several_threads_at_once(tmp_path, monkeypatch):
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path))
    with ThreadPoolExecutor(16) as pool:
        for coefficient in (1e-4, 2e-4, 3e-4, 4e-4):
            formula = Formula((fit_of('moment_alpha', LOCATIONS['moment_alpha'].terms[1].name, coefficient),))
            loaded = list(pool.map(lambda _, formula=formula: formula.load(), range(16)))
            assert {found.parameters[0].default for found in loaded} == {coefficient}
    assert not list(tmp_path.rglob('*.part'))
