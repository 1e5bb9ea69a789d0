"""Heat radiated by the surface of the wire.

Q = -emissivity sigma_SB A_s (T^4 - T_E^4)   [W]        Stefan-Boltzmann law, surroundings at T_E
"""

from sma_sim.model.effects.effect import Effect
from sma_sim.model.parameters import Parameter

SIGMA_SB = 5.670374419e-8  # [W/(m^2 K^4)], exact to these digits by definition of the SI

EFFECT = Effect(
    name='radiation',
    title='heat lost by radiation',
    port='wire_heat',
    equation='Q = -emissivity sigma_SB A_s (T^4 - T_E^4)',
    source='Stefan-Boltzmann law: Incropera, Fundamentals of Heat and Mass Transfer, 1.2.3; a grey wire in a large room',
    parameters=(
        Parameter(
            'emissivity',
            0.7,
            '-',
            (0.0, 1.0),
            'of the surface: 0.1 polished, 0.9 oxidised',
            neutral=0.0,
            realistic=(0.05, 0.95),
        ),
    ),
    kernel=lambda s, w, p: -p.emissivity * SIGMA_SB * w.surface * (s.T**4 - s.T_E**4),
    energy='heat to the room, cools a wire above T_E always',
    description='one or two per cent of the convection of thin wires',
    signature='a hot wire cools a little faster; the share grows with about T^3',
    confused_with=('wire.lambda', 'natural_convection', 'thermal_crosstalk'),
)
