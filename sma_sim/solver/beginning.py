"""Where a run begins that does not begin at rest: what is left of a motion before it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import islice

WARMTH, POSE, RATES = 'warmth', 'pose', 'rates'  # its parts, in the order of its values
STATES = 'states.'  # before the name of an effect: the part of its extra states


@dataclass(frozen=True)
class Beginning:
    """What is left of a motion before a run, where it begins. Without any of it, a run begins at rest.

    Attributes
    ----------
    warmth : tuple of float
        By how much each wire is warmer than the ambient [K]; empty where temperatures are imposed.
    pose : tuple of float
        By how much each coordinate differs from the equilibrium of wires that warm (SI).
    rates : tuple of float
        The rates of the coordinates (SI).
    states : tuple of (str, tuple of float)
        By name of an effect, by how much each of its extra states differs from its first value (in its unit); a single copy
        of those that wires share. Those of other effects begin at their first values.
    """

    warmth: tuple[float, ...] = ()
    pose: tuple[float, ...] = ()
    rates: tuple[float, ...] = ()
    states: tuple[tuple[str, tuple[float, ...]], ...] = ()

    @property
    def is_at_rest(self) -> bool:
        """Whether it says nothing."""
        return not self.values

    @property
    def parts(self) -> dict[str, tuple[float, ...]]:
        """Its values by their kind."""
        of_effects = {STATES + name: values for name, values in self.states}
        return {WARMTH: self.warmth, POSE: self.pose, RATES: self.rates} | of_effects

    @property
    def values(self) -> tuple[float, ...]:
        """All of its values, in the order of its parts."""
        return tuple(value for part in self.parts.values() for value in part)

    @classmethod
    def of_parts(cls, parts: Mapping[str, Iterable[float]]) -> Beginning:
        """The beginning with these parts, by their kind; what is not among them is empty."""
        warmth, pose, rates = (tuple(parts.get(kind, ())) for kind in (WARMTH, POSE, RATES))
        names = [kind.removeprefix(STATES) for kind in parts if kind.startswith(STATES)]
        return cls(warmth, pose, rates, tuple((name, tuple(parts[STATES + name])) for name in names))

    def with_values(self, values: Iterable[float]) -> Beginning:
        """The same parts with other values, in the order of `values`."""
        rest = iter(values)
        return self.of_parts({kind: tuple(islice(rest, len(part))) for kind, part in self.parts.items()})


AT_REST = Beginning()
