"""The start of a run: static equilibrium, and modes that admit the requested phase fractions."""

from __future__ import annotations

import numpy as np

from sma_sim.model.arrays import Matrix, Vector
from sma_sim.model.automaton import AUSTENITE, INNER, MARTENSITE, TO_AUSTENITE, TO_MARTENSITE
from sma_sim.model.effects.calls import fill_kernel_state, start_states
from sma_sim.model.layout import O_S_A, O_S_M, O_SIGMA, O_X, InputPoint, System, SystemState
from sma_sim.model.system import ambient_temperature, flow
from sma_sim.solver.linear import invert, multiply
from sma_sim.solver.work import Work, copy_into

NEWTON_STEPS, MAX_UPDATES = 50, 200
SETTLED = 1e-2  # change of first values relative to the difference steps: 1e-9 of their size
MAX_STEP = 1e6  # relative to the difference steps, where whole steps lead away: a tenth of the size of the pose
ON_EDGE = 1e-6  # of dsigma, from the stress at which a wire transforms
CONVERGED = 1e-4  # last step relative to the difference steps: 1e-11 of the size of the pose


def solve_pose(state: SystemState, point: InputPoint, p: System, w: Work, alone: bool, careful: bool) -> bool:
    """Move the pose to static equilibrium in the given modes (Newton); False if it was not found.

    `alone`: that of each segment of a series for itself, without what the accelerations add, such as weight.
    `careful`: no coordinate moves far at once.
    In modes 4 and 5 x_M follows from sigma = sigma_A or sigma_M. Temperatures stay; rates must be zero. First values of
    effects that depend on a stress take that of the equilibrium before, until they stay.
    """
    y, n, forces = state.y, p.coordinates, p.structure.effects
    last = forces.shape[0] - n  # where a series has the forces on its segments
    matrix, force, step = w.matrix[:n, :n], w.y_stage[:n], w.y_new[:n]
    keep_wires(w, p)
    steps, updates = 0, 0
    while steps < NEWTON_STEPS and updates < MAX_UPDATES:
        steps += 1
        balance(state, point, p, w, w.first.dy)
        for i in range(n):
            force[i] = forces[last + i] if alone else w.first.dy[n + i]
        for j in range(n):
            kept = y[j]
            y[j] = kept + w.increment[j]
            delta = y[j] - kept
            balance(state, point, p, w, w.stage.dy)
            y[j] = kept
            for i in range(n):
                moved = forces[last + i] if alone else w.stage.dy[n + i]
                matrix[i, j] = (moved - force[i]) / delta
        if not invert(matrix, w.pivot, 0):
            return False
        multiply(matrix, force, step, 0)
        size = 0.0
        for j in range(n):
            most = MAX_STEP * w.increment[j]
            y[j] -= min(max(step[j], -most), most) if careful else step[j]
            size = max(size, abs(step[j]) / w.increment[j])
        if not np.isfinite(size):
            return False
        if size < CONVERGED:
            if first_values_stay(state, point, p, w):
                return True
            steps, updates = 0, updates + 1
    return False


def keep_wires(w: Work, p: System) -> None:
    """Note the stresses and fractions at which the first values of effects are taken."""
    for i in range(p.wires):
        w.guard.obs[i, O_SIGMA], w.guard.obs[i, O_X] = w.first.obs[i, O_SIGMA], w.first.obs[i, O_X]


def first_values_stay(state: SystemState, point: InputPoint, p: System, w: Work) -> bool:
    """Whether the first values of effects are those for the stress of this equilibrium; else they are from now on."""
    y, first = state.y, p.first_T + p.wires
    balance(state, point, p, w, w.first.dy)
    copy_into(w.y_dense, y)
    keep_wires(w, p)
    balance(state, point, p, w, w.first.dy)
    for j in range(first, y.shape[0]):
        if abs(y[j] - w.y_dense[j]) > SETTLED * w.increment[j]:
            return False
    return True


def start(state: SystemState, point: InputPoint, requested: Vector, parts: Vector, p: System, w: Work) -> bool:
    """Fill the state with a start at rest; False when no equilibrium was found.

    The state has its temperatures, and zeros. `requested` as in `start_at`; where `parts` (wires,) are finite, these are
    asked for instead: x_M as a part of what a resting wire can have, from sigma = sigma_A (least) to sigma_M (most).
    """
    within = False
    for i in range(p.wires):
        within = within or np.isfinite(parts[i])
    if not within:
        return start_at(state, point, requested, p, w)
    first, least, asked, edge = w.stages[0], w.stages[1], w.stages[2, : p.wires], w.stages[3, : p.wires]
    copy_into(first, state.y)
    edge[:] = np.nan
    if not start_at(state, point, edge, p, w):
        return False
    for i in range(p.wires):
        least[i], edge[i] = state.x_frozen[i], np.inf
    copy_into(state.y, first)
    if not start_at(state, point, edge, p, w):
        return False
    for i in range(p.wires):
        asked[i] = min(max(least[i] + parts[i] * (state.x_frozen[i] - least[i]), 0.0), 1.0)
    copy_into(state.y, first)
    return start_at(state, point, asked, p, w)


