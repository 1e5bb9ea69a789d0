"""Random commands, parameters and tolerances: no failure, no NaN, no run that takes far more steps than its like."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / 'benchmarks'))
from robustness import TOLERANCES, judge, run_all


@pytest.mark.parametrize('rtol', TOLERANCES)
def test_random_runs(rtol):
    result = judge(run_all(40, [rtol]))[f'rtol {rtol:g}']
    assert result['failed'] == 0
    assert result['most_over_median'] <= 20.0
