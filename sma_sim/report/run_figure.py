"""One run as a figure: pose, temperatures, forces, modes and command over time, or what an observer says of its wires."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from sma_sim.evidence.data.display_units import ZERO_CELSIUS
from sma_sim.evidence.data.recording import Recording
from sma_sim.model.arrays import Vector
from sma_sim.model.errors import UserError
from sma_sim.report.run_panels import COLOURS, MODE_COLUMN, WITH_LEGEND, Panel, is_held, panels_of
from sma_sim.report.style import axes_of, draw_modes, sized_figure

PANEL_HEIGHT = 1.4  # [inch]
EXPECTED = (
    'alpha_rad and other coordinates in m or rad, T_1_K, ..., F_1_N, ..., x_M_1, ..., mode_1, ..., J_eq_W, J_W, J_1_W, ..., '
    'T_E_K, T_K, stress_Pa, strain, x_M, mode'
)
INTERVAL = 1.96  # standard deviations
PANELS = (  # name and unit of columns; factor, offset and label of what is shown
    ('T', '_K', 1.0, -ZERO_CELSIUS, 'T [deg C]'),
    ('x_M', '', 1.0, 0.0, 'x_M [-]'),
    ('stress', '_Pa', 1e-6, 0.0, 'stress [MPa]'),
)


def draw_run(columns: Mapping[str, Vector], title: str = '') -> Figure:
    """A figure of the columns (names of the file contract, (k,) each) over ``time_s``; NaN is a gap. Raises UserError."""
    present = [name for name, column in columns.items() if np.isfinite(column).any()]
    panels = panels_of(present)
    modes = {
        f'wire {found.group(1) or ""}'.strip(): columns[name]
        for name in present
        if (found := re.fullmatch(MODE_COLUMN, name)) is not None
    }
    time = columns['time_s']
    if not panels and not modes:
        raise UserError(f'nothing to draw: expected some of the columns {EXPECTED}')
    if len(time) < 2 or (np.diff(time) < 0.0).any() or time[-1] == time[0]:
        raise UserError('column time_s: expected at least two rows, with times that increase')
    heights = [1.0] * len(panels) + [0.3 * len(modes)] * bool(modes)
    figure = sized_figure(9.0, 1.2 + PANEL_HEIGHT * sum(heights))
    axes = axes_of(figure, len(heights), heights)
    for axis, panel in zip(axes, panels, strict=False):
        draw_panel(axis, panel, columns)
    if modes:
        draw_modes(axes[-1], time, modes)
    axes[-1].set_xlabel('time [s]')
    axes[-1].set_xlim(time[0], time[-1])
    figure.align_ylabels(axes)
    if title:
        figure.suptitle(title, fontsize=11)
    return figure


def draw_panel(axis: Any, panel: Panel, columns: Mapping[str, Vector]) -> None:
    """The curves of one panel, their gaps joined."""
    for name, label, colour, factor, offset in panel.curves:
        known = np.isfinite(columns[name])
        style = {'drawstyle': 'steps-post'} if is_held(name) else {}
        values = factor * columns[name][known] + offset
        axis.plot(columns['time_s'][known], values, color=colour, label=label, lw=1.3, **style)
    axis.set_ylabel(panel.label)
    if panel.label in WITH_LEGEND or len(panel.curves) > 1:
        panel_legend(axis)


def panel_legend(axis: Any) -> None:
    """The names of the curves, above the panel on the right: nothing is drawn there."""
    axis.legend(loc='lower right', bbox_to_anchor=(1.0, 0.94), frameon=False, fontsize=8, ncols=len(axis.lines))


def draw_observed(columns: Mapping[str, Vector], recording: Recording, title: str = '') -> Figure:
    """A figure of the columns of `observe_recording`, with measured temperatures as dots where there are any."""
    suffixes = [name.removeprefix('mode') for name in columns if name.startswith('mode')]
    time = columns['time_s']
    figure = sized_figure(9.0, 7.2)
    axes = axes_of(figure, 5, [1.0, 1.0, 1.0, 0.6, 0.3 * len(suffixes)])
    for axis, (name, unit, factor, offset, label) in zip(axes, PANELS, strict=False):
        for k, suffix in enumerate(suffixes):
            colour = COLOURS[k % len(COLOURS)]
            mean = factor * columns[f'{name}{suffix}{unit}'] + offset
            half = INTERVAL * factor * columns[f'{name}{suffix}_std{unit}']
            axis.fill_between(time, mean - half, mean + half, color=colour, alpha=0.25, linewidth=0)
            axis.plot(time, mean, color=colour, lw=1.3, label=f'wire {suffix[1:]}'.strip())
            measured = recording.channels.get(f'{name}{suffix}')
            if measured is not None:
                axis.plot(
                    recording.time, factor * measured + offset, '.', color='black', ms=2.0, label='_' * (k > 0) + 'measured'
                )
        axis.set_ylabel(label)
        panel_legend(axis)
    for name, values in columns.items():
        if name.startswith('J'):
            axes[3].plot(time, values, lw=1.3, drawstyle='steps-post', label=name.removesuffix('_W'))
    axes[3].set_ylabel('J [W]')
    draw_modes(axes[4], time, {f'wire {suffix[1:]}'.strip(): columns[f'mode{suffix}'] for suffix in suffixes})
    axes[4].set_xlabel('time [s]')
    axes[4].set_xlim(time[0], time[-1])
    figure.align_ylabels(axes)
    if title:
        figure.suptitle(f'{title}: estimates, 95 % intervals', fontsize=11)
    return figure
