"""An equation for what no known effect explains: found, written as an effect, refitted, cross-validated."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import inf
from pathlib import Path

from sma_sim.evidence.data.tables import write_whole
from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.model_selection.candidate_fit import CandidateFit, is_bent
from sma_sim.evidence.model_selection.candidates import Candidate
from sma_sim.evidence.model_selection.criteria import CRITERIA
from sma_sim.evidence.model_selection.forward_selection import leaves_something, step_with
from sma_sim.evidence.model_selection.score_tests import ScreeningResult
from sma_sim.evidence.symbolic_regression.criteria import TERM_SEARCH_CRITERIA
from sma_sim.evidence.symbolic_regression.formula import Formula
from sma_sim.evidence.symbolic_regression.partial_residuals import PartialResidualPlot, partial_residual_plot
from sma_sim.evidence.symbolic_regression.search import search_formulas, without_terms
from sma_sim.evidence.symbolic_regression.stability import stabilities, stability_by_variable
from sma_sim.solver.simulate import SimulationError

MATERIAL_HOOKS = ('wire_strain', 'transformation_stress')  # taken only where no load or heat explains as much


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


@dataclass
class FormulaSearch:
    """Searches for formulas, each model's once."""

    context: SearchContext
    rankings: list[tuple[FitResult, list[FormulaFit]]] = field(default_factory=list)

    def ranking(self, base: FitResult, known: FitResult) -> list[FormulaFit]:
        """The formulas that were refitted on a model, by their cross-validated error.

        Instead of `known` effects, those are continued alone that begin near what these leave: of not more causes the listed
        ones stand, unless a formula explains better by more than its freedom does.
        """
        for searched, ranking in self.rankings:
            if searched.problem is base.problem and searched.z is base.z:
                return ranking
        instead = len(known.effects) > len(base.effects)
        most = TERM_SEARCH_CRITERIA.lead_error_ratio * max(1.0, known.error) if instead else inf
        self.rankings.append((base, refitted_formulas(base, self.context, most)))
        return self.rankings[-1][1]

    def explains(self, base: FitResult) -> bool:
        """Whether a formula alone leaves nothing that another explanation could be seen to explain better."""
        return any(not leaves_something(one.candidate.fit) for one in self.ranking(base, base)[:1])


def propose(path: Sequence[FitResult], search: FormulaSearch) -> Proposal | None:
    """Find a formula that explains better than known effects, instead of them or beside them.

    Parameters
    ----------
    path
        Fits to the training runs: the nominal model, then those with known effects, to the last.
    search
        Searches for formulas; the `seed` of its context is that of the random halves of the data.

    Returns
    -------
    Proposal or None
        The formula as an effect, with the model refitted and the others that were considered; None where the effects of the
        last fit are to be preferred (`is_better`), or the search was stopped. It stands instead of the known effects, unless
        these leave more than noise and beside them it leaves clearly less.
    """
    first, best, found = path[0], path[-1], None
    beside = [path[-1]] if len(path) > 1 and path[-1].error > CRITERIA.noise_only else []
    for base in (first, *beside):
        if search.context.stop.is_set() or (found is not None and best.error <= CRITERIA.noise_only):
            break
        proposal = proposal_for(base, best, search)
        if proposal is not None:
            best, found = proposal.fit, replace(proposal, error_before=path[-1].prediction_error)
    return found


def is_better(fit: FitResult, known: FitResult) -> bool:
    """Whether a model with a formula is to be preferred to one with known effects only.

    Fewer causes win unless the others explain better by odds that are no chance. As many must explain worse by such odds,
    and predict worse: clearly so, unless the formula leaves only noise. A further cause has to take away a part of the error
    that is worth it. Of models that explain with implausible parameters (`is_bent`), one that does not need them is better
    where it fits better by such odds and predicts as well.
    """
    more, better = len(fit.effects) - len(known.effects), known.cost - fit.cost
    predicts_as_well = fit.prediction_error <= (1.0 + CRITERIA.same_error) * known.prediction_error
    if more < 0:
        return predicts_as_well and better >= -CRITERIA.decisive_log_odds
    if better < TERM_SEARCH_CRITERIA.decisive_log_odds:
        return False
    if known.is_bent and not fit.is_bent:
        return predicts_as_well
    only_noise = more == 0 and fit.error <= CRITERIA.pooled_noise_only
    least = CRITERIA.same_error if only_noise else TERM_SEARCH_CRITERIA.min_error_reduction
    return fit.prediction_error <= (1.0 - least) * known.prediction_error


def proposal_for(base: FitResult, known: FitResult, search: FormulaSearch) -> Proposal | None:
    """The best formula on a model, if it is better than the effects of the last one."""
    ranking, context = search.ranking(base, known), search.context
    if not ranking:
        return None
    best = ranking[0].candidate.fit
    if not is_better(replace(best, is_bent=known.is_bent and is_bent(best, context)), known):
        return None
    shares = stabilities([fit.candidate.fit for fit in ranking], context.pool, context.seed)
    ranking = [replace(fit, stability=float(share)) for fit, share in zip(ranking, shares, strict=True)]
    close = [fit for fit in ranking if fit.error <= (1.0 + CRITERIA.same_error) * ranking[0].error]
    chosen = min(close, key=simplicity)
    context.on_progress(f'{chosen.formula.equation}: error over noise {chosen.error:.2f}')
    fitted = chosen.candidate.fit
    formula = chosen.formula.with_values(fitted.values_of(chosen.formula.name))
    return Proposal(
        formula, fitted, known.prediction_error, tuple(ranking),
        tuple(fit.formula.name for fit in close if fit is not chosen),
        partial_residual_plot(fitted, formula, context.pool), chosen.candidate.std,
    )  # fmt: skip


def simplicity(fit: FormulaFit) -> tuple[int, bool, float]:
    """The order in which formulas that predict equally well are taken."""
    return len(fit.formula.parameters), fit.formula.location.hook in MATERIAL_HOOKS, fit.error


def refitted_formulas(base: FitResult, context: SearchContext, most: float = inf) -> list[FormulaFit]:
    """The best formulas of the search as effects, by their cross-validated error; none where no model can be run, or comes
    down to an error of `most`.

    They are refitted and judged as effects are, from where the best sketch has led.
    """
    try:
        sketches = search_formulas(base, context, most)
    except SimulationError:
        return []
    criteria, structure = TERM_SEARCH_CRITERIA, base.problem.config.structure.structure
    near = [sketch for sketch in sketches if sketch.fitted.error <= criteria.refit_error_ratio * sketches[0].fitted.error]
    formulas: dict[str, Formula] = {}
    for formula in (Formula(sketch.terms, structure) for sketch in near):
        if len(formulas) < criteria.max_refitted:
            formulas.setdefault(formula.name, formula)
    if not formulas or context.stop.is_set():
        return []
    chosen = [formula_candidate(formula) for formula in formulas.values()]
    step = step_with(base, (), chosen, context, without_terms(base, near[0]))
    fits = [FormulaFit(formulas[fit.name], fit) for fit in step.candidate_fits if not fit.not_cross_validated]
    return sorted(fits, key=lambda fit: fit.error)


def formula_candidate(formula: Formula) -> ScreeningResult:
    """A formula as a candidate of the selection, which starts at the values that its sketch has found."""
    return ScreeningResult(Candidate(formula.load(), ()), 0.0, {p.name: p.default for p in formula.parameters}, 1.0)
