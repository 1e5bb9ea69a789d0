"""Structures as markers for RViz and Foxglove: lines, wires in the colour of their mode."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Pose, Vector3
from numpy.typing import NDArray
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from sma_sim.model.config import Config
from sma_sim.model.parameters import BeamConstants, beam_constants
from sma_sim.model.structures.beam_links import BASE_FRAME, PLATE_THICKNESS
from sma_sim.model.structures.drawing import Sketch
from sma_sim.model.structures.geometry import shape_of
from sma_sim.model.structures.module import STRUCTURE as MODULE
from sma_sim.report.palette import MODE_COLOURS
from sma_sim.ros.messages import Messages
from sma_sim.solver.columns import sample_columns

Points = Iterable[Sequence[float]]
Picture = Callable[[Time, NDArray[Any], Sequence[int]], MarkerArray]  # of a stamp, a row of samples and the modes
POSE = sample_columns(MODULE).pose
BEAM_POINTS = 21
BEAM_COLOUR, PLATE_COLOUR = '#444444', '#000000'
WIRE_WIDTH = 1e-3  # [m], drawn thicker than a wire is
BODY_WIDTH = 0.02  # of other lines, relative to the length of a wire


def colour_from(code: str) -> ColorRGBA:
    """A colour from ``#rrggbb``."""
    red, green, blue = (int(code[k : k + 2], 16) / 255.0 for k in (1, 3, 5))
    return ColorRGBA(r=red, g=green, b=blue, a=1.0)


MODE_RGBA = {mode: colour_from(code) for mode, code in MODE_COLOURS.items()}


def line_marker(header: Header, number: int, name: str, line: Points, width: float, rgba: ColorRGBA) -> Marker:
    """One line."""
    marker = Marker(header=header, ns=name, id=number, type=Marker.LINE_STRIP, action=Marker.ADD, color=rgba)
    marker.pose = Pose()
    marker.scale = Vector3(x=width)
    marker.points = [Point(**dict(zip('xyz', point, strict=False))) for point in line]
    return marker


def markers(stamp: Time, frame: str, row: NDArray[Any], modes: Sequence[int], beam: BeamConstants, h: float) -> MarkerArray:
    """The module in the true pose of a row of samples; `h` is the beam's radius [m]."""
    header = Header(stamp=stamp, frame_id=frame)
    U_x, U_y, alpha = row[POSE].tolist()
    shape = shape_of(U_x, U_y, alpha, beam, BEAM_POINTS)
    lines = [
        line_marker(header, 0, 'beam', shape.beam.tolist(), 2.0 * h, colour_from(BEAM_COLOUR)),
        line_marker(header, 1, 'plate', shape.plate.tolist(), PLATE_THICKNESS, colour_from(PLATE_COLOUR)),
    ]
    for i, (wire, mode) in enumerate(zip(shape.wires, modes, strict=True)):
        lines.append(line_marker(header, 2 + i, f'wire_{i + 1}', wire.tolist(), WIRE_WIDTH, MODE_RGBA[mode]))
    return MarkerArray(markers=lines)


def picture_of(config: Config, frame_prefix: str, made: Messages) -> Picture:
    """What draws a structure with these parameters from samples, which `made` reads."""
    frame = frame_prefix + BASE_FRAME
    if config.structure is MODULE:
        beam, h = beam_constants(config.parameters), config.parameters['beam.h']
        return lambda stamp, row, modes: markers(stamp, frame, row, modes, beam, h)
    sketch = Sketch(config.structure, config.parameters)

    def draw(stamp: Time, row: NDArray[Any], modes: Sequence[int]) -> MarkerArray:
        header = Header(stamp=stamp, frame_id=frame)
        lines = sketch.lines(made.coordinates(row), made.wire_values(row, 'length'))
        rgba, width = colour_from(PLATE_COLOUR), BODY_WIDTH * sketch.scale
        drawn = [line_marker(header, k, f'body_{k + 1}', line, width, rgba) for k, line in enumerate(lines.bodies)]
        for i, (wire, mode) in enumerate(zip(lines.wires, modes, strict=True)):
            drawn.append(line_marker(header, len(lines.bodies) + i, f'wire_{i + 1}', wire, WIRE_WIDTH, MODE_RGBA[mode]))
        return MarkerArray(markers=drawn)

    return draw
