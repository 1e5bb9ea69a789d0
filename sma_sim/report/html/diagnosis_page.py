"""The page of `sma-sim diagnose`: how the error fell, what was tried at each step, what is left."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path

from sma_sim.evidence.data.recording import Campaign
from sma_sim.evidence.diagnosis.diagnose import Diagnosis, ModelStage
from sma_sim.evidence.diagnosis.verdict_text import headline, remarks, short_title
from sma_sim.evidence.model_selection.forward_selection import UNEXPLAINED
from sma_sim.evidence.residual_analysis.compare import compared_calibration
from sma_sim.evidence.residual_analysis.summary import summarise
from sma_sim.model.parameters import DEFAULTS
from sma_sim.report.html.comparison_page import comparison_sections
from sma_sim.report.html.data import data_section
from sma_sim.report.html.figures import HELD_OUT, SHOWN, log_axis, new_figure
from sma_sim.report.html.page import Bullets, Paragraph, Plot, Section, write_page
from sma_sim.report.html.parameters import parameters_section
from sma_sim.report.html.proposed import proposed_section
from sma_sim.report.html.tried import revision_section, round_section
from sma_sim.report.palette import GREY


def write_diagnosis_page(
    path: Path, found: Diagnosis, training: Campaign, held: Campaign | None, offer: str = ''
) -> None:  # fmt: skip
    """The page of a diagnosis; `offer` is the command that designs a deciding experiment. Raises UserError."""
    before = {name: parameter.default for name, parameter in DEFAULTS.items()} | found.steps[0].values
    for one in found.calibration.free:
        before.setdefault(one.name, one.center)
    rest = summarise(compared_calibration(found.calibration, training, held, found.predicted, 'last step'))
    steps = [round_section(number, one, found, training, held) for number, one in enumerate(found.rounds, start=1)]
    steps += [revision_section(one, found) for one in found.revisions]
    if found.proposal is not None:
        steps.append(proposed_section(found, found.proposal))
    left = [Section(f'What is left: {part.title}', part.blocks) for part in comparison_sections(rest)]
    sections = [fall_section(found, offer), *steps, parameters_section(found.calibration, before), *left]
    write_page(path, f'Diagnosis: {short_title(found)}', [*sections, data_section(training, held)])


def fall_section(found: Diagnosis, offer: str) -> Section:
    """The verdict, and the error over noise step by step."""
    return Section('How the error fell', [
        Paragraph(headline(found), 'lead'),
        Plot(fall_figure(found), 'Error over noise (root mean square over channels) of the runs that were fitted and of '
             'those held out, from the nominal model through each added effect; 1 is the noise.', 360),
        Bullets([*remarks(found), *([f'The experiment that tells them apart: {offer}'] if offer else []), *closing(found)]),
    ])  # fmt: skip


def fall_figure(found: Diagnosis) -> object:
    """Error over noise by step, down to the noise."""
    before = ((), *(step.effects for step in found.steps))
    labels = [f'{step_name(step, effects)}<br>({step.model})' for step, effects in zip(found.steps, before, strict=False)]
    figure = new_figure()
    for values, name, colour, place in (
        ([step.held_out for step in found.steps], 'held out', HELD_OUT, 'top right'),
        ([step.train for step in found.steps], 'fitted', SHOWN, 'bottom left'),
    ):
        if all(value == value for value in values):
            figure.add_scatter(
                x=labels, y=values, name=name, mode='lines+markers+text', text=[f'{value:.2f}' for value in values],
                textposition=place, textfont={'color': colour}, line={'color': colour}, marker={'size': 10},
                cliponaxis=False,
            )  # fmt: skip
    figure.add_scatter(x=labels, y=[1.0] * len(labels), name='noise', mode='lines', line={'color': GREY, 'dash': 'dot'})
    largest = max(value for step in found.steps for value in (step.train, step.held_out) if math.isfinite(value))
    figure.update_yaxes(title_text='error over noise', **log_axis(0.76, 1.3 * max(largest, 1.5) ** 1.1))
    figure.update_xaxes(range=[-0.35, len(labels) - 0.65], automargin=True)
    return figure


def step_name(step: ModelStage, before: Sequence[str]) -> str:
    """What a step added to the effects `before` it, or took away, in lines that a phone has room for."""
    changes = [f'+ {name}' for name in step.effects if name not in before]
    changes += [f'- {name}' for name in before if name not in step.effects]
    return '<br>'.join(changes).replace('_', '_<br>') or 'nominal model'


def closing(found: Diagnosis) -> Iterator[str]:
    """How the verdict came about."""
    yield f'Fitted: {", ".join(found.training)}. Held out, evaluated only at the end: {", ".join(found.held_out) or "none"}.'
    if found.verdict == 'none' and not found.effects:
        yield 'No effect of the library lowers the cross-validated error by more than chance would.'
    rule = f'An error over noise above {UNEXPLAINED:g} at the end counts as unexplained'
    explained = found.together is not None and found.together.explained
    yield rule + (', except in runs that one model explains together.' if explained else '.')
