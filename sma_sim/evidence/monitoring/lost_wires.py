"""Wires of a bundle that are broken or have slipped out: the others pull with less than the whole.

F_added = -part_i F   [N], of bundle i
"""

from typing import Any

from sma_sim.model.effects.effect import Effect
from sma_sim.model.effects.ports import State
from sma_sim.model.parameters import Parameter, WireConstants


def missing_pull(s: State, w: WireConstants, p: Any) -> float:
    """What the lost wires would pull [N]."""
    return float(-(p.part if s.wire < 0.5 else p.part_2) * s.F)


EFFECT = Effect(
    name='lost_wires',
    title='lost wires of a bundle',
    port='wire_force',
    equation='F_added = -part_i F',
    source='a bundle of n equal wires pulls with n - m of them',
    parameters=(
        Parameter(
            'part', 0.1, '-', (0.0, 0.95), 'share of the wires of bundle 1 that is lost', neutral=0.0, realistic=(0.0, 0.5)
        ),
        Parameter(
            'part_2', 0.0, '-', (0.0, 0.95), 'share of the wires of bundle 2 that is lost', neutral=0.0, realistic=(0.0, 0.5)
        ),
    ),
    kernel=missing_pull,
    wires=2,
)
