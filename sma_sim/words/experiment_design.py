"""A design as plain data for programs, and in tables and sentences for people."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import Any

from sma_sim.evidence.data.display_units import in_display_unit
from sma_sim.evidence.experiment_design.further_channels import FurtherChannel
from sma_sim.evidence.experiment_design.plan import ParameterPrecision, Plan
from sma_sim.evidence.experiment_design.rival_fits import ModelHypothesis
from sma_sim.evidence.experiment_design.sequences import as_rows

TextTable = tuple[Sequence[str], Sequence[Sequence[str]]]  # header and rows


def plan_data(plan: Plan) -> dict[str, Any]:
    """Everything, SI units, log evidence in natural units; JSON's types only."""
    times, levels = as_rows(plan.levels, plan.grid)
    return {
        'kind': 'rivals' if plan.discriminates else 'parameters',
        'length_s': plan.grid.length,
        'hold_s': plan.grid.hold,
        'sequence': {'time_s': times.tolist(), plan.grid.columns[0]: levels.tolist()},
        'hypotheses': [hypothesis_data(hypothesis) for hypothesis in plan.hypotheses],
        'expected_log_evidence_ratio': [asdict(ratio) for ratio in plan.expected],
        'inseparable': [list(pair) for pair in plan.indistinguishable],
        'parameters': {parameter.name: precision_data(parameter) for parameter in plan.precision},
        'information_nat': {'designed': plan.gain.designed, 'default': plan.gain.default},
        'limits': {
            'power_W': plan.grid.power,
            'temperature_K': plan.limits.temperature,
            'stress_Pa': plan.limits.stress,
            'from': dict(plan.limits_from),
        },
        'reached': {
            'power_W': plan.reached['power'],
            'temperature_K': plan.reached['temperature'],
            'stress_Pa': plan.reached['stress'],
        },
        'further_channels': [channel_data(channel) for channel in plan.further_channels],
        'tried': plan.evaluated,
        'in_motion': plan.in_motion,
        'interrupted': plan.interrupted,
        'seconds': plan.seconds,
    }


def hypothesis_data(hypothesis: ModelHypothesis) -> dict[str, Any]:
    """One fitted hypothesis."""
    return {
        'name': hypothesis.name,
        'model': hypothesis.fitted.problem.config.simulated_kinetics,
        'log_evidence': hypothesis.log_evidence,
        'error': hypothesis.fitted.error * hypothesis.noise_factor,
        'parameters': hypothesis.fitted.values,
    }


def precision_data(parameter: ParameterPrecision) -> dict[str, Any]:
    """Standard deviations of one parameter."""
    return {
        'std_now': parameter.now,
        'std_default': parameter.default,
        'std_designed': parameter.designed,
        'log': parameter.log,
        'unit': parameter.unit,
    }


def ratio_table(plan: Plan) -> TextTable:
    """How strong the evidence is expected to be, designed and by default."""
    rows = [
        (
            ratio.true,
            ratio.rival,
            f'{ratio.designed:.4g}',
            f'{ratio.default:.4g}',
            f'{ratio.designed / ratio.default:.1f}' if ratio.default > 0.0 else '',
        )
        for ratio in plan.expected
    ]
    return ('expected log evidence ratio if true', 'against', 'designed', 'default', 'times'), rows


def precision_table(plan: Plan) -> TextTable:
    """Standard deviations of the parameters."""
    rows = [(p.name, *(f'{std:.3g}' for std in (p.now, p.default, p.designed)), p.shown_unit) for p in plan.precision]
    return ('standard deviation of', 'now', 'after a default', 'after the design', 'unit'), rows


def limits_table(plan: Plan) -> TextTable:
    """What was reached under any hypothesis and draw of its posterior."""
    reached = {
        'power': (plan.reached['power'], plan.grid.power, 'W'),
        'temperature': (plan.reached['temperature'], plan.limits.temperature, 'K'),
        'stress': (1e-6 * plan.reached['stress'], 1e-6 * plan.limits.stress, 'MPa'),
    }
    rows = [(name, f'{x:.4g}', f'{most:.4g}', unit, plan.limits_from[name]) for name, (x, most, unit) in reached.items()]
    return ('under every hypothesis and draw', 'reached', 'limit', 'unit', 'limit from'), rows


BEGINS_IN_MOTION = (
    'The recordings do not begin at rest, by their first samples, and are taken to: what is left of a motion before them '
    'bends every explanation. Add --in-motion.'
)


def indistinguishable_sentences(plan: Plan) -> Iterator[str]:
    """Which pairs no experiment tells apart, with the number."""
    expected = {(ratio.true, ratio.rival): ratio.designed for ratio in plan.expected}
    for a, b in plan.indistinguishable:
        most = max(expected[a, b], expected[b, a])
        yield (
            f'no experiment on these channels tells {a} from {b} apart: the best of {plan.evaluated} sequences is expected '
            f'to bring a log evidence ratio of {most:.2g} (3 is odds of 20 to 1)'
        )


def channels_sentence(found: Sequence[FurtherChannel]) -> str:
    """The best of them in words; empty where none was compared."""
    if not found:
        return ''
    best = found[0]
    noise = in_display_unit(best.channel, best.noise_std)
    if not best.expected:
        return (
            f'With the same commands, the {best.words} (noise {noise}) would tell most of these parameters: '
            f'{best.information:.3g} nat.'
        )
    if not best.decides:
        return (
            f'No further channel along these recordings separates all explanations: the best, the {best.words} (noise '
            f'{noise}), is expected to bring a log evidence ratio of {best.least:.2g} for the pair that it separates least.'
        )
    return (
        f'With the same commands, the {best.words} (noise {noise}) would separate the explanations: expected log evidence '
        f'ratio {best.least:.3g}, for the pair that it separates least (3 is odds of 20 to 1).'
    )


def channel_data(channel: FurtherChannel) -> dict[str, Any]:
    """One of them for programs (SI, natural logarithms)."""
    return {
        'channel': channel.channel,
        'measured': channel.measured,
        'noise_std': channel.noise_std,
        'utility': channel.utility,
        'decides': channel.decides,
        'information_nat': channel.information,
        'expected_log_evidence_ratio': [asdict(ratio) for ratio in channel.expected],
    }
