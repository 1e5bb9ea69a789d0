"""What to know beside the numbers of a fit, in sentences."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from sma_sim.evidence.estimation.calibrate import DELAY_NAME, FINAL_RTOL, Calibration
from sma_sim.evidence.estimation.fit_result import OtherStart
from sma_sim.evidence.estimation.free_parameters import GIVEN_STDS
from sma_sim.evidence.estimation.log_evidence import DECISIVE
from sma_sim.evidence.estimation.plausibility import ImplausibleParameter
from sma_sim.evidence.estimation.run_estimates import DISAGREE, MIN_P, ParameterByRun, disagreement
from sma_sim.evidence.estimation.uncertainty import RULED_OUT, Interval
from sma_sim.model.config import AUTO, Config
from sma_sim.words.nuisances import ambient_sentence, beginning_words, factor_sentences, offset_sentences, warm_wires

MISFIT = 1.3  # normalized RMSE above which a model lacks something: noise that was estimated may be off by as much
ONE_START = 'from one starting point: other minima were not looked for'
DIFFERENT = 0.1  # relative difference of a parameter that is shown of another minimum


def remarks_on(found: Calibration) -> list[str]:
    """All of them, what weakens the numbers first."""
    remarks = [sentence] if (sentence := unfollowed_sentence(found)) else []
    remarks += [sentence] if (sentence := misfit_sentence(found.error)) else []
    if found.rtol > FINAL_RTOL and found.free:
        begin = f'With these parameters runs cannot be made at the tolerance of a last fit, {FINAL_RTOL:g}'
        remarks.append(f'{begin}: errors and intervals are those of {found.rtol:g}')
    unseen, held = found.uncertainty.unseen if found.uncertainty else (), found.held_by_prior
    remarks += [f'not determined by these data: {name}' for name in unseen if name not in held]
    remarks += [f'its prior tells more than these data: {words}' for words in held.values()]
    remarks += limit_sentences(found)
    remarks += [f'{parameter.name} was kept fixed: {parameter.reason}' for parameter in found.fixed]
    remarks += [implausible_sentence(found.implausible)] if found.implausible else []
    remarks += beyond_sentences(found)
    remarks += [sentence] if (sentence := agreement_sentence(found.by_run, found.error > MISFIT)) else []
    remarks += [starts_sentence(found.other_starts) or ONE_START, *other_minima(found)]
    remarks.append(kinetics_sentence(found.config, found.kinetics))
    remarks += offset_sentences(found)
    remarks += [sentence] if (sentence := ambient_sentence(found)) else []
    remarks += factor_sentences(found)
    if wires := warm_wires(found):
        remarks.append(f'how warm wires were when recordings began, estimated for each: {beginning_words(wires)}')
    if any(fit.zero for fit in found.runs):
        zeros = ', '.join(f'{fit.name} {1e6 * fit.zero:.0f}' for fit in found.runs if fit.quasi_static)
        remarks.append(f'zero of the strain gauge, estimated for each recording [1e-6]: {zeros}')
    if not all(fit.quasi_static for fit in found.runs):
        remarks.append(delay_sentence(found))
    return remarks


def unfollowed_sentence(found: Calibration) -> str:
    """Which channels the model hardly follows, and what to do; empty where it follows all or leaves no more than noise."""
    if found.error <= MISFIT or not found.unfollowed:
        return ''
    errors = (
        f'{name} {found.channel_errors[name]:.3g} times the noise (a constant: {found.errors_of_constants[name]:.3g})'
        for name in found.unfollowed
    )
    return (
        f'The model hardly follows what was measured, {", ".join(errors)}. Its values may be those of another robot: give '
        'lengths, radii, springs and transformation stresses with --config or --set'
    )


def misfit_sentence(error: float) -> str:
    """That intervals presuppose the rest of the model, where it leaves more than noise; else empty."""
    if error <= MISFIT:
        return ''
    return (
        f'The normalized RMSE is {error:.3g}, more than noise. The intervals count what is left as correlated noise, and '
        'hold only if what the model lacks does not bias its parameters.'
    )


def other_minima(found: Calibration) -> list[str]:
    """What other minima say that are nearly as probable; values within a standard deviation of a parameter are the same."""
    words = list[str]()
    intervals = found.uncertainty.intervals if found.uncertainty and found.other_starts else ()
    least = {one.name: max(DIFFERENT * abs(one.value), one.std_of_value if one.seen else 0.0) for one in intervals}
    for start in found.other_starts:
        moved = [
            f'{name} {value:.4g} (here {found.values[name]:.4g})'
            for name, value in start.values.items()
            if name in found.values
            and abs(value - found.values[name]) > least.get(name, DIFFERENT * abs(found.values[name]))
        ]
        if moved and start.log_odds < DECISIVE:
            part = '; the intervals hold these values too' if start.log_odds < RULED_OUT else ''
            words.append(f'another minimum is nearly as probable (log odds {start.log_odds:.1f}): {", ".join(moved)}{part}')
    return list(dict.fromkeys(words))  # several starts may have led there


def starts_sentence(others: Sequence[OtherStart]) -> str:
    """How many starting points of a fit agree, `others` beside the best; nothing of a single one."""
    same, count = 1 + sum(start.same for start in others), 1 + len(others)
    if count == 1:
        return ''
    if same == count:
        return f'all {count} starting points led to the same minimum'
    return f'{same} of {count} starting points led to this minimum, the others to one of higher cost: see --json'


def limit_sentences(found: Calibration) -> list[str]:
    """Which estimates ended at a limit, and how that is moved; no delay that these data do not determine."""
    delay = delay_interval_of(found)
    is_open = delay is not None and not delay.seen
    return [limit.text for limit in found.limits if limit.name != DELAY_NAME or not is_open]


def delay_interval_of(found: Calibration) -> Interval | None:
    """The interval of the delay, where it was fitted and intervals are known."""
    return found.uncertainty.delay if found.uncertainty else None


def delay_sentence(found: Calibration) -> str:
    """The delay of the measurement, and whether it is one; that it is not determined, as in slow tests."""
    begin, delay, interval, known = (
        'delay of the measurement: ',
        found.delay,
        found.sampling_interval,
        delay_interval_of(found),
    )
    if known and not known.seen:
        return f'{begin}not determined by these data (between {time_words(known.low)} and {time_words(known.high)})'
    words = f'{begin}{time_words(delay)}'
    words += f' ({time_words(known.low)} to {time_words(known.high)})' if known else ''
    if DELAY_NAME in found.at_bound:
        return words
    if abs(delay) <= 0.5 * interval:
        return f'{words}, within half a sampling interval ({time_words(interval)}): no finding'
    return f'{words}: the interval holds 0, no finding' if known and known.low <= 0.0 <= known.high else words


def time_words(seconds: float) -> str:
    """A time in milliseconds, or in seconds from 1 s on."""
    return f'{seconds:.3g} s' if abs(seconds) >= 1.0 else f'{1e3 * seconds:.3g} ms'


def agreement_sentence(found: Sequence[ParameterByRun], is_misfit: bool = False) -> str:
    """What recordings say together, in a sentence; empty where no parameter could be compared.

    `is_misfit`: whether the model leaves more than noise, which hides much of what recordings differ by.
    """
    tested = [parameter for parameter in found if parameter.dof]
    if not tested:
        return ''
    worst = disagreement(found)
    if worst is None:
        least = min(tested, key=lambda parameter: parameter.p)
        agree = 'do not disagree by more than what the model leaves in them' if is_misfit else 'agree on every parameter'
        return f'The recordings {agree} (least on {least.name}: p = {least.p:.2g}).'
    run, unit = worst.outlier, '' if worst.unit == '-' else f' {worst.unit}'
    many = sum(parameter.p * len(tested) < DISAGREE for parameter in tested) - 1
    further = f' and {many} more' if many else ''
    others = f'{run.value:.5g} +- {run.std:.2g}{unit}, all together {worst.value:.5g}'
    return (
        f'The recordings disagree on {worst.name}{further} ({p_words(worst.p)}), most of all {run.run} ({others}). '
        'Something differs between recordings, or is missing.'
    )


def p_words(p: float) -> str:
    """A p-value, of which no more is said than that it is tiny where it is."""
    return f'p = {p:.2g}' if p >= MIN_P else f'p < {MIN_P:g}'


def implausible_sentence(found: Sequence[ImplausibleParameter]) -> str:
    """What it means that parameters left their plausible range."""
    return (
        f'Outside the plausible range: {", ".join(parameter.text for parameter in found)}. The model is probably missing '
        'something, and its intervals need not hold the true values, or its nominal values are not those of this '
        f'robot{material_hint(found)}.'
    )


def beyond_sentences(found: Calibration) -> list[str]:
    """What ended where it is hardly true, and what that means: parameters that no data hold, and offsets of recordings."""
    sentences = []
    if found.unusual:
        shown = ', '.join(one.text for one in found.unusual)
        cure = 'keep known ones (--set, and without them in --free), or record what shows them'
        sentences.append(f'Not usual, and hardly determined by these data: {shown}. Do not use these values: {cure}')
    if found.improbable_offsets:
        shown = '; '.join(one.text for one in found.improbable_offsets)
        means = 'The model is probably missing something for which they make up, or what was stated is wrong'
        sentences.append(
            f'Farther than {GIVEN_STDS:g} standard deviations from what is stated of recordings: {shown}. {means}'
        )
    return sentences


def material_hint(found: Sequence[ImplausibleParameter]) -> str:
    """How another material is said, where one was taken."""
    return ', or its wire is of another material (--material)' if any(one.material for one in found) else ''


def kinetics_sentence(config: Config, probabilities: Mapping[str, float]) -> str:
    """Which kinetics a fitted model has, and whether they were given; `probabilities` of both where they were not."""
    taken = config.simulated_kinetics
    if not probabilities and config.kinetics == AUTO:
        return f'kinetics: none were given, and the fit was stopped before it could tell; {taken} was taken'
    if not probabilities:
        return f'kinetics: {taken}, as given (--model auto fits both)'
    shown = ', '.join(f'{name} {probability:.3g}' for name, probability in probabilities.items())
    if config.kinetics == AUTO:
        return f'kinetics: these recordings do not decide between them (probabilities: {shown}); {taken} was taken'
    return f'kinetics: none were given, {taken} is more probable (probabilities: {shown})'
