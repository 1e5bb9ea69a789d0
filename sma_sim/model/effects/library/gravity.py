"""Weight, on a structure whose own equations leave it out.

F = m_H g   [N] for the plate of a beam, g = (g_x, g_y, g_z) in the frame of its foot; the beam's own mass is neglected.
"""

from sma_sim.model.effects.effect import Effect
from sma_sim.model.parameters import Parameter

EFFECT = Effect(
    name='gravity',
    title='gravity',
    port='structure_force',
    needs=('gravity',),
    equation='F = m_H g, g = (g_x, g_y) or (g_x, g_y, g_z)',
    source="Newton's law; the paper neglects it",
    parameters=(
        Parameter('g_y', -9.81, 'm/s^2', (-50.0, 50.0), 'gravity across the beam', neutral=0.0, realistic=(-9.81, 9.81)),
        Parameter('g_x', 0.0, 'm/s^2', (-50.0, 50.0), 'gravity along the beam', neutral=0.0, realistic=(-9.81, 9.81)),
    ),
    in_space=(Parameter('g_z', 0.0, 'm/s^2', (-50.0, 50.0), 'gravity along z', neutral=0.0, realistic=(-9.81, 9.81)),),
    kernel=lambda s, b, p, gravity: gravity(s.q, b, p.g_x, p.g_y, p.g_z),
    energy='the force of a potential, none is lost',
    description='the same force at every angle; g_z where a structure moves along z',
    signature='bent to one side at rest; the same offset of force in all poses',
    confused_with=('sensor_bias', 'power_gain_mismatch', 'beam_creep'),
)
