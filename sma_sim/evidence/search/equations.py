"""The equation that a search has ended with: written as an effect of its own, with those that compete with it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sma_sim.evidence.data.tables import write_whole
from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.estimation.levenberg_marquardt import refit
from sma_sim.evidence.estimation.problem import Problem, normal_parts, residuals_at
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.model_selection.candidates import Candidate
from sma_sim.evidence.model_selection.model_changes import with_candidate
from sma_sim.evidence.model_selection.score_tests import ScreeningResult
from sma_sim.evidence.search.beam import Book, stripped
from sma_sim.evidence.search.posterior import Posterior
from sma_sim.evidence.search.refine import Model
from sma_sim.evidence.search.steps import standard_errors
from sma_sim.evidence.symbolic_regression.formula import Formula, as_fitted
from sma_sim.evidence.symbolic_regression.partial_residuals import PartialResidualPlot, partial_residual_plot
from sma_sim.model.arrays import Vector

COMPETING = 4  # equations beside the chosen one that are reported
SEGMENTS_PER_RUN = 25  # each longer than residuals correlate
COMPLEMENTARY_PAIRS = 200  # of halves: shares are then known to within 3 %
TIE_TOLERANCE = 1e-9  # of the squares: rounding


@dataclass(frozen=True)
class FormulaFit:
    """An equation with its fitted values, its normalized RMSE, and its log odds against the chosen one.

    `stability`: the share of random halves of the data in which it is the best of those that are reported.
    """

    formula: Formula
    error: float
    log_odds: float
    stability: float


@dataclass(frozen=True)
class Proposal:
    """An equation as an effect, and those that were fitted beside it.

    Attributes
    ----------
    formula
        What is proposed.
    fit
        The model with it.
    error_before
        The fitted normalized RMSE without it.
    ranking
        Equations by score, the proposed one first.
    indistinguishable
        Names of equations that these data do not distinguish from it.
    plot
        The quantity over its variable.
    std
        Standard errors of the parameters by full name (SI), with the model's priors.
    """

    formula: Formula
    fit: FitResult
    error_before: float
    ranking: tuple[FormulaFit, ...]
    indistinguishable: tuple[str, ...]
    plot: PartialResidualPlot
    std: Mapping[str, float]

    @property
    def effect(self) -> str:
        """The name of the effect."""
        return self.formula.name

    @property
    def ports(self) -> tuple[str, ...]:
        """The effects' port, once for every port on which the formula or one that is as good acts."""
        others = [fit.formula.location.hook for fit in self.ranking if fit.formula.name in self.indistinguishable]
        return tuple(dict.fromkeys([self.formula.location.hook, *others]))

    @property
    def stability(self) -> float:
        """The share of random halves of the data that choose this formula."""
        return self.ranking[0].stability

    @property
    def by_variable(self) -> Mapping[str, float]:
        """The share of random halves of the data whose choice depends on each variable, the largest first."""
        shares: dict[str, float] = {}
        for fit in self.ranking:
            for name in fit.formula.variables:
                shares[name] = shares.get(name, 0.0) + fit.stability
        return dict(sorted(shares.items(), key=lambda item: -item[1]))

    def write(self, folder: Path, values: dict[str, float], source: str) -> Path:
        """Write the effect file with fitted values (by the short names) as defaults; returns its path."""
        folder.mkdir(parents=True, exist_ok=True)
        path = folder / f'{self.effect}.py'
        text = self.formula.with_values(values).text(source)
        write_whole(path, lambda file: file.write(text))
        return path


