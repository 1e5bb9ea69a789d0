"""What is thought of models before data are seen: which components they have, and which values these have."""

from __future__ import annotations

from math import log, log1p, pi

import numpy as np

from sma_sim.evidence.estimation.free_parameters import declared_parameters
from sma_sim.evidence.estimation.plausibility import realistic_range
from sma_sim.evidence.estimation.problem import Problem
from sma_sim.model.arrays import Vector

SPARSITY = 3.0
"""Minus the log prior probability of any one component, beside that of which one it is: a model as it is used in practice
lacks nothing that shows with a probability of about 95 %. It is the one constant that decides between a simple model and a
rich one; benchmarks/calibration.py shows what it does."""
UNLISTED = 2.0
"""Further nats against what no list has: of what has been found missing in such robots, most is known by name."""
TAIL = 0.1  # of a realistic range: literature is not sharper, and robots differ
EVEN_PRECISION = 1e-6  # of a normal prior that stands for an even one: its bounds are a thousandth of its width apart
NO_ZEROS = 10  # beside one zero: several, ambient, motion before, late or rounded commands, 3 parameters, unpowered sides


def effect_log_prior(effects: int, forms: int = 1) -> float:
    """Of one of so many listed effects, in one of so many scopes or forms that share what it has."""
    return -SPARSITY - log(effects) - log(max(1, forms))


def formula_log_prior(terms: int, locations: int) -> float:
    """Of one term of an equation, among those of its place and all places."""
    return -SPARSITY - UNLISTED - log(max(1, terms)) - log(max(1, locations))


def difference_log_prior(channels: int, of_several: bool) -> float:
    """Of what differs between recordings, among all kinds of it: zeros of one of so many channels or of any several, which
    drift or do not, ambient temperature, late commands, rounded ones, power of a side."""
    return -SPARSITY - log(2 * channels + NO_ZEROS) - (channels * log(2.0) if of_several else 0.0)


def prior_of_values(problem: Problem, z: Vector) -> tuple[Vector, Vector, Vector, float]:
    """The prior of all unknowns about z: bounds (n,), precision of the normal prior (n,), and the log density there of those
    whose prior is even, over that of a standard normal one in its middle.

    Values of effects are as probable all over what literature calls realistic, with heavy tails beyond, so that others
    cost nats and are not forbidden: with W the width of the range in z, d the distance beyond it and w = TAIL W the density
    is (1 + d/w)^-2/(W (1 + 2 TAIL)). About a z in the range it is taken to be even as far as w beyond.
    """
    declared, (low, high) = declared_parameters(problem.config), problem.limits()
    precision, log_density = np.ones(len(z)), 0.0
    for j, (free, at) in enumerate(zip(problem.free, z.tolist(), strict=False)):
        between = realistic_range(declared[free.name])
        if between is None or not free.name.startswith('effects.'):
            continue
        first, last = (free.coordinate(value) if value > 0.0 or not free.log else free.low for value in between)
        tail = TAIL * (last - first)
        precision[j] = EVEN_PRECISION
        log_density += 0.5 * log(2.0 * pi) - log(last - first + 2.0 * tail)
        log_density -= 2.0 * log1p(max(first - at, at - last, 0.0) / tail)
        if first - tail <= at <= last + tail:
            low[j], high[j] = max(low[j], first - tail), min(high[j], last + tail)
    return low, high, precision, log_density
