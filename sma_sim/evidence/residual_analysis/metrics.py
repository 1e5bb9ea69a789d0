"""How large the residuals of a channel are, and whether they are white."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from sma_sim.evidence.residual_analysis.compare import ComparedRun

Vector = NDArray[np.float64]
MOST_LAGS = 20


@dataclass(frozen=True)
class Whiteness:
    """Ljung and Box's portmanteau test: `statistic`, `lags` (degrees of freedom), `p`; `first`: correlation at lag 1."""

    statistic: float
    lags: int
    p: float
    first: float


@dataclass(frozen=True)
class Score:
    """A channel over some runs, SI units.

    `share`: RMSE over the range that was measured; `over_noise`: RMSE over noise; `bias`: mean of measured - model.
    """

    channel: str
    samples: int
    rmse: float
    bias: float
    share: float
    over_noise: float
    whiteness: Whiteness


def score(runs: Sequence[ComparedRun], channel: str) -> Score | None:
    """The score of a channel, None where no run measured it."""
    runs = [run for run in runs if channel in run.measured and np.isfinite(run.measured[channel]).any()]
    if not runs:
        return None
    residuals = [run.residual(channel) for run in runs]
    joined = np.concatenate([one[np.isfinite(one)] for one in residuals])
    measured = np.concatenate([run.measured[channel] for run in runs])
    scaled = np.concatenate([one[np.isfinite(one)] / run.noise[channel] for one, run in zip(residuals, runs, strict=True)])
    rmse, span = float(np.sqrt(np.mean(joined**2))), float(np.nanmax(measured) - np.nanmin(measured))
    return Score(
        channel=channel, samples=len(joined), rmse=rmse, bias=float(joined.mean()),
        share=rmse / span if span > 0.0 else float('nan'), over_noise=float(np.sqrt(np.mean(scaled**2))),
        whiteness=ljung_box(residuals),
    )  # fmt: skip


def scores(runs: Sequence[ComparedRun], channels: Sequence[str]) -> dict[str, Score]:
    """Scores of the channels that the runs have."""
    found = {channel: score(runs, channel) for channel in channels}
    return {channel: one for channel, one in found.items() if one is not None}


def total_error(found: Sequence[Score]) -> float:
    """sqrt(mean over channels of (RMSE over noise)^2), NaN for none."""
    return float(np.sqrt(np.mean([one.over_noise**2 for one in found]))) if found else float('nan')


def ljung_box(series: Sequence[Vector]) -> Whiteness:
    """Ljung and Box (Biometrika 1978) over several runs (k,), NaN where a sample is missing.

    Q = k (k + 2) sum over lags h of rho_h^2/n_h, n_h pairs of samples h apart (k - h of them where none is missing).
    Each run adds its own, so that nothing is assumed across runs.
    """
    statistic, freedom, weighted, count = 0.0, 0, 0.0, 0
    for one in series:
        known = np.isfinite(one)
        k = int(known.sum())
        lags = min(MOST_LAGS, k // 5)
        if lags < 1:
            continue
        filled = np.where(known, one - np.nanmean(one), 0.0)
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
    return Whiteness(statistic, freedom, float(chi2.sf(statistic, freedom)), weighted / count)
