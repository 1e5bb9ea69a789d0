"""The start of a run: static equilibrium, and modes that admit the wanted phase fractions."""

from __future__ import annotations

import numpy as np

from sma_sim.model.automaton import AUSTENITE, INNER, MARTENSITE, TO_AUSTENITE, TO_MARTENSITE
from sma_sim.model.effects.calls import share_state, start_states
from sma_sim.model.layout import O_S_A, O_S_M, O_SIGMA, O_X, System
from sma_sim.model.system import flow
from sma_sim.solver.linear import factorise, solve_factorised
from sma_sim.solver.stepper import Integers, Matrix, Vector, Work

NEWTON_STEPS = 50
CONVERGED = 1e-4  # last step relative to the difference steps: 1e-11 of the size of the pose


def settle(y: Vector, u: Vector, still: Vector, mode: Integers, x_frozen: Vector, p: System, w: Work) -> bool:
    """Move the pose in `y` to static equilibrium in the given modes (Newton); False if it was not found.

    In modes 4 and 5 x_M follows from sigma = sigma_A or sigma_M. Temperatures stay; rates must be zero.
    """
    matrix, step = w.matrix[:3, :3], w.y_new[:3]
    for _ in range(NEWTON_STEPS):
        balance(y, u, still, mode, x_frozen, p, w, w.f)
        for j in range(3):
            kept = y[j]
            y[j] = kept + w.increment[j]
            delta = y[j] - kept
            balance(y, u, still, mode, x_frozen, p, w, w.f_stage)
            y[j] = kept
            for i in range(3):
                matrix[i, j] = (w.f_stage[3 + i] - w.f[3 + i]) / delta
        for i in range(3):
            step[i] = w.f[3 + i]
        if not factorise(matrix, w.pivot):
            return False
        solve_factorised(matrix, w.pivot, step)
        size = 0.0
        for j in range(3):
            y[j] -= step[j]
            size = max(size, abs(step[j]) / w.increment[j])
        if not np.isfinite(size):
            return False
        if size < CONVERGED:
            balance(y, u, still, mode, x_frozen, p, w, w.f)
            return True
    return False


def start(y: Vector, u: Vector, still: Vector, wanted: Vector, mode: Integers, x_frozen: Vector, p: System, w: Work) -> bool:
    """Fill `y`, `mode` and `x_frozen` with a start at rest; False when no equilibrium was found.

    `still` is an input slope of zero. `wanted` is x_M per wire; NaN asks for sigma = sigma_A, inf for sigma = sigma_M.
    A fraction that no mode admits is moved to the nearest one that does, where the stress lies on the edge of the
    hysteresis.
    """
    for i in range(p.wires):
        x_frozen[i], mode[i] = 0.5, TO_AUSTENITE if np.isinf(wanted[i]) else TO_MARTENSITE
    found = equilibrium(y, u, still, mode, x_frozen, p, w)
    for i in range(p.wires):
        if np.isfinite(wanted[i]):
            x_frozen[i], mode[i] = wanted[i], INNER
    if found and not equilibrium(y, u, still, mode, x_frozen, p, w):
        towards_admitted(y, u, still, wanted, mode, x_frozen, p, w)
    for _ in range(8 * p.wires):
        if not equilibrium(y, u, still, mode, x_frozen, p, w):
            return False
        if not move_to_admitted(mode, x_frozen, p, w.obs):
            break
    for i in range(p.wires):
        x_frozen[i] = min(max(w.obs[i, O_X], 0.0), 1.0)
        mode[i] = AUSTENITE if x_frozen[i] <= 0.0 else MARTENSITE if x_frozen[i] >= 1.0 else INNER
        if p.mas:
            y[p.first_x + i] = x_frozen[i]
    return True


def towards_admitted(
    y: Vector, u: Vector, still: Vector, wanted: Vector, mode: Integers, x_frozen: Vector, p: System, w: Work
) -> None:
    """Where the wanted fractions have no equilibrium at all: put each wire on the nearer edge of its hysteresis."""
    for j in range(3):
        y[j] = 0.0
    for i in range(p.wires):
        x_frozen[i], mode[i] = 0.5, TO_MARTENSITE
    equilibrium(y, u, still, mode, x_frozen, p, w)
    for i in range(p.wires):
        if wanted[i] > w.obs[i, O_X]:
            mode[i] = TO_AUSTENITE


def equilibrium(y: Vector, u: Vector, still: Vector, mode: Integers, x_frozen: Vector, p: System, w: Work) -> bool:
    """Static equilibrium of the module; the wire has its strain from the input."""
    if p.module:
        return settle(y, u, still, mode, x_frozen, p, w)
    balance(y, u, still, mode, x_frozen, p, w, w.f)
    return True


def balance(y: Vector, u: Vector, still: Vector, mode: Integers, x_frozen: Vector, p: System, w: Work, f: Vector) -> None:
    """The flow at rest, with the extra states of effects at their first values for this pose."""
    share_state(0.0, y, u[-1], p)
    start_states(y, p, w.obs)
    flow(0.0, y, u, still, mode, x_frozen, p, f, w.obs)


def move_to_admitted(mode: Integers, x_frozen: Vector, p: System, obs: Matrix) -> bool:
    """Correct one wire whose fraction its mode does not admit; whether there was one."""
    slack = 1e-9 * p.wire.dsigma
    for i in range(p.wires):
        x = obs[i, O_X]
        moving = mode[i] == TO_MARTENSITE or mode[i] == TO_AUSTENITE
        if moving and (x < 0.0 or x > 1.0):
            mode[i], x_frozen[i] = INNER, min(max(x, 0.0), 1.0)
            return True
        if not moving and x < 1.0 and obs[i, O_SIGMA] > obs[i, O_S_A] + slack:
            mode[i] = TO_MARTENSITE
            return True
        if not moving and x > 0.0 and obs[i, O_SIGMA] < obs[i, O_S_M] - slack:
            mode[i] = TO_AUSTENITE
            return True
    return False
