"""What is read where values are rounded: by a converter, an encoder, or a logger that writes few digits.

A reading of x is the multiple of a step q (beside an origin o) that is nearest to x + n, with the noise n of the sensor,
normal with standard deviation s. With u = x - o, the sawtooth of the rounding error, averaged over n, is

    E[y | x] - x = sum over k of (-1)^k q/(pi k) exp(-2 (pi k s/q)^2) sin(2 pi k u/q)

(nonsubtractive dither; Widrow and Kollar, Quantization Noise, 2008). It is the same for all rows while x stays,
so it does not average out as noise does: a model that leaves it out finds an effect in it. A reading varies about it by
s^2 + q^2/12 - sum over k of (q/(pi k))^2 exp(-(2 pi k s/q)^2)/2, the mean over all u. Where s is above half a step nothing
is left of it; where s is far below the step, the reading is a staircase, and rows that repeat a value are one measurement
(`repeated_values.py`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import exp, pi, sqrt

import numpy as np
from numpy.typing import NDArray

from sma_sim.model.arrays import Matrix, Vector
from sma_sim.model.errors import UserError

LEAST_DITHER = 0.2  # of the step: below, the slope of what is read all but vanishes between two steps
ENOUGH_DITHER = 0.5  # of the step: above, the error of rounding is below a hundredth of the noise
HARMONICS = 5  # of which the next is below 1e-6 of the step at the least dither
SAME = 1e-12  # of the values, by which two spellings of one differ
OFF_GRID = 0.02  # of the step, by which values are beside its multiples at most, as a root mean square
WINDOW = 16  # rows in which what is read is taken for a straight line
WINDOWS = 500  # which tell the noise to a few per cent
SLOW = 0.5  # of a step, which a line passes in a window at most: faster, its bend would pass for noise
SURPRISES, READINGS = 0.002, 5.0  # share of readings that lie elsewhere (kinks, outliers), and among how many
SIGMAS = np.geomspace(0.05, 1.0, 22)  # of the step, among which the noise is sought
LEVELS = np.arange(-0.9, 0.91, 0.075)  # of the step, about the line of least squares
TILTS = np.arange(-0.9, 0.91, 0.225)  # of the step, over a window, likewise
FINE = 100  # entries per step of the table of probabilities


@dataclass(frozen=True)
class Rounding:
    """Readings are multiples of a `step` beside an `origin`, of values with noise of a standard deviation `std` (SI).

    Raises UserError for a step that is not above 0, or a noise below 0.
    """

    step: float
    origin: float
    std: float

    def __post_init__(self) -> None:
        if not (0.0 < self.step < np.inf and np.isfinite(self.origin) and 0.0 <= self.std < np.inf):
            raise UserError(f'{self}: expected a step above 0, an origin and a noise of 0 or more, in SI units')

    def _waves(self) -> list[tuple[float, float]]:
        """Angular wave numbers, and the error of rounding at each, with its sign."""
        numbers = range(1, HARMONICS + 1)
        return [
            (2.0 * pi * k / self.step, (-1) ** k * self.step / (pi * k) * exp(-2.0 * (pi * k * self.std / self.step) ** 2))
            for k in numbers
        ]

    def expected(self, values: Vector) -> Vector:
        """The mean reading (k,) of values (k,)."""
        found = np.array(values, dtype=float)
        for wave, size in self._waves():
            found += size * np.sin(wave * (values - self.origin))
        return found

    def slope(self, values: Vector) -> Vector:
        """By how much the mean reading (k,) changes with the values (k,)."""
        found = np.ones_like(values)
        for wave, size in self._waves():
            found += size * wave * np.cos(wave * (values - self.origin))
        return found

    @property
    def noise_std(self) -> float:
        """The standard deviation of a reading about its mean, over all values."""
        return sqrt(self.std**2 + self.step**2 / 12.0 - sum(size**2 for _, size in self._waves()) / 2.0)

    def times(self, factor: float) -> Rounding:
        """That of readings in another unit, or of the opposite sign."""
        return Rounding(abs(factor) * self.step, factor * self.origin, abs(factor) * self.std)


def rounding_of(runs: Sequence[Vector]) -> Rounding | None:
    """How a channel was rounded, whose values (k,) in some runs are given, NaN where missing.

    None where they lie on no grid that matters, where the noise hides it, and where it is so small that values repeat.
    """
    known = [run[np.isfinite(run)] for run in runs]
    grid = grid_of(np.concatenate(known)) if known else None
    if grid is None:
        return None
    step, origin = grid
    windows = slow_windows([np.rint((run - origin) / step) for run in known])
    if len(windows) == 0:
        return None
    size = noise_before(windows)
    return Rounding(step, origin, size * step) if LEAST_DITHER <= size <= ENOUGH_DITHER else None


def grid_of(values: Vector) -> tuple[float, float] | None:
    """Step and origin of the grid on which all values (k,) lie; None where there is none."""
    distinct = np.unique(values)
    apart = np.diff(distinct)
    apart = apart[apart > SAME * np.abs(distinct).max(initial=0.0)]
    if len(apart) == 0:
        return None
    rough = float(np.quantile(apart, 0.1))
    counted = np.cumsum(np.rint(np.diff(distinct, prepend=distinct[0]) / rough))  # from each to the next: no error adds up
    step, origin = np.polyfit(counted, distinct, 1)
    off = distinct - origin - step * counted
    return (float(step), float(origin)) if sqrt(float(np.mean(off**2))) < OFF_GRID * step else None


def slow_windows(runs: Sequence[Vector]) -> Matrix:
    """Stretches of readings in steps, (windows, WINDOW), in which these change by little, evenly over all runs."""
    cut = [run[: len(run) // WINDOW * WINDOW].reshape(-1, WINDOW) for run in runs]
    found = np.concatenate([np.empty((0, WINDOW)), *cut])
    _, slopes = lines(found)
    slow = found[np.abs(slopes) * WINDOW <= SLOW]
    return slow[:: -(-len(slow) // WINDOWS)] if len(slow) else slow


def lines(windows: Matrix) -> tuple[Vector, Vector]:
    """Means and slopes per row (windows,) of the lines of least squares through windows."""
    rows = np.arange(WINDOW) - 0.5 * (WINDOW - 1)
    return windows.mean(axis=1), windows @ rows / (rows @ rows)


def noise_before(windows: Matrix) -> float:
    """The standard deviation of the noise before rounding, in steps: the most likely one, whatever lines the values follow.

    `windows` (m, WINDOW): readings in steps. The likelihood of each window is averaged over all lines near its own.
    """
    means, slopes = lines(windows)
    rows = (np.arange(WINDOW) - 0.5 * (WINDOW - 1)) / WINDOW
    shifts = LEVELS[:, None, None] + (TILTS[:, None] * rows)[None]  # (levels, tilts, rows)
    beside = windows - means[:, None] - slopes[:, None] * WINDOW * rows
    reach = float(np.abs(beside).max() + np.abs(shifts).max()) + 1.0
    offsets = np.arange(-reach, reach, 1.0 / FINE)
    where = np.rint((beside[:, None, None, :] - shifts[None] + reach) * FINE).astype(np.int32)
    found = np.array([log_likelihood(where, offsets, size) for size in SIGMAS])
    best = int(np.clip(found.argmax(), 1, len(SIGMAS) - 2))
    a, b, _ = np.polyfit(np.log(SIGMAS[best - 1 : best + 2]), found[best - 1 : best + 2], 2)
    return float(np.clip(np.exp(-b / (2.0 * a)) if a < 0.0 else SIGMAS[found.argmax()], SIGMAS[0], SIGMAS[-1]))


def log_likelihood(where: NDArray[np.int32], offsets: Vector, size: float) -> float:
    """Of all windows, under noise of a `size` in steps: `where` (windows, levels, tilts, rows) each reading lies beside the
    line, by its index among `offsets` (k,) in steps."""
    from scipy.special import ndtr  # only here: it takes long to import

    hit = ndtr((offsets + 0.5) / size) - ndtr((offsets - 0.5) / size)
    table = np.log((1.0 - SURPRISES) * hit + SURPRISES / READINGS)
    each = table[np.minimum(where, len(table) - 1)].sum(axis=-1).reshape(len(where), -1)
    return float(np.sum(np.logaddexp.reduce(each, axis=1)))
