"""Wires driven by a current: the power follows their resistance, which depends on phase and temperature.

Q = J (rho(x_M, T)/rho(1/2, 298 K) - 1), rho = rho_A (1 - x_M) + rho_M x_M + b (T - 298 K)   [W], rho_A = 0.82 uOhm m
"""

from sma_sim.challenge.truth import drawn_parameter, simulated_truth
from sma_sim.model.effects.effect import Effect

RHO_A = 0.82e-6  # [Ohm m]


EFFECT = Effect(
    name='truth_resistance_feedback',
    port='wire_heat',
    equation='Q = J (rho(x_M, T)/rho(1/2, 298) - 1); rho = rho_A (1 - x_M) + rho_M x_M + b (T - 298)',
    source='resistivity of NiTi: 0.82 uOhm m in austenite, 0.9 to 1.0 in martensite',
    parameters=(
        drawn_parameter('rho_M', 'Ohm m', 0.88e-6, 1.05e-6, 'resistivity of martensite at 298 K'),
        drawn_parameter('b', 'Ohm m/K', 1e-10, 6e-10, 'temperature coefficient of the resistivity'),
    ),
    kernel=lambda s, w, p: (
        s.J * ((RHO_A * (1.0 - s.x) + p.rho_M * s.x + p.b * (s.T - 298.0)) / (0.5 * (RHO_A + p.rho_M)) - 1.0)
    ),
)
TRUTH = simulated_truth(
    EFFECT,
    library='resistance_feedback',
    variables=('J', 'x', 'T'),
    listed=lambda p, of: {
        'r': (p['rho_M'] - RHO_A) / (0.5 * (RHO_A + p['rho_M'])),
        'a': p['b'] / (0.5 * (RHO_A + p['rho_M'])),
    },
)
