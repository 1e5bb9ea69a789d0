"""Heat capacity and heat transfer that a thermometer on a wire shows, where a fit starts from."""

import numpy as np
import pytest

from sma_sim import Config, Dataset, FitOptions, Model, PhysicsWarning, Recording, calibrate, simulate, wire_input
from sma_sim.evidence.estimation.heat_balance import shown_by_warming
from sma_sim.evidence.estimation.prepared_fit import started_from_warming

HELD = wire_input([0.0, 10.0, 40.0, 80.0], [0.0] * 4, [0.0, 0.06, 0.0, 0.0])  # warms up by a few kelvin


def warmed(values, rate=5.0, noise=0.05):
    """A wire at rest that is heated below its transformation, as a thermometer shows it."""
    config = Config({f'wire.{name}': value for name, value in values.items()}, 'wire')
    run = simulate(Model(config), HELD, rate)
    T = run['T_K'] + noise * np.random.default_rng(0).normal(size=len(run.time))
    return Dataset((Recording('a', 'wire', run.time, {'T': T}, HELD),), {'T': noise})


@pytest.mark.parametrize('values', [{}, {'c_V': 4000.0}, {'lambda': 30.0, 'c_V': 1500.0}])
def test_warming_shows_capacity_and_transfer_however_far_from_nominal(values):
    shown = shown_by_warming(warmed(values), Config(system='wire'))
    true = Config({f'wire.{name}': value for name, value in values.items()}, 'wire').parameters
    assert shown['wire.lambda'] == pytest.approx(true['wire.lambda'], rel=0.15)
    assert shown['wire.c_V'] == pytest.approx(true['wire.c_V'], rel=0.5 if not values else 0.15)


def test_a_fit_of_few_samples_starts_from_what_warming_shows():
    """Ten times slower than nominal, sampled every four seconds: at nominal values no sample depends on the capacity."""
    dataset = warmed({'c_V': 4000.0, 'lambda': 100.0}, rate=0.25)
    options = FitOptions(free=('wire.c_V', 'wire.lambda'), kinetics='hybrid', intervals=False)
    found = calibrate(dataset, Config(system='wire'), options)
    assert found.error < 1.3
    assert found.values['wire.c_V'] == pytest.approx(4000.0, rel=0.1)


def test_a_wire_that_warms_much_beside_itself_is_fitted_and_said():
    """A hundred times the heat capacity of NiTi, as of a wire in a fabric: a fit from the default reaches twelve times."""
    with pytest.warns(
        PhysicsWarning, match=r'wire.c_V: the warming of the wire shows 3.*e\+04 J/\(kg K\).*380, is out of reach'
    ):
        found = calibrate(warmed({'c_V': 38000.0}, noise=0.005), Config(system='wire'), FitOptions(kinetics='hybrid'))
    assert found.error < 1.1 and found.values['wire.c_V'] == pytest.approx(38000.0, rel=0.05)
    assert found.uncertainty is not None
    seen = {one.name for one in found.uncertainty.intervals if one.seen}
    assert seen <= {'wire.c_V', 'wire.lambda'}


def test_a_value_that_was_given_stays_whatever_warming_shows():
    given = Config({'wire.c_V': 450.0, 'wire.lambda': 500.0}, 'wire')
    assert started_from_warming(warmed({'c_V': 38000.0}, noise=0.005), given) == given


def test_where_no_heating_was_commanded_nothing_is_shown():
    cold = Recording(
        'a', 'wire', np.arange(20.0), {'T': 298.0 + np.arange(20.0)}, wire_input([0.0, 20.0], [0.0, 0.0], [0.0, 0.0])
    )
    assert shown_by_warming(Dataset((cold,), {'T': 0.1}), Config(system='wire')) == {}
