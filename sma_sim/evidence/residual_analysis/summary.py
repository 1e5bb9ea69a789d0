"""All that a comparison says, computed once, and as plain data for programs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sma_sim.evidence.data.display_units import in_display_unit
from sma_sim.evidence.estimation.executors import one_thread_for_linear_algebra
from sma_sim.evidence.residual_analysis.compare import ComparedRun, Comparison
from sma_sim.evidence.residual_analysis.error_by_stratum import ChannelSamples, Split, all_splits, samples_of
from sma_sim.evidence.residual_analysis.metrics import AT_NOISE, ChannelScore, channel_score, channel_scores, total_error
from sma_sim.evidence.residual_analysis.spectrum import Band, error_bands
from sma_sim.evidence.residual_analysis.state_density import StateDensity, state_densities
from sma_sim.evidence.residual_analysis.strata import Dimension, dimensions
from sma_sim.evidence.residual_analysis.subgroups import (
    BOOTSTRAP_DRAWS,
    Region,
    RegionCertainty,
    assess_region,
    blocks_of,
    conditions_of,
    find_region,
    thinned,
)
from sma_sim.evidence.residual_analysis.wire_states import rate_of_change
from sma_sim.evidence.residual_analysis.wire_tests import Characterization, characterization
from sma_sim.model.arrays import Vector
from sma_sim.model.shown import joined_words


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


# The ranked list, in plain words, of where the error concentrates and how certain that is.
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
        f'{percent(share)} of the squared error of {channel} arises while {joined_words(words)} '
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


def percent(part: float) -> str:
    """A part in per cent."""
    return f'{100.0 * part:.0f} %'


# Shapes that the residual of a channel may have everywhere: an offset, a wrong scale, a lag.
#
# The residual over noise is fitted by least squares with each shape of the model's channel y alone: 1 (offset),
# y - mean(y) (scale) and dy/dt (a lag of as many seconds, to first order). Blocks drawn again give the interval.
MIN_PATTERN_SHARE = 0.25  # of the squared error: a shape that explains less is not reported


@dataclass(frozen=True)
class Pattern:
    """A shape (`offset`, `scale`, `lag`) of the residual of a channel: the part `share` of the squared error that it
    explains, its size `value` (offset: SI; scale: relative; lag: s) with its 95 % interval, its `weight` among all that is
    said of an error (as `ErrorRegion` has it), and the sentence.
    """

    channel: str
    shape: str
    share: float
    value: float
    low: float
    high: float
    weight: float
    text: str


PATTERN_SHAPES: dict[str, Callable[[ComparedRun, str], Vector]] = {
    'offset': lambda run, channel: np.ones(len(run.time)),
    'scale': lambda run, channel: run.predicted[channel] - float(np.mean(run.predicted[channel])),
    'lag': lambda run, channel: -rate_of_change(run.time, run.predicted[channel]),
}


def find_patterns(comparison: Comparison) -> tuple[Pattern, ...]:
    """Shapes that explain a good part of a channel's squared error, certainly not zero; largest share first."""
    found = []
    for channel in comparison.channels:
        channel_error = channel_score(comparison.runs, channel)
        if channel_error is None or channel_error.over_noise < AT_NOISE:
            continue
        samples = samples_of(comparison, channel)
        found += [fit_pattern(comparison, samples, shape) for shape in PATTERN_SHAPES]
    significant = [shape for shape in found if shape.share >= MIN_PATTERN_SHARE and shape.low * shape.high > 0.0]
    return tuple(sorted(significant, key=lambda shape: -shape.share))


def fit_pattern(comparison: Comparison, samples: ChannelSamples, shape: str) -> Pattern:
    """One shape in one channel."""
    channel = samples.channel
    joined = np.concatenate(
        [
            PATTERN_SHAPES[shape](run, channel) if channel in run.predicted else np.full(len(run.time), np.nan)
            for run in comparison.runs
        ]
    )[samples.index]
    noise = np.array([run.noise.get(channel, np.nan) for run in comparison.runs])[samples.run]
    regressor = joined / noise
    block = blocks_of(samples)
    count = int(block.max()) + 1
    along = np.bincount(block, regressor * samples.scaled, count)
    size = np.bincount(block, regressor**2, count)
    draws = np.random.default_rng(2).multinomial(count, np.full(count, 1.0 / count), BOOTSTRAP_DRAWS)
    values = (draws @ along) / np.maximum(draws @ size, 1e-300)
    low, high = (float(x) for x in np.quantile(values, (0.025, 0.975)))
    value = float(along.sum() / max(size.sum(), 1e-300))
    squares = float(np.sum(samples.scaled**2))
    share = float(value * along.sum() / max(squares, 1e-300))
    weight, words = share * (squares / len(samples.scaled) - 1.0), pattern_text(channel, shape, share, (value, low, high))
    return Pattern(channel, shape, share, value, low, high, weight, words)


def pattern_text(channel: str, shape: str, share: float, interval: tuple[float, float, float]) -> str:
    """A pattern in words."""
    part = f'{100.0 * share:.0f} % of the squared error of {channel} is'
    value, low, high = interval
    if shape == 'offset':
        size, least, most = (in_display_unit(channel, number) for number in (abs(value), low, high))
        numbers = f'{size} (95 %: {least} to {most})'
        return f'{part} a constant offset: measured {"above" if value > 0.0 else "below"} the model by {numbers}.'
    if shape == 'scale':
        numbers = f'{abs(100 * value):.3g} % (95 %: {100 * low:+.3g} to {100 * high:+.3g} %)'
        return f'{part} a wrong scale: measured {"larger" if value > 0.0 else "smaller"} than the model by {numbers}.'
    numbers = f'{abs(value):.3g} s (95 %: {low:+.3g} to {high:+.3g} s)'
    return f'{part} a shift in time: measured {"later" if value > 0.0 else "earlier"} than the model by {numbers}.'
