"""Where an effect acts: in each wire or in one, in each coordinate or in one, through a state that wires share.

A scope is a mask that the compiled kernels read beside the effect's parameters: no scope compiles anything. An effect in a
scope is named NAME@SCOPE.
"""

from __future__ import annotations

from dataclasses import dataclass

from sma_sim.model.structures.structure import Structure

SEPARATOR = '@'
MASK_SIZE = 3
MASK_WIRE, MASK_COORDINATE, MASK_SHARED = range(MASK_SIZE)  # where the mask has them
EVERY = -1  # wire, or coordinate


@dataclass(frozen=True)
class Scope:
    """A part of the places at which an effect can act.

    `words` complete "beam creep, ..."; `wire` and `coordinate` are indices, or EVERY; the wires share the extra states where
    `shared`; `channel` is that of a sensing effect.
    """

    name: str
    words: str
    wire: int = EVERY
    coordinate: int = EVERY
    shared: bool = False
    channel: str = ''

    @property
    def mask(self) -> tuple[float, float, float]:
        """What kernels read of it."""
        return float(self.wire), float(self.coordinate), float(self.shared)


EVERYWHERE = Scope('', '')


def scopes_at(port: str, channels: tuple[str, ...], has_states: bool, structure: Structure) -> tuple[Scope, ...]:
    """The scopes on a structure of an effect on a port, which senses `channels`.

    What wires can share lies outside them: heat.
    """
    if port == 'structure_force':
        words = [coordinate.motion or coordinate.name for coordinate in structure.coordinates]
        scopes = [Scope(word, f'in {word} only', coordinate=j) for j, word in enumerate(words)]
    elif port == 'sensing':
        return tuple(Scope(name, f'in {name} only', channel=name) for name in channels)
    else:
        scopes = [Scope(f'wire_{i + 1}', f'in wire {i + 1} only', wire=i) for i in range(structure.wires)]
        if port == 'wire_heat' and has_states:
            every = 'both' if structure.wires == 2 else 'all'
            scopes.append(Scope('shared', f'through a state that {every} wires share', shared=True))
    return tuple(scopes)
