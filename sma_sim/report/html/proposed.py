"""Section: the equation that is proposed for what no known effect explains."""

from __future__ import annotations

from sma_sim.evidence.diagnosis.diagnose import Diagnosis
from sma_sim.evidence.search.equations import Proposal
from sma_sim.evidence.symbolic_regression.partial_residuals import PartialResidualPlot
from sma_sim.report.html.figures import new_figure
from sma_sim.report.html.page import Block, Paragraph, Plot, Section, Table
from sma_sim.report.html.step_figures import channel_plot
from sma_sim.report.palette import BLUE, GREY, ORANGE, RED
from sma_sim.words.proposed_equation import coefficients, error_words, formula_change, ranked, stability_words

PORTRAIT_COLOURS = (BLUE, RED, GREY, '#7a5195')
PORTRAIT_CAPTION = (
    'The missing quantity in the training runs (points: the formula plus what the residuals still call for, with two '
    'standard errors) and the formula (line; rings where it depends on more than what is drawn).'
)
FORMULAS_CAPTION = (
    'Formulas that were refitted, best first. Chosen: share of random halves of the data in which each is the best.'
)


def proposed_section(found: Diagnosis, proposal: Proposal) -> Section:
    """The formula, its parameters, the quantity over its variable, the other formulas that were tried."""
    before, after = formula_change(found)
    lead = f'No known effect explains what is left. Proposed equation: {proposal.formula.equation}'
    rows = [
        (
            name,
            f'{coefficient["value"]:.4g}',
            '' if coefficient['std'] is None else f'{coefficient["std"]:.1g}',
            'only with the priors'
            if coefficient['low'] is None
            else f'{coefficient["low"]:.4g} to {coefficient["high"]:.4g}',
            coefficient['unit'],
            coefficient['description'],
        )
        for name, coefficient in coefficients(found).items()
    ]
    others = [
        (
            formula['formula'],
            f'{formula["error"]:.3f}',
            f'{100 * formula["stability"]:.0f} %',
            ', '.join(f'{name} = {value:.3g}' for name, value in formula['parameters'].items()),
        )
        for formula in map(ranked, proposal.ranking)
        if formula['error'] is not None
    ]
    blocks: list[Block] = [
        Paragraph(lead, 'lead'),
        Paragraph(f'{error_words(before, after)} {rivals_sentence(proposal)}'),
        Paragraph(stability_words(proposal)),
        Table(('parameter', 'value', 'std', '95 % from the data alone', 'unit', ''), rows),
        Plot(residual_figure(proposal.plot), PORTRAIT_CAPTION, 380),
        channel_plot(before, after),
        Table(('formula', 'normalized RMSE', 'chosen', 'parameters'), others, FORMULAS_CAPTION),
    ]
    return Section('Proposed equation', blocks)


def rivals_sentence(proposal: Proposal) -> str:
    """What cannot be told from it."""
    if not proposal.indistinguishable:
        return 'The other formulas that were refitted predict worse.'
    return f'These data do not distinguish it from {", ".join(proposal.indistinguishable)}.'


def residual_figure(plot: PartialResidualPlot) -> object:
    """The quantity over its variable."""
    figure = new_figure()
    for k, run in enumerate(plot.runs):
        figure.add_scatter(
            x=run.x,
            y=run.quantity,
            mode='markers',
            name=run.label,
            marker={'color': PORTRAIT_COLOURS[k % len(PORTRAIT_COLOURS)], 'size': 6},
            error_y={'type': 'data', 'array': 2.0 * run.std, 'thickness': 1, 'width': 0},
        )
    if plot.curve is not None:
        x, y = plot.curve
        figure.add_scatter(x=x, y=y, mode='lines', name='formula', line={'color': ORANGE, 'width': 2})
    for k, run in enumerate(plot.runs if plot.curve is None else ()):
        figure.add_scatter(
            x=run.x,
            y=run.formula,
            mode='markers',
            name='formula',
            legendgroup='formula',
            showlegend=k == 0,
            marker={'color': ORANGE, 'symbol': 'circle-open', 'size': 11, 'line': {'width': 2}},
        )
    figure.update_xaxes(title_text=f'{plot.variable} [{plot.variable_unit}]')
    figure.update_yaxes(title_text=f'{plot.quantity} [{plot.unit}]', title_standoff=14)
    figure.update_layout(margin={'l': 96})
    return figure
