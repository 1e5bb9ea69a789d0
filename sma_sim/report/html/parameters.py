"""Section: the fitted parameters with their intervals, and what the data do not determine."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from sma_sim.evidence.estimation.calibrate import Calibration
from sma_sim.evidence.estimation.run_estimates import ParameterByRun
from sma_sim.evidence.estimation.uncertainty import Interval, Uncertainty
from sma_sim.report.html.figures import interval_bars, log_axis, new_figure, signed_map, small
from sma_sim.report.html.page import Block, Bullets, Paragraph, Plot, Section, Table
from sma_sim.report.palette import BLUE, GREY, ORANGE
from sma_sim.words.fit_remarks import agreement_sentence, p_words, remarks_on

MAX_RATIO = 3.0  # of an edge of an interval over the value: wider ones go beyond the figure
PARAMETER_HEADER = ('parameter', 'value', '95 % interval', 'unit', 'as given', 'change')
CALIBRATED = 'calibrated without'  # heading of the values of the same model before effects were added
MAX_COLUMNS = 8  # recordings of a table; more are in the figure only
MAX_DEVIATION = 5.0  # standard errors, at the end of the colours
FIGURE_WORDS = (
    'How far each recording is from all together, in standard errors, where one parameter at a time may have its own value '
    'in every recording and the others are shared. Beyond 3 is rarely chance; empty: this recording does not determine it.'
)
NOTE = (
    'Value and standard error of its difference from all together; p: how likely so much spread is if all have the same '
    'value (Cochran\'s Q, the noise widened by what each recording leaves).'
)
ALONE_CAPTION = 'Each recording alone, all parameters its own, held by the priors of the fit (a step from the fit above)'


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
            error_x=interval_bars(
                [(interval.high - interval.value) / first for interval, first in part],
                [(interval.value - max(interval.low, 1e-3 * interval.value)) / first for interval, first in part],
                colour,
                thickness=1.6,
            ),
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
    figure = signed_map(names, names, small(np.array(uncertainty.correlation)), 1.0, '%{x}, %{y}: %{z:.2f}<extra></extra>')
    figure.update_xaxes(tickangle=-50)
    return figure


def by_run_blocks(found: Sequence[ParameterByRun]) -> list[Block]:
    """The sentence, deviations as a figure, values as tables; nothing where there is one recording."""
    if not agreement_sentence(found):
        return []
    blocks: list[Block] = [
        Paragraph('Recording by recording:'),
        Bullets([agreement_sentence(found)]),
        Plot(deviation_figure(found), FIGURE_WORDS, 130 + 26 * len(found)),
    ]
    names = [run.run for run in found[0].runs]
    if len(names) <= MAX_COLUMNS:
        rows = [shared_row(parameter) for parameter in found]
        alone = [
            (one.name, *(f'{run.value_alone:.4g} \u00b1 {run.std_alone:.2g}' for run in one.runs), one.unit) for one in found
        ]
        blocks += [
            Table(('parameter', 'all', *names, 'unit', 'p'), rows, 'Each recording, the other parameters shared'),
            Paragraph(NOTE, 'note'),
            Table(('parameter', *names, 'unit'), alone, ALONE_CAPTION),
        ]
    return blocks


def shared_row(parameter: ParameterByRun) -> tuple[str, ...]:
    """One parameter."""
    cells = [f'{run.value:.5g} \u00b1 {run.std:.2g}' if run.seen else 'not determined' for run in parameter.runs]
    p = p_words(parameter.p).removeprefix('p ').removeprefix('= ') if parameter.dof else ''
    return parameter.name, f'{parameter.value:.5g}', *cells, parameter.unit, p


def deviation_figure(found: Sequence[ParameterByRun]) -> object:
    """Standard errors from all together, by parameter and recording."""
    recordings, names = [run.run for run in found[0].runs], [parameter.name for parameter in found]
    deviations = [[round(run.deviation, 2) if run.seen else None for run in parameter.runs] for parameter in found]
    figure = signed_map(recordings, names, deviations, MAX_DEVIATION, '%{y}, %{x}: %{z:.1f}<extra></extra>')
    figure.update_xaxes(type='category')
    return figure
