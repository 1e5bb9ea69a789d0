"""Compiled against plain Python: the kernels of model, solver and effects mean the same to both."""

import numpy as np
import pytest
from systems import COMBINATIONS, active, make_model

from sma_sim import module_input, simulate, wire_input
from sma_sim.solver.fixed_rate import simulate_fixed_rate

STEPS = module_input([0.0, 0.1, 0.5, 1.0, 1.5], [0.0, 12.0, -12.0, 4.0, 0.0])
LOOP = wire_input([0.0, 0.5, 1.0, 1.5], [0.0, 0.07, 0.01, 0.04], [0.0, 0.3, 0.0, 1.0])
EVERY_PORT = (
    'driver_lag',
    'resistance_feedback',
    'natural_convection',
    'ambient_heating',
    'latent_heat_scale',
    'thermal_expansion',
    'functional_fatigue',
    'polycrystal',
    'guide_friction',
)
OF_THE_MODULE = ('gravity', 'beam_creep', 'sensor_lag', 'sensor_bias')


def same(one, other):
    """Two trajectories, but for the last bits that another compiler may round differently."""
    assert (one.reason, one.steps, one.rejected) == (other.reason, other.steps, other.rejected)
    assert [(jump.wire, jump.guard) for jump in one.jumps] == [(jump.wire, jump.guard) for jump in other.jumps]
    for name, column in one.columns.items():
        assert other[name] == pytest.approx(column, rel=1e-9, abs=1e-12), name


def runs():
    """Every combination without effects and with one at every port; all of the latter but one take half a minute."""
    for system, kind in COMBINATIONS:
        yield pytest.param(system, kind, False, id=f'{system}-{kind}-bare')
        marks = [] if (system, kind) == ('wire', 'hybrid') else [pytest.mark.slow]
        yield pytest.param(system, kind, True, id=f'{system}-{kind}-every port', marks=marks)


@pytest.mark.parametrize(('system', 'kind', 'rich'), list(runs()))
def test_adaptive_runs(interpreted, system, kind, rich):
    names = EVERY_PORT + (OF_THE_MODULE if system == 'module' else ()) if rich else ()
    source = STEPS if system == 'module' else LOOP

    def run():
        return simulate(make_model(system, kind, [active(name) for name in names]), source, np.linspace(0.0, 1.5, 31))

    found = interpreted(run)
    assert found.completed and found.steps > 20
    same(run(), found)


@pytest.mark.parametrize('kind', ['hybrid', 'mas'])
def test_fixed_rate(interpreted, kind):
    def run():
        return simulate_fixed_rate(make_model('module', kind), STEPS, 200.0, 50.0)

    same(run(), interpreted(run))
