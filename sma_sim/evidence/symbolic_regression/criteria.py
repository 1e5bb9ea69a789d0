"""The thresholds by which the search for an equation decides."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class TermSearchCriteria:
    """How many terms and formulas are fitted, and when a formula is proposed.

    Attributes
    ----------
    max_first_terms, max_per_location
        Terms that are fitted after the first regression, and of one location: the regression is linear and often ranks a
        neighbour of the true term first.
    max_leads, lead_error_ratio
        Fits around which terms are exchanged, each of another port, and how far their error may lie above the least, that of
        known effects in whose place they are sought included.
    max_exchanged
        Terms that are fitted in place of those of such a fit.
    good_fit_error
        Error over noise below which no term is exchanged.
    max_second_terms, sufficient_error
        Second terms that are fitted, and the error over noise below which none is needed.
    max_refitted, refit_error_ratio
        Formulas that are refitted as effects of their own and cross-validated, and how far their error may lie above the
        least.
    min_error_reduction
        Fraction of the cross-validated error that a formula must remove as a further cause.
    decisive_log_odds
        By which a formula must explain better than as many listed causes: as e^10 for a variant, times the number of terms
        and shapes among which it was chosen.
    """

    max_first_terms: int = 9
    max_per_location: int = 2
    max_leads: int = 2
    lead_error_ratio: float = 1.5
    max_exchanged: int = 6
    good_fit_error: float = 1.03
    max_second_terms: int = 3
    sufficient_error: float = 1.1
    max_refitted: int = 4
    refit_error_ratio: float = 1.5
    min_error_reduction: float = 0.1
    decisive_log_odds: float = 20.0


TERM_SEARCH_CRITERIA = TermSearchCriteria()
