"""The page of `sma-sim next`: the sequence, what the rivals foretell of it, and what a rival cannot follow."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sma_sim.evidence.data.display_units import DISPLAY_UNITS as UNITS
from sma_sim.evidence.experiment_design.design import Plan
from sma_sim.evidence.experiment_design.forecast import Foretold
from sma_sim.evidence.experiment_design.sequences import as_rows
from sma_sim.evidence.experiment_design.summary import inseparable_words
from sma_sim.evidence.experiment_design.utilities import follower
from sma_sim.report.html.figures import new_figure, small
from sma_sim.report.html.page import Block, Bullets, Paragraph, Plot, Section, Table, write_page
from sma_sim.report.palette import BLUE, GREEN, GREY, ORANGE, RED

COLOURS = (BLUE, RED, GREEN, '#CC79A7', '#56B4E9', GREY)
BAND = 2.0  # standard deviations
COMMAND, VALUE = 110, 125  # heights [px]


def write_design_page(path: Path, plan: Plan) -> None:
    """The page of a design. Raises UserError."""
    told = 'What to know better' if not plan.rivals else 'What the experiment is expected to say'
    table = [rival_table(plan), Bullets(list(inseparable_words(plan)))] if plan.rivals else [knowledge_table(plan)]
    sections = [Section(told, [*lead(plan), *table]), Section('The sequence', [foretold_plot(plan)])]
    if plan.rivals:
        sections.append(Section('What a refitted rival cannot follow', left_blocks(plan)))
    sections.append(Section('Limits', [limits_table(plan)]))
    names = ' or '.join(one.name for one in plan.hypotheses)
    write_page(path, f'Next experiment: {names}' if plan.rivals else 'Next experiment', sections)


def lead(plan: Plan) -> Iterator[Block]:
    """The sequence in a sentence."""
    rows = len(as_rows(plan.levels, plan.grid)[0]) - 1
    yield Paragraph(
        f'{rows} levels in {plan.grid.length:g} s, held for {plan.grid.hold:g} s or longer: '
        f'the best of {plan.tried} sequences.',
        'lead',
    )


def rival_table(plan: Plan) -> Block:
    """Expected evidence, designed and default."""
    rows = [(f'{one.true} against {one.rival}', f'{one.designed:.4g}', f'{one.default:.4g}') for one in plan.expected]
    caption = (
        'Expected log evidence ratio, natural, if the first is true; 3 is odds of 20 to 1. '
        'Default: the mean of several sequences of random steps.'
    )
    return Table(('if true, against', 'designed', 'default'), rows, caption)


def knowledge_table(plan: Plan) -> Block:
    """Standard deviations of the parameters."""
    rows = [
        (one.name, *(f'{x:.3g}' for x in (one.now, one.default, one.designed)), one.shown_unit) for one in plan.knowledge
    ]
    return Table(('standard deviation of', 'now', 'after a default', 'after the design', 'unit'), rows)


def limits_table(plan: Plan) -> Block:
    """What was reached under any hypothesis and draw of its posterior."""
    hottest = max(one.temperature for one in plan.predicted)
    tightest = 1e-6 * max(one.stress for one in plan.predicted)
    rows = [
        ('power', f'{np.abs(plan.levels).max():.4g} W', f'{plan.grid.power:.4g} W', plan.limits_from['power']),
        ('temperature', f'{hottest:.1f} K', f'{plan.limits.temperature:.1f} K', plan.limits_from['temperature']),
        ('stress', f'{tightest:.1f} MPa', f'{1e-6 * plan.limits.stress:.1f} MPa', plan.limits_from['stress']),
    ]
    return Table(('of a wire', 'reached', 'limit', 'limit from'), rows, 'Under every hypothesis and draw of its posterior.')


def foretold_plot(plan: Plan) -> Plot:
    """Command, and each channel as every hypothesis foretells it, with its band."""
    channels = plan.run.channels
    heights = [COMMAND] + [VALUE] * len(channels)
    figure = new_figure(len(heights), [height / sum(heights) for height in heights], gap=0.015)
    draw_command(figure, plan)
    for k, one in enumerate(plan.hypotheses):
        for row in range(len(channels)):
            draw_channel(figure, plan, plan.predicted[k], row, one.name, COLOURS[k % len(COLOURS)])
    for row, channel in enumerate(channels):
        figure.update_yaxes(title_text=f'{channel} [{UNITS[channel][0]}]', row=row + 2, col=1)
    finish(figure, plan, len(heights))
    return Plot(
        figure, f'Command, and the channels that each explanation foretells after its fit to the recordings; bands are '
        f'+-{BAND:g} standard deviations of the posterior.', sum(heights) + 100,
    )  # fmt: skip


def draw_command(figure: Any, plan: Plan) -> None:
    """J_eq as it is held."""
    times, levels = as_rows(plan.levels, plan.grid)
    figure.add_scatter(
        x=small(times), y=small(np.append(levels[:-1], levels[-2])), mode='lines', name='command', showlegend=False,
        line={'color': ORANGE, 'width': 1.4, 'shape': 'hv'}, hovertemplate='%{y:.4g} W at %{x:.2f} s', row=1, col=1,
    )  # fmt: skip
    figure.update_yaxes(title_text='J_eq [W]', row=1, col=1)


def draw_channel(figure: Any, plan: Plan, one: Foretold, row: int, name: str, colour: str) -> None:
    """One channel of one hypothesis."""
    unit, factor = UNITS[plan.run.channels[row]]
    shape, scale = plan.run.weight.shape, factor / plan.run.weight[row]
    values = scale * one.centres[0].reshape(shape)[row]
    std = scale * np.sqrt(np.sum(one.jacobians[0].reshape(-1, *shape)[:, row] ** 2, axis=0))
    time = plan.run.time
    figure.add_scatter(
        x=small(np.concatenate([time, time[::-1]])),
        y=small(np.concatenate([values + BAND * std, (values - BAND * std)[::-1]])), fill='toself', fillcolor=colour,
        opacity=0.2, line={'width': 0}, hoverinfo='skip', showlegend=False, legendgroup=name, row=row + 2, col=1,
    )  # fmt: skip
    figure.add_scatter(
        x=small(time), y=small(values), mode='lines', name=name, legendgroup=name, showlegend=row == 0,
        line={'color': colour, 'width': 1.3}, hovertemplate=f'%{{y:.4g}} {unit} at %{{x:.2f}} s', row=row + 2, col=1,
    )  # fmt: skip


def left_blocks(plan: Plan) -> Sequence[Block]:
    """What is left of the difference of each pair when the rival is refitted."""
    channels, shape = plan.run.channels, plan.run.weight.shape
    heights = [COMMAND] + [VALUE] * len(channels)
    figure = new_figure(len(heights), [height / sum(heights) for height in heights], gap=0.015)
    draw_command(figure, plan)
    every = np.sqrt(plan.every)
    best = max(range(len(plan.hypotheses)), key=lambda k: plan.hypotheses[k].evidence)
    for k, one in enumerate(plan.hypotheses):
        if k == best:
            continue
        rival = follower(plan.predicted[k])
        left = rival.residual(plan.predicted[best].centres[0] - rival.centre).reshape(shape) / every
        for row, values in enumerate(left):
            figure.add_scatter(
                x=small(plan.run.time), y=small(values), mode='lines', name=one.name, legendgroup=one.name,
                showlegend=row == 0, line={'color': COLOURS[k % len(COLOURS)], 'width': 1.2},
                hovertemplate='%{y:.2f} x noise at %{x:.2f} s', row=row + 2, col=1,
            )  # fmt: skip
    for row, channel in enumerate(channels):
        figure.add_hrect(y0=-1, y1=1, fillcolor=GREY, opacity=0.15, line_width=0, row=row + 2, col=1)
        figure.update_yaxes(title_text=channel, row=row + 2, col=1)
    finish(figure, plan, len(heights))
    name = plan.hypotheses[best].name
    words = (
        f'If {name} is true: channels less those of the rival after it was refitted to recordings and experiment together '
        '(linearised), in units of the noise of one sample (the band is +-1).'
    )
    return [Plot(figure, words, sum(heights) + 100)]


def finish(figure: Any, plan: Plan, rows: int) -> None:
    """What all figures share."""
    figure.update_xaxes(title_text='time [s]', row=rows, col=1)
    figure.update_xaxes(range=[0.0, plan.grid.length])
    figure.update_yaxes(title_font_size=11, tickfont_size=10, nticks=5)
