"""A peak of stress where bands nucleate: the first of a phase costs more than bands that spread.

s_A = peak_A exp(-x/x_n),   s_M = -peak_M exp(-(1 - x)/x_n)   [Pa], x = x_M
After the first band has formed it spreads at the plateau. A stress that fell faster than a wire at constant strain unloads,
(eps_T + d sigma) E per fraction, would snap, which inertia decides: x_n is at least what halves that rate.
"""

import math
from typing import Any

from sma_sim.model.effects.effect import Effect
from sma_sim.model.parameters import Parameter, WireConstants

STEEPEST = 0.5  # of the rate at which a wire at constant strain unloads


def decaying(peak: float, x: float, w: WireConstants, p: Any) -> float:
    """What is left of a peak [Pa] when the part x of the new phase is there."""
    width = max(p.x_n, peak / (STEEPEST * w.eps_T * min(w.E_A, w.E_M)))
    return float(peak * math.exp(-max(x, 0.0) / width))


EFFECT = Effect(
    name='nucleation_peak',
    title='the peak of stress where transformation bands nucleate',
    port='transformation_stress',
    equation='s_A = peak_A exp(-x/x_n), s_M = -peak_M exp(-(1 - x)/x_n)',
    source='Shaw and Kyriakides, Acta Mater. 45 (1997) 683: nucleation and propagation stresses of NiTi; exponential here',
    parameters=(
        Parameter(
            'peak_A',
            2e7,
            'Pa',
            (0.0, 1e10),
            'stress above the plateau to begin martensite',
            neutral=0.0,
            realistic=(3e6, 1.5e8),
        ),
        Parameter(
            'peak_M',
            1e7,
            'Pa',
            (0.0, 1e10),
            'stress below the plateau to begin austenite',
            neutral=0.0,
            realistic=(3e6, 1e8),
        ),
        Parameter('x_n', 0.05, '-', (1e-3, 1.0), 'fraction after which 37 % of a peak is left', realistic=(0.01, 0.15)),
    ),
    tried='single wire',
    kernel=lambda s, w, p: (decaying(p.peak_A, s.x, w, p), -decaying(p.peak_M, 1.0 - s.x, w, p)),
    energy='latent heat at the shifted stress: first law with U unchanged; energy of the bands\' surfaces is left out',
    description='a wire that still holds some of a phase needs no new nuclei of it: inner loops have no peak',
    signature='an overshoot where a plateau begins in a wire of one phase, none where it turns back half way',
    confused_with=('smooth_transformation', 'wire.dsigma'),
)
