"""An equation for what no known effect explains: found, written as an effect, refitted, judged on runs left out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.data.tables import write_whole
from sma_sim.evidence.estimation.calibrate import run_in_threads
from sma_sim.evidence.estimation.free_parameters import declared_parameters, free_parameter
from sma_sim.evidence.estimation.levenberg_marquardt import StopCriteria
from sma_sim.evidence.estimation.problem import Problem
from sma_sim.evidence.model_selection.candidates import Candidate
from sma_sim.evidence.model_selection.forward_selection import (
    SAME,
    CandidateFit,
    SearchContext,
    better_kinetics,
    candidate_fit,
    prediction_error,
)
from sma_sim.evidence.model_selection.refit import FitResult, refit
from sma_sim.evidence.model_selection.score_tests import Screened
from sma_sim.evidence.symbolic_regression.augmented_fit import AugmentedFit
from sma_sim.evidence.symbolic_regression.formula import Formula
from sma_sim.evidence.symbolic_regression.partial_residuals import Portrait, portrait
from sma_sim.evidence.symbolic_regression.search import search
from sma_sim.evidence.symbolic_regression.stability import by_variable, stabilities
from sma_sim.model.effects.discovery import ActiveEffect
from sma_sim.solver.simulate import SimulationError

Vector = NDArray[np.float64]
FINALISTS = 4  # formulas that are refitted through the simulator and cross-validated
RATHER_GOOD = 1.5  # times the least error: formulas beyond it are not
LEAST_FALL = 0.1  # part of the cross-validated error that a formula must take away to be proposed
MATERIAL = ('wire_strain', 'transformation_stress')  # ports that are taken only where no load or heat explains as much
JOIN = StopCriteria(most=10, damping=1.0, enough=0.3, gain=1e-3, near=True)


@dataclass(frozen=True)
class Judged:
    """One formula after its refit: `error` on runs left out in turn, its parameters with standard errors (SI).

    `stability`: the share of random halves of the data in which it is the best of all that were refitted.
    """

    formula: Formula
    tried: CandidateFit
    stability: float = float('nan')

    @property
    def error(self) -> float:
        """Cross-validated error over noise."""
        return prediction_error(self.tried.fitted)


@dataclass(frozen=True)
class Proposal:
    """What is proposed: the best formula as an effect, the others that were tried (best first), which are as good.

    `before`: the cross-validated error without it; `fitted`: the model with it; `indistinguishable`: names of
    formulas that these data cannot tell from it; `portrait`: the quantity over its variable; `std`: standard errors by full
    name (SI), with the model's priors.
    """

    formula: Formula
    fitted: FitResult
    before: float
    judged: tuple[Judged, ...]
    indistinguishable: tuple[str, ...]
    portrait: Portrait
    std: Mapping[str, float]

    @property
    def effect(self) -> str:
        """The name of the effect."""
        return self.formula.name

    @property
    def ports(self) -> tuple[str, ...]:
        """The effects' port, once for every port on which the formula or one that is as good acts."""
        others = [one.formula.place.hook for one in self.judged if one.formula.name in self.indistinguishable]
        return tuple(dict.fromkeys([self.formula.place.hook, *others]))

    @property
    def stability(self) -> float:
        """The share of random halves of the data that choose this formula."""
        return next(one.stability for one in self.judged if one.formula.name == self.formula.name)

    @property
    def by_variable(self) -> Mapping[str, float]:
        """The share of random halves of the data whose choice depends on each variable."""
        return by_variable([one.formula.variables for one in self.judged], [one.stability for one in self.judged])

    def write(self, folder: Path, values: dict[str, float], origin: str) -> Path:
        """Write the effect file with fitted values (by the short names) as defaults; returns its path."""
        folder.mkdir(parents=True, exist_ok=True)
        path = folder / f'{self.effect}.py'
        text = self.formula.with_values(values).text(origin)
        write_whole(path, lambda file: file.write(text))
        return path


def propose(bases: Sequence[FitResult], place: SearchContext) -> Proposal | None:
    """An equation that explains what is left of the best of some fits; None where none does.

    `bases`: the bare model first, then those with known effects; later ones are tried where nothing helps the first.
    """
    least = min(prediction_error(one) for one in bases)
    for base in bases:
        if place.stop.is_set():
            break
        found = proposed_for(base, least, place)
        if found is not None:
            return found
    return None


def proposed_for(base: FitResult, least: float, place: SearchContext) -> Proposal | None:
    """The best formula on one model, if it takes enough of the least error so far."""
    try:
        grown = search(base, place)
    except SimulationError:
        return None
    best = [one for one in grown if one.fitted.error <= RATHER_GOOD * grown[0].fitted.error][:FINALISTS]
    judged = (
        [one for one in run_in_threads([partial(judge, base, one, place) for one in best], place.stop) if one]
        if best
        else []
    )
    judged.sort(key=lambda one: one.error)
    if not judged or judged[0].error > (1.0 - LEAST_FALL) * least:
        return None
    shares = stabilities([one.tried.fitted for one in judged], place.pool, place.seed)
    judged = [replace(one, stability=float(share)) for one, share in zip(judged, shares, strict=True)]
    close = [one for one in judged if one.error <= (1.0 + SAME) * judged[0].error]
    chosen = min(close, key=lambda one: (len(one.formula.parameters), one.formula.place.hook in MATERIAL, one.error))
    place.on_progress(f'{chosen.formula.equation}: error over noise {chosen.error:.2f}')
    fitted = better_kinetics(chosen.tried.fitted, place)
    indistinguishable = tuple(one.formula.name for one in close if one is not chosen)
    formula = chosen.formula.with_values(fitted.values_of(chosen.formula.name))
    return Proposal(
        formula, fitted, least, tuple(judged), indistinguishable, portrait(fitted, formula, place.pool), chosen.tried.std
    )


def judge(base: FitResult, grown: AugmentedFit, place: SearchContext) -> Judged | None:
    """A formula refitted as an effect of its own, and cross-validated."""
    formula = Formula(grown.guesses)
    found = formula.found()
    problem, z = with_formula(base, grown, formula)
    fitted = refit(problem, z, place.pool, place.stop, JOIN)
    if fitted is None or place.stop.is_set():
        return None
    return Judged(
        formula, candidate_fit(base, Screened(Candidate(found, ()), base.cost - fitted.cost, {}, 1.0), fitted, place)
    )


def with_formula(base: FitResult, grown: AugmentedFit, formula: Formula) -> tuple[Problem, Vector]:
    """The problem with the formula's effect, at the fit that was found with the terms."""
    config = base.problem.config
    values = tuple(p.default for p in formula.parameters)
    config = replace(config, effects=(*config.effects, ActiveEffect(formula.found(), values)))
    declared = declared_parameters(config)
    names = [f'effects.{formula.name}.{p.name}' for p in formula.parameters]
    new = [free_parameter(name, value, declared[name]) for name, value in zip(names, values, strict=True)]
    n, more = len(base.problem.free), len(grown.fitted.problem.free)
    z = np.concatenate([grown.fitted.z[:n], np.zeros(len(new)), grown.fitted.z[more:]])
    return replace(base.problem, config=config, free=(*base.problem.free, *new)), z
