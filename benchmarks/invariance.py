"""Is a diagnosis invariant under the form of its data: order, names, units, rates?

    python benchmarks/invariance.py [--cases NAME ...] [--folder DIR ...] [--minutes 60] [--at-once 2]

Each case is a folder of CSV recordings: robots with hidden effects (sma_sim/challenge, three runs of 50 s at 20 Hz, with
forces), and those named by --folder. It is diagnosed as it is, with the runs in another order and under each other's names
(so that another one is held out), with foreign column names and units through a map, with other seeds, and decimated by two:
every second sample, or every second row of the file, rows that tell when the command changed included. Finished ones are
kept in --file, so that a run can be continued; the table is of all in it.
"""

from __future__ import annotations

import argparse
import csv
import shutil
import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from dataclasses import replace
from pathlib import Path
from typing import Any

from cases import add_options, drawn, held_out, of, solved

from sma_sim.challenge.files import write_challenge
from sma_sim.challenge.make import RecordingPlan, make_challenge
from sma_sim.evidence.data.recording import Dataset
from sma_sim.evidence.data.recordings import read_dataset
from sma_sim.evidence.diagnosis.diagnose import diagnose
from sma_sim.evidence.estimation.calibrate import FitOptions
from sma_sim.evidence.model_selection.nominal_fit import NOMINAL_STARTS, DiagnosisRequest
from sma_sim.model.config import read_config
from sma_sim.words.diagnosis_data import as_data

CASES: dict[str, tuple[int, tuple[str, ...]]] = {
    'joint_friction': (15, ('joint_friction',)),
    'natural_convection': (17, ('natural_convection',)),
    'nothing': (5, ()),
    'power_gain_mismatch': (15, ('power_gain_mismatch',)),
    'harness_ripple': (14, ('harness_ripple',)),
    'sensor_gain': (15, ('sensor_gain',)),
    'ambient_heating': (16, ('ambient_heating',)),
    'polycrystal': (14, ('polycrystal',)),
    'gravity + driver_lag': (18, ('gravity', 'driver_lag')),
}
FOREIGN = {  # column, unit of the contract: column and scale of the foreign file, so that SI = scale * foreign
    'time_s': ('t [ms]', 1e-3),
    'J_eq_W': ('power [mW]', 1e-3),
    'T_E_K': ('room', 1.0),
    'U_x_m': ('x [mm]', 1e-3),
    'U_y_m': ('y [um]', 1e-6),
    'alpha_rad': ('angle [deg]', 0.017453292519943295),
    'F_1_N': ('load 1 [mN]', 1e-3),
    'F_2_N': ('load 2 [kgf]', 9.80665),
}
REORDERED = (2, 0, 1)  # which run takes each name
Asked = tuple[Dataset, DiagnosisRequest]


def plain_request(seed: int = 0) -> DiagnosisRequest:
    """A request without intervals and equations, which no verdict needs."""
    return DiagnosisRequest(seed=seed, equation=False, options=FitOptions(starts=NOMINAL_STARTS, seed=seed, intervals=False))


def read(folder: Path, mapping: Path | None = None) -> Dataset:
    """The recordings of a folder."""
    return read_dataset([folder], 'module', 298.0, mapping)


def as_it_is(folder: Path) -> Asked:
    """Nothing changed."""
    return read(folder), plain_request()


def reordered(folder: Path) -> Asked:
    """The runs in another order, under each other's names."""
    dataset = read(folder)
    names = [recording.name for recording in dataset.recordings]
    runs = tuple(replace(dataset.recordings[k], name=name) for k, name in zip(REORDERED, names, strict=True))
    return replace(dataset, recordings=runs[::-1]), plain_request()


def renamed(folder: Path) -> Asked:
    """Files with foreign column names and units, read through a map."""
    with tempfile.TemporaryDirectory() as place:
        home = Path(place)
        for file in sorted(folder.glob('*.csv')):
            with file.open() as source, (home / file.name).open('w', newline='') as out:
                header, *rows = csv.reader(source)
                foreign = csv.writer(out)
                foreign.writerow([FOREIGN[name][0] for name in header])
                foreign.writerows([[in_foreign(name, cell) for name, cell in zip(header, row, strict=True)] for row in rows])
        shutil.copy(folder / 'meta.json', home)
        lines = [f'{name}: {{column: "{FOREIGN[name][0]}", scale: {FOREIGN[name][1]!r}}}' for name in header]
        (home / 'map.yaml').write_text('\n'.join(lines) + '\n')
        return read(home, home / 'map.yaml'), plain_request()


