"""Lays out the active effects for the compiled flow: order, addresses, parameters, places of extra states."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from sma_sim.compiler.compile import code_of
from sma_sim.compiler.effect_kernels import native_effect, own_kernels
from sma_sim.compiler.fields_read import fields_read
from sma_sim.model.effects.conversion import effect_on, like_of, with_parameters
from sma_sim.model.effects.discovery import ActiveEffect
from sma_sim.model.effects.effect import CHAIN, Effect
from sma_sim.model.effects.meaning import POSE, acting_coordinates, acts_on, channel_slots
from sma_sim.model.effects.ports import CHANNELS, PORT_NAMES, S_POSE, SENSING, STRUCTURE_FORCE, EffectTable
from sma_sim.model.effects.scope import FORM_SIZE, MASK_SIZE
from sma_sim.model.layout import System
from sma_sim.model.parameters import WireConstants
from sma_sim.model.structures.structure import Constants, Structure

# Size of a change in a channel that is no coordinate, for the states of sensing effects.
FORCE_SCALE, TEMPERATURE_SCALE, STRESS_SCALE, RESISTANCE_SCALE = 10.0, 30.0, 1e8, 1.0


def channel_codes(structure: Structure) -> list[int]:
    """The number by which kernels know each channel of a structure: its place in CHANNELS, or one after all of these."""
    return [
        CHANNELS.index(channel) if channel in CHANNELS else len(CHANNELS) + k for k, channel in enumerate(structure.channels)
    ]


def channel_kinds(structure: Structure) -> list[int]:
    """The same number for channels that are alike: forces, temperatures, resistances; coordinates in one unit."""
    own = [coordinate.unit for coordinate in structure.coordinates]
    kinds = own + [f'of wires: {name[0]}' for name in structure.channels[len(own) :]]
    return [kinds.index(kind) for kind in kinds]


def channel_scales(structure: Structure) -> list[float]:
    """Size of a change in each channel."""
    constants = structure.default_constants
    own = [c.sensor_size(constants) for c in structure.coordinates]
    forces = [FORCE_SCALE] * structure.wires if structure.coordinates else [STRESS_SCALE]
    temperatures = [TEMPERATURE_SCALE] * structure.wires if structure.imposed_temperature < 0 else []
    return [*own, *forces, *temperatures, *[RESISTANCE_SCALE] * structure.wires]


def state_scales(effect: Effect, structure: Structure) -> list[float]:
    """Scales of the extra states of all instances of an effect."""
    if effect.port == PORT_NAMES[SENSING]:
        slots = channel_slots(effect, structure)
        acting = [size for size, slot in zip(channel_scales(structure), slots, strict=True) if slot >= 0]
        return [channel * scale for channel in acting for scale in effect.scale]
    if effect.needs:
        sizes = channel_scales(structure)
        return [sizes[j] * scale for j in acting_coordinates(effect.needs, structure) for scale in effect.scale]
    return list(effect.scale) * (1 if effect.port == 'structure_force' else structure.wires)


def acting_order(effects: Sequence[Effect], structure: Structure) -> tuple[int, ...]:
    """Which of some effects act on a structure, in the order in which they do."""
    acting = [k for k, effect in enumerate(effects) if acts_on(effect, structure)]
    return tuple(sorted(acting, key=lambda k: effects[k].order))


def sizes_of_states(active: Sequence[ActiveEffect], structure: Structure) -> dict[str, tuple[float, ...]]:
    """The scales of the extra states by effect, in the order in which the states of a model have them."""
    effects = [as_on(one, structure).effect for one in active]
    found = {effects[k].name: tuple(state_scales(effects[k], structure)) for k in acting_order(effects, structure)}
    return {name: sizes for name, sizes in found.items() if sizes}


def states_together(effect: Effect, structure: Structure) -> int:
    """How many extra states the kernels of an effect take at once: those of a wire, a channel, or the structure."""
    return len(effect.states) * (len(acting_coordinates(effect.needs, structure)) if effect.needs else 1)


SERIES = (PORT_NAMES.index('wire_strain'), CHAIN['wire_strain'].index('series'))  # place in the order of effects


class Layout(NamedTuple):
    """What of a table does not depend on values: `order` of the effects, the scales of their extra states, the fields."""

    order: tuple[int, ...]
    scales: tuple[float, ...]
    fields: Mapping[str, Any]


def layout(effects: tuple[Effect, ...], structure: Structure, first_state: int) -> Layout:
    """The layout of some effects, whose extra states begin at `first_state`."""
    kernels = (kernel for one in effects if not one.files for kernel in (one.kernel, one.rate, one.start))
    return _layout(effects, structure, first_state, code_of(*kernels))


@lru_cache(256)
def _layout(active: tuple[Effect, ...], structure: Structure, first_state: int, code: str) -> Layout:
    """The same, made once: fits make models with other values only. `code`: that of kernels that no file holds, of which
    what they use may have changed."""
    order = acting_order(active, structure)
    effects = [active[k] for k in order]
    ports = np.array([effect.order[0] for effect in effects], dtype=np.int64)
    natives = [native_effect(one, structure if own_kernels(one, structure) else None).addresses for one in effects]
    addresses = np.array(natives, dtype=np.int64).reshape(-1, 3).T.copy()
    scales: list[float] = []
    state_start = []
    for effect in effects:
        state_start.append(first_state + len(scales))
        scales += state_scales(effect, structure)
    counts = [len(effect.parameters) + MASK_SIZE for effect in effects]
    fields = [fields_read(effect.kernel) for effect in effects]
    states = [states_together(effect, structure) for effect in effects]
    return Layout(
        order,
        tuple(scales),
        {
            'port_start': np.searchsorted(ports, np.arange(len(PORT_NAMES) + 1)).astype(np.int64),
            'series_start': sum(effect.order < SERIES for effect in effects),
            'value': addresses[0],
            'rate': addresses[1],
            'start': addresses[2],
            'states': np.array(states, dtype=np.int64),
            'state_start': np.array(state_start, dtype=np.int64),
            'scale': np.array(scales, dtype=float),
            'row': np.array([structure.wires - 1 if port >= STRUCTURE_FORCE else -1 for port in ports], dtype=np.int64),
            'slot': np.array([channel_slots(effect, structure) for effect in effects], dtype=np.int64).reshape(
                -1, len(structure.channels)
            ),
            'code': np.array(channel_codes(structure), dtype=np.int64),
            'kind': np.array(channel_kinds(structure), dtype=np.int64),
            'shared': np.array([effect.scope.shared for effect in effects], dtype=np.int64),
            'depends_on_x': np.array(['x' in read for read in fields], dtype=np.int64),
            'depends_on_eps': np.array(['eps' in read or 'length' in read for read in fields], dtype=np.int64),
            'depends_on_dx': np.array(['dx' in read for read in fields], dtype=np.int64),
            'depends_on_t': np.array(['t' in read for read in fields], dtype=np.int64),
            'depends_on_neighbours': np.array(['neighbours' in read for read in fields], dtype=np.int64),
            'parameter_start': np.array([sum(counts[:k]) for k in range(len(counts))], dtype=np.int64),
        },
    )


def as_on(active: ActiveEffect, structure: Structure) -> ActiveEffect:
    """An effect with the parameters that its kernels read on a structure.

    Where the effect is as declared for the module, channels of the structure take the value of the like one of the module
    (`parameters_of_channels`), and what it has there for each bundle or in space is neutral.
    """
    declared, values = active.effect, active.by_short_name
    if declared.by_channel:
        if declared.structure is structure or declared.scope.name:
            return active
        own = effect_on(active.effect, structure)
        likes = {p.name: like_of(declared, p.name, structure) for p in own.parameters if p.name in structure.channels}
        return ActiveEffect(own, tuple(values[(likes.get(p.name) or p).name] for p in own.parameters))
    effect = with_parameters(declared, structure)
    if effect is declared:
        return active
    more = effect.parameters[len(declared.parameters) :]
    return ActiveEffect(effect, (*active.values, *(p.default if p.neutral is None else p.neutral for p in more)))


def effect_table(
    active: Sequence[ActiveEffect], on: Structure, first_state: int, wire: WireConstants, constants: Constants
) -> tuple[EffectTable, tuple[float, ...]]:
    """The table of the active effects and the scales of their extra states, which begin at `first_state`."""
    active = [as_on(one, on) for one in active]
    plan = layout(tuple(one.effect for one in active), on, first_state)
    of_wire, of_structure = np.array(wire, dtype=float), np.array(constants, dtype=float)
    structural = [active[k].effect.port == PORT_NAMES[STRUCTURE_FORCE] for k in plan.order]
    coordinates = max(len(on.coordinates), len(POSE))  # most kernels take the state of these
    table = EffectTable(
        **plan.fields,
        constants=np.array([(of_structure if of else of_wire).ctypes.data for of in structural], dtype=np.int64),
        parameters=np.array([v for k in plan.order for v in with_mask(active[k])], dtype=float),
        s=np.zeros((on.wires, S_POSE + 2 * coordinates)),
        wire=of_wire,
        structure=of_structure,
        out=np.zeros(max([16, len(on.coordinates), *plan.fields['states']])),
        contribution=np.zeros((len(active), 3)),
    )
    return table, plan.scales


def with_mask(active: ActiveEffect) -> tuple[float, ...]:
    """The parameters of an effect, the mask of its scope, and what another form of its law has, as its kernels read them."""
    scope, own = active.effect.scope, len(active.values)
    if scope.field:
        own -= FORM_SIZE
    return (*active.values[:own], *scope.mask, *active.values[own:])


def own_scratch(p: System) -> System:
    """The system with scratch memory of its own: runs of one model in several threads must not share it."""
    e, at = p.effects, p.structure
    effects = e._replace(s=np.zeros(e.s.shape), out=np.zeros(e.out.shape), contribution=np.zeros(e.contribution.shape))
    return p._replace(effects=effects, structure=at._replace(effects=at.effects.copy()))
