"""The hybrid automaton of one wire: five modes, eight edges (paper, section III.C, with errata).

| mode | meaning                 | x_M                          | flows while                   |
|------|-------------------------|------------------------------|-------------------------------|
| 1    | austenite               | 0                            | sigma <= sigma_A              |
| 2    | martensite              | 1                            | sigma >= sigma_M              |
| 3    | inside the hysteresis   | frozen                       | sigma_M <= sigma <= sigma_A   |
| 4    | austenite to martensite | such that sigma = sigma_A(T) | x_M <= 1 and dx_M/dt >= 0     |
| 5    | martensite to austenite | such that sigma = sigma_M(T) | x_M >= 0 and dx_M/dt <= 0     |

The paper writes the guards of modes 1 to 3 in fractions: `x^(4) > x_M` there is `sigma > sigma_A` here, since
stress falls with x_M. (C_3 is printed there with its bounds exchanged, which makes it empty.) A jump is taken
only when the flow violates its guard, and an earlier edge of the table goes before a later one.
"""

from __future__ import annotations

from typing import NamedTuple

AUSTENITE, MARTENSITE, INNER, TO_MARTENSITE, TO_AUSTENITE = 1, 2, 3, 4, 5

# Guards, each a number that is positive when the guard is violated.
ABOVE_A, BELOW_M, FULL, EMPTY, FALLING, RISING = range(6)
GUARD_NAMES = (
    'sigma > sigma_A',
    'sigma < sigma_M',
    'x_M > 1',
    'x_M < 0',
    'dx_M/dt < 0',
    'dx_M/dt > 0',
)


class Edge(NamedTuple):
    """One edge of the automaton."""

    source: int
    target: int
    guard: int


EDGES = (
    Edge(AUSTENITE, TO_MARTENSITE, ABOVE_A),
    Edge(MARTENSITE, TO_AUSTENITE, BELOW_M),
    Edge(INNER, TO_AUSTENITE, BELOW_M),
    Edge(INNER, TO_MARTENSITE, ABOVE_A),
    Edge(TO_MARTENSITE, MARTENSITE, FULL),
    Edge(TO_MARTENSITE, INNER, FALLING),
    Edge(TO_AUSTENITE, AUSTENITE, EMPTY),
    Edge(TO_AUSTENITE, INNER, RISING),
)


def frozen_fraction(target: int, x: float) -> float:
    """x_M that a jump into `target` freezes (maps g_1 to g_8): 0 and 1 exactly in modes 1 and 2."""
    if target == AUSTENITE:
        return 0.0
    if target == MARTENSITE:
        return 1.0
    return x


def observed_mode(x: float, dx: float, resting_rate: float) -> int:
    """The mode that a MAS wire is seen in: transforming beyond `resting_rate` [1/s], else by its fraction."""
    if dx > resting_rate:
        return TO_MARTENSITE
    if dx < -resting_rate:
        return TO_AUSTENITE
    if x < 1e-3:
        return AUSTENITE
    if x > 1.0 - 1e-3:
        return MARTENSITE
    return INNER
