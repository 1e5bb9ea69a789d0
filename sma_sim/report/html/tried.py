"""Section: one round of a diagnosis - what was screened, what was tried, what was accepted and why."""

from __future__ import annotations

from sma_sim.evidence.diagnose import Diagnosis, Step
from sma_sim.evidence.selection import LEAST_FALL, Round, Tried
from sma_sim.report.html.figures import SHOWN, new_figure
from sma_sim.report.html.page import Block, Paragraph, Plot, Section, Table
from sma_sim.report.palette import BLUE, GREY, ORANGE

MOST_SCREENED = 12
TRIED = ('effect', 'cross-validated error, with / without', 'held out', 'chance', 'delta BIC', 'realistic', 'explains alike')


def round_section(number: int, one: Round, found: Diagnosis) -> Section:
    """A round with its tables and figures."""
    blocks: list[Block] = [Paragraph(words_on(one), 'lead')]
    if one.tried:
        rows = [row(tried, found.held_out_ratio if number == 1 else {}) for tried in one.tried]
        blocks.append(Table(TRIED, rows, 'Refitted together with the parameters of the model, best first.'))
    if one.accepted is not None:
        blocks.append(Table(('parameter', 'value', 'std', 'realistic', 'unit'), values_of(one.accepted)))
        if number < len(found.steps):
            blocks.append(Plot(channel_figure(found.steps[number - 1], found.steps[number]),
                               'Error over noise by channel before and after.', 280))  # fmt: skip
    if one.screened:
        blocks.append(Plot(screen_figure(one), 'Score test: part of the remaining squares that each effect could explain '
                           'to first order, beyond what the fitted parameters absorb.', 80 + 22 * shown(one)))  # fmt: skip
    return Section(f'Step {number}', blocks)


def words_on(one: Round) -> str:
    """What happened in a round."""
    if one.accepted is not None:
        fall = 100.0 * (1.0 - one.accepted.ratio)
        return f'{one.accepted.name} is accepted: the cross-validated error falls by {fall:.0f} %.'
    if one.stopped:
        return 'The search was stopped in this step.'
    if not one.tried:
        return 'Nothing that was screened could explain enough of what is left: the search ends.'
    best = one.tried[0]
    reasons = [
        words for wrong, words in (
            (best.fall < LEAST_FALL, f'the cross-validated error falls by less than {100 * LEAST_FALL:.0f} %'),
            (not best.not_chance, f'chance alone would do as well in {100 * best.family_p:.0f} % of cases'),
            (not best.plausible, 'its fitted value is not realistic'),
        ) if wrong
    ]  # fmt: skip
    return f'Nothing more is accepted. The best, {best.name}: {"; ".join(reasons)}.'


def row(one: Tried, held: dict[str, float]) -> tuple[str, ...]:
    """A candidate."""
    ratio = held.get(one.name)
    return (
        one.name, f'{one.ratio:.3f}', '' if ratio is None else f'{ratio:.3f}', f'{one.family_p:.3f}', f'{one.delta_bic:.0f}',
        'yes' if one.plausible else 'no', ', '.join(one.alike),
    )  # fmt: skip


def values_of(one: Tried) -> list[tuple[str, ...]]:
    """The fitted parameters of an effect beside what is realistic."""
    fitted = one.fitted.values_of(one.name)
    rows: list[tuple[str, ...]] = []
    for parameter in one.found.effect.parameters:
        if parameter.name in fitted:
            real = f'{parameter.realistic[0]:g} to {parameter.realistic[1]:g}' if parameter.realistic else ''
            std = one.std.get(f'effects.{one.name}.{parameter.name}', float('nan'))
            rows.append((parameter.name, f'{fitted[parameter.name]:.4g}', f'{std:.1g}', real, parameter.unit))
    return rows


def channel_figure(before: Step, after: Step) -> object:
    """Errors by channel, held out where there is a held-out run; the channel that changed most first."""
    first = before.held_out_channels or before.channels
    then = after.held_out_channels or after.channels
    names = sorted(first, key=lambda name: then[name] / first[name])
    figure = new_figure()
    figure.add_bar(x=names, y=[first[name] for name in names], name='before', marker={'color': GREY})
    figure.add_bar(x=names, y=[then[name] for name in names], name='after', marker={'color': SHOWN})
    figure.update_yaxes(title_text='error over noise')
    return figure


def screen_figure(one: Round) -> object:
    """Screened effects by what they could explain."""
    best = list(reversed(one.screened[: shown(one)]))
    accepted = one.accepted.name if one.accepted else ''
    figure = new_figure()
    figure.add_bar(
        x=[100.0 * screened.gain / max(one.base.squares, 1e-300) for screened in best],
        y=[screened.candidate.name for screened in best], orientation='h', showlegend=False,
        marker={'color': [ORANGE if screened.candidate.name == accepted else BLUE for screened in best]},
    )  # fmt: skip
    figure.update_xaxes(title_text='part of the squares [%]')
    figure.update_layout(margin={'l': 210})
    return figure


def shown(one: Round) -> int:
    """How many screened effects are drawn."""
    return min(MOST_SCREENED, len(one.screened))
