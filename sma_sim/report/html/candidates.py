"""Sections: one step of the selection each - what it changed, which effects were tried, and why they were taken or not."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from sma_sim.evidence.diagnosis.diagnose import Diagnosis
from sma_sim.evidence.diagnosis.review import DiagnosisReview
from sma_sim.evidence.model_selection.backward_elimination import EliminationStep
from sma_sim.evidence.model_selection.candidate_fit import CandidateFit, SelectionStep
from sma_sim.evidence.model_selection.criteria import CRITERIA
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
    diagnosis, accepted = review.diagnosis, step.accepted
    blocks: list[Block] = [Paragraph(outcome(step), 'lead')]
    if accepted is not None and accepted.name in review.changes:
        changed = review.changes[accepted.name]
        blocks += [change_plot(changed, review.given_run(changed.before.name)), Grid(range_plots(accepted))]
    if step.candidate_fits:
        blocks += candidate_blocks(step, diagnosis.held_out_ratio if number == 1 else {})
    if accepted is not None:
        blocks += confounding_blocks(accepted, diagnosis)
        if (change := diagnosis.change('added', accepted.name)) is not None:
            blocks.append(channel_plot(*change, review.scores(bool(change[0].held_out_channel_errors))))
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
        Table(CANDIDATE_HEADER, [candidate_row(fit, held_out_ratios) for fit in step.candidate_fits], CANDIDATE_CAPTION),
        Bullets([f'{fit.name}: {decision(fit, step.accepted)}' for fit in step.candidate_fits]),
    ]


def outcome(step: SelectionStep) -> str:
    """How a step ended."""
    if step.accepted is not None and step.only_together:
        name = step.accepted.name
        return f'{name} explains little by itself, but much together with the effect of the next step: both are accepted.'
    if step.accepted is not None:
        reduction = 100.0 * (1.0 - step.accepted.error_ratio)
        return f'{step.accepted.name} is accepted: the cross-validated error falls by {reduction:.0f} %.'
    if step.stopped:
        return 'The search was stopped in this step.'
    if not step.candidate_fits:
        return 'Nothing that was screened could explain enough of what is left: the search ends.'
    best = step.candidate_fits[0]
    return f'Nothing more is accepted. The best, {best.name}: {"; ".join(objections(best))}.'


def objections(candidate: CandidateFit) -> list[str]:
    """Why a candidate cannot be accepted."""
    least = CRITERIA.min_error_reduction
    tests = (
        (candidate.error_reduction < least, f'the cross-validated error falls by less than {100 * least:.0f} %'),
        (not candidate.significant, f'chance alone would do as well in {100 * candidate.family_p:.0f} % of cases'),
        (not candidate.plausible, f'not realistic: {fitted_values(candidate)}'),
    )
    return [words for holds, words in tests if holds]


def fitted_values(candidate: CandidateFit) -> str:
    """The fitted values of an effect with their units."""
    units = {parameter.name: parameter.unit for parameter in candidate.found.effect.parameters}
    values = candidate.fit.values_of(candidate.name).items()
    return ', '.join(f'{name} = {value:.3g} {units[name]}'.removesuffix(' -') for name, value in values)


def candidate_row(candidate: CandidateFit, held_out_ratios: Mapping[str, float]) -> tuple[str, ...]:
    """The table row of a candidate."""
    held_out = held_out_ratios.get(candidate.name)
    bound = '> ' if candidate.not_cross_validated else ''
    return (
        candidate.name, f'{bound}{candidate.error_ratio:.3f}', '' if held_out is None else f'{held_out:.3f}',
        f'{candidate.family_p:.3f}', f'{candidate.delta_bic:.0f}',
        'yes' if candidate.plausible else 'no',
    )  # fmt: skip


def decision(candidate: CandidateFit, accepted: CandidateFit | None) -> str:
    """Why a candidate was accepted or not, in a few words."""
    if candidate is accepted:
        return f'accepted, {fitted_values(candidate)}'
    against = '; '.join(objections(candidate))
    if against or accepted is None:
        return against
    if candidate.name in accepted.indistinguishable:
        extent = f'as well as {accepted.name}'
    elif candidate.error_ratio < accepted.error_ratio:
        extent = f'more than {accepted.name} alone, but less than it does with the effect of the next step'
    else:
        extent = f'less than {accepted.name}'
    return f'explains {extent}, {fitted_values(candidate)}'


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
