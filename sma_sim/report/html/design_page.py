"""The page of `sma-sim next`: the sequence, what the rivals predict for it, and what a refitted rival cannot follow."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sma_sim.evidence.data.display_units import DISPLAY_UNITS, in_display_unit
from sma_sim.evidence.experiment_design.curves import HypothesisCurves, best_hypothesis
from sma_sim.evidence.experiment_design.plan import Plan
from sma_sim.evidence.experiment_design.sequences import as_rows
from sma_sim.report.html.figures import add_band, add_curve, new_figure, small
from sma_sim.report.html.page import Block, Bullets, Paragraph, Plot, Provenance, Section, Table, write_page
from sma_sim.report.palette import BLUE, GREEN, GREY, ORANGE, PURPLE, RED, SKY
from sma_sim.words.experiment_design import (
    BEGINS_IN_MOTION,
    channels_sentence,
    indistinguishable_sentences,
    limits_table,
    precision_table,
    ratio_table,
)

HYPOTHESIS_COLOURS = (BLUE, RED, GREEN, PURPLE, SKY, GREY)
BAND = 2.0  # standard deviations
RATIO_CAPTION = 'Natural logarithms; 3 is odds of 20 to 1. Default: the mean of several sequences of random steps.'
COMMAND_HEIGHT, CHANNEL_HEIGHT = 110, 125  # [px]


def write_design_page(
    path: Path, plan: Plan, curves: Sequence[HypothesisCurves], provenance: Provenance | None = None
) -> None:
    """The page of a design and of what its hypotheses predict. Raises UserError."""
    if plan.discriminates:
        ratios = Table(*ratio_table(plan), RATIO_CAPTION)
        expected = [*lead(plan), ratios, Bullets(list(indistinguishable_sentences(plan)))]
        first = Section('What the experiment is expected to tell', expected)
    else:
        first = Section('What to know better', [*lead(plan), Table(*precision_table(plan))])
    sections = [first, Section('The sequence', [prediction_plot(plan, curves)])]
    if plan.discriminates:
        sections.append(Section('What a refitted rival cannot follow', [remainder_plot(plan, curves)]))
    if plan.further_channels:
        sections.append(Section('One sensor more', [*further_blocks(plan)]))
    sections.append(Section('Limits', [Table(*limits_table(plan))]))
    names = ' or '.join(hypothesis.name for hypothesis in plan.hypotheses)
    write_page(path, f'Next experiment: {names}' if plan.discriminates else 'Next experiment', sections, provenance)


def lead(plan: Plan) -> Iterator[Block]:
    """The sequence in a sentence."""
    if plan.in_motion:
        yield Paragraph(BEGINS_IN_MOTION, 'lead')
    rows = len(as_rows(plan.levels, plan.grid)[0]) - 1
    yield Paragraph(
        f'{rows} levels in {plan.grid.length:g} s, held for {plan.grid.hold:g} s or longer: '
        f'the best of {plan.evaluated} sequences.',
        'lead',
    )


def further_blocks(plan: Plan) -> Iterator[Block]:
    """What one sensor more would tell along the recordings."""
    yield Paragraph(channels_sentence(plan.further_channels), 'lead')
    pairs = [f'{ratio.true} against {ratio.rival}' for ratio in plan.further_channels[0].expected]
    rows = [
        (
            channel.words,
            in_display_unit(channel.channel, channel.noise_std),
            *([f'{ratio.expected:.3g}' for ratio in channel.expected] or [f'{channel.information:.3g}']),
        )
        for channel in plan.further_channels
    ]
    caption = (
        'What the same recordings would tell with one sensor more, at that noise: log evidence ratio, natural, expected if '
        'the first is true, or information [nat] on the parameters. Linearized; nothing was measured.'
    )
    yield Table(('sensor', 'noise', *(pairs or ('information [nat]',))), rows, caption)


def prediction_plot(plan: Plan, curves: Sequence[HypothesisCurves]) -> Plot:
    """Command, and each channel as every hypothesis predicts it, with its band."""
    figure, height = channel_figure(plan)
    for number, hypothesis in enumerate(curves):
        for channel in range(len(plan.run.channels)):
            draw_prediction(figure, plan, hypothesis, channel, colour_of(number))
    for channel, name in enumerate(plan.run.channels):
        figure.update_yaxes(title_text=f'{name} [{DISPLAY_UNITS[name][0]}]', row=channel + 2, col=1)
    caption = (
        'Command, and the channels that each explanation predicts after its fit to the recordings; bands are '
        f'+-{BAND:g} standard deviations of the posterior.'
    )
    return Plot(figure, caption, height)


def channel_figure(plan: Plan) -> tuple[Any, int]:
    """A figure of the command with a row of axes for each channel below it, and its height [px]."""
    heights = [COMMAND_HEIGHT] + [CHANNEL_HEIGHT] * len(plan.run.channels)
    figure = new_figure(len(heights), [height / sum(heights) for height in heights], gap=0.015)
    times, levels = as_rows(plan.levels, plan.grid)
    line, curve = {'color': ORANGE, 'width': 1.4, 'shape': 'hv'}, (small(times), np.append(levels[:-1], levels[-2]))
    add_curve(figure, curve, 'command', line, '%{y:.4g} W at %{x:.2f} s', showlegend=False)
    figure.update_xaxes(title_text='time [s]', row=len(heights), col=1)
    figure.update_xaxes(range=[0.0, plan.grid.length])
    figure.update_yaxes(title_font_size=11, tickfont_size=10, nticks=5)
    figure.update_yaxes(title_text=f'{plan.grid.columns[0].removesuffix("_W")} [W]', row=1, col=1)
    return figure, sum(heights) + 100


def colour_of(number: int) -> str:
    """The colour of a hypothesis."""
    return HYPOTHESIS_COLOURS[number % len(HYPOTHESIS_COLOURS)]


def draw_prediction(figure: Any, plan: Plan, hypothesis: HypothesisCurves, channel: int, colour: str) -> None:
    """One channel of one hypothesis with its band."""
    unit, factor = DISPLAY_UNITS[plan.run.channels[channel]]
    mean, reach = factor * hypothesis.mean[channel], BAND * factor * hypothesis.std[channel]
    time, row = plan.run.time, channel + 2
    band = {'opacity': 0.2, 'showlegend': False, 'legendgroup': hypothesis.name}
    add_band(figure, time, mean, reach, row, colour, **band)
    hover, line = f'%{{y:.4g}} {unit} at %{{x:.2f}} s', {'color': colour, 'width': 1.3}
    add_curve(figure, (small(time), mean), hypothesis.name, line, hover, row, showlegend=channel == 0)


def remainder_plot(plan: Plan, curves: Sequence[HypothesisCurves]) -> Plot:
    """What is left of the difference between the best hypothesis and each rival when the rival is refitted."""
    figure, height = channel_figure(plan)
    for number, rival in enumerate(curves):
        for channel, values in enumerate(() if rival.remainder is None else rival.remainder):
            hover, line = '%{y:.2f} x noise at %{x:.2f} s', {'color': colour_of(number), 'width': 1.2}
            curve = small(plan.run.time), values
            add_curve(figure, curve, rival.name, line, hover, channel + 2, showlegend=channel == 0)
    for channel, name in enumerate(plan.run.channels):
        figure.add_hrect(y0=-1, y1=1, fillcolor=GREY, opacity=0.15, line_width=0, row=channel + 2, col=1)
        figure.update_yaxes(title_text=name, row=channel + 2, col=1)
    caption = (
        f'If {plan.hypotheses[best_hypothesis(plan)].name} is true: channels less those of the rival after it was refitted '
        'to recordings and experiment together (linearized), in units of the noise of one sample (the band is +-1).'
    )
    return Plot(figure, caption, height)
