"""A beam whose bending shortens it, as all do: bending and axial force are coupled.

Energy k_x (U_x + c g)^2/2 in place of k_x U_x^2/2, with the foreshortening of a cubic beam element
g = (6 U_y^2/(5 L) - U_y alpha/5 + 2 L alpha^2/15)/2; forces are its negative derivatives   [N, N, N m]
"""

from typing import Any

from sma_sim.challenge.truth import drawn_parameter, simulated_truth
from sma_sim.model.effects.effect import Effect
from sma_sim.model.effects.ports import State
from sma_sim.model.parameters import BeamConstants


def added_force(s: State, b: BeamConstants, p: Any) -> tuple[float, float, float]:
    """What the coupling adds to the linear beam."""
    by_y = 1.2 * s.U_y / b.L - 0.1 * s.alpha
    by_alpha = -0.1 * s.U_y + 2.0 * b.L / 15.0 * s.alpha
    shortening = 0.5 * p.c * (by_y * s.U_y + by_alpha * s.alpha)
    tension = b.k_x * (s.U_x + shortening)
    return -b.k_x * shortening, -p.c * tension * by_y, -p.c * tension * by_alpha


EFFECT = Effect(
    name='truth_beam_nonlinearity',
    port='structure_force',
    equation='E = k_x (U_x + c g)^2/2, g = (6 U_y^2/(5 L) - U_y alpha/5 + 2 L alpha^2/15)/2',
    source='von Karman beam, consistent geometric stiffness (Przemieniecki, Theory of Matrix Structural Analysis, 15)',
    parameters=(drawn_parameter('c', '-', 0.1, 1.0, 'part of the foreshortening that the support does not take up'),),
    kernel=added_force,
)
TRUTH = simulated_truth(
    EFFECT, library='beam_nonlinearity', variables=('U_x', 'U_y', 'alpha'), listed=lambda p, of: {'b': 0.0, 'c': p['c']}
)
