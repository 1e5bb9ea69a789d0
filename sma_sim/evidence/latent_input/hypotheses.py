"""What may be missing: one port, or the same quantity on both wires; and what each cannot be told from, by physics."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from sma_sim.evidence.estimation.injection_points import Port


@dataclass(frozen=True)
class Hypothesis:
    """Ports with unknown time courses that are believed together."""

    name: str
    ports: tuple[Port, ...]

    @property
    def hook(self) -> str:
        """The port of effects on which they act."""
        return self.ports[0].hook

    @property
    def group(self) -> str:
        """Their quantity."""
        return self.ports[0].group


def hypotheses_of(ports: Sequence[Port]) -> tuple[Hypothesis, ...]:
    """Every port alone, and the same quantity on both wires."""
    found = [Hypothesis(port.name, (port,)) for port in ports]
    groups = dict.fromkeys(port.group for port in ports)
    for group in groups:
        both = tuple(port for port in ports if port.group == group)
        if len(both) > 1:
            found.append(Hypothesis(group, both))
    return tuple(found)


# Why two quantities may leave the same in every channel.
REASONS = {
    frozenset(('heat', 'power')): 'a wire feels the sum of all heat, whatever it comes from',
    frozenset(('heat', 'stress')): 'on its plateau a wire shows a change of temperature as sigma_T times as much stress',
    frozenset(('power', 'stress')): 'on its plateau a wire shows a change of temperature as sigma_T times as much stress',
    frozenset(('strain', 'stress')): 'off its plateau a wire shows a strain as a stress',
    frozenset(('force_U_y', 'moment_alpha')): 'a force across the end of a beam and a moment bend it in nearly the same way',
    frozenset(('force_U_x', 'moment_alpha')): 'a force along a bent beam turns its end',
    frozenset(('force_U_x', 'force_U_y')): 'on a bent beam the directions mix',
    frozenset(('stiffness', 'moment_alpha')): 'a beam that is softer bends as if a moment helped',
    frozenset(('stiffness', 'force_U_y')): 'a beam that is softer bends as if a force helped',
}  # fmt: skip


WIRES = ('heat', 'power', 'stress', 'strain')
UNSEEN = 'where no force is measured a pull of the wires shows only as the moment that it makes'


def reason(one: Hypothesis, other: Hypothesis, pulls_seen: bool) -> str:
    """Why two hypotheses may be alike; '' where physics knows no reason. `pulls_seen`: the wires' forces were measured."""
    if one.group == other.group:
        return 'the same quantity, on one wire or on both'
    pair = frozenset((one.group, other.group))
    if not pulls_seen and len(pair.intersection(WIRES)) == 1 and pair & {'moment_alpha', 'force_U_y', 'stiffness'}:
        return UNSEEN
    return REASONS.get(pair, '')
