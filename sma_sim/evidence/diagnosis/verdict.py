"""A diagnosis as plain data for programs, and in a few lines for people."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

from sma_sim.evidence.data.json_values import finite
from sma_sim.evidence.diagnosis.diagnose import Diagnosis, ModelStage
from sma_sim.evidence.diagnosis.proposed_equation import number, proposed_data, proposed_text
from sma_sim.evidence.model_selection.forward_selection import UNEXPLAINED, CandidateFit, SelectionStep
from sma_sim.evidence.model_selection.refit import EXPLAINED
from sma_sim.model.config import flat_parameters

FURTHER = (
    'the held-out runs go where the fitted ones do not tell the parameters: fitted too, they are explained '
    'to {held_out:.2f} (the others {train:.2f}); fit with all runs, or record more like them'
)
TAKEN_BACK = 'taken back: {effects} - held-out runs are hardly better off, or worse ({worse:.2f} with, {best:.2f} without)'
ONLY_THERE = 'the fitted runs are explained; what is missing shows in what is held out: fit it too, and hold out others'
WORDS = {
    'none': 'nothing is missing that these data could show',
    'missing_effect': 'the model lacks {effects}',
    'unknown_effect': 'something is missing that no known effect explains',
}


def as_data(diagnosis: Diagnosis, file: Path | None = None) -> dict[str, Any]:
    """The verdict of the file contract (design: ranking of the first step, error by step), JSON's types only.

    `file` is where the proposed effect was written.
    """
    first = diagnosis.rounds[0] if diagnosis.rounds else None
    found: dict[str, Any] = finite({
        'verdict': diagnosis.verdict,
        'model': diagnosis.calibration.config.model,
        'effects': diagnosis.effects,
        'taken_back': diagnosis.taken_back,
        'ranking': ranking(first, diagnosis) if first else (),
        'error': [error_of(step) for step in diagnosis.steps],
        'noise_std': diagnosis.noise_std,
        'parameters': {
            name: value for name, value in flat_parameters(diagnosis.calibration.config).items()
            if isinstance(value, float) and math.isfinite(value)
        },
        'intervals': intervals_of(diagnosis),
        'training': diagnosis.training,
        'held_out': diagnosis.held_out,
        'interrupted': diagnosis.interrupted,
        'seconds': diagnosis.seconds,
        **({'fitted_together': asdict(diagnosis.together)} if diagnosis.together else {}),
        **({'proposed': proposed_data(diagnosis, file)} if diagnosis.proposal else {}),
    })  # fmt: skip
    return found


def ranking(first: SelectionStep, diagnosis: Diagnosis) -> list[dict[str, Any]]:
    """Candidates of the first step: what the model has in the end, what was accepted, then by cross-validated error.

    What explains as well as the accepted one is said as it was seen last, beside the other effects.
    """
    accepted = first.accepted.name if first.accepted else ''
    indistinguishable = {one.name: one.indistinguishable for one in first.tried}
    indistinguishable |= {
        one.name: one.indistinguishable for again in diagnosis.revisions if again.effect == accepted for one in again.tried
    }
    kept = diagnosis.effects[:1]
    ordered = sorted(first.tried, key=lambda one: (one.name not in kept, one.name != accepted, one.ratio))
    return [rank_of(one, diagnosis.held_out_ratio, indistinguishable[one.name]) for one in ordered]


def rank_of(one: CandidateFit, ratios: dict[str, float], indistinguishable: tuple[str, ...]) -> dict[str, Any]:
    """One candidate."""
    units = {parameter.name: parameter.unit for parameter in one.found.effect.parameters}
    std = {name.rpartition('.')[2]: s for name, s in one.std.items() if name.startswith(f'effects.{one.name}.')}
    return {
        'effect': one.name,
        'delta_bic': one.delta_bic,
        'held_out_error_ratio': ratios.get(one.name, one.ratio),
        'cross_validated_error_ratio': None if one.hopeless else one.ratio,
        'family_p': one.family_p,
        'parameters': {
            name: {'value': value, 'std': std.get(name), 'unit': units[name]}
            for name, value in one.fitted.values_of(one.name).items()
        },
        'plausible': one.plausible,
        'confounded_with': indistinguishable,
        'same_as': one.found.effect.same_as,
    }  # fmt: skip


def error_of(step: ModelStage) -> dict[str, Any]:
    """One step of the error's fall."""
    return {
        'effects': step.effects,
        'model': step.model,
        'train': step.train,
        'held_out': step.held_out,
        'channels': step.held_out_channels or step.channels,
    }


