"""Grains of a polycrystal transform one after the other: plateaus with a slope, steeper at their ends.

shift of both = H ((1 - c) y + 4 c y^3), y = x_M - 1/2   [Pa]: H from the first grain to the last
"""

from sma_sim.challenge.truth import drawn_parameter, simulated_truth
from sma_sim.model.effects.effect import Effect

EFFECT = Effect(
    name='truth_polycrystal',
    port='transformation_stress',
    equation='shift = H ((1 - c) y + 4 c y^3), y = x_M - 1/2',
    source='cubic quantile of the transformation stress of the grains',
    parameters=(
        drawn_parameter('H', 'Pa', 3e6, 5e7, 'transformation stress of the last grain less that of the first'),
        drawn_parameter('c', '-', 0.1, 0.7, 'part of H at the ends of the plateau'),
    ),
    kernel=lambda s, w, p: (
        p.H * ((1.0 - p.c) * (s.x - 0.5) + 4.0 * p.c * (s.x - 0.5) ** 3),
        p.H * ((1.0 - p.c) * (s.x - 0.5) + 4.0 * p.c * (s.x - 0.5) ** 3),
    ),
    energy='latent heat at the shifted stress',
)
TRUTH = simulated_truth(EFFECT, library='polycrystal', variables=('x',), listed=lambda p, of: {'spread': p['H']})
