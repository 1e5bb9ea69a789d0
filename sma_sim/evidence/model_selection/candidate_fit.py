"""A candidate's fit compared with the model without it, and the choice among several."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from math import inf, isnan, log, nan

import numpy as np

from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.estimation.free_parameters import FreeParameter
from sma_sim.evidence.estimation.levenberg_marquardt import accumulated, normal_parts
from sma_sim.evidence.estimation.overdispersion import overdispersion
from sma_sim.evidence.estimation.plausibility import implausible_in
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.estimation.temperature_uncertainty import error_beyond_temperature
from sma_sim.evidence.model_selection.candidates import other_form
from sma_sim.evidence.model_selection.criteria import CRITERIA, unexplained_above
from sma_sim.evidence.model_selection.restricted import is_plausible_fit
from sma_sim.evidence.model_selection.score_tests import ScreeningResult
from sma_sim.model.effects.discovery import FoundEffect


@dataclass(frozen=True)
class CandidateFit:
    """The fit with a candidate effect, compared with the base, which is the fit without it.

    `error_ratio`: cross-validated error with over without (the fitted error, which is smaller, where it is
    `not_cross_validated`); `error_reduction`: by how much it is lower, as a fraction of the error or of the noise,
    whichever is larger; `explained`: fraction of the fitted squares; `family_p` of the screening; `std`: standard errors by
    full name (SI); `straightens`: the base is bent, and the fit is not, though it fits better by odds that are no chance;
    `indistinguishable`: other candidates that explain as well; `beyond_temperature`: the part of the base's error that it
    takes away from what no uncertainty of the specimen's temperature explains (NaN where that is no question).
    """

    found: FoundEffect
    fit: FitResult
    delta_bic: float
    error_ratio: float
    error_reduction: float
    explained: float
    family_p: float
    plausible: bool
    std: Mapping[str, float]
    straightens: bool = False
    indistinguishable: tuple[str, ...] = ()
    beyond_temperature: float = nan

    @property
    def name(self) -> str:
        """Name of the effect."""
        return self.found.effect.name

    @property
    def is_variant(self) -> bool:
        """Whether it acts in a part of the places of its effect, or in another form."""
        return bool(self.found.effect.scope.name or other_form(self.found, self.fit.values_of(self.name)))

    @property
    def not_cross_validated(self) -> bool:
        """Whether its fitted error was larger than another's cross-validated one, so that it could not win."""
        return len(self.fit.problem.runs) > 1 and isnan(self.fit.cross_validated_error)

    @property
    def acceptable(self) -> bool:
        """Whether it explains enough, by more than chance, with realistic values."""
        return self.convincing and self.plausible

    @property
    def convincing(self) -> bool:
        """Whether it explains enough or all, and more than an uncertain temperature does, whatever its values."""
        return (self.predicts_better or self.leaves_only_noise or self.straightens) and not self.blurred

    @property
    def blurred(self) -> bool:
        """Whether what it explains may as well be the specimen's temperature, which is uncertain."""
        return is_blurred(self.beyond_temperature)

    @property
    def leaves_only_noise(self) -> bool:
        """Whether it leaves only noise where much was left without it, all fitted runs together.

        A run may go beyond what the others tell, which then predict it badly with the right effect too.
        """
        return self.fit.error <= CRITERIA.noise_only and self.explained >= CRITERIA.min_explained_by_full_fit

    @property
    def predicts_better(self) -> bool:
        """Whether runs left out are predicted better by enough, and by more than chance."""
        return self.error_reduction >= CRITERIA.min_error_reduction and self.significant

    @property
    def significant(self) -> bool:
        """Whether the score test says so, or the runs do by themselves, fitted and left out.

        A model that is far off predicts better with anything that holds it back; then the fitted runs are hardly helped.
        The score test sees what an effect gains to first order; where its fit leaves only noise, its odds count too.
        """
        strong = CRITERIA.strong_error_reduction
        found_by_runs = self.error_reduction >= strong and self.explained >= strong
        found_by_odds = self.fit.error <= CRITERIA.noise_only and self.delta_bic <= -2.0 * CRITERIA.decisive_log_odds
        return self.family_p <= CRITERIA.significance or found_by_runs or found_by_odds


