"""Diagnosis of a real superelastic wire: stress error on loops that were not fitted, before and after.

    python benchmarks/nitinol.py FOLDER [--only NAME ...] [--model hybrid]

FOLDER holds the files of https://github.com/maestrolab/calibration_matlab as CSV (docs/nitinol.md). Each case fits some
of them and holds others out; the table has every step of every case, good or bad. Cases that are in nitinol.jsonl
already are not run again.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from sma_sim import Campaign, Config, read_config
from sma_sim.evidence.diagnose import Diagnosis, Request, Step, diagnose
from sma_sim.evidence.recordings import read_campaign

FILE = Path('nitinol.jsonl')
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
)  # fmt: skip


def parts(campaign: Campaign, held: tuple[str, ...]) -> tuple[Campaign, Campaign]:
    """The recordings to fit, and those held out."""
    out = tuple(one for one in campaign.recordings if any(words in one.name for words in held))
    rest = tuple(one for one in campaign.recordings if one not in out)
    return replace(campaign, recordings=rest), replace(campaign, recordings=out)


def shown(step: Step, noise: float) -> dict[str, Any]:
    """One step of the fall: effects, and stress RMSE [MPa] fitted and held out."""
    return {
        'effects': list(step.effects), 'fitted': step.channels['stress'] * noise * 1e-6,
        'held_out': step.held_out_channels['stress'] * noise * 1e-6, 'values': step.values,
    }  # fmt: skip


def result(case: Case, found: Diagnosis) -> dict[str, Any]:
    """What the table needs of a diagnosis."""
    tried = [[one.name, one.ratio, one.plausible, one.family_p] for round_ in found.rounds for one in round_.tried]
    steps = [shown(step, found.noise_std['stress']) for step in found.steps]
    return {'case': case.name, 'verdict': found.verdict, 'steps': steps, 'tried': tried, 'seconds': found.seconds}


def run(case: Case, folder: Path, model: str) -> dict[str, Any]:
    """Diagnose one case."""
    campaign = read_campaign(sorted(folder.glob(case.pattern)), 'wire', ROOM, MAPS / case.map)
    config: Config = read_config(words=['system=wire', *case.words])
    training, held = parts(campaign, case.held)
    return result(case, diagnose(training, config, held, Request(model=model), told=print))


def rows(results: list[dict[str, Any]]) -> list[str]:
    """The table, one row per step."""
    lines = ['| case | effects | fitted [MPa] | held out [MPa] | verdict |', '|---|---|---|---|---|']
    for one in results:
        for k, step in enumerate(one['steps']):
            last = k == len(one['steps']) - 1
            lines.append(f'| {"" if k else one["case"]} | {", ".join(step["effects"]) or "none"} | {step["fitted"]:.1f} '
                         f'| {step["held_out"]:.1f} | {one["verdict"] if last else ""} |')  # fmt: skip
    return lines


def main() -> None:
    """Run the cases that are not done, print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('folder', type=Path)
    parser.add_argument('--only', nargs='*', default=[''], metavar='NAME', help='cases with one of these in their names')
    parser.add_argument('--model', choices=('hybrid', 'mas', 'auto'), default='hybrid')
    arguments = parser.parse_args()
    done = [json.loads(line) for line in FILE.read_text().splitlines()] if FILE.exists() else []
    for case in CASES:
        if any(one['case'] == case.name for one in done) or not any(words in case.name for words in arguments.only):
            continue
        done.append(run(case, arguments.folder, arguments.model))
        with FILE.open('a') as file:
            file.write(json.dumps(done[-1]) + '\n')
    print(*rows(done), sep='\n')


if __name__ == '__main__':
    main()
