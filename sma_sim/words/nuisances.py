"""What a fit says of the bench: zeros, drifts, and the effects that its model had from the start. No findings."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite, nan
from typing import Any

from sma_sim.evidence.estimation.calibrate import UNMOVED, Calibration
from sma_sim.evidence.estimation.held_out_prediction import RunFit
from sma_sim.evidence.estimation.recording_differences import CONVECTION, LENGTH, SUPPLY
from sma_sim.evidence.estimation.uncertainty import Interval
from sma_sim.model.effects.discovery import ActiveEffect
from sma_sim.model.parameters import ZERO_CELSIUS
from sma_sim.model.shown import joined_words


def offset_sentences(found: Calibration) -> list[str]:
    """The zeros of channels and their drifts, a sentence for each channel."""
    kinds = {'zero': {fit.name: fit.zeros for fit in found.runs}, 'drift': {fit.name: fit.drifts for fit in found.runs}}
    sentences = []
    for word, by_run in kinds.items():
        for channel in dict.fromkeys(name for offsets in by_run.values() for name in offsets):
            shown = ', '.join(f'{run} {offsets[channel]:.3g}' for run, offsets in by_run.items() if channel in offsets)
            sentences.append(f'{word} of {channel}, estimated for each recording [SI]: {shown}')
    return sentences


def ambient_sentence(found: Calibration) -> str:
    """The ambient temperature of each recording where that was not known; empty where it was."""
    own = {run.name: run.ambient for run in found.runs if run.ambient_std > 0.0}
    moved = {name: f'{value:+.2f}' for name, value in own.items() if abs(value) >= UNMOVED}
    return own_sentence(own, moved, 'ambient temperature', ' above that of the recording, estimated for each [K]')


def factor_sentences(found: Calibration) -> list[str]:
    """What each recording had another one of, a sentence for each parameter."""
    by_parameter: dict[str, dict[str, float]] = {}
    for run in found.runs:
        for parameter, factor in run.factors:
            by_parameter.setdefault(parameter, {})[run.name] = factor
    words = {one.parameter: one.words for one in (CONVECTION, LENGTH, SUPPLY)}
    sentences = []
    for parameter, own in by_parameter.items():
        moved = {name: f'{factor:.4g}' for name, factor in own.items() if abs(factor - 1.0) >= UNMOVED}
        how = ', estimated for each recording as a factor'
        sentences.append(own_sentence(own, moved, words.get(parameter, parameter), how))
    return sentences


def own_sentence(names: Collection[str], moved: Mapping[str, str], what: str, how: str) -> str:
    """What recordings had their own of, for those in which it `moved` from the middle of its prior; in the others of `names`
    nothing that was measured depends on it. Empty without any."""
    shown = f'{what}{how}: {", ".join(f"{name} {value}" for name, value in moved.items())}'
    idle = [name for name in names if name not in moved]
    if not idle:
        return shown if moved else ''
    words = f'nothing that was measured in {joined_words(idle)} depends on it'
    return f'{shown}; {words}' if moved else f'{what}, asked for as another one in each recording: {words}, leave it out'


@dataclass(frozen=True)
class WireAtBeginning:
    """The temperature of a wire when a recording begins [K], its 95 % interval, NaN where that is not known, and the ambient
    temperature."""

    T: float
    low: float
    high: float
    T_E: float


def warm_wires(found: Calibration, predicted: Sequence[RunFit] = ()) -> dict[str, tuple[WireAtBeginning, ...]]:
    """By recording that may not begin at rest, its wires; those of held-out runs as they were `predicted`."""
    known, wires = found.uncertainty.warmth if found.uncertainty else {}, dict[str, tuple[WireAtBeginning, ...]]()
    for run in (*found.runs, *predicted):
        unknown = [(nan, nan)] * len(run.beginning.warmth)
        ends = [(one.low, one.high) for one in known.get(run.name, ())] or unknown
        wires[run.name] = tuple(
            WireAtBeginning(run.T_E + warmth, run.T_E + low, run.T_E + high, run.T_E)
            for warmth, (low, high) in zip(run.beginning.warmth, ends, strict=True)
        )
    return {name: of_run for name, of_run in wires.items() if of_run}


def beginning_words(wires: Mapping[str, Sequence[WireAtBeginning]]) -> str:
    """The wires that are warm when recordings begin, in degrees Celsius, with their 95 % intervals where these are known."""
    shown = []
    for name, of_run in wires.items():
        for k, wire in enumerate(of_run, start=1):
            is_known = isfinite(wire.low)
            if (wire.low if is_known else wire.T) > wire.T_E:
                between = f' ({wire.low - ZERO_CELSIUS:.0f} to {wire.high - ZERO_CELSIUS:.0f})' if is_known else ''
                shown.append(f'wire_{k} of {name} at {wire.T - ZERO_CELSIUS:.0f} degC{between}')
    return joined_words(shown) or 'no wire is clearly warm, but the poses are not those at rest'


def given_effects(found: Calibration, findings: Collection[str]) -> list[ActiveEffect]:
    """The active effects that are no `findings`: the model had them from the start."""
    return [active for active in found.config.effects if active.effect.name not in findings]


def nuisance_sentences(found: Calibration, findings: Collection[str]) -> list[str]:
    """All of it in words."""
    given = given_effects(found, findings)
    intervals = {interval.name: interval for interval in found.uncertainty.intervals} if found.uncertainty else {}
    words = [effect_words(active, intervals) for active in given]
    sentence = [f'In the model from the start, no finding: {"; ".join(words)}.'] if words else []
    return [*sentence, *offset_sentences(found)]


def effect_words(active: ActiveEffect, intervals: dict[str, Interval]) -> str:
    """An effect with its parameters, those that were fitted with their intervals."""
    effect, shown = active.effect, []
    for parameter, value in zip(effect.parameters, active.values, strict=True):
        interval = intervals.get(f'effects.{effect.name}.{parameter.name}')
        unit = '' if parameter.unit == '-' else f' {parameter.unit}'
        spread = f' ({interval.low:.4g} to {interval.high:.4g})' if interval else ''
        shown.append(f'{parameter.name} {value:.4g}{unit}{spread}')
    return f'{effect.name}, {", ".join(shown)}'


def nuisance_data(found: Calibration, findings: Collection[str]) -> dict[str, Any]:
    """All of it for programs (SI)."""
    return {
        'delay': found.delay,
        'effects': {active.effect.name: active.by_short_name for active in given_effects(found, findings)},
        'zeros': {fit.name: dict(fit.zeros) for fit in found.runs if fit.zeros},
        'drifts': {fit.name: dict(fit.drifts) for fit in found.runs if fit.drifts},
    }
