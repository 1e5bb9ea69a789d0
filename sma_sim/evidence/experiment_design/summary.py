"""A design as plain data for programs, and what it cannot do in words for people."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from sma_sim.evidence.experiment_design.design import Plan
from sma_sim.evidence.experiment_design.sequences import as_rows


def as_data(plan: Plan) -> dict[str, Any]:
    """Everything, SI units, log evidence in natural units; JSON's types only."""
    times, levels = as_rows(plan.levels, plan.grid)
    return {
        'kind': 'rivals' if plan.rivals else 'parameters',
        'length_s': plan.grid.length,
        'hold_s': plan.grid.hold,
        'sequence': {'time_s': times.tolist(), 'J_eq_W': levels.tolist()},
        'hypotheses': [
            {
                'name': one.name, 'model': one.fitted.problem.config.model, 'log_evidence': one.evidence,
                'error': one.fitted.error * one.factor, 'parameters': one.fitted.values,
            }
            for one in plan.hypotheses
        ],
        'expected_log_evidence_ratio': [
            {'true': one.true, 'rival': one.rival, 'designed': one.designed, 'default': one.default}
            for one in plan.expected
        ],
        'inseparable': [list(pair) for pair in plan.inseparable],
        'parameters': {
            one.name: {
                'std_now': one.now, 'std_default': one.default, 'std_designed': one.designed, 'log': one.log,
                'unit': one.unit,
            }
            for one in plan.knowledge
        },
        'information_nat': {'designed': plan.gains[0], 'default': plan.gains[1]},
        'limits': {
            'power_W': plan.grid.power, 'temperature_K': plan.limits.temperature, 'stress_Pa': plan.limits.stress,
            'from': plan.limits_from,
        },
        'reached': {
            'power_W': plan.reached['power'],
            'temperature_K': plan.reached['temperature'],
            'stress_Pa': plan.reached['stress'],
        },
        'tried': plan.tried,
        'interrupted': plan.interrupted,
        'seconds': plan.seconds,
    }  # fmt: skip


def inseparable_words(plan: Plan) -> Iterator[str]:
    """Which pairs no experiment tells apart, with the number."""
    expected = {(one.true, one.rival): one.designed for one in plan.expected}
    for a, b in plan.inseparable:
        most = max(expected[a, b], expected[b, a])
        yield (
            f'no experiment on these channels tells {a} from {b} apart: the best of {plan.tried} sequences is expected '
            f'to bring a log evidence ratio of {most:.2g} (3 is odds of 20 to 1)'
        )
