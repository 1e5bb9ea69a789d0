"""What a session gives away: the parameter file, the report, and shell commands and Python lines that do the same again."""

from __future__ import annotations

import shlex
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sma_sim.evidence.data.tables import write_whole
from sma_sim.explore.history import Version
from sma_sim.explore.jobs import COMMANDS, REPORT, RESULT, Job
from sma_sim.explore.session import Session
from sma_sim.explore.stages import Engine
from sma_sim.explore.work import diagnosis_request, fit_options
from sma_sim.model.errors import UserError
from sma_sim.model.given import effect_folders_of
from sma_sim.workflow.code_folders import folders_from, parameter_file_at
from sma_sim.workflow.data_request import DataRequest

START, PARAMETERS, REPORT_FILE, COMPARISON, SHELL, PYTHON = (
    'start.yaml',
    'parameters.yaml',
    'report.html',
    'comparison.json',
    'reproduce.sh',
    'reproduce.py',
)
OUTPUTS = 'again'  # where the commands and the Python lines write


@dataclass(frozen=True)
class Export:
    """The files in `folder`, and the text of the commands (`shell`) and of the Python lines (`python`)."""

    folder: Path
    files: tuple[Path, ...]
    shell: str
    python: str


def export(engine: Engine, folder: Path | None = None) -> Export:
    """Write the current version with its report and the way to it; by default into the session's ``export`` folder.

    Raises UserError where the version was not compared with the recordings, and for a folder that cannot be written.
    """
    session = engine.session
    compared = engine.latest('compare')
    if (reason := engine.reason('export')) or compared is None or session.data is None:
        raise UserError(f'export: {reason}')
    folder = folder or session.folder / 'export' / f'{session.current.number:04}'
    start, steps = steps_to(engine, session.current)
    try:
        (folder / OUTPUTS).mkdir(parents=True, exist_ok=True)
        write_version(session, session.current, folder / PARAMETERS)
        write_version(session, start, folder / START)
        shutil.copyfile(compared.folder / REPORT, folder / REPORT_FILE)
        shutil.copyfile(compared.folder / RESULT, folder / COMPARISON)
    except OSError as error:
        raise UserError(f'cannot write {folder}: {error.strerror}') from error
    head = headline(session, start)
    shell, python = shell_text(head, session.data, steps), python_text(head, session.data, steps)
    for name, text in ((SHELL, shell), (PYTHON, python)):
        write_whole(folder / name, lambda file, text=text: file.write(text))
    names = (PARAMETERS, REPORT_FILE, COMPARISON, START, SHELL, PYTHON)
    return Export(folder, tuple(folder / name for name in names), shell, python)


def steps_to(engine: Engine, version: Version) -> tuple[Version, list[Job]]:
    """The version that was made by hand, and the steps that lead from it to another.

    A step that was stopped cannot be repeated: its model is where the way begins.
    """
    steps: list[Job] = []
    while version.step is not None and (job := engine.job(version.step)).state == 'done':
        steps.insert(0, job)
        version = engine.session.version(job.version)
    return version, steps


def write_version(session: Session, version: Version, path: Path) -> None:
    """A version's parameter file elsewhere; effects that lie in the session are copied beside it."""
    inside, folders = session.folder.resolve(), []
    for folder in effect_folders_of(session.file(version.number), ()):
        home = folder.resolve()
        if home.is_relative_to(inside):
            copy = path.with_name(f'effects_of_{home.parent.name}')
            shutil.copytree(home, copy, dirs_exist_ok=True, ignore=shutil.ignore_patterns('__pycache__'))
            home = copy
        folders.append(home)
    text = f'# {version.words}\n' + parameter_file_at(path, session.config(version.number), folders_from(path, folders))
    write_whole(path, lambda file: file.write(text))


def headline(session: Session, start: Version) -> list[str]:
    """What the scripts say of themselves."""
    ways: list[Version] = [start]
    while (parent := ways[0].parent) is not None:
        ways.insert(0, session.version(parent))
    lines = [f'From version {start.number} to version {session.current.number} of the session {session.folder.name}.']
    return [*lines, f'{START} is version {start.number}:', *(f'  {one.number}. {one.words}' for one in ways)]