def intervals_of(diagnosis: Diagnosis) -> dict[str, dict[str, Any]]:
    """95 % intervals of the last fit."""
    sure = diagnosis.calibration.uncertainty
    if sure is None:
        return {}
    return {
        one.name: {'value': one.value, 'low': one.low, 'high': one.high, 'unit': one.unit, 'seen': one.seen}
        for one in sure.intervals
    }


def as_text(diagnosis: Diagnosis) -> Iterator[str]:
    """The verdict for the terminal."""
    yield headline(diagnosis)
    yield f'{"error over noise":<44} training  held out'
    for step in diagnosis.steps:
        name = ' + '.join(step.effects) or 'bare model'
        yield f'  {name + " (" + step.model + ")":<42} {number(step.train):>8}  {number(step.held_out):>8}'
    yield from remarks(diagnosis)


def remarks(diagnosis: Diagnosis) -> Iterator[str]:
    """What to know beside the verdict and the errors: values, what explains as well, what is left."""
    for one in diagnosis.judged:
        if one.accepted is not None:
            yield from lines_on(one.accepted, diagnosis)
    if diagnosis.taken_back:
        worse, best = diagnosis.steps[-3:-1] if diagnosis.proposal else diagnosis.steps[-2:]
        yield TAKEN_BACK.format(effects=' and '.join(diagnosis.taken_back), worse=worse.held_out, best=best.held_out)
    if diagnosis.verdict == 'unknown_effect' and diagnosis.search_ended:
        last = diagnosis.steps[-2 if diagnosis.proposal else -1]
        channels = last.held_out_channels or last.channels
        worst = max(channels, key=lambda name: channels[name])
        yield f'what is left is {channels[worst]:.1f} times the noise in {worst} (beyond {UNEXPLAINED:g} is not chance)'
        if last.train <= EXPLAINED:
            yield ONLY_THERE
        yield from proposed_text(diagnosis)
    elif diagnosis.together is not None and diagnosis.together.explained:
        yield FURTHER.format(**asdict(diagnosis.together))
    if len(diagnosis.training) < 2:
        yield 'one run was fitted: nothing could be foretold to test an effect, which flatters every one of them'
    elif not diagnosis.held_out:
        yield 'no run was held out: the errors in the end are those of the fitted runs, which flatter the model'
    if diagnosis.interrupted and diagnosis.search_ended:
        yield 'stopped in the last fit: its values are not final'


def headline(diagnosis: Diagnosis) -> str:
    """The verdict in a line; of a search that was stopped only what was found so far."""
    effects = ' and '.join(diagnosis.effects)
    if not diagnosis.search_ended:
        found = f'the model lacks {effects}; more may be missing' if effects else 'nothing was found missing so far'
        return f'stopped before the search was over: {found}'
    return f'verdict: {diagnosis.verdict} - {WORDS[diagnosis.verdict].format(effects=effects)}'


def lines_on(one: CandidateFit, diagnosis: Diagnosis) -> Iterator[str]:
    """An accepted effect: its values in the last fit beside what is realistic, and what explains as well."""
    sure = diagnosis.calibration.uncertainty
    intervals = {interval.name: interval for interval in sure.intervals} if sure else {}
    for parameter in one.found.effect.parameters:
        name = f'effects.{one.name}.{parameter.name}'
        value, interval = diagnosis.calibration.values.get(name), intervals.get(name)
        if value is not None:
            known = f' ({interval.low:.4g} to {interval.high:.4g})' if interval and interval.seen else ''
            real = parameter.realistic
            range_ = f'  [realistic: {real[0]:g} to {real[1]:g}]' if real else ''
            unit = '' if parameter.unit == '-' else f' {parameter.unit}'
            yield f'{name.removeprefix("effects.")} = {value:.4g}{known}{unit}{range_}'
    if one.indistinguishable:
        yield f'these data cannot tell it from {", ".join(one.indistinguishable)}'
    if one.found.effect.same_as:
        yield f'no data can tell it from {one.found.effect.same_as}'
