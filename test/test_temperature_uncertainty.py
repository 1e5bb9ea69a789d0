"""What isobaric tests show beyond the uncertainty of the specimen's temperature."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from test_variants import candidate

from sma_sim.evidence.estimation.temperature_uncertainty import distance
from sma_sim.evidence.model_selection import candidate_fit

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


@pytest.mark.parametrize(('beyond', 'taken'), [(float('nan'), True), (0.3, True), (0.08, False)])
def test_what_an_uncertain_temperature_explains_is_no_finding(beyond, taken):
    one = replace(candidate('polycrystal', 1.5), beyond_temperature=beyond)
    assert one.predicts_better and one.acceptable == taken
    only_noise = replace(one, error_reduction=0.0)
    assert only_noise.leaves_only_noise and not only_noise.predicts_better and only_noise.acceptable == taken


@pytest.mark.parametrize(('left', 'expected'), [(0.7, (0.7 - 0.2) / 3.4), (4.0, float('nan'))])
def test_it_is_asked_only_where_a_homogeneous_wire_may_leave_as_much(monkeypatch, left, expected):
    monkeypatch.setattr(candidate_fit, 'error_beyond_temperature', lambda one: one.beyond)
    base = SimpleNamespace(beyond=left, error=3.4, problem=SimpleNamespace(span=60.0))  # 5 % of it: 3
    found = candidate_fit.gain_beyond_temperature(base, SimpleNamespace(beyond=0.2))
    assert found == pytest.approx(expected, nan_ok=True)