def shell_text(head: Sequence[str], request: DataRequest, steps: Sequence[Job]) -> str:
    """The commands, from the first model to the comparison of the last."""
    lines = ['#!/bin/sh', *(f'# {line}' for line in head), 'set -e', 'cd "$(dirname "$0")"', f'mkdir -p {OUTPUTS}']
    config = START
    for k, job in enumerate(steps, 1):
        out = f'{OUTPUTS}/{k}_{job.stage}'
        words = ['sma-sim', COMMANDS[job.stage], *request.options(), '--config', config, *job.command_options()]
        lines.append(shlex.join([*words, '-o', f'{out}.yaml', '--json', f'{out}.json', '--report', f'{out}.html']))
        config = f'{out}.yaml'
    words = ['sma-sim', 'compare', *request.options(), '--config', config]
    outputs = ['--json', f'{OUTPUTS}/{COMPARISON}', '--report', f'{OUTPUTS}/{REPORT_FILE}']
    return '\n'.join([*lines, shlex.join([*words, *outputs]), ''])


def python_text(head: Sequence[str], request: DataRequest, steps: Sequence[Job]) -> str:
    """The Python lines that do what the commands do."""
    body = ["config = sma_sim.read_config(HERE / 'start.yaml')"]
    for k, job in enumerate(steps, 1):
        body += ['', *read_lines(), *STEP_LINES[job.stage](job.options)]
        body += [
            f"file = OUT / '{k}_{job.stage}_by_python.yaml'",
            WRITE_LINES[job.stage],
            'config = sma_sim.read_config(file)',
        ]
    body += ['', *read_lines(is_fitted=False), "summary = summarize(sma_sim.compare(fitted, config, held_out, 'by Python'))"]
    body += ["write_json(OUT / 'comparison_by_python.json', comparison_result([summary], (), fitted.noise_std))"]
    body += ["print(f'normalized RMSE {summary.fitted_error}')"]
    imports = sorted({*IMPORTS, *(line for job in steps for line in STEP_IMPORTS[job.stage])})
    text = ['"""' + head[0], '', *head[1:], '"""', '', 'from pathlib import Path', '', *imports, '']
    text += ['import sma_sim', '', "HERE = Path(__file__).resolve().parent", f"OUT = HERE / '{OUTPUTS}'"]
    return '\n'.join([*text, *request_lines(request), 'OUT.mkdir(exist_ok=True)', *body, ''])


def read_lines(is_fitted: bool = True) -> list[str]:
    """The recordings, and the model that a step begins with."""
    start = f'config, _ = started_from_curves(fitted, config, {is_fitted})'
    return ['fitted, held_out = request.split(request.read(config))', start]


def request_lines(request: DataRequest) -> list[str]:
    """The recordings as Python."""
    entries: Mapping[str, Any] = request.as_data()
    data = ', '.join(f'Path({path!r})' for path in entries['data'])
    mapping = f'Path({entries["map"]!r})' if entries['map'] else 'None'
    return [
        f'request = DataRequest(data=({data},), hold_out={tuple(entries["hold_out"])!r}, map={mapping}, '
        f'noise={entries["noise"]!r}, namespace={entries["namespace"]!r})'
    ]


def fit_lines(options: Mapping[str, Any]) -> list[str]:
    """A calibration."""
    return [f'found = sma_sim.calibrate(fitted, config, sma_sim.{fit_options(options)!r})']


def diagnosis_lines(options: Mapping[str, Any]) -> list[str]:
    """A diagnosis."""
    asked = diagnosis_request(options, ())
    fits = f'sma_sim.{asked.options!r}'
    words = f'{asked.kinetics!r}, FOLDERS, {asked.seed}, {fits}, equation={asked.equation}, variants={asked.variants}'
    request = f'sma_sim.DiagnosisRequest({words})'.replace('FOLDERS', "tuple(effect_folders_of(HERE / 'start.yaml', ()))")
    return [f'found = sma_sim.diagnose(fitted, config, held_out, {request})']


STEP_LINES = {'calibrate': fit_lines, 'diagnose': diagnosis_lines}
FOLDERS = "folders_from(file, effect_folders_of(HERE / 'start.yaml', ()))"
WRITE_LINES = {
    'calibrate': f'write_fitted(file, found, {FOLDERS})',
    'diagnose': f'write_improved(file, found, {FOLDERS})',
}
IMPORTS = (
    'from sma_sim.evidence.estimation.prepared_fit import started_from_curves',
    'from sma_sim.evidence.residual_analysis.summary import summarize',
    'from sma_sim.words.comparison import comparison_result',
    'from sma_sim.words.json_values import write_json',
    'from sma_sim.workflow.data_request import DataRequest',
)
STEP_IMPORTS: Mapping[str, tuple[str, ...]] = {
    'calibrate': (
        'from sma_sim.model.given import effect_folders_of',
        'from sma_sim.workflow.code_folders import folders_from',
        'from sma_sim.workflow.fit import write_fitted',
    ),
    'diagnose': (
        'from sma_sim.model.given import effect_folders_of',
        'from sma_sim.workflow.diagnosis import write_improved',
        'from sma_sim.workflow.code_folders import folders_from',
    ),
}