def proposal_of(model: Model, before: FitResult, book: Book, posterior: Posterior, context: SearchContext) -> Proposal:
    """The equation of a model that has terms, `before` being the fit without them."""
    k, rest = posterior.overdispersion, names_beside(model)
    others = [one for one in book.ranked() if has_terms(one) and names_beside(one) == rest and one.names != model.names]
    competing = [model, *others[:COMPETING]]
    shares = stabilities([one.fit for one in competing], context.pool, context.seed)
    ranking = tuple(
        FormulaFit(formula_of(one), one.fit.error, one.score(k) - model.score(k), float(share))
        for one, share in zip(competing, shares, strict=True)
    )
    fitted = as_effect(model, context)
    formula = ranking[0].formula
    formula = formula.with_values(fitted.values_of(formula.name))
    tied = tuple(formula_of(one).name for one in posterior.rivals(competing, model))
    plot = partial_residual_plot(fitted, formula, context.pool)
    parts = normal_parts(fitted.problem, fitted.z, context.pool)
    return Proposal(formula, fitted, before.error, ranking, tied, plot, standard_errors(fitted, parts, k))


def has_terms(model: Model) -> bool:
    """Whether a model has terms of an equation."""
    return any(one.is_formula for one in model.components)


def names_beside(model: Model) -> frozenset[str]:
    """The components of a model that are no terms."""
    return frozenset(one.name for one in model.components if not one.is_formula)


def formula_of(model: Model) -> Formula:
    """The terms of a model with their fitted values, those of one place."""
    terms = [(one.term, one.effect) for one in model.components if one.term is not None]
    structure = model.fit.problem.config.structure
    return Formula(tuple(as_fitted(term, effect, model.fit) for term, effect in terms), structure)


def as_effect(model: Model, context: SearchContext) -> FitResult:
    """The fit with the equation as one effect of its own, in place of the terms of which it was composed."""
    formula, rest = formula_of(model), stripped(model, [one for one in model.components if one.is_formula])
    start = {p.name: p.default for p in formula.parameters}
    problem, z = with_candidate(rest.fit, ScreeningResult(Candidate(formula.load(), ()), 0.0, start))
    found = refit(problem, z, context)
    return found if found is not None else FitResult(problem, z, model.fit.cost)


def stabilities(fits: Sequence[FitResult], pool: Executor, seed: int = 0) -> Vector:
    """The share of random halves of the data in which each of several fits to the same runs is the best, (fits,).

    Stability selection (Meinshausen and Buehlmann, J. R. Stat. Soc. B 72, 2010; in complementary pairs: Shah and Samworth,
    ibid. 75, 2013), with what is costly left out: the formulas are not fitted again to each half, but the squares that each
    leaves at its own fit are summed anew (as phylogenetics resamples likelihoods: Kishino, Miyata and Hasegawa, J. Mol.
    Evol. 31, 1990). Halves are made of segments of time, since residuals are correlated. Best: least squares over noise plus
    log N for each parameter, as in the Bayesian information criterion. A tie is shared.
    """
    squares = np.array([squares_by_segment(fit.problem, fit.z, pool) for fit in fits])
    samples = fits[0].problem.samples / 2.0
    penalties = np.log(samples) * np.array([len(fit.problem.free) for fit in fits], dtype=float)
    random, count = np.random.default_rng(seed), squares.shape[1]
    wins = np.zeros(len(fits))
    for _ in range(COMPLEMENTARY_PAIRS):
        order = random.permutation(count)
        for half in (order[: count // 2], order[count // 2 :]):
            bic = squares[:, half].sum(axis=1) + penalties
            best = bic <= bic.min() + TIE_TOLERANCE * samples
            wins += best / best.sum()
    return wins / (2 * COMPLEMENTARY_PAIRS)


def squares_by_segment(problem: Problem, z: Vector, pool: Executor) -> Vector:
    """Sums of squared residuals over noise, all channels, (runs SEGMENTS_PER_RUN,); inf where a run cannot be simulated."""
    squares = []
    for residuals in residuals_at(problem, z, pool):
        if residuals is None:
            squares += [np.inf] * SEGMENTS_PER_RUN
        else:
            squares += [float(np.vdot(part, part)) for part in np.array_split(residuals, SEGMENTS_PER_RUN, axis=1)]
    return np.array(squares)
