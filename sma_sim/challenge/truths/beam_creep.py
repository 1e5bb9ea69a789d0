"""A beam that creeps: under a constant force the pose grows by the factor 1 + c, in the time tau_c.

Standard linear solid in the forces of its dashpot: the branch that relaxes holds c/(1 + c) of the stiffness and forgets with
tau = tau_c/(1 + c). f' = (c/(1 + c) K q - f)/tau, F = f   [N, N, N m]
"""

from typing import Any

from sma_sim.challenge.truth import drawn_parameter, simulated_truth
from sma_sim.model.effects.effect import Effect
from sma_sim.model.effects.ports import State
from sma_sim.model.parameters import BeamConstants
from sma_sim.model.structures.beam import stiffness_forces


def branch(s: State, b: BeamConstants, p: Any) -> tuple[float, float, float]:
    """Force of the branch once it has relaxed."""
    return stiffness_forces(s.U_x, s.U_y, s.alpha, b, p.c / (1.0 + p.c))


def forget(s: State, b: BeamConstants, p: Any, m: Any) -> tuple[float, float, float]:
    """The force goes to that of the pose."""
    pace = (1.0 + p.c) / p.tau_c
    x, y, alpha = branch(s, b, p)
    return pace * (x - m.f_x), pace * (y - m.f_y), pace * (alpha - m.f_alpha)


EFFECT = Effect(
    name='truth_beam_creep',
    port='structure_force',
    equation="f' = (c/(1 + c) K q - f) (1 + c)/tau_c; F = f",
    source='creep compliance of the standard linear solid (Ferry, Viscoelastic Properties of Polymers)',
    parameters=(
        drawn_parameter('c', '-', 0.03, 0.4, 'final creep over the elastic deformation'),
        drawn_parameter('tau_c', 's', 4.0, 60.0, 'retardation time'),
    ),
    states=('f_x', 'f_y', 'f_alpha'),
    scale=(1.0, 1.0, 0.1),
    start=lambda s, b, p: branch(s, b, p),
    rate=forget,
    kernel=lambda s, b, p, m: (m.f_x, m.f_y, m.f_alpha),
)
TRUTH = simulated_truth(
    EFFECT,
    library='beam_creep',
    variables=('U_x', 'U_y', 'alpha', 'memory'),
    listed=lambda p, of: {'phi': p['c'] / (1.0 + p['c']), 'tau': p['tau_c'] / (1.0 + p['c'])},
)
