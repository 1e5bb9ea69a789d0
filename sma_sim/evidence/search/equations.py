"""The equation that a search has ended with: written as an effect of its own, with those that compete with it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from sma_sim.evidence.data.tables import write_whole
from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.model_selection.candidates import Candidate
from sma_sim.evidence.model_selection.refit import refit, without_effect
from sma_sim.evidence.model_selection.score_tests import ScreeningResult
from sma_sim.evidence.model_selection.sketches import with_candidate
from sma_sim.evidence.search.beam import Book
from sma_sim.evidence.search.posterior import Posterior
from sma_sim.evidence.search.refine import Model
from sma_sim.evidence.search.steps import standard_errors
from sma_sim.evidence.symbolic_regression.formula import Formula
from sma_sim.evidence.symbolic_regression.partial_residuals import PartialResidualPlot, partial_residual_plot
from sma_sim.evidence.symbolic_regression.stability import stabilities, stability_by_variable
from sma_sim.evidence.symbolic_regression.term_candidates import as_fitted

COMPETING = 4  # equations beside the chosen one that are reported


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
        """The share of random halves of the data whose choice depends on each variable."""
        variables = [fit.formula.variables for fit in self.ranking]
        return stability_by_variable(variables, [fit.stability for fit in self.ranking])

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
    return Proposal(formula, fitted, before.error, ranking, tied, plot, standard_errors(fitted, k, context.pool))


def has_terms(model: Model) -> bool:
    """Whether a model has terms of an equation."""
    return any(one.is_formula for one in model.components)


def names_beside(model: Model) -> frozenset[str]:
    """The components of a model that are no terms."""
    return frozenset(one.name for one in model.components if not one.is_formula)


def formula_of(model: Model) -> Formula:
    """The terms of a model with their fitted values, those of one place."""
    terms = [(one.term, one.effect) for one in model.components if one.term is not None]
    structure = model.fit.problem.config.structure.structure
    return Formula(tuple(as_fitted(term, effect, model.fit) for term, effect in terms), structure)


def as_effect(model: Model, context: SearchContext) -> FitResult:
    """The fit with the equation as one effect of its own, in place of the terms of which it was composed."""
    formula, fit = formula_of(model), model.fit
    for component in model.components:
        if component.is_formula:
            problem, z = without_effect(fit, component.effect)
            fit = FitResult(problem, z, fit.cost)
    start = {p.name: p.default for p in formula.parameters}
    problem, z = with_candidate(fit, ScreeningResult(Candidate(formula.load(), ()), 0.0, start))
    found = refit(problem, z, context)
    return found if found is not None else FitResult(problem, z, model.fit.cost)
