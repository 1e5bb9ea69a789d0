"""Spring whose stiffness changes with how far it is from its zero: stiffer (c > 0) or softer.

F = -c k q^3,   k the linear stiffness of the coordinate q; energy c k q^4/4
"""

from sma_sim.model.effects.effect import Effect
from sma_sim.model.parameters import Parameter

EFFECT = Effect(
    name='cubic_stiffness',
    title='a nonlinear stiffness of the spring',
    port='structure_force',
    needs=('spring',),
    equation='F = -c k q^3',
    source='Duffing spring: Nayfeh and Mook, Nonlinear Oscillations, 4.1',
    parameters=(
        Parameter(
            'c',
            1.0,
            '1/rad^2',
            (-5.0, 1e3),
            'stiffness grows by 1 + 3 c q^2: above 0 stiffer',
            neutral=0.0,
            realistic=(-0.5, 20.0),
            quantity='1/change^2',
        ),
    ),
    kernel=lambda s, b, p: -p.c * s.k * s.q**3,
    energy='elastic: the force of a potential, none is lost',
    description='about the zero of the coordinate; a beam has beam_nonlinearity',
    signature='large strokes fall short of (c > 0) or exceed the model, small ones agree; no hysteresis',
    confused_with=('wire.sigma_T', 'wire.eps_T'),
)
