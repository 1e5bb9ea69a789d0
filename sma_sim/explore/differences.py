"""In what two versions of a model differ."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from sma_sim.model.config import Config, flat_parameters

Value = float | str | bool


@dataclass(frozen=True)
class Difference:
    """A parameter in which two versions differ; None where the effect that has it is not active."""

    name: str
    unit: str
    before: Value | None
    after: Value | None
    meaning: str


def differences(before: Config, after: Config) -> tuple[Difference, ...]:
    """In what two configurations differ: effects first, then parameters in their order."""
    first, second = flat_parameters(before), flat_parameters(after)
    meanings = meanings_in(before) | meanings_in(after)
    found = []
    for one in dict.fromkeys((*first['effects.active'], *second['effects.active'])):
        active = one in first['effects.active'], one in second['effects.active']
        if active[0] != active[1]:
            found.append(Difference(f'effects.{one}', '', *active, 'whether the effect is active'))
    for name in dict.fromkeys((*first, *second)):
        values = first.get(name), second.get(name)
        if not name.startswith(('effects.active', 'effects.paths', 'structures.paths', 'covariance.')) and not same_value(
            *values
        ):
            found.append(Difference(name, meanings.get(name, ('', ''))[0], *values, meanings.get(name, ('', ''))[1]))
    return tuple(found)


def same_value(one: Any, other: Any) -> bool:
    """Whether two values are equal; NaN, the node's word for "not given", is equal to itself."""
    both = isinstance(one, float) and isinstance(other, float)
    return bool(one == other or both and math.isnan(one) and math.isnan(other))


def meanings_in(config: Config) -> dict[str, tuple[str, str]]:
    """Unit and meaning of every parameter by full name."""
    found = {name: (p.unit, p.description) for name, p in config.structure.all_parameters.items()}
    for active in config.effects:
        effect = active.effect
        found |= {f'effects.{effect.name}.{p.name}': (p.unit, p.description) for p in effect.parameters}
    return found


def difference_words(found: Sequence[Difference]) -> str:
    """A change in words, short."""
    words = []
    for one in found:
        if isinstance(one.after, bool) and one.name.count('.') == 1 and one.name.startswith('effects.'):
            words.append(f'{one.name.partition(".")[2]} {"on" if one.after else "off"}')
        elif one.before is not None and one.after is not None:
            words.append(f'{one.name} {value_words(one.before)} -> {value_words(one.after)} {one.unit}'.rstrip(' -'))
    more = f' and {len(words) - 3} more' if len(words) > 3 else ''
    return ', '.join(words[:3]) + more or 'the order of the effects'


def value_words(value: Value) -> str:
    """A value, short."""
    return f'{value:g}' if isinstance(value, float) else str(value)
