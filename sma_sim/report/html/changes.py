"""Section: two configurations side by side."""

from __future__ import annotations

import math
from collections.abc import Sequence

from sma_sim.evidence.residual_analysis.paired_comparison import ErrorChange
from sma_sim.evidence.residual_analysis.summary import Summary
from sma_sim.report.html.figures import HELD_OUT, SHOWN, new_figure
from sma_sim.report.html.page import Bullets, Paragraph, Plot, Section, Table
from sma_sim.report.palette import GREY


def changes_section(summaries: Sequence[Summary], pairs: Sequence[ErrorChange]) -> Section:
    """Errors of both, and their ratios with intervals."""
    rows = [
        (
            summary.comparison.label,
            summary.comparison.config.simulated_kinetics,
            *('' if math.isnan(error) else f'{error:.3f}' for error in (summary.fitted_error, summary.held_out_error)),
        )
        for summary in summaries
    ]
    return Section(
        'Side by side',
        [
            Table(('configuration', 'model', 'normalized RMSE', 'held out'), rows),
            Plot(ratio_figure(pairs), 'RMSE of the second over that of the first, 95 %; below 1 the second is nearer.'),
            Bullets([change.text for change in pairs]),
            Paragraph('Intervals: stretches of the runs are drawn again, the same ones for both.', 'note'),
        ],
    )


def ratio_figure(pairs: Sequence[ErrorChange]) -> object:
    """Ratios by channel."""
    figure = new_figure()
    for held, name, colour in ((False, 'fitted', SHOWN), (True, 'held out', HELD_OUT)):
        part = [change for change in pairs if change.held_out == held]
        if part:
            figure.add_scatter(
                x=[change.channel for change in part],
                y=[change.ratio for change in part],
                mode='markers',
                name=name,
                marker={'color': colour, 'size': 10},
                error_y={
                    'type': 'data',
                    'symmetric': False,
                    'color': colour,
                    'array': [change.high - change.ratio for change in part],
                    'arrayminus': [change.ratio - change.low for change in part],
                },
            )
    figure.add_hline(y=1.0, line={'color': GREY, 'dash': 'dot'})
    figure.update_yaxes(title_text='RMSE, second over first', rangemode='tozero')
    return figure
