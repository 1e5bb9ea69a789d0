"""No run of effects in their realistic ranges stalls; one that has to stop says why, after a fixed number of steps."""

import sys
from pathlib import Path

import numpy as np
import pytest
from systems import active, make_model

from sma_sim import Config, Model, find_effects, module_input, simulate
from sma_sim.model.layout import O_S_A, O_S_M, InputPoint
from sma_sim.model.system import flow
from sma_sim.model.transformation import half_of_height
from sma_sim.solver.effect_table import own_scratch
from sma_sim.solver.end_of_run import stop_reason
from sma_sim.solver.integrate import N_TIGHTENED, RATE_NOT_FINITE, WINDOW
from sma_sim.solver.model import new_findings

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / 'benchmarks'))
from fuzz_effects import TIMES, fuzz  # noqa: E402

HELD = module_input([0.0, 40.0], [30.0, 30.0])


def test_hysteresis_that_narrows_with_temperature_is_followed():
    narrowing = active('clausius_clapeyron_mismatch', delta=-4.1e5)
    run = simulate(make_model('module', 'mas', [narrowing], solver__rtol=6e-5), HELD, 10.0)
    assert run.completed and run.steps < 2_000
    assert run['T_1_K'].max() > 420.0  # where in proportion to T the hysteresis would have been inverted


def test_height_of_the_hysteresis_falls_smoothly_to_its_limit():
    """In proportion to what effects take away down to a fifth, then slower and slower; whatever they take, 5 % are left."""
    dsigma = 1.23e7

    def height(change):
        return 1.0 + 2.0 * half_of_height(change * dsigma, dsigma) / dsigma

    assert height(0.0) == 1.0 and height(3.0) == 4.0 and height(-0.75) == pytest.approx(0.25)
    assert height(-0.8 + 1e-9) == pytest.approx(height(-0.8 - 1e-9), abs=1e-8)
    slopes = [(height(-0.8 + h + 1e-6) - height(-0.8 + h)) / 1e-6 for h in (1e-5, -1e-5)]
    assert slopes == pytest.approx([1.0, 1.0], rel=1e-3)
    heights = [height(change) for change in np.linspace(-0.8, -1e3, 100)]
    assert sorted(heights, reverse=True) == heights and heights[-1] == pytest.approx(0.05)


def test_a_stalled_run_stops_and_says_why():
    run = simulate(Model(Config(kinetics='mas').variant({'wire.dsigma': 10.0})), HELD, 10.0)
    assert not run.completed and run.steps <= 5 * WINDOW
    for words in ('stalled', 'the hysteresis of wire 1 is only', 'check wire.dsigma', 'hybrid model'):
        assert words in run.reason
    assert np.isfinite(run['alpha_rad']).all()


@pytest.mark.parametrize('kinetics', ['hybrid', 'mas'])
@pytest.mark.parametrize('delta', [-1.5e5, 1e6])
def test_two_effects_that_would_close_the_hysteresis_leave_a_part_of_it(kinetics, delta):
    """Above T0 and below: upside down, MAS rates are beyond all numbers, and the hybrid model jumps to and fro."""
    closing = [
        active('smooth_transformation', width_A=7e8, width_M=1.4e9, start_A=7.0, end_A=24.0, start_M=5.0, end_M=8.0),
        active('clausius_clapeyron_mismatch', delta=delta),
    ]
    model = make_model('module', kinetics, closing)
    run = simulate(model, module_input([0.0, 3.0, 8.0, 12.0], [15.0, -18.0, 1.0, 1.0]), 10.0)
    assert run.completed and run.steps < 5_000
    p, y = model.compiled, run.state.state.y
    found, at_rest = new_findings(p), InputPoint(np.zeros(2), np.zeros(2))
    flow(0.0, run.state.state, at_rest, own_scratch(p), np.zeros(len(y)), found)
    assert (found[:, O_S_A] - found[:, O_S_M]).min() > 0.05 * p.wire.dsigma


