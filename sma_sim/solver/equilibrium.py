"""The start of a run: static equilibrium, and modes that admit the requested phase fractions."""

from __future__ import annotations

import numpy as np

from sma_sim.model.automaton import AUSTENITE, INNER, MARTENSITE, TO_AUSTENITE, TO_MARTENSITE
from sma_sim.model.effects.calls import fill_kernel_state, start_states
from sma_sim.model.layout import O_S_A, O_S_M, O_SIGMA, O_X, InputPoint, System, SystemState
from sma_sim.model.system import ambient_temperature, flow
from sma_sim.solver.linear import factorise, solve_factorised
from sma_sim.solver.work import Matrix, Vector, Work

NEWTON_STEPS = 50
CONVERGED = 1e-4  # last step relative to the difference steps: 1e-11 of the size of the pose


def solve_pose(state: SystemState, point: InputPoint, p: System, w: Work, alone: bool) -> bool:
    """Move the pose to static equilibrium in the given modes (Newton); False if it was not found.

    `alone`: that of each segment of a series for itself, without what the accelerations add, such as weight.
    In modes 4 and 5 x_M follows from sigma = sigma_A or sigma_M. Temperatures stay; rates must be zero.
    """
    y, n, forces = state.y, p.coordinates, p.structure.effects
    last = forces.shape[0] - n  # where a series has the forces on its segments
    matrix, step = w.matrix[:n, :n], w.y_new[:n]
    for _ in range(NEWTON_STEPS):
        balance(state, point, p, w, w.first.dy)
        for i in range(n):
            step[i] = forces[last + i] if alone else w.first.dy[n + i]
        for j in range(n):
            kept = y[j]
            y[j] = kept + w.increment[j]
            delta = y[j] - kept
            balance(state, point, p, w, w.stage.dy)
            y[j] = kept
            for i in range(n):
                moved = forces[last + i] if alone else w.stage.dy[n + i]
                matrix[i, j] = (moved - step[i]) / delta
        if not factorise(matrix, w.pivot):
            return False
        solve_factorised(matrix, w.pivot, step)
        size = 0.0
        for j in range(n):
            y[j] -= step[j]
            size = max(size, abs(step[j]) / w.increment[j])
        if not np.isfinite(size):
            return False
        if size < CONVERGED:
            balance(state, point, p, w, w.first.dy)
            return True
    return False


def start(state: SystemState, point: InputPoint, requested: Vector, p: System, w: Work) -> bool:
    """Fill the state with a start at rest; False when no equilibrium was found.

    The input `point` has a slope of zero. `requested` is x_M per wire; NaN asks for sigma = sigma_A, inf for sigma_M.
    A fraction that no mode admits is moved to the nearest one that does, where the stress lies on the edge of the
    hysteresis.
    """
    mode, x_frozen = state.mode, state.x_frozen
    for i in range(p.wires):
        x_frozen[i], mode[i] = 0.5, TO_AUSTENITE if np.isinf(requested[i]) else TO_MARTENSITE
    approach(state, point, p, w)
    found = equilibrium(state, point, p, w)
    for i in range(p.wires):
        if np.isfinite(requested[i]):
            x_frozen[i], mode[i] = requested[i], INNER
    if found and not equilibrium(state, point, p, w):
        start_on_hysteresis_edge(state, point, requested, p, w)
    for _ in range(8 * p.wires):
        if not equilibrium(state, point, p, w):
            return False
        if not move_to_admitted(state, p, w.first.obs):
            break
    for i in range(p.wires):
        x_frozen[i] = min(max(w.first.obs[i, O_X], 0.0), 1.0)
        mode[i] = AUSTENITE if x_frozen[i] <= 0.0 else MARTENSITE if x_frozen[i] >= 1.0 else INNER
        if p.mas:
            state.y[p.first_x + i] = x_frozen[i]
    return True


def start_on_hysteresis_edge(state: SystemState, point: InputPoint, requested: Vector, p: System, w: Work) -> None:
    """Where the requested fractions have no equilibrium at all: put each wire on the nearer edge of its hysteresis."""
    for j in range(p.coordinates):
        state.y[j] = 0.0
    for i in range(p.wires):
        state.x_frozen[i], state.mode[i] = 0.5, TO_MARTENSITE
    approach(state, point, p, w)
    equilibrium(state, point, p, w)
    for i in range(p.wires):
        if requested[i] > w.first.obs[i, O_X]:
            state.mode[i] = TO_AUSTENITE


def approach(state: SystemState, point: InputPoint, p: System, w: Work) -> None:
    """Bring segments in series near equilibrium: straight ones push on each other so hard that Newton's method is lost."""
    if p.segments > 1:
        solve_pose(state, point, p, w, True)


def equilibrium(state: SystemState, point: InputPoint, p: System, w: Work) -> bool:
    """Static equilibrium of the structure; a wire alone has its strain from the input."""
    if p.coordinates > 0:
        return solve_pose(state, point, p, w, False)
    balance(state, point, p, w, w.first.dy)
    return True


def balance(state: SystemState, point: InputPoint, p: System, w: Work, f: Vector) -> None:
    """The flow at rest into `f`, with the extra states of effects at their first values for this pose."""
    obs = w.first.obs
    fill_kernel_state(0.0, state.y, ambient_temperature(point.u, p), p, obs)
    start_states(state.y, p, obs)
    flow(0.0, state, point, p, f, obs)


def move_to_admitted(state: SystemState, p: System, obs: Matrix) -> bool:
    """Correct one wire whose fraction its mode does not admit; whether there was one."""
    mode, x_frozen = state.mode, state.x_frozen
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
