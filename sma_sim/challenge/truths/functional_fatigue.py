"""Wires that tire: every transformation leaves some strain behind and lowers the plateaus, less each time.

z' = |dx_M/dt| (1 - z)/N;   e = e_inf z   [-];   shift of both transformation stresses = -s_inf z   [Pa]
"""

from typing import Any

from sma_sim.challenge.truth import drawn_parameter, simulated_truth
from sma_sim.model.effects.effect import Effect
from sma_sim.model.effects.ports import State
from sma_sim.model.parameters import WireConstants

SOURCE = 'residual strain and plateau stress over cycles saturate exponentially (NiTi, first hundred cycles)'
TRANSFORMATIONS = drawn_parameter('N', '-', 1.0, 5.0, 'full transformations, in either direction, in which it saturates')


def tire(s: State, w: WireConstants, p: Any, m: Any) -> tuple[float]:
    """Rate of the part of the fatigue that has come."""
    return (abs(s.dx) * (1.0 - m.z) / p.N,)


EFFECT = Effect(
    name='truth_functional_fatigue',
    port='wire_strain',
    equation="z' = |dx_M/dt| (1 - z)/N; e = e_inf z",
    source=SOURCE,
    parameters=(drawn_parameter('e_inf', '-', 3e-4, 6e-3, 'strain that stays in the end'), TRANSFORMATIONS),
    states=('z',),
    scale=(1.0,),
    rate=tire,
    kernel=lambda s, w, p, m: p.e_inf * m.z,
    energy='does not enter',
)
PLATEAUS = Effect(
    name='truth_fatigue_of_plateaus',
    port='transformation_stress',
    equation="z' = |dx_M/dt| (1 - z)/N; shift = -s_inf z",
    source=SOURCE,
    parameters=(drawn_parameter('s_inf', 'Pa', 1e6, 1e7, 'loss of the transformation stresses in the end'), TRANSFORMATIONS),
    states=('z',),
    scale=(1.0,),
    rate=tire,
    kernel=lambda s, w, p, m: (-p.s_inf * m.z, -p.s_inf * m.z),
    energy='does not enter',
)
TRUTH = simulated_truth(
    EFFECT,
    PLATEAUS,
    library='functional_fatigue',
    variables=('dx', 'memory'),
    listed=lambda p, of: {'eps_r': p['e_inf'], 'sigma_r': p['s_inf'], 'z_r': p['N']},
)
