"""Elastic attachment: a spring between each wire and the plate, in series with the wire.

e = F/(k l0) = c sigma, c = C pi r0^2/l0 [1/Pa], C = 1/k the compliance. sigma depends on e in turn; solved for it:
e = c (eps - e_o - eps_T x)/(x/E_M + (1 - x)/E_A + c), e_o what all other effects add.
The same as 1/E_A + c and 1/E_M + c in place of 1/E_A and 1/E_M, in the MAS kinetics too, where 1/E_I becomes 1/E_I - c.
"""

from typing import Any

from sma_sim.model.effects.effect import Effect
from sma_sim.model.effects.ports import State
from sma_sim.model.material import compliance
from sma_sim.model.parameters import Parameter, WireConstants


def stretch(s: State, w: WireConstants, p: Any) -> float:
    """Elongation of the spring over l0."""
    c: float = p.C * w.section / w.l0
    return c * (s.eps - s.strain - w.eps_T * s.x) / (compliance(s.x, w) + c)


EFFECT = Effect(
    name='attachment_compliance',
    title='compliance of the attachments of the wires',
    port='wire_strain',
    stage='series',
    equation='e = c sigma, c = C pi r0^2/l0',
    source="springs in series (Hooke's law)",
    parameters=(
        Parameter(
            'C', 3e-5, 'm/N', (0.0, 1e-3), 'compliance of the attachment of one wire', neutral=0.0, realistic=(3e-6, 3e-4)
        ),
    ),
    kernel=stretch,
    straight=True,
    energy='elastic: the spring stores Om c sigma^2/2, which is not in U of the wire',
    description='exactly equal shifts of 1/E_A and 1/E_M: no measurement at the ends tells them apart',
    signature='every change of force costs stroke; both moduli appear smaller, the plateaus stay',
    confused_with=(
        'wire.E_A',
        'wire.E_M',
        'pretension_mismatch',
        'thermal_expansion',
        'functional_fatigue',
        'r_phase_strain',
        'grip_toe',
    ),
    same_as='equal shifts of 1/E_A and 1/E_M by C pi r0^2/l0, in the kinetics too',
)
