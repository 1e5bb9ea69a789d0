"""The ranked list, in plain words, of where the error concentrates and how sure that is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sma_sim.evidence.data.display_units import in_display_unit
from sma_sim.evidence.residual_analysis.compare import Comparison
from sma_sim.evidence.residual_analysis.error_by_stratum import Samples, samples_of
from sma_sim.evidence.residual_analysis.strata import Dimension, dimensions
from sma_sim.evidence.residual_analysis.subgroups import Region, Sureness, conditions_of, search, sureness, thinned

AT_NOISE = 1.05  # RMSE over noise below which a channel holds nothing to find
PER_CHANNEL = 2
LEAST_SHARE = 0.1  # of the channel's squared error: a second region with less is not told
SURE, LIKELY = 0.9, 0.6
CHANCE = 0.02  # p-value beyond which a region is not told
OFFSET = 0.5  # |bias| over RMSE in a region from which its sign is told


@dataclass(frozen=True)
class Finding:
    """A region in which the squared error of a channel concentrates.

    `share` of the squared error (95 % interval `low` to `high`), `time` share of the samples, `weight` of the finding
    in the ranking, `p` how likely a search finds as much where there is nothing, `again` part of random halves of the
    data that show the same region again, `trend` mean squared error in the
    second over that in the first half of the run with its 95 % interval. `over_noise` and `bias` (SI, mean of
    measured - model) within the region; `conditions` in words, `text` the whole sentence.
    """

    channel: str
    conditions: tuple[str, ...]
    share: float
    low: float
    high: float
    time: float
    over_noise: float
    bias: float
    p: float
    again: float
    trend: tuple[float, float, float]
    weight: float
    text: str


def findings(comparison: Comparison) -> tuple[Finding, ...]:
    """Where the error concentrates, the most important first; empty where it is spread evenly or no more than noise."""
    ways = dimensions(comparison)
    found = [
        one
        for channel in comparison.channels
        for one in of_channel(thinned(samples_of(comparison, channel)), ways)
    ]  # fmt: skip
    return tuple(sorted(found, key=lambda one: -one.weight))


def of_channel(samples: Samples, ways: Sequence[Dimension]) -> list[Finding]:
    """The findings of one channel."""
    if len(samples.place) == 0:
        return []
    squares = samples.scaled**2
    total = float(squares.sum())
    if total <= AT_NOISE**2 * len(squares):
        return []
    conditions = conditions_of(ways, samples)
    left, found = np.ones(len(squares), dtype=bool), []
    for _ in range(PER_CHANNEL):
        error = squares * left
        if error.sum() < LEAST_SHARE * total:
            break
        region = search(conditions, error / error.sum(), left / left.sum())
        if region is None or error[region.mask].sum() < LEAST_SHARE * total:
            break
        sure = sureness(region, conditions, samples, error, left)
        if sure.p <= CHANCE:
            found.append(finding(samples, replace(region, mask=region.mask & left), sure, float(error.sum())))
        left = left & ~region.mask
    return found


def finding(samples: Samples, region: Region, sure: Sureness, searched: float) -> Finding:
    """One region with its words; `searched` is the squared error that the search was about."""
    inside, squares = region.mask, samples.scaled**2
    share, time = float(squares[inside].sum() / squares.sum()), float(inside.mean())
    scale = searched / float(squares.sum())
    excess = float(np.mean(squares)) - 1.0
    residual = samples.residual[inside]
    bias, rmse = float(residual.mean()), float(np.sqrt(np.mean(residual**2)))
    words = tuple(one.words for one in region.conditions)
    return Finding(
        channel=samples.channel, conditions=words, share=share, low=scale * sure.low, high=scale * sure.high, time=time,
        over_noise=float(np.sqrt(np.mean(squares[inside]))), bias=bias, p=sure.p, again=sure.again, trend=sure.trend,
        weight=(share - time) * excess,
        text=sentence(samples.channel, words, (share, scale * sure.low, scale * sure.high, time), sure, bias / rmse, rmse),
    )  # fmt: skip


def sentence(
    channel: str, words: Sequence[str], shares: tuple[float, float, float, float], sure: Sureness, offset: float, rmse: float
) -> str:
    """A finding in words; `offset` is bias over RMSE, `rmse` (SI) that within the region."""
    share, low, high, time = shares
    text = (
        f'{percent(share)} of the squared error of {channel} arises while {joined(words)} ({percent(time)} of the samples); '
        f'RMSE {in_display_unit(channel, rmse)} there'
    )
    if abs(offset) > OFFSET:
        side = 'above' if offset > 0.0 else 'below'
        text += f', measured {side} the model by {in_display_unit(channel, abs(offset) * rmse)} on average'
    ratio, least, most = sure.trend
    if least > 1.0:
        text += f'; it grows over the run, x{ratio:.2g} in square from its first to its second half'
    elif most < 1.0:
        text += f'; it falls over the run, x{ratio:.2g} in square from its first to its second half'
    interval = f'95 %: {percent(low)} to {percent(high)}; {percent(sure.again)} of random halves show it'
    return f'{text}. {degree(sure)} ({interval}).'


def degree(sure: Sureness) -> str:
    """How sure, in a word."""
    return 'Sure' if sure.again >= SURE else 'Likely' if sure.again >= LIKELY else 'Doubtful'


def joined(words: Sequence[str]) -> str:
    """`a`, `a and b`, `a, b and c`."""
    return words[0] if len(words) == 1 else f'{", ".join(words[:-1])} and {words[-1]}'


def percent(part: float) -> str:
    """A part in per cent."""
    return f'{100.0 * part:.0f} %'
