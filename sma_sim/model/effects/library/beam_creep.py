"""Viscoelastic beam or spring: a standard linear solid whose modulus relaxes from E to (1 - phi) E.

F = phi K z,   tau dz/dt = q - z,   K z the force of all springs of the structure at the coordinates z
"""

from sma_sim.model.effects.effect import Effect
from sma_sim.model.parameters import Parameter

EFFECT = Effect(
    name='beam_creep',
    title='creep of the beam',
    general_title='creep of the springs',
    port='structure_force',
    needs=('coordinate', 'stiffness'),
    equation='F = phi K z, tau dz/dt = q - z',
    source='Zener model: Findley, Lai and Onaran, Creep and Relaxation of Nonlinear Viscoelastic Materials, 5.7',
    parameters=(
        Parameter('phi', 0.15, '-', (0.0, 0.95), 'part of the stiffness that relaxes', neutral=0.0, realistic=(0.02, 0.5)),
        Parameter('tau', 20.0, 's', (1e-3, 1e6), 'relaxation time', realistic=(1.0, 1000.0)),
    ),
    states=('z',),
    scale=(1.0,),
    start=lambda s, b, p: s.q,
    rate=lambda s, b, p, m: (s.q - m.z) / p.tau,
    kernel=lambda s, b, p, m, stiffness: stiffness(m.z, b, p.phi),
    energy='the relaxing spring and its damper dissipate; nothing of it reaches the wires',
    description='all is relaxed at the start',
    signature='the pose creeps on after a step and back after it, while forces and temperatures hardly change',
    confused_with=('ambient_heating', 'beam.E', 'gravity'),
)
