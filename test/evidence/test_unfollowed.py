"""Fits whose given values are of a robot that hardly moves: no derivative leads from there to one that does."""

from dataclasses import replace

import numpy as np
import pytest

from sma_sim import Dataset, FitOptions, Input, Model, Recording, calibrate, read_config, simulate
from sma_sim.words.fit_remarks import remarks_on

NOMINAL = read_config(words=['system=slider', 'bench.temperature=prescribed', 'wire.r0=2.5e-4'])
TIMES, NOISE = np.arange(0.0, 200.0, 0.5), 1e-5
TRUTH = {
    'slider.k': 40.0,
    'slider.x_0': 0.03,
    'wire.sigma_MW0': 1e8,
    'wire.sigma_T': 4e6,
    'wire.E_A': 4e10,
    'wire.E_M': 2e10,
    'wire.eps_T': 0.045,
}


def in_a_bath(seed=0):
    """A wire against a spring in water that is heated and cooled twice, by 50 K."""
    T = [297.0, 350.0, 297.0, 345.0, 297.0]
    values = np.column_stack([T, np.zeros(5), np.full(5, 298.0)])
    source = Input(np.linspace(0.0, 200.0, 5), values, (True, False, False), NOMINAL.structure.input_columns)
    run = simulate(Model(NOMINAL.variant(TRUTH)), source, TIMES)
    position = run['position_m'] + NOISE * np.random.default_rng(seed).normal(size=len(TIMES))
    return Dataset((Recording('bath', NOMINAL.structure.name, TIMES, {'position': position}, source),), {'position': NOISE})


def test_a_fit_leaves_values_at_which_nothing_moves():
    dataset = in_a_bath()
    found = calibrate(dataset, NOMINAL, FitOptions(kinetics='hybrid', intervals=False))
    assert found.errors_of_constants['position'] > 50.0
    assert found.error < 1.1 and not found.unfollowed


def test_what_a_model_hardly_follows_is_said():
    dataset = in_a_bath()
    options = FitOptions(kinetics='hybrid', intervals=False, free=('slider.b',))
    found = calibrate(dataset, NOMINAL, options)
    assert found.unfollowed == ('position',)
    assert remarks_on(found)[0].startswith('The model hardly follows what was measured, position ')
    assert not any(
        'hardly follows' in remark for remark in remarks_on(replace(found, errors_of_constants={'position': 1e4}))
    )


def test_constants_leave_the_scatter_about_them():
    dataset = in_a_bath()
    (recording,) = dataset.recordings
    found = calibrate(dataset, NOMINAL, FitOptions(kinetics='hybrid', intervals=False, starts=1))
    expected = np.std(recording.channels['position']) / NOISE
    assert found.errors_of_constants['position'] == pytest.approx(expected, rel=1e-6)
