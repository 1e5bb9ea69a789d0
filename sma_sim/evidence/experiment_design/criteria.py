"""The settings by which the design of an experiment decides and spends its effort."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class DesignCriteria:
    """How the search for an experiment spends its budget; rivals and ties are those of a diagnosis.

    Shares and counts move time and how far the search goes, not what is promised of the sequence that it ends with.

    Attributes
    ----------
    weak_std, min_directions
        A combination of parameters is weakly known if its standard deviation exceeds this fraction of its prior's: at a
        tenth, the recordings say a hundred times what the prior says. At least so many are considered, since a design for
        one alone may tell nothing of the next.
    limit_margin
        By which a default limit exceeds what the recordings reached, of the rise above rest: little, since there the model
        was not compared with anything.
    linear_share
        Of the budget, where rivals are refitted afterwards: the linear prediction is rough there.
    random_share
        Of the linear search's budget that is spent on random sequences before the best are mutated: each shape is tried
        about three times in the default budget.
    batch
        Sequences that are evaluated at once: fixed, so that the result does not depend on the number of cores.
    default_sequences
        With which the design is compared; their mean is what a recording made without a design brings, to a third of what
        single ones scatter.
    parents
        Sequences that are kept for mutation: as many as a batch has.
    scale_down, max_scale_downs
        Factor by which a sequence shrinks that exceeds a limit, so that it ends within a fifth of it, and how often: what
        exceeds it still at 7 % of its power is given up.
    refit_share, min_refitted
        Sequences to which rivals are refitted: this share of the budget, since one costs a hundred times as much as a
        linear one, but not fewer than two batches of them.
    max_refitted_pairs
        Pairs of rivals that are refitted, the least discriminated ones: their number grows with the square of the rivals,
        and three have six.
    refitted_parents, refitted_defaults, refitted_batch
        As above, of the search with refits: half of these, and a quarter of the default sequences.
    """

    weak_std: float = 0.1
    min_directions: int = 3
    limit_margin: float = 0.1
    linear_share: float = 0.4
    random_share: float = 0.35
    batch: int = 8
    default_sequences: int = 8
    parents: int = 8
    scale_down: float = 0.8
    max_scale_downs: int = 12
    refit_share: float = 0.05
    min_refitted: int = 8
    max_refitted_pairs: int = 6
    refitted_parents: int = 4
    refitted_defaults: int = 2
    refitted_batch: int = 4


DESIGN_CRITERIA = DesignCriteria()
