"""Variants: the effects of the candidates in one wire, one coordinate or one channel, or with a state that wires share.

They are generated, with the kernels of the effects themselves. What an effect can do by its own parameters is no variant:
one whose kernel tells the wires or channels apart, or that has a parameter of its own for a coordinate. Other forms of a
law are proposed where a model that has it leaves something.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import cache
from itertools import chain
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sma_sim.compiler.fields_read import can_share, fields_read, forms_of_law
from sma_sim.evidence.model_selection.candidates import Candidate, candidate_at, candidate_of, shape_grid
from sma_sim.model.effects.effect import Effect
from sma_sim.model.effects.meaning import POSE, acting_coordinates
from sma_sim.model.effects.ports import State
from sma_sim.model.effects.scope import Scope
from sma_sim.model.parameters import beam_constants
from sma_sim.model.program_parameters import DEFAULTS

POSE_RATE = ('dU_x', 'dU_y', 'dalpha')
SPEEDS = ('v', 'dq')  # fields of the state in which other forms of a law are proposed


def variants_of(candidates: Iterable[Candidate], channels: Iterable[str]) -> tuple[Candidate, ...]:
    """The variants of all candidates on a structure, of which `channels` are measured."""
    measured = set(channels)
    return tuple(
        candidate_of(candidate.effect.in_scope(scope))
        for candidate in candidates
        for scope in scopes_of(candidate.effect)
        if not scope.channel or scope.channel in measured
    )


@cache
def scopes_of(effect: Effect) -> tuple[Scope, ...]:
    """The scopes in which an effect is something else than by its own parameters."""
    return () if effect.scope.name else tuple(scope for scope in effect.scopes if differs(effect, scope))


def differs(effect: Effect, scope: Scope) -> bool:
    """Whether an effect in a scope is another one."""
    read = fields_read(effect.kernel)
    if scope.wire >= 0:
        return 'wire' not in read and not effect.each_bundle and effect.structure.wires > 1
    if scope.shared:
        return can_share(effect) and effect.structure.wires > 1
    if scope.coordinate >= 0:
        return is_of_several_coordinates(effect, scope.coordinate)
    own = effect.of_channel(scope.channel) if effect.by_channel else None
    return 'channel' not in read and len(effect.channels) > 1 and (own is None or own.name != scope.channel)


def is_of_several_coordinates(effect: Effect, coordinate: int) -> bool:
    """Whether an effect acts in a coordinate when it sees that one alone, and what acts there acts in others too."""
    if effect.needs:
        acting = acting_coordinates(effect.needs, effect.structure)
        return 'gravity' not in effect.needs and coordinate in acting and len(acting) > 1
    if effect.structure.coordinate_names != POSE:
        return False
    alone = forces_by_parameter(effect, tuple(float(k == coordinate) for k in range(len(POSE))))
    if not any(moved[coordinate] for moved in alone.values()):
        return False
    everywhere = forces_by_parameter(effect, (1.0, 1.0, 1.0))
    return any(moved[coordinate] and moved.sum() > 1 for moved in everywhere.values())


def forces_by_parameter(effect: Effect, mask: tuple[float, ...]) -> Mapping[str, NDArray[np.bool_]]:
    """By strength, in which coordinates (3,) a small one moves the structure in a pose that is seen through a mask."""
    constants = beam_constants({name: parameter.default for name, parameter in DEFAULTS.items()})
    pose = {name: 0.5 * (k + 1) * mask[k] for k, name in enumerate(POSE)}
    rates = {name: 0.5 * (k + 1) * mask[k] for k, name in enumerate(POSE_RATE)}
    state = State(*[0.5] * len(State._fields))._replace(**pose, **rates)
    memory = SimpleNamespace(**{name: 0.5 * mask[k % len(POSE)] for k, name in enumerate(effect.states)})
    given = (memory,) if effect.states else ()
    neutral = {p.name: p.default if p.neutral is None else p.neutral for p in effect.parameters}

    def forces(values: Mapping[str, float]) -> NDArray[np.float64]:
        kernel: Callable[..., Any] = effect.kernel
        return np.asarray(kernel(state, constants, SimpleNamespace(**values), *given), dtype=float)

    without = forces(neutral)
    probes = chain(*candidate_of(effect).families[:1])
    return {one.parameter: forces({**neutral, one.parameter: one.neutral + one.step}) != without for one in probes}


def forms_of(effect: Effect) -> tuple[Candidate, ...]:
    """The other forms of the law of an active effect, each probed beside it as it is; none of one in another form.

    Only in the speed: how friction builds up with it is a regularisation, not physics. That of guides in another function of
    the force would be that of joints, and of what transforms or heats a wire other laws are listed.
    """
    made = list[Candidate]()
    for form in forms_of_law(effect):
        if form.field not in SPEEDS or form != effect.scope.of(form.field):
            continue
        other = effect.in_scope(form)
        own = other.parameters[len(effect.parameters) :]
        made.append(candidate_at(other, shape_grid([p for p in own if p.neutral is None]), own))
    return tuple(made)
