"""Section: how well the model fits, by channel and by run."""

from __future__ import annotations

from sma_sim.evidence.residual_analysis.summary import Summary
from sma_sim.report.html.figures import HELD_OUT, SHOWN, new_figure
from sma_sim.report.html.page import Block, Paragraph, Plot, Section, Table
from sma_sim.report.palette import GREY
from sma_sim.words.comparison import SCORE_HEADER, channel_row, score_groups


def summary_section(summary: Summary) -> Section:
    """Totals, the scores as a figure and as a table, errors of every run."""
    runs = summary.comparison.runs
    held = [run.name for run in runs if run.held_out]
    words = f'Normalized RMSE {summary.fitted_error:.3g} on {count(len(runs) - len(held))}'
    if held:
        words += f', {summary.held_out_error:.3g} on {count(len(held))} held out ({", ".join(held)})'
    note = (
        'Normalized RMSE is the root mean square of measured - model, divided by the noise of the sensor: 1 is as near as '
        'a model can be. Whiteness is the p-value of Ljung and Box over 20 lags: small means that residuals follow each '
        'other (neighbours: their correlation), so something is missing in the model or in the measurement.'
    )
    rows = [channel_row(kind, score) for kind, part in score_groups(summary) for score in part]
    blocks: list[Block] = [
        Paragraph(words + '.', 'lead'),
        Plot(score_figure(summary), height=300),
        Table(SCORE_HEADER, rows),
        Paragraph(note, 'note'),
        run_table(summary),
    ]
    return Section('How well it fits', blocks)


def count(runs: int) -> str:
    """So many runs."""
    return f'{runs} run' + ('' if runs == 1 else 's')


def score_figure(summary: Summary) -> object:
    """Normalized RMSE by channel."""
    figure = new_figure()
    for (kind, part), colour in zip(score_groups(summary), (SHOWN, HELD_OUT), strict=False):
        figure.add_bar(
            x=[score.channel for score in part],
            y=[round(score.over_noise, 4) for score in part],
            name=kind,
            marker_color=colour,
            hovertemplate='%{x}: %{y:.3f} x noise',
        )
    figure.add_hline(y=1.0, line={'color': GREY, 'dash': 'dot'})
    figure.update_layout(barmode='group', bargap=0.35)
    figure.update_yaxes(title_text='normalized RMSE', rangemode='tozero')
    return figure


def run_table(summary: Summary) -> Table:
    """Normalized RMSE of every run by channel."""
    channels = summary.comparison.channels
    rows = []
    for run in summary.comparison.runs:
        found = summary.runs[run.name]
        cells = [f'{found[name].over_noise:.3f}' if name in found else '' for name in channels]
        label = run.name + (' (held out)' if run.held_out else '')
        rows.append((label, *cells, f'{summary.run_error(run.name):.3f}'))
    return Table(('run', *channels, 'all'), rows, 'Normalized RMSE of every run')
