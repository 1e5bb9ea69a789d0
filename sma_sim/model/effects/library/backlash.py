"""Play between a structure and its spring: the spring is not felt until the play is taken up.

F = f - d(f),   d(f) = sign(f) max(|f| - k b/2, 0), rounded off over 5 % of k b/2: f the spring's force, k its stiffness
With play the spring's force is d(f) in place of f, which is zero while |f| < k b/2. A spring that never changes the sign of
its force only loses k b/2.
"""

import math
from typing import Any

from sma_sim.model.effects.effect import Effect
from sma_sim.model.parameters import Parameter

RELATIVE_KNEE_WIDTH = 0.05  # of half the play
SMALLEST = 1e-30  # [N or N m]; a smaller force of the play is none


def softplus(x: float) -> float:
    """ln(1 + exp(x)), written so that nothing overflows."""
    return max(x, 0.0) + math.log1p(math.exp(-abs(x)))


def lost(s: Any, b: Any, p: Any) -> float:
    """What the play takes away of the spring's force."""
    half = 0.5 * s.k * p.b
    if half < SMALLEST:
        return 0.0
    width = RELATIVE_KNEE_WIDTH * half
    return float(s.f - width * (softplus((s.f - half) / width) - softplus((-s.f - half) / width)))


EFFECT = Effect(
    name='backlash',
    title='play between the structure and its spring',
    port='structure_force',
    needs=('spring',),
    equation='F = f - sign(f) max(|f| - k b/2, 0)',
    source='dead-zone model of backlash: Nordin and Gutman, Automatica 38 (2002) 1633',
    parameters=(
        Parameter(
            'b', 0.02, 'rad', (0.0, 1.5), 'play, from end to end', neutral=0.0, realistic=(2e-3, 0.2), quantity='change'
        ),
    ),
    kernel=lost,
    energy='elastic: the force of a potential, none is lost',
    description='without mass and friction between the ends of the play',
    signature='easy motion about the place where the spring changes sign, and further away by half the play',
    confused_with=('wire.eps_T', 'wire.sigma_MW0'),
)