@dataclass(frozen=True)
class SelectionStep:
    """One step of the selection: the base, all that was screened, the candidates that were fitted, what was accepted.

    `after`: the model with the accepted effect; `stopped`: it was not brought to its end, so that nothing could be accepted.
    `only_together`: accepted for what it explains beside the effect of the next step.
    """

    base: FitResult
    screened: tuple[ScreeningResult, ...]
    candidate_fits: tuple[CandidateFit, ...]
    accepted: CandidateFit | None
    after: FitResult | None = None
    stopped: bool = False
    only_together: bool = False


def candidate_fit(
    base: FitResult, found: FoundEffect, fit: FitResult, family_p: float, context: SearchContext
) -> CandidateFit:
    """The comparison of a fit with a candidate effect and the base without it."""
    before, after = base.prediction_error, fit.prediction_error
    k = overdispersion(fit.problem, fit.z, context.pool)
    return CandidateFit(
        found, fit, delta_bic(base, fit, k), after / before, (before - after) / max(before, 1.0),
        1.0 - fit.squares / base.squares, family_p, is_plausible_fit(fit, found), standard_errors(fit, context.pool),
        straightens(base, fit, context), beyond_temperature=gain_beyond_temperature(base, fit),
    )  # fmt: skip


def gain_beyond_temperature(base: FitResult, fit: FitResult) -> float:
    """The part of a base's error that a fit takes away from what no uncertainty of the specimen's temperature explains.

    NaN but in isobaric tests, and where more is left of these than a homogeneous wire may: then that is no question.
    """
    before = error_beyond_temperature(base)
    if isnan(before) or before > unexplained_above(base.problem.span):
        return nan
    return (before - error_beyond_temperature(fit)) / max(base.error, 1.0)


def is_blurred(gain: float) -> bool:
    """Whether a gain beyond the specimen's temperature is so small that the temperature may explain the whole."""
    return gain < CRITERIA.min_part_beyond_temperature


def straightens(base: FitResult, fit: FitResult, context: SearchContext) -> bool:
    """Whether a fit explains better and as well what is left out, without the implausible parameters of its base."""
    if not base.is_bent or fit.cost > base.cost - CRITERIA.decisive_log_odds:
        return False
    predicts_as_well = fit.prediction_error <= (1.0 + CRITERIA.same_error) * base.prediction_error
    return predicts_as_well and not is_bent(fit, context)


def is_bent(fit: FitResult, context: SearchContext) -> bool:
    """Whether parameters of a model that leaves little are implausible: with them it may imitate what it lacks."""
    return fit.error <= CRITERIA.unexplained and bool(implausible_in(fit, context))


def delta_bic(base: FitResult, fit: FitResult, k: float = 1.0) -> float:
    """Difference of the Bayesian information criterion, with minus without: negative is better.

    Squares are over those of `k`, the overdispersion that the fit leaves: of a wrong model they are no evidence.
    """
    more = len(fit.problem.free) - len(base.problem.free)
    return 2.0 * (fit.cost - base.cost) / k**2 + more * log(fit.problem.samples)


def standard_errors(fit: FitResult, pool: Executor) -> dict[str, float]:
    """Standard deviations of the free parameters (SI) from the Hessian, widened by the size of the residuals.

    Not a number where rounding leaves no variance: the data do not determine such a parameter.
    """
    _, _, hessian = accumulated(normal_parts(fit.problem, fit.z, pool), fit.z, fit.problem.tempering)
    variance = np.diag(np.linalg.inv(hessian))
    std = np.sqrt(np.where(variance >= 0.0, variance, np.nan)) * max(1.0, fit.error, fit.problem.tempering)
    return {p.name: std_of_value(p, float(z), float(s)) for p, z, s in zip(fit.problem.free, fit.z, std, strict=False)}


