"""The air in the housing of a bundle keeps part of the bundle's heat.

C dtheta/dt = n lambda A_s (T - T_E - theta) - G theta,   Q = lambda A_s theta   [W]
"""

from sma_sim.challenge.truth import drawn_parameter, simulated_truth
from sma_sim.model.effects.effect import Effect

EFFECT = Effect(
    name='truth_ambient_heating',
    port='wire_heat',
    equation='C dtheta/dt = n lambda A_s (T - T_E - theta) - G theta; Q = lambda A_s theta',
    source='heat balance of the air in a housing with leaking walls',
    parameters=(
        drawn_parameter('G', 'W/K', 0.5, 5.0, 'conductance from the air of the housing to the room'),
        drawn_parameter('C', 'J/K', 25.0, 250.0, 'heat capacity of the air and of what it touches'),
    ),
    states=('theta',),
    scale=(10.0,),
    rate=lambda s, w, p, m: ((w.n * w.lambda_ * w.surface * (s.T - s.T_E - m.theta) - p.G * m.theta) / p.C,),
    kernel=lambda s, w, p, m: w.lambda_ * w.surface * m.theta,
)
TRUTH = simulated_truth(
    EFFECT,
    library='ambient_heating',
    variables=('T', 'memory'),
    listed=lambda p, of: {'R': 1.0 / p['G'], 'tau': p['C'] / p['G']},
)
