"""An equation for what no known effect explains: found, written as an effect, refitted, cross-validated."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.data.tables import write_whole
from sma_sim.evidence.estimation.executors import run_in_threads
from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.estimation.free_parameters import declared_parameters, free_parameter
from sma_sim.evidence.estimation.problem import Problem
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.estimation.stop_criteria import StopCriteria
from sma_sim.evidence.model_selection.candidate_fit import CandidateFit
from sma_sim.evidence.model_selection.candidates import Candidate
from sma_sim.evidence.model_selection.criteria import CRITERIA
from sma_sim.evidence.model_selection.forward_selection import cross_validated_candidate
from sma_sim.evidence.model_selection.kinetics_choice import better_kinetics
from sma_sim.evidence.model_selection.refit import refit
from sma_sim.evidence.model_selection.score_tests import ScreeningResult
from sma_sim.evidence.symbolic_regression.augmented_fit import AugmentedFit
from sma_sim.evidence.symbolic_regression.criteria import TERM_SEARCH_CRITERIA
from sma_sim.evidence.symbolic_regression.formula import Formula
from sma_sim.evidence.symbolic_regression.partial_residuals import PartialResidualPlot, partial_residual_plot
from sma_sim.evidence.symbolic_regression.search import search_formulas
from sma_sim.evidence.symbolic_regression.stability import stabilities, stability_by_variable
from sma_sim.model.effects.discovery import ActiveEffect
from sma_sim.solver.simulate import SimulationError

Vector = NDArray[np.float64]
MATERIAL_HOOKS = ('wire_strain', 'transformation_stress')  # taken only where no load or heat explains as much
FORMULA_STOP_CRITERIA = StopCriteria(
    max_iterations=10, damping=1.0, min_decrease=0.3, relative_decrease=1e-3, central=True
)  # it starts at its optimum


@dataclass(frozen=True)
class FormulaFit:
    """One formula after its refit as an effect.

    `stability`: the share of random halves of the data in which it is the best of all that were refitted.
    """

    formula: Formula
    candidate: CandidateFit
    stability: float = float('nan')

    @property
    def error(self) -> float:
        """Cross-validated error over noise."""
        return self.candidate.fit.prediction_error


@dataclass(frozen=True)
class Proposal:
    """The best formula as an effect, and those that were refitted beside it.

    Attributes
    ----------
    formula
        What is proposed.
    fit
        The model with it.
    error_before
        The cross-validated error over noise without it.
    ranking
        All formulas that were refitted, the best first.
    indistinguishable
        Names of formulas that these data do not distinguish from it.
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
        return next(fit.stability for fit in self.ranking if fit.formula.name == self.formula.name)

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


def propose(bases: Sequence[FitResult], context: SearchContext) -> Proposal | None:
    """Find an equation that explains what is left of the best of some fits.

    Parameters
    ----------
    bases
        Fits to the training runs: the nominal model first, then those with known effects. Later ones are used where no
        formula helps the first.
    context
        Runs the simulations; its `seed` is that of the random halves of the data.

    Returns
    -------
    Proposal or None
        The formula as an effect, with the model refitted and the others that were considered; None where no formula removes
        `TERM_SEARCH_CRITERIA.min_error_reduction` of the least cross-validated error, or the search was stopped.
    """
    least_error = min(base.prediction_error for base in bases)
    for base in bases:
        if context.stop.is_set():
            break
        proposal = proposal_for(base, least_error, context)
        if proposal is not None:
            return proposal
    return None


def proposal_for(base: FitResult, least_error: float, context: SearchContext) -> Proposal | None:
    """The best formula on one model, if it removes enough of the least error so far."""
    ranking = refitted_formulas(base, context)
    if not ranking or ranking[0].error > (1.0 - TERM_SEARCH_CRITERIA.min_error_reduction) * least_error:
        return None
    shares = stabilities([fit.candidate.fit for fit in ranking], context.pool, context.seed)
    ranking = [replace(fit, stability=float(share)) for fit, share in zip(ranking, shares, strict=True)]
    close = [fit for fit in ranking if fit.error <= (1.0 + CRITERIA.same_error) * ranking[0].error]
    chosen = min(close, key=simplicity)
    context.on_progress(f'{chosen.formula.equation}: error over noise {chosen.error:.2f}')
    fitted = better_kinetics(chosen.candidate.fit, context)
    formula = chosen.formula.with_values(fitted.values_of(chosen.formula.name))
    return Proposal(
        formula, fitted, least_error, tuple(ranking), tuple(fit.formula.name for fit in close if fit is not chosen),
        partial_residual_plot(fitted, formula, context.pool), chosen.candidate.std,
    )  # fmt: skip


def simplicity(fit: FormulaFit) -> tuple[int, bool, float]:
    """The order in which formulas that predict equally well are taken."""
    return len(fit.formula.parameters), fit.formula.location.hook in MATERIAL_HOOKS, fit.error


def refitted_formulas(base: FitResult, context: SearchContext) -> list[FormulaFit]:
    """The best formulas of the search as effects, by their cross-validated error; none where no model can be run."""
    try:
        fits = search_formulas(base, context)
    except SimulationError:
        return []
    criteria = TERM_SEARCH_CRITERIA
    best = [fit for fit in fits if fit.fitted.error <= criteria.refit_error_ratio * fits[0].fitted.error]
    jobs = [partial(fit_formula, base, fit, context) for fit in best[: criteria.max_refitted]]
    refitted = [fit for fit in run_in_threads(jobs, context.stop) if fit] if jobs else []
    return sorted(refitted, key=lambda fit: fit.error)


def fit_formula(base: FitResult, fit: AugmentedFit, context: SearchContext) -> FormulaFit | None:
    """A formula refitted as an effect of its own, and cross-validated; None where it cannot be run, or after Ctrl-C."""
    formula = Formula(fit.terms, base.problem.config.structure.structure)
    effect = formula.load()
    problem, z = problem_with_formula(base, fit, formula)
    fitted = refit(problem, z, context, FORMULA_STOP_CRITERIA)
    if fitted is None or context.stop.is_set():
        return None
    screened = ScreeningResult(Candidate(effect, ()), base.cost - fitted.cost, {}, 1.0)
    return FormulaFit(formula, cross_validated_candidate(base, screened, fitted, context))


def problem_with_formula(base: FitResult, fit: AugmentedFit, formula: Formula) -> tuple[Problem, Vector]:
    """The problem with the formula's effect, at the fit that was found with the terms."""
    config = base.problem.config
    values = tuple(p.default for p in formula.parameters)
    config = replace(config, effects=(*config.effects, ActiveEffect(formula.load(), values)))
    declared = declared_parameters(config)
    names = [f'effects.{formula.name}.{p.name}' for p in formula.parameters]
    free = [free_parameter(name, value, declared[name]) for name, value in zip(names, values, strict=True)]
    n, with_terms = len(base.problem.free), len(fit.fitted.problem.free)
    z = np.concatenate([fit.fitted.z[:n], np.zeros(len(free)), fit.fitted.z[with_terms:]])
    return replace(base.problem, config=config, free=(*base.problem.free, *free)), z
