"""A comparison of model and recordings as plain data for programs, and what is said of an error that is everywhere."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from sma_sim.evidence.data.display_units import in_display_unit
from sma_sim.evidence.residual_analysis.metrics import AT_NOISE, ChannelScore
from sma_sim.evidence.residual_analysis.paired_comparison import ErrorChange
from sma_sim.evidence.residual_analysis.summary import Summary
from sma_sim.words.wire_tests import characterization_data

SCORE_HEADER = ('channel', 'runs', 'RMSE', 'of range', 'over noise', 'whiteness p', 'neighbours', 'bias')
LEAST_P = 1e-16  # that is told


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
        'patterns': [asdict(pattern) for pattern in summary.patterns],
        'findings': [asdict(finding) for finding in summary.findings],
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


def score_groups(summary: Summary) -> list[tuple[str, list[ChannelScore]]]:
    """Scores of fitted runs and of those held out, where there are any."""
    held = list(summary.held_out.values())
    first = ('fitted' if held else 'all', list(summary.fitted.values()))
    return [first, ('held out', held)] if held else [first]


def channel_row(kind: str, score: ChannelScore) -> tuple[str, ...]:
    """One channel of some runs, under SCORE_HEADER."""
    return (
        score.channel,
        kind,
        in_display_unit(score.channel, score.rmse),
        score.share_text,
        f'{score.over_noise:.3f}',
        f'{score.whiteness.p:.2g}' if score.whiteness.p >= LEAST_P else f'<{LEAST_P:g}',
        f'{score.whiteness.first:.2f}',
        in_display_unit(score.channel, score.bias),
    )


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
