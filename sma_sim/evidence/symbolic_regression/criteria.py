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
        Fits around which terms are exchanged, each of another port, and how far their error may lie above the least.
    max_exchanged
        Terms that are fitted in place of those of such a fit.
    good_fit_error
        Error over noise below which no term is exchanged.
    exchange_tempering
        Factor on the noise variance while terms are exchanged: priors keep the parameters from following a wrong term.
    max_second_terms, sufficient_error
        Second terms that are fitted, and the error over noise below which none is needed.
    max_refitted, refit_error_ratio
        Formulas that are refitted as effects of their own and cross-validated, and how far their error may lie above the
        least.
    min_error_reduction
        Fraction of the cross-validated error that a formula must remove to be proposed.
    """

    max_first_terms: int = 9
    max_per_location: int = 2
    max_leads: int = 2
    lead_error_ratio: float = 1.5
    max_exchanged: int = 6
    good_fit_error: float = 1.03
    exchange_tempering: float = 4.0
    max_second_terms: int = 3
    sufficient_error: float = 1.1
    max_refitted: int = 4
    refit_error_ratio: float = 1.5
    min_error_reduction: float = 0.1


TERM_SEARCH_CRITERIA = TermSearchCriteria()
