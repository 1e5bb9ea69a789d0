"""The ranked list, in plain words, of where the error concentrates and how certain that is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sma_sim.evidence.data.display_units import in_display_unit
from sma_sim.evidence.residual_analysis.compare import Comparison
from sma_sim.evidence.residual_analysis.error_by_stratum import ChannelSamples, samples_of
from sma_sim.evidence.residual_analysis.metrics import AT_NOISE
from sma_sim.evidence.residual_analysis.strata import Dimension, dimensions
from sma_sim.evidence.residual_analysis.subgroups import (
    Region,
    RegionCertainty,
    assess_region,
    conditions_of,
    find_region,
    thinned,
)

MAX_FINDINGS_PER_CHANNEL = 2  # more of them overlap in what they say
MIN_FINDING_SHARE = 0.1  # of the channel's squared error: a region with less is not reported
CONFIDENT, LIKELY = 0.9, 0.6  # of random halves of the data that show a region again
MAX_P_VALUE = 0.02  # beyond it a region is not reported
MIN_RELATIVE_BIAS = 0.5  # |bias| over RMSE in a region, above which its sign is reported


@dataclass(frozen=True)
class ErrorRegion:
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


def find_error_regions(comparison: Comparison) -> tuple[ErrorRegion, ...]:
    """Where the error concentrates, the most important first; empty where it is spread evenly or no more than noise."""
    ways = dimensions(comparison)
    found = [
        region
        for channel in comparison.channels
        for region in findings_of_channel(thinned(samples_of(comparison, channel)), ways)
    ]
    return tuple(sorted(found, key=lambda region: -region.weight))


def findings_of_channel(samples: ChannelSamples, ways: Sequence[Dimension]) -> list[ErrorRegion]:
    """The findings of one channel."""
    if len(samples.index) == 0:
        return []
    squares = samples.scaled**2
    total = float(squares.sum())
    if total <= AT_NOISE**2 * len(squares):
        return []
    conditions = conditions_of(ways, samples)
    left, found = np.ones(len(squares), dtype=bool), []
    for _ in range(MAX_FINDINGS_PER_CHANNEL):
        error = squares * left
        if error.sum() < MIN_FINDING_SHARE * total:
            break
        region = find_region(conditions, error / error.sum(), left / left.sum())
        if region is None or error[region.mask].sum() < MIN_FINDING_SHARE * total:
            break
        certainty = assess_region(region, conditions, samples, error, left)
        if certainty.p <= MAX_P_VALUE:
            found.append(make_finding(samples, replace(region, mask=region.mask & left), certainty, float(error.sum())))
        left = left & ~region.mask
    return found


def make_finding(samples: ChannelSamples, region: Region, certainty: RegionCertainty, searched: float) -> ErrorRegion:
    """One region with its words; `searched` is the squared error that the search was about."""
    inside, squares = region.mask, samples.scaled**2
    share, time = float(squares[inside].sum() / squares.sum()), float(inside.mean())
    scale = searched / float(squares.sum())
    excess = float(np.mean(squares)) - 1.0
    residual = samples.residual[inside]
    bias, rmse = float(residual.mean()), float(np.sqrt(np.mean(residual**2)))
    words = tuple(condition.words for condition in region.conditions)
    low, high = scale * certainty.low, scale * certainty.high
    text = finding_text(samples.channel, words, (share, low, high, time), certainty, bias / rmse, rmse)
    return ErrorRegion(
        channel=samples.channel,
        conditions=words,
        share=share,
        low=low,
        high=high,
        time=time,
        over_noise=float(np.sqrt(np.mean(squares[inside]))),
        bias=bias,
        p=certainty.p,
        again=certainty.again,
        trend=certainty.trend,
        weight=(share - time) * excess,
        text=text,
    )


def finding_text(
    channel: str,
    words: Sequence[str],
    shares: tuple[float, float, float, float],
    certainty: RegionCertainty,
    offset: float,
    rmse: float,
) -> str:
    """A finding in words; `offset` is bias over RMSE, `rmse` (SI) that within the region."""
    share, low, high, time = shares
    text = (
        f'{percent(share)} of the squared error of {channel} arises while {enumeration(words)} '
        f'({percent(time)} of the samples); RMSE {in_display_unit(channel, rmse)} there'
    )
    if abs(offset) > MIN_RELATIVE_BIAS:
        side = 'above' if offset > 0.0 else 'below'
        text += f', measured {side} the model by {in_display_unit(channel, abs(offset) * rmse)} on average'
    ratio, least, most = certainty.trend
    if least > 1.0:
        text += f'; it grows over the run, x{ratio:.2g} in square from its first to its second half'
    elif most < 1.0:
        text += f'; it falls over the run, x{ratio:.2g} in square from its first to its second half'
    interval = f'95 %: {percent(low)} to {percent(high)}; {percent(certainty.again)} of random halves show it'
    return f'{text}. {confidence_word(certainty)} ({interval}).'


def confidence_word(certainty: RegionCertainty) -> str:
    """The confidence in a region, in a word."""
    return 'Confident' if certainty.again >= CONFIDENT else 'Likely' if certainty.again >= LIKELY else 'Uncertain'


def enumeration(words: Sequence[str]) -> str:
    """`a`, `a and b`, `a, b and c`."""
    return words[0] if len(words) == 1 else f'{", ".join(words[:-1])} and {words[-1]}'


def percent(part: float) -> str:
    """A part in per cent."""
    return f'{100.0 * part:.0f} %'
