"""The page of `sma-sim diagnose`: how each effect reduced the error, what was tried at each step, what is left."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from sma_sim.evidence.diagnosis.conclusion import ModelStage
from sma_sim.evidence.diagnosis.diagnose import Diagnosis
from sma_sim.evidence.diagnosis.review import DiagnosisReview
from sma_sim.evidence.search.equations import Proposal
from sma_sim.evidence.search.steps import CandidateFit, SelectionStep
from sma_sim.evidence.symbolic_regression.partial_residuals import PartialResidualPlot
from sma_sim.model.shown import joined_words
from sma_sim.report.html.comparison_page import comparison_sections
from sma_sim.report.html.data import data_section
from sma_sim.report.html.figures import HELD_OUT, SHOWN, log_axis, new_figure
from sma_sim.report.html.page import Block, Bullets, Grid, Paragraph, Plot, Provenance, Section, Table, write_page
from sma_sim.report.html.parameters import parameters_section
from sma_sim.report.html.step_figures import change_plot, channel_plot, range_plots
from sma_sim.report.palette import BLUE, GREY, ORANGE, RED
from sma_sim.words.diagnosis_data import as_data
from sma_sim.words.diagnosis_text import explains_all_together, headline, remarks, short_title, verdict_words
from sma_sim.words.probabilities import finding_rows, model_rows, probability_lines
from sma_sim.words.proposed_equation import coefficients, error_words, formula_change, ranked, stability_words
from sma_sim.words.set_up import set_up_sentences

HELD_OUT_NOTE = (
    'From the models of the search, each refitted without the run: which of them the other runs ask for, and how that one '
    'predicts it.'
)
REDUCTION_CAPTION = (
    'Normalized RMSE (root mean square over channels) of the fitted and of the held-out runs: of your model as it was '
    'given, of the same model calibrated, which biases its parameters towards what it lacks, and with what was added, '
    'calibrated too; 1 is the noise.'
)
CANDIDATE_HEADER = ('effect', 'log odds', 'error ratio', 'held out', 'delta BIC', 'realistic')
CANDIDATE_CAPTION = (
    'Fitted together with the parameters of the model, the most probable first. Log odds: natural logarithm of the odds of '
    'the model with the effect against the one without it, prior probabilities included; error ratio: fitted error with the '
    'effect over that without it; held out: the same of the held-out runs.'
)
PORTRAIT_COLOURS = (BLUE, RED, GREY, '#7a5195')
PORTRAIT_CAPTION = (
    'The missing quantity in the training runs (points: the formula plus what the residuals still call for, with two '
    'standard errors) and the formula (line; rings where it depends on more than what is drawn).'
)
FORMULAS_CAPTION = (
    'Formulas that were refitted, best first. Chosen: share of random halves of the data in which each is the best.'
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
    labels = [f'{stage_label(*pair)}<br>({pair[0].kinetics})' for pair in zip(stages, (None, *stages), strict=False)]
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


def stage_label(stage: ModelStage, before: ModelStage | None) -> str:
    """What a stage added to the one `before` it, or took away, in lines that a phone has room for."""
    had, differed = (before.effects, before.differences) if before else ((), ())
    added = [name for name in stage.effects if name not in had]
    changes = [f'+ {name}' for name in (['proposed equation'] if stage.kind == 'formula' else added)]
    changes += [f'- {name}' for name in had if name not in stage.effects]
    changes += ['+ recordings<br>that differ'] * (not {*stage.differences} <= {*differed})
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


def selection_section(number: int, step: SelectionStep, review: DiagnosisReview) -> Section:
    """A step towards the best model with its figures and tables."""
    diagnosis, accepted = review.diagnosis, step.accepted
    blocks: list[Block] = [Paragraph(outcome(step), 'lead')]
    if accepted is not None and accepted.name in review.changes:
        changed = review.changes[accepted.name]
        given = next(run for run in review.given.runs if run.name == changed.before.name)
        blocks += [change_plot(changed, given), Grid(range_plots(accepted))]
    if step.candidate_fits:
        ratios = diagnosis.held_out_ratio if number == 1 else {}
        blocks += [
            Table(CANDIDATE_HEADER, [candidate_row(fit, ratios) for fit in step.candidate_fits], CANDIDATE_CAPTION),
            Bullets([f'{fit.name}: {fitted_values(fit)}' for fit in step.candidate_fits]),
        ]
    if accepted is not None:
        blocks += confounding_blocks(accepted, diagnosis)
        if (change := diagnosis.change('added', accepted.name)) is not None:
            blocks.append(channel_plot(*change, review.scores(bool(change[0].held_out_channel_errors))))
    return Section(f'Step {number}', blocks)


def outcome(step: SelectionStep) -> str:
    """How a step ended."""
    if step.accepted is not None:
        reduction = 100.0 * (1.0 - step.accepted.error_ratio)
        return f'{step.accepted.name} is part of the best model: the fitted error falls by {reduction:.0f} %.'
    after = step.after.differences if step.after else ()
    if differing := joined_words([one for one in after if one not in step.base.differences]):
        return f'No effect: what is part of the best model is that the recordings differ in {differing}.'
    if not step.candidate_fits:
        return 'No effect promised more than its prior probability costs.'
    best = step.candidate_fits[0]
    return f'No further effect is part of the best model. The next, {best.name}: log odds {best.log_odds:.1f}.'


def fitted_values(candidate: CandidateFit) -> str:
    """The fitted values of an effect with their units."""
    units = {parameter.name: parameter.unit for parameter in candidate.effect.parameters}
    values = candidate.fit.seen_values_of(candidate.name).items()
    return ', '.join(f'{name} = {value:.3g} {units[name]}'.removesuffix(' -') for name, value in values)


def candidate_row(candidate: CandidateFit, held_out_ratios: Mapping[str, float]) -> tuple[str, ...]:
    """The table row of a candidate."""
    held_out = held_out_ratios.get(candidate.name)
    return (
        candidate.name,
        f'{candidate.log_odds:.1f}',
        f'{candidate.error_ratio:.3f}',
        '' if held_out is None else f'{held_out:.3f}',
        f'{candidate.delta_bic:.0f}',
        'yes' if candidate.plausible else 'no',
    )


def confounding_blocks(candidate: CandidateFit, diagnosis: Diagnosis) -> Iterator[Block]:
    """Which effects explain as well, and why they cannot be told apart; which parameters are known to hide the effect."""
    reasons = [str(confounding) for confounding in diagnosis.confounding.get(candidate.name, ())]
    hidden_by = [name for name in candidate.effect.confused_with if '.' in name or name == 'delay']
    if reasons:
        yield Paragraph(
            f'These data do not distinguish {candidate.name} from {", ".join(candidate.indistinguishable)}. Why:'
        )
        yield Bullets(reasons)
    if candidate.effect.same_as:
        yield Paragraph(f'The equations make it the same as {candidate.effect.same_as}: no data can tell them apart.')
    if hidden_by:
        text = f'A small {candidate.name} may hide in {", ".join(hidden_by)}: their estimates are correlated.'
        yield Paragraph(text, 'note')


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