def std_of_value(parameter: FreeParameter, z: float, std: float) -> float:
    """A standard deviation in z as one of the value (SI)."""
    return (parameter.value(z) if parameter.log else 1.0) * parameter.scale * std


def ordered_by_error(fits: Sequence[CandidateFit]) -> tuple[CandidateFit, ...]:
    """Best first, each with those that explain as well."""
    return tuple(
        replace(candidate, indistinguishable=indistinguishable(candidate, fits))
        for candidate in sorted(fits, key=lambda candidate: candidate.error_ratio)
    )


def indistinguishable(candidate: CandidateFit, fits: Sequence[CandidateFit]) -> tuple[str, ...]:
    """Other plausible candidates whose cross-validated error is the same; an effect's own variants are no others."""
    error = candidate.fit.prediction_error
    return tuple(
        other.name for other in fits
        if other.found.effect.plain_name != candidate.found.effect.plain_name and other.plausible
        and abs(other.fit.prediction_error - error) <= CRITERIA.same_error * error
    )  # fmt: skip


def best_acceptable(fits: Sequence[CandidateFit]) -> CandidateFit | None:
    """The acceptable candidate with the least error; among equally good ones no variant, and the fewest parameters, unless
    another fits better by odds that these do not explain.

    Where one leaves only noise in all fitted runs, what leaves clearly more there is out. A variant must fit better than
    every effect by more than chance, too.
    """
    good = [candidate for candidate in fits if candidate.acceptable]
    if not good:
        return None
    least = min(good, key=lambda candidate: candidate.fit.error)
    if least.fit.error <= CRITERIA.noise_only:
        good = [candidate for candidate in good if not is_dominated(candidate, least)]
    cost_of_effects = min((candidate.fit.cost for candidate in good if not candidate.is_variant), default=inf)
    limit = cost_of_effects - CRITERIA.decisive_log_odds
    good = [candidate for candidate in good if not candidate.is_variant or candidate.fit.cost <= limit]
    best = min(candidate.fit.prediction_error for candidate in good)
    close = [candidate for candidate in good if candidate.fit.prediction_error <= (1.0 + CRITERIA.same_error) * best]
    simple = min(close, key=simplicity)
    richer = min((one for one in close if one.is_variant == simple.is_variant), key=lambda one: one.fit.cost)
    return richer if log_odds(richer, simple) > CRITERIA.decisive_log_odds else simple


def log_odds(candidate: CandidateFit, other: CandidateFit) -> float:
    """By which a candidate fits better than another: under the tempered likelihood with what the candidate leaves."""
    overdispersion = candidate.fit.problem.tempering**2 * (1.0 - candidate.explained)
    return (other.fit.cost - candidate.fit.cost) / max(1.0, overdispersion)


def simplicity(candidate: CandidateFit) -> tuple[bool, int, float]:
    """The order in which candidates that predict equally well are taken."""
    return candidate.is_variant, len(candidate.fit.problem.free), candidate.fit.prediction_error


def is_dominated(candidate: CandidateFit, best: CandidateFit) -> bool:
    """Whether the best leaves less in the fitted runs: much less, or less without predicting those left out much worse.

    Where one of the two predicts none of those left out, that the other does so less badly says nothing: the runs that are
    left do not determine the parameters, and the odds of the two in all fitted runs decide.
    """
    more = candidate.fit.error / best.fit.error
    if max(candidate.fit.prediction_error, best.fit.prediction_error) > CRITERIA.unexplained:
        return more > CRITERIA.noise_only or candidate.fit.cost - best.fit.cost > CRITERIA.decisive_log_odds
    predicts_better = candidate.fit.prediction_error < (1.0 - CRITERIA.min_error_reduction) * best.fit.prediction_error
    return more > CRITERIA.noise_only or (more > 1.0 + CRITERIA.same_error and not predicts_better)
