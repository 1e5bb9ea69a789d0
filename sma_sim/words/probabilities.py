"""How probable a diagnosis holds its models, in words: for the terminal, the report and the page of `explore`.

All of it is read from the data of a diagnosis (`sma_sim.words.diagnosis_data.as_data`): its ``system`` and ``verdict``;
``probabilities``, of nothing missing (``none``), of something that is not listed (``unlisted``), of each of the ``effects``
by name and of ``other`` ones; ``models``, the most probable first, with their ``effects``, a ``formula`` or none,
``differences`` between recordings, ``probability`` and ``error`` over noise; and which effects were ``retracted``.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from sma_sim.evidence.search.posterior import EVEN
from sma_sim.evidence.search.refine import TIE
from sma_sim.model.effects.conversion import effect_on
from sma_sim.model.effects.discovery import package_effects
from sma_sim.model.effects.scope import FORM, SEPARATOR, words_of
from sma_sim.model.structures.discovery import known_structures
from sma_sim.model.structures.module import STRUCTURE as MODULE

NOTHING, UNLISTED = 'nothing missing', 'something that is not listed'
NO_EFFECT = 'no effect of the list'  # in place of NOTHING, where something is missing all the same
OTHER = 'another listed effect, which these data would hardly show'
CERTAIN, MIN_PERCENT = 0.999, 0.01  # above it no digits, below it a ratio
LEAST = 1e-9  # a ratio below is not told: no model is known so well
DIGITS = 2  # of a ratio


@dataclass(frozen=True)
class ProbabilityRow:
    """A model or a finding and its probability, both in words; the normalized RMSE of a model, None of a finding."""

    words: str
    probability: str
    error: float | None = None


def probability_words(p: float) -> str:
    """A probability as people say it: ``more than 99.9 %``, ``87 %``, ``1 in 40,000``."""
    if p > CERTAIN:
        return f'more than {100.0 * CERTAIN:g} %'
    if p >= MIN_PERCENT:
        return f'{100.0 * p:.1f} %' if p > 1.0 - MIN_PERCENT else f'{100.0 * p:.0f} %'
    if p < LEAST:
        return f'less than 1 in {1.0 / LEAST:,.0f}'
    ratio = 1.0 / p
    return f'1 in {round(ratio, DIGITS - 1 - math.floor(math.log10(ratio))):,.0f}'


def effect_words(name: str, system: str = MODULE.name) -> str:
    """What a sentence calls an effect, NAME or NAME@SCOPE, on a structure."""
    plain, _, scope = name.partition(SEPARATOR)
    known, structure = package_effects().get(plain), known_structures().get(system)
    known = effect_on(known, structure) if known and structure else known
    phrase = known.phrase if known else plain.replace('_', ' ')
    scope, _, field = scope.partition(FORM)
    place = re.sub(r'^wire_(\d+)_?$', r'wire \1', scope).rstrip('_')
    words = '' if not scope else ', shared by the wires' if scope == 'shared' else f', in {place} only'
    return phrase + words + (f', as another function of {words_of(field)}' if field else '')


def model_words(model: Mapping[str, Any], system: str, alone: str = NOTHING) -> str:
    """What a model of a structure adds to the nominal one, `alone` where nothing, and in what recordings differ."""
    parts = [
        *(effect_words(name, system) for name in model['effects']),
        *([f'the equation {model["formula"]}'] if model['formula'] else []),
    ]
    differences = [f'recordings that differ in {name}' for name in model.get('differences') or ()]
    return ' + '.join([*(parts or [alone]), *differences])


def system_of(found: Mapping[str, Any]) -> str:
    """The structure of a diagnosis; data of older versions do not say it."""
    return str(found.get('system', MODULE.name))


def model_rows(found: Mapping[str, Any]) -> list[ProbabilityRow]:
    """The models of a diagnosis, the most probable first; none where it says nothing of them."""
    is_unknown = lacks_unlisted(found) or found.get('verdict') == 'unknown_effect'
    system, alone = system_of(found), NO_EFFECT if is_unknown else NOTHING
    return [
        ProbabilityRow(model_words(model, system, alone), probability_words(model['probability']), model['error'])
        for model in found.get('models') or ()
    ]


def lacks_unlisted(found: Mapping[str, Any]) -> bool:
    """Whether something that is not listed is probably missing, beside the models that were tried."""
    models = found.get('models') or ()
    left = (found.get('probabilities') or {}).get('unlisted', 0.0)
    return bool(left > EVEN and models and not models[0]['formula'])


def finding_rows(found: Mapping[str, Any]) -> list[ProbabilityRow]:
    """By effect, how probable it is that it is missing, the most probable first; then nothing, and what is not listed."""
    known = found.get('probabilities')
    if not known:
        return []
    effects = sorted(known['effects'].items(), key=lambda item: -float(item[1]))
    named = [(effect_words(name, system_of(found)), p) for name, p in effects] + [
        (NOTHING, known['none']),
        *([(OTHER, known['other'])] if known.get('other') else []),
        (UNLISTED, known['unlisted']),
    ]
    return [ProbabilityRow(words, probability_words(p)) for words, p in named]


def probability_lines(found: Mapping[str, Any]) -> list[str]:
    """A diagnosis' probabilities in a few sentences; none where it has none."""
    models: Sequence[Mapping[str, Any]] = found.get('models') or ()
    rows = model_rows(found)
    if not rows:
        return []
    second = f' Second: {rows[1].words}, {rows[1].probability}.' if len(rows) > 1 else ''
    first = 'By the fitted recordings alone, which do not tell those held out' if found.get('retracted') else 'Most probable'
    lines = [f'{first}: {rows[0].words}, {rows[0].probability}.{second}']
    least = math.exp(-TIE) * models[0]['probability']
    *others, last = [row.words for row, model in zip(rows, models, strict=True) if model['probability'] > least]
    if others:
        lines.append(f'These data do not decide between {"; ".join(others)} and {last}.')
    if lacks_unlisted(found):
        left = probability_words(found['probabilities']['unlisted'])
        lines.append(
            f'Beside these, {UNLISTED} is left: {left}. The normalized RMSE of the best model is '
            f'{models[0]["error"]:.3g}; the other probabilities are among the models that were tried.'
        )
    return lines
