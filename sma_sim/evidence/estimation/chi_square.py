"""The tail of the chi-square distribution, by which statistics of several values are judged."""

from __future__ import annotations

from scipy.special import chdtrc


def chi_square_tail(statistic: float, freedom: int) -> float:
    """The probability that a chi-square variable of so many degrees of freedom exceeds the statistic; NaN for none.

    A statistic below 0, as rounding may leave of nothing, counts as 0. `scipy.stats.chi2.sf` is the same; to import it takes
    longer than most commands.
    """
    return float(chdtrc(freedom, max(statistic, 0.0))) if freedom > 0 else float('nan')
