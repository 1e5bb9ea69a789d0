"""Section: the loops that hysteresis draws, measured and model."""

from __future__ import annotations

import numpy as np

from sma_sim.evidence.data.display_units import DISPLAY_UNITS, ZERO_CELSIUS
from sma_sim.evidence.residual_analysis.compare import ComparedRun, Comparison
from sma_sim.model.structures.structure import Structure
from sma_sim.report.html.figures import MEASURED, SHOWN, add_curve, new_figure, small
from sma_sim.report.html.page import Grid, Paragraph, Plot, Section

MAX_LOOP_RUNS = 24
MAX_LOOP_POINTS = 1000
# By system: what is drawn over what (a state's column, its factor, its label, the least range).
LOOPS = {
    'module': (('alpha', 'J_eq_W', 1.0, 'J_eq [W]', 0.0),),
    'wire': (
        ('stress', 'strain', 100.0, 'strain [%]', 0.0),
        ('stress', 'T_K', 1.0, 'temperature of the model [deg C]', 3.0),
    ),
}


def hysteresis_section(comparison: Comparison) -> Section:
    """A figure per run and loop."""
    plots = [
        Plot(loop_figure(run, loop), run.name + (' (held out)' if run.held_out else ''), 300)
        for run in comparison.runs[:MAX_LOOP_RUNS]
        for loop in LOOPS.get(comparison.config.system, loops_of(comparison.config.structure.structure))
        if loop[0] in run.measured and np.ptp(run.states[loop[1]]) > loop[4]
    ]
    if not plots:
        return Section('Hysteresis', [])
    words = 'Measured (grey) and model (blue).'
    if len(comparison.runs) > MAX_LOOP_RUNS:
        words += f' The first {MAX_LOOP_RUNS} of {len(comparison.runs)} runs.'
    return Section('Hysteresis', [Paragraph(words), Grid(plots)])


def loops_of(structure: Structure) -> tuple[tuple[str, str, float, str, float], ...]:
    """The loops of a structure: every coordinate over the first command."""
    command = structure.commands[0]
    return tuple((c.name, f'{command}_W', 1.0, f'{command} [W]', 0.0) for c in structure.coordinates)


def loop_figure(run: ComparedRun, loop: tuple[str, str, float, str, float]) -> object:
    """One loop."""
    channel, column, scale, label, _ = loop
    unit, factor = DISPLAY_UNITS[channel]
    known = np.flatnonzero(np.isfinite(run.measured[channel]))
    at = known[:: -(-len(known) // MAX_LOOP_POINTS)]
    x = small(scale * run.states[column][at] - (ZERO_CELSIUS if column.endswith('_K') else 0.0))
    figure = new_figure()
    for name, values, colour, width in (
        ('measured', run.measured[channel], MEASURED, 2.2),
        ('model', run.predicted[channel], SHOWN, 1.3),
    ):
        hover, line = f'%{{y:.4g}} {unit} at %{{x:.4g}}', {'color': colour, 'width': width}
        add_curve(figure, (x, factor * values[at]), name, line, hover)
    figure.update_layout(margin_r=10)
    figure.update_xaxes(title_text=label)
    figure.update_yaxes(title_text=f'{channel} [{unit}]')
    return figure
