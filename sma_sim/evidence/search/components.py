"""What a model may be made of beside its nominal equations, all alike: each component has a name, a prior, and a start."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sma_sim.compiler.fields_read import uses_time
from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.estimation.problem import Problem, with_difference
from sma_sim.evidence.estimation.recording_differences import RecordingDifference
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.model_selection.candidates import Candidate, candidates_for
from sma_sim.evidence.model_selection.model_changes import with_candidate
from sma_sim.evidence.model_selection.score_tests import ScreeningResult
from sma_sim.evidence.model_selection.variants import variants_of
from sma_sim.evidence.search.prior import UNLISTED, difference_log_prior, effect_log_prior
from sma_sim.evidence.symbolic_regression.term_fits import TermFit
from sma_sim.model.arrays import Vector
from sma_sim.model.effects.ports import ACTUATION, PORT_NAMES
from sma_sim.model.effects.scope import SEPARATOR
from sma_sim.solver.inputs import Input

NEUTRAL = 1e-9  # distance from a neutral value, in standard deviations of the prior, that is rounding


@dataclass(frozen=True)
class Component:
    """An addition to a model: an effect, an effect in a scope, a term of an equation, or what differs between recordings.

    `start`: the effect with the values at which a fit begins, or the difference; `log_prior`: of this one among all;
    `term`: of an equation.
    """

    name: str
    log_prior: float
    start: ScreeningResult | RecordingDifference
    term: TermFit | None = None

    @property
    def plain_name(self) -> str:
        """The name without the scope: no effect acts in two scopes at once."""
        return self.name.partition(SEPARATOR)[0]

    @property
    def effect(self) -> str:
        """The name of its effect in a configuration; empty for a difference."""
        return '' if isinstance(self.start, RecordingDifference) else self.start.candidate.name

    @property
    def is_formula(self) -> bool:
        """Whether it is a term of an equation, not a listed effect."""
        return self.term is not None

    @property
    def is_difference(self) -> bool:
        """Whether it is of the recordings, not of the robot."""
        return isinstance(self.start, RecordingDifference)

    @property
    def is_of_beginning(self) -> bool:
        """Whether it is that recordings do not begin at rest."""
        return isinstance(self.start, RecordingDifference) and self.start.in_motion

    @property
    def uses_time(self) -> bool:
        """Whether it is an effect that depends on the time, not on the robot's states alone."""
        return not isinstance(self.start, RecordingDifference) and uses_time(self.start.candidate.effect)

    def is_absent(self, fit: FitResult) -> bool:
        """Whether all that makes it act ended at its neutral value, a bound: the model without it stands for this."""
        if isinstance(self.start, RecordingDifference):
            return False
        prefix, parameters = f'effects.{self.effect}.', self.start.candidate.effect.parameters
        neutral = {prefix + p.name: float(p.neutral) for p in parameters if p.neutral is not None}
        fitted = zip(fit.problem.free, fit.z.tolist(), strict=False)
        away = [abs(z - free.coordinate(neutral[free.name])) for free, z in fitted if free.name in neutral]
        return bool(away) and max(away) < NEUTRAL

    def added_to(self, fit: FitResult) -> tuple[Problem, Vector]:
        """The problem with it, and where to start: the fit without it, and its own start."""
        if isinstance(self.start, RecordingDifference):
            return with_difference(fit.problem, fit.z, self.start)
        return with_candidate(fit, self.start)


@dataclass(frozen=True)
class Catalogue:
    """The listed effects of a structure and their scopes, and what each costs: the prior is the same for all effects, and
    what an effect has is shared by itself and its scopes."""  # fmt: skip

    effects: tuple[Candidate, ...]
    variants: tuple[Candidate, ...]

    @property
    def candidates(self) -> tuple[Candidate, ...]:
        """All of them."""
        return (*self.effects, *self.variants)

    def log_prior(self, candidate: Candidate) -> float:
        """Of one effect, or of it in one of its scopes."""
        plain = candidate.effect.plain_name
        scopes = sum(other.effect.plain_name == plain for other in self.variants)
        return effect_log_prior(len(self.effects), scopes if candidate.effect.scope.name else 1)

    def form(self, screened: ScreeningResult, law: Component, forms: int, fit: FitResult) -> Component:
        """Another form of the law of a component, one of so many `forms`, from its fitted values; no list has it."""
        found = screened.candidate.effect
        own = {p.name: float(p.neutral) for p in found.parameters if p.neutral is not None}
        values = own | fit.values_of(law.effect) | dict(screened.values)
        log_prior = effect_log_prior(len(self.effects), forms) - UNLISTED
        return Component(found.name, log_prior, replace(screened, values=values))

    def component(self, screened: ScreeningResult) -> Component:
        """A candidate with the values that a score test has found; all its parameters are fitted, whatever that has seen."""
        parameters = screened.candidate.effect.parameters
        values = {p.name: p.default if p.neutral is None else float(p.neutral) for p in parameters} | dict(screened.values)
        return Component(screened.candidate.name, self.log_prior(screened.candidate), replace(screened, values=values))


def catalogue_for(nominal: FitResult, context: SearchContext) -> Catalogue:
    """The effects that may be missing from a model and would show, and their scopes where these are asked for."""
    effects = candidates_for(nominal.problem.config, context.folders)
    if not any(is_powered(run.source) for run in nominal.problem.runs):
        # what is imposed without a driver stands in the rows that are measured, by the same clock
        found = ((one, one.effect) for one in effects)
        effects = tuple(one for one, effect in found if effect.port != PORT_NAMES[ACTUATION] and effect.clock is None)
    channels = {name for run in nominal.problem.runs for name in run.channels}
    return Catalogue(effects, variants_of(effects, channels) if context.variants else ())


def is_powered(source: Input) -> bool:
    """Whether any power was commanded in a run: without any, nothing of the driver shows."""
    columns = [k for k, name in enumerate(source.columns) if name.startswith('J')]
    return bool(np.any(np.asarray(source.values)[:, columns]))


def difference_component(difference: RecordingDifference, problem: Problem) -> Component:
    """What differs between recordings."""
    channels = len({name for run in problem.runs for name in run.channels})
    return Component(difference.words, difference_log_prior(channels, len(difference.zeros) > 1), difference)


def log_prior_of(components: Sequence[Component]) -> float:
    """Of a set of components."""
    return sum(component.log_prior for component in components)
