"""Lays out the active effects for the compiled flow: order, addresses, parameters, places of extra states."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from sma_sim.model.effects.discovery import ActiveEffect, FoundEffect
from sma_sim.model.effects.effect import SYSTEMS, Effect
from sma_sim.model.effects.ports import CHANNELS, MODULE_CHANNELS, PORT_NAMES, S_SIZE, SENSING, STRUCTURE_FORCE, EffectTable
from sma_sim.model.effects.scope import MASK_SIZE
from sma_sim.model.layout import System
from sma_sim.model.parameters import BeamConstants, WireConstants
from sma_sim.solver.fields_read import fields_read
from sma_sim.solver.kernels import native_effect

# Size of a change in each channel, for the states of sensing effects.
CHANNEL_SCALES = (1e-4, 1e-3, 0.15, 10.0, 10.0, 30.0, 30.0, 1e8, 30.0)


def channel_slots(effect: Effect, module: bool) -> list[int]:
    """The instance of a sensing effect on each channel of the system, -1 where it does not act."""
    slots, count = [], 0
    for k, channel in enumerate(CHANNELS):
        acts = effect.port == PORT_NAMES[SENSING] and channel in effect.channels and module == (k < MODULE_CHANNELS)
        slots.append(count if acts else -1)
        count += acts
    return slots


def state_scales(effect: Effect, module: bool) -> list[float]:
    """Scales of the extra states of all instances of an effect."""
    if effect.port == PORT_NAMES[SENSING]:
        acting = [CHANNEL_SCALES[k] for k, slot in enumerate(channel_slots(effect, module)) if slot >= 0]
        return [channel * scale for channel in acting for scale in effect.scale]
    instances = 1 if effect.port == 'structure_force' or not module else 2
    return list(effect.scale) * instances


class Layout(NamedTuple):
    """What of a table does not depend on values: `order` of the effects, the scales of their extra states, the fields."""

    order: tuple[int, ...]
    scales: tuple[float, ...]
    fields: Mapping[str, Any]


@lru_cache(256)
def layout(found: tuple[FoundEffect, ...], module: bool, first_state: int) -> Layout:
    """The layout of some effects, whose extra states begin at `first_state`; fits make models with other values only."""
    acting = [k for k, one in enumerate(found) if SYSTEMS[0 if module else 1] in one.effect.systems]
    order = tuple(sorted(acting, key=lambda k: found[k].effect.order))
    effects = [found[k].effect for k in order]
    ports = np.array([effect.order[0] for effect in effects], dtype=np.int64)
    natives = [native_effect(found[k]).addresses for k in order]
    addresses = np.array(natives, dtype=np.int64).reshape(-1, 3).T.copy()
    scales: list[float] = []
    state_start = []
    for effect in effects:
        state_start.append(first_state + len(scales))
        scales += state_scales(effect, module)
    counts = [len(effect.parameters) + MASK_SIZE for effect in effects]
    fields = [fields_read(effect.kernel) for effect in effects]
    return Layout(order, tuple(scales), {
        'port_start': np.searchsorted(ports, np.arange(len(PORT_NAMES) + 1)).astype(np.int64),
        'value': addresses[0],
        'rate': addresses[1],
        'start': addresses[2],
        'states': np.array([len(effect.states) for effect in effects], dtype=np.int64),
        'state_start': np.array(state_start, dtype=np.int64),
        'scale': np.array(scales, dtype=float),
        'row': np.array([(1 if module else 0) if port >= STRUCTURE_FORCE else -1 for port in ports], dtype=np.int64),
        'slot': np.array([channel_slots(effect, module) for effect in effects], dtype=np.int64).reshape(-1, len(CHANNELS)),
        'depends_on_x': np.array(['x' in read for read in fields], dtype=np.int64),
        'depends_on_eps': np.array(['eps' in read or 'length' in read for read in fields], dtype=np.int64),
        'depends_on_dx': np.array(['dx' in read for read in fields], dtype=np.int64),
        'parameter_start': np.array([sum(counts[:k]) for k in range(len(counts))], dtype=np.int64),
    })  # fmt: skip


def effect_table(
    active: Sequence[ActiveEffect], module: bool, first_state: int, wire: WireConstants, beam: BeamConstants
) -> tuple[EffectTable, tuple[float, ...]]:
    """The table of the active effects and the scales of their extra states, which begin at `first_state`."""
    plan = layout(tuple(one.found for one in active), module, first_state)
    of_wire, of_beam = np.array(wire, dtype=float), np.array(beam, dtype=float)
    structural = [active[k].found.effect.port == PORT_NAMES[STRUCTURE_FORCE] for k in plan.order]
    table = EffectTable(
        **plan.fields,
        constants=np.array([(of_beam if of else of_wire).ctypes.data for of in structural], dtype=np.int64),
        parameters=np.array([v for k in plan.order for v in with_mask(active[k])], dtype=float),
        s=np.zeros((2 if module else 1, S_SIZE)),
        wire=of_wire,
        beam=of_beam,
        out=np.zeros(16),
    )
    return table, plan.scales


def with_mask(active: ActiveEffect) -> tuple[float, ...]:
    """The parameters of an effect and the mask of its scope, as its kernels read them."""
    return (*active.values, *active.found.effect.scope.mask)


def own_scratch(p: System) -> System:
    """The system with scratch memory of its own: runs of one model in several threads must not share it."""
    e = p.effects
    return p._replace(effects=e._replace(s=np.zeros_like(e.s), out=np.zeros_like(e.out)))
