"""A rocker on a pivot: a wire on each side pulls its end down, a spring between the ends and the base returns it.

J dw/dt = -dl_1/dangle F_1 - dl_2/dangle F_2 - k a^2 sin(2 angle) - b w
"""

import math

from sma_sim import Coordinate, Parameter, Structure


def lengths(q, p):
    """From the foot of each wire, inside the arm by `offset`, to the end of the arm [m]."""
    along, up = p.a * math.cos(q.angle) - (p.a - p.offset), p.a * math.sin(q.angle)
    return math.hypot(along, p.h - up), math.hypot(along, p.h + up)


def forces(q, v, p):
    """Moments of both springs and of the pivot's damping [N m]."""
    return -p.k * p.a**2 * math.sin(2.0 * q.angle) - p.b * v.angle


STRUCTURE = Structure(
    name='rocker',
    title='rocker',
    coordinates=(Coordinate('angle', 'rad', 0.1, 'positive where wire 1 is shorter'),),
    wires=2,
    antagonistic=True,
    lengths=lengths,
    forces=forces,
    inertia=lambda p: p.J,
    parameters=(
        Parameter('a', 0.02, 'm', (1e-3, 1.0), 'half the length of the rocker'),
        Parameter('h', 0.1, 'm', (1e-3, 1.0), 'height of the pivot above the feet'),
        Parameter('offset', 2e-3, 'm', (0.0, 0.1), 'how far a foot stands inside'),
        Parameter('k', 50.0, 'N/m', (0.0, 1e5), 'stiffness of each spring'),
        Parameter('b', 1e-3, 'N m s/rad', (0.0, 1e3), 'damping of the pivot'),
        Parameter('J', 1e-5, 'kg m^2', (1e-12, 1.0), 'moment of inertia'),
    ),
    fitted=('rocker.k', 'rocker.b'),
    defaults={'wire.n': 1.0},
    source='measured with a ruler',
)
