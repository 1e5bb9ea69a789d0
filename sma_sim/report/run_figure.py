"""One run as a figure: pose, temperatures, forces, mode bands and command over time, whatever of them there is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from sma_sim.model.errors import UserError
from sma_sim.report.palette import BLUE, GREEN, GREY, ORANGE, RED
from sma_sim.report.style import axes_of, draw_modes, sized_figure

Vector = NDArray[np.float64]
FREEZING = 273.15
PANEL_HEIGHT = 1.4  # [inch]


class Panel(NamedTuple):
    """What one panel shows: its axis label, and columns with label, colour, factor and offset."""

    label: str
    curves: Sequence[tuple[str, str, str, float, float]]


PANELS = (
    Panel('alpha [deg]', (('alpha_rad', 'alpha', BLUE, 180.0 / np.pi, 0.0),)),
    Panel('U_y [mm]', (('U_y_m', 'U_y', BLUE, 1e3, 0.0),)),
    Panel('U_x [mm]', (('U_x_m', 'U_x', GREEN, 1e3, 0.0),)),
    Panel(
        'T [deg C]',
        (
            ('T_1_K', 'wire 1', RED, 1.0, -FREEZING), ('T_2_K', 'wire 2', BLUE, 1.0, -FREEZING),
            ('T_K', 'wire', RED, 1.0, -FREEZING), ('T_E_K', 'ambient', GREY, 1.0, -FREEZING),
        ),
    ),
    Panel('force [N]', (('F_1_N', 'bundle 1', RED, 1.0, 0.0), ('F_2_N', 'bundle 2', BLUE, 1.0, 0.0))),
    Panel('stress [MPa]', (('stress_Pa', 'stress', BLUE, 1e-6, 0.0),)),
    Panel(
        'x_M [-]',
        (
            ('x_M_1', 'wire 1', RED, 1.0, 0.0), ('x_M_2', 'wire 2', BLUE, 1.0, 0.0),
            ('x_M', 'wire', BLUE, 1.0, 0.0),
        ),
    ),
    Panel('strain [%]', (('strain', 'strain', BLUE, 100.0, 0.0),)),
    Panel('J_eq [W]', (('J_eq_W', 'J_eq', ORANGE, 1.0, 0.0),)),
    Panel('J [W]', (('J_W', 'J of one wire', ORANGE, 1.0, 0.0),)),
)  # fmt: skip
MODE_COLUMNS = {'mode_1': 'wire 1', 'mode_2': 'wire 2', 'mode': 'wire'}
HELD = ('J_eq_W', 'J_W', 'T_E_K')
KNOWN = [curve[0] for panel in PANELS for curve in panel.curves] + list(MODE_COLUMNS)


def draw_run(columns: Mapping[str, Vector], title: str = '') -> Figure:
    """A figure of the columns (names of the file contract, (k,) each) over ``time_s``; NaN is a gap. Raises UserError."""
    present = {name for name, column in columns.items() if np.isfinite(column).any()}
    panels = [panel for panel in PANELS if present & {curve[0] for curve in panel.curves}]
    modes = {label: columns[name] for name, label in MODE_COLUMNS.items() if name in present}
    time = columns['time_s']
    if not panels and not modes:
        raise UserError(f'nothing to draw: expected some of the columns {", ".join(KNOWN)}')
    if len(time) < 2 or (np.diff(time) < 0.0).any() or time[-1] == time[0]:
        raise UserError('column time_s: expected at least two rows, with times that increase')
    heights = [1.0] * len(panels) + [0.3 * len(modes)] * bool(modes)
    figure = sized_figure(9.0, 1.2 + PANEL_HEIGHT * sum(heights))
    axes = axes_of(figure, len(heights), heights)
    for axis, panel in zip(axes, panels, strict=False):
        draw_panel(axis, panel, columns, present)
    if modes:
        draw_modes(axes[-1], time, modes)
    axes[-1].set_xlabel('time [s]')
    axes[-1].set_xlim(time[0], time[-1])
    figure.align_ylabels(axes)
    if title:
        figure.suptitle(title, fontsize=11)
    return figure


def draw_panel(axis: Any, panel: Panel, columns: Mapping[str, Vector], present: Set[str]) -> None:
    """The curves of one panel, their gaps joined."""
    shown = [curve for curve in panel.curves if curve[0] in present]
    for name, label, colour, factor, offset in shown:
        known = np.isfinite(columns[name])
        style = {'drawstyle': 'steps-post'} if name in HELD else {}
        values = factor * columns[name][known] + offset
        axis.plot(columns['time_s'][known], values, color=colour, label=label, lw=1.3, **style)
    axis.set_ylabel(panel.label)
    if len(panel.curves) > 1:
        panel_legend(axis)


def panel_legend(axis: Any) -> None:
    """The names of the curves, above the panel on the right: nothing is drawn there."""
    axis.legend(loc='lower right', bbox_to_anchor=(1.0, 0.94), frameon=False, fontsize=8, ncols=len(axis.lines))
