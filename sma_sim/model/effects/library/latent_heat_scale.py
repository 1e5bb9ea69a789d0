"""Latent heat that differs from the one that the slope sigma_T asks for.

Q = (k - 1) L_x dx_M/dt   [W], L_x the latent heat of the single crystal (L3a); so k L_x in all
"""

from sma_sim.model.effects.effect import Effect
from sma_sim.model.material import latent_heat
from sma_sim.model.parameters import Parameter

EFFECT = Effect(
    name='latent_heat_scale',
    title='a different latent heat of transformation',
    port='wire_heat',
    equation='Q = (k - 1) L_x dx_M/dt',
    source='calorimetry against the Clausius-Clapeyron relation: Otsuka and Wayman, Shape Memory Materials',
    parameters=(
        Parameter('k', 1.3, '-', (0.0, 10.0), 'latent heat over that of the model', neutral=1.0, realistic=(0.5, 2.0)),
    ),
    kernel=lambda s, w, p: (p.k - 1.0) * latent_heat(s.T, s.sigma, w) * s.dx,
    energy='(k - 1) L_x dx_M/dt is exchanged with a store that U leaves out; nil over a loop where L_x is constant',
    description='a polycrystal transforms in part, with more or less heat than its slope sigma_T says',
    signature='transformation takes more time (k > 1) or less when heat is scarce; nothing at rest',
    confused_with=('wire.c_V', 'driver_lag', 'sensor_lag', 'guide_friction', 'power_scale', 'heat_capacity_difference'),
    same_as='a power gain 1/k that all wires have in common, with c_V and lambda times 1/k',
)
