"""Equal segments in series, each clamped to the end of the one before it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from sma_sim.model.structures.structure import Coordinate, Structure, numbers, record

# What a structure has of its segment where nothing else is given.
KEPT = 'title', 'antagonistic', 'parameters', 'constants', 'size_parameter', 'fitted', 'defaults', 'strain'


def in_series(segment: Structure, count: int, word: str, **fields: Any) -> Structure:
    """A structure of `count` equal segments, whose coordinates get the segment's number; a `word` names one.

    `fields` are the others of `Structure`, `accelerations` among them; what is not given is the segment's.
    """
    fields = {name: getattr(segment, name) for name in KEPT} | fields
    lengths, forces, stiffness = segment.lengths, segment.forces, segment.stiffness
    assert lengths is not None and forces is not None
    return Structure(
        coordinates=tuple(numbered(coordinate, k, word) for k in range(1, count + 1) for coordinate in segment.coordinates),
        wires=count * segment.wires,
        lengths=lambda q, p: tuple(length for (part,) in parts(segment, q) for length in numbers(lengths(part, p))),
        forces=lambda q, v, p: tuple(f for qk, vk in parts(segment, q, v) for f in numbers(forces(qk, vk, p))),
        stiffness=None
        if stiffness is None
        else lambda q, p, part: tuple(f for (qk,) in parts(segment, q) for f in numbers(stiffness(qk, p, part))),
        segment=segment,
        **fields,
    )


def numbered(coordinate: Coordinate, k: int, word: str) -> Coordinate:
    """A coordinate of segment `k`."""
    of_this = f' ({word} {k})'
    motion, law = (name and f'{name}_{k}' for name in (coordinate.motion, coordinate.law))
    force = coordinate.force and coordinate.force + of_this
    description = coordinate.description + of_this
    return replace(coordinate, name=f'{coordinate.name}_{k}', motion=motion, law=law, force=force, description=description)


def parts(segment: Structure, *poses: Any) -> Iterator[tuple[Any, ...]]:
    """The poses of each segment in turn, by the names of its coordinates, from those of the whole."""
    pose, n = record('Pose', segment.coordinate_names), len(segment.coordinates)
    for first in range(0, len(poses[0]), n):
        yield tuple(pose(*whole[first : first + n]) for whole in poses)
