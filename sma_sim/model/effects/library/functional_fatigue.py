"""Functional fatigue: with all transformation so far strain stays behind, the plateaus sink, and both saturate.

dz/dt = |dx_M/dt|,   f = 1 - exp(-z/z_r),   e = eps_r f [-],   s_A = s_M = -sigma_r f [Pa]        z: 2 for a full cycle
"""

import math
from typing import Any

from sma_sim.model.effects.effect import Effect
from sma_sim.model.effects.ports import State
from sma_sim.model.parameters import Parameter, WireConstants


def left_behind(s: State, w: WireConstants, p: Any, m: Any) -> tuple[float, float, float]:
    """Strain, and shifts of sigma_A and sigma_M [Pa]."""
    part = 1.0 - math.exp(-m.z / p.z_r)
    return p.eps_r * part, -p.sigma_r * part, -p.sigma_r * part


EFFECT = Effect(
    name='functional_fatigue',
    title='functional fatigue of the wires',
    port='wire_strain',
    equation='e = eps_r f, s_A = s_M = -sigma_r f, f = 1 - exp(-z/z_r), dz/dt = |dx_M/dt|',
    source='Eggeler et al., Mater. Sci. Eng. A 378 (2004) 24; saturation: Lagoudas, Shape Memory Alloys',
    parameters=(
        Parameter('eps_r', 3e-3, '-', (0.0, 0.1), 'strain that stays behind in the end', neutral=0.0, realistic=(0.0, 0.02)),
        Parameter(
            'sigma_r',
            5e6,
            'Pa',
            (0.0, 1e10),
            'fall of both transformation stresses in the end',
            neutral=0.0,
            realistic=(0.0, 8e7),
        ),
        Parameter('z_r', 5.0, '-', (1e-2, 1e6), 'transformation after which 63 % of it is there', realistic=(1.0, 1000.0)),
    ),
    states=('z',),
    scale=(1.0,),
    rate=lambda s, w, p, m: abs(s.dx),
    kernel=left_behind,
    energy='latent heat at the shifted stress; Om sigma de/dt is left out, below eps_r/(z_r eps_T) of it',
    description='counts from the start of each run: a wire that is trained already has small eps_r and sigma_r',
    signature='drift from cycle to cycle that stops when nothing transforms; the strain is hidden on the plateaus',
    confused_with=(
        'wire.sigma_MW0',
        'ambient_heating',
        'pretension_mismatch',
        'attachment_compliance',
        'thermal_expansion',
        'transformation_plasticity',
        'ambient_drift',
        'clamp_slip',
    ),
)
