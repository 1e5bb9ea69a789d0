"""How all interactive figures look, and how much of a long series they carry."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sma_sim.model.arrays import Vector
from sma_sim.model.optional import require
from sma_sim.report.palette import BLUE, GREY, RED

MEASURED, SHOWN = GREY, BLUE
HELD_OUT = RED
GRID = '#e5e8ec'
NARROW, BROAD = 0.7, 3.0  # decades: below, ticks at equal steps; above, at the decades; between, at 1, 2 and 5 of each
FONT = {'family': 'system-ui, -apple-system, Segoe UI, Roboto, sans-serif', 'size': 12, 'color': '#1f2328'}


def new_figure(rows: int = 1, heights: Sequence[float] | None = None, gap: float = 0.02) -> Any:
    """An empty figure: `rows` of axes below each other that share their x axis."""
    graph_objects = require('plotly.graph_objects', 'a report')
    return graph_objects.Figure(empty_figure(rows, None if heights is None else tuple(heights), gap))


@cache
def empty_figure(rows: int, heights: tuple[float, ...] | None, gap: float) -> Any:
    """What `new_figure` copies: plotly takes ten times as long to make one as to copy it, and a page has a hundred."""
    subplots = require('plotly.subplots', 'a report')
    figure = subplots.make_subplots(
        rows=rows, cols=1, shared_xaxes=True, row_heights=None if heights is None else list(heights), vertical_spacing=gap
    )
    figure.update_layout(
        template='none',
        font=FONT,
        paper_bgcolor='white',
        plot_bgcolor='white',
        hovermode='closest',
        margin={'l': 58, 'r': 36, 't': 34, 'b': 44},
        hoverlabel={'font': {'size': 12}},
        modebar={'orientation': 'v'},
        legend={'orientation': 'h', 'x': 0, 'xanchor': 'left', 'y': 1.0, 'yanchor': 'bottom', 'font': {'size': 11}},
    )
    figure.update_xaxes(gridcolor=GRID, zeroline=False, linecolor=GREY, ticks='outside', tickcolor=GREY)
    figure.update_yaxes(gridcolor=GRID, zeroline=False, linecolor=GREY, title_standoff=6)
    return figure


def add_curve(
    figure: Any, curve: tuple[Any, Any], name: str, line: dict[str, Any], hover: str, row: int = 1, **more: Any
) -> None:
    """A line through x and y in one of the rows of axes; those of one name are switched together."""
    x, y = curve
    figure.add_scatter(
        **{'x': x, 'y': small(y), 'name': name, 'legendgroup': name, 'mode': 'lines', 'line': line, 'hovertemplate': hover},
        **more,
        row=row,
        col=1,
    )


def add_band(figure: Any, time: Vector, mean: Vector, reach: Vector, row: int, colour: str, **more: Any) -> None:
    """A band of `reach` on either side of a mean, in one of the rows of axes."""
    x = small(np.concatenate([time, time[::-1]]))
    y = small(np.concatenate([mean + reach, (mean - reach)[::-1]]))
    look = {'fill': 'toself', 'fillcolor': colour, 'mode': 'lines', 'line': {'width': 0}, 'hoverinfo': 'skip'}
    figure.add_scatter(x=x, y=y, **look, **more, row=row, col=1)


def signed_map(x: Sequence[str], y: Sequence[str], z: Any, reach: float, hover: str) -> Any:
    """A figure of values from -`reach` to `reach`, red to blue, by two names; the first of y is above."""
    figure, bar = new_figure(), {'thickness': 10, 'len': 0.9}
    figure.add_heatmap(
        x=x, y=y, z=z, zmin=-reach, zmax=reach, colorscale='RdBu', xgap=1, ygap=1, colorbar=bar, hovertemplate=hover
    )
    figure.update_xaxes(automargin=True, showgrid=False)
    figure.update_yaxes(automargin=True, showgrid=False, autorange='reversed')
    figure.update_layout(margin={'t': 12})
    return figure


def interval_bars(above: Sequence[float], below: Sequence[float], colour: str, **more: Any) -> dict[str, Any]:
    """How far intervals reach above values and below them, as plotly draws it."""
    return {'type': 'data', 'symmetric': False, 'color': colour, 'array': above, 'arrayminus': below, **more}


def log_axis(low: float, high: float) -> dict[str, Any]:
    """A logarithmic axis from `low` to `high` (both above 0), labelled such that several ticks have their number."""
    ends = [math.log10(low), math.log10(high)]
    decades = ends[1] - ends[0]
    ticks: dict[str, Any] = {'nticks': 6} if decades < NARROW else {'dtick': 'D2' if decades < BROAD else 1}
    return {'type': 'log', 'range': ends, 'tickformat': '~g', **ticks}


def small(values: Vector) -> NDArray[np.float32]:
    """Curves as a page carries them: no finer than a screen shows (`figure_json` packs them)."""
    return np.asarray(values, dtype=np.float32)


def envelope(values: Vector, most: int) -> NDArray[np.int64]:
    """Indices of at most `most` of the values (k,) that keep what a line through them looks like.

    Of every stretch the smallest and the largest are kept, so that no spike is lost; NaN are left out.
    """
    known = np.flatnonzero(np.isfinite(values))
    if len(known) <= most:
        return known
    edges = np.linspace(0, len(known), max(most // 2, 1) + 1).astype(int)
    chosen = [
        (first + int(np.argmin(values[known[first:last]])), first + int(np.argmax(values[known[first:last]])))
        for first, last in zip(edges[:-1], edges[1:], strict=True)
    ]
    found: NDArray[np.int64] = known[np.unique(np.array(chosen))]
    return found


def stretches(labels: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Where stretches of equal labels (k,) begin, and where each ends (the last one at k - 1)."""
    begin = np.concatenate([[0], np.flatnonzero(np.diff(labels)) + 1])
    return begin, np.append(begin[1:], len(labels) - 1)
