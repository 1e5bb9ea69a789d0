"""Transformation-induced plasticity: each transformation under stress leaves some strain, a ratchet from cycle to cycle.

de/dt = c max(sigma, 0) |dx_M/dt|/(1 + z/z_p),   dz/dt = |dx_M/dt|;   at constant stress e = c sigma z_p ln(1 + z/z_p)
Slip accommodates the shape of martensite plates and follows the stress; the material hardens, so that a cycle leaves less
the more there were before, but never nothing.
"""

from typing import Any

from sma_sim.model.effects.effect import Effect
from sma_sim.model.effects.ports import State
from sma_sim.model.parameters import Parameter, WireConstants


def rates(s: State, w: WireConstants, p: Any, m: Any) -> tuple[float, float]:
    """Of plastic strain and of all transformation so far [1/s]."""
    moved = abs(s.dx)
    return p.c * max(s.sigma, 0.0) * moved / (1.0 + m.z / p.z_p), moved


EFFECT = Effect(
    name='transformation_plasticity',
    title='plastic strain that transformation under stress leaves',
    port='wire_strain',
    equation='de/dt = c sigma |dx_M/dt|/(1 + z/z_p), dz/dt = |dx_M/dt|',
    source='Lagoudas and Entchev, Mech. Mater. 36 (2004) 865: transformation-induced plasticity, logarithmic in all '
    'transformation so far; in proportion to stress: Greenwood and Johnson, Proc. R. Soc. A 283 (1965) 403',
    parameters=(
        Parameter(
            'c',
            5e-12,
            '1/Pa',
            (0.0, 1e-9),
            'strain per stress and transformation of a fresh wire',
            neutral=0.0,
            realistic=(1e-13, 2e-11),
        ),
        Parameter(
            'z_p', 5.0, '-', (1e-2, 1e6), 'transformation after which it leaves half as much', realistic=(1.0, 1000.0)
        ),
    ),
    tried='single wire',
    states=('e', 'z'),
    scale=(0.01, 1.0),
    rate=rates,
    kernel=lambda s, w, p, m: m.e,
    energy='Om sigma de/dt is dissipated; its heat is left out, below c sigma/eps_T of the work of transformation',
    description='counts from the start of each run: a wire that is trained already has a large z_p and a small c',
    signature='strain that does not come back and grows from cycle to cycle, more under high stress; plateaus stay',
    confused_with=('functional_fatigue',),
)
