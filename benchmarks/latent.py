"""How often `sma-sim latent` names the right port: challenges with something outside the library, and with nothing hidden.

    python benchmarks/latent.py --seeds 301 302 --out latent.jsonl
    python benchmarks/latent.py --out latent.jsonl --table

Takes up again where it was stopped: every case is a line of the file.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import Any

from sma_sim.challenge.make import make_challenge
from sma_sim.evidence.latent.latent import Latent, latent

KINDS = (
    'harness_ripple', 'angle_stop', 'supply_sag', 'fraction_convection', 'magnet', 'hot_neighbour', 'warm_beam',
    'backlash', 'leaking_hinge', 'fan', 'shaking_table', 'drying_film', 'ageing', 'supply_limit', 'sensor_ripple',
    'sensor_drift', 'none',
)  # fmt: skip
DETECTABLE = 1.3  # error over noise


def main() -> None:
    """Run what is missing, print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--seeds', type=int, nargs='+', default=[301])
    parser.add_argument('--kinds', nargs='+', default=list(KINDS), choices=KINDS)
    parser.add_argument('--channels', nargs='+', default=['forces', 'pose'], choices=('forces', 'pose'))
    parser.add_argument('--duration', type=float, default=100.0, help='of a run [s]')
    parser.add_argument('--rate', type=float, default=50.0, help='samples per second')
    parser.add_argument('--out', type=Path, default=Path('latent.jsonl'))
    parser.add_argument('--table', action='store_true', help='only print the table')
    arguments = parser.parse_args()
    done = read(arguments.out)
    cases = [] if arguments.table else [
        (kind, seed, channels) for seed in arguments.seeds for channels in arguments.channels for kind in arguments.kinds
    ]  # fmt: skip
    for case in cases:
        if case not in {(one['kind'], one['seed'], one['channels']) for one in done}:
            done.append(one := run(*case, arguments.duration, arguments.rate))
            with arguments.out.open('a') as file:
                file.write(json.dumps(one) + '\n')
            print(row(one), flush=True)
    print(table(done))


def read(path: Path) -> list[dict[str, Any]]:
    """The cases that were run before."""
    return [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []


def run(kind: str, seed: int, channels: str, duration: float, rate: float) -> dict[str, Any]:
    """One case."""
    kinds = [] if kind == 'none' else [kind]
    case = make_challenge(seed, len(kinds), None, kinds, channels == 'forces', duration=duration, rate=rate)
    begun = time.process_time()
    found = latent(case.campaign, case.nominal)
    right = case.answer.effects[0].port if case.answer.effects else ''
    return {
        'kind': kind, 'seed': seed, 'channels': channels, 'port': right, 'verdict': found.verdict,
        'alike': list(found.alike), 'error': found.error, 'left': found.findings[0].error, 'p': found.p_value,
        'hooks': hooks(found), 'cpu': time.process_time() - begun, 'wall': found.seconds,
    }  # fmt: skip


def hooks(found: Latent) -> list[str]:
    """Where the verdict acts, then those named as alike."""
    if found.verdict == 'none':
        return []
    names = {one.name: one.hypothesis.hook for one in found.findings}
    return [names[found.verdict], *(names[name] for name in found.alike)]


def mark(one: dict[str, Any]) -> str:
    """What the verdict is worth."""
    if not one['port']:
        return 'right' if one['verdict'] == 'none' else 'false alarm'
    if one['error'] < DETECTABLE and one['port'] not in one['hooks']:
        return 'not detectable'
    if one['hooks'] and one['hooks'][0] == one['port']:
        return 'right'
    return 'named as alike' if one['port'] in one['hooks'] else 'wrong'


def row(one: dict[str, Any]) -> str:
    """A line of the table."""
    alike = ', '.join(one['alike']) or '-'
    cells = (one['kind'], one['seed'], one['channels'], f'{one["error"]:.2f}', f'{one["left"]:.2f}', one['verdict'], alike)
    return f'| {" | ".join(map(str, cells))} | {mark(one)} | {one["cpu"]:.0f} |'


def table(done: list[dict[str, Any]]) -> str:
    """All cases, and the counts."""
    head = '| hidden | seed | channels | error | left | port | alike | mark | CPU s |\n|---|---|---|---|---|---|---|---|---|'
    marks = [mark(one) for one in done]
    counts = ', '.join(f'{marks.count(name)} {name}' for name in dict.fromkeys(marks))
    return '\n'.join([head, *map(row, done), '', counts])


if __name__ == '__main__':
    main()
