"""Is a fault of the set-up named, and nothing invented in its place? With and without an effect that is hidden in the robot.

    python benchmarks/set_up_faults.py [--seed 9000] [--minutes 60] [--share 1]

Each case is a robot with fresh parameters and MAS kinetics (sma_sim/challenge), three runs of 40 s at 20 Hz with forces, the
last of them held out; into its recordings one fault is put, in all of them or in one. Every fault meets a robot that lacks
nothing and one with a hidden effect. Counted are faults that are named and corrected, faults that do no harm without being
named, and effects or equations that the robot does not have.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from math import pi
from typing import Any

import numpy as np
from cases import add_options, drawn, of, solved

from sma_sim.challenge.make import RecordingPlan, make_challenge
from sma_sim.evidence.data.recording import Dataset
from sma_sim.evidence.diagnosis.diagnose import diagnose
from sma_sim.evidence.set_up.faults import Fault, with_command
from sma_sim.words.set_up import phrases

PLAN = RecordingPlan(3, 40.0, 20.0)
EFFECTS = ('gravity', 'natural_convection', 'driver_lag', 'guide_friction', 'polycrystal')  # hidden in turn
FORCES, LAST = ('F_1', 'F_2'), ('run3',)
OUTLIERS = ('alpha', 250.0, 0.01)  # a channel, the size of its outliers over its noise, the part of its samples
FAULTS = {
    'J_eq sign': Fault('sign', ('J_eq',)),
    'J_eq sign in run1': Fault('sign', ('J_eq',), recordings=('run1',)),
    'J_eq sign in run3': Fault('sign', ('J_eq',), recordings=LAST),
    'alpha sign': Fault('sign', ('alpha',)),
    'alpha sign in run2': Fault('sign', ('alpha',), recordings=('run2',)),
    'U_x sign': Fault('sign', ('U_x',)),
    'U_y sign': Fault('sign', ('U_y',)),
    'y axis': Fault('sign', ('U_y', 'alpha')),
    'sense of forces': Fault('sign', FORCES),
    'forces swapped': Fault('swap', FORCES),
    'forces swapped in run1': Fault('swap', FORCES, recordings=('run1',)),
    'forces swapped in run3': Fault('swap', FORCES, recordings=LAST),
    'U_x and U_y swapped': Fault('swap', ('U_x', 'U_y')),
    'alpha in degrees': Fault('unit', ('alpha',), pi / 180.0),
    'alpha in degrees in run3': Fault('unit', ('alpha',), pi / 180.0, recordings=LAST),
    'U_y in mm': Fault('unit', ('U_y',), 1e-3),
    'U_x in um': Fault('unit', ('U_x',), 1e-6),
    'J_eq in mW': Fault('unit', ('J_eq',), 1e-3),
    'J_eq in kW': Fault('unit', ('J_eq',), 1e3),
    'commands of run1 and run3 exchanged': Fault('exchanged_commands', ('J_eq',), recordings=('run1', 'run3')),
    'command of run2 in run1': Fault('copied_command', ('J_eq',), recordings=('run1', 'run2')),
    'time in ms': Fault('unit', ('time',), 1e-3),
    'noise 3 times too small': Fault('noise', ('U_x', 'U_y', 'alpha', *FORCES), 3.0),
    'noise 3 times too large': Fault('noise', ('U_x', 'U_y', 'alpha', *FORCES), 1.0 / 3.0),
    'outliers': Fault('outliers', (OUTLIERS[0],)),
}


def with_fault(dataset: Dataset, fault: Fault, random: np.random.Generator) -> Dataset:
    """Recordings as they are read where something is wrong: a sign and an exchange undo themselves."""
    if fault.kind == 'noise':
        noise = {name: std / (fault.factor if name in fault.quantities else 1.0) for name, std in dataset.noise_std.items()}
        return replace(dataset, noise_std=noise)
    if fault.kind == 'copied_command':
        by_name = {one.name: one for one in dataset.recordings}
        wrong, other = (by_name[name] for name in fault.recordings)
        copied = {wrong.name: replace(wrong, source=with_command(wrong.source, other.source))}
        return replace(dataset, recordings=tuple(copied.get(one.name, one) for one in dataset.recordings))
    if fault.kind != 'outliers':
        undone = replace(fault, factor=1.0 / fault.factor)
        return replace(dataset, recordings=undone.in_recordings(dataset.recordings))
    recordings, (channel, size, part) = [], OUTLIERS
    for one in dataset.recordings:
        values = one.channels[channel].copy()
        at = random.choice(len(values), round(part * len(values)), replace=False)
        values[at] += size * dataset.noise_std[channel] * random.choice((-1.0, 1.0), len(at))
        recordings.append(replace(one, channels={**one.channels, channel: values}))
    return replace(dataset, recordings=tuple(recordings))


def solve(name: str, effect: str, seed: int, pool: Executor) -> dict[str, Any]:
    """Diagnose one case."""
    fault, hidden = FAULTS[name], (effect,) if effect else ()
    made = make_challenge(seed, len(hidden), None, hidden, forces=True, plan=PLAN)
    wrong = with_fault(made.dataset, fault, np.random.default_rng(seed))
    found = diagnose(wrong, made.nominal, executor=pool, on_progress=lambda words: None)
    names = [(one.kind, sorted(one.quantities), sorted(one.recordings)) for one in found.set_up]
    is_named = (fault.kind, sorted(fault.quantities), sorted(fault.recordings)) in names or (
        fault.kind in ('noise', 'outliers') and any(one.kind == fault.kind for one in found.set_up)
    )
    signs = [one for one in found.set_up if one.kind == 'sign' and one.recordings == fault.recordings]
    is_named |= fault.kind == 'sign' and sorted(q for one in signs for q in one.quantities) == sorted(fault.quantities)
    is_mirrored = any(phrases(other) == phrases([fault]) for one in found.set_up for other in one.alternatives)
    effects = [one.partition('@')[0] for one in found.effects]
    return {
        'named': is_named or is_mirrored,
        'verdict': found.verdict,
        'effects': effects,
        'invented': [one for one in effects if one != effect] + (['an equation'] if found.proposal is not None else []),
        'missed': [one for one in hidden if one not in effects],
        'error': found.stages[-1].held_out,
        'set_up': [one.words for one in found.set_up],
        'seconds': found.seconds,
    }


def table(results: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """Every case, then the counts."""
    results = [one for one in results if 'failed' not in one]
    yield '| fault | hidden | said of the set-up | verdict | effects | held out |'
    yield '|---|---|---|---|---|---|'
    for one in results:
        said, effects = '; '.join(one['set_up']) or '-', ', '.join(one['effects']) or '-'
        name, effect = one['case'][:2]
        yield f'| {name} | {effect or "-"} | {said} | {one["verdict"]} | {effects} | {one["error"]:.2f} |'
    yield ''
    yield f'named: {of(sum(one["named"] for one in results), len(results))}'
    harmless = sum(not one['invented'] and (one['named'] or not one['missed']) for one in results)
    yield f'named or without harm, and nothing invented: {of(harmless, len(results))}'
    yield f'an effect or an equation too many: {of(sum(bool(one["invented"]) for one in results), len(results))}'
    hidden = [one for one in results if one['case'][1]]
    yield f'the hidden effect found: {of(sum(not one["missed"] for one in hidden), len(hidden))}'


def cases(seed: int) -> list[tuple[str, str, int]]:
    """Every fault with nothing hidden, and with an effect."""
    found = []
    for k, name in enumerate(FAULTS):
        found += [(name, '', seed + 2 * k), (name, EFFECTS[k % len(EFFECTS)], seed + 2 * k + 1)]
    return found


def main() -> None:
    """Diagnose the cases that are not in the file yet, as far as the time goes; print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--seed', type=int, default=9000)
    add_options(parser, 'set_up_faults.jsonl', 60.0)
    asked = parser.parse_args()
    results = solved(drawn(cases(asked.seed), asked.share), solve, asked, lambda one: list(table([one]))[2])
    print(*table(results), sep='\n')


if __name__ == '__main__':
    main()
