"""Links and joints of a structure: a tree from one root, for whoever draws it or asks where its frames are.

A structure supplies its tree and the values of its coordinates; nothing here knows which structure it is.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

Vector3 = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]  # x, y, z, w


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
    """A child's frame in its parent's: at `origin` [m] and parallel to it while the coordinate is zero."""

    parent: str
    child: str
    origin: Vector3
    motion: Motion | None = None  # None: fixed


@dataclass(frozen=True)
class LinkTree:
    """The links of a structure, the root first, and the joints between them."""

    name: str
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]


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
        return Transform(joint.parent, joint.child, joint.origin, (0.0, 0.0, 0.0, 1.0))
    a, b, c = motion.axis
    if motion.revolute:
        sine = math.sin(0.5 * q)
        return Transform(joint.parent, joint.child, joint.origin, (a * sine, b * sine, c * sine, math.cos(0.5 * q)))
    return Transform(joint.parent, joint.child, (x + a * q, y + b * q, z + c * q), (0.0, 0.0, 0.0, 1.0))


def moving_transforms(tree: LinkTree, q: Mapping[str, float]) -> list[Transform]:
    """Transforms of the joints that move, at the coordinates q by name [m or rad]."""
    return [transform_of(joint, q[joint.motion.coordinate]) for joint in tree.joints if joint.motion is not None]


def fixed_transforms(tree: LinkTree) -> list[Transform]:
    """Transforms of the joints that do not."""
    return [transform_of(joint) for joint in tree.joints if joint.motion is None]
