"""A bundle whose wires are not equally tight: the loose ones hang through while the force is small, and none can push.

Tightness spread evenly over +-F_s about the mean: the mean of max(0, F + F_s u) over -1 < u < 1 is (F + F_s)^2/(4 F_s)
where |F| < F_s, F above, 0 below   [N per wire]. Only in the cold: a wire gets slack once sigma_M is near zero.
"""

from typing import Any

from sma_sim.challenge.truth import drawn_parameter, simulated_truth
from sma_sim.model.effects.effect import Effect
from sma_sim.model.effects.ports import State
from sma_sim.model.parameters import WireConstants


def added_force(s: State, w: WireConstants, p: Any) -> float:
    """What is passed on less what equal wires would pass on [N per wire]."""
    spread: float = p.F_s
    if abs(s.F) < spread:
        return (s.F + spread) ** 2 / (4.0 * spread) - s.F
    return max(0.0, s.F) - s.F


EFFECT = Effect(
    name='truth_slack',
    port='wire_force',
    equation='F_passed = mean of max(0, F + F_s u) over -1 < u < 1',
    source='geometry of a bundle',
    parameters=(drawn_parameter('F_s', 'N', 0.005, 0.05, 'spread of the force of one wire in the bundle'),),
    kernel=added_force,
)
TRUTH = simulated_truth(EFFECT, library='slack', variables=('F',), T_E=266.0)
