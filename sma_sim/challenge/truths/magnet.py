"""A magnet beside the plate that draws it to one angle.

M = -M_0 u/(1 + u^2)^2, u = (alpha - alpha_0)/w   [N m]: the force of a dipole fades with the distance
"""

from sma_sim.challenge.truth import drawn_parameter, simulated_truth
from sma_sim.model.effects.effect import Effect

EFFECT = Effect(
    name='truth_magnet',
    port='structure_force',
    equation='M = -M_0 u/(1 + u^2)^2, u = (alpha - alpha_0)/w',
    source='attraction between two dipoles, bell-shaped potential',
    parameters=(
        drawn_parameter('M_0', 'N m', 3e-3, 1.5e-2, 'scale of the moment'),
        drawn_parameter('w', 'rad', 0.03, 0.06, 'width'),
        drawn_parameter('alpha_0', 'rad', -0.08, 0.08, 'angle to which it draws'),
    ),
    kernel=lambda s, b, p: (
        0.0,
        0.0,
        -p.M_0 * ((s.alpha - p.alpha_0) / p.w) / (1.0 + ((s.alpha - p.alpha_0) / p.w) ** 2) ** 2,
    ),
)
TRUTH = simulated_truth(EFFECT, variables=('alpha',))
