"""A thin wire cannot push: it bends away.

F_added = part (F_s ln(1 + exp(F/F_s)) - F)   [N]: with part = 1 the structure feels F in tension and nothing in compression
"""

import math
from typing import Any

from sma_sim.model.effects.effect import Effect
from sma_sim.model.effects.ports import State
from sma_sim.model.parameters import Parameter, WireConstants


def missing_push(s: State, w: WireConstants, p: Any) -> float:
    """What keeps a wire from pushing [N]: F_s ln(1 + exp(F/F_s)) - F, written so that nothing overflows."""
    push = math.log1p(math.exp(-abs(s.F) / p.F_s)) * p.F_s
    added: float = p.part * (push + max(-s.F, 0.0))
    return added


EFFECT = Effect(
    name='slack',
    title='slack of wires that cannot push',
    port='wire_force',
    equation='F_added = part (F_s ln(1 + exp(F/F_s)) - F)',
    source='Euler buckling of a slender wire: its load is far below its tension',
    parameters=(
        Parameter(
            'part', 1.0, '-', (0.0, 1.0), 'share of the compression that is not passed on', neutral=0.0, realistic=(0.5, 1.0)
        ),
        Parameter('F_s', 5e-3, 'N', (1e-6, 10.0), 'force of one wire that counts as slack', realistic=(1e-3, 0.05)),
    ),
    kernel=missing_push,
    straight=True,
    energy='the work of pushing is kept from the structure; in U the wire stays straight, so exact while x_M is frozen',
    description='only for wires that get slack: little pretension, or T_E so low that sigma_M is below zero',
    signature='dead stroke: the plate does not move until the slack is taken up; forces never below zero',
    confused_with=('pretension_mismatch', 'wire.l0'),
)
