"""A cable harness that is led over the joint: a spring and a damper that turn the plate back.

M = -k (alpha - alpha_0) - c dalpha/dt   [N m]
"""

from sma_sim import Effect, Parameter

EFFECT = Effect(
    name='harness',
    port='structure_force',
    equation='M = -k (alpha - alpha_0) - c dalpha/dt',
    source='a torsion spring with viscous damping; k from hanging known weights on the harness',
    parameters=(
        Parameter('k', 0.2, 'N m/rad', (0.0, 100.0), 'stiffness of the harness', neutral=0.0, realistic=(0.01, 2.0)),
        Parameter('alpha_0', 0.0, 'rad', (-1.5, 1.5), 'angle at which the harness is relaxed', realistic=(-0.3, 0.3)),
        Parameter('c', 0.0, 'N m s/rad', (0.0, 100.0), 'damping of the harness', neutral=0.0, realistic=(0.0, 1.0)),
    ),
    kernel=lambda s, b, p: (0.0, 0.0, -p.k * (s.alpha - p.alpha_0) - p.c * s.dalpha),
    description='smaller angles than modelled, the same at every temperature; confused with a stiffer beam',
)
