"""Transformation strain that depends on the stress under which martensite forms.

H(sigma)/eps_T = 1 - deficit exp(-max(sigma - sigma_crit, 0)/k),   eps_T the strain at high stress (H_sat)
Memory: e = -eps_T m x_M with d(m x_M) = (1 - H(sigma)/eps_T) dx_M while martensite forms, dm = 0 while it turns back   [-]
Without stress, martensite variants form that cancel each other; stress selects those along it. What formed keeps its strain
until it turns back, all of it in the same proportion. The state is the share m that the martensite which is there lacks, not
e itself: austenite then has no e, where the integration of e would leave its error for ever. Wires that keep each other at
their transformation stresses are left out: what forms and what turns back then have different strains, between which their
modes switch back and forth.
"""

import math
from typing import Any

from sma_sim.model.effects.effect import Effect
from sma_sim.model.effects.ports import State
from sma_sim.model.parameters import Parameter, WireConstants

MIN_FRACTION = 1e-4  # of martensite, below which what forms is averaged with this much of what was there


def missing(sigma: float, p: Any) -> float:
    """1 - H(sigma)/eps_T [-]."""
    return float(p.deficit * math.exp(-max(sigma - p.sigma_crit, 0.0) / p.k))


def rate(s: State, w: WireConstants, p: Any, m: Any) -> float:
    """dm/dt [1/s]: what forms lacks `missing`, what turns back leaves the rest as it is."""
    return (missing(s.sigma, p) - m.m) * s.dx / max(s.x, MIN_FRACTION) if s.dx > 0.0 else 0.0


EFFECT = Effect(
    name='stress_dependent_transformation_strain',
    title='transformation strain that depends on stress',
    port='wire_strain',
    equation='H(sigma) = eps_T (1 - deficit exp(-max(sigma - sigma_crit, 0)/k)), kept by what formed until it turns back',
    source='Lagoudas et al., Int. J. Plast. 32-33 (2012) 155: H_cur, with H_sat = eps_T, H_min = (1 - deficit) eps_T',
    parameters=(
        Parameter(
            'deficit',
            0.9,
            '-',
            (0.0, 1.0),
            '1 - H_min/H_sat: share of eps_T missing without stress',
            neutral=0.0,
            realistic=(0.1, 1.0),
        ),
        Parameter('k', 1.2e8, 'Pa', (1e6, 1e10), 'stress over which the missing share falls to 37 %', realistic=(2e7, 5e8)),
        Parameter('sigma_crit', 0.0, 'Pa', (0.0, 1e9), 'stress below which nothing is gained', realistic=(0.0, 1.5e8)),
    ),
    systems=('wire', 'slider', 'coil'),
    states=('m',),
    scale=(1.0,),
    start=lambda s, w, p: missing(s.sigma, p),
    rate=rate,
    kernel=lambda s, w, p, m: -w.eps_T * m.m * s.x,
    energy='latent heat with eps_T; Om sigma de/dt is left out, up to `deficit` of the mechanical part of the latent heat',
    description='at the start, martensite is as if it had formed under the stress that it has',
    signature='less strain at low stress than at high stress between the same phases; plateaus start where they did',
    confused_with=('wire.eps_T',),
)
