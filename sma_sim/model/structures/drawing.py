"""Where the parts of any structure are in a pose, for pictures, URDF and TF."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from sma_sim.model.parameters import wire_constants
from sma_sim.model.structures.links import AXES, Box, Joint, Line, Link, LinkTree, Motion, Vector3
from sma_sim.model.structures.structure import Coordinate, Structure, numbers, record

BASE_FRAME, END_FRAME = 'base', 'end'
SPACING, HALF_BAR = 0.2, 0.04  # of wires side by side, and of a bar across a single one, relative to their length
BASE_COLOUR, END_COLOUR = '#888888', '#222222'
DRAWN_SIZE, MAX_MOTION = 0.03, 10.0  # of a box, relative to a wire's length; of a joint, relative to its usual change
DIFFERENCE = 1e-3  # relative to the usual change of a coordinate
DEPTH = (0.6, 0.4)  # by how much a point that is further in z is moved in a picture, relative to z


class Lines(NamedTuple):
    """The lines of a structure [m]: its wires, from their fixed ends on, and all else."""

    wires: Sequence[Line]
    bodies: Sequence[Line]


class Sketch:
    """The drawing of a structure with parameters `values` by full name, SI units."""

    def __init__(self, structure: Structure, values: Mapping[str, float]) -> None:
        self._structure, self._values = structure, values
        self._constants = structure.constants_of(values)
        self._pose = record('Pose', structure.coordinate_names)
        self._in_segment = max(1, len(structure.coordinates) // structure.segments)
        self._at_zero = dict.fromkeys(structure.coordinate_names, 0.0)
        self._rest = self.lengths_at(self._at_zero)
        self.scale = sum(self._rest) / len(self._rest)
        self.tree = structure.links(values) if structure.links is not None else self._chain()

    def lines(self, q: Mapping[str, float], lengths: Sequence[float]) -> Lines:
        """The lines at the coordinates q by name [m or rad], where the wires have these lengths [m]."""
        drawing, pose = self._structure.drawing, self._pose(**q)
        if drawing is None:
            wires: Sequence[Line] = self._side_by_side(lengths)
        else:
            wires = drawing.wires(pose, self._constants)
            if drawing.bodies is not None:
                return Lines(wires, drawing.bodies(pose, self._constants))
        return Lines(wires, [self._joined([wire[-1] for wire in wires])])

    def ends(self, lines: Lines) -> dict[str, Vector3]:
        """Where the ends of the wires are [m], by their frames."""
        return {f'wire_{i + 1}_end': (wire[-1][0], wire[-1][1], wire[-1][2]) for i, wire in enumerate(lines.wires)}

    def lengths_at(self, q: Mapping[str, float]) -> tuple[float, ...]:
        """Lengths of the wires [m] at the coordinates q by name; of one whose strain is imposed, without strain."""
        if self._structure.lengths is None:
            return (wire_constants(self._values).l0,) * self._structure.wires
        return tuple(map(float, numbers(self._structure.lengths(self._pose(**q), self._constants))))

    def _side_by_side(self, lengths: Sequence[float]) -> list[Line]:
        """Wires along x, which are as long as they are."""
        places = [SPACING * self.scale * (0.5 * (len(lengths) - 1) - i) for i in range(len(lengths))]
        return [((0.0, y, 0.0), (length, y, 0.0)) for y, length in zip(places, lengths, strict=True)]

    def _joined(self, ends: Sequence[Vector3]) -> Line:
        """What joins the ends of the wires: a bar, or a ring."""
        if len(ends) == 1:
            (x, y, z), half = ends[0], HALF_BAR * self.scale
            return ((x, y - half, z), (x, y + half, z))
        return [*ends, ends[0]] if len(ends) > 2 else ends

    def _chain(self) -> LinkTree:
        """Joint after joint in the order of the coordinates, and both ends of each wire."""
        structure, size = self._structure, DRAWN_SIZE * self.scale
        names = [f'{name}_link' for name in structure.coordinate_names[:-1]] + [END_FRAME] * bool(structure.coordinates)
        drawing, parent = structure.drawing, BASE_FRAME
        origin = (0.0, 0.0, 0.0) if drawing is None or drawing.origin is None else drawing.origin(self._constants)
        links, joints = [Link(BASE_FRAME, Box((size, size, size), (0.0, 0.0, 0.0), BASE_COLOUR))], []
        first = origin
        for k, (name, motion) in enumerate(zip(names, self._motions(), strict=True)):
            origin = first if k % self._in_segment == 0 else (0.0, 0.0, 0.0)
            links.append(Link(name, Box((size, size, size), (0.0, 0.0, 0.0), END_COLOUR) if name == END_FRAME else None))
            joints.append(Joint(parent, name, origin, motion))
            parent = name
        lines = self.lines(self._at_zero, self._rest)
        for i, (child, end) in enumerate(self.ends(lines).items()):
            links += [Link(f'wire_{i + 1}'), Link(child)]
            before = i * structure.segments // structure.wires  # segments that carry this one: its frame is parallel to base
            x, y, z = (at - before * offset for at, offset in zip(lines.wires[i][0], first, strict=True))
            joints.append(Joint(names[before * self._in_segment - 1] if before else BASE_FRAME, f'wire_{i + 1}', (x, y, z)))
            joints.append(Joint(BASE_FRAME, child, end, free=True))
        return LinkTree(f'sma_{structure.name}', tuple(links), tuple(joints))

    def _motions(self) -> list[Motion]:
        """What every joint allows; limits for sliders and planners: the model has none."""
        w, found = wire_constants(self._values), []
        force = w.n * w.section * w.E_A * w.eps_T
        counts: dict[str, int] = {}
        for k, coordinate in enumerate(self._structure.coordinates):
            counts = counts if k % self._in_segment else {'rad': 0, '': 0}
            revolute, size = coordinate.unit == 'rad', coordinate.size(self._constants)
            ends = [self._rest, self.lengths_at(self._at_zero | {coordinate.name: DIFFERENCE * size})]
            rest, moved = (self._structure.strains(lengths, self._values) for lengths in ends)
            change = w.l0 * sum(abs(a - b) for (a, _), (b, _) in zip(moved, rest, strict=True))
            effort = force * change / (DIFFERENCE * size)
            most = min(coordinate.limit, MAX_MOTION * size)
            axis = axis_of(coordinate, counts)
            found.append(Motion(coordinate.name, revolute, AXES[axis], -most, most, max(effort, force * 1e-6), most, 0.0))
        return found


def axis_of(coordinate: Coordinate, counts: dict[str, int]) -> str:
    """The axis of a coordinate; `counts` those before it that were not told."""
    if coordinate.axis:
        return coordinate.axis
    kind = 'rad' if coordinate.unit == 'rad' else ''
    counts[kind] += 1
    return ('zyx' if kind else 'xyz')[(counts[kind] - 1) % 3]


def projected(line: Line) -> tuple[list[float], list[float]]:
    """A line in the plane of a picture: x to the right, y up, z into the depth."""
    return [x + DEPTH[0] * z for x, _, z in line], [y + DEPTH[1] * z for _, y, z in line]
