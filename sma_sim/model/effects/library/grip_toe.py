"""Toe of a tensile test: grips and slack bends settle at low force, before the wire itself is stretched.

e = toe sigma/(sigma + sigma_t)   [-], nil in compression; sigma depends on e in turn (`material.saturating_strain`)
"""

from sma_sim.model.effects.effect import Effect
from sma_sim.model.material import compliance, saturating_strain
from sma_sim.model.parameters import Parameter

EFFECT = Effect(
    name='grip_toe',
    title='the toe of the grips',
    port='wire_strain',
    stage='series',
    equation='e = toe sigma/(sigma + sigma_t)',
    source='toe compensation of tensile tests: ASTM D638, annex A1; a hyperbola here',
    parameters=(
        Parameter(
            'toe', 1e-3, '-', (0.0, 0.05), 'strain that the grips take in the end', neutral=0.0, realistic=(1e-4, 5e-3)
        ),
        Parameter('sigma_t', 5e6, 'Pa', (1e4, 1e10), 'stress at which they have taken half of it', realistic=(1e6, 5e7)),
    ),
    tried='never',
    systems=('wire', 'slider'),
    kernel=lambda s, w, p: saturating_strain(s.eps - s.strain - w.eps_T * s.x, p.toe, p.sigma_t, compliance(s.x, w)),
    straight=True,
    energy='elastic: the grips store Om times the integral of sigma de, which is not in U of the wire',
    description='of the bench, not of the wire: no finding of a diagnosis, but part of its model where it is switched on',
    signature='the first part of each pull is soft and bends upwards; beyond it curves are shifted by a constant strain',
    confused_with=('attachment_compliance', 'pretension_mismatch'),
)
