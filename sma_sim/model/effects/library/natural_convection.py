"""Heat lost to the air by buoyancy, which grows faster than the temperature difference.

Q = -k A_s |T - T_E|^m (T - T_E)   [W]        laminar free convection from a cylinder, Nu ~ Ra^m
"""

from sma_sim.model.effects.effect import Effect
from sma_sim.model.parameters import Parameter

EFFECT = Effect(
    name='natural_convection',
    title='heat lost by natural convection',
    port='wire_heat',
    equation='Q = -k A_s |T - T_E|^m (T - T_E)',
    source='Morgan, Advances in Heat Transfer 11 (1975); Incropera, Fundamentals of Heat and Mass Transfer, 9.6',
    parameters=(
        Parameter(
            'k',
            40.0,
            'W/(m^2 K^(1+m))',
            (0.0, 1e4),
            'coefficient; larger for thinner wires',
            neutral=0.0,
            realistic=(5.0, 300.0),
        ),
        Parameter('m', 0.25, '-', (0.0, 1.0), '1/4 laminar, less for thin wires, 0 in a draught', realistic=(0.0, 0.34)),
    ),
    kernel=lambda s, w, p: -p.k * w.surface * abs(s.T - s.T_E) ** p.m * (s.T - s.T_E),
    energy='heat to the air, cools a wire above T_E always',
    description='free convection on top of the constant lambda',
    signature='cooling is faster when hot; the time to cool depends on how hot the wire was',
    confused_with=(
        'wire.lambda',
        'radiation',
        'thermal_crosstalk',
        'resistance_feedback',
        'polycrystal',
        'driver_deadband',
        'driver_saturation',
    ),
)
