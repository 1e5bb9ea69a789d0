"""Sections: one step of the selection each - what it changed, which effects were tried, and why they were taken or not."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from sma_sim.evidence.diagnosis.diagnose import Diagnosis
from sma_sim.evidence.diagnosis.review import DiagnosisReview
from sma_sim.evidence.search.steps import CandidateFit, SelectionStep
from sma_sim.report.html.page import Block, Bullets, Grid, Paragraph, Section, Table
from sma_sim.report.html.step_figures import change_plot, channel_plot, range_plots

CANDIDATE_HEADER = ('effect', 'log odds', 'error ratio', 'held out', 'delta BIC', 'realistic')
CANDIDATE_CAPTION = (
    'Fitted together with the parameters of the model, the most probable first. Log odds: natural logarithm of the odds of '
    'the model with the effect against the one without it, prior probabilities included; error ratio: fitted error with the '
    'effect over that without it; held out: the same of the held-out runs.'
)


def selection_section(number: int, step: SelectionStep, review: DiagnosisReview) -> Section:
    """A step towards the best model with its figures and tables."""
    diagnosis, accepted = review.diagnosis, step.accepted
    blocks: list[Block] = [Paragraph(outcome(step), 'lead')]
    if accepted is not None and accepted.name in review.changes:
        changed = review.changes[accepted.name]
        given = next(run for run in review.given.runs if run.name == changed.before.name)
        blocks += [change_plot(changed, given), Grid(range_plots(accepted))]
    if step.candidate_fits:
        blocks += candidate_blocks(step, diagnosis.held_out_ratio if number == 1 else {})
    if accepted is not None:
        blocks += confounding_blocks(accepted, diagnosis)
        if (change := diagnosis.change('added', accepted.name)) is not None:
            blocks.append(channel_plot(*change, review.scores(bool(change[0].held_out_channel_errors))))
    return Section(f'Step {number}', blocks)


def candidate_blocks(step: SelectionStep, held_out_ratios: Mapping[str, float]) -> list[Block]:
    """What was fitted; `held_out_ratios` of errors by effect."""
    return [
        Table(CANDIDATE_HEADER, [candidate_row(fit, held_out_ratios) for fit in step.candidate_fits], CANDIDATE_CAPTION),
        Bullets([f'{fit.name}: {fitted_values(fit)}' for fit in step.candidate_fits]),
    ]


def outcome(step: SelectionStep) -> str:
    """How a step ended."""
    if step.accepted is not None:
        reduction = 100.0 * (1.0 - step.accepted.error_ratio)
        return f'{step.accepted.name} is part of the best model: the fitted error falls by {reduction:.0f} %.'
    if not step.candidate_fits:
        return 'No effect promised more than its prior probability costs.'
    best = step.candidate_fits[0]
    return f'No further effect is part of the best model. The next, {best.name}: log odds {best.log_odds:.1f}.'


def fitted_values(candidate: CandidateFit) -> str:
    """The fitted values of an effect with their units."""
    units = {parameter.name: parameter.unit for parameter in candidate.found.effect.parameters}
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
    hidden_by = [name for name in candidate.found.effect.confused_with if '.' in name or name == 'delay']
    if reasons:
        yield Paragraph(
            f'These data do not distinguish {candidate.name} from {", ".join(candidate.indistinguishable)}. Why:'
        )
        yield Bullets(reasons)
    if candidate.found.effect.same_as:
        yield Paragraph(f'The equations make it the same as {candidate.found.effect.same_as}: no data can tell them apart.')
    if hidden_by:
        text = f'A small {candidate.name} may hide in {", ".join(hidden_by)}: their estimates are correlated.'
        yield Paragraph(text, 'note')