def in_foreign(name: str, cell: str) -> str:
    """A cell of the contract's column `name` in the foreign unit."""
    return repr(float(cell) / FOREIGN[name][1]) if cell else ''


def other_seeds(folder: Path) -> Asked:
    """Other random starts of the fit, and other draws of the score tests."""
    return read(folder), plain_request(seed=29)


def decimated(folder: Path) -> Asked:
    """Every second sample; the command as it was."""
    dataset = read(folder)
    halves = tuple(
        replace(
            recording, time=recording.time[::2], channels={name: values[::2] for name, values in recording.channels.items()}
        )
        for recording in dataset.recordings
    )
    return replace(dataset, recordings=halves), plain_request()


def every_second_row(folder: Path) -> Asked:
    """Every second row of each file, whatever it holds."""
    with tempfile.TemporaryDirectory() as place:
        home = Path(place)
        for file in folder.glob('*.csv'):
            header, *rows = file.read_text().splitlines()
            (home / file.name).write_text('\n'.join([header, *rows[::2]]) + '\n')
        shutil.copy(folder / 'meta.json', home)
        return read(home), plain_request()


VARIANTS: dict[str, Callable[[Path], Asked]] = {
    'as it is': as_it_is,
    'reordered': reordered,
    'renamed': renamed,
    'other seeds': other_seeds,
    'decimated': decimated,
    'every second row': every_second_row,
}


def solve(folder: str, variant: str, pool: Executor) -> dict[str, Any]:
    """Diagnose one variant of a case: a folder, or a challenge that is made."""
    with tempfile.TemporaryDirectory() as home:
        place = Path(folder) if folder not in CASES else made(folder, Path(home) / 'case')
        nominal = place / 'nominal.yaml'
        config = read_config(nominal if nominal.exists() else None)
        dataset, request = VARIANTS[variant](place)
        data = as_data(diagnose(dataset, config, request=request, executor=pool))
    return {
        'verdict': data['verdict'],
        'effects': data['effects'],
        'bare': held_out(data['error'][0]),
        'last': held_out(data['error'][-1]),
    }


def made(name: str, folder: Path) -> Path:
    """The folder of a challenge."""
    seed, kinds = CASES[name]
    write_challenge(
        make_challenge(seed, len(kinds), kinds=kinds, forces=True, plan=RecordingPlan(duration=50.0, rate=20.0)),
        folder,
        'csv',
    )
    return folder


def table(done: list[dict[str, Any]]) -> Iterator[str]:
    """A row per case: what it is as it is, and what becomes of it in each variant."""
    yield '| case | nominal | verdict | ' + ' | '.join(list(VARIANTS)[1:]) + ' |'
    yield '|' + '---|' * (len(VARIANTS) + 2)
    same: list[bool] = []
    for name in dict.fromkeys(case['case'][0] for case in done):
        found = {case['case'][1]: case for case in done if case['case'][0] == name}
        first = found.pop('as it is', None)
        if first is not None:
            cells = [cell(found.get(variant), first) for variant in list(VARIANTS)[1:]]
            nominal_error = 'cannot be run' if first['bare'] is None else f'{first["bare"]:.2f}'
            yield f'| {Path(name).name} | {nominal_error} | {words(first)} | ' + ' | '.join(cells) + ' |'
            same += [cell == 'same' for cell in cells if cell]
    yield f'\nthe same verdict and first effect: {of(sum(same), len(same))}'


def words(one: dict[str, Any]) -> str:
    """A verdict in short."""
    return ' '.join([f'`{one["verdict"]}`', ', '.join(one['effects'])]).strip()


def cell(one: dict[str, Any] | None, first: dict[str, Any]) -> str:
    """What became of a variant: the same verdict and first effect, or which other."""
    if one is None:
        return ''
    same = one['verdict'] == first['verdict'] and one['effects'][:1] == first['effects'][:1]
    return 'same' if same else words(one)


def main() -> None:
    """Run what is missing, as long as there is time; print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--cases', nargs='*', default=list(CASES), choices=CASES, help='of challenges; all by default')
    parser.add_argument('--folder', nargs='*', default=[])
    add_options(parser, 'invariance.jsonl', 60.0)
    asked = parser.parse_args()
    cases = drawn([(name, variant) for name in asked.cases for variant in VARIANTS], asked.share, lambda case: case[0])
    folders = [(name, variant) for variant in VARIANTS for name in asked.folder]  # each of them as it is comes first
    cases = (cases if asked.cases else []) + folders[: round(asked.share * len(folders))]
    done = solved(cases, solve, asked, str)
    print(*table(done), sep='\n')


if __name__ == '__main__':
    main()
