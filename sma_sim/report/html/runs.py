"""Section: every run, measured against model, with residuals, command and the mode bands of each wire beneath."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.data.display_units import DISPLAY_UNITS
from sma_sim.evidence.residual_analysis.compare import ComparedRun, Comparison
from sma_sim.evidence.residual_analysis.summary import Summary
from sma_sim.evidence.residual_analysis.wire_states import RESTING, wires_of
from sma_sim.model.structures.structure import Structure
from sma_sim.report.html.figures import MEASURED, SHOWN, add_curve, envelope, new_figure, small, stretches
from sma_sim.report.html.page import Block, Paragraph, Plot, Section, Tabs
from sma_sim.report.palette import MODE_COLOURS, MODE_NAMES, ORANGE

BYTES = 500_000  # of the curves of all runs: a page stays below 3 MB
MAX_TABS = 30  # in the page
PER_POINT = 11  # bytes of one point: time, measured, model and residual, packed
MAX_RUN_POINTS, MIN_RUN_POINTS = 1600, 300  # per channel and run
VALUE_ROW, RESIDUAL_ROW, INPUT_ROW, MODE_ROW = 105, 58, 62, 26  # heights [px]


def runs_section(summary: Summary) -> Section:
    """A tab per run."""
    comparison, runs = summary.comparison, runs_to_show(summary)
    points = BYTES // (PER_POINT * len(runs) * len(comparison.channels))
    points = int(np.clip(points, MIN_RUN_POINTS, MAX_RUN_POINTS))
    tabs: list[tuple[str, list[Block]]] = [
        (run.name + (' (held out)' if run.held_out else ''), [run_plot(comparison, run, points)]) for run in runs
    ]
    words = (
        'Measured (grey) against model (blue); below each the residual, measured - model, in units of the noise (the band '
        'is +-2). At the bottom the active mode of each wire in the model. Drag to zoom, double-click to go back; the '
        'legend switches curves off.'
    )
    if len(runs) < len(comparison.runs):
        words += f' These are the {len(runs)} of {len(comparison.runs)} runs with the largest error.'
    return Section('Measured against model', [Paragraph(words), Tabs(tabs)])


def runs_to_show(summary: Summary) -> list[ComparedRun]:
    """All runs, or those with the largest normalized RMSE, in the order of the dataset."""
    runs = summary.comparison.runs
    least = sorted((summary.run_error(run.name) for run in runs), reverse=True)[:MAX_TABS][-1]
    return [run for run in runs if summary.run_error(run.name) >= least]


def structure_of(comparison: Comparison, run: ComparedRun) -> Structure:
    """The structure of a run: that of the model, on the bench of the run."""
    own = comparison.config.structure
    return comparison.config.on_bench(run.system).structure if run.system else own


def input_curves(structure: Structure) -> list[tuple[str, str, float, str]]:
    """Column, label, factor and unit of what is imposed and of every heating command."""
    imposed = [(drive.column, drive.name, 1.0, drive.unit) for drive in structure.drives]
    imposed = [
        (column, name, 100.0, '%') if unit == '-' else (column, name, factor, unit) for column, name, factor, unit in imposed
    ]
    return [*imposed, *((f'{name}_W', name, 1.0, 'W') for name in structure.commands)]


def run_plot(comparison: Comparison, run: ComparedRun, points: int) -> Plot:
    """One run."""
    channels = [name for name in comparison.channels if name in run.measured and np.isfinite(run.measured[name]).any()]
    commands = [column for column in input_curves(structure_of(comparison, run)) if np.ptp(run.states[column[0]]) > 0.0]
    wires = wires_of(comparison.config)
    heights = [VALUE_ROW, RESIDUAL_ROW] * len(channels) + [INPUT_ROW] * len(commands) + [MODE_ROW * len(wires)]
    total = sum(heights)
    figure = new_figure(len(heights), [height / total for height in heights], gap=10 / (total + 10 * len(heights)))
    for k, channel in enumerate(channels):
        draw_channel(figure, run, channel, 2 * k + 1, points)
    for k, (column, label, factor, unit) in enumerate(commands):
        row = 2 * len(channels) + 1 + k
        draw_input(figure, run, column, factor, row)
        figure.update_yaxes(title_text=f'{label} [{unit}]', row=row, col=1)
    draw_mode_bars(figure, run, wires, len(heights))
    figure.update_xaxes(title_text='time [s]', row=len(heights), col=1)
    figure.update_layout(barmode='overlay', bargap=0.15)
    figure.update_xaxes(range=[float(run.time[0]), float(run.time[-1])])
    figure.update_yaxes(title_font_size=11, tickfont_size=10, nticks=5)
    return Plot(figure, height=int(total + 10 * len(heights) + 90))


def draw_channel(figure: Any, run: ComparedRun, channel: str, row: int, points: int) -> None:
    """Measured, model and residual of one channel in two rows."""
    unit, factor = DISPLAY_UNITS[channel]
    at = envelope(run.residual(channel), points)
    time, first = small(run.time[at]), row == 1
    curves = (('measured', run.measured[channel], MEASURED, 2.2), ('model', run.predicted[channel], SHOWN, 1.2))
    for name, values, colour, width in curves:
        hover, line = f'%{{y:.4g}} {unit} at %{{x:.2f}} s', {'color': colour, 'width': width}
        add_curve(figure, (time, factor * values[at]), name, line, hover, row, showlegend=first)
    left, line = run.residual(channel)[at] / run.noise[channel], {'color': '#5b5f66', 'width': 1}
    add_curve(figure, (time, left), 'residual', line, '%{y:.2f} x noise at %{x:.2f} s', row + 1, showlegend=first)
    figure.add_hrect(y0=-2, y1=2, fillcolor=SHOWN, opacity=0.12, line_width=0, row=row + 1, col=1)
    figure.update_yaxes(title_text=f'{channel} [{unit}]', row=row, col=1)
    figure.update_yaxes(title_text='res.', row=row + 1, col=1)


def draw_input(figure: Any, run: ComparedRun, column: str, factor: float, row: int) -> None:
    """The input at the samples, only where it changes."""
    values = factor * run.states[column]
    held = column != 'strain'
    at = np.unique(np.concatenate(stretches(np.unique(values, return_inverse=True)[1]))) if held else envelope(values, 800)
    line, curve = {'color': ORANGE, 'width': 1.4, **({'shape': 'hv'} if held else {})}, (small(run.time[at]), values[at])
    add_curve(figure, curve, 'command', line, '%{y:.4g} at %{x:.2f} s', row, showlegend=False)


def draw_mode_bars(figure: Any, run: ComparedRun, wires: dict[str, str], row: int) -> None:
    """A band per wire; one trace per mode, so that the legend switches it."""
    names = {RESTING: 'at rest', **{mode: f'mode {name}' for mode, name in MODE_NAMES.items()}}
    colours = {RESTING: '#eceef1', **MODE_COLOURS}
    bars: dict[int, list[tuple[str, float, float]]] = {}
    for suffix, wire in wires.items():
        labels: NDArray[np.int64] = run.states[f'class{suffix}'].astype(np.int64)
        begin, end = stretches(labels)
        for first, last in zip(begin, end, strict=True):
            bars.setdefault(int(labels[first]), []).append((wire, float(run.time[first]), float(run.time[last])))
    for mode in sorted(bars):
        rows, starts, ends = zip(*bars[mode], strict=True)
        figure.add_bar(
            y=list(rows),
            base=small(np.array(starts)),
            x=small(np.array(ends) - np.array(starts)),
            orientation='h',
            name=names[mode],
            marker={'color': colours[mode], 'line': {'width': 0}},
            row=row,
            col=1,
            hovertemplate=f'{names[mode]}, from %{{base:.2f}} s for %{{x:.2f}} s',
        )
    figure.update_yaxes(categoryorder='array', categoryarray=list(wires.values())[::-1], showgrid=False, row=row, col=1)
