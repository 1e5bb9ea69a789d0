"""A proposed equation as plain data for programs, and in a few lines for people."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from sma_sim.evidence.diagnosis.conclusion import ModelStage
from sma_sim.evidence.diagnosis.diagnose import Diagnosis
from sma_sim.evidence.estimation.uncertainty import GAUSS_95
from sma_sim.evidence.search.criteria import NOISE_ONLY
from sma_sim.evidence.search.equations import FormulaFit, Proposal
from sma_sim.words.json_values import finite


def proposed_data(diagnosis: Diagnosis, file: Path | None) -> dict[str, Any]:
    """The `proposed` entry of a verdict: port, formula, fitted coefficients, errors before and after, what is as good."""
    proposal, (before, after) = proposal_of(diagnosis), formula_change(diagnosis)
    formula = proposal.formula
    return {
        'effect': proposal.effect,
        'port': formula.location.hook,
        'ports': list(proposal.ports),
        'place': formula.location.name,
        'formula': formula.equation,
        'term': [term.name for term in formula.terms],
        'variables': list(formula.variables),
        'stability': finite(proposal.stability),
        'stability_by_variable': finite(proposal.by_variable),
        'coefficients': coefficients(diagnosis),
        'file': str(file) if file else None,
        'source': formula.with_values(effect_values(diagnosis)).text(),
        'held_out': {'before': finite(before.held_out), 'after': finite(after.held_out)},
        'fitted': {'before': finite(proposal.error_before), 'after': finite(proposal.fit.error)},
        'alike': list(proposal.indistinguishable),
        'ranking': [ranked(fit) for fit in proposal.ranking],
        'similar': similar_data(diagnosis),
    }


def similar_data(diagnosis: Diagnosis) -> dict[str, Any] | None:
    """The listed effect with the most similar signature, and the cosine of the two."""
    similar = diagnosis.similar
    if similar is None:
        return None
    effect = similar.effect
    return {'effect': effect.plain_name, 'scope': effect.scope.words, 'cosine': finite(similar.cosine)}


def proposal_of(diagnosis: Diagnosis) -> Proposal:
    """The proposal of a diagnosis that has one."""
    assert diagnosis.proposal is not None
    return diagnosis.proposal


def formula_change(diagnosis: Diagnosis) -> tuple[ModelStage, ModelStage]:
    """The stages without and with the proposed formula, of a diagnosis that has one."""
    change = diagnosis.change('formula')
    assert change is not None
    return change


def effect_values(diagnosis: Diagnosis) -> dict[str, float]:
    """The parameters of the proposed effect after the last fit, by their short names."""
    prefix = f'effects.{proposal_of(diagnosis).effect}.'
    values = diagnosis.calibration.values
    return {name.removeprefix(prefix): value for name, value in values.items() if name.startswith(prefix)}


def coefficients(diagnosis: Diagnosis) -> dict[str, dict[str, Any]]:
    """The parameters with units: `std` with the model's priors, and 95 % intervals where data alone can tell.

    Without measured forces the scale of all forces is known from the priors only.
    """
    proposal, uncertainty = proposal_of(diagnosis), diagnosis.calibration.uncertainty
    seen = {interval.name: interval for interval in uncertainty.intervals if interval.seen} if uncertainty else {}
    found = {}
    for p in proposal.formula.parameters:
        name = f'effects.{proposal.effect}.{p.name}'
        interval, std = seen.get(name), proposal.std.get(name)
        found[p.name] = {
            'value': effect_values(diagnosis)[p.name],
            'unit': p.unit,
            'description': p.description,
            'std': None if std is None else finite(std),
            'low': finite(interval.low) if interval else None,
            'high': finite(interval.high) if interval else None,
        }
    return found


def describes(diagnosis: Diagnosis) -> bool:
    """Whether the proposed equation is what is missing: it leaves noise only, and its coefficients are not zero (95 %)."""
    last = diagnosis.stages[-1]
    if last.train > NOISE_ONLY or last.held_out > diagnosis.limit:
        return False
    neutral = {p.name: p.neutral for p in proposal_of(diagnosis).formula.parameters if p.neutral is not None}
    return not any(includes(one, neutral[name]) for name, one in coefficients(diagnosis).items() if name in neutral)


def includes(coefficient: Mapping[str, Any], value: float) -> bool:
    """Whether a coefficient may have a value: by its 95 % interval, else by its standard deviation with the priors."""
    low, high, std = coefficient['low'], coefficient['high'], coefficient['std']
    if low is None or high is None:
        reach = GAUSS_95 * std if std is not None else math.inf
        low, high = coefficient['value'] - reach, coefficient['value'] + reach
    return bool(low <= value <= high)


def ranked(fit: FormulaFit) -> dict[str, Any]:
    """A formula that was refitted."""
    return {
        'effect': fit.formula.name,
        'port': fit.formula.location.hook,
        'formula': fit.formula.equation,
        'error': finite(fit.error),
        'log_odds': finite(fit.log_odds),
        'parameters': {p.name: p.default for p in fit.formula.parameters},
        'variables': list(fit.formula.variables),
        'stability': finite(fit.stability),
    }


def proposed_text(diagnosis: Diagnosis) -> Iterator[str]:
    """The proposal for the terminal."""
    proposal = diagnosis.proposal
    if proposal is None:
        return
    before, after = formula_change(diagnosis)
    yield f'Proposed equation: {proposal.formula.equation}'
    for name, one in coefficients(diagnosis).items():
        std = '' if one['std'] is None else f' +- {one["std"]:.1g}'
        yield f'{proposal.effect}.{name} = {one["value"]:.4g}{std} {one["unit"]}'
    yield error_words(before, after)
    yield stability_words(proposal)
    if (similar := diagnosis.similar) is not None:
        name = f'{similar.effect.phrase} ({similar.effect.name})'
        yield f'Of the listed effects, {name} leaves the most similar signature (cosine {similar.cosine:.2f}).'
    if proposal.indistinguishable:
        yield f'These data do not distinguish it from {", ".join(proposal.indistinguishable)}.'


def stability_words(proposal: Proposal) -> str:
    """How firmly the choice stands, in a sentence."""
    percent = {name: round(100.0 * share) for name, share in proposal.by_variable.items()}
    shares = ', '.join(f'{name} in {share} %' for name, share in percent.items() if share > 0)
    chosen = f'It was chosen on {100 * proposal.stability:.0f} % of random halves of the data'
    return f'{chosen}; the chosen equation depends on {shares} of them.' if shares else f'{chosen}.'


def error_words(before: ModelStage, after: ModelStage) -> str:
    """What the equation does for the error, in a sentence; of the fitted runs where none is held out."""
    kind, first, last = 'held-out', before.held_out, after.held_out
    if not math.isfinite(first + last):
        kind, first, last = 'fitted', before.train, after.train
    changes = 'falls' if last <= first else 'rises'
    return (
        f'With it the error of the {kind} runs {changes} from {error_number(first)} to {error_number(last)} times the noise.'
    )


def error_number(value: float) -> str:
    """A normalized RMSE."""
    return f'{value:.2f}' if math.isfinite(value) else '-'
