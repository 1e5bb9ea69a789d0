"""All that a comparison says, computed once, and as plain data for programs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from sma_sim.evidence.estimation.executors import one_thread_for_linear_algebra
from sma_sim.evidence.residual_analysis.compare import Comparison
from sma_sim.evidence.residual_analysis.error_by_stratum import Split, all_splits
from sma_sim.evidence.residual_analysis.findings import ErrorRegion, find_error_regions
from sma_sim.evidence.residual_analysis.metrics import AT_NOISE, ChannelScore, channel_scores, total_error
from sma_sim.evidence.residual_analysis.paired_comparison import ErrorChange
from sma_sim.evidence.residual_analysis.patterns import Pattern, find_patterns
from sma_sim.evidence.residual_analysis.spectrum import Band, error_bands
from sma_sim.evidence.residual_analysis.state_density import StateDensity, state_densities
from sma_sim.evidence.residual_analysis.wire_tests import (
    Characterization,
    characterization,
    characterization_data,
)


@dataclass(frozen=True)
class Summary:
    """What a comparison says. `fitted`, `held_out`: scores by channel; `runs`: the same by run; `densities` by channel;
    `tests`: isobaric and isothermal tests of a wire."""

    comparison: Comparison
    fitted: Mapping[str, ChannelScore]
    held_out: Mapping[str, ChannelScore]
    runs: Mapping[str, Mapping[str, ChannelScore]]
    patterns: tuple[Pattern, ...]
    findings: tuple[ErrorRegion, ...]
    splits: tuple[Split, ...]
    bands: Mapping[str, tuple[Band, ...]]
    densities: Mapping[str, tuple[StateDensity, ...]]
    tests: Characterization

    @property
    def fitted_error(self) -> float:
        """Normalized RMSE of the fitted runs; NaN without any."""
        return total_error(list(self.fitted.values()))

    @property
    def held_out_error(self) -> float:
        """Normalized RMSE of the held-out runs; NaN without any."""
        return total_error(list(self.held_out.values()))

    @property
    def remarks(self) -> tuple[Pattern | ErrorRegion, ...]:
        """What is said of where the error is, the most important first."""
        return tuple(sorted((*self.patterns, *self.findings), key=lambda remark: -remark.weight))

    @property
    def spread_sentence(self) -> str:
        """What is said of an error that concentrates nowhere."""
        scores = (*self.fitted.values(), *self.held_out.values())
        worst = max(scores, key=lambda score: score.over_noise, default=None)
        if worst is None or worst.over_noise <= AT_NOISE:
            return 'The error is no more than noise.'
        return (
            f'The error, {worst.over_noise:.3g} times the noise in {worst.channel}, concentrates nowhere: it is spread over '
            'all modes, temperatures, directions, times and runs.'
        )

    def run_error(self, name: str) -> float:
        """Normalized RMSE of a run."""
        return total_error(list(self.runs[name].values()))


def summarize(comparison: Comparison) -> Summary:
    """Look at a comparison in every way."""
    channels = comparison.channels
    with one_thread_for_linear_algebra():  # the matrices are small
        return Summary(
            comparison,
            channel_scores(comparison.part(False), channels),
            channel_scores(comparison.part(True), channels),
            {run.name: channel_scores((run,), channels) for run in comparison.runs},
            find_patterns(comparison),
            find_error_regions(comparison),
            all_splits(comparison),
            {channel: error_bands(comparison.runs, channel) for channel in channels},
            state_densities(comparison),
            characterization(comparison),
        )


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
        'spread': '' if summary.remarks else summary.spread_sentence,
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
