"""A diagnosis in sentences, for the terminal and the report."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

from sma_sim.evidence.diagnosis.conclusion import HeldOutVerdict, ModelStage, PooledErrors
from sma_sim.evidence.diagnosis.diagnose import Diagnosis
from sma_sim.evidence.estimation.plausibility import unrealistic
from sma_sim.evidence.estimation.run_estimates import disagreement
from sma_sim.evidence.estimation.uncertainty import AmbientDifference, Interval
from sma_sim.evidence.search.criteria import NOISE_ONLY, UNEXPLAINED
from sma_sim.evidence.search.refine import TIE
from sma_sim.evidence.search.steps import CandidateFit
from sma_sim.evidence.set_up.faults import is_uncertain
from sma_sim.model.effects.scope import law_name
from sma_sim.model.parameters import Parameter
from sma_sim.model.shown import joined_words
from sma_sim.words.diagnosis_data import above_first, amounts, models, probabilities, wires_at_beginning
from sma_sim.words.fit_remarks import (
    agreement_sentence,
    beyond_sentences,
    implausible_sentence,
    limit_sentences,
    misfit_sentence,
    other_minima,
    unfollowed_sentence,
)
from sma_sim.words.nuisances import ambient_sentence, beginning_words, nuisance_sentences
from sma_sim.words.probabilities import probability_lines
from sma_sim.words.proposed_equation import describes, error_number, proposed_text
from sma_sim.words.set_up import set_up_sentences

NOTHING_MISSING = 'These data show no sign of a missing effect.'
NOTHING_MISSING_BUT = 'These data show no sign of a missing effect. What differs from recording to recording: {what}.'
NOTHING_FOUND = 'No known effect explains more, and yet something is probably missing.'
BIASED_NOMINAL = 'The fit without further effects left the plausible range, as where something is missing: {parameters}.'
SET_UP_FIRST = 'The set-up has to be fixed first; no effect was searched for.'
UNKNOWN_EFFECT = 'Something is missing that no known effect explains.'
OPEN = (
    'These data do not tell whether your model lacks {effects}: the fitted runs are explained by it, and all runs if they '
    'are fitted together, but those held out are predicted worse with it than without.'
)
ADEQUATE = (
    'The normalized RMSE of {channel} is {ratio:.1f}; in such quasi-static tests up to {limit:.1f} counts as explained, 5 % '
    'of what it spans, since a specimen is not as homogeneous as its model.'
)
ONLY_HELD_OUT = (
    'The fitted runs are explained; what is missing shows only in the held-out runs: fit those too, and hold out others.'
)
BEYOND_FITTED = (
    'The held-out runs depend on parameters that the fitted runs do not determine: fitted together, all runs are explained '
    '(normalized RMSE {held_out:.2f} held out, {train:.2f} others). Fit with all runs, or record more like them.'
)
ROOMS_DIFFER = (
    'One model explains all runs if their ambient temperatures differ, from that of {first} by {amounts} [K] '
    '(normalized RMSE {held_out:.2f} held out, {train:.2f} others), which is no effect of the robot. Measure them.'
)
IN_OWN_ROOMS = (
    ' Predicted with ambient temperatures of their own, held-out runs have {first:.2f} without effects, {last:.2f} with.'
)
REMOVED = (
    'Retracted: {effects}. The held-out runs are more probable without it '
    '(normalized RMSE {worse:.2f} with, {best:.2f} without).'
)
TAKEN_UNREALISTIC = (
    'Not realistic: {values}. The effect is taken since nothing realistic explains nearly as much; make sure that your '
    'robot can have it.'
)
DIFFERING = ', recordings differ'
LESS_PROBABLE = '; they speak no less for {names}, less probable only by its prior (more free parameters, or rarer values)'
TOGETHER = 'With the held-out runs fitted too: {verdict} Normalized RMSE {first:.2f} without, {last:.2f} with.'
SAME_VERDICT = 'The verdict is the same whichever of the {count} runs is held out.'
OTHER_VERDICT = 'The verdict depends on the run that is held out ({count} of {all} runs change it): {others}.'
MAKES_UP = '. What was found may only make up for them'
ONE_RUN = (
    'Only one run was fitted: no effect could be tested by predicting a run that was left out, which favours every effect.'
)
NO_HELD_OUT = 'No run was held out: the final errors are those of the fitted runs, which are lower than those of new runs.'


def as_text(diagnosis: Diagnosis) -> Iterator[str]:
    """The verdict for the terminal."""
    yield headline(diagnosis)
    yield from set_up_sentences(diagnosis.set_up)
    if diagnosis.has_compared:
        yield from probability_lines(
            {
                'system': diagnosis.calibration.config.system,
                'verdict': diagnosis.verdict,
                'models': models(diagnosis.posterior),
                'probabilities': probabilities(diagnosis.posterior),
                'retracted': diagnosis.retracted,
            }
        )
    yield f'{"normalized RMSE (1: as good as the sensors)":<44} fitted  held out'
    for stage in diagnosis.stages:
        name = f'{" + ".join(stage.effects) or "nominal model"}{DIFFERING if stage.differences else ""} ({stage.kinetics})'
        yield f'  {name:<42} {error_number(stage.train):>6}  {error_number(stage.held_out):>8}'
    yield from remarks(diagnosis)


def short_title(diagnosis: Diagnosis) -> str:
    """The verdict in a few words."""
    if not diagnosis.search_ended:
        return 'stopped early'
    if is_uncertain(diagnosis.set_up):
        return 'a fault of the set-up'
    if diagnosis.verdict == 'unknown_effect':
        return 'an unknown effect'
    nothing = 'nothing found, but implausible parameters' if diagnosis.calibration.implausible else 'nothing is missing'
    return joined_words(missing_phrases(diagnosis)) or nothing


def headline(diagnosis: Diagnosis) -> str:
    """The verdict in a sentence or two; of a search that was stopped only what was found so far."""
    phrases = missing_phrases(diagnosis)
    lacks = f'Your model lacks {joined_words(phrases)}'
    if not diagnosis.search_ended:
        none = 'Nothing was found to be missing so far' if diagnosis.has_compared else 'No effect has been tried'
        more = f'{lacks}; more may be missing' if phrases else none
        return f'Stopped before the search was complete. {more}.'
    if is_uncertain(diagnosis.set_up):
        return SET_UP_FIRST
    if diagnosis.verdict == 'unknown_effect':
        return unknown_words(diagnosis, phrases)
    if phrases:
        return f'{lacks}{missing_words(diagnosis, phrases)}.'
    if diagnosis.calibration.implausible:
        return NOTHING_FOUND
    differing_in = joined_words([one.words for one in diagnosis.differences])
    return NOTHING_MISSING_BUT.format(what=differing_in) if differing_in else NOTHING_MISSING


def missing_words(diagnosis: Diagnosis, phrases: Sequence[str]) -> str:
    """How much is explained by what the model lacks, and of one effect its values and its rivals."""
    share = explained_share(diagnosis.nominal, diagnosis.stages[-1])
    candidates = accepted_fits(diagnosis)
    if len(phrases) > 1 or len(candidates) != 1:
        return f'; {"together they explain" if len(phrases) > 1 else "it explains"} {share}'
    (candidate,) = candidates
    values = ', '.join(value_words(parameter, diagnosis, candidate.name) for parameter in decisive(candidate, diagnosis))
    rivals = f'; {rival_words(candidate, diagnosis)}' if candidate.indistinguishable else ''
    return f': {values}; it explains {share}{rivals}'


def unknown_words(diagnosis: Diagnosis, phrases: Sequence[str]) -> str:
    """What is known of something that no effect explains: what explains a part, and the equation that describes it."""
    share = explained_share(diagnosis.nominal, diagnosis.stages[-1])
    if phrases and diagnosis.proposal is None and explains_all_together(diagnosis):
        return OPEN.format(effects=joined_words(phrases))
    if diagnosis.proposal is not None:
        part = f' beside {joined_words(phrases)}' if phrases else ''
        how = 'An equation describes it' if describes(diagnosis) else 'An equation comes nearest, and is not what is missing'
        return f'{UNKNOWN_EFFECT} {how}{part}: {diagnosis.proposal.formula.equation}; it explains {share}.'
    if phrases:
        verb = 'explain' if len(phrases) > 1 else 'explains'
        return f'{UNKNOWN_EFFECT} Only a part is explained: {joined_words(phrases)} {verb} {share}.'
    return UNKNOWN_EFFECT


def missing_phrases(diagnosis: Diagnosis) -> list[str]:
    """What sentences call the effects that were found, those that the model had from the start left out."""
    return [phrase_of(name, diagnosis) for name in diagnosis.effects if name not in diagnosis.nominal.effects]


def explained_share(before: ModelStage, after: ModelStage) -> str:
    """Share of the squared error that a model removes, of the held-out runs where there are any."""
    held_out = math.isfinite(before.held_out + after.held_out)
    if held_out and after.held_out <= before.held_out:
        return f'{removed_percent(before.held_out, after.held_out):.0f} % of the squared error in the held-out runs'
    share = f'{removed_percent(before.train, after.train):.0f} % of the squared error in the fitted runs'
    return f'{share}, nothing in the held-out runs' if held_out else share


def removed_percent(before: float, after: float) -> float:
    """The part of a squared error that is gone, in per cent."""
    return 100.0 * (1.0 - (after / before) ** 2)


def remarks(diagnosis: Diagnosis) -> Iterator[str]:
    """What to know beside the verdict and the errors: what explains as well, how firm it is, values, what is left."""
    if sentence := unfollowed_sentence(diagnosis.nominal.calibration):
        yield f'Without effects: {sentence}{MAKES_UP if diagnosis.findings else ""}.'
    yield from rival_lines(diagnosis)
    yield from firmness_lines(diagnosis)
    for candidate in accepted_fits(diagnosis):
        yield from parameter_lines(candidate, diagnosis)
    yield from difference_lines(diagnosis)
    yield from removed_lines(diagnosis)
    yield from implausible_lines(diagnosis)
    yield from beyond_sentences(diagnosis.calibration)
    yield from nuisance_sentences(diagnosis.calibration, diagnosis.findings)
    if (sentence := ambient_sentence(diagnosis.calibration)) and not any(one.ambient for one in diagnosis.differences):
        yield sentence
    if sentence := misfit_sentence(diagnosis.calibration.error):
        yield sentence
    yield from other_minima(diagnosis.calibration)
    yield from limit_sentences(diagnosis.calibration)
    if disagreement(diagnosis.calibration.by_run) is not None:
        yield agreement_sentence(diagnosis.calibration.by_run)
    if diagnosis.pooled_errors is not None and diagnosis.proposal is None and explains_all_together(diagnosis):
        yield together_sentence(diagnosis.pooled_errors)
    elif diagnosis.verdict == 'unknown_effect' and diagnosis.search_ended:
        yield from left_lines(diagnosis)
    yield from together_lines(diagnosis)
    if len(diagnosis.training) < 2:
        yield ONE_RUN
    elif not diagnosis.held_out:
        yield NO_HELD_OUT
    if diagnosis.interrupted and diagnosis.search_ended:
        yield 'Stopped during the last fit: its values are not final.'


def explains_all_together(diagnosis: Diagnosis) -> bool:
    """Whether the last model explains all runs when it is fitted to those held out too."""
    return diagnosis.pooled_errors is not None and diagnosis.pooled_errors.explained(diagnosis.limit)


def together_sentence(pooled: PooledErrors) -> str:
    """That one model explains all runs, and what had to differ between them for that."""
    first, *others = pooled.above_first.items() or [('', AmbientDifference(0.0, 0.0, 0.0))]
    amounts = joined_words([kelvin_words(*one) for one in others])
    sentence = ROOMS_DIFFER if amounts else BEYOND_FITTED
    said = sentence.format(train=pooled.train, held_out=pooled.held_out, first=first[0], amounts=amounts)
    errors = pooled.in_own_rooms
    return said + (IN_OWN_ROOMS.format(first=errors[0], last=errors[-1]) if errors else '')


def difference_lines(diagnosis: Diagnosis) -> Iterator[str]:
    """What each recording has its own, which is no physics of the robot."""
    for difference in diagnosis.differences:
        values = dict(amounts(difference, diagnosis))
        if difference.in_motion:
            warm = beginning_words(wires_at_beginning(diagnosis))
            yield f'The recordings do not begin at rest, no effect of the robot: {warm}.'
            continue
        if difference.unpowered_side:
            shown = f'lost in {joined_words([name for name, is_lost in values.items() if is_lost])}'
        elif difference.ambient:
            first, *others = above_first(diagnosis).items()
            shown = f'above that of {first[0]}: {joined_words([kelvin_words(*one) for one in others])} [K]'
        elif difference.parameter:
            shown = joined_words([f'{name} {value:+.2%}' for name, value in values.items()])
        else:
            shown = f'{joined_words([f"{name} {value:+.3g}" for name, value in values.items()])} [SI]'
        yield f'The recordings differ, no effect of the robot: {difference.words}, {shown}.'


def kelvin_words(name: str, there: AmbientDifference) -> str:
    """A difference of temperature with its 95 % interval, where that is known."""
    between = f' ({there.low:+.2g} to {there.high:+.2g})' if math.isfinite(there.low) else ''
    return f'{name} {there.value:+.2f}{between}'


def together_lines(diagnosis: Diagnosis) -> Iterator[str]:
    """What all recordings say together, where the fitted ones did not say what is missing."""
    joint = diagnosis.together
    if joint is None:
        return
    first, last = joint.nominal.train, joint.stages[-1].train
    yield TOGETHER.format(verdict=headline(joint), first=first, last=last)
    yield from (f'  {line}' for line in rival_lines(joint))
    for candidate in accepted_fits(joint):
        yield from (f'  {line}' for line in parameter_lines(candidate, joint))


def firmness_lines(diagnosis: Diagnosis) -> Iterator[str]:
    """Whether the verdict depends on the run that is held out."""
    verdicts = diagnosis.by_held_out_run
    if not verdicts or not diagnosis.search_ended:
        return
    known = diagnosis.verdict, {*map(law_name, diagnosis.effects)}
    others = {name: one for name, one in verdicts.items() if (one.verdict, {*map(law_name, one.effects)}) != known}
    if not others:
        yield SAME_VERDICT.format(count=len(verdicts))
        return
    words = [f'without {name}, {verdict_words(found, diagnosis)}' for name, found in others.items()]
    yield OTHER_VERDICT.format(others=joined_words(words), count=len(others), all=len(verdicts))


def verdict_words(found: HeldOutVerdict, diagnosis: Diagnosis) -> str:
    """A verdict with a run held out, in a few words."""
    effects = joined_words([phrase_of(name, diagnosis) for name in found.effects])
    if found.verdict == 'unknown_effect':
        left = f'something unexplained (normalized RMSE {found.error:.2f})'
        return f'{effects} and {left}' if effects else left
    return effects or 'nothing is missing'


def implausible_lines(diagnosis: Diagnosis) -> Iterator[str]:
    """Parameters that left their plausible range: in the last fit, else in the nominal one."""
    implausible = diagnosis.calibration.implausible
    for candidate in accepted_fits(diagnosis):
        own = [one for one in implausible if one.name.startswith(f'effects.{candidate.name}.')]
        if own and not candidate.plausible:
            fitted = {p.name: value_of(p, diagnosis, candidate.name) for p in candidate.effect.parameters}
            known = {name: value for name, value in fitted.items() if value is not None}
            yield TAKEN_UNREALISTIC.format(values=beyond_words(candidate, known))
            implausible = tuple(one for one in implausible if one not in own)
    if implausible:
        yield implausible_sentence(implausible)
    elif not diagnosis.calibration.implausible and diagnosis.implausible and len(diagnosis.stages) > 1:
        yield BIASED_NOMINAL.format(parameters=', '.join(parameter.text for parameter in diagnosis.implausible))


def removed_lines(diagnosis: Diagnosis) -> Iterator[str]:
    """Effects that were accepted on the way and are not in the last model."""
    if (retracted := diagnosis.change('retracted')) is not None:
        worse, best = retracted
        names = joined_words([phrase_of(name, diagnosis) for name in diagnosis.retracted])
        yield REMOVED.format(effects=names, worse=worse.held_out, best=best.held_out)


def left_lines(diagnosis: Diagnosis) -> Iterator[str]:
    """What known effects leave, and the equation that is proposed for it."""
    last = [stage for stage in diagnosis.stages if stage.kind != 'formula'][-1]
    channels = last.held_out_channel_errors or last.channel_errors
    worst = max(channels, key=lambda name: channels[name])
    limit = diagnosis.limit
    if channels[worst] > UNEXPLAINED and limit > UNEXPLAINED:
        yield ADEQUATE.format(ratio=channels[worst], channel=worst, limit=limit)
    elif channels[worst] > limit:
        yield (
            f'With known effects, the normalized RMSE of {worst} is {channels[worst]:.1f} '
            f'(more than {limit:g} is not chance).'
        )
    if last.train <= NOISE_ONLY and diagnosis.proposal is None:
        yield ONLY_HELD_OUT
    yield from proposed_text(diagnosis)


def beyond_words(candidate: CandidateFit, values: Mapping[str, float]) -> str:
    """The values of an effect that are not realistic, beside what is."""
    return joined_words(
        [
            f'{p.name} = {values[p.name]:.4g}{unit_of(p)} (realistic: {p.realistic[0]:g} to {p.realistic[1]:g})'
            for p in unrealistic(candidate.effect, values)
            if p.realistic is not None
        ]
    )


def parameter_lines(candidate: CandidateFit, diagnosis: Diagnosis) -> Iterator[str]:
    """An accepted effect: its values in the last fit beside what is realistic, and what explains as well."""
    for parameter in candidate.effect.parameters:
        if f'effects.{candidate.name}.{parameter.name}' in diagnosis.calibration.values:
            real = parameter.realistic
            range_ = f'  [realistic: {real[0]:g} to {real[1]:g}]' if real else ''
            yield f'{candidate.name}.{value_words(parameter, diagnosis, candidate.name)}{range_}  {parameter.description}'
    if candidate.effect.same_as:
        yield f'No data can tell it from {candidate.effect.same_as}.'


def rival_lines(diagnosis: Diagnosis) -> Iterator[str]:
    """By accepted effect, which others explain as well; of a single one the headline says it."""
    for candidate in accepted_fits(diagnosis):
        if candidate.indistinguishable and len(diagnosis.effects) > 1:
            yield f'For {candidate.effect.phrase}, {rival_words(candidate, diagnosis)}.'


def rival_words(candidate: CandidateFit, diagnosis: Diagnosis) -> str:
    """Which effects explain as well as an accepted one."""
    rivals = [f'{phrase_of(name, diagnosis)} ({name})' for name in candidate.indistinguishable]
    said = f'these data do not distinguish it from {joined_words(rivals, "or")}'
    known, least = diagnosis.posterior.effects, math.exp(-TIE)
    alike = [name for name in candidate.indistinguishable if known.get(name, 0.0) < least * known.get(candidate.name, 0.0)]
    return said + (LESS_PROBABLE.format(names=joined_words(alike)) if alike else '')


def decisive(candidate: CandidateFit, diagnosis: Diagnosis) -> list[Parameter]:
    """The fitted parameters of an effect whose interval excludes no effect; all of them where none does."""
    fitted = [p for p in candidate.effect.parameters if value_of(p, diagnosis, candidate.name) is not None]
    found = []
    for parameter in fitted:
        interval, neutral = interval_of(parameter, diagnosis, candidate.name), parameter.neutral
        if neutral is None or (interval is not None and not interval.low <= neutral <= interval.high):
            found.append(parameter)
    return found if any(parameter.neutral is not None for parameter in found) else fitted


def value_words(parameter: Parameter, diagnosis: Diagnosis, effect: str) -> str:
    """A fitted value with its unit and its 95 % interval, if the data determine it."""
    value, interval = value_of(parameter, diagnosis, effect), interval_of(parameter, diagnosis, effect)
    known = f' ({interval.low:.4g} to {interval.high:.4g})' if interval is not None else ''
    return f'{parameter.name} = {value:.4g}{unit_of(parameter)}{known}'


def unit_of(parameter: Parameter) -> str:
    """The unit after a number, if it has one."""
    return '' if parameter.unit == '-' else f' {parameter.unit}'


def value_of(parameter: Parameter, diagnosis: Diagnosis, effect: str) -> float | None:
    """The value of an effect's parameter in the last fit; None where it was not fitted."""
    return diagnosis.calibration.values.get(f'effects.{effect}.{parameter.name}')


def interval_of(parameter: Parameter, diagnosis: Diagnosis, effect: str) -> Interval | None:
    """Its 95 % interval; None where the data do not determine it."""
    uncertainty = diagnosis.calibration.uncertainty
    intervals = {interval.name: interval for interval in uncertainty.intervals if interval.seen} if uncertainty else {}
    return intervals.get(f'effects.{effect}.{parameter.name}')


def accepted_fits(diagnosis: Diagnosis) -> list[CandidateFit]:
    """The effects of the last model that the search accepted, as they were judged last."""
    return [step.accepted for step in diagnosis.deciding_steps if step.accepted is not None]


def phrase_of(name: str, diagnosis: Diagnosis) -> str:
    """What a sentence calls an effect."""
    fits = [candidate for step in diagnosis.selection_steps for candidate in step.candidate_fits]
    effects = {candidate.name: candidate.effect for candidate in fits}
    return effects[name].phrase if name in effects else name.replace('_', ' ')
