"""Thermal expansion of the wires.

e = a (T - T_ref)   [-]
"""

from sma_sim.model.effects.effect import Effect
from sma_sim.model.parameters import Parameter

EFFECT = Effect(
    name='thermal_expansion',
    title='thermal expansion of the wires',
    port='wire_strain',
    equation='e = a (T - T_ref)',
    source='linear expansion; NiTi 6.6e-6 (martensite) to 11e-6 1/K (austenite), CuZnAl 16e-6 to 18e-6 1/K',
    parameters=(
        Parameter('a', 11e-6, '1/K', (0.0, 1e-3), 'coefficient of linear expansion', neutral=0.0, realistic=(2e-6, 3e-5)),
        Parameter('T_ref', 298.0, 'K', (1.0, 2000.0), 'temperature at which l0 was measured', realistic=(273.0, 330.0)),
    ),
    kernel=lambda s, w, p: p.a * (s.T - p.T_ref),
    straight=True,
    energy='does not enter: its heat, Om sigma a dT/dt, is below 1 % of the latent heat',
    description='works against the contraction of the transformation',
    signature='a hot wire is longer by a strain in proportion to its temperature, where nothing transforms too',
    confused_with=('attachment_compliance', 'pretension_mismatch', 'functional_fatigue', 'r_phase_strain', 'wire.E_A'),
)
