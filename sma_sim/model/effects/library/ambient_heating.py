"""Air around a bundle that warms up with the heat it takes.

tau dTheta/dt = R n lambda A_s (T - T_E - Theta) - Theta,   Q = lambda A_s Theta   [W]      one thermal node
"""

from sma_sim.model.effects.effect import Effect
from sma_sim.model.parameters import Parameter

EFFECT = Effect(
    name='ambient_heating',
    title='warming of the air around the wires',
    port='wire_heat',
    equation='tau dTheta/dt = R n lambda A_s (T - T_E - Theta) - Theta; Q = lambda A_s Theta',
    source='lumped capacitance: Incropera, Fundamentals of Heat and Mass Transfer, 5.1',
    parameters=(
        Parameter(
            'R',
            0.5,
            'K/W',
            (0.0, 100.0),
            'thermal resistance from the air at the bundle to the room',
            neutral=0.0,
            realistic=(0.05, 3.0),
        ),
        Parameter('tau', 60.0, 's', (1e-2, 1e5), 'time constant of the air', realistic=(5.0, 600.0)),
    ),
    states=('Theta',),
    scale=(10.0,),
    rate=lambda s, w, p, m: (p.R * w.n * w.lambda_ * w.surface * (s.T - s.T_E - m.Theta) - m.Theta) / p.tau,
    kernel=lambda s, w, p, m: w.lambda_ * w.surface * m.Theta,
    energy='heat that the wire gave to the air and that the air gives back in part',
    description='one thermal node of air per bundle, at T_E at the start',
    signature='slow drift of all that depends on temperature, up under heating and back after it',
    confused_with=('environment.T_E', 'wire.sigma_MW0', 'beam_creep', 'functional_fatigue', 'ambient_drift'),
)
