"""The reduction of the error as a picture: normalized RMSE from the nominal model through each added effect."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from sma_sim.report.palette import BLUE, GREY, RED
from sma_sim.report.style import plain_axes, sized_figure

TICKS = tuple(step * decade for decade in (1e-6, 1e-5, 1e-4, 1e-3, 0.01, 0.1, 1, 10, 100, 1000) for step in (1, 2, 5))


def draw_error_reduction(steps: Sequence[Mapping[str, Any]]) -> Figure:
    """`steps`: the `error` of a verdict (effects, model, train, held_out)."""
    figure = sized_figure(6.4, 3.6)
    axis = figure.subplots()
    plain_axes(axis)
    positions = np.arange(len(steps))
    for name, label, colour in (('train', 'fitted runs', BLUE), ('held_out', 'held-out runs', RED)):
        values = [np.nan if step[name] is None else float(step[name]) for step in steps]
        axis.plot(positions, values, 'o-', color=colour, label=label)
        for position, value in zip(positions, values, strict=True):
            if name == 'held_out' and np.isfinite(value):
                axis.annotate(f'{value:.2f}', (float(position), value), (8, 6), textcoords='offset points', color=colour)
    axis.axhline(1.0, color=GREY, ls=':', label='noise')
    axis.set_yscale('log')
    axis.minorticks_off()
    known = [float(step[name]) for step in steps for name in ('train', 'held_out') if step[name]]
    low, high = 0.85 * min(1.0, *known), 1.4 * max(2.0, *known)
    ticks = [tick for tick in TICKS if low <= tick <= high]
    axis.set_yticks(ticks, [f'{tick:g}' for tick in ticks])
    axis.set_ylim(low, high)
    axis.set_xlim(-0.3, len(steps) - 0.5)
    axis.set_xticks(positions, [added_by(step, before) for step, before in zip(steps, [None, *steps], strict=False)])
    axis.set_ylabel('normalized RMSE')
    axis.legend(frameon=False)
    return figure


def added_by(step: Mapping[str, Any], before: Mapping[str, Any] | None) -> str:
    """What a step has that the one before has not."""
    if before is not None and len(step.get('differences', ())) > len(before.get('differences', ())):
        return 'recordings differ'
    return f'+ {step["effects"][-1]}' if step['effects'] else 'nominal model'
