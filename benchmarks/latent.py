"""How often `sma-sim latent` names the right port: challenges with something outside the library, and with nothing hidden.

    python benchmarks/latent.py [--seeds 301 302] [--kinds NAME ...] [--channels forces pose] [--minutes 60] [--at-once 2]

Each case is a robot with other parameters, MAS kinetics and noise (sma_sim/challenge), three runs of 100 s at 50 Hz;
two of them are looked at. Finished cases are kept in --file, so that a run can be continued; the table is of all in it.
"""

from __future__ import annotations

import argparse
from concurrent.futures import Executor
from typing import Any

from cases import add_options, drawn, of, solved

from sma_sim.challenge.make import RecordingPlan, make_challenge
from sma_sim.evidence.latent_input.latent_search import estimate_latent_inputs
from sma_sim.evidence.latent_input.results import LatentInputs

KINDS = (
    'harness_ripple',
    'angle_stop',
    'supply_sag',
    'fraction_convection',
    'magnet',
    'hot_neighbour',
    'warm_beam',
    'backlash',
    'leaking_hinge',
    'fan',
    'shaking_table',
    'drying_film',
    'ageing',
    'supply_limit',
    'sensor_ripple',
    'sensor_drift',
    'none',
)
DETECTABLE = 1.3  # normalized RMSE


def main() -> None:
    """Run what is missing, print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--seeds', type=int, nargs='+', default=[301])
    parser.add_argument('--kinds', nargs='+', default=list(KINDS), choices=KINDS)
    parser.add_argument('--channels', nargs='+', default=['forces', 'pose'], choices=('forces', 'pose'))
    parser.add_argument('--duration', type=float, default=100.0, help='of a run [s]')
    parser.add_argument('--rate', type=float, default=50.0, help='samples per second')
    add_options(parser, 'latent.jsonl', 60.0)
    asked = parser.parse_args()
    cases = [
        (kind, seed, channels, asked.duration, asked.rate)
        for seed in asked.seeds
        for channels in asked.channels
        for kind in asked.kinds
    ]
    print(table(solved(drawn(cases, asked.share), solve, asked, row)))


def solve(kind: str, seed: int, channels: str, duration: float, rate: float, pool: Executor) -> dict[str, Any]:
    """Make one case, and say which port is named."""
    kinds = [] if kind == 'none' else [kind]
    case = make_challenge(
        seed, len(kinds), None, kinds, channels == 'forces', plan=RecordingPlan(duration=duration, rate=rate)
    )
    found = estimate_latent_inputs(case.dataset, case.nominal, executor=pool)
    right = case.answer.effects[0].port if case.answer.effects else ''
    return {
        'port': right,
        'verdict': found.verdict,
        'alike': list(found.indistinguishable),
        'error': found.error,
        'left': found.findings[0].error,
        'probability': found.probability,
        'hooks': hooks(found),
    }


def hooks(found: LatentInputs) -> list[str]:
    """Where the verdict acts, then those named as indistinguishable."""
    if found.verdict == 'none':
        return []
    names = {finding.name: finding.hypothesis.hook for finding in found.findings}
    return [names[found.verdict], *(names[name] for name in found.indistinguishable)]


def mark(case: dict[str, Any]) -> str:
    """Whether the verdict is right."""
    if not case['port']:
        return 'right' if case['verdict'] == 'none' else 'false alarm'
    if case['error'] < DETECTABLE and case['port'] not in case['hooks']:
        return 'not detectable'
    if case['hooks'] and case['hooks'][0] == case['port']:
        return 'right'
    return 'named as indistinguishable' if case['port'] in case['hooks'] else 'wrong'


def row(case: dict[str, Any]) -> str:
    """A line of the table."""
    indistinguishable = ', '.join(case['alike']) or '-'
    kind, seed, channels, *_ = case['case']
    cells = (kind, seed, channels, f'{case["error"]:.2f}', f'{case["left"]:.2f}', case['verdict'], indistinguishable)
    return f'| {" | ".join(map(str, cells))} | {mark(case)} | {case["seconds"]:.0f} |'


def table(done: list[dict[str, Any]]) -> str:
    """All cases, and the counts."""
    head = '| hidden | seed | channels | error | left | port | indistinguishable | mark | seconds |\n' + '|---' * 9 + '|'
    done = [case for case in done if 'failed' not in case]
    marks = [mark(case) for case in done]
    counts = '; '.join(f'{name}: {of(marks.count(name), len(marks))}' for name in dict.fromkeys(marks))
    return '\n'.join([head, *map(row, done), '', counts])


if __name__ == '__main__':
    main()
