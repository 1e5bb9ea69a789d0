"""Derivatives of the flow at the nodes of a step, for its tangents: in states once for all, in unknowns one by one."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sma_sim.compiler.pinned_systems import record_at
from sma_sim.model.arrays import Integers, Matrix, Vector
from sma_sim.model.automaton import INNER
from sma_sim.model.effects.calls import fill_kernel_state
from sma_sim.model.layout import Evaluation, InputPoint, System, SystemState
from sma_sim.model.system import (
    EVERY_WIRE,
    EVERYTHING,
    PER_WIRE_BITS,
    WIRE_1,
    ambient_temperature,
    depends_on,
    sensed_channel,
    update_flow,
)
from sma_sim.solver.stepper import Segment, flow_at, input_at
from sma_sim.solver.tangent_algebra import copy_matrix, subtract_product
from sma_sim.solver.work import Work, copy_evaluation, copy_into

Arrays = NDArray[np.float64]  # of three dimensions
FRACTION_STEP = 1e-7  # of frozen fractions, for differences
FIRST, MIDDLE, LAST = range(3)


class Tangents(NamedTuple):
    """Tangents in the making: P unknowns, n states, c sampled channels; three nodes of each step: FIRST, MIDDLE, LAST.

    `systems` are the addresses of the equations with one unknown moved by `delta` (P or fewer: the last tangents may be of
    no unknown). `row_shift` (rows, P) tells how the times of the input's rows change; `value_shift` and `slope_shift`
    (rows, P, columns; no rows where nothing does) how its values do in a stretch, which is number `row` (1,).
    """

    numbers: Integers  # (c,) of the channels
    direct: Integers  # (c,) the state that a sensor shows as it is, -1 where it shows something else
    timed: Integers  # (c,) 1 where what a sensor does depends on time itself
    systems: Integers
    delta: float
    row_shift: Matrix
    value_shift: Arrays
    slope_shift: Arrays
    row: Integers
    s: Matrix  # (n, P) tangents of the states
    r: Matrix  # (wires, P) tangents of the frozen fractions
    shift: Vector  # (P,) of the last jump's time
    y: Matrix  # (3, n) states at the nodes
    dy: Matrix  # (3, n)
    obs: Arrays  # (3, wires, ...)
    shown: Matrix  # (3, c)
    by_state: Arrays  # (3, n + c, n + wires) derivatives in states and frozen fractions, of rates, then of channels
    by_unknown: Arrays  # (3, n + c, P), of channels without `sensed`
    sensed: Arrays  # (3, c, P) of timed channels, what the sensor alone makes of an unknown
    slope: Matrix  # (n, P) h times the derivative in time of the equation at the beginning of a step
    matrix: Matrix  # (n, n + wires)
    stage: Matrix  # (n, P)
    stages: Arrays  # (6, n, P)
    rhs: Matrix  # (n, P) of the equations of a stage
    new: Matrix  # (n, P)
    dense: Arrays  # (2, n, P)
    mode: Integers  # (wires,) before a jump
    x_frozen: Vector
    moved: Vector  # (n,)
    moved_x: Vector  # (wires,)
    moved_u: Vector  # (columns,)
    moved_du: Vector
    samples: Arrays  # (k, c, P)
    slopes: Matrix  # (k, c) of the samples in time


def linearize_node(node: int, t: float, state: SystemState, segment: Segment, p: System, w: Work, a: Tangents) -> None:
    """The flow at a node, what sensors show there, and the derivatives of both in states and frozen fractions."""
    y, found, n = state.y, Evaluation(a.dy[node], a.obs[node]), state.y.shape[0]
    flow_at(t, state, segment, p, w, found)
    point = InputPoint(w.u, segment.du)
    for c in range(a.shown.shape[1]):
        a.shown[node, c] = sensed_channel(a.numbers[c], y, p, found.obs, found.dy)
    for j in range(n):
        copy_evaluation(found, w.stage)
        kept = y[j]
        y[j] = kept + w.increment[j]
        step = y[j] - kept
        update_flow(t, state, point, p, w.stage, depends_on(j, state, p))
        column(1.0 / step, node, j, y, p, w, a)
        y[j] = kept
    for i in range(p.wires):
        if p.mas or state.mode[i] != INNER:  # frozen fractions of other modes are 0, 1, or none
            for row in range(a.by_state.shape[1]):
                a.by_state[node, row, n + i] = 0.0
        else:
            copy_evaluation(found, w.stage)
            kept = state.x_frozen[i]
            state.x_frozen[i] = kept + FRACTION_STEP
            step = state.x_frozen[i] - kept
            changed = EVERY_WIRE if p.effects.port_start[-1] > 0 else WIRE_1 << PER_WIRE_BITS * i
            update_flow(t, state, point, p, w.stage, changed)
            column(1.0 / step, node, n + i, y, p, w, a)
            state.x_frozen[i] = kept


def column(inverse: float, node: int, j: int, y: Vector, p: System, w: Work, a: Tangents) -> None:
    """Column `j` of the derivatives in states at a node, from the evaluation ``w.stage`` beside it."""
    n = y.shape[0]
    for i in range(n):
        a.by_state[node, i, j] = (w.stage.dy[i] - a.dy[node, i]) * inverse
    for c in range(a.shown.shape[1]):
        if a.direct[c] < 0:
            there = sensed_channel(a.numbers[c], y, p, w.stage.obs, w.stage.dy)
            a.by_state[node, n + c, j] = (there - a.shown[node, c]) * inverse
        else:
            a.by_state[node, n + c, j] = 1.0 if a.direct[c] == j else 0.0


def unknown_columns(node: int, t: float, state: SystemState, segment: Segment, p: System, w: Work, a: Tangents) -> None:
    """The derivatives of the flow and of what sensors show in the unknowns, at a node that is linearised.

    Each is found beside the node on the tangent at the beginning of the step, less what the states' derivatives make of it:
    large derivatives that cancel on the tangent, such as those of a stress that stays, so leave no error of differences.
    """
    n = state.y.shape[0]
    input_at(t, segment, w.u)
    inverse = 1.0 / a.delta
    for j in range(a.systems.shape[0]):
        moved = record_at(a.systems[j], p)
        beside = move_along(j, state, a)
        update_flow(t, beside, input_beside(j, t, segment, w, a), moved, w.stage, EVERYTHING)
        for i in range(n):
            a.by_unknown[node, i, j] = (w.stage.dy[i] - a.dy[node, i]) * inverse
        for c in range(a.shown.shape[1]):
            if a.direct[c] < 0:
                there = sensed_channel(a.numbers[c], beside.y, moved, w.stage.obs, w.stage.dy)
                a.by_unknown[node, n + c, j] = (there - a.shown[node, c]) * inverse
    subtract_product(a.by_state[node], a.s, a.r, a.by_unknown[node])
    for c in range(a.shown.shape[1]):
        if a.timed[c] != 0:
            by_sensor(c, t, Evaluation(state.y, a.obs[node]), p, w, a, a.sensed[node, c])
            for j in range(a.systems.shape[0]):
                a.by_unknown[node, n + c, j] -= a.sensed[node, c, j]


def by_sensor(c: int, t: float, at: Evaluation, p: System, w: Work, a: Tangents, found: Vector) -> None:
    """Derivatives (P,) in the unknowns of what the sensor of channel `c` makes of a state that stays: `at` has y and obs.

    What it does may change faster in time than the states: between the nodes of a step this part is no parabola.
    """
    y, obs = at
    T_E = ambient_temperature(w.u, p)
    fill_kernel_state(t, y, T_E, p, obs)
    here = sensed_channel(a.numbers[c], y, p, obs, w.stage.dy)
    for j in range(a.systems.shape[0]):
        moved = record_at(a.systems[j], p)
        fill_kernel_state(t, y, T_E, moved, obs)
        found[j] = (sensed_channel(a.numbers[c], y, moved, obs, w.stage.dy) - here) / a.delta


def move_along(j: int, state: SystemState, a: Tangents) -> SystemState:
    """The state beside one, `delta` along its tangent of unknown `j`."""
    for k in range(a.moved.shape[0]):
        a.moved[k] = state.y[k] + a.delta * a.s[k, j]
    for i in range(a.moved_x.shape[0]):
        a.moved_x[i] = state.x_frozen[i] + a.delta * a.r[i, j]
    return SystemState(a.moved, state.mode, a.moved_x)


def input_beside(j: int, t: float, segment: Segment, w: Work, a: Tangents) -> InputPoint:
    """The input at time t, ``w.u``, with unknown `j` moved by `delta`."""
    if a.value_shift.shape[0] == 0:
        return InputPoint(w.u, segment.du)
    row = a.row[0]
    for k in range(a.moved_u.shape[0]):
        slope = a.delta * a.slope_shift[row, j, k]
        a.moved_u[k] = w.u[k] + a.delta * a.value_shift[row, j, k] + slope * (t - segment.t_0)
        a.moved_du[k] = segment.du[k] + slope
    return InputPoint(a.moved_u, a.moved_du)


def keep_last(a: Tangents) -> None:
    """The end of a step is the beginning of the next."""
    copy_into(a.dy[FIRST], a.dy[LAST])
    copy_into(a.shown[FIRST], a.shown[LAST])
    copy_matrix(a.obs[FIRST], a.obs[LAST])
    copy_matrix(a.by_state[FIRST], a.by_state[LAST])
    copy_matrix(a.by_unknown[FIRST], a.by_unknown[LAST])
