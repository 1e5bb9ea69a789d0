"""Blocks: what each recording says of every parameter, and whether the recordings agree."""

from __future__ import annotations

from collections.abc import Sequence

from sma_sim.evidence.estimation.run_estimates import ParameterByRun, RunEstimate
from sma_sim.report.html.figures import new_figure
from sma_sim.report.html.page import Block, Bullets, Paragraph, Plot, Table
from sma_sim.words.fit_remarks import agreement_sentence, p_words

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
        alone = [(parameter.name, *map(alone_cell, parameter.runs), parameter.unit) for parameter in found]
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


def alone_cell(run: RunEstimate) -> str:
    """What a recording alone says."""
    return f'{run.value_alone:.4g} \u00b1 {run.std_alone:.2g}'


def deviation_figure(found: Sequence[ParameterByRun]) -> object:
    """Standard errors from all together, by parameter and recording."""
    figure = new_figure()
    figure.add_heatmap(
        x=[run.run for run in found[0].runs],
        y=[parameter.name for parameter in found],
        z=[[round(run.deviation, 2) if run.seen else None for run in parameter.runs] for parameter in found],
        zmin=-MAX_DEVIATION,
        zmax=MAX_DEVIATION,
        colorscale='RdBu',
        xgap=1,
        ygap=1,
        colorbar={'thickness': 10, 'len': 0.9},
        hovertemplate='%{y}, %{x}: %{z:.1f}<extra></extra>',
    )
    figure.update_xaxes(automargin=True, showgrid=False, type='category')
    figure.update_yaxes(automargin=True, showgrid=False, autorange='reversed')
    figure.update_layout(margin={'t': 12})
    return figure
