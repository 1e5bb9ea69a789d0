"""Heat that bundles exchange with each other through the air between them.

Q = G l0 sum (T_other - T)   [W] per wire, over all other bundles: what one loses the others gain
"""

from sma_sim.model.effects.effect import Effect
from sma_sim.model.parameters import Parameter

EFFECT = Effect(
    name='thermal_crosstalk',
    title='heat exchanged between the bundles',
    port='wire_heat',
    equation='Q = G l0 sum (T_other - T)',
    source='conduction between parallel cylinders: Incropera, Fundamentals of Heat and Mass Transfer, table 4.1',
    parameters=(
        Parameter(
            'G',
            0.03,
            'W/(m K)',
            (0.0, 10.0),
            'conductance from wire to wire per length; still air 10 mm wide 0.02',
            neutral=0.0,
            realistic=(5e-3, 0.2),
        ),
    ),
    kernel=lambda s, w, p: p.G * w.l0 * s.others * (s.T_other - s.T),
    wires=2,
    energy='heat from the hotter to the colder bundle; their sum is unchanged',
    description='quasi-steady: the air between the bundles stores nothing; every two exchange heat alike',
    signature='the unpowered wire warms while the other is hot: less stroke, more at long heating',
    confused_with=('wire.sigma_T', 'plate.W', 'natural_convection', 'radiation', 'polycrystal', 'r_phase'),
)
