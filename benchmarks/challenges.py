"""Hidden effects found and not found: the diagnosis on robots of which it knows nothing.

    python benchmarks/challenges.py [--part library nothing pairs outside] [--channels forces pose] [--seeds 1 2 3]
                                    [--minutes 20] [--at-once 2]

Each case is a robot with other parameters, MAS kinetics and noise (sma_sim/challenge), three runs of 100 s at 50 Hz, with
and without forces. Finished cases are kept in --file, so that a run can be continued; the table is of all in it.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from concurrent.futures import Executor
from typing import Any

import numpy as np
from cases import add_options, drawn, held_out, solved

from sma_sim.challenge.make import make_challenge
from sma_sim.challenge.truth import truths
from sma_sim.evidence.diagnosis.diagnose import diagnose
from sma_sim.evidence.model_selection.nominal_fit import DiagnosisRequest
from sma_sim.evidence.search.posterior import EVEN
from sma_sim.words.diagnosis_data import as_data

DETECTABLE = 1.3  # held-out normalized RMSE of the best fit without the effect
PAIRS = (
    ('gravity', 'natural_convection'),
    ('joint_friction', 'ambient_heating'),
    ('polycrystal', 'gravity'),
    ('beam_creep', 'driver_lag'),
    ('power_gain_mismatch', 'natural_convection'),
    ('guide_friction', 'gravity'),
    ('resistance_feedback', 'sensor_gain'),
    ('beam_nonlinearity', 'thermal_crosstalk'),
    ('clausius_clapeyron_mismatch', 'pretension_mismatch'),
    ('sensor_lag', 'gravity'),
)
CHANNELS = ('forces', 'pose')  # what is recorded: the forces too, or the pose alone
Case = tuple[str, tuple[str, ...], int, bool]  # part, hidden effects, seed, with forces


def cases(parts: list[str], channels: list[str], seeds: list[int]) -> Iterator[Case]:
    """All cases, in an order in which a part of them tells something of all; only the library's are of every seed."""
    known = sorted({one.library for one in truths().values() if one.library})
    beyond = sorted(name for name, one in truths().items() if not one.library)
    first = seeds[0]
    for seed in seeds:
        for forces in (one == 'forces' for one in channels):
            if 'library' in parts:
                yield from (('library', (name,), seed, forces) for name in known)
            if 'outside' in parts and seed == first:
                yield from (('outside', (name,), seed, forces) for name in beyond)
            if 'pairs' in parts and seed == first:
                yield from (('pairs', pair, seed, forces) for pair in PAIRS)
    if 'nothing' in parts:
        yield from (('nothing', (), 1000 * first + k, k % 2 == 0) for k in range(100) if CHANNELS[k % 2] in channels)


def solve(part: str, hidden: tuple[str, ...], seed: int, forces: bool, pool: Executor) -> dict[str, Any]:
    """Make one case, diagnose it, and say how that went."""
    made = make_challenge(seed, len(hidden), None, hidden, forces)
    data = as_data(diagnose(made.dataset, made.nominal, request=DiagnosisRequest(equation=False), executor=pool))
    ranked = [one['effect'] for one in data['ranking']]
    return {
        'verdict': data['verdict'],
        'model': data['model'],
        'effects': data['effects'],
        'ranked': ranked,
        'alike': data['ranking'][0]['confounded_with'] if ranked else [],
        'probabilities': data['probabilities'],
        'bare': held_out(data['error'][0]),
        'last': held_out(data['error'][-1]),
        'together': data.get('fitted_together'),
    }


def is_right(one: dict[str, Any]) -> bool:
    """Whether the first effect is a hidden one, or one that the report itself cannot tell from it."""
    _, hidden, _, _ = one['case']
    first = one['effects'][:1]
    return bool(first) and (first[0] in hidden or any(name in one['alike'] for name in hidden))


def is_detectable(one: dict[str, Any]) -> bool:
    """Whether the best fit without effects misses the held-out run, and does so even when it is fitted to that run too."""
    together = one.get('together')
    left = max(together['train'], together['held_out']) if together else DETECTABLE
    reconciled = not one['effects'] and left <= DETECTABLE and not (together and together['unlisted'] > EVEN)
    return one['bare'] > DETECTABLE and not reconciled


def summary(results: list[dict[str, Any]]) -> Iterator[str]:
    """The table."""

    def part_of(name: str) -> list[dict[str, Any]]:
        return [one for one in results if one['case'][0] == name]

    failed = [one for one in results if 'failed' in one]
    results = [one for one in results if 'failed' not in one]
    if failed:
        yield f'refused by the program: {len(failed)}'
    alone = part_of('library')
    seen = [one for one in alone if is_detectable(one)]
    unseen = [one for one in alone if not is_detectable(one)]
    yield f'detectable, the right effect first: {sum(map(is_right, seen))} of {len(seen)}'
    right_after = [one['last'] for one in seen if is_right(one)]
    if right_after:
        yield f'  held-out normalized RMSE after adding: median {np.median(right_after):.2f}, worst {max(right_after):.2f}'
    fine = sum(not one['effects'] or is_right(one) for one in unseen)
    yield f'undetectable, nothing or the right one: {fine} of {len(unseen)}'
    nothing = part_of('nothing')
    yield f'nothing missing, false alarms: {sum(one["verdict"] != "none" for one in nothing)} of {len(nothing)}'
    if nothing:
        yield f'  mean P(none): {np.mean([one["probabilities"]["none"] for one in nothing]):.3f}'
    pairs = part_of('pairs')
    single = [one for one in pairs if not set(one['case'][1]) <= set(one['effects'])]
    covered = sum(is_right(one) and one['last'] <= DETECTABLE for one in single)
    yield f'pairs, both found: {len(pairs) - len(single)} of {len(pairs)}'
    yield f'  one of them, which leaves at most {DETECTABLE}: the other cannot be detected beside it: {covered}'
    outside = [one for one in part_of('outside') if is_detectable(one)]
    unknown = sum(one['verdict'] == 'unknown_effect' for one in outside)
    yield f'outside the library, unknown_effect: {unknown} of {len(outside)}'
    times = [one['seconds'] for one in results]
    if times:
        yield f'seconds: median {np.median(times):.0f}, longest {max(times):.0f}'
    for one in results:
        part, hidden, seed, forces = one['case']
        mark = 'right' if is_right(one) else ('none' if not one['effects'] else 'WRONG')
        yield (
            f'{part:8} {"+".join(hidden) or "-":42} {seed:5} {"forces" if forces else "pose":6} '
            f'nominal {one["bare"]:6.2f} -> {one["last"]:6.2f} {one["verdict"]:15} {mark:6} {", ".join(one["effects"])}'
            + (f' (like {", ".join(one["alike"])})' if one['alike'] else '')
        )


def main() -> None:
    """Solve what is not solved yet, as long as there is time; print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--part', nargs='+', default=['library', 'nothing', 'pairs', 'outside'])
    parser.add_argument('--seeds', type=int, nargs='+', default=[1, 2, 3])
    parser.add_argument('--channels', nargs='+', default=list(CHANNELS), choices=CHANNELS)
    add_options(parser, 'challenges.jsonl', 20.0)
    asked = parser.parse_args()
    chosen = drawn(list(cases(asked.part, asked.channels, asked.seeds)), asked.share)
    done = solved(chosen, solve, asked, lambda one: list(summary([one]))[-1])
    print(*summary(done), sep='\n')


if __name__ == '__main__':
    main()
