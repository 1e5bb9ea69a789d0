"""Draw the module at a few instants of a run: `python examples/draw_module.py [module.png]`.

The bent beam with its plate and wires, deflections larger than they are, above its angle and its command over time.
"""

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

import sma_sim
from sma_sim.model.arrays import Vector
from sma_sim.model.parameters import BeamConstants
from sma_sim.model.structures.geometry import shape_of
from sma_sim.report.palette import BLUE, GREY, MODE_COLOURS, ORANGE
from sma_sim.report.style import mode_legend, plain_axes, save, sized_figure
from sma_sim.solver.inputs import inputs_at

ANGLE_SCALE = 3.0  # angles and deflections are drawn larger than they are


def draw_module(columns: Mapping[str, Vector], instants: Sequence[float], beam: BeamConstants) -> Figure:
    """Above the module at some instants [s], below its angle and its command over time."""
    figure = sized_figure(9.0, 6.0)
    parts: Any = figure.subfigures(2, 1, height_ratios=(2.0, 1.0))
    above, below = parts
    time = columns['time_s']
    shown: set[int] = set()
    poses = above.subplots(1, len(instants), squeeze=False)[0]
    for axis, instant in zip(poses, instants, strict=True):
        shown |= draw_pose(axis, columns, min(int(np.searchsorted(time, instant)), len(time) - 1), beam)
        axis.set_title(f't = {instant:g} s', fontsize=10)
    draw_angle_and_command(below.subplots(), columns, instants)
    title = f'wires by active mode; deflections drawn {ANGLE_SCALE:g} times larger'
    mode_legend(above, shown, 'outside upper center', title)
    return figure


def draw_angle_and_command(axis: Any, columns: Mapping[str, Vector], instants: Sequence[float]) -> None:
    """Angle and command over time, zero at the same height; the command is drawn lower so that it hides nothing."""
    time, alpha, J_eq = columns['time_s'], np.degrees(columns['alpha_rad']), columns['J_eq_W']
    plain_axes(axis)
    command = axis.twinx()
    command.plot(time, J_eq, color=ORANGE, drawstyle='steps-post')
    command.set_ylabel('J_eq [W]', color=ORANGE)
    command.spines['top'].set_visible(False)
    axis.plot(time, alpha, color=BLUE)
    axis.set_ylabel('alpha [deg]', color=BLUE)
    axis.set_xlabel('time [s]')
    axis.set_xlim(time[0], time[-1])
    for axes, values, room in ((axis, alpha, 1.15), (command, J_eq, 1.6)):
        limit = room * (np.abs(values).max() or 1.0)
        axes.set_ylim(-limit, limit)
    for instant in instants:
        axis.axvline(instant, color=GREY, lw=0.8, ls=':')


def draw_pose(axis: Any, columns: Mapping[str, Vector], k: int, beam: BeamConstants) -> set[int]:
    """The module in sample `k`, upright; the modes that its wires are in."""
    U_x, U_y, alpha = (float(columns[name][k]) for name in ('U_x_m', 'U_y_m', 'alpha_rad'))
    shape = shape_of(U_x, ANGLE_SCALE * U_y, ANGLE_SCALE * alpha, beam)

    def draw(line: Vector, colour: str, width: float) -> None:
        axis.plot(1e3 * line[:, 1], 1e3 * line[:, 0], color=colour, lw=width, solid_capstyle='butt')

    draw(shape.beam, '#444444', 5.0)
    modes = [int(columns[f'mode_{wire}'][k]) for wire in (1, 2)]
    for mode, wire in zip(modes, shape.wires, strict=True):
        draw(wire, MODE_COLOURS[mode], 2.5)
    draw(shape.plate, 'black', 4.0)
    axis.plot([-14, 14], [-1.5, -1.5], color='black', lw=4)
    axis.set_aspect('equal')
    axis.set_xlim(-28, 28)
    axis.set_ylim(-5, 108)
    axis.axis('off')
    return set(modes)


if __name__ == '__main__':
    command = sma_sim.module_input(times=[0, 2, 14, 26, 34], J_eq=[0, 14, -14, 0, 0])
    model = sma_sim.Model()
    run = sma_sim.simulate(model, command, 50)
    columns = inputs_at(command, run.time) | run.columns
    picture = Path(sys.argv[1] if len(sys.argv) > 1 else 'module.png')
    save(draw_module(columns, [1.0, 4.0, 13.0, 17.0, 25.0], model.constants), picture)
    print(picture)
