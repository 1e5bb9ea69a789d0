"""Diagnoses of simulated benches with nuisances: nothing is invented where nothing is missing."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / 'benchmarks'))
import benches


@pytest.mark.slow
@pytest.mark.parametrize(
    ('kind', 'number'),
    [
        ('tensile', 810),  # a transformation strain far from the nominal one
        ('tensile', 814),  # a load cell whose drift is far out in its prior
        ('blocked', 907),  # valleys where zeros and drifts of the force hide a wrong beginning
        ('blocked', 911),  # a held-out run that goes further
        ('slider', 800),  # another room for each recording
        ('slider', 809),  # closer to the model than repeats are to each other
        ('slider', 920),  # rooms that an effect imitates in the fitted recordings
    ],
)
def test_nothing_is_missing_on_a_bench_with_nuisances(kind, number):
    found = benches.diagnosed(kind, [], number)
    assert found['verdict'] == 'none' and found['effects'] == []


@pytest.mark.slow
def test_an_effect_is_found_among_nuisances():
    found = benches.diagnosed('tensile', ['polycrystal'], 900)
    assert found['verdict'] == 'missing_effect' and found['effects'] == ['polycrystal']
