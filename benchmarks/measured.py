"""Other people's benches: what a diagnosis names in their recordings, and how it predicts those that it has not seen.

    python benchmarks/measured.py FOLDER [--only NAME ...] [--at-once 1]

FOLDER holds their public recordings, a folder each (docs/reference/validation/measured.md says whose they are). Of each
bench one recording after the other is held out where there are enough of them. Finished cases are kept in --file, so that
a run can be continued.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Mapping
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cases import add_options, drawn, solved

from sma_sim import read_config, read_dataset
from sma_sim.evidence.data.train_test_split import split_dataset
from sma_sim.evidence.diagnosis.diagnose import diagnose
from sma_sim.evidence.model_selection.nominal_fit import DiagnosisRequest

EXAMPLES = Path(__file__).resolve().parents[1] / 'examples' / 'real'
ROOM = 298.0  # [K] where a map says nothing
SHOWN = 0.05  # probability from which the table shows what may be missing
Row = dict[str, Any]


@dataclass(frozen=True)
class Bench:
    """Files of a folder, of which each name in `held_out` (joined by +) is held out in turn; map and parameters beside
    them, or in an example."""

    folder: str
    held_out: tuple[str, ...]
    files: tuple[str, ...] = ()
    map: str = 'map.yaml'
    config: str = 'config.yaml'
    words: tuple[str, ...] = ()
    example: str = ''


NITIHF = ('7MPa', '50MPa', '100MPa', '200MPa', '300MPa', '400MPa')
ISOBARIC = 'isobaric'
BENCHES = {
    'actuator wire, measured stress': Bench('flexinol', ('50MPa', '100MPa', '150MPa', '172MPa', '200MPa')),
    'actuator wire, constant stress': Bench('flexinol', ('100MPa', '150MPa', '172MPa'), map='map_constant_stress.yaml'),
    'NiTiHf, 56 rows a level': Bench('nitihf_sparse', ('100MPa', '200MPa', '300MPa')),
    'NiTiHf': Bench('isobaric/nitihf', NITIHF, example=ISOBARIC),
    'NiTiCo': Bench('isobaric/nitico', ('7MPa', '50MPa', '150MPa', '200MPa'), example=ISOBARIC),
    'blocked element': Bench('blocked_force', ('run2+run4',), example='blocked_force'),
    'slider': Bench('slider', ('step01', 'ramp01', 'step02'), ('step01', 'ramp01', 'step02'), example='slider'),
    'single cycles': Bench('cycles', ('',)),
    'fabric, one warm-up': Bench('thermocouple_pwm', ('',), words=('system=wire',), config=''),
    'dead weight': Bench('static_load', ('',)),
}


def solve(name: str, held_out: str, root: str, pool: Executor) -> Row:
    """Diagnose one bench."""
    bench = BENCHES[name]
    folder = Path(root) / bench.folder
    beside = EXAMPLES / bench.example if bench.example else folder
    files = [folder / f'{file}.csv' for file in bench.files] or sorted(folder.glob('*.csv'))
    config = read_config(beside / bench.config if bench.config else None, list(bench.words))
    dataset = read_dataset(files, config.structure.name, ROOM, beside / bench.map)
    training, judging = split_dataset(dataset, held_out.split('+')) if held_out else (dataset, None)
    start = time.perf_counter()
    found = diagnose(training, config, judging, DiagnosisRequest(kinetics='hybrid', equation=False), executor=pool)
    bare, last = found.nominal, found.stages[-1]
    return {
        'verdict': found.verdict,
        'effects': sorted(found.effects),
        'probable': {name: p for name, p in found.posterior.effects.items() if p >= SHOWN},
        'unlisted': found.posterior.unlisted,
        'none': found.posterior.none,
        'fitted': [bare.train, last.train],
        'predicted': None if judging is None else [bare.held_out, last.held_out],
        'seconds': time.perf_counter() - start,
    }


def table(results: list[Row]) -> list[str]:
    """A row for each bench and recording that was held out."""
    lines = [
        '| bench | held out | verdict | named | probability | fitted | predicted | wall s |',
        '|---|---|---|---|---|---|---|---|',
    ]
    order = list(BENCHES)
    for row in sorted((row for row in results if 'failed' not in row), key=lambda row: order.index(row['case'][0])):
        name, held_out, _ = row['case']
        predicted = change(row['predicted']) if row['predicted'] else ''
        probable = {'nothing': row['none'], 'unlisted': row['unlisted'], **row['probable']}
        shown = ', '.join(f'{name} {p:.3f}' for name, p in probable.items() if p >= SHOWN)
        lines.append(
            f'| {name} | {held_out or "none"} | {row["verdict"]} | {" + ".join(row["effects"])} | {shown} '
            f'| {change(row["fitted"])} | {predicted} | {row["seconds"]:.0f} |'
        )
    return lines


def change(errors: list[float]) -> str:
    """Errors of the nominal model and of the last one."""
    return ' to '.join(f'{error:.3g}' for error in errors)


def ratios(results: list[Row]) -> list[float]:
    """By what the error of what was held out falls, where something was named."""
    rows = [row for row in results if row.get('predicted') and row['effects']]
    return [row['predicted'][0] / row['predicted'][1] for row in rows]


def main() -> None:
    """Run the cases that are not done, print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('folder', type=Path)
    parser.add_argument('--only', nargs='*', default=[''], metavar='NAME', help='benches with one of these in their names')
    add_options(parser, 'measured.jsonl', 60.0)
    asked = parser.parse_args()
    chosen: Mapping[str, Bench] = {
        name: bench for name, bench in BENCHES.items() if any(words in name for words in asked.only)
    }
    cases = [(name, held_out, str(asked.folder)) for name, bench in chosen.items() for held_out in bench.held_out]
    done = solved(drawn(cases, asked.share), solve, asked, lambda result: table([result])[2])
    print(*table(done), sep='\n')


if __name__ == '__main__':
    main()
