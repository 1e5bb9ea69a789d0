"""How large the residuals of a channel are, and whether they are white."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sma_sim.evidence.estimation.chi_square import chi_square_tail
from sma_sim.evidence.residual_analysis.compare import ComparedRun
from sma_sim.model.arrays import Vector

MAX_LAGS = 20  # of the whiteness test: enough for the time constants of wires at usual rates
AT_NOISE = 1.05  # normalized RMSE below which a channel holds nothing to find


@dataclass(frozen=True)
class Whiteness:
    """Ljung and Box's portmanteau test: `statistic`, `lags` (degrees of freedom), `p`; `first`: correlation at lag 1."""

    statistic: float
    lags: int
    p: float
    first: float


@dataclass(frozen=True)
class ChannelScore:
    """A channel over some runs, SI units.

    `share`: RMSE over the range that was measured, NaN where that is zero; `over_noise`: normalized RMSE; `bias`: mean of
    measured - model.
    """

    channel: str
    samples: int
    rmse: float
    bias: float
    share: float
    over_noise: float
    whiteness: Whiteness

    @property
    def share_text(self) -> str:
        """RMSE in per cent of the range; a dash where all samples are the same."""
        return f'{100.0 * self.share:.2f} %' if np.isfinite(self.share) else '-'


def channel_score(runs: Sequence[ComparedRun], channel: str) -> ChannelScore | None:
    """The score of a channel, None where no run measured it."""
    runs = [run for run in runs if channel in run.measured and np.isfinite(run.measured[channel]).any()]
    if not runs:
        return None
    residuals = [run.residual(channel) for run in runs]
    joined = np.concatenate([residual[np.isfinite(residual)] for residual in residuals])
    measured = np.concatenate([run.measured[channel] for run in runs])
    rmse, span = float(np.sqrt(np.mean(joined**2))), float(np.nanmax(measured) - np.nanmin(measured))
    return ChannelScore(
        channel=channel,
        samples=len(joined),
        rmse=rmse,
        bias=float(joined.mean()),
        share=rmse / span if span > 0.0 else float('nan'),
        over_noise=error_over_noise(runs, channel),
        whiteness=ljung_box(residuals),
    )


def error_over_noise(runs: Sequence[ComparedRun], channel: str) -> float:
    """Normalized RMSE of a channel in the runs that have it; NaN where none has."""
    scaled = [run.residual(channel) / run.noise[channel] for run in runs if channel in run.measured]
    known = np.concatenate([values[np.isfinite(values)] for values in scaled]) if scaled else np.zeros(0)
    return float(np.sqrt(np.mean(known**2))) if len(known) else float('nan')


def pooled_over_channels(errors: Sequence[float]) -> float:
    """sqrt(mean over channels of (normalized RMSE)^2), NaN for none."""
    return float(np.sqrt(np.mean([error**2 for error in errors]))) if errors else float('nan')


def channel_scores(runs: Sequence[ComparedRun], channels: Sequence[str]) -> dict[str, ChannelScore]:
    """Scores of the channels that the runs have."""
    found = {channel: channel_score(runs, channel) for channel in channels}
    return {channel: entry for channel, entry in found.items() if entry is not None}


def total_error(found: Sequence[ChannelScore]) -> float:
    """The normalized RMSE of several channels, NaN for none."""
    return pooled_over_channels([entry.over_noise for entry in found])


def ljung_box(series: Sequence[Vector]) -> Whiteness:
    """Ljung and Box (Biometrika 1978) over several runs (k,), NaN where a sample is missing.

    Q = k (k + 2) sum over lags h of rho_h^2/n_h, n_h pairs of samples h apart (k - h of them where none is missing).
    Each run adds its own, so that nothing is assumed across runs.
    """
    statistic, freedom, weighted, count = 0.0, 0, 0.0, 0
    for residual in series:
        known = np.isfinite(residual)
        k = int(known.sum())
        lags = min(MAX_LAGS, k // 5)
        if lags < 1:
            continue
        filled = np.where(known, residual - np.nanmean(residual), 0.0)
        power = float(filled @ filled)
        if power <= 0.0:
            continue
        rho = np.array([filled[h:] @ filled[:-h] / power for h in range(1, lags + 1)])
        pairs = np.array([np.count_nonzero(known[h:] & known[:-h]) for h in range(1, lags + 1)])
        seen = pairs > 0
        statistic += float(k * (k + 2) * np.sum(rho[seen] ** 2 / pairs[seen]))
        freedom += int(seen.sum())
        weighted, count = weighted + k * float(rho[0]), count + k
    if freedom == 0:
        return Whiteness(0.0, 0, float('nan'), float('nan'))
    return Whiteness(statistic, freedom, chi_square_tail(statistic, freedom), weighted / count)
