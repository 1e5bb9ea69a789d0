"""Diagnosis: which physical effect a model lacks, judged on runs that it was not fitted to.

a. The bare model is fitted with either kinetics; the better goes on. b. Score tests screen all effects. c. The best are
refitted and cross-validated on the training runs. d. The best is accepted if it explains enough, by more than chance, with
a realistic value; then it goes on from b. e. The held-out runs are looked at once, and the verdict is given; partial
explanations that hardly help there are taken back. f. Where no known effect explains enough, or several leave more than
noise, an equation is proposed (`sma_sim.evidence.equation`).
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from math import isnan
from threading import Event

from sma_sim.evidence.data.recording import Campaign
from sma_sim.evidence.data.train_test_split import hold_out_last
from sma_sim.evidence.estimation.calibrate import (
    Calibration,
    MultistartResult,
    check,
    finished,
    over_runs,
    problem_for,
    result,
)
from sma_sim.evidence.estimation.cross_validation import RunFit, held_out, mean_error, run_fits, summed_up
from sma_sim.evidence.estimation.executors import some_executor
from sma_sim.evidence.estimation.free_parameters import with_values
from sma_sim.evidence.estimation.interruption import stoppable
from sma_sim.evidence.estimation.levenberg_marquardt import MinimizerResult
from sma_sim.evidence.model_selection.backward_elimination import EliminationStep, eliminate_backward
from sma_sim.evidence.model_selection.confounding import Confounding, confoundings
from sma_sim.evidence.model_selection.forward_selection import (
    LEAST_REDUCTION,
    MOST_EFFECTS,
    UNEXPLAINED,
    OnProgress,
    SearchContext,
    SelectionStep,
    prediction_error,
    select,
)
from sma_sim.evidence.model_selection.nominal_fit import DiagnosisRequest, nominal_fit
from sma_sim.evidence.model_selection.pooled_refit import PooledErrors, pooled_refit
from sma_sim.evidence.model_selection.refit import EXPLAINED, FitResult
from sma_sim.evidence.symbolic_regression.propose import Proposal, propose
from sma_sim.model.config import Config

CLEARLY = 1.5  # error over noise above which a fit on all samples makes no other verdict of it
SEVERAL, LEFT_OVER = 2, 1.05  # effects that leave more than this together are held against one formula
WORTH_NAMING = 0.1  # part of the held-out error that a partial explanation takes away
VERDICTS = ('none', 'missing_effect', 'unknown_effect')


@dataclass(frozen=True)
class ModelStage:
    """One step of the error's fall: the effects so far, the errors over noise of training and held-out runs.

    `channels`: training error by channel; `held_out_channels` likewise; NaN and empty where no run is held out. `config`
    and `delay` [s] are the model's, `runs` and `predicted` the training and held-out runs under it.
    """

    effects: tuple[str, ...]
    train: float
    held_out: float
    channels: dict[str, float]
    held_out_channels: dict[str, float]
    values: dict[str, float]
    config: Config
    delay: float
    runs: tuple[RunFit, ...]
    predicted: tuple[RunFit, ...]

    @property
    def model(self) -> str:
        """`hybrid` or `mas`."""
        return self.config.model


@dataclass(frozen=True)
class Diagnosis:
    """What was found. `calibration` is the fit of the last step on all samples; its `config` runs in the node.

    `rounds` are those of the selection; `held_out_ratio`: by effect of the first round, held-out error with over without;
    `predicted`: the held-out runs under the last model; `confounding`: by accepted effect, why others cannot be told apart.
    With a `proposal` the last model is that with the proposed effect, which `effects` does not name. `together`: how well
    one model explains fitted and held-out runs, where that which was fitted to the former misses the latter. `taken_back`:
    effects that were accepted, but hardly help to foretell the held-out runs. `revisions`: effects looked at again beside
    those that came after them.
    """

    verdict: str
    effects: tuple[str, ...]
    steps: tuple[ModelStage, ...]
    rounds: tuple[SelectionStep, ...]
    calibration: Calibration
    held_out_ratio: dict[str, float]
    predicted: tuple[RunFit, ...]
    confounding: dict[str, tuple[Confounding, ...]]
    training: tuple[str, ...]
    held_out: tuple[str, ...]
    noise_std: dict[str, float]
    interrupted: bool
    seconds: float
    proposal: Proposal | None = None
    together: PooledErrors | None = None
    taken_back: tuple[str, ...] = ()
    revisions: tuple[EliminationStep, ...] = ()

    @property
    def judged(self) -> tuple[SelectionStep, ...]:
        """By effect of the last model, in their order, the round in which it was judged last."""
        last = {one.accepted.name: one for one in (*self.rounds, *self.revisions) if one.accepted is not None}
        return tuple(last[name] for name in self.effects if name in last)

    @property
    def search_ended(self) -> bool:
        """Whether the search came to its end, rather than being stopped on the way."""
        last = self.rounds[-1] if self.rounds else None
        return last is not None and not last.stopped and (last.accepted is None or len(self.rounds) == MOST_EFFECTS)


def diagnose(
    campaign: Campaign, config: Config, held: Campaign | None = None, request: DiagnosisRequest | None = None,
    executor: Executor | None = None, on_progress: OnProgress = lambda words: None, stop: Event | None = None,
) -> Diagnosis:  # fmt: skip
    """Find what `config` lacks to explain the campaign's recordings.

    Those of `held` are only looked at in the end; without it the last of three or more recordings, by name, is held out.
    Ctrl-C, or `stop`, ends the search with the steps so far. Raises UserError for what cannot be diagnosed.
    """
    if stop is None:
        with stoppable() as stop:
            return diagnose(campaign, config, held, request, executor, on_progress, stop)
    t_start, request = time.perf_counter(), request or DiagnosisRequest()
    training, out = hold_out_last(campaign, held)
    check(training, config, request.options)
    with some_executor(executor) as pool:
        context = SearchContext(pool, stop, on_progress, request.folders, request.seed)
        bare = nominal_fit(training, config, request, context)
        rounds = select(bare, context)
        path, revisions = path_of(bare, rounds, context)
        end = ending(path, training, out, request, context, t_start)
        steps, last = end.steps, end.last
        ratios = held_out_ratios(rounds[0], steps[0], out, context) if rounds else {}
        confounding = {
            one.accepted.name: confoundings(one, pool) for one in (*rounds, *revisions) if one.accepted is not None
        }
    return Diagnosis(
        end.verdict, last.effects, steps, rounds, end.calibration, ratios, steps[-1].predicted, confounding,
        tuple(one.name for one in training.recordings), tuple(one.name for one in out.recordings) if out else (),
        dict(campaign.noise_std), stop.is_set(), time.perf_counter() - t_start, end.proposal, end.together,
        tuple(name for name in path[-1].effects if name not in last.effects), revisions,
    )  # fmt: skip


@dataclass(frozen=True)
class Ending:
    """What is made of the models that were found: the verdict, the last of them, and its fit on all samples.

    `steps`, `together` and `proposal` as in Diagnosis.
    """

    verdict: str
    last: FitResult
    steps: tuple[ModelStage, ...]
    calibration: Calibration
    together: PooledErrors | None
    proposal: Proposal | None


def ending(
    path: Sequence[FitResult],
    training: Campaign,
    out: Campaign | None,
    request: DiagnosisRequest,
    context: SearchContext,
    t_start: float,
) -> Ending:
    """Look at the held-out runs, take back what does not help there, and look for an equation where much is left.

    Where that is sure to follow, the model of known effects is not fitted on all samples first.
    """
    bare, last, stop = path[0], path[-1], context.stop
    steps = [stage_of(training, out, one, request, context) for one in path[:-1]]
    final, together = None, None
    sketch = stage_of(training, out, last, request, context) if request.equation and last.error > CLEARLY else None
    if sketch is not None and not sketch.held_out <= CLEARLY:
        steps.append(sketch)
    else:
        final = final_stage(steps, training, out, last, request, context, t_start)
    if out and goes_further(steps[-1]):
        together = pooled_refit(training, out, last, steps[-1].predicted, request.options, context)
    verdict = verdict_of(steps[-1], together)
    if verdict == 'unknown_effect' and not stop.is_set() and (best := predicts_best(steps)) < len(path) - 1:
        last = path[best]
        context.on_progress('the held-out runs are foretold better with fewer effects')
        if final is None:
            steps.append(steps[best])
        else:
            final = final_stage(steps, training, out, last, request, context, t_start)
        verdict = verdict_with_fewer(steps[-1])
    proposal = None
    if request.equation and prediction_error(last) > EXPLAINED and not stop.is_set():
        verdict, proposal = with_equation(verdict, bare, last, context)
    if proposal is not None:
        final = final_stage(steps, training, out, proposal.fitted, request, context, t_start)
    elif final is None:
        steps.pop()
        final = final_stage(steps, training, out, last, request, context, t_start)
    return Ending(verdict, last, tuple(steps), final, together, proposal)


def with_equation(verdict: str, bare: FitResult, last: FitResult, context: SearchContext) -> tuple[str, Proposal | None]:
    """The verdict and the equation of what no known effect explains, if any is better than nothing.

    Several effects that leave more than noise in the fitted runs may imitate something that none of them is: if one formula
    foretells better than all of them, it is taken, and they explain a part.
    """
    if verdict == 'unknown_effect':
        return verdict, propose([bare, last] if last is not bare else [bare], context)
    if len(last.effects) < SEVERAL or last.error <= LEFT_OVER:
        return verdict, None
    context.on_progress(f'{" and ".join(last.effects)} leave more than noise: is there one formula that leaves less?')
    found = propose([bare], context)
    if found is None or prediction_error(found.fitted) > (1.0 - LEAST_REDUCTION) * prediction_error(last):
        return verdict, None
    return 'unknown_effect', found


def path_of(
    bare: FitResult, rounds: Sequence[SelectionStep], context: SearchContext
) -> tuple[list[FitResult], tuple[EliminationStep, ...]]:
    """The models from the bare one to the last, whose effects were looked at again beside each other."""
    path = [bare, *(after for after in (one.after for one in rounds) if after is not None)]
    last, revisions = eliminate_backward(path[-1], rounds, context)
    return [*(path[:-1] if last.effects == path[-1].effects else path), last], revisions


def final_stage(
    steps: list[ModelStage], training: Campaign, out: Campaign | None, last: FitResult, request: DiagnosisRequest,
    context: SearchContext, t_start: float,
) -> Calibration:  # fmt: skip
    """The last model fitted on all samples, with intervals; its errors become a further one of the `steps`."""
    context.on_progress('the last fit, on all samples')
    options = replace(request.options, free=tuple(p.name for p in last.problem.free))
    found = MultistartResult(last.problem, MinimizerResult(last.z, last.cost, 0, True), ())
    done = finished(training, found, options, context.pool, context.stop, None)
    scores = {last.problem.config.model: last.validated}
    rtol = last.problem.config.parameters['solver.rtol']
    final = result(done, rtol, scores, options, context.pool, context.stop, t_start)
    predicted = held_out(final.config, out, final.delay, context.pool) if out else ()
    held, held_channels = summed_up(predicted)
    steps.append(ModelStage(
        last.effects, final.error, held, dict(final.channels), held_channels, dict(final.values), final.config, final.delay,
        final.runs, predicted,
    ))  # fmt: skip
    return final


def stage_of(
    training: Campaign, out: Campaign | None, one: FitResult, request: DiagnosisRequest, context: SearchContext
) -> ModelStage:
    """The errors of a model that was fitted on the way."""
    problem = replace(
        problem_for(training, one.problem.config, request.options, 1, step_limited=False), free=one.problem.free
    )
    runs = run_fits(problem, one.z, context.pool)
    channels = over_runs(problem, runs)
    config, delay = with_values(one.problem.config, one.values), one.problem.delay_at(one.z)
    predicted = held_out(config, out, delay, context.pool) if out else ()
    held, held_channels = summed_up(predicted)
    return ModelStage(
        one.effects, mean_error(channels), held, channels, held_channels, one.values, config, delay, runs, predicted
    )


def held_out_ratios(
    first: SelectionStep, bare: ModelStage, out: Campaign | None, context: SearchContext
) -> dict[str, float]:
    """By effect of the first round, the held-out error with it over that without; empty where no run is held out."""
    ratios: dict[str, float] = {}
    if out is None:
        return ratios
    for one in first.tried:
        config = with_values(one.fitted.problem.config, one.fitted.values)
        predicted = held_out(config, out, one.fitted.problem.delay_at(one.fitted.z), context.pool)
        ratios[one.name] = summed_up(predicted)[0] / bare.held_out
    return ratios


def predicts_best(steps: Sequence[ModelStage]) -> int:
    """The last step that takes a part worth naming from the held-out error; the last of all without held-out runs.

    What imitates something else takes little, or comes and goes with the run that is held out. A step without more effects
    (a rival in the place of one, or one dropped) is undone only if it costs as much.
    """
    if isnan(steps[-1].held_out):
        return len(steps) - 1
    best = 0
    for k, step in enumerate(steps):
        part = WORTH_NAMING if len(step.effects) > len(steps[best].effects) else -WORTH_NAMING
        if step.held_out <= (1.0 - part) * steps[best].held_out:
            best = k
    return best


def goes_further(last: ModelStage) -> bool:
    """Whether the fitted runs are explained, and those held out are not."""
    return last.train <= EXPLAINED and last.held_out > UNEXPLAINED


def verdict_of(last: ModelStage, together: PooledErrors | None) -> str:
    """`none`, `missing_effect`, or `unknown_effect` where much is left unexplained.

    Without a held-out run the error of the fitted ones counts: that of runs left out in turn is large where one run alone
    cannot tell the parameters, which is no sign of an effect. Nor is a held-out run that the model explains `together` with
    the fitted ones.
    """
    error = last.train if isnan(last.held_out) else last.held_out
    if error > UNEXPLAINED and not (together is not None and together.explained):
        return 'unknown_effect'
    return 'missing_effect' if last.effects else 'none'


def verdict_with_fewer(last: ModelStage) -> str:
    """The verdict on a model from which effects were taken back: what is left in the fitted runs asked for them."""
    return 'unknown_effect' if last.train > UNEXPLAINED else verdict_of(last, None)
