"""The module as markers for RViz and Foxglove: bent beam, plate, wires in the colour of their mode."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Pose, Vector3
from numpy.typing import NDArray
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from sma_sim.model.parameters import BeamConstants
from sma_sim.model.structures.beam_links import BASE_FRAME, PLATE_THICKNESS
from sma_sim.model.structures.geometry import shape_of
from sma_sim.report.palette import MODE_COLOURS
from sma_sim.ros.messages import WHERE
from sma_sim.ros.robot_frames import frame_prefix

BEAM_POINTS = 21
BEAM_COLOUR, PLATE_COLOUR = '#444444', '#000000'
WIRE_WIDTH = 1e-3  # [m], drawn thicker than a wire is


def colour_from(code: str) -> ColorRGBA:
    """A colour from ``#rrggbb``."""
    red, green, blue = (int(code[k : k + 2], 16) / 255.0 for k in (1, 3, 5))
    return ColorRGBA(r=red, g=green, b=blue, a=1.0)


MODE_RGBA = {mode: colour_from(code) for mode, code in MODE_COLOURS.items()}


def frame_of(namespace: str) -> str:
    """The frame of a node's markers: modules in several namespaces are told apart."""
    return frame_prefix(namespace) + BASE_FRAME


def line_marker(header: Header, number: int, name: str, line: NDArray[Any], width: float, rgba: ColorRGBA) -> Marker:
    """One line."""
    marker = Marker(header=header, ns=name, id=number, type=Marker.LINE_STRIP, action=Marker.ADD, color=rgba)
    marker.pose = Pose()
    marker.scale = Vector3(x=width)
    marker.points = [Point(x=x, y=y) for x, y in line.tolist()]
    return marker


def markers(stamp: Time, frame: str, row: NDArray[Any], modes: Sequence[int], beam: BeamConstants, h: float) -> MarkerArray:
    """The module in the true pose of a row of samples; `h` is the beam's radius [m]."""
    header = Header(stamp=stamp, frame_id=frame)
    U_x, U_y, alpha = row[WHERE.pose].tolist()
    shape = shape_of(U_x, U_y, alpha, beam, BEAM_POINTS)
    lines = [
        line_marker(header, 0, 'beam', shape.beam, 2.0 * h, colour_from(BEAM_COLOUR)),
        line_marker(header, 1, 'plate', shape.plate, PLATE_THICKNESS, colour_from(PLATE_COLOUR)),
    ]
    for i, (wire, mode) in enumerate(zip(shape.wires, modes, strict=True)):
        lines.append(line_marker(header, 2 + i, f'wire_{i + 1}', wire, WIRE_WIDTH, MODE_RGBA[mode]))
    return MarkerArray(markers=lines)
