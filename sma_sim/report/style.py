"""How all figures look: size, colours that colour-blind people tell apart, mode bands."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from sma_sim.model.errors import UserError

Vector = NDArray[np.float64]

# Okabe and Ito's colours
BLUE, ORANGE, GREEN, RED, GREY = '#0072B2', '#E69F00', '#009E73', '#D55E00', '#8c8c8c'
MODE_COLOURS = {1: '#CC79A7', 2: '#0072B2', 3: '#e3e3e3', 4: '#56B4E9', 5: '#E69F00'}
MODE_NAMES = {
    1: '1 austenite',
    2: '2 martensite',
    3: '3 inside the hysteresis',
    4: '4 to martensite',
    5: '5 to austenite',
}
DPI = 120


def new_figure(width: float, height: float) -> Figure:
    """An empty figure of this size [inch], drawn without a screen."""
    figure = Figure(figsize=(width, height), layout='constrained')
    FigureCanvasAgg(figure)
    return figure


def axes_of(figure: Figure, rows: int, heights: list[float] | None = None) -> list[Any]:
    """Axes below each other that share their time."""
    axes = figure.subplots(rows, 1, sharex=True, height_ratios=heights, squeeze=False)[:, 0]
    for axis in axes:
        plain(axis)
    return list(axes)


def plain(axis: Any) -> None:
    """Light grid, no box."""
    axis.grid(color='#dddddd', linewidth=0.6)
    axis.set_axisbelow(True)
    axis.spines[['top', 'right']].set_visible(False)


def draw_modes(axis: Any, time: Vector, modes: dict[str, Vector]) -> None:
    """Bands of the active mode, a row per wire."""
    used = set()
    for row, mode in enumerate(modes.values()):
        edges = np.flatnonzero(np.diff(mode)) + 1
        starts, ends = np.concatenate([[0], edges]), np.concatenate([edges, [len(mode) - 1]])
        for first, last in zip(starts, ends, strict=True):
            number = int(mode[first])
            used.add(number)
            axis.barh(row, time[last] - time[first], left=time[first], height=0.8, color=MODE_COLOURS.get(number, GREY))
    axis.set_yticks(range(len(modes)), list(modes))
    axis.invert_yaxis()
    axis.grid(visible=False)
    patches = [Patch(color=MODE_COLOURS[n], label=MODE_NAMES[n]) for n in sorted(used) if n in MODE_NAMES]
    axis.legend(handles=patches, ncols=3, loc='upper center', bbox_to_anchor=(0.5, -0.55), frameon=False, fontsize=8)


def save(figure: Figure, path: Path) -> None:
    """Write a PNG or SVG under a temporary name, then rename it. Raises UserError."""
    if path.suffix.lower() not in ('.png', '.svg', '.pdf'):
        raise UserError(f'{path}: expected a name that ends in .png, .svg or .pdf')
    temporary = path.with_name(f'.{path.stem}.part{path.suffix}')
    try:
        figure.savefig(temporary, dpi=DPI)
        temporary.replace(path)
    except OSError as error:
        raise UserError(f'cannot write {path}: {error.strerror}') from error
    finally:
        temporary.unlink(missing_ok=True)
