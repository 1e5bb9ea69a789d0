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
from dataclasses import dataclass, field, replace
from math import isfinite, isnan
from pathlib import Path
from threading import Event

from sma_sim.evidence.calibrate import (
    MODELS,
    Calibration,
    Found,
    Options,
    check,
    finished,
    over_runs,
    prepared,
    result,
    search,
)
from sma_sim.evidence.descent import FIRST, Descent
from sma_sim.evidence.equation.propose import Proposal, propose
from sma_sim.evidence.free_parameters import with_values
from sma_sim.evidence.held_out import RunFit, held_out, mean_error, run_fits, summed_up
from sma_sim.evidence.likeness import Likeness, likenesses
from sma_sim.evidence.parallel import some_executor
from sma_sim.evidence.reconcile import Together, fitted_together
from sma_sim.evidence.recording import Campaign
from sma_sim.evidence.refit import EXPLAINED, Fitted, validated
from sma_sim.evidence.revision import Revision, revised
from sma_sim.evidence.selection import (
    LEAST_FALL,
    MOST_EFFECTS,
    UNEXPLAINED,
    Round,
    Told,
    Workplace,
    judged_error,
    select,
)
from sma_sim.evidence.splitting import by_name
from sma_sim.evidence.stopping import stoppable
from sma_sim.model.config import Config

LEAST_TO_HOLD_OUT = 3  # recordings from which on the last is held out when nothing else was asked for
STARTS = 2  # of the bare fit
BARE = replace(FIRST, most=12, gain=1e-3)  # a model that lacks an effect creeps along valleys that end nowhere
CLEARLY = 1.5  # error over noise above which a fit on all samples makes no other verdict of it
SEVERAL, LEFT_OVER = 2, 1.05  # effects that leave more than this together are held against one formula
WORTH_NAMING = 0.1  # part of the held-out error that a partial explanation takes away
PREFERENCE = 0.8  # of the hybrid model's error for that of MAS
VERDICTS = ('none', 'missing_effect', 'unknown_effect')


