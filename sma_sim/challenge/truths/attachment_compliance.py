"""Clamps that give: the wires lengthen by F/k_c less than the distance of the clamps.

e = g sigma, g = n A/(k_c l0), with wire and clamp in series: sigma = (eps - eps_T x_M)/(x_M/E_M + (1 - x_M)/E_A + g)
"""

from typing import Any

from sma_sim.challenge.truth import drawn_parameter, simulated_truth
from sma_sim.model.effects.effect import Effect
from sma_sim.model.effects.ports import State
from sma_sim.model.parameters import WireConstants


def clamp_strain(s: State, w: WireConstants, p: Any) -> float:
    """Strain that the clamps take up."""
    clamp: float = w.n * w.section / (p.k_c * w.l0)
    wire = s.x / w.E_M + (1.0 - s.x) / w.E_A
    return clamp * (s.eps - w.eps_T * s.x) / (wire + clamp)


EFFECT = Effect(
    name='truth_attachment_compliance',
    port='wire_strain',
    equation='e = g (eps - eps_T x_M)/(x_M/E_M + (1 - x_M)/E_A + g), g = n A/(k_c l0)',
    source='springs in series',
    parameters=(drawn_parameter('k_c', 'N/m', 4e4, 6e5, 'stiffness of the clamps of one bundle'),),
    kernel=clamp_strain,
    energy='the work that the clamps store and give back does not enter',
)
TRUTH = simulated_truth(
    EFFECT, library='attachment_compliance', variables=('sigma',), listed=lambda p, of: {'C': of['wire.n'] / p['k_c']}
)
