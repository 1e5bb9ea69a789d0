"""Sections: one step of the selection each - what it changed, which effects were tried, and why they were taken or not."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from sma_sim.evidence.diagnosis.diagnose import Diagnosis
from sma_sim.evidence.diagnosis.review import DiagnosisReview
from sma_sim.evidence.model_selection.backward_elimination import EliminationStep
from sma_sim.evidence.model_selection.forward_selection import LEAST_REDUCTION, CandidateFit, SelectionStep
from sma_sim.report.html.page import Block, Bullets, Grid, Paragraph, Section, Table
from sma_sim.report.html.step_figures import change_plot, channel_plot, range_plots, screen_plot

CANDIDATE_HEADER = ('effect', 'ratio', 'held out', 'chance', 'delta BIC', 'realistic')
CANDIDATE_CAPTION = (
    'Refitted together with the parameters of the model, best first. Ratio: cross-validated error with the effect over that '
    'without it (after >: the fitted error, which already exceeds the best, so that it was not cross-validated); held out: '
    'the same of the held-out runs; chance: how often chance would do as well.'
)


def selection_section(number: int, step: SelectionStep, review: DiagnosisReview) -> Section:
    """A step of the forward selection with its figures and tables."""
    diagnosis, stages = review.diagnosis, review.diagnosis.steps
    blocks: list[Block] = [Paragraph(outcome(step), 'lead')]
    if step.accepted is not None and number in review.changes:
        blocks += [change_plot(review.changes[number]), Grid(range_plots(step.accepted))]
    if step.tried:
        blocks += candidate_blocks(step, diagnosis.held_out_ratio if number == 1 else {})
    if step.accepted is not None:
        blocks += confounding_blocks(step.accepted, diagnosis)
        if number < len(stages):
            blocks.append(channel_plot(stages[number - 1], stages[number]))
    if step.screened:
        blocks.append(screen_plot(step))
    return Section(f'Step {number}', blocks)


def elimination_section(step: EliminationStep, diagnosis: Diagnosis) -> Section:
    """An effect that was compared again beside those that came after it."""
    others, best = ' and '.join(step.base.effects), step.accepted
    result = f'{best.name} takes its place.' if best and best.name != step.effect else 'It stays.'
    lead = f'{step.effect} and the effects that were tried with it, each beside {others}. {result}'
    blocks: list[Block] = [Paragraph(lead, 'lead'), *candidate_blocks(step, {})]
    if best is not None:
        blocks += confounding_blocks(best, diagnosis)
    return Section(f'Again: {step.effect}', blocks)


def candidate_blocks(step: SelectionStep, held_out_ratios: Mapping[str, float]) -> list[Block]:
    """What was tried, and why it was taken or not; `held_out_ratios` of errors by effect."""
    return [
        Table(CANDIDATE_HEADER, [candidate_row(fit, held_out_ratios) for fit in step.tried], CANDIDATE_CAPTION),
        Bullets([f'{fit.name}: {decision(fit, step.accepted)}' for fit in step.tried]),
    ]


def outcome(step: SelectionStep) -> str:
    """How a step ended."""
    if step.accepted is not None and step.only_together:
        name = step.accepted.name
        return f'{name} explains little by itself, but much together with the effect of the next step: both are accepted.'
    if step.accepted is not None:
        reduction = 100.0 * (1.0 - step.accepted.ratio)
        return f'{step.accepted.name} is accepted: the cross-validated error falls by {reduction:.0f} %.'
    if step.stopped:
        return 'The search was stopped in this step.'
    if not step.tried:
        return 'Nothing that was screened could explain enough of what is left: the search ends.'
    best = step.tried[0]
    return f'Nothing more is accepted. The best, {best.name}: {"; ".join(objections(best))}.'


def objections(fit: CandidateFit) -> list[str]:
    """Why a candidate cannot be accepted."""
    tests = (
        (fit.fall < LEAST_REDUCTION, f'the cross-validated error falls by less than {100 * LEAST_REDUCTION:.0f} %'),
        (not fit.not_chance, f'chance alone would do as well in {100 * fit.family_p:.0f} % of cases'),
        (not fit.plausible, f'not realistic: {fitted_values(fit)}'),
    )
    return [words for holds, words in tests if holds]


def fitted_values(fit: CandidateFit) -> str:
    """The fitted values of an effect with their units."""
    units = {parameter.name: parameter.unit for parameter in fit.found.effect.parameters}
    values = fit.fitted.values_of(fit.name).items()
    return ', '.join(f'{name} = {value:.3g} {units[name]}'.removesuffix(' -') for name, value in values)


def candidate_row(fit: CandidateFit, held_out_ratios: Mapping[str, float]) -> tuple[str, ...]:
    """The table row of a candidate."""
    held_out = held_out_ratios.get(fit.name)
    return (
        fit.name, f'{"> " if fit.hopeless else ""}{fit.ratio:.3f}', '' if held_out is None else f'{held_out:.3f}',
        f'{fit.family_p:.3f}', f'{fit.delta_bic:.0f}',
        'yes' if fit.plausible else 'no',
    )  # fmt: skip


def decision(fit: CandidateFit, accepted: CandidateFit | None) -> str:
    """Why a candidate was accepted or not, in a few words."""
    if fit is accepted:
        return f'accepted, {fitted_values(fit)}'
    against = '; '.join(objections(fit))
    if against or accepted is None:
        return against
    extent = 'as well as' if fit.name in accepted.indistinguishable else 'less than'
    return f'explains {extent} {accepted.name}, {fitted_values(fit)}'


def confounding_blocks(fit: CandidateFit, diagnosis: Diagnosis) -> Iterator[Block]:
    """Which effects explain as well, and why they cannot be told apart; which parameters are known to hide the effect."""
    reasons = [str(confounding) for confounding in diagnosis.confounding.get(fit.name, ())]
    hidden_by = [name for name in fit.found.effect.confused_with if '.' in name or name == 'delay']
    if reasons:
        yield Paragraph(f'These data cannot tell {fit.name} from {", ".join(fit.indistinguishable)}. Why:')
        yield Bullets(reasons)
    if fit.found.effect.same_as:
        yield Paragraph(f'The equations make it the same as {fit.found.effect.same_as}: no data can tell them apart.')
    if hidden_by:
        text = f'A small {fit.name} may hide in {", ".join(hidden_by)}: their estimates are correlated.'
        yield Paragraph(text, 'note')
