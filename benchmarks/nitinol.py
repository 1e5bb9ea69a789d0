"""Diagnosis of a real superelastic wire: stress error on loops that were not fitted, before and after.

    python benchmarks/nitinol.py FOLDER [--only NAME ...] [--model hybrid] [--at-once 2]

FOLDER holds the files of https://github.com/maestrolab/calibration_matlab as CSV (docs/explanation/nitinol.md).
Each case fits some of them and holds others out; the table has every step of every case, good or bad. Finished cases
are kept in --file, so that a run can be continued.
"""

from __future__ import annotations

import argparse
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from cases import add_options, drawn, solved

from sma_sim import Config, Dataset, read_config
from sma_sim.evidence.data.recordings import read_dataset
from sma_sim.evidence.diagnosis.conclusion import ModelStage
from sma_sim.evidence.diagnosis.diagnose import Diagnosis, diagnose
from sma_sim.evidence.model_selection.nominal_fit import DiagnosisRequest

MAPS = Path(__file__).parent.parent / 'examples' / 'maps'
ROUGHLY = ('wire.sigma_MW0=4e8', 'wire.dsigma=2e8')  # read off the loops by eye: the paper's wire is another one
WIRE = ('wire.r0=2e-4', 'wire.l0=0.23946')  # of the electric runs, from the files' origin
ROOM = 294.15


@dataclass(frozen=True)
class Case:
    """Files (`pattern`) read through a map; recordings whose names have one of `held` in them are not fitted."""

    name: str
    pattern: str
    map: str
    held: tuple[str, ...]
    words: tuple[str, ...] = ROUGHLY


ISOTHERM, ELECTRIC = 'nitinol_isotherm.yaml', 'nitinol_electric.yaml'
CASES = (
    Case('across: 0 deg C held out', 'stress_strain_*.csv', ISOTHERM, ('_0C',)),
    Case('across: 40 deg C held out', 'stress_strain_*.csv', ISOTHERM, ('_40C',)),
    Case('across: 100 deg C held out', 'stress_strain_*.csv', ISOTHERM, ('_100C',)),
    Case('within: end of 40 deg C held out', 'stress_strain_*.csv', ISOTHERM, ('_40C#2', '_40C#3')),
    Case('electric: phases -25, 25 held out', 'electric_*.csv', ELECTRIC, ('phase-25', 'phase25'), ROUGHLY + WIRE),
    Case('electric: duty 69 held out', 'electric_*.csv', ELECTRIC, ('duty69',), ROUGHLY + WIRE),
)


def parts(dataset: Dataset, held: tuple[str, ...]) -> tuple[Dataset, Dataset]:
    """The recordings to fit, and those held out."""
    out = tuple(recording for recording in dataset.recordings if any(words in recording.name for words in held))
    rest = tuple(one for one in dataset.recordings if one not in out)
    return replace(dataset, recordings=rest), replace(dataset, recordings=out)


def shown(step: ModelStage, noise: float) -> dict[str, Any]:
    """One step of the fall: effects, and stress RMSE [MPa] fitted and held out."""
    return {
        'effects': list(step.effects),
        'fitted': step.channel_errors['stress'] * noise * 1e-6,
        'held_out': step.held_out_channel_errors['stress'] * noise * 1e-6,
        'values': dict(step.values),
    }


def result(found: Diagnosis) -> dict[str, Any]:
    """What the table needs of a diagnosis."""
    tried = [
        [candidate.name, candidate.error_ratio, candidate.plausible, candidate.log_odds]
        for step in found.selection_steps
        for candidate in step.candidate_fits
    ]
    steps = [shown(stage, found.noise_std['stress']) for stage in found.stages]
    return {'verdict': found.verdict, 'steps': steps, 'tried': tried}


def solve(name: str, model: str, folder: str, pool: Executor) -> dict[str, Any]:
    """Diagnose one case."""
    case = next(case for case in CASES if case.name == name)
    dataset = read_dataset(sorted(Path(folder).glob(case.pattern)), 'wire', ROOM, MAPS / case.map)
    config: Config = read_config(words=['system=wire', *case.words])
    training, held = parts(dataset, case.held)
    return result(diagnose(training, config, held, DiagnosisRequest(kinetics=model, equation=False), executor=pool))


def rows(results: list[dict[str, Any]]) -> list[str]:
    """The table, one row per step."""
    lines = ['| case | effects | fitted [MPa] | held out [MPa] | verdict |', '|---|---|---|---|---|']
    for case in (case for case in results if 'failed' not in case):
        for k, step in enumerate(case['steps']):
            last = k == len(case['steps']) - 1
            lines.append(
                f'| {"" if k else case["case"][0]} | {", ".join(step["effects"]) or "none"} | {step["fitted"]:.1f} '
                f'| {step["held_out"]:.1f} | {case["verdict"] if last else ""} |'
            )
    return lines


def main() -> None:
    """Run the cases that are not done, print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('folder', type=Path)
    parser.add_argument('--only', nargs='*', default=[''], metavar='NAME', help='cases with one of these in their names')
    parser.add_argument('--model', choices=('hybrid', 'mas', 'auto'), default='hybrid')
    add_options(parser, 'nitinol.jsonl', 60.0)
    asked = parser.parse_args()
    chosen = [case.name for case in CASES if any(words in case.name for words in asked.only)]
    cases = [(name, asked.model, str(asked.folder)) for name in chosen]
    done = solved(drawn(cases, asked.share), solve, asked, lambda result: '\n'.join(rows([result])[2:]))
    print(*rows(done), sep='\n')


if __name__ == '__main__':
    main()
