"""Where an effect acts: in each wire or in one, in each coordinate of the pose or in one, through a state that wires share.

A scope is a mask that the compiled kernels read beside the effect's parameters: no scope compiles anything. An effect in a
scope is named NAME@SCOPE.
"""

from __future__ import annotations

from dataclasses import dataclass

SEPARATOR = '@'
MASK_SIZE = 5
MASK_WIRE, MASK_POSE, MASK_SHARED = 0, 1, 4  # where the mask has them; the pose takes three entries
BOTH_WIRES = -1.0


@dataclass(frozen=True)
class Scope:
    """A part of the places at which an effect can act.

    `words` complete "beam creep, ..."; `mask` is (wire, or BOTH_WIRES; 1 or 0 for U_x, U_y, alpha; 1 where the wires share
    the extra states); `channel` is that of a sensing effect.
    """

    name: str
    words: str
    mask: tuple[float, float, float, float, float] = (BOTH_WIRES, 1.0, 1.0, 1.0, 0.0)
    channel: str = ''


EVERYWHERE = Scope('', '')
WIRES = (
    Scope('wire_1', 'in wire 1 only', (0.0, 1.0, 1.0, 1.0, 0.0)),
    Scope('wire_2', 'in wire 2 only', (1.0, 1.0, 1.0, 1.0, 0.0)),
)
SHARED = Scope('shared', 'through a state that both wires share', (BOTH_WIRES, 1.0, 1.0, 1.0, 1.0))
COORDINATES = (
    Scope('stretch', 'in stretch only', (BOTH_WIRES, 1.0, 0.0, 0.0, 0.0)),
    Scope('deflection', 'in deflection only', (BOTH_WIRES, 0.0, 1.0, 0.0, 0.0)),
    Scope('rotation', 'in rotation only', (BOTH_WIRES, 0.0, 0.0, 1.0, 0.0)),
)


def scopes_at(port: str, channels: tuple[str, ...], has_states: bool) -> tuple[Scope, ...]:
    """The scopes of an effect on a port, which senses `channels`. What wires can share lies outside them: heat."""
    if port == 'structure_force':
        return COORDINATES
    if port == 'sensing':
        return tuple(Scope(name, f'in {name} only', channel=name) for name in channels)
    return (*WIRES, SHARED) if port == 'wire_heat' and has_states else WIRES
