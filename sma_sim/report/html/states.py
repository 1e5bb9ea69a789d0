"""Section: the residual over the model's states, as density maps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.residual_analysis.state_density import StateDensity
from sma_sim.report.html.figures import new_figure, small
from sma_sim.report.html.page import Block, Grid, Paragraph, Plot, Section, Tabs
from sma_sim.report.palette import RED

DENSITY_COLOURS = [[0.0, '#ffffff'], [0.02, '#e6eef6'], [0.3, '#9dbfdd'], [0.65, '#3d7fb5'], [1.0, '#0b3c66']]
DENSITY_WORDS = (
    'Residual (measured - model, in units of the noise) of all runs over what the model says at the same instant; '
    'darker: more samples. The line is the mean: where it leaves 0 the model has an error that depends on this state.'
)


def states_section(densities: Mapping[str, Sequence[StateDensity]]) -> Section:
    """A tab per channel, a map per state."""
    tabs: list[tuple[str, list[Block]]] = [
        (channel, [Grid([Plot(density_map(density), height=260) for density in found])])
        for channel, found in densities.items()
    ]
    return Section('Residual over state', [Paragraph(DENSITY_WORDS), Tabs(tabs)])


def density_map(density: StateDensity) -> object:
    """Density of the residual over one state, with its mean."""
    figure = new_figure()
    figure.add_heatmap(
        x=small(density.state),
        y=small(density.residual),
        z=shades(np.log1p(density.counts)),
        colorscale=DENSITY_COLOURS,
        showscale=False,
        hovertemplate='%{x:.4g}, %{y:.2f} x noise<extra></extra>',
    )
    figure.add_scatter(
        x=small(density.mean_state),
        y=small(density.mean),
        mode='lines',
        line={'color': RED, 'width': 2},
        name='mean',
        hovertemplate='mean %{y:.2f} x noise at %{x:.4g}<extra></extra>',
    )
    figure.update_layout(showlegend=False, margin={'l': 46, 'r': 8, 't': 12, 'b': 42})
    figure.update_xaxes(title_text=density.label, showgrid=False)
    figure.update_yaxes(title_text='residual / noise', showgrid=False)
    return figure


def shades(values: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Values from 0 up as the shades that a screen can show."""
    found: NDArray[np.uint8] = np.rint(255.0 * values / values.max()).astype(np.uint8)
    return found
