"""Thermal expansion of the wires, which the phases differ in.

e = (a + da x_M)(T - T_ref)   [-]
Linear expansion of a mixture of phases: Lagoudas, Shape Memory Alloys (2008), 3.2. Martensite expands differently along its
crystal's axes, so that a wire whose martensite is oriented by stress may hardly expand, or shrink, along its length: Monroe
et al., Acta Mater. 102 (2016) 333 (15e-6 to -3e-6 1/K in one alloy). That da changes the transformation stresses by about
da (T - T_ref)/eps_T of themselves is left out.
"""

from sma_sim.model.effects.effect import Effect
from sma_sim.model.parameters import Parameter

EFFECT = Effect(
    name='thermal_expansion',
    title='thermal expansion of the wires',
    port='wire_strain',
    equation='e = (a + da x_M)(T - T_ref)',
    source='linear expansion; NiTi 6.6e-6 (martensite) to 11e-6 1/K (austenite), CuZnAl 16e-6 to 18e-6 1/K; oriented '
    'martensite: Monroe et al., Acta Mater. 102 (2016) 333',
    parameters=(
        Parameter('a', 11e-6, '1/K', (0.0, 1e-3), 'coefficient of austenite', neutral=0.0, realistic=(2e-6, 3e-5)),
        Parameter(
            'da',
            0.0,
            '1/K',
            (-1e-3, 1e-3),
            'coefficient of martensite less that of austenite',
            neutral=0.0,
            realistic=(-2e-5, 1e-5),
        ),
        Parameter('T_ref', 298.0, 'K', (1.0, 2000.0), 'temperature at which l0 was measured', realistic=(273.0, 330.0)),
    ),
    kernel=lambda s, w, p: (p.a + p.da * s.x) * (s.T - p.T_ref),
    straight=True,
    energy='does not enter: its heat, Om sigma a dT/dt, is below 1 % of the latent heat',
    description='works against the contraction of the transformation',
    signature='where nothing transforms a wire lengthens in proportion to its temperature, hot at another rate than cold',
    confused_with=('attachment_compliance', 'pretension_mismatch', 'functional_fatigue', 'r_phase_strain', 'wire.E_A'),
)
