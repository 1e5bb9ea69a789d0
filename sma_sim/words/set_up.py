"""Faults of the set-up: what is wrong and what to change, in sentences and as plain data."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from sma_sim.evidence.set_up.faults import Fault
from sma_sim.model.shown import joined_words


def set_up_sentences(faults: Sequence[Fault]) -> Iterator[str]:
    """What was wrong with the recordings, what was done about it, and what to change."""
    for group in related(faults):
        first, cure = group[0], '; '.join(dict.fromkeys(fault.cure for fault in group))
        others = ', or '.join(phrases(other) for other in first.alternatives)
        if not first.corrected and not others:
            yield f'Set-up: {phrases(group)}. Fix it: {cure}.'
            continue
        if not first.corrected:
            yield f'Set-up: {phrases(group)}, or {others}: these recordings do not say which. Find out and fix it: {cure}.'
            continue
        either = f' (or, which leaves the same recordings of a symmetric robot: {others})' if others else ''
        either = either_sign(group) or f'{phrases(group)}{either}'
        yield f'Set-up: {either}. Corrected for this diagnosis; to fix it, {cure}.'


def related(faults: Sequence[Fault]) -> list[list[Fault]]:
    """Signs and exchanges in the same recordings together, others by themselves."""
    groups = dict[object, list[Fault]]()
    for k, fault in enumerate(faults):
        together = fault.kind in ('sign', 'swap') and fault.corrected
        groups.setdefault(fault.recordings if together else k, []).append(fault)
    return list(groups.values())


def either_sign(group: Sequence[Fault]) -> str:
    """`J_eq or alpha has the opposite sign`, where one or the other leaves the same recordings; else nothing."""
    others = [other[0] for other in group[0].alternatives if len(other) == 1]
    if len(group) != 1 or len(group[0].alternatives) != 1 or not others or {group[0].kind, others[0].kind} != {'sign'}:
        return ''
    return f'{group[0].quantities[0]} or {others[0].words}'


def phrases(faults: Sequence[Fault]) -> str:
    """Several faults in a clause; those of one kind together."""
    signs = tuple(name for fault in faults if fault.kind == 'sign' for name in fault.quantities)
    together = [*(fault for fault in faults if fault.kind != 'sign'), *([Fault('sign', signs)] if signs else [])]
    return joined_words([fault.phrase for fault in together]) + faults[0].where


def fault_data(fault: Fault) -> dict[str, object]:
    """A fault as plain data."""
    return {
        'kind': fault.kind,
        'quantities': list(fault.quantities),
        'factor': fault.multiplier,
        'recordings': list(fault.recordings),
        'words': fault.words,
        'cure': fault.cure,
        'corrected': fault.corrected,
        'alternatives': [[one.words for one in other] for other in fault.alternatives],
    }
