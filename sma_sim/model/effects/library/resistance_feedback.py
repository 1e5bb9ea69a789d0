"""Heating by a current source: the heat follows the resistance of the wire.

J_out = J R/R_0,   R/R_0 = (1 + r (x_M - 1/2)) (1 + a (T - T0))   [W]; the command J is I^2 R_0
"""

from sma_sim.model.effects.effect import Effect
from sma_sim.model.parameters import Parameter

EFFECT = Effect(
    name='resistance_feedback',
    title='heating that changes with the resistance of the wires',
    port='actuation',
    stage='gain',
    equation='J_out = J (1 + r (x_M - 1/2)) (1 + a (T - T0))',
    source="Joule's law; the resistivities of the phases by a rule of mixtures (Lagoudas, Shape Memory Alloys)",
    parameters=(
        Parameter(
            'r', 0.2, '-', (-1.0, 1.0), 'resistance of martensite over austenite, less 1', neutral=0.0, realistic=(-0.3, 0.4)
        ),
        Parameter(
            'a', 5e-4, '1/K', (-1e-3, 3e-3), 'growth of resistance with temperature', neutral=0.0, realistic=(-2e-4, 1.5e-3)
        ),
    ),
    kernel=lambda s, w, p: s.J * (1.0 + p.r * (s.x - 0.5)) * (1.0 + p.a * (s.T - w.T0)),
    energy='the driver delivers what the wire takes; the balance of the wire is that of its true heating',
    description='R_0 is the resistance at T0 with half of the wire martensite: other choices are a common power gain',
    signature='heating by the same command weakens (r > 0) while the wire turns to austenite; nothing during cooling',
    confused_with=('wire.lambda', 'natural_convection', 'driver_saturation'),
)
