"""The thresholds by which the search for a missing input decides."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class LatentCriteria:
    """How far each hypothesis is followed, and when two leave as much. Whether an input is named is decided by its odds.

    Attributes
    ----------
    max_runs
        Runs that are searched, those with the largest error: the cost grows with the samples, a missing quantity shows in
        the worst runs first.
    biased_fit_error
        Normalized RMSE above which a fit is taken to be biased by what the model lacks; it is then tempered. Noise
        that was estimated may be wrong by a tenth.
    tie_ratio
        Errors within this ratio of the least explain equally well: a tenth, as above.
    reported_if_none
        Hypotheses that are reported where nothing is missing: what fits a table, none of them decides anything.
    max_finalists
        Quantities that are simulated for more than one step, which takes most of the time.
    give_up_ratios
        Ratio to the least error above which a hypothesis is given up, by step. The first steps are lenient, since a linear
        estimate may start far from where it leads.
    fast_reduction
        A hypothesis whose error falls to this fraction in a step stays as long as the first of `give_up_ratios` allows.
    converged_reduction
        Fraction of the squares before: a step that leaves more is the last.
    """

    max_runs: int = 3
    biased_fit_error: float = 1.1
    tie_ratio: float = 1.1
    reported_if_none: int = 6
    max_finalists: int = 5
    give_up_ratios: tuple[float, ...] = (3.0, 1.3, 1.15, 1.1)
    fast_reduction: float = 0.75
    converged_reduction: float = 0.95


LATENT_CRITERIA = LatentCriteria()