def test_stresses_without_a_barrier_are_said_where_rates_are_beyond_all_numbers():
    """The reason evaluates the equations as plain Python, where an exponential that is too large is an error."""
    model = make_model('module', 'mas', [active('polycrystal', spread=9e9)])
    run, p = simulate(model, module_input([0.0, 1.0], [0.0, 0.0]), 10.0).state, model.compiled
    run.state.y[p.first_x] = 0.01
    with pytest.raises(OverflowError):
        at_rest = InputPoint(np.zeros(2), np.zeros(2))
        flow(0.0, run.state, at_rest, own_scratch(p), np.zeros(len(run.state.y)), new_findings(p))
    assert 'of wire 1 has come to -' in stop_reason(RATE_NOT_FINITE, model, run)


@pytest.mark.parametrize('kinetics', ['hybrid', 'mas'])
def test_a_beam_that_gives_way_says_so(kinetics):
    """A beam that softens so much has no stable pose under the pull of the wires."""
    softening = active('beam_nonlinearity', b=-3.0, c=1.2)
    run = simulate(make_model('module', kinetics, [softening]), HELD, 10.0)
    assert not run.completed and run.steps <= 5 * WINDOW
    assert 'the beam has lost its stability' in run.reason and 'structure_force' in run.reason


@pytest.mark.parametrize('kinetics', ['hybrid', 'mas'])
@pytest.mark.parametrize('c', [0.0, 0.6, 1.2])
def test_a_beam_that_softens_within_its_realistic_range_does_not_give_way(kinetics, c):
    """The moment grows with the curvature everywhere, from the root to the plate: L |kappa| < 1/sqrt(-3 b)."""
    b = find_effects()['beam_nonlinearity'].parameters[0].realistic[0]
    model = make_model('module', kinetics, [active('beam_nonlinearity', b=b, c=c)])
    run = simulate(model, HELD, np.linspace(0.0, 40.0, 401))
    L, U_y, alpha = model.constants.L, run['U_y_m'], run['alpha_rad']
    ends = 2.0 / L * np.abs([3.0 * U_y - L * alpha, 2.0 * L * alpha - 3.0 * U_y])
    assert b < 0.0 and run.completed and ends.max() < 1.0 / np.sqrt(-3.0 * b)


def test_friction_that_switches_within_the_tolerance_is_resolved():
    """Dry friction of the joint, fully developed at 1 mrad/s: steps that do not see it lead nowhere."""
    effects = [
        active('natural_convection', k=111.86006364497631, m=0.051767826014193837),
        active('joint_friction', M_c=0.135, w_s=0.001),
        active('ambient_heating', R=0.23112452476404693, tau=512.8788203585854),
    ]
    times = [0.0, 3.66229257, 4.6228158, 4.95639348, 12.82200969, 27.63176158, 30.03443367, 39.51046872, 40.0]
    J_eq = [8.54696235, -16.59484085, -29.41556218, 18.18254762, -1.5686328, -23.38712221, -26.06919585, 14.91645645, 10.3]
    model = make_model('module', 'mas', effects, solver__rtol=4.34e-05)
    run = simulate(model, module_input(times, J_eq), TIMES)
    assert run.completed and run.state.count[N_TIGHTENED] == 1
    assert run.steps < 3 * WINDOW


def test_tight_tolerances_do_not_look_stalled():
    run = simulate(make_model('module', solver__rtol=1e-12), module_input([0.0, 1.0], [30.0, 0.0]), 10.0)
    assert run.completed and run.steps > 1_000


def test_random_effects_with_realistic_values():
    """A few of the runs of benchmarks/fuzz_effects.py."""
    numbers = fuzz(0, 60)
    assert numbers['completed'] == 60
    assert numbers['most_steps'] < 20_000


def test_runs_do_not_share_scratch_memory():
    p = make_model(effects=[active('gravity')]).compiled
    mine = own_scratch(p)
    assert mine.effects.s is not p.effects.s and mine.effects.out is not p.effects.out
    assert mine.effects.s.shape == p.effects.s.shape and mine.effects.parameters is p.effects.parameters
