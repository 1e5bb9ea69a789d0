"""Compares a verdict of `sma-sim diagnose` (docs/reference/challenges.md) with the answer of a challenge."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sma_sim.challenge.answer import MISSING_EFFECT, NOTHING_MISSING, UNKNOWN_EFFECT, VERDICT_CODES, Answer
from sma_sim.model.errors import UserError

RIGHT, PARTIAL, WRONG = 'right', 'partial', 'wrong'
DETECTABLE = 1.3  # held-out normalized RMSE above which something is seen to be missing


@dataclass(frozen=True)
class Verdict:
    """A verdict, as in the file of docs/reference/challenges.md. `error` holds (effects, held-out error) step by step."""

    kind: str
    effects: tuple[str, ...]
    ranking: tuple[str, ...]
    confounded: Mapping[str, frozenset[str]]
    error: tuple[tuple[tuple[str, ...], float], ...]

    @property
    def nominal_error(self) -> float | None:
        """Held-out normalized RMSE of the fitted model without effects."""
        return next((held_out for effects, held_out in self.error if not effects), None)

    @property
    def final_error(self) -> float | None:
        """Held-out normalized RMSE with all effects that were accepted."""
        return self.error[-1][1] if self.error else None

    def names(self, effect: str) -> str | None:
        """The accepted effect that is this one, or one that the verdict declares inseparable from it."""
        if effect in self.effects:
            return effect
        for accepted in self.effects:
            if effect in self.confounded.get(accepted, ()) or accepted in self.confounded.get(effect, ()):
                return accepted
        return None


@dataclass(frozen=True)
class VerdictScore:
    """`outcome` is right, partial or wrong, and `why`; `ranks` counts from 1, None for an effect that is not ranked."""

    outcome: str
    why: str
    verdict: str
    expected_verdict: str
    ranks: Mapping[str, int | None]
    nominal_error: float | None
    final_error: float | None


def read_verdict(path: Path) -> Verdict:
    """A verdict file of `diagnose`. Raises UserError that says what is missing in it."""
    try:
        data = json.loads(path.read_text(encoding='utf-8'))
    except OSError as error:
        raise UserError(f'cannot read {path}: {error.strerror}') from error
    except ValueError as error:
        raise UserError(f'{path} is not JSON: {error}') from error
    if not isinstance(data, dict) or data.get('verdict') not in VERDICT_CODES:
        given = data.get('verdict') if isinstance(data, dict) else type(data).__name__
        raise UserError(
            f'{path} is no verdict of `sma-sim diagnose`: "verdict" is {given!r}, expected one of {", ".join(VERDICT_CODES)}'
        )
    try:
        return verdict_from(data)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise UserError(
            f'{path} is no verdict of `sma-sim diagnose`: expected "effects" (names), "ranking" (objects with "effect") and '
            f'"error" (objects with "effects" and "held_out"); {type(error).__name__}: {error}'
        ) from error


def verdict_from(data: Mapping[str, Any]) -> Verdict:
    """A verdict of plain data."""
    ranking = data.get('ranking', [])
    return Verdict(
        data['verdict'],
        checked_names(data['effects']),
        checked_names([entry['effect'] for entry in ranking]),
        {entry['effect']: frozenset(checked_names(entry.get('confounded_with') or [])) for entry in ranking},
        tuple((checked_names(entry['effects']), float(entry['held_out'])) for entry in data.get('error', [])),
    )


def checked_names(words: Any) -> tuple[str, ...]:
    """A list of words, and nothing else."""
    if not isinstance(words, list) or not all(isinstance(word, str) for word in words):
        raise TypeError(f'expected a list of names, got {words!r}')
    return tuple(words)


def score_verdict(answer: Answer, verdict: Verdict) -> VerdictScore:
    """Whether a verdict is right.

    An effect counts as named when one is that the verdict declares inseparable from it. What the verdict's own held-out
    errors show not to be missed (at most DETECTABLE times the noise) need not be named.
    """
    outcome, why = outcome_and_reason(answer, verdict)
    ranks = {name: verdict.ranking.index(name) + 1 if name in verdict.ranking else None for name in answer.library_names}
    return VerdictScore(outcome, why, verdict.kind, answer.verdict, ranks, verdict.nominal_error, verdict.final_error)


def outcome_and_reason(answer: Answer, verdict: Verdict) -> tuple[str, str]:
    """Outcome and reason."""
    names = {effect: verdict.names(effect) for effect in answer.library_names}
    found = [effect for effect, name in names.items() if name]
    missed = [effect for effect, name in names.items() if not name]
    explains_in_part = verdict.kind == UNKNOWN_EFFECT == answer.verdict  # then the verdict's effects need not be real
    false = [effect for effect in verdict.effects if effect not in names.values() and not explains_in_part]
    if answer.verdict == NOTHING_MISSING:
        return (
            (WRONG, 'a false alarm: nothing is missing')
            if verdict.kind != NOTHING_MISSING
            else (RIGHT, 'nothing is missing')
        )
    if verdict.kind == NOTHING_MISSING:
        if is_within_noise(verdict.nominal_error):
            return RIGHT, f'what is missing cannot be seen ({verdict.nominal_error:.2f} times the noise, held out)'
        return WRONG, 'something is missing'
    if false and not found:
        return WRONG, f'{joined_names(false)} is not what is missing'
    if false:
        return PARTIAL, f'{joined_names(found)} is right, {joined_names(false)} is not'
    return outcome_of_names(answer, verdict, found, missed)


def outcome_of_names(answer: Answer, verdict: Verdict, found: Sequence[str], missed: Sequence[str]) -> tuple[str, str]:
    """Outcome and reason where something is missing and no effect was named in error."""
    beyond = [effect.name for effect in answer.effects if not effect.library]
    if missed and not (found and is_within_noise(verdict.final_error)):
        return (
            PARTIAL if found or beyond and verdict.kind == UNKNOWN_EFFECT else WRONG
        ), f'{joined_names(missed)} is missing, not named'
    if verdict.kind == UNKNOWN_EFFECT and not beyond:
        return PARTIAL, f'{joined_names(found)} is all that is missing'
    if verdict.kind == MISSING_EFFECT and beyond and not is_within_noise(verdict.final_error):
        return PARTIAL, f'{joined_names(beyond)} is missing as well, which is no effect of the library'
    inseparable = [name for name in found if name not in verdict.effects]
    why = (
        f'{joined_names(found)} is missing'
        if found
        else f'{joined_names(beyond)} is missing, which is no effect of the library'
    )
    unseen = f'; the rest cannot be seen ({verdict.final_error:.2f} times the noise)' if missed else ''
    return RIGHT, why + (' (named with others that are inseparable)' if inseparable else '') + unseen


def is_within_noise(error: float | None) -> bool:
    """Whether a held-out normalized RMSE shows nothing that is missing."""
    return error is not None and error <= DETECTABLE


def joined_names(names: Sequence[str]) -> str:
    """Names in a sentence."""
    return ' and '.join(names)