@dataclass(frozen=True)
class Step:
    """One step of the error's fall: the effects so far, the errors over noise of training and held-out runs.

    `channels`: training error by channel; `held_out_channels` likewise; NaN and empty where no run is held out. `config`
    and `delay` [s] are the model's, `runs` and `foretold` the training and held-out runs under it.
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
    foretold: tuple[RunFit, ...]

    @property
    def model(self) -> str:
        """`hybrid` or `mas`."""
        return self.config.model


@dataclass(frozen=True)
class Diagnosis:
    """What was found. `calibration` is the fit of the last step on all samples; its `config` runs in the node.

    `rounds` are those of the selection; `held_out_ratio`: by effect of the first round, held-out error with over without;
    `foretold`: the held-out runs under the last model; `likeness`: by accepted effect, why others cannot be told from it.
    With a `proposal` the last model is that with the proposed effect, which `effects` does not name. `together`: how well
    one model explains fitted and held-out runs, where that which was fitted to the former misses the latter. `taken_back`:
    effects that were accepted, but hardly help to foretell the held-out runs. `revisions`: effects looked at again beside
    those that came after them.
    """

    verdict: str
    effects: tuple[str, ...]
    steps: tuple[Step, ...]
    rounds: tuple[Round, ...]
    calibration: Calibration
    held_out_ratio: dict[str, float]
    foretold: tuple[RunFit, ...]
    likeness: dict[str, tuple[Likeness, ...]]
    training: tuple[str, ...]
    held_out: tuple[str, ...]
    noise_std: dict[str, float]
    interrupted: bool
    seconds: float
    proposal: Proposal | None = None
    together: Together | None = None
    taken_back: tuple[str, ...] = ()
    revisions: tuple[Revision, ...] = ()

    @property
    def judged(self) -> tuple[Round, ...]:
        """By effect of the last model, in their order, the round in which it was judged last."""
        last = {one.accepted.name: one for one in (*self.rounds, *self.revisions) if one.accepted is not None}
        return tuple(last[name] for name in self.effects if name in last)

    @property
    def search_ended(self) -> bool:
        """Whether the search came to its end, rather than being stopped on the way."""
        last = self.rounds[-1] if self.rounds else None
        return last is not None and not last.stopped and (last.accepted is None or len(self.rounds) == MOST_EFFECTS)


@dataclass(frozen=True)
class Request:
    """How to diagnose: kinetics (hybrid, mas or auto), folders of the user's effects, seed of the bootstrap.

    `equation`: whether to look for the equation of what no known effect explains.
    """

    model: str = 'auto'
    folders: tuple[Path, ...] = ()
    seed: int = 0
    options: Options = field(default_factory=lambda: Options(starts=STARTS))
    equation: bool = True


def some_held_out(campaign: Campaign, held: Campaign | None) -> tuple[Campaign, Campaign | None]:
    """Training and held-out recordings by name: the last name of several is held out where nothing else was chosen.

    The order in which recordings are given says nothing of them: with it a verdict would change.
    """
    training = by_name(campaign)
    if held is not None:
        return training, by_name(held)
    if len(training.recordings) < LEAST_TO_HOLD_OUT:
        return training, None
    *rest, last = training.recordings
    return replace(campaign, recordings=tuple(rest)), replace(campaign, recordings=(last,))


def diagnose(
    campaign: Campaign, config: Config, held: Campaign | None = None, request: Request | None = None,
    executor: Executor | None = None, told: Told = lambda words: None, stop: Event | None = None,
) -> Diagnosis:  # fmt: skip
    """Find what `config` lacks to explain the campaign's recordings.

    Those of `held` are only looked at in the end; without it the last of three or more recordings, by name, is held out.
    Ctrl-C, or `stop`, ends the search with the steps so far. Raises UserError for what cannot be diagnosed.
    """
    if stop is None:
        with stoppable() as stop:
            return diagnose(campaign, config, held, request, executor, told, stop)
    begun, request = time.perf_counter(), request or Request()
    training, out = some_held_out(campaign, held)
    check(training, config, request.options)
    with some_executor(executor) as pool:
        place = Workplace(pool, stop, told, request.folders, request.seed)
        bare = bare_fit(training, config, request, place)
        rounds = select(bare, place)
        path, revisions = path_of(bare, rounds, place)
        end = ending(path, training, out, request, place, begun)
        steps, last = end.steps, end.last
        ratios = held_out_ratios(rounds[0], steps[0], out, place) if rounds else {}
        likeness = {one.accepted.name: likenesses(one, pool) for one in (*rounds, *revisions) if one.accepted is not None}
    return Diagnosis(
        end.verdict, last.effects, steps, rounds, end.calibration, ratios, steps[-1].foretold, likeness,
        tuple(one.name for one in training.recordings), tuple(one.name for one in out.recordings) if out else (),
        dict(campaign.noise_std), stop.is_set(), time.perf_counter() - begun, end.proposal, end.together,
        tuple(name for name in path[-1].effects if name not in last.effects), revisions,
    )  # fmt: skip


@dataclass(frozen=True)
class Ending:
    """What is made of the models that were found: the verdict, the last of them, and its fit on all samples.

    `steps`, `together` and `proposal` as in Diagnosis.
    """

    verdict: str
    last: Fitted
    steps: tuple[Step, ...]
    calibration: Calibration
    together: Together | None
    proposal: Proposal | None


def ending(
    path: Sequence[Fitted], training: Campaign, out: Campaign | None, request: Request, place: Workplace, begun: float
) -> Ending:
    """Look at the held-out runs, take back what does not help there, and look for an equation where much is left.

    Where that is sure to follow, the model of known effects is not fitted on all samples first.
    """
    bare, last, stop = path[0], path[-1], place.stop
    steps = [step_of(training, out, one, request, place) for one in path[:-1]]
    final, together = None, None
    sketch = step_of(training, out, last, request, place) if request.equation and last.error > CLEARLY else None
    if sketch is not None and not sketch.held_out <= CLEARLY:
        steps.append(sketch)
    else:
        final = last_step(steps, training, out, last, request, place, begun)
    if out and goes_further(steps[-1]):
        together = fitted_together(training, out, last, steps[-1].foretold, request.options, place)
    verdict = verdict_of(steps[-1], together)
    if verdict == 'unknown_effect' and not stop.is_set() and (best := foretells_best(steps)) < len(path) - 1:
        last = path[best]
        place.told('the held-out runs are foretold better with fewer effects')
        if final is None:
            steps.append(steps[best])
        else:
            final = last_step(steps, training, out, last, request, place, begun)
        verdict = verdict_with_fewer(steps[-1])
    proposal = None
    if request.equation and judged_error(last) > EXPLAINED and not stop.is_set():
        verdict, proposal = with_equation(verdict, bare, last, place)
    if proposal is not None:
        final = last_step(steps, training, out, proposal.fitted, request, place, begun)
    elif final is None:
        steps.pop()
        final = last_step(steps, training, out, last, request, place, begun)
    return Ending(verdict, last, tuple(steps), final, together, proposal)


def with_equation(verdict: str, bare: Fitted, last: Fitted, place: Workplace) -> tuple[str, Proposal | None]:
    """The verdict and the equation of what no known effect explains, if any is better than nothing.

    Several effects that leave more than noise in the fitted runs may imitate something that none of them is: if one formula
    foretells better than all of them, it is taken, and they explain a part.
    """
    if verdict == 'unknown_effect':
        return verdict, propose([bare, last] if last is not bare else [bare], place)
    if len(last.effects) < SEVERAL or last.error <= LEFT_OVER:
        return verdict, None
    place.told(f'{" and ".join(last.effects)} leave more than noise: is there one formula that leaves less?')
    found = propose([bare], place)
    if found is None or judged_error(found.fitted) > (1.0 - LEAST_FALL) * judged_error(last):
        return verdict, None
    return 'unknown_effect', found


def bare_fit(training: Campaign, config: Config, request: Request, place: Workplace) -> Fitted:
    """The better of the kinetics without further effects."""
    found = []
    for model in MODELS if request.model == 'auto' else (request.model,):
        place.told(f'fitting the {model} model')
        best = search(training, replace(config, model=model), request.options, place.pool, place.stop, None, BARE)
        found.append(validated(Fitted(best.problem, best.best.z, best.best.cost), place.pool, place.stop))
        place.told(f'{model}: error over noise {judged_error(found[-1]):.2f}')
        if place.stop.is_set():
            break
    whole = [one for one in found if isfinite(one.validated)] or found  # stopped on the way, the last one is not
    # MAS has the hybrid model as a limit (V_L large), so that the hybrid one must be clearly better to be taken
    return min(whole, key=lambda one: judged_error(one) * (PREFERENCE if one.problem.config.model == 'mas' else 1.0))


def path_of(bare: Fitted, rounds: Sequence[Round], place: Workplace) -> tuple[list[Fitted], tuple[Revision, ...]]:
    """The models from the bare one to the last, whose effects were looked at again beside each other."""
    path = [bare, *(after for after in (one.after for one in rounds) if after is not None)]
    last, revisions = revised(path[-1], rounds, place)
    return [*(path[:-1] if last.effects == path[-1].effects else path), last], revisions


def last_step(
    steps: list[Step], training: Campaign, out: Campaign | None, last: Fitted, request: Request, place: Workplace,
    begun: float,
) -> Calibration:  # fmt: skip
    """The last model fitted on all samples, with intervals; its errors become a further one of the `steps`."""
    place.told('the last fit, on all samples')
    options = replace(request.options, free=tuple(p.name for p in last.problem.free))
    found = Found(last.problem, Descent(last.z, last.cost, 0, True), ())
    done = finished(training, found, options, place.pool, place.stop, None)
    scores = {last.problem.config.model: last.validated}
    rtol = last.problem.config.parameters['solver.rtol']
    final = result(done, rtol, scores, options, place.pool, place.stop, begun)
    foretold = held_out(final.config, out, final.delay, place.pool) if out else ()
    held, held_channels = summed_up(foretold)
    steps.append(Step(
        last.effects, final.error, held, dict(final.channels), held_channels, dict(final.values), final.config, final.delay,
        final.runs, foretold,
    ))  # fmt: skip
    return final


def step_of(training: Campaign, out: Campaign | None, one: Fitted, request: Request, place: Workplace) -> Step:
    """The errors of a model that was fitted on the way."""
    problem = replace(prepared(training, one.problem.config, request.options, 1, hasty=False), free=one.problem.free)
    runs = run_fits(problem, one.z, place.pool)
    channels = over_runs(problem, runs)
    config, delay = with_values(one.problem.config, one.values), one.problem.delay_at(one.z)
    foretold = held_out(config, out, delay, place.pool) if out else ()
    held, held_channels = summed_up(foretold)
    return Step(
        one.effects, mean_error(channels), held, channels, held_channels, one.values, config, delay, runs, foretold
    )


def held_out_ratios(first: Round, bare: Step, out: Campaign | None, place: Workplace) -> dict[str, float]:
    """By effect of the first round, the held-out error with it over that without; empty where no run is held out."""
    ratios: dict[str, float] = {}
    if out is None:
        return ratios
    for one in first.tried:
        config = with_values(one.fitted.problem.config, one.fitted.values)
        foretold = held_out(config, out, one.fitted.problem.delay_at(one.fitted.z), place.pool)
        ratios[one.name] = summed_up(foretold)[0] / bare.held_out
    return ratios


def foretells_best(steps: Sequence[Step]) -> int:
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


def goes_further(last: Step) -> bool:
    """Whether the fitted runs are explained, and those held out are not."""
    return last.train <= EXPLAINED and last.held_out > UNEXPLAINED


def verdict_of(last: Step, together: Together | None) -> str:
    """`none`, `missing_effect`, or `unknown_effect` where much is left unexplained.

    Without a held-out run the error of the fitted ones counts: that of runs left out in turn is large where one run alone
    cannot tell the parameters, which is no sign of an effect. Nor is a held-out run that the model explains `together` with
    the fitted ones.
    """
    error = last.train if isnan(last.held_out) else last.held_out
    if error > UNEXPLAINED and not (together is not None and together.explained):
        return 'unknown_effect'
    return 'missing_effect' if last.effects else 'none'


def verdict_with_fewer(last: Step) -> str:
    """The verdict on a model from which effects were taken back: what is left in the fitted runs asked for them."""
    return 'unknown_effect' if last.train > UNEXPLAINED else verdict_of(last, None)
