"""Shapes that the residual of a channel may have everywhere: an offset, a wrong scale, a lag.

The residual over noise is fitted by least squares with each shape of the model's channel y alone: 1 (offset),
y - mean(y) (scale) and dy/dt (a lag of as many seconds, to first order). Blocks drawn again give the interval.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.data.display_units import in_display_unit
from sma_sim.evidence.residual_analysis.compare import ComparedRun, Comparison
from sma_sim.evidence.residual_analysis.error_by_stratum import ChannelSamples, samples_of
from sma_sim.evidence.residual_analysis.metrics import AT_NOISE, channel_score
from sma_sim.evidence.residual_analysis.subgroups import BOOTSTRAP_DRAWS, blocks_of
from sma_sim.evidence.residual_analysis.wire_states import rate_of_change

Vector = NDArray[np.float64]
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
