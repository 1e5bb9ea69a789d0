"""Radiation between a wire and a large enclosure, by the coefficient of radiative transfer.

h_r = (1 - rho) sigma_SB (T^2 + T_E^2)(T + T_E),   Q = -h_r A_s (T - T_E)   [W], rho the reflectivity of the oxide
"""

from sma_sim.challenge.truth import drawn_parameter, simulated_truth
from sma_sim.model.effects.effect import Effect

SIGMA_SB = 5.670374419e-8  # [W/(m^2 K^4)]

EFFECT = Effect(
    name='truth_radiation',
    port='wire_heat',
    equation='Q = -(1 - reflectivity) sigma_SB (T^2 + T_E^2)(T + T_E) A_s (T - T_E)',
    source="Kirchhoff's and Stefan and Boltzmann's laws",
    parameters=(drawn_parameter('reflectivity', '-', 0.1, 0.8, 'of the surface in the infrared'),),
    kernel=lambda s, w, p: (
        -(1.0 - p.reflectivity) * SIGMA_SB * (s.T**2 + s.T_E**2) * (s.T + s.T_E) * w.surface * (s.T - s.T_E)
    ),
)
TRUTH = simulated_truth(
    EFFECT, library='radiation', variables=('T',), listed=lambda p, of: {'emissivity': 1.0 - p['reflectivity']}
)
