"""The page of `sma-sim diagnose`: how each effect reduced the error, what was tried at each step, what is left."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from sma_sim.evidence.diagnosis.conclusion import ModelStage
from sma_sim.evidence.diagnosis.diagnose import Diagnosis
from sma_sim.evidence.diagnosis.review import DiagnosisReview
from sma_sim.report.html.candidates import selection_section
from sma_sim.report.html.comparison_page import comparison_sections
from sma_sim.report.html.data import data_section
from sma_sim.report.html.figures import HELD_OUT, SHOWN, log_axis, new_figure
from sma_sim.report.html.page import Block, Bullets, Paragraph, Plot, Provenance, Section, Table, write_page
from sma_sim.report.html.parameters import parameters_section
from sma_sim.report.html.proposed import proposed_section
from sma_sim.report.palette import GREY
from sma_sim.words.diagnosis_data import as_data
from sma_sim.words.diagnosis_text import explains_all_together, headline, remarks, short_title, verdict_words
from sma_sim.words.probabilities import finding_rows, model_rows, probability_lines
from sma_sim.words.set_up import set_up_sentences

HELD_OUT_NOTE = (
    'From the models of the search, each refitted without the run: which of them the other runs ask for, and how that one '
    'predicts it.'
)
REDUCTION_CAPTION = (
    'Normalized RMSE (root mean square over channels) of the fitted and of the held-out runs: of your model as it was '
    'given, of the same model calibrated, which biases its parameters towards what it lacks, and with each added effect, '
    'calibrated too; 1 is the noise.'
)


def write_diagnosis_page(
    path: Path, review: DiagnosisReview, next_command: str = '', provenance: Provenance | None = None
) -> None:
    """The page of a diagnosis; `next_command` designs a deciding experiment. Raises UserError."""
    diagnosis = review.diagnosis
    steps = [selection_section(number, step, review) for number, step in enumerate(diagnosis.selection_steps, start=1)]
    if diagnosis.proposal is not None:
        steps.append(proposed_section(diagnosis, diagnosis.proposal))
    sections = [
        verdict_section(review, next_command),
        *steps,
        parameters_section(diagnosis.calibration, review.given_values, review.nominal_values),
        *(Section(f'What is left: {part.title}', part.blocks) for part in comparison_sections(review.remaining)),
        data_section(review.training, review.held_out),
    ]
    write_page(path, f'Diagnosis: {short_title(diagnosis)}', sections, provenance)


def verdict_section(review: DiagnosisReview, next_command: str) -> Section:
    """The verdict, how probable it is, and the normalized RMSE stage by stage."""
    diagnosis = review.diagnosis
    experiment = [f'The experiment that separates them: {next_command}'] if next_command else []
    return Section(
        'What is missing',
        [
            Paragraph(headline(diagnosis), 'lead'),
            *(Paragraph(words) for words in set_up_sentences(diagnosis.set_up)),
            *probability_blocks(as_data(diagnosis)),
            Plot(reduction_figure(diagnosis, review.given_errors), REDUCTION_CAPTION, 360),
            Bullets([*remarks(diagnosis), *experiment, *procedure(diagnosis)]),
            *held_out_blocks(diagnosis),
        ],
    )


def probability_blocks(found: Mapping[str, Any]) -> list[Block]:
    """How probable the models are, and each effect; nothing where a diagnosis says nothing of it."""
    models, findings = model_rows(found), finding_rows(found)
    if not models:
        return []
    rows = [(row.words, row.probability, '' if row.error is None else f'{row.error:.3f}') for row in models]
    blocks: list[Block] = [
        *(Paragraph(line) for line in probability_lines(found)),
        Table(('model', 'probability', 'normalized RMSE'), rows, 'Models, the most probable first'),
    ]
    if findings:
        named = [(row.words, row.probability) for row in findings]
        blocks.append(Table(('missing', 'probability'), named, 'How probable it is that each is missing'))
    return blocks


def held_out_blocks(diagnosis: Diagnosis) -> list[Block]:
    """The verdict with each run held out in turn; nothing where that is not known."""
    if not diagnosis.by_held_out_run:
        return []
    rows = [
        (name + (' (held out)' if name in diagnosis.held_out else ''), verdict_words(found, diagnosis), f'{found.error:.2f}')
        for name, found in diagnosis.by_held_out_run.items()
    ]
    return [
        Table(('without', 'what is missing', 'normalized RMSE of that run'), rows, 'If another run were held out'),
        Paragraph(HELD_OUT_NOTE, 'note'),
    ]


def reduction_figure(diagnosis: Diagnosis, given: tuple[float, float] | None = None) -> object:
    """Normalized RMSE of the model as it was `given` (fitted, held-out runs) and by stage, down to the noise."""
    stages = diagnosis.stages
    before = ((), *(stage.effects for stage in stages))
    labels = [f'{stage_label(stage, had)}<br>({stage.model})' for stage, had in zip(stages, before, strict=False)]
    fitted, held_out = [stage.train for stage in stages], [stage.held_out for stage in stages]
    if given is not None:
        labels, fitted, held_out = ['your model,<br>as given', *labels], [given[0], *fitted], [given[1], *held_out]
    figure = new_figure()
    for values, name, colour, position in (
        (held_out, 'held out', HELD_OUT, 'top right'),
        (fitted, 'fitted', SHOWN, 'bottom left'),
    ):
        if not any(math.isnan(value) for value in values):
            figure.add_scatter(
                x=labels,
                y=values,
                name=name,
                mode='lines+markers+text',
                text=[f'{value:.3g}' for value in values],
                textposition=position,
                textfont={'color': colour},
                line={'color': colour},
                marker={'size': 10},
                cliponaxis=False,
            )
    figure.add_scatter(x=labels, y=[1.0] * len(labels), name='noise', mode='lines', line={'color': GREY, 'dash': 'dot'})
    known = [value for value in (*fitted, *held_out) if math.isfinite(value) and value > 0.0]
    low, high = min(1.0, *known), max(1.5, *known)
    room = (high / low) ** 0.1  # for the numbers beside the outermost points
    figure.update_yaxes(title_text='normalized RMSE', **log_axis(low / (1.3 * room), 1.3 * high * room))
    figure.update_xaxes(range=[-0.35, len(labels) - 0.65], automargin=True)
    return figure


def stage_label(stage: ModelStage, before: Sequence[str]) -> str:
    """What a stage added to the effects `before` it, or took away, in lines that a phone has room for."""
    added = [name for name in stage.effects if name not in before]
    changes = [f'+ {name}' for name in (['proposed equation'] if stage.kind == 'formula' else added)]
    changes += [f'- {name}' for name in before if name not in stage.effects]
    return '<br>'.join(changes).replace('_', '_<br>') or 'the same,<br>calibrated'


def procedure(diagnosis: Diagnosis) -> Iterator[str]:
    """How the verdict came about."""
    held_out = ', '.join(diagnosis.held_out) or 'none'
    yield f'Fitted: {", ".join(diagnosis.training)}. Held out, evaluated only at the end: {held_out}.'
    if diagnosis.verdict == 'none' and not diagnosis.effects:
        yield 'No effect of the library explains the recordings better by more than its prior probability costs.'
    rule = f'A normalized RMSE above {diagnosis.limit:.3g} at the end counts as unexplained'
    is_exception = explains_all_together(diagnosis) and diagnosis.verdict != 'unknown_effect'
    yield rule + (', except in runs that one model explains together.' if is_exception else '.')
