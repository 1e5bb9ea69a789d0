"""What isobaric tests show beyond the uncertainty of the specimen's temperature."""

import numpy as np
import pytest

from sma_sim.evidence.estimation.temperature_uncertainty import distance

T = np.concatenate([np.linspace(300.0, 340.0, 161), np.linspace(340.0, 300.0, 161)[1:]])
HEATING = np.arange(len(T)) < 161


def transformed(width):
    """Strain of a wire that turns back over a width [K] about 325 K and forms about 315 K."""
    middle = np.where(HEATING, 325.0, 315.0)
    return 0.04 * np.clip(0.5 - (T - middle) / max(width, 1e-9), 0.0, 1.0)


@pytest.mark.parametrize('width', [0.0, 1.0, 3.9])
def test_gradual_transformation_within_the_uncertainty_is_none(width):
    assert distance(transformed(width), transformed(0.0), T, 2.0) == pytest.approx(0.0)


def test_beyond_it_the_distance_is_that_of_the_tails():
    """Of a ramp of 12 K from a step in its middle, all but 2 K on either side of the step."""
    measured, away = transformed(12.0), distance(transformed(12.0), transformed(0.0), T, 2.0)
    middle = np.where(HEATING, 325.0, 315.0)
    expected = np.where(np.abs(T - middle) > 2.25, np.minimum(measured, 0.04 - measured), 0.0)
    clear = np.abs(np.abs(T - middle) - 2.0) > 0.5
    assert away[clear] == pytest.approx(expected[clear])
    assert away.max() > 0.01


def test_an_offset_of_strain_is_no_temperature():
    flat = np.full(len(T), 0.01)
    assert distance(flat + 1e-3, flat, T, 2.0) == pytest.approx(1e-3)
