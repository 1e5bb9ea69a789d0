"""Listed effects that act in another form: in one coordinate, in one wire, through shared air, with another exponent.

    python benchmarks/other_forms.py [--forms NAME ...] [--seeds 51] [--channels pose] [--no-variants] [--minutes 60]
                                     [--at-once 1]

Each case is a robot with other parameters, MAS kinetics and noise (sma_sim/challenge), three runs of 100 s at 50 Hz, the
last of them held out; the hidden effects are those of `other_form_truths.py`. Finished cases are kept in --file, so that a
run can be continued; the table is of all in it. Processor seconds are those of the case's process.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from concurrent.futures import Executor
from typing import Any

from cases import add_options, drawn, held_out, of, solved
from other_form_truths import FORMS

from sma_sim.challenge.make import challenge_with
from sma_sim.evidence.diagnosis.diagnose import diagnose
from sma_sim.evidence.model_selection.nominal_fit import DiagnosisRequest
from sma_sim.words.diagnosis_data import as_data

DETECTABLE = 1.3  # held-out normalized RMSE of the best fit without the effect
GOOD = 1.1  # held-out normalized RMSE that a right explanation leaves
CHANNELS = ('forces', 'pose')  # what is recorded: the forces too, or the pose alone


def solve(name: str, seed: int, forces: bool, variants: bool, pool: Executor) -> dict[str, Any]:
    """Make one case, diagnose it, and say what was found."""
    made = challenge_with((FORMS[name].truth,), seed, forces)
    t_start = time.process_time()
    data = as_data(diagnose(made.dataset, made.nominal, request=DiagnosisRequest(variants=variants), executor=pool))
    used = time.process_time() - t_start
    proposed, last = data.get('proposed'), data['error'][-1]
    return {
        'verdict': data['verdict'],
        'effects': data['effects'],
        'variants': data.get('variants', {}),
        'names': names_with_scopes(data),
        'nominal': held_out(data['error'][0]),
        'last': held_out(last),
        'train': last['train'],
        'formula': proposed['formula'] if proposed else None,
        'terms': proposed['term'] if proposed else [],
        'place': proposed['place'] if proposed else None,
        'processor_seconds': used,
        'retracted': data['retracted'],
    }


def names_with_scopes(data: dict[str, Any]) -> list[str]:
    """The effects of the last model, as NAME@SCOPE in a scope: the names under which their parameters stand."""
    full = dict.fromkeys(name.split('.')[1] for name in data['parameters'] if name.startswith('effects.'))
    return [name for name in full if name.partition('@')[0] in data['effects']]


def is_detectable(result: dict[str, Any]) -> bool:
    """Whether the best fit without the effect leaves an error that is no chance."""
    return bool(result['nominal'] > DETECTABLE)


def named_right(result: dict[str, Any]) -> bool:
    """Whether the listed effect is found, in whatever form."""
    return FORMS[result['case'][0]].effect in result['effects']


def scope_right(result: dict[str, Any]) -> bool:
    """Whether its scope is right too."""
    expected = FORMS[result['case'][0]]
    scopes = {name.partition('@')[2] for name in result['names'] if name.partition('@')[0] == expected.effect}
    return bool(scopes.intersection(expected.scopes))


def formula_right(result: dict[str, Any]) -> bool:
    """Whether the equation that is proposed is exactly the truth."""
    return tuple(result['terms']) in FORMS[result['case'][0]].terms


def absorbed(result: dict[str, Any]) -> bool:
    """Whether nothing is said to be missing where parameters of the model can absorb the truth, or it cannot be seen."""
    nothing = result['verdict'] == 'none'
    return nothing and (not FORMS[result['case'][0]].effect or not is_detectable(result))


def is_right(result: dict[str, Any]) -> bool:
    """Right name and scope, or exactly the true formula."""
    return (scope_right(result) and result['verdict'] == 'missing_effect') or formula_right(result) or absorbed(result)


def extra_effects(result: dict[str, Any]) -> list[str]:
    """Effects that are named beside the listed one, or beside a formula."""
    expected = FORMS[result['case'][0]].effect
    return [name for name in result['effects'] if name != expected]


def table(results: list[dict[str, Any]]) -> Iterator[str]:
    """One row per case, then the shares."""
    failed = [result for result in results if 'failed' in result]
    results = [result for result in results if 'failed' not in result]
    yield '| form | seed | recorded | variants | error without | with | verdict | found | right | extra | processor s | s |'
    yield '|---|---|---|---|---|---|---|---|---|---|---|---|'
    for result in sorted(results, key=lambda result: result['case']):
        name, seed, forces, variants = result['case']
        found = ', '.join(result['names']) + (f' ({result["formula"]})' if result['formula'] else '')
        right = 'yes' if is_right(result) else 'name' if named_right(result) else 'no'
        yield (
            f'| {name} | {seed} | {CHANNELS[not forces]} | {"yes" if variants else "no"} | '
            f'{result["nominal"]:.2f} | {result["last"]:.2f} | '
            f'`{result["verdict"]}` | {found or "-"} | {right} | {", ".join(extra_effects(result))} | '
            f'{result["processor_seconds"]:.0f} | {result["seconds"]:.0f} |'
        )
    yield ''
    if failed:
        yield f'refused by the program: {len(failed)}'
    if not results:
        return
    count = len(results)
    good = sum(result['last'] <= GOOD for result in results)
    yield f'right name and scope, or exactly the true formula: {of(sum(map(is_right, results)), count)}'
    yield f'an effect too many: {of(sum(bool(extra_effects(result)) for result in results), count)}'
    yield f'held-out error at most {GOOD}: {of(good, count)}'


def main() -> None:
    """Solve what is not in the file yet, as far as the time goes, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--forms', nargs='+', choices=list(FORMS), default=list(FORMS), metavar='NAME')
    parser.add_argument('--seeds', nargs='+', type=int, default=[51])
    parser.add_argument('--no-variants', action='store_true', help='the diagnosis tries no variants of the effects')
    parser.add_argument('--channels', nargs='+', default=['pose'], choices=CHANNELS)
    add_options(parser, 'other_forms.jsonl', 60.0)
    asked = parser.parse_args()
    recorded = [name == 'forces' for name in asked.channels]
    cases = [
        (name, seed, forces, not asked.no_variants) for seed in asked.seeds for forces in recorded for name in asked.forms
    ]
    results = solved(drawn(cases, asked.share), solve, asked, lambda result: list(table([result]))[2])
    print(*table(results), sep='\n')


if __name__ == '__main__':
    main()
