"""Equations of what no known effect explains, on hidden effects that the library does not have.

    python benchmarks/equations.py [--kinds NAME ...] [--seeds 11 12] [--forces] [--bare] [--minutes 20] [--at-once 2]

Each case is a robot with other parameters, MAS kinetics and noise (sma_sim/challenge), three runs of 100 s at 50 Hz, the
last of them held out. Finished cases are kept in --file, so that a run can be continued; the table is of all in it.
`--bare` leaves out the search among known effects, which takes most of the time: the errors before are then those of the
bare model.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager, nullcontext
from typing import Any

from cases import add_options, solved

import sma_sim.evidence.diagnosis.diagnose as diagnosing
from sma_sim.challenge.make import make_challenge
from sma_sim.challenge.truth import truths
from sma_sim.evidence.diagnosis.diagnose import diagnose
from sma_sim.evidence.diagnosis.verdict import as_data

DETECTABLE = 1.3  # held-out error over noise of the best fit without the effect
NO_VARIABLES = {'memory', 'wire', 'constant'}  # what a truth lists beside its states


def solve(kind: str, seed: int, forces: bool, bare: bool, pool: Executor) -> dict[str, Any]:
    """Make one case, diagnose it, and say what was proposed."""
    made = make_challenge(seed, 1, None, (kind,), forces)
    hidden = made.answer.effects[0]
    with nothing_known() if bare else nullcontext():
        data = as_data(diagnose(made.campaign, made.nominal, executor=pool))
    proposed = data.get('proposed')
    return {
        'verdict': data['verdict'], 'effects': data['effects'],
        'port': hidden.port, 'variables': list(hidden.variables),
        'bare': data['error'][0]['held_out'],
        'before': proposed['held_out']['before'] if proposed else data['error'][-1]['held_out'],
        'after': proposed['held_out']['after'] if proposed else None,
        'found': {name: proposed[name] for name in ('port', 'ports', 'formula', 'variables', 'alike')} if proposed else None,
        'values': {name: one['value'] for name, one in proposed['coefficients'].items()} if proposed else None,
    }  # fmt: skip


@contextmanager
def nothing_known() -> Iterator[None]:
    """Without the search among known effects."""
    known = diagnosing.select_forward
    diagnosing.select_forward = lambda base, place: ()
    try:
        yield
    finally:
        diagnosing.select_forward = known


def is_detectable(one: dict[str, Any]) -> bool:
    """Whether the best fit without the effect leaves an error that is no chance."""
    return bool(one['before'] > DETECTABLE)


def port_right(one: dict[str, Any]) -> bool:
    """Whether the formula acts on the port of what is hidden."""
    return bool(one['found']) and one['found']['port'] == one['port']


def variable_right(one: dict[str, Any]) -> bool:
    """Whether the formula depends on all the states on which the hidden effect depends."""
    return port_right(one) and set(one['variables']) - NO_VARIABLES <= set(one['found']['variables'])


def good_after(one: dict[str, Any]) -> bool:
    """Whether the held-out error is near the noise with the proposed effect."""
    return one['after'] is not None and one['after'] <= DETECTABLE


def table(results: list[dict[str, Any]]) -> Iterator[str]:
    """One row per case, then the shares among those that can be seen."""
    results = [one for one in results if 'failed' not in one]
    yield '| hidden | seed | port | variable | error before | after | proposed | seconds |'
    yield '|---|---|---|---|---|---|---|---|'
    for one in sorted(results, key=lambda one: one['case']):
        kind, seed, forces, _ = one['case']
        marks = ['yes' if ok(one) else 'no' for ok in (port_right, variable_right)] if one['found'] else ['', '']
        after = f'{one["after"]:.2f}' if one['after'] is not None else ''
        words = one['found']['formula'] if one['found'] else f'nothing ({one["verdict"]})'
        name = kind + (' (forces)' if forces else '')
        errors = f'{one["before"]:.2f} | {after}'
        yield f'| {name} | {seed} | {" | ".join(marks)} | {errors} | {words} | {one["seconds"]:.0f} |'
    seen = [one for one in results if is_detectable(one)]
    yield ''
    for words, ok in (('port', port_right), ('variable', variable_right), ('held-out error at most 1.3', good_after)):
        yield f'{words}: {sum(map(ok, seen))} of {len(seen)} that can be seen'


def main() -> None:
    """Solve what is not in the file yet, as far as the time goes, and print the table."""
    outside = sorted(name.removeprefix('truth_') for name, one in truths().items() if not one.library)
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--kinds', nargs='+', choices=outside, default=outside, metavar='NAME')
    parser.add_argument('--seeds', nargs='+', type=int, default=[11, 12])
    parser.add_argument('--forces', action='store_true')
    parser.add_argument('--bare', action='store_true')
    add_options(parser, 'equations.jsonl', 20.0)
    asked = parser.parse_args()
    cases = [(kind, seed, asked.forces, asked.bare) for seed in asked.seeds for kind in asked.kinds]
    results = solved(cases, solve, asked, lambda one: list(table([one]))[2])
    print(*table(results), sep='\n')


if __name__ == '__main__':
    main()
