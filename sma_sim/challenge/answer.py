"""The answer of a challenge: what was hidden, as plain data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

NOTHING_MISSING, MISSING_EFFECT, UNKNOWN_EFFECT = 'none', 'missing_effect', 'unknown_effect'
VERDICT_CODES = (NOTHING_MISSING, MISSING_EFFECT, UNKNOWN_EFFECT)


@dataclass(frozen=True)
class HiddenEffect:
    """A hidden effect: `library` is the package's name for it, '' if it has none; `parameters` are (value, unit) by name.

    `influence` is the root mean square of what it changes, over the noise, by channel and for `all` recorded ones.
    `listed` are the parameters of the package's effect that come nearest, (value, unit) by name.
    """

    name: str
    library: str
    port: str
    variables: tuple[str, ...]
    parameters: Mapping[str, tuple[float, str]]
    influence: Mapping[str, float]
    listed: Mapping[str, tuple[float, str]] = field(default_factory=dict)


@dataclass(frozen=True)
class Answer:
    """The hidden effects, and by full name what the user's model has and what the robot has (nominal, true)."""

    seed: int
    effects: tuple[HiddenEffect, ...]
    parameters: Mapping[str, tuple[float, float]]
    noise_std: Mapping[str, float]

    @property
    def verdict(self) -> str:
        """What a perfect diagnosis says."""
        if not self.effects:
            return NOTHING_MISSING
        return MISSING_EFFECT if all(effect.library for effect in self.effects) else UNKNOWN_EFFECT

    @property
    def library_names(self) -> tuple[str, ...]:
        """The effects that a diagnosis can name."""
        return tuple(effect.library for effect in self.effects if effect.library)

    def as_data(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return asdict(self)


def with_units(data: Mapping[str, Any]) -> dict[str, tuple[float, str]]:
    """Values and units by name, of plain data."""
    return {name: (float(value), str(unit)) for name, (value, unit) in data.items()}


def answer_from(data: Mapping[str, Any]) -> Answer:
    """The answer of plain data."""
    effects = tuple(
        HiddenEffect(
            effect['name'],
            effect['library'],
            effect['port'],
            tuple(effect['variables']),
            with_units(effect['parameters']),
            effect['influence'],
            with_units(effect.get('listed', {})),
        )
        for effect in data['effects']
    )
    offsets = {name: (float(nominal), float(true)) for name, (nominal, true) in data['parameters'].items()}
    return Answer(int(data['seed']), effects, offsets, data['noise_std'])
