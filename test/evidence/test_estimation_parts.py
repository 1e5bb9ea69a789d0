"""Small parts of fits and of what is said of them, each against what it must be."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from sma_sim import Config, Recording, module_input
from sma_sim.evidence.estimation.calibrate import limits_reached
from sma_sim.evidence.estimation.free_parameters import choose_free, free_parameter
from sma_sim.evidence.estimation.levenberg_marquardt import secant_update
from sma_sim.evidence.estimation.plausibility import is_form, plausible_range
from sma_sim.evidence.estimation.problem import LinearizedRun, assembled, difference_points
from sma_sim.evidence.estimation.recording_differences import zeros_of
from sma_sim.evidence.estimation.residuals import elapsed, fit_data
from sma_sim.evidence.estimation.run_estimates import score_overdispersion, shown_value
from sma_sim.model.effects.discovery import find_effects
from sma_sim.model.parameters import Parameter
from sma_sim.model.program_parameters import DEFAULTS


@pytest.fixture
def run():
    times = np.linspace(3.0, 7.0, 41)
    source = module_input(times, np.zeros(41))
    return fit_data(
        Recording('run', 'module', times, {'alpha': np.zeros(41), 'U_y': np.zeros(41)}, source), {'alpha': 1.0, 'U_y': 1.0}
    )


def test_a_secant_update_agrees_with_its_step_and_keeps_the_rest():
    """Broyden: the changed derivatives give the change that was seen, and what they say across the step stays."""
    random = np.random.default_rng(0)
    run = LinearizedRun(np.array([0, 2, 3]), random.normal(size=(2, 5)), random.normal(size=(3, 2, 5)))
    step, shown = random.normal(size=4), random.normal(size=(2, 5))
    own = step[run.indices]
    across = np.cross(own, random.normal(size=3))
    for taken in (True, False):
        updated = secant_update(run, step, shown, taken)
        assert np.tensordot(own, updated.jacobian, 1) == pytest.approx(shown - run.residuals)
        assert np.tensordot(across, updated.jacobian, 1) == pytest.approx(np.tensordot(across, run.jacobian, 1))
        assert (updated.residuals == (shown if taken else run.residuals)).all()


def test_differences_go_away_from_an_upper_bound_and_to_both_sides_if_central():
    part, low, high, steps = np.array([0.0, 1.0, 0.5]), -np.ones(3), np.array([1.0, 1.0, 0.5]), np.full(3, 0.1)
    one_sided = difference_points(part, low, high, steps, False)
    assert [(j, round(at[j] - part[j], 9)) for j, at in one_sided] == [(0, 0.1), (1, -0.1), (2, -0.1)]
    central = difference_points(part, low, high, steps, True)
    assert [(j, round(at[j] - part[j], 9)) for j, at in central] == [(0, 0.1), (0, -0.1), (1, -0.1), (2, -0.1)]


def test_difference_quotients_are_the_slopes_of_a_line():
    """One-sided where only one side could be run, zero where none could."""
    slopes, part = np.array([[[2.0]], [[-3.0]], [[5.0]]]), np.zeros(3)
    moves = [(j, sign * 0.1 * np.eye(3)[j]) for j in range(3) for sign in (1.0, -1.0)]
    found = [np.full((1, 1), 7.0), *(7.0 + np.tensordot(at, slopes, 1) for _, at in moves)]
    found[3] = found[5] = found[6] = None  # one side of the second, both of the third
    linear = assembled(SimpleNamespace(name='run'), part, np.arange(3), moves, found)
    assert linear.jacobian == pytest.approx(slopes * [[[1.0]], [[1.0]], [[0.0]]])
    assert linear.residuals == 7.0


def test_parameters_at_a_bound_are_named():
    free, _ = choose_free(Config(), ['wire.E_A', 'wire.c_V', 'wire.lambda'])
    z = np.array([free[0].low, 0.5 * free[1].high, free[2].high, 9.0])
    reached = limits_reached(SimpleNamespace(config=Config(), shared=free, runs=()), z, ())
    assert [limit.name for limit in reached] == ['wire.E_A', 'wire.lambda']
    assert reached[1].value == reached[1].high == free[2].value(free[2].high)


def test_a_drift_is_counted_from_the_middle_of_a_recording(run):
    assert elapsed(run) == pytest.approx(np.linspace(-0.5, 0.5, 41))


def test_a_zero_of_one_channel_is_no_drift_and_no_zero_of_others(run):
    changed = zeros_of({'U_y': 2e-5}).in_run(run)
    zeros = dict(zip(run.channels, changed.zero_std, strict=True))
    assert zeros == {'alpha': 0.0, 'U_y': 2e-5} and changed.drift_std == (0.0, 0.0)
    drifting = replace(run, zero_std=(3e-4, 1e-3), drift_std=(0.0, 1e-4))
    again = zeros_of({'U_y': 2e-5}).in_run(drifting)
    known = dict(zip(run.channels, drifting.zero_std, strict=True))
    assert dict(zip(run.channels, again.zero_std, strict=True)) == known | {'U_y': 2e-5}
    assert again.drift_std == drifting.drift_std


def test_values_of_a_recording_have_errors_in_their_unit():
    """A standard error of the logarithm is a part of the value."""
    log = free_parameter('wire.c_V', 380.0, DEFAULTS['wire.c_V'])
    linear = free_parameter('wire.T', 300.0, replace(DEFAULTS['environment.T_E'], neutral=300.0))
    assert log.log and not linear.log
    value, std = shown_value(log, 0.3, 0.1)
    assert (value, std) == (log.value(0.3), pytest.approx(log.value(0.3) * log.scale * 0.1))
    assert shown_value(linear, 0.3, 0.1) == (linear.value(0.3), pytest.approx(linear.scale * 0.1))
    assert shown_value(log, 10.0 * log.high, 0.1)[0] == log.value(log.high)


def test_all_realistic_values_are_within_the_reach_of_a_fit():
    """Also where a value is far outside, as of an effect that was given so: a thousand times too much is no limit."""
    k = Parameter('k', 5e-3, 'W/K', (0.0, 10.0), '', neutral=0.0, realistic=(1e-4, 1e-2))
    far, usual = free_parameter('effects.fin.k', 1.0, k), free_parameter('effects.fin.k', k.default, k)
    assert far.value(far.low) <= k.realistic[0] and far.value(far.high) > 1.5
    assert usual.scale == pytest.approx(0.5 * (k.realistic[1] - k.realistic[0]))


def test_scatter_is_counted_beside_the_unknowns_that_were_fitted(run):
    """White residuals whose squares were lowered by fitting are no less than noise; at most half of them is."""
    random = np.random.default_rng(1)
    white = random.normal(size=(2, 41))
    few, many, most = (score_overdispersion(run, 2.0 * white, unknowns, False) for unknowns in (0, 20, 80))
    assert many == pytest.approx(few / (1.0 - 20.0 / 82.0)) and most == pytest.approx(2.0 * few)
    assert score_overdispersion(run, 0.1 * white, 0, False) == 1.0


def test_numbers_that_form_a_law_are_told_from_strengths():
    """A strength has a neutral value; a size that has none has a unit. Only a form may have any value that fits."""
    effects = find_effects()
    forms = {f'{name}.{p.name}' for name, one in effects.items() for p in one.parameters if is_form(p)}
    assert {'natural_convection.m', 'smooth_transformation.start_A', 'functional_fatigue.S_0'} & forms
    assert not {'gravity.g_y', 'natural_convection.k', 'driver_lag.tau', 'latent_heat_scale.k'} & forms
    for name, effect in (('m', 'natural_convection'), ('tau', 'driver_lag')):
        (p,) = (p for p in effects[effect].parameters if p.name == name)
        free = free_parameter(f'effects.{effect}.{name}', p.default, p)
        low, high, reason = plausible_range(free, p)
        assert reason == 'realistic' and low < free.coordinate(p.default) < high
        if is_form(p):
            assert (low, high) == (free.low, free.high)
        else:
            width = p.realistic[1] - p.neutral
            assert free.value(high) == pytest.approx(p.realistic[1] + 0.1 * width)
