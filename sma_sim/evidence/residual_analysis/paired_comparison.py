"""Two configurations beside the same dataset: which is nearer, and how certain that is."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sma_sim.evidence.residual_analysis.compare import Comparison
from sma_sim.evidence.residual_analysis.error_by_stratum import samples_of
from sma_sim.evidence.residual_analysis.subgroups import BOOTSTRAP_DRAWS, blocks_of


@dataclass(frozen=True)
class ErrorChange:
    """Normalized RMSE of the second configuration over that of the first, with its 95 % interval."""

    channel: str
    held_out: bool
    ratio: float
    low: float
    high: float

    @property
    def text(self) -> str:
        """In words."""
        where = 'on the runs held out' if self.held_out else 'on the fitted runs'
        interval = f'x{self.ratio:.3f}, 95 %: {self.low:.3f} to {self.high:.3f}'
        if self.low <= 1.0 <= self.high:
            return f'{self.channel}: no significant difference {where} ({interval})'
        return f'{self.channel}: the second is {"nearer" if self.ratio < 1.0 else "farther"} {where} ({interval})'


def error_changes(first: Comparison, second: Comparison) -> tuple[ErrorChange, ...]:
    """From the first to the second comparison of the same dataset, per channel, fitted and held-out runs apart.

    Blocks of the runs are drawn again, the same ones for both.
    """
    return tuple(
        error_change(replace(first, runs=first.part(held)), replace(second, runs=second.part(held)), channel, held)
        for held in (False, True)
        for channel in first.channels
        if any(np.isfinite(run.measured.get(channel, np.nan)).any() for run in first.part(held))
    )


def error_change(first: Comparison, second: Comparison, channel: str, held: bool) -> ErrorChange:
    """One channel over all runs of two comparisons."""
    samples_before, samples_after = samples_of(first, channel), samples_of(second, channel)
    block = blocks_of(samples_before)
    count = int(block.max()) + 1
    before, after = (np.bincount(block, samples.scaled**2, count) for samples in (samples_before, samples_after))
    draws = np.random.default_rng(3).multinomial(count, np.full(count, 1.0 / count), BOOTSTRAP_DRAWS)
    ratios = np.sqrt((draws @ after) / np.maximum(draws @ before, 1e-300))
    low, high = (float(x) for x in np.quantile(ratios, (0.025, 0.975)))
    return ErrorChange(channel, held, float(np.sqrt(after.sum() / max(before.sum(), 1e-300))), low, high)
