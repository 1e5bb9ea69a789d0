"""Which inputs may be missing: one port, or the same quantity on all wires; and which of them physics confounds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from sma_sim.evidence.estimation.injection_points import Port


@dataclass(frozen=True)
class InputHypothesis:
    """Ports at which unknown functions of time act together."""

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


def hypotheses_of(ports: Sequence[Port]) -> tuple[InputHypothesis, ...]:
    """Every port alone, and the same quantity on all wires."""
    hypotheses = [InputHypothesis(port.name, (port,)) for port in ports]
    for group in dict.fromkeys(port.group for port in ports):
        both = tuple(port for port in ports if port.group == group)
        if len(both) > 1:
            hypotheses.append(InputHypothesis(group, both))
    return tuple(hypotheses)


# Why two quantities may have the same effect on every channel.
CONFOUNDING_REASONS = {
    frozenset(('heat', 'power')): 'a wire feels the sum of all heat, whatever it comes from',
    frozenset(('heat', 'stress')): 'on its plateau a wire shows a change of temperature as sigma_T times as much stress',
    frozenset(('power', 'stress')): 'on its plateau a wire shows a change of temperature as sigma_T times as much stress',
    frozenset(('strain', 'stress')): 'off its plateau a wire shows a strain as a stress',
    frozenset(('force_U_y', 'moment_alpha')): 'a force across the end of a beam and a moment bend it in nearly the same way',
    frozenset(('force_U_x', 'moment_alpha')): 'a force along a bent beam turns its end',
    frozenset(('force_U_x', 'force_U_y')): 'on a bent beam the directions mix',
    frozenset(('stiffness', 'moment_alpha')): 'a softer beam bends as if a moment helped',
    frozenset(('stiffness', 'force_U_y')): 'a softer beam bends as if a force helped',
}
WIRE_QUANTITIES = ('heat', 'power', 'stress', 'strain')
ALONG_WIRES = 'force_U_x'  # stretches the beam, which no tension of a wire does alone
FORCES_UNMEASURED = 'where no force is measured, the tension of the wires shows only as the force or moment that it makes'


def confounding_reason(first: InputHypothesis, second: InputHypothesis, forces_measured: bool) -> str:
    """Why two hypotheses may be indistinguishable; '' where physics gives no reason.

    `forces_measured`: the recordings have the wires' forces (or stress).
    """
    if first.group == second.group:
        return 'the same quantity, on one wire or on several'
    pair = frozenset((first.group, second.group))
    one_of_a_wire = len(pair.intersection(WIRE_QUANTITIES)) == 1
    on_structure = [
        tested.group for tested in (first, second) if tested.hook == 'structure_force' and tested.group != ALONG_WIRES
    ]
    if not forces_measured and one_of_a_wire and on_structure:
        return FORCES_UNMEASURED
    return CONFOUNDING_REASONS.get(pair, '')
