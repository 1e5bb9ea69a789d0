"""What an observer says of a recording: temperatures, fractions and stresses of the wires with their 95 % intervals."""

from __future__ import annotations

from collections.abc import Mapping

from matplotlib.figure import Figure

from sma_sim.evidence.data.display_units import ZERO_CELSIUS
from sma_sim.evidence.data.recording import Recording
from sma_sim.model.arrays import Vector
from sma_sim.report.run_figure import panel_legend
from sma_sim.report.run_panels import COLOURS
from sma_sim.report.style import axes_of, draw_modes, sized_figure

INTERVAL = 1.96  # standard deviations
PANELS = (  # name and unit of columns; factor, offset and label of what is shown
    ('T', '_K', 1.0, -ZERO_CELSIUS, 'T [deg C]'),
    ('x_M', '', 1.0, 0.0, 'x_M [-]'),
    ('stress', '_Pa', 1e-6, 0.0, 'stress [MPa]'),
)


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
