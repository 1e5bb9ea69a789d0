"""A force on the plate, a moment on it, or a loss of beam stiffness, as a given function of time."""

from typing import Any

from sma_sim.evidence.estimation.injection_points import STIFFNESS
from sma_sim.evidence.latent_input.time_functions.time_function import knot_parameters, time_function
from sma_sim.model.effects.effect import Effect
from sma_sim.model.effects.ports import State
from sma_sim.model.parameters import BeamConstants
from sma_sim.model.structures.beam import stiffness_forces


def force(s: State, b: BeamConstants, p: Any) -> tuple[float, float, float]:
    """The force on one of the three coordinates, or along K q."""
    u = time_function(s.t, p)
    if p.wire == STIFFNESS:
        return stiffness_forces(s.U_x, s.U_y, s.alpha, b, u)
    return u if p.wire == 0.0 else 0.0, u if p.wire == 1.0 else 0.0, u if p.wire == 2.0 else 0.0


EFFECT = Effect(
    name='latent_force',
    port='structure_force',
    systems=('module',),
    equation='F = u(t) on one coordinate, or u(t) K q',
    source='a basis, not a law of nature',
    parameters=knot_parameters('N, N m, -'),
    kernel=force,
)
