"""All that a comparison says, computed once, and as plain data for programs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from sma_sim.evidence.estimation.executors import one_thread_for_linear_algebra
from sma_sim.evidence.residual_analysis.compare import Comparison
from sma_sim.evidence.residual_analysis.error_by_stratum import Split, all_splits
from sma_sim.evidence.residual_analysis.findings import ErrorRegion, find_error_regions
from sma_sim.evidence.residual_analysis.metrics import ChannelScore, channel_scores, total_error
from sma_sim.evidence.residual_analysis.patterns import Pattern, find_patterns
from sma_sim.evidence.residual_analysis.spectrum import Band, error_bands
from sma_sim.evidence.residual_analysis.state_density import StateDensity, state_densities
from sma_sim.evidence.residual_analysis.wire_tests import Characterization, characterization


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