def start_at(state: SystemState, point: InputPoint, requested: Vector, p: System, w: Work) -> bool:
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
    if not found:
        forget_pose(state, p, w.first.obs)
    for i in range(p.wires):
        if np.isfinite(requested[i]):
            x_frozen[i], mode[i] = requested[i], INNER
    if found and not equilibrium(state, point, p, w):
        start_on_hysteresis_edge(state, point, requested, p, w)
    for _ in range(8 * p.wires):
        if not equilibrium(state, point, p, w):
            if not run_to_end(state, p):
                return False
            forget_pose(state, p, w.first.obs)
        elif not move_to_admitted(state, p, w.first.obs):
            break
    for i in range(p.wires):
        x_frozen[i] = min(max(w.first.obs[i, O_X], 0.0), 1.0)
        mode[i] = AUSTENITE if x_frozen[i] <= 0.0 else MARTENSITE if x_frozen[i] >= 1.0 else INNER
    return True


def take_fractions(state: SystemState, point: InputPoint, parts: Vector, moved: Vector, p: System, w: Work) -> None:
    """Give the wires fractions as `parts` (wires,) of those that their temperatures and strains admit, the pose as it is: 0
    where sigma = sigma_A, as of a wire that cools, 1 where sigma = sigma_M, as of one that is heated. `moved` (like y): by
    how much the extra states of effects differ from their first values."""
    mode, x_frozen, least = state.mode, state.x_frozen, w.stages[1]
    for side in (TO_MARTENSITE, TO_AUSTENITE):
        for i in range(p.wires):
            mode[i] = side
        balance_beside(state, point, moved, p, w)
        for i in range(p.wires):
            x = min(max(w.first.obs[i, O_X], 0.0), 1.0)
            if side == TO_MARTENSITE:
                least[i] = x
            else:
                x_frozen[i] = least[i] + parts[i] * (x - least[i])
    for i in range(p.wires):
        mode[i] = AUSTENITE if x_frozen[i] <= 0.0 else MARTENSITE if x_frozen[i] >= 1.0 else INNER
    balance_beside(state, point, moved, p, w)


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
        solve_pose(state, point, p, w, True, False)


def equilibrium(state: SystemState, point: InputPoint, p: System, w: Work) -> bool:
    """Static equilibrium of the structure; a wire alone has its strain from the input."""
    if p.coordinates > 0:
        if solve_pose(state, point, p, w, False, False):
            return at_transformation_stress(state, p, w.first.obs)
        if p.segments == 1:
            return False
        for j in range(p.coordinates):
            state.y[j] = 0.0
        approach(state, point, p, w)
        return solve_pose(state, point, p, w, False, True)
    keep_wires(w, p)
    balance(state, point, p, w, w.first.dy)
    return True


def at_transformation_stress(state: SystemState, p: System, obs: Matrix) -> bool:
    """Whether wires in modes 4 and 5 have the stress that these ask for: an implicit x_M may have no solution."""
    for i in range(p.wires):
        expected = obs[i, O_S_A] if state.mode[i] == TO_MARTENSITE else obs[i, O_S_M]
        moving = state.mode[i] == TO_MARTENSITE or state.mode[i] == TO_AUSTENITE
        if moving and abs(obs[i, O_SIGMA] - expected) > ON_EDGE * p.wire.dsigma:
            return False
    return True


def balance(state: SystemState, point: InputPoint, p: System, w: Work, f: Vector) -> None:
    """The flow at rest into `f`, with the extra states of effects at their first values for this pose."""
    take_first_values(state, point, p, w)
    flow(0.0, state, point, p, f, w.first.obs)


def balance_beside(state: SystemState, point: InputPoint, moved: Vector, p: System, w: Work) -> None:
    """As `balance`, with the extra states of effects beside their first values, by what `moved` (like y) has of them."""
    y, first = state.y, p.first_T + p.wires
    keep_wires(w, p)
    for j in range(first, y.shape[0]):
        y[j] = 0.0  # the first value of those without one of their own
    take_first_values(state, point, p, w)
    for j in range(first, y.shape[0]):
        y[j] += moved[j]
    flow(0.0, state, point, p, w.first.dy, w.first.obs)


def take_first_values(state: SystemState, point: InputPoint, p: System, w: Work) -> None:
    """Set the extra states of effects to their first values, for this pose and the stresses that were noted."""
    obs = w.first.obs
    for i in range(p.wires):
        obs[i, O_SIGMA], obs[i, O_X] = w.guard.obs[i, O_SIGMA], w.guard.obs[i, O_X]
    fill_kernel_state(0.0, state.y, ambient_temperature(point.u, p), p, obs)
    start_states(state.y, p, obs)


def forget_pose(state: SystemState, p: System, obs: Matrix) -> None:
    """Back to where nothing was found yet, from a search that failed."""
    for j in range(p.coordinates):
        state.y[j] = 0.0
    for i in range(p.wires):
        obs[i, O_SIGMA], obs[i, O_X] = 0.0, state.x_frozen[i]


def run_to_end(state: SystemState, p: System) -> bool:
    """Put a wire that has no equilibrium while it transforms, as under a dead weight, at the end; whether there was one."""
    mode, x_frozen = state.mode, state.x_frozen
    for i in range(p.wires):
        if mode[i] == TO_MARTENSITE or mode[i] == TO_AUSTENITE:
            x_frozen[i] = 1.0 if mode[i] == TO_MARTENSITE else 0.0
            mode[i] = INNER
            return True
    return False


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
