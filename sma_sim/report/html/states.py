"""Section: the residual over the model's states, as density maps."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.residual_analysis.compare import Comparison
from sma_sim.evidence.residual_analysis.error_by_stratum import Samples, samples_of
from sma_sim.evidence.residual_analysis.wire_states import wires_of
from sma_sim.report.html.figures import new_figure, small
from sma_sim.report.html.page import Block, Grid, Paragraph, Plot, Section, Tabs
from sma_sim.report.palette import RED

Vector = NDArray[np.float64]
ACROSS, UP = 56, 40  # cells of a map
COLOURS = [[0.0, '#ffffff'], [0.02, '#e6eef6'], [0.3, '#9dbfdd'], [0.65, '#3d7fb5'], [1.0, '#0b3c66']]
LEAST = 5  # samples in a column of which a mean is drawn


def states_section(comparison: Comparison) -> Section:
    """A tab per channel, a map per state."""
    states = states_of(comparison)
    tabs: list[tuple[str, list[Block]]] = []
    for channel in comparison.channels:
        samples = samples_of(comparison, channel)
        maps = [Plot(state_map(samples, values, label), height=260) for label, values in states]
        tabs.append((channel, [Grid(maps)]))
    words = (
        'Residual (measured - model, in units of the noise) of all runs over what the model says at the same instant; '
        'darker: more samples. The line is the mean: where it leaves 0 the model is wrong in a way that this state tells.'
    )
    return Section('Residual over state', [Paragraph(words), Tabs(tabs)])


def states_of(comparison: Comparison) -> list[tuple[str, Vector]]:
    """Labels and values of the states over all runs joined; those that do not change are left out."""
    columns: list[tuple[str, str, float]] = []
    for suffix, wire in wires_of(comparison.config).items():
        columns += [
            (f'temperature of {wire} [K]', f'T{suffix}_K', 1.0), (f'strain of {wire} [%]', f'strain{suffix}', 100.0),
            (f'x_M of {wire} [-]', f'x_M{suffix}', 1.0),
        ]  # fmt: skip
    columns.append(('J_eq [W]', 'J_eq_W', 1.0) if comparison.config.system == 'module' else ('power J [W]', 'J_W', 1.0))
    found = [
        (label, factor * np.concatenate([run.states[name] for run in comparison.runs])) for label, name, factor in columns
    ]
    return [(label, values) for label, values in found if np.ptp(values) > 0.0]


def shades(values: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Values from 0 up as the shades that a screen can show."""
    shade: NDArray[np.uint8] = np.rint(255.0 * values / values.max()).astype(np.uint8)
    return shade


def state_map(samples: Samples, values: Vector, label: str) -> object:
    """Density of the residual over one state."""
    state, residual = values[samples.place], samples.scaled
    reach = max(3.0, 1.1 * float(np.quantile(np.abs(residual), 0.998)))
    inside = np.clip(residual, -reach, reach)
    edges = np.linspace(state.min(), state.max(), ACROSS + 1), np.linspace(-reach, reach, UP + 1)
    density, _, _ = np.histogram2d(state, inside, bins=edges)
    middle_x, middle_y = (0.5 * (one[1:] + one[:-1]) for one in edges)
    column = np.clip(np.searchsorted(edges[0], state, side='right') - 1, 0, ACROSS - 1)
    count = np.bincount(column, minlength=ACROSS)
    enough = count >= LEAST
    mean = np.bincount(column, residual, ACROSS)[enough] / count[enough]
    figure = new_figure()
    figure.add_heatmap(
        x=small(middle_x), y=small(middle_y), z=shades(np.log1p(density.T)), colorscale=COLOURS, showscale=False,
        hovertemplate='%{x:.4g}, %{y:.2f} x noise<extra></extra>',
    )  # fmt: skip
    figure.add_scatter(
        x=small(middle_x[enough]), y=small(mean), mode='lines', line={'color': RED, 'width': 2}, name='mean',
        hovertemplate='mean %{y:.2f} x noise at %{x:.4g}<extra></extra>',
    )  # fmt: skip
    figure.update_layout(showlegend=False, margin={'l': 46, 'r': 8, 't': 12, 'b': 42})
    figure.update_xaxes(title_text=label, showgrid=False)
    figure.update_yaxes(title_text='residual / noise', showgrid=False)
    return figure
