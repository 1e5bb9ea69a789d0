"""Section: the fitted parameters with their intervals, and what the data do not determine."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from sma_sim.evidence.estimation.calibrate import Calibration
from sma_sim.evidence.estimation.uncertainty import Interval, Uncertainty
from sma_sim.report.html.by_run import by_run_blocks
from sma_sim.report.html.figures import log_axis, new_figure, small
from sma_sim.report.html.page import Block, Bullets, Paragraph, Plot, Section, Table
from sma_sim.report.palette import BLUE, GREY, ORANGE
from sma_sim.words.fit_remarks import remarks_on

MAX_RATIO = 3.0  # of an edge of an interval over the value: wider ones go beyond the figure
PARAMETER_HEADER = ('parameter', 'value', '95 % interval', 'unit', 'as given', 'change')
CALIBRATED = 'calibrated without'  # heading of the values of the same model before effects were added


def parameters_section(
    found: Calibration, before: Mapping[str, float], calibrated: Mapping[str, float] | None = None
) -> Section:
    """Table, intervals as a figure, sentences on identifiability, correlations.

    `before`: the values that were given; `calibrated`: those of a fit of the same model without further effects.
    """
    uncertainty = found.uncertainty
    rows = [parameter_row(found, one.name, one.unit, before) for one in found.free]
    header: tuple[str, ...] = PARAMETER_HEADER
    if calibrated is not None:
        header = (*header, CALIBRATED)
        rows = [(*row, f'{calibrated[row[0]]:.5g}' if row[0] in calibrated else '') for row in rows]
    blocks: list[Block] = [Table(header, rows)]
    if uncertainty is not None and uncertainty.intervals:
        blocks.append(
            Plot(
                interval_figure(uncertainty, before),
                'Fitted value with its 95 % interval over the value that was given. Open '
                'orange marks: the data do not see this parameter alone; the bar shows how far the fit could go.',
                60 + 30 * len(uncertainty.intervals),
            )
        )
    words = remarks_on(found)
    words += ['the fit was stopped: these are the best values so far, not the optimum'] if found.interrupted else []
    blocks += [Paragraph('What these data do not determine, and further remarks:'), Bullets(words)] if words else []
    if uncertainty is not None and len(uncertainty.intervals) > 1:
        blocks.append(
            Plot(correlation_figure(uncertainty), 'Correlation of the estimates.', 130 + 26 * len(uncertainty.intervals))
        )
    return Section('Parameters', [*blocks, *by_run_blocks(found.by_run)])


def parameter_row(found: Calibration, name: str, unit: str, before: Mapping[str, float]) -> tuple[str, ...]:
    """One parameter."""
    intervals = {interval.name: interval for interval in found.uncertainty.intervals} if found.uncertainty else {}
    value, first = found.values[name], before[name]
    interval, shown = intervals.get(name), ''
    if interval is not None:
        shown = f'{interval.low:.5g} to {interval.high:.5g}' if interval.seen else 'not determined alone'
    change = f'{100.0 * (value / first - 1.0):+.1f} %' if first != 0.0 else f'{value - first:+.3g}'
    return name, f'{value:.5g}', shown, unit, f'{first:.5g}', change


def interval_figure(uncertainty: Uncertainty, before: Mapping[str, float]) -> object:
    """Values and intervals over the (positive) values before, on a logarithmic axis."""
    shown = [
        interval for interval in reversed(uncertainty.intervals) if before[interval.name] > 0.0 and interval.value > 0.0
    ]
    figure = new_figure()
    for seen, colour, symbol, name in (
        (True, BLUE, 'circle', 'determined'),
        (False, ORANGE, 'circle-open', 'not determined alone'),
    ):
        part = [(interval, before[interval.name]) for interval in shown if interval.seen == seen]
        figure.add_scatter(
            x=[interval.value / first for interval, first in part],
            y=[interval.name for interval, _ in part],
            mode='markers',
            name=name,
            marker={'color': colour, 'symbol': symbol, 'size': 9},
            error_x={
                'type': 'data',
                'symmetric': False,
                'color': colour,
                'thickness': 1.6,
                'array': [(interval.high - interval.value) / first for interval, first in part],
                'arrayminus': [
                    (interval.value - max(interval.low, 1e-3 * interval.value)) / first for interval, first in part
                ],
            },
            hovertemplate='%{y}: x%{x:.4g}<extra></extra>',
        )
    figure.add_vline(x=1.0, line={'color': GREY, 'dash': 'dot'})
    reach = max((abs(np.log10(edge / before[interval.name])) for interval in shown for edge in edges(interval)), default=0.1)
    figure.update_xaxes(title_text='over the given value', **log_axis(10.0 ** (-1.1 * reach), 10.0 ** (1.1 * reach)))
    figure.update_yaxes(
        automargin=True, categoryorder='array', categoryarray=[interval.name for interval in shown], type='category'
    )
    return figure


def edges(interval: Interval) -> tuple[float, ...]:
    """What must be in the figure: the value, and the interval unless it is very wide."""
    wide = not interval.seen or interval.high > MAX_RATIO * interval.value or interval.low * MAX_RATIO < interval.value
    return (interval.value,) if wide else (interval.low, interval.value, interval.high)


def correlation_figure(uncertainty: Uncertainty) -> object:
    """Correlation coefficients of the estimates."""
    names = [interval.name for interval in uncertainty.intervals]
    figure = new_figure()
    figure.add_heatmap(
        x=names,
        y=names,
        z=small(np.array(uncertainty.correlation)),
        zmin=-1,
        zmax=1,
        colorscale='RdBu',
        xgap=1,
        ygap=1,
        colorbar={'thickness': 10, 'len': 0.9},
        hovertemplate='%{x}, %{y}: %{z:.2f}<extra></extra>',
    )
    figure.update_xaxes(automargin=True, showgrid=False, tickangle=-50)
    figure.update_yaxes(automargin=True, showgrid=False, autorange='reversed')
    figure.update_layout(margin={'t': 12})
    return figure
