"""Links and joints of a structure: a tree from one root, for whoever draws it or asks where its frames are.

A structure supplies its tree and the values of its coordinates; nothing here knows which structure it is.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, NamedTuple

Vector3 = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]  # x, y, z, w
Line = Sequence[Vector3]  # points [m]
UPRIGHT: Quaternion = (0.0, 0.0, 0.0, 1.0)
AXES: Mapping[str, Vector3] = {'x': (1.0, 0.0, 0.0), 'y': (0.0, 1.0, 0.0), 'z': (0.0, 0.0, 1.0)}
NOWHERE: Mapping[str, Vector3] = MappingProxyType({})


@dataclass(frozen=True)
class Box:
    """A box that stands for a link in pictures: edges and centre [m], colour as ``#rrggbb``."""

    size: Vector3
    centre: Vector3
    colour: str


@dataclass(frozen=True)
class Link:
    """A rigid part; `mass` [kg] and `inertia` (I_xx, I_yy, I_zz) [kg m^2] about its origin, zero where it has none."""

    name: str
    box: Box | None = None
    mass: float = 0.0
    inertia: Vector3 = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Motion:
    """What a joint allows: along or about an axis, within limits (SI units), with viscous damping."""

    coordinate: str
    revolute: bool
    axis: Vector3
    lower: float
    upper: float
    effort: float
    velocity: float
    damping: float


@dataclass(frozen=True)
class Joint:
    """A child's frame in its parent's: at `origin` [m] and parallel to it while the coordinate is zero.

    A `free` one is wherever it is said to be in a pose, parallel to its parent: such as the end of a wire.
    """

    parent: str
    child: str
    origin: Vector3
    motion: Motion | None = None  # None: fixed
    free: bool = False


@dataclass(frozen=True)
class LinkTree:
    """The links of a structure, the root first, and the joints between them."""

    name: str
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]


@dataclass(frozen=True)
class Drawing:
    """How a structure is drawn, in metres, in the frame `base`.

    Attributes
    ----------
    wires : callable
        ``wires(q, p)`` returns the points (x, y, z) of every wire, from its fixed end on, for the `q` and `p` of `lengths`.
    bodies : callable, optional
        ``bodies(q, p)`` returns the lines of everything else; without it, a line that joins the ends of the wires.
    origin : callable, optional
        ``origin(p)`` is where the frame `end` is while all coordinates are zero; without it, in the origin of `base`. Of
        segments in series, the end of each in that of the one before.
    """

    wires: Callable[[Any, Any], Sequence[Line]]
    bodies: Callable[[Any, Any], Sequence[Line]] | None = None
    origin: Callable[[Any], Vector3] | None = None


class Transform(NamedTuple):
    """The pose of a child's frame in its parent's [m, unit quaternion]."""

    parent: str
    child: str
    translation: Vector3
    rotation: Quaternion


def transform_of(joint: Joint, q: float = 0.0) -> Transform:
    """Where a joint's child is at the coordinate q [m or rad]."""
    x, y, z = joint.origin
    motion = joint.motion
    if motion is None:
        return Transform(joint.parent, joint.child, joint.origin, UPRIGHT)
    a, b, c = motion.axis
    if motion.revolute:
        sine = math.sin(0.5 * q)
        return Transform(joint.parent, joint.child, joint.origin, (a * sine, b * sine, c * sine, math.cos(0.5 * q)))
    return Transform(joint.parent, joint.child, (x + a * q, y + b * q, z + c * q), UPRIGHT)


def moving_transforms(tree: LinkTree, q: Mapping[str, float], places: Mapping[str, Vector3] = NOWHERE) -> list[Transform]:
    """Transforms of the joints that move, at the coordinates q by name [m or rad]; of free ones by `places` [m]."""
    moving = [transform_of(joint, q[joint.motion.coordinate]) for joint in tree.joints if joint.motion is not None]
    free = [joint for joint in tree.joints if joint.free and joint.child in places]
    return moving + [Transform(joint.parent, joint.child, places[joint.child], UPRIGHT) for joint in free]


def fixed_transforms(tree: LinkTree) -> list[Transform]:
    """Transforms of the joints that do not."""
    return [transform_of(joint) for joint in tree.joints if joint.motion is None and not joint.free]
