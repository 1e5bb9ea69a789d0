"""Samples of single sensor channels: only what they show is evaluated."""

from __future__ import annotations

from sma_sim.model.effects.calls import stress_wire, true_channel
from sma_sim.model.effects.ports import SENSING, TRANSFORMATION_STRESS, WIRE_FORCE, WIRE_STRAIN
from sma_sim.model.layout import InputPoint, System, SystemState
from sma_sim.model.system import (
    EVERYTHING,
    LENGTHS,
    NOMINAL_FORCE,
    PER_WIRE_BITS,
    STRESS_1,
    sensed_channel,
    update_flow,
)
from sma_sim.solver.stepper import Segment, input_at
from sma_sim.solver.work import Integers, Vector, Work


def needed_for(channels: Integers, p: System) -> int:
    """What of the flow the sensors of these channels show, for `update_flow`; 0 where they show states."""
    e, needed = p.effects, 0
    for channel in channels:
        for k in range(e.port_start[SENSING], e.port_start[SENSING + 1]):
            if e.slot[k, channel] >= 0:
                return EVERYTHING
        i = stress_wire(channel, p)
        if i >= 0 and (
            e.port_start[TRANSFORMATION_STRESS + 1] > e.port_start[WIRE_STRAIN]
            or e.port_start[WIRE_FORCE + 1] > e.port_start[WIRE_FORCE]
        ):
            return EVERYTHING
        if i >= 0:
            needed |= NOMINAL_FORCE | LENGTHS | STRESS_1 << PER_WIRE_BITS * i
    return needed


def sample_channels(
    t: float, state: SystemState, segment: Segment, p: System, w: Work, channels: Integers, needed: int, row: Vector
) -> None:
    """What the sensors of the `channels` show, one number each; `needed` is what `needed_for` says of them."""
    if needed != 0:
        input_at(t, segment, w.u)
        update_flow(t, state, InputPoint(w.u, segment.du), p, w.sample, needed)
    for k in range(channels.shape[0]):
        if needed == EVERYTHING:
            row[k] = sensed_channel(channels[k], state.y, p, w.sample.obs, w.sample.dy)
        else:
            row[k] = true_channel(channels[k], state.y, p, w.sample.obs)
