"""Friction in the guides, with stiction: the guide holds back a part mu of the force, fully after the distance d.

d dz/dt = v - |v| z,   F_added = mu z F   [N]
"""

from sma_sim.challenge.truth import acting, ranged
from sma_sim.model.effects.effect import Effect

EFFECT = Effect(
    name='truth_guide_friction',
    port='wire_force',
    equation='d dz/dt = v - |v| z; F_added = mu z F',
    source="Coulomb's law with a presliding distance (Dahl)",
    parameters=(
        ranged('mu', '-', 0.01, 0.15, 'part of the force that friction takes'),
        ranged('d', 'm', 2e-6, 2e-5, 'distance over which friction turns'),
    ),
    states=('z',),
    scale=(1.0,),
    rate=lambda s, w, p, m: ((s.v - abs(s.v) * m.z) / p.d,),
    kernel=lambda s, w, p, m: p.mu * m.z * s.F,
)
TRUTHS = (acting(EFFECT, library='guide_friction', variables=('v', 'F', 'memory'), file=__file__),)
