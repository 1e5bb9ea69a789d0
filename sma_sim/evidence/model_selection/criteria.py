"""The thresholds of all decisions of a diagnosis: which effects are tried, accepted, named, and what the verdict is."""

from __future__ import annotations

from dataclasses import dataclass

from sma_sim.evidence.estimation.plausibility import RANGE_TOLERANCE


@dataclass(frozen=True)
class SelectionCriteria:
    """Every threshold with its reason. Errors are over noise (1: the model explains all but the noise).

    Fractions are of the error or of the sum of squares before, as each line says.
    """

    # Nominal fit
    nominal_starts: int = 2
    """Starts of the nominal fit: one may end in a valley that the other one avoids."""

    # Candidates and their probes
    shape_fractions: tuple[float, ...] = (1 / 6, 1 / 2, 5 / 6)
    """Where in its realistic range a parameter without a neutral value is probed: the centres of its thirds."""
    probe_fraction: float = 0.3
    """Probe step as a fraction of a realistic range that begins at neutral: visible, and still in the linear part."""
    range_tolerance: float = RANGE_TOLERANCE
    """Fraction of its width by which a value may lie beyond its realistic range: literature values are not sharper."""
    log_range_ratio: float = 3.0
    """Ends of a range whose ratio is larger are interpolated logarithmically."""

    # Score tests
    most_instants: int = 2000
    tried_instants: int = 3
    """Times at which residuals may change, and at how many of them an effect with an instant is probed."""
    bootstrap_draws: int = 999
    """Wild-bootstrap draws: with the measurement itself 1000, so that p-values are multiples of 0.001."""
    min_blocks: int = 8
    max_blocks: int = 40
    """Blocks of a run whose signs are flipped: enough to draw from, and long beside the correlation of the residuals."""
    block_correlations: float = 4.0
    """Length of a block in correlation times of the residuals: beyond it they count as independent."""
    min_unabsorbed: float = 1e-6
    """Fraction of a response left by what the fit can absorb, below which it is rounding error: the data cannot see it."""

    # Which candidates are refitted and cross-validated
    sketched_candidates: int = 12
    """Most candidates whose refits are sketched, which costs a twentieth of refitting them."""
    sketch_cost_ratio: float = 1.2
    """Ratio to an accepted effect's cost up to which a sketch may lead below it: it ends up to a fifth above its optimum."""
    refitted_candidates: int = 5
    """Most candidates that are refitted: one more than are cross-validated, as sketches seldom order neighbours wrongly."""
    min_relative_gain: float = 0.1
    """Fraction of the best candidate's gain below which a candidate is not tried: a refit would have to gain ten times
    what the score test predicts to catch up. Of what more than noise is, a difference between recordings must promise as
    much."""
    variants_above: float = 1.02
    """Cross-validated error up to which no variant is tried, and an effect with unrealistic values may be taken: it is what
    runs differ by."""
    min_explained_by_screening: float = 0.02
    """Fraction of the squares that the best candidate must promise for refits to be worth their time."""
    cross_validated_candidates: int = 4
    """Most refitted candidates that are cross-validated, which takes five times as long as a refit."""
    first_refits: int = 2
    """Candidates refitted before the others: the cost they reach lets hopeless refits of the others end early."""
    retried_refits: int = 3
    """Most candidates that are refitted once more with weak damping, as either may miss a valley."""
    retry_cost_ratio: float = 2.0
    """Ratio to the least cost beyond which they are not: they are too far behind for that to decide."""
    pair_candidates: int = 2
    """Candidates tried beside another effect: each takes a further step of selection."""

    # Acceptance
    min_error_reduction: float = 0.03
    """Fraction of the cross-validated error (of the noise, below it) that an accepted effect takes away: less has no use."""
    same_error: float = 0.01
    """Relative difference of errors within which two models are equally good: far below what runs differ by."""
    significance: float = 0.05
    """Chance that the best of all candidates gains as much from residuals without any effect: the usual level."""
    strong_error_reduction: float = 0.25
    """Fraction of the cross-validated error and of the fitted squares that needs no score test: chance does not do both."""
    min_explained_by_full_fit: float = 0.4
    """Fraction of the fitted squares that a fit which leaves only noise must explain: its error came from 1.3 or more."""
    decisive_log_odds: float = 10.0
    """Half the squares by which a variant must fit better than every acceptable effect, and the best candidate than those
    that predict no run left out either: chance does not do that where both leave only noise."""
    max_effects: int = 4
    """Most effects of a model: it bounds the time of a search, and recordings of few runs seldom tell more."""

    # What counts as explained
    noise_only: float = 1.1
    """Error of the fitted runs below which nothing more is looked for in them: noise is estimated to some per cent only."""
    other_kinetics_above: float = 1.01
    """Error of the fitted runs below which the other kinetics are not tried: they could not be seen to be better."""
    pooled_noise_only: float = 1.05
    """Error of runs fitted together which one model explains: with some hundred samples more is no chance, but small."""
    unexplained: float = 1.3
    """Error above which something is missing that no accepted effect explains: parameters that few runs tell, and noise that
    was estimated, can raise the error of a right model up to there."""
    adequate_part: float = 0.05
    """Part of what strain spans in a quasi-static test within which a model of one homogeneous wire predicts it: specimens
    have gradients of temperature and texture that no such model has."""
    min_part_beyond_temperature: float = 0.1
    """Part of the error of such tests below that which an effect must take away from what no uncertainty of the specimen's
    temperature explains: of simulated specimens that lack nothing, effects take up to 0.08 there, where one is missing
    mostly 0.15 and more."""
    min_named_reduction: float = 0.1
    """Fraction of the held-out error that a partial explanation takes away to be named: what imitates another effect takes
    little, or comes and goes with the run that is held out."""

    # Tempered likelihood
    tempering_stages: int = 3
    """Most fits of a tempered likelihood: it bounds their time where the weights do not settle."""
    tempering_ratio: float = 0.7
    """Another stage is fitted where the noise inflation has fallen below this fraction: otherwise it has settled."""


CRITERIA = SelectionCriteria()


def unexplained_above(span: float) -> float:
    """The error over noise above which something is missing that no accepted effect explains.

    `span`: what strain spans in isobaric tests, over its noise, which is far less than a model of one homogeneous wire can
    follow: there the least is a part of it. NaN for other runs.
    """
    return max(CRITERIA.unexplained, CRITERIA.adequate_part * span) if span == span else CRITERIA.unexplained


def fits_all(limit: float) -> float:
    """The error of runs fitted together below which one model explains them, where something is missing above a `limit`."""
    return CRITERIA.pooled_noise_only if limit <= CRITERIA.unexplained else limit
