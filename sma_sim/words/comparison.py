"""A comparison of model and recordings: where the error is and which shape it has, in sentences and as plain data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from sma_sim.evidence.data.display_units import in_display_unit
from sma_sim.evidence.residual_analysis.findings import ErrorRegion
from sma_sim.evidence.residual_analysis.metrics import AT_NOISE
from sma_sim.evidence.residual_analysis.paired_comparison import ErrorChange
from sma_sim.evidence.residual_analysis.patterns import Pattern
from sma_sim.evidence.residual_analysis.summary import Summary
from sma_sim.words.wire_tests import characterization_data

CONFIDENT, LIKELY = 0.9, 0.6  # of random halves of the data that show a region again
MIN_RELATIVE_BIAS = 0.5  # |bias| over RMSE in a region, above which its sign is reported


def comparison_data(summary: Summary) -> dict[str, Any]:
    """The summary for JSON; SI units."""
    comparison = summary.comparison
    return {
        'configuration': comparison.label,
        'model': comparison.config.simulated_kinetics,
        'delay': comparison.delay,
        'error': {
            'train': summary.fitted_error,
            'held_out': summary.held_out_error,
        },
        'channels': {
            name: {channel: asdict(entry) for channel, entry in part.items()}
            for name, part in (('train', summary.fitted), ('held_out', summary.held_out))
        },
        'runs': {
            run.name: {
                'held_out': run.held_out,
                'start': run.nuisance.start,
                'channels': {channel: asdict(entry) for channel, entry in summary.runs[run.name].items()},
            }
            for run in comparison.runs
        },
        'patterns': [asdict(one) | {'text': pattern_sentence(one)} for one in summary.patterns],
        'findings': [asdict(one) | {'text': region_sentence(one)} for one in summary.findings],
        'spread': '' if summary.remarks else spread_sentence(summary),
        'splits': [asdict(split) for split in summary.splits],
        'bands': {channel: [asdict(band) for band in found] for channel, found in summary.bands.items()},
        **({'characterization': characterization_data(summary.tests)} if summary.tests else {}),
    }


def comparison_result(
    summaries: Sequence[Summary], changes: Sequence[ErrorChange], noise_std: Mapping[str, float]
) -> dict[str, Any]:
    """One comparison or two, the second with its changes of the first's errors, for JSON."""
    return {
        'comparisons': [comparison_data(summary) for summary in summaries],
        'changes': [vars(change) for change in changes],
        'noise_std': noise_std,
    }


def spread_sentence(summary: Summary) -> str:
    """What is said of an error that concentrates nowhere."""
    scores = (*summary.fitted.values(), *summary.held_out.values())
    worst = max(scores, key=lambda score: score.over_noise, default=None)
    if worst is None or worst.over_noise <= AT_NOISE:
        return 'The error is no more than noise.'
    return (
        f'The error, {worst.over_noise:.3g} times the noise in {worst.channel}, concentrates nowhere: it is spread over '
        'all modes, temperatures, directions, times and runs.'
    )


def change_sentence(change: ErrorChange) -> str:
    """Which of two configurations is nearer in a channel."""
    where = 'on the runs held out' if change.held_out else 'on the fitted runs'
    interval = f'x{change.ratio:.3f}, 95 %: {change.low:.3f} to {change.high:.3f}'
    if change.low <= 1.0 <= change.high:
        return f'{change.channel}: no significant difference {where} ({interval})'
    return f'{change.channel}: the second is {"nearer" if change.ratio < 1.0 else "farther"} {where} ({interval})'


def remark_sentence(remark: Pattern | ErrorRegion) -> str:
    """Where the error of a channel is, or which shape it has."""
    return pattern_sentence(remark) if isinstance(remark, Pattern) else region_sentence(remark)


def pattern_sentence(pattern: Pattern) -> str:
    """A pattern in words."""
    part = f'{100.0 * pattern.share:.0f} % of the squared error of {pattern.channel} is'
    value, low, high = pattern.value, pattern.low, pattern.high
    if pattern.shape == 'offset':
        size, least, most = (in_display_unit(pattern.channel, number) for number in (abs(value), low, high))
        numbers = f'{size} (95 %: {least} to {most})'
        return f'{part} a constant offset: measured {"above" if value > 0.0 else "below"} the model by {numbers}.'
    if pattern.shape == 'scale':
        numbers = f'{abs(100 * value):.3g} % (95 %: {100 * low:+.3g} to {100 * high:+.3g} %)'
        return f'{part} a wrong scale: measured {"larger" if value > 0.0 else "smaller"} than the model by {numbers}.'
    numbers = f'{abs(value):.3g} s (95 %: {low:+.3g} to {high:+.3g} s)'
    return f'{part} a shift in time: measured {"later" if value > 0.0 else "earlier"} than the model by {numbers}.'


def region_sentence(region: ErrorRegion) -> str:
    """Where the error concentrates, and how certain that is."""
    text = (
        f'{percent(region.share)} of the squared error of {region.channel} arises while {enumeration(region.conditions)} '
        f'({percent(region.time)} of the samples); RMSE {in_display_unit(region.channel, region.rmse)} there'
    )
    if abs(region.bias) > MIN_RELATIVE_BIAS * region.rmse:
        side = 'above' if region.bias > 0.0 else 'below'
        text += f', measured {side} the model by {in_display_unit(region.channel, abs(region.bias))} on average'
    ratio, least, most = region.trend
    if least > 1.0:
        text += f'; it grows over the run, x{ratio:.2g} in square from its first to its second half'
    elif most < 1.0:
        text += f'; it falls over the run, x{ratio:.2g} in square from its first to its second half'
    certain = 'Confident' if region.again >= CONFIDENT else 'Likely' if region.again >= LIKELY else 'Uncertain'
    interval = f'95 %: {percent(region.low)} to {percent(region.high)}; {percent(region.again)} of random halves show it'
    return f'{text}. {certain} ({interval}).'


def enumeration(words: Sequence[str]) -> str:
    """`a`, `a and b`, `a, b and c`."""
    return words[0] if len(words) == 1 else f'{", ".join(words[:-1])} and {words[-1]}'


def percent(part: float) -> str:
    """A part in per cent."""
    return f'{100.0 * part:.0f} %'
