"""Viscoelastic beam: a standard linear solid whose modulus relaxes from E to (1 - phi) E.

F = phi K z,   tau dz/dt = q - z,   K the beam's stiffness matrix, q = (U_x, U_y, alpha)
"""

from sma_sim.model.effects.effect import Effect
from sma_sim.model.parameters import Parameter
from sma_sim.model.structures.beam import stiffness_forces

EFFECT = Effect(
    name='beam_creep',
    title='creep of the beam',
    port='structure_force',
    systems=('module',),
    equation='F = phi K z, tau dz/dt = q - z',
    source='Zener model: Findley, Lai and Onaran, Creep and Relaxation of Nonlinear Viscoelastic Materials, 5.7',
    parameters=(
        Parameter('phi', 0.15, '-', (0.0, 0.95), 'part of the stiffness that relaxes', '', 0.0, (0.02, 0.5)),
        Parameter('tau', 20.0, 's', (1e-3, 1e6), 'relaxation time', '', None, (1.0, 1000.0)),
    ),
    states=('z_x', 'z_y', 'z_alpha'),
    scale=(1e-4, 1e-3, 0.15),
    start=lambda s, b, p: (s.U_x, s.U_y, s.alpha),
    rate=lambda s, b, p, m: ((s.U_x - m.z_x) / p.tau, (s.U_y - m.z_y) / p.tau, (s.alpha - m.z_alpha) / p.tau),
    kernel=lambda s, b, p, m: stiffness_forces(m.z_x, m.z_y, m.z_alpha, b, p.phi),
    energy='the relaxing spring and its damper dissipate; nothing of it reaches the wires',
    description='the beam is relaxed at the start',
    signature='the pose creeps on after a step and back after it, while forces and temperatures hardly change',
    confused_with=('ambient_heating', 'beam.E', 'gravity'),
)
