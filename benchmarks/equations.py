"""Equations of what no known effect explains, on hidden effects that the library does not have.

    python benchmarks/equations.py [--kinds NAME ...] [--seeds 11 12] [--forces] [--no-known-effects] [--minutes 20]
                                   [--at-once 2]

Each case is a robot with other parameters, MAS kinetics and noise (sma_sim/challenge), three runs of 100 s at 50 Hz, the
last of them held out. Finished cases are kept in --file, so that a run can be continued; the table is of all in it.
`--no-known-effects` leaves out the search among known effects, which takes most of the time: the errors before are then
those of the nominal model.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager, nullcontext
from typing import Any

from cases import add_options, drawn, of, solved

import sma_sim.evidence.search.beam as beam
from sma_sim.challenge.make import make_challenge
from sma_sim.challenge.truth import truths
from sma_sim.evidence.diagnosis.diagnose import diagnose
from sma_sim.evidence.search.components import Catalogue
from sma_sim.words.diagnosis_data import as_data

DETECTABLE = 1.3  # held-out normalized RMSE of the best fit without the effect
NO_VARIABLES = {'memory', 'wire', 'constant'}  # what a truth lists beside its states


def solve(kind: str, seed: int, forces: bool, unknown_only: bool, pool: Executor) -> dict[str, Any]:
    """Make one case, diagnose it, and say what was proposed."""
    made = make_challenge(seed, 1, None, (kind,), forces)
    hidden = made.answer.effects[0]
    with no_known_effects() if unknown_only else nullcontext():
        data = as_data(diagnose(made.dataset, made.nominal, executor=pool))
    proposed = data.get('proposed')
    return {
        'verdict': data['verdict'],
        'effects': data['effects'],
        'port': hidden.port,
        'variables': list(hidden.variables),
        'nominal': data['error'][0]['held_out'],
        'before': proposed['held_out']['before'] if proposed else data['error'][-1]['held_out'],
        'after': proposed['held_out']['after'] if proposed else None,
        'found': {name: proposed[name] for name in ('port', 'ports', 'formula', 'variables', 'alike')} if proposed else None,
        'values': {name: c['value'] for name, c in proposed['coefficients'].items()} if proposed else None,
    }


@contextmanager
def no_known_effects() -> Iterator[None]:
    """With an empty catalogue of effects."""
    known = beam.catalogue_for
    beam.catalogue_for = lambda *_: Catalogue((), ())
    try:
        yield
    finally:
        beam.catalogue_for = known


def is_detectable(result: dict[str, Any]) -> bool:
    """Whether the best fit without the effect leaves an error that is no chance."""
    return bool(result['before'] > DETECTABLE)


def port_right(result: dict[str, Any]) -> bool:
    """Whether the formula acts on the port of what is hidden."""
    return bool(result['found']) and result['found']['port'] == result['port']


def variable_right(result: dict[str, Any]) -> bool:
    """Whether the formula depends on all the states on which the hidden effect depends."""
    return port_right(result) and set(result['variables']) - NO_VARIABLES <= set(result['found']['variables'])


def good_after(result: dict[str, Any]) -> bool:
    """Whether the held-out error is near the noise with the proposed effect."""
    return result['after'] is not None and result['after'] <= DETECTABLE


def table(results: list[dict[str, Any]]) -> Iterator[str]:
    """One row per case, then the shares among those that can be seen."""
    results = [result for result in results if 'failed' not in result]
    yield '| hidden | seed | port | variable | error before | after | proposed | seconds |'
    yield '|---|---|---|---|---|---|---|---|'
    for result in sorted(results, key=lambda result: result['case']):
        kind, seed, forces, _ = result['case']
        marks = ['yes' if ok(result) else 'no' for ok in (port_right, variable_right)] if result['found'] else ['', '']
        after = f'{result["after"]:.2f}' if result['after'] is not None else ''
        words = result['found']['formula'] if result['found'] else f'nothing ({result["verdict"]})'
        name = kind + (' (forces)' if forces else '')
        errors = f'{result["before"]:.2f} | {after}'
        yield f'| {name} | {seed} | {" | ".join(marks)} | {errors} | {words} | {result["seconds"]:.0f} |'
    seen = [result for result in results if is_detectable(result)]
    yield ''
    for words, ok in (('port', port_right), ('variable', variable_right), ('held-out error at most 1.3', good_after)):
        yield f'{words}: {of(sum(map(ok, seen)), len(seen))} that can be seen'


def main() -> None:
    """Solve what is not in the file yet, as far as the time goes, and print the table."""
    outside = sorted(name.removeprefix('truth_') for name, truth in truths().items() if not truth.library)
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--kinds', nargs='+', choices=outside, default=outside, metavar='NAME')
    parser.add_argument('--seeds', nargs='+', type=int, default=[11, 12])
    parser.add_argument('--forces', action='store_true')
    parser.add_argument('--no-known-effects', action='store_true')
    add_options(parser, 'equations.jsonl', 20.0)
    asked = parser.parse_args()
    cases = [(kind, seed, asked.forces, asked.no_known_effects) for seed in asked.seeds for kind in asked.kinds]
    results = solved(drawn(cases, asked.share), solve, asked, lambda result: list(table([result]))[2])
    print(*table(results), sep='\n')


if __name__ == '__main__':
    main()
