"""Section: the fitted parameters with their intervals, and what the data cannot tell."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from sma_sim.evidence.estimation.calibrate import Calibration
from sma_sim.evidence.estimation.uncertainty import Interval, Uncertainty
from sma_sim.report.html.figures import log_axis, new_figure, small
from sma_sim.report.html.page import Block, Bullets, Paragraph, Plot, Section, Table
from sma_sim.report.palette import BLUE, GREY, ORANGE

MOST_RATIO = 3.0  # of an edge of an interval over the value: wider ones go beyond the figure
PARAMETER_HEADER = ('parameter', 'value', '95 % interval', 'unit', 'before', 'change')


def parameters_section(found: Calibration, before: Mapping[str, float]) -> Section:
    """Table, intervals as a figure, sentences on identifiability, correlations; `before`: values that were started from."""
    sure = found.uncertainty
    rows = [parameter_row(found, name, unit, before) for name, unit in fitted_names(found)]
    blocks: list[Block] = [Table(PARAMETER_HEADER, rows)]
    if sure is not None and sure.intervals:
        blocks.append(Plot(
            interval_figure(sure, before), 'Fitted value with its 95 % interval over the value before. Open orange marks: '
            'the data do not see this parameter alone; the bar shows how far the fit could go.',
            60 + 30 * len(sure.intervals),
        ))  # fmt: skip
    words = fit_remarks(found)
    blocks += [Paragraph('What these data cannot tell, and what else to know:'), Bullets(words)] if words else []
    if sure is not None and len(sure.intervals) > 1:
        blocks.append(Plot(correlation_figure(sure), 'Correlation of the estimates.', 130 + 26 * len(sure.intervals)))
    return Section('Parameters', blocks)


def fitted_names(found: Calibration) -> list[tuple[str, str]]:
    """Fitted parameters and their units."""
    return [(one.name, one.unit) for one in found.free]


def parameter_row(found: Calibration, name: str, unit: str, before: Mapping[str, float]) -> tuple[str, ...]:
    """One parameter."""
    known = {one.name: one for one in found.uncertainty.intervals} if found.uncertainty else {}
    value, first = found.values[name], before[name]
    one = known.get(name)
    interval = '' if one is None else f'{one.low:.5g} to {one.high:.5g}' if one.seen else 'not seen alone'
    change = f'{100.0 * (value / first - 1.0):+.1f} %' if first != 0.0 else f'{value - first:+.3g}'
    return name, f'{value:.5g}', interval, unit, f'{first:.5g}', change


def interval_figure(sure: Uncertainty, before: Mapping[str, float]) -> object:
    """Values and intervals over the (positive) values before, on a logarithmic axis."""
    told = [one for one in reversed(sure.intervals) if before[one.name] > 0.0 and one.value > 0.0]
    figure = new_figure()
    for seen, colour, symbol, name in ((True, BLUE, 'circle', 'seen'), (False, ORANGE, 'circle-open', 'not seen alone')):
        part = [(one, before[one.name]) for one in told if one.seen == seen]
        figure.add_scatter(
            x=[one.value / first for one, first in part], y=[one.name for one, _ in part], mode='markers', name=name,
            marker={'color': colour, 'symbol': symbol, 'size': 9},
            error_x={
                'type': 'data', 'symmetric': False, 'color': colour, 'thickness': 1.6,
                'array': [(one.high - one.value) / first for one, first in part],
                'arrayminus': [(one.value - max(one.low, 1e-3 * one.value)) / first for one, first in part],
            },
            hovertemplate='%{y}: x%{x:.4g}<extra></extra>',
        )  # fmt: skip
    figure.add_vline(x=1.0, line={'color': GREY, 'dash': 'dot'})
    reach = max((abs(np.log10(edge / before[one.name])) for one in told for edge in edges(one)), default=0.1)
    figure.update_xaxes(title_text='over the value before', **log_axis(10.0 ** (-1.1 * reach), 10.0 ** (1.1 * reach)))
    figure.update_yaxes(automargin=True, categoryorder='array', categoryarray=[one.name for one in told], type='category')
    return figure


def edges(one: Interval) -> tuple[float, ...]:
    """What must be in the figure: the value, and the interval unless it is very wide."""
    wide = not one.seen or one.high > MOST_RATIO * one.value or one.low * MOST_RATIO < one.value
    return (one.value,) if wide else (one.low, one.value, one.high)


def correlation_figure(sure: Uncertainty) -> object:
    """Correlation coefficients of the estimates."""
    names = [one.name for one in sure.intervals]
    figure = new_figure()
    figure.add_heatmap(
        x=names, y=names, z=small(np.array(sure.correlation)), zmin=-1, zmax=1, colorscale='RdBu', xgap=1, ygap=1,
        colorbar={'thickness': 10, 'len': 0.9}, hovertemplate='%{x}, %{y}: %{z:.2f}<extra></extra>',
    )  # fmt: skip
    figure.update_xaxes(automargin=True, showgrid=False, tickangle=-50)
    figure.update_yaxes(automargin=True, showgrid=False, autorange='reversed')
    figure.update_layout(margin={'t': 12})
    return figure


def fit_remarks(found: Calibration) -> list[str]:
    """What a person must know of a fit beside its numbers."""
    words = list(found.uncertainty.unseen) if found.uncertainty else []
    words += [f'{name} lies on a bound of the fit: the true value may be beyond it' for name in found.at_bound]
    words += [f'{one.name} was held: {one.reason}' for one in found.held]
    for one in found.other_starts:
        if not one.same:
            moved = ', '.join(f'{name} {value:.4g}' for name, value in one.values.items())
            words.append(f'another start ended at a cost higher by {one.excess:.3g}: {moved}')
    if found.cross_validation:
        scores = ', '.join(f'{model} {error:.3f}' for model, error in found.cross_validation.items())
        words.append(f'error over noise of runs left out in turn: {scores}; the {found.config.model} model was taken')
    side = 'later' if found.delay > 0.0 else 'earlier'
    words.append(f'the measurement is {1e3 * abs(found.delay):.3g} ms {side} than the model')
    if found.interrupted:
        words.append('the fit was stopped: these are the best values so far, not the optimum')
    return words
