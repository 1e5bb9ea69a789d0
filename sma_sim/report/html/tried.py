"""Section: one round of a diagnosis - what changed, what was fitted, what else was tried and why it was not taken."""

from __future__ import annotations

from collections.abc import Iterator

from sma_sim.evidence.data.recording import Campaign
from sma_sim.evidence.diagnosis.diagnose import Diagnosis
from sma_sim.evidence.diagnosis.stage_change import step_change
from sma_sim.evidence.model_selection.backward_elimination import EliminationStep
from sma_sim.evidence.model_selection.forward_selection import LEAST_REDUCTION, CandidateFit, SelectionStep
from sma_sim.report.html.page import Block, Bullets, Grid, Paragraph, Section, Table
from sma_sim.report.html.step_figures import change_plot, channel_plot, range_plots, screen_plot

TRIED = ('effect', 'ratio', 'held out', 'chance', 'delta BIC', 'realistic')

CAPTION = (
    'Refitted together with the parameters of the model, best first. Ratio: cross-validated error with the effect over that '
    'without it (after >: the fitted error, already beyond the best, so that it was not cross-validated); held out: the '
    'same of the held-out runs; chance: how often chance would do as well.'
)


def round_section(number: int, one: SelectionStep, found: Diagnosis, training: Campaign, held: Campaign | None) -> Section:
    """A round with its figures and tables."""
    blocks: list[Block] = [Paragraph(words_on(one), 'lead')]
    if one.accepted is not None and number < len(found.steps):
        before, after = found.steps[number - 1], found.steps[number]
        blocks += [change_plot(step_change(before, after, training, held)), Grid(range_plots(one.accepted))]
    if one.tried:
        ratios = found.held_out_ratio if number == 1 else {}
        blocks += tried_blocks(one, ratios)
    if one.accepted is not None:
        blocks += list(not_told_apart(one.accepted, found))
        if number < len(found.steps):
            blocks.append(channel_plot(found.steps[number - 1], found.steps[number]))
    if one.screened:
        blocks.append(screen_plot(one))
    return Section(f'Step {number}', blocks)


def revision_section(one: EliminationStep, found: Diagnosis) -> Section:
    """An effect looked at again beside those that came after it."""
    beside, best = ' and '.join(one.base.effects), one.accepted
    words = f'{best.name} takes its place.' if best and best.name != one.effect else 'It stays.'
    blocks: list[Block] = [Paragraph(f'{one.effect} and what was tried with it, each beside {beside}. {words}', 'lead')]
    blocks += tried_blocks(one, {})
    if best is not None:
        blocks += list(not_told_apart(best, found))
    return Section(f'Again: {one.effect}', blocks)


def tried_blocks(one: SelectionStep, ratios: dict[str, float]) -> list[Block]:
    """What was tried, and why it was taken or not; `ratios` of held-out errors by effect."""
    return [
        Table(TRIED, [row(tried, ratios) for tried in one.tried], CAPTION),
        Bullets([f'{tried.name}: {why(tried, one.accepted)}' for tried in one.tried]),
    ]


def words_on(one: SelectionStep) -> str:
    """What happened in a round."""
    if one.accepted is not None and one.only_together:
        return f'{one.accepted.name} explains little by itself, but much beside what the next step accepts: both are taken.'
    if one.accepted is not None:
        fall = 100.0 * (1.0 - one.accepted.ratio)
        return f'{one.accepted.name} is accepted: the cross-validated error falls by {fall:.0f} %.'
    if one.stopped:
        return 'The search was stopped in this step.'
    if not one.tried:
        return 'Nothing that was screened could explain enough of what is left: the search ends.'
    best = one.tried[0]
    return f'Nothing more is accepted. The best, {best.name}: {"; ".join(reasons(best))}.'


def reasons(one: CandidateFit) -> list[str]:
    """Why a candidate cannot be accepted."""
    wrong = (
        (one.fall < LEAST_REDUCTION, f'the cross-validated error falls by less than {100 * LEAST_REDUCTION:.0f} %'),
        (not one.not_chance, f'chance alone would do as well in {100 * one.family_p:.0f} % of cases'),
        (not one.plausible, f'not realistic: {values_of(one)}'),
    )
    return [words for holds, words in wrong if holds]


def values_of(one: CandidateFit) -> str:
    """The fitted values of an effect with their units."""
    units = {parameter.name: parameter.unit for parameter in one.found.effect.parameters}
    fitted = one.fitted.values_of(one.name).items()
    return ', '.join(f'{name} = {value:.3g} {units[name]}'.removesuffix(' -') for name, value in fitted)


def row(one: CandidateFit, held: dict[str, float]) -> tuple[str, ...]:
    """A candidate."""
    ratio = held.get(one.name)
    return (
        one.name, f'{"> " if one.hopeless else ""}{one.ratio:.3f}', '' if ratio is None else f'{ratio:.3f}',
        f'{one.family_p:.3f}', f'{one.delta_bic:.0f}',
        'yes' if one.plausible else 'no',
    )  # fmt: skip


def why(one: CandidateFit, accepted: CandidateFit | None) -> str:
    """Why a candidate was taken or not, in a few words."""
    if one is accepted:
        return f'accepted, {values_of(one)}'
    against = '; '.join(reasons(one))
    if against or accepted is None:
        return against
    much = 'as well as' if one.name in accepted.indistinguishable else 'less than'
    return f'explains {much} {accepted.name}, {values_of(one)}'


def not_told_apart(one: CandidateFit, found: Diagnosis) -> Iterator[Block]:
    """Who explains as well, and why they cannot be told apart; which parameters are known to hide the effect."""
    why_alike = [str(other) for other in found.confounding.get(one.name, ())]
    hidden_by = [name for name in one.found.effect.confused_with if '.' in name or name == 'delay']
    if why_alike:
        yield Paragraph(f'These data cannot tell {one.name} from {", ".join(one.indistinguishable)}. Why:')
        yield Bullets(why_alike)
    if one.found.effect.same_as:
        yield Paragraph(f'The equations make it the same as {one.found.effect.same_as}: no data can tell them apart.')
    if hidden_by:
        words = f'A small {one.name} may hide in {", ".join(hidden_by)}: their estimates go together.'
        yield Paragraph(words, 'note')
