"""Is a fault of the set-up named, and nothing invented in its place? With and without an effect that is hidden in the robot.

    python benchmarks/set_up_faults.py [--seed 9400] [--minutes 60] [--share 1] [--set-up-only]

Each case is a robot with fresh parameters and MAS kinetics (sma_sim/challenge), three runs of 40 s at 20 Hz with forces, the
last of them held out; into its recordings one fault is put, in all of them or in one. Every fault meets a robot that lacks
nothing and one with a hidden effect. Counted are faults that are named, recordings that come out as they were before (or as
those of the robot in a mirror), and effects or equations that the robot does not have. `--set-up-only` ends where the search
for physics would begin, which is that of recordings without a fault where they come out as they were.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from functools import partial
from math import pi
from threading import Event
from typing import Any

import numpy as np
from cases import add_options, drawn, of, solved

from sma_sim.challenge.make import RecordingPlan, make_challenge
from sma_sim.evidence.data.recording import Dataset
from sma_sim.evidence.data.train_test_split import hold_out_last
from sma_sim.evidence.diagnosis.diagnose import diagnose
from sma_sim.evidence.estimation.prepared_fit import prepare
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.model_selection.nominal_fit import DiagnosisRequest, nominal_fits
from sma_sim.evidence.set_up.check import faults_after_fit, faults_before_fits
from sma_sim.evidence.set_up.faults import Fault, corrected, is_uncertain, with_command
from sma_sim.model.config import Config
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


def solve(name: str, effect: str, seed: int, pool: Executor, set_up_only: bool = False) -> dict[str, Any]:
    """Diagnose one case, or only find what is wrong with its set-up."""
    fault, hidden = FAULTS[name], (effect,) if effect else ()
    made = make_challenge(seed, len(hidden), None, hidden, forces=True, plan=PLAN)
    wrong = with_fault(made.dataset, fault, np.random.default_rng(seed))
    if set_up_only:
        found = set_up_of(wrong, made.nominal, pool)
        return set_up_result(fault, found, wrong, made.dataset)
    diagnosis = diagnose(wrong, made.nominal, executor=pool, on_progress=lambda words: None)
    effects = [one.partition('@')[0] for one in diagnosis.effects]
    return set_up_result(fault, diagnosis.set_up, wrong, made.dataset) | {
        'verdict': diagnosis.verdict,
        'effects': effects,
        'invented': [one for one in effects if one != effect] + (['an equation'] if diagnosis.proposal is not None else []),
        'missed': [one for one in hidden if one not in effects],
        'error': diagnosis.stages[-1].held_out,
        'seconds': diagnosis.seconds,
    }


def set_up_of(dataset: Dataset, nominal: Config, pool: Executor) -> tuple[Fault, ...]:
    """What a diagnosis finds to be wrong with recordings before it searches for physics."""
    request, training = DiagnosisRequest(), hold_out_last(dataset, None)[0]
    start = prepare(training, nominal)
    context = SearchContext(pool, Event(), kinetics=start.kinetics)
    tried = start.with_kinetics(start.kinetics[0]).config
    faults = faults_before_fits(dataset, tried, request.options, context)
    if is_uncertain(faults):
        return faults
    right = corrected(dataset, faults)
    fits = nominal_fits(prepare(hold_out_last(right, None)[0], nominal), request.options, context)
    best = min(fits, key=lambda fit: fit.cost)
    return (*faults, *faults_after_fit(right, best, request.options, faults, context))


def set_up_result(fault: Fault, found: Sequence[Fault], wrong: Dataset, right: Dataset) -> dict[str, Any]:
    """Whether a fault is named and its recordings come out right."""
    named = {kind_of(one) for one in found}
    signs = [one for one in found if one.kind == 'sign' and one.recordings == fault.recordings]
    together = replace(fault, quantities=tuple(name for one in signs for name in one.quantities))
    is_mirrored = any(phrases(other) == phrases([fault]) for one in found for other in one.alternatives)
    return {
        'named': kind_of(fault) in named or (fault.kind == 'sign' and kind_of(together) == kind_of(fault)) or is_mirrored,
        'restored': is_mirrored or are_the_same(corrected(wrong, found), right),
        'set_up': [one.words for one in found],
    }


def kind_of(fault: Fault) -> tuple[str, ...]:
    """What a fault is and what it concerns; of samples that are wrong, which are not counted one by one, the former only."""
    concerned = () if fault.kind in ('noise', 'outliers') else (*sorted(fault.quantities), *sorted(fault.recordings))
    return (fault.kind, *concerned)


def are_the_same(dataset: Dataset, other: Dataset) -> bool:
    """Whether two datasets hold the same recordings, but for missing samples, and the same noise within 10 %."""
    noise = all(abs(std / other.noise_std[name] - 1.0) < 0.1 for name, std in dataset.noise_std.items())
    return noise and all(
        np.allclose(a.time, b.time)
        and all(np.allclose(x[np.isfinite(x)], b.channels[name][np.isfinite(x)]) for name, x in a.channels.items())
        and a.source.values.shape == b.source.values.shape
        and np.allclose(a.source.values, b.source.values)
        for a, b in zip(dataset.recordings, other.recordings, strict=True)
    )


def table(results: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """Every case, then the counts."""
    results = [one for one in results if 'failed' not in one]
    whole = [one for one in results if 'verdict' in one]
    yield '| fault | hidden | said of the set-up | recordings come out right | verdict | effects | held out | s |'
    yield '|---|---|---|---|---|---|---|---|'
    for one in results:
        said, (name, effect, _) = '; '.join(one['set_up']) or '-', one['case']
        physics = [one['verdict'], ', '.join(one['effects']) or '-', f'{one["error"]:.2f}'] if one in whole else ['-'] * 3
        restored = 'yes' if one['restored'] else 'no'
        yield f'| {name} | {effect or "-"} | {said} | {restored} | {" | ".join(physics)} | {one["seconds"]:.0f} |'
    yield ''
    yield f'named: {of(sum(one["named"] for one in results), len(results))}'
    yield f'recordings come out right: {of(sum(one["restored"] for one in results), len(results))}'
    if whole:
        yield f'an effect or an equation too many: {of(sum(bool(one["invented"]) for one in whole), len(whole))}'
        hidden = [one for one in whole if one['case'][1]]
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
    parser.add_argument('--seed', type=int, default=9400)
    add_options(parser, 'set_up_faults.jsonl', 60.0)
    parser.add_argument('--set-up-only', action='store_true', help='do not search for physics')
    asked = parser.parse_args()
    solve_case = partial(solve, set_up_only=asked.set_up_only)
    results = solved(drawn(cases(asked.seed), asked.share), solve_case, asked, lambda one: list(table([one]))[2])
    print(*table(results), sep='\n')


if __name__ == '__main__':
    main()
