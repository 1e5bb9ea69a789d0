"""Diagnosis: which physical effect a model lacks, judged on runs that it was not fitted to.

The nominal model is fitted with the kinetics that were given, else with both; a search (`sma_sim.evidence.search`) finds the
sets of components that explain the recordings, and their probabilities; the held-out runs are read once, and the verdict is
given.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace

from sma_sim.evidence.data.readings import with_noise_of_readings
from sma_sim.evidence.data.recording import Dataset
from sma_sim.evidence.data.train_test_split import apart, hold_out_last, pooled
from sma_sim.evidence.diagnosis.conclusion import (
    HeldOutVerdict,
    ModelStage,
    PooledErrors,
    StageData,
    StageKind,
    conclusion,
    verdicts_by_run,
)
from sma_sim.evidence.estimation.calibrate import Calibration
from sma_sim.evidence.estimation.executors import executor_or_threads
from sma_sim.evidence.estimation.held_out_prediction import RunFit, pooled_error
from sma_sim.evidence.estimation.interruption import stoppable
from sma_sim.evidence.estimation.plausibility import ImplausibleParameter, implausible_in
from sma_sim.evidence.estimation.prepared_fit import PreparedFit, check_data, check_systems, prepare
from sma_sim.evidence.estimation.recording_differences import RecordingDifference
from sma_sim.evidence.estimation.search_context import OnProgress, SearchContext
from sma_sim.evidence.model_selection.nominal_fit import DiagnosisRequest, nominal_fits, report_model
from sma_sim.evidence.search.beam import search
from sma_sim.evidence.search.confounding import Confounding, SimilarEffect, confoundings, most_similar
from sma_sim.evidence.search.criteria import UNEXPLAINED
from sma_sim.evidence.search.equations import Proposal, has_terms, proposal_of
from sma_sim.evidence.search.posterior import Posterior, posterior_of
from sma_sim.evidence.search.refine import on_run_subset, with_all_runs
from sma_sim.evidence.search.steps import SelectionStep, path_to, steps_along
from sma_sim.evidence.set_up.check import faults_after_fit, faults_before_fits, noise_after_search, with_noise_at_rest
from sma_sim.evidence.set_up.faults import Fault, is_uncertain, without_faults
from sma_sim.model.archive import Saved
from sma_sim.model.argument_checks import checked
from sma_sim.model.comparable import Comparable
from sma_sim.model.config import Config
from sma_sim.model.progress import progress_in_words
from sma_sim.model.renamed import renamed
from sma_sim.model.shown import Shown, listed, text_table

TINY = 0.001  # a probability beyond which only the bound is shown: nothing is certain


@renamed(taken_back='retracted')
@dataclass(frozen=True, eq=False, repr=False)
class Diagnosis(Shown, Saved, Comparable):
    """What a diagnosis found.

    Attributes
    ----------
    verdict : str
        ``'none'``, ``'missing_effect'`` or ``'unknown_effect'``, as which a search that was stopped before it found
        anything counts too (`interrupted`).
    effects : tuple of str
        Names of the accepted effects, in order.
    stages : tuple of ModelStage
        The models from the nominal one to the last; with a `proposal` the last one has the proposed effect, which `effects`
        does not name.
    selection_steps : tuple of SelectionStep
        The candidates that were compared in each step, in order.
    posterior : sma_sim.evidence.search.posterior.Posterior
        The models that have weight, and with which probability each effect is there.
    held_out_ratio : mapping
        By effect of the first selection step, held-out error with over without.
    confounding : mapping
        By accepted effect, the effects that cannot be distinguished from it, and why.
    training, held_out : tuple of str
        Names of the recordings that were fitted, and of those held out.
    noise_std : mapping
        Standard deviation of the noise by channel, SI units.
    interrupted : bool
        Whether the diagnosis was stopped; the results are those up to then.
    seconds : float
        Time that the diagnosis took.
    proposal : Proposal or None
        The equation of what no known effect explains.
    pooled_errors : PooledErrors or None
        How well one model explains fitted and held-out runs, where the one fitted to the former misses the latter.
    retracted : tuple of str
        Effects of the best model without which the held-out runs are predicted better.
    differences : tuple of RecordingDifference
        What each recording has its own, which is no physics of the robot.
    similar : SimilarEffect or None
        The listed effect whose signature is most like that of the proposed equation.
    implausible : tuple of ImplausibleParameter
        Parameters that left their plausible range in the nominal fit; those of the last fit are in its `calibration`.
    by_held_out_run : mapping
        By recording, the verdict and effects if it were held out; empty where a single one was fitted.
    limit : float
        Normalized RMSE above which something counts as missing that no accepted effect explains.
    together : Diagnosis or None
        The search with the held-out runs among the fitted ones, where these did not say what is missing.
    search_ended : bool
        Whether the search came to its end, rather than being stopped on the way.
    set_up : tuple of Fault
        What was wrong with the recordings: signs, exchanged columns, units, the stated noise, outliers. All results are of
        the recordings without those that were `corrected`; where one was not, no effect was searched for.
    """

    verdict: str
    effects: tuple[str, ...]
    stages: tuple[ModelStage, ...]
    selection_steps: tuple[SelectionStep, ...]
    posterior: Posterior
    held_out_ratio: Mapping[str, float]
    confounding: Mapping[str, tuple[Confounding, ...]]
    training: tuple[str, ...]
    held_out: tuple[str, ...]
    noise_std: Mapping[str, float]
    interrupted: bool
    seconds: float
    proposal: Proposal | None = None
    pooled_errors: PooledErrors | None = None
    retracted: tuple[str, ...] = ()
    implausible: tuple[ImplausibleParameter, ...] = ()
    by_held_out_run: Mapping[str, HeldOutVerdict] = field(default_factory=dict)
    similar: SimilarEffect | None = None
    differences: tuple[RecordingDifference, ...] = ()
    limit: float = UNEXPLAINED
    together: Diagnosis | None = None
    search_ended: bool = True
    set_up: tuple[Fault, ...] = ()

    @property
    def has_compared(self) -> bool:
        """Whether anything was compared with the nominal model, so that probabilities say something."""
        return not is_uncertain(self.set_up) and (
            self.search_ended or any(one.candidate_fits for one in self.selection_steps)
        )

    def facts(self) -> Mapping[str, str]:
        """What is to be known at a glance; errors are root mean squares over the noise, 1 is perfect."""
        found = {
            'verdict': self.verdict,
            'effects': listed(self.effects),
            'kinetics': self.calibration.config.simulated_kinetics,
        }
        if self.proposal is not None:
            found['equation'] = self.proposal.formula.equation
        if self.set_up:
            found['set-up'] = '; '.join(fault.words for fault in self.set_up)
        before, after = self.nominal.train, self.stages[-1].train
        found['normalized RMSE'] = f'{before:.3g} without, {after:.3g} with what was found'
        found['recordings'] = f'{listed(self.training)} fitted; {listed(self.held_out)} held out'
        return found | ({'interrupted': 'the results are those up to then'} if self.interrupted else {})

    def summary(self) -> str:
        """What is to be known, the errors from model to model, and how probable it is that something is missing, as text."""
        models = [(' + '.join(one.effects) or 'nominal', f'{one.train:.3g}', f'{one.held_out:.3g}') for one in self.stages]
        errors = text_table(('normalized RMSE', 'fitted', 'held out'), models)
        if not self.has_compared:
            return '\n\n'.join([super().summary(), errors])
        missing = {'nothing': self.posterior.none, 'something unlisted': self.posterior.unlisted, **self.posterior.effects}
        said = [
            (name, f'> {1.0 - TINY}' if p > 1.0 - TINY else f'< {TINY}' if p < TINY else f'{p:.3f}')
            for name, p in missing.items()
        ]
        odds = text_table(('missing', 'probability'), said)
        return '\n\n'.join([super().summary(), errors, odds])

    @property
    def calibration(self) -> Calibration:
        """The fit of the last stage on all samples; its `config` runs in the node."""
        return self.stages[-1].calibration

    @property
    def predicted(self) -> tuple[RunFit, ...]:
        """The held-out runs under the last model."""
        return self.stages[-1].predicted

    @property
    def nominal(self) -> ModelStage:
        """The model without further effects."""
        return next(stage for stage in self.stages if stage.kind == 'nominal')

    def change(self, kind: StageKind, effect: str = '') -> tuple[ModelStage, ModelStage] | None:
        """The stages before and after a change of some kind, of an effect if one is named; None where there was none."""
        for before, after in zip(self.stages, self.stages[1:], strict=False):
            if after.kind == kind and effect in ('', *after.effects[-1:]):
                return before, after
        return None

    @property
    def deciding_steps(self) -> tuple[SelectionStep, ...]:
        """By effect of the last model, in their order, the step in which it was last compared with its rivals."""
        last = {step.accepted.name: step for step in self.selection_steps if step.accepted is not None}
        return tuple(last[name] for name in self.effects if name in last)

    @property
    def findings(self) -> tuple[str, ...]:
        """The effects that the search has found, a proposed one among them."""
        return (*self.effects, *((self.proposal.effect,) if self.proposal else ()))


@checked
def diagnose(
    dataset: Dataset,
    config: Config,
    held_out: Dataset | None = None,
    request: DiagnosisRequest | None = None,
    executor: Executor | None = None,
    on_progress: OnProgress | None = None,
) -> Diagnosis:
    """Find the physical effects that a model lacks to explain recordings.

    Parameters
    ----------
    dataset : Dataset
        Recordings with their noise.
    config : Config
        The nominal model; its active effects are part of it. Of isobaric tests, values that are defaults give way to what
        the curves show.
    held_out : Dataset, optional
        Recordings that only judge the result; without it, the last by name of three or more.
    request : DiagnosisRequest, optional
        Kinetics, folders of effects, seed, options of fits, whether to search for an equation.
    executor : Executor, optional
        Where the simulations run; without it, threads on all cores.
    on_progress : callable
        Called with a line of text at each stage; without it a terminal or a notebook shows them.

    Returns
    -------
    Diagnosis
        Verdict, accepted effects, evidence, and the calibrated model; after Ctrl-C, from the steps so far.

    Raises
    ------
    UserError
        For recordings that cannot be diagnosed.

    Examples
    --------
    A robot that lacks nothing:

    >>> import numpy as np
    >>> import sma_sim
    >>> random = np.random.default_rng(0)
    >>> def recorded(name, power):
    ...     command = sma_sim.module_input([0.0, 2.0, 8.0, 15.0], [0.0, power, 0.0, 0.0])
    ...     run = sma_sim.simulate(sma_sim.Model(), command, 4.0)
    ...     alpha = run['alpha_rad'] + 3.5e-4 * random.standard_normal(len(run.time))
    ...     return sma_sim.Recording(name, 'module', run.time, {'alpha': alpha}, command)
    >>> dataset = sma_sim.Dataset((recorded('a', 10.0), recorded('b', -8.0)), {'alpha': 3.5e-4})
    >>> options = sma_sim.FitOptions(free=('beam.E',), kinetics='hybrid', starts=1, intervals=False)
    >>> request = sma_sim.DiagnosisRequest(kinetics='hybrid', options=options, equation=False)
    >>> sma_sim.diagnose(dataset, sma_sim.Config(), request=request).verdict
    'none'
    """
    t_start, request = time.perf_counter(), request or DiagnosisRequest()
    training, held_out = hold_out_last(dataset, held_out)
    as_given = pooled(training, held_out)
    check_systems(as_given, config)
    shown = with_noise_of_readings(as_given)
    if shown is not as_given:
        training, held_out = apart(shown, len(training.recordings))
    start = prepare(training, config, request.kinetics)
    words = progress_in_words('diagnosing', on_progress)
    with stoppable() as stop, executor_or_threads(executor) as pool, words as report:
        context = SearchContext(
            pool,
            stop,
            report,
            request.folders,
            request.seed,
            variants=request.variants,
            kinetics=start.kinetics,
            on_model=request.on_model,
        )
        faults = faults_before_fits(pooled(training, held_out), start.config, request.options, context)
        uncertain, (training, held_out) = is_uncertain(faults), without_faults(training, held_out, faults)
        if faults:
            start = prepare(training, config, request.kinetics)
        if not uncertain:
            check_data(pooled(training, held_out), config)
        found = search_effects(start, held_out, request, context, faults)
        if training.floor and held_out is not None:
            found = searched_together(found, start, held_out, request, context, faults)
        interrupted = stop.is_set()
    found = replace(found, together=found.together and at_tolerance_of(found.together, config))
    return replace(at_tolerance_of(found, config), interrupted=interrupted, seconds=time.perf_counter() - t_start)


def at_tolerance_of(found: Diagnosis, config: Config) -> Diagnosis:
    """A diagnosis whose models have the solver.rtol of a configuration."""
    return replace(
        found, stages=tuple(replace(one, calibration=one.calibration.at_tolerance_of(config)) for one in found.stages)
    )


def searched_together(
    found: Diagnosis,
    start: PreparedFit,
    held_out: Dataset,
    request: DiagnosisRequest,
    context: SearchContext,
    faults: tuple[Fault, ...],
) -> Diagnosis:
    """With the diagnosis of all recordings where those fitted do not tell: one held out may be the only one that cools.

    All recordings are without `faults`. The diagnosis is as it was where it is open what is wrong with them.
    """
    if found.verdict != 'unknown_effect' or is_uncertain(found.set_up) or context.stop.is_set():
        return found
    context.on_progress('the held-out runs are not explained: searching all runs together')
    everything = start.on(pooled(start.dataset, held_out))
    joint = search_effects(everything, None, replace(request, equation=False), context, faults)
    return found if context.stop.is_set() else replace(found, together=joint)


def search_effects(
    start: PreparedFit,
    held_out: Dataset | None,
    request: DiagnosisRequest,
    context: SearchContext,
    faults: tuple[Fault, ...],
) -> Diagnosis:
    """The whole search; its time, and whether it was interrupted, are still open.

    It does not begin where it is not certain what is wrong with the recordings.
    """
    options, nominal = request.options, nominal_fits(start, request.options, context)
    best, everything = min(nominal, key=lambda fit: fit.cost), pooled(start.dataset, held_out)
    later = () if context.stop.is_set() else faults_after_fit(everything, best, options, faults, context)
    if later:
        training, held_out = without_faults(start.dataset, held_out, later)
        start, faults = start.on(training), (*faults, *later)
        nominal = nominal_fits(start, options, context)
    data = StageData(start.dataset, held_out, options)
    uncertain = is_uncertain(faults)
    if not (uncertain or context.stop.is_set()):
        nominal = with_noise_at_rest(nominal, pooled(start.dataset, held_out), options, context)
    subsets = [on_run_subset(fit) for fit in nominal]
    book = search(subsets, context, most=0, equations=False) if uncertain else search(subsets, context, request.equation)
    posterior = posterior_of(book)
    stopped = uncertain or context.stop.is_set()
    noise = () if stopped else noise_after_search(posterior.best.fit, start.dataset, options, faults, context)
    if noise:
        training, held_out = without_faults(start.dataset, held_out, noise)
        return search_effects(start.on(training), held_out, request, context, (*faults, *noise))
    models = path_to(posterior.best, book, context)
    steps, ended = steps_along(models, book, posterior), not context.stop.is_set()
    path = [with_all_runs(model, nominal, posterior.overdispersion, context) for model in models]
    for fit in path[1:]:
        report_model('accepted', fit, context)
    implausible = () if context.stop.is_set() else implausible_in(path[0], context)
    proposal = None
    if has_terms(posterior.best):
        before = max((k for k, model in enumerate(models) if not has_terms(model)))
        proposal = proposal_of(posterior.best, path[before], book, posterior, context)
        path = [*path[: before + 1], with_all_runs(replace(posterior.best, fit=proposal.fit), nominal, 1.0, context)]
    end = conclusion(path, proposal is not None, posterior, data, context)
    proposed = proposal if proposal is not None and end.stages[-1].kind == 'formula' else None
    similar = None if proposal is None or context.stop.is_set() else most_similar(proposal.fit, steps[0], context.pool)
    return Diagnosis(
        verdict='unknown_effect' if uncertain or not (ended or len(path) > 1) else end.verdict,
        effects=tuple(name for name in end.last.effects if proposed is None or name != proposed.effect),
        stages=end.stages,
        selection_steps=steps,
        posterior=posterior,
        held_out_ratio=held_out_ratios(steps[0], end.stages[0], data, context),
        confounding={step.accepted.name: confoundings(step, context.pool) for step in steps if step.accepted is not None},
        training=tuple(recording.name for recording in data.training.recordings),
        held_out=tuple(recording.name for recording in data.held_out.recordings) if data.held_out else (),
        noise_std=dict(data.training.noise_std),
        limit=data.limit,
        interrupted=False,
        seconds=0.0,
        search_ended=ended,
        proposal=proposed,
        pooled_errors=end.pooled_errors,
        retracted=tuple(name for name in path[-1].effects if name in posterior.effects and name not in end.last.effects),
        similar=similar,
        implausible=implausible,
        differences=data.differences(end.last, context),
        by_held_out_run={} if context.stop.is_set() else verdicts_by_run(book, posterior, data, end),
        set_up=faults,
    )


def held_out_ratios(first: SelectionStep, before: ModelStage, data: StageData, context: SearchContext) -> dict[str, float]:
    """By effect of the first step, the held-out error with it over that without; empty where no run is held out."""
    if data.held_out is None or context.stop.is_set():
        return {}
    predicted = {one.name: data.under(one.fit, context).predicted(one.fit, context) for one in first.candidate_fits}
    return {name: pooled_error(fits)[0] / before.held_out for name, fits in predicted.items()}
