"""How all figures look: size, grid, mode bands."""

from __future__ import annotations

import io
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Literal

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure, FigureBase
from matplotlib.patches import Patch

from sma_sim.model.arrays import Vector
from sma_sim.model.errors import UserError
from sma_sim.model.files import whole_file
from sma_sim.report.palette import MODE_COLOURS, MODE_NAMES

DPI = 120
LegendPosition = Literal['outside lower center', 'outside upper center']


class NotebookFigure(Figure):
    """A figure that a notebook shows although no window was asked for."""

    def _repr_png_(self) -> bytes:
        written = io.BytesIO()
        self.savefig(written, format='png', dpi=DPI)
        return written.getvalue()


def sized_figure(width: float, height: float) -> Figure:
    """An empty figure of this size [inch], drawn without a screen."""
    figure = NotebookFigure(figsize=(width, height), layout='constrained')
    FigureCanvasAgg(figure)
    return figure


def axes_of(figure: Figure, rows: int, heights: list[float] | None = None) -> list[Any]:
    """Axes below each other that share their time."""
    axes = figure.subplots(rows, 1, sharex=True, height_ratios=heights, squeeze=False)[:, 0]
    for axis in axes:
        plain_axes(axis)
    return list(axes)


def plain_axes(axis: Any) -> None:
    """Light grid, no box."""
    axis.grid(color='#dddddd', linewidth=0.6)
    axis.set_axisbelow(True)
    axis.spines[['top', 'right']].set_visible(False)


def draw_modes(axis: Any, time: Vector, modes: dict[str, Vector]) -> None:
    """Bands of the active mode, a row per wire; a gap (NaN) goes on as the mode before it."""
    used: set[int] = set()
    for row, with_gaps in enumerate(modes.values()):
        known = np.flatnonzero(np.isfinite(with_gaps))
        mode, start = with_gaps[known].astype(int), time[known]
        edges = np.concatenate([[0], np.flatnonzero(np.diff(mode)) + 1])
        ends = np.concatenate([start[edges[1:]], time[-1:]])
        used |= set(mode.tolist())
        colours = [MODE_COLOURS.get(number, 'black') for number in mode[edges].tolist()]
        axis.barh(row, ends - start[edges], left=start[edges], height=0.8, color=colours, linewidth=0)
    axis.set_yticks(range(len(modes)), list(modes))
    axis.invert_yaxis()
    axis.grid(visible=False)
    mode_legend(axis.figure, used, 'outside lower center')


def mode_legend(figure: FigureBase, modes: Iterable[int], place: LegendPosition, title: str | None = None) -> None:
    """One legend of the colours of `modes` beside the axes: inside, long names would cover a label."""
    patches = [Patch(color=MODE_COLOURS[n], label=MODE_NAMES[n]) for n in sorted(modes) if n in MODE_NAMES]
    figure.legend(
        handles=patches, ncols=max(1, len(patches)), loc=place, frameon=False, fontsize=9, title=title, title_fontsize=9
    )


def save(figure: Figure, path: Path) -> None:
    """Write a PNG, SVG or PDF, whole or not at all. Raises UserError."""
    if path.suffix.lower() not in ('.png', '.svg', '.pdf'):
        raise UserError(f'{path}: expected a name that ends in .png, .svg or .pdf')
    with whole_file(path) as temporary:
        figure.savefig(temporary, dpi=DPI)
