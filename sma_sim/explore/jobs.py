"""Long steps as processes of their own, each with a folder that says all: what was asked, how far it is, what came out.

A folder of a session's ``jobs/`` holds ``request.json``, ``state.json``, ``events.jsonl``, ``log.txt`` and the results
(docs/reference/session.md). Whoever opens the session finds jobs there, running or ended.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import numpy as np

from sma_sim.evidence.estimation.residuals import Nuisance
from sma_sim.explore.lock import is_locked
from sma_sim.model.arrays import Vector
from sma_sim.model.config import Config
from sma_sim.model.errors import UserError
from sma_sim.model.files import whole_file
from sma_sim.solver.beginning import Beginning
from sma_sim.words.json_values import write_json

JOBS, REQUEST, STATE, EVENTS, LOG, LOCK, STOP = (
    'jobs',
    'request.json',
    'state.json',
    'events.jsonl',
    'log.txt',
    'lock',
    'stop',
)
RESULT, PARAMETERS, REPORT, CURVES, SUMMARY = 'result.json', 'parameters.yaml', 'report.html', 'curves.npz', 'summary.txt'
FILES = {'result': RESULT, 'parameters': PARAMETERS, 'report': REPORT, 'curves': CURVES, 'summary': SUMMARY}
COMMANDS = {'compare': 'compare', 'calibrate': 'fit', 'diagnose': 'diagnose'}  # by stage, the verb of sma-sim
START_TIME = 60.0  # [s] that a process may take before it says that it runs
KILLED = 'the process ended without a result: it was killed, or the computer went down; start this step again'


@dataclass(frozen=True)
class Job:
    """A step that runs or has run in a process of its own.

    Attributes
    ----------
    folder : Path
        Where its files are.
    number : int
        From 1, in the order of starting.
    stage : str
        ``check``, ``compare``, ``calibrate``, ``diagnose`` or ``candidates``.
    version : int
        The version of the model that it is about.
    options : mapping
        Options of the step, as `Engine.start` took them.
    data : str
        What tells whether the recordings are still the same (`fingerprint`).
    time : str
        When it was started, UTC.
    """

    folder: Path
    number: int
    stage: str
    version: int
    options: Mapping[str, Any]
    data: str
    time: str

    @property
    def state(self) -> str:
        """``running``, ``done``, ``stopped`` (with what it had), ``failed`` or ``killed``."""
        return self.read_state()[0]

    @property
    def words(self) -> str:
        """What it is doing, or how it ended."""
        state, words = self.read_state()
        if state != 'running':
            return words
        said = [event['words'] for event in self.events() if event['kind'] == 'progress']
        return str(said[-1]) if said else 'starting'

    def read_state(self) -> tuple[str, str]:
        """State and words. What says that it runs, and holds no lock, was killed."""
        known = self.written_state()
        if known[0] != 'running':
            return known
        started = (self.folder / STATE).exists()
        if started and not is_locked(self.folder / LOCK):
            known = self.written_state()  # it may have come to its end in between
            return known if known[0] != 'running' else ('killed', KILLED)
        return known if started or self.age < START_TIME else ('killed', KILLED)

    @property
    def age(self) -> float:
        """Time since it was started [s]."""
        return (datetime.now(timezone.utc) - datetime.fromisoformat(self.time)).total_seconds()

    @property
    def seconds(self) -> float | None:
        """Time that it took, or has taken so far [s]; None of one that was killed."""
        if self.state == 'running':
            return max(self.age, 0.0)
        with suppress(OSError, ValueError, KeyError, TypeError):
            return float(json.loads((self.folder / STATE).read_text(encoding='utf-8'))['seconds'])
        return None

    def written_state(self) -> tuple[str, str]:
        """State and words as the process wrote them last."""
        with suppress(OSError, ValueError, KeyError, TypeError):
            content = json.loads((self.folder / STATE).read_text(encoding='utf-8'))
            return str(content['state']), str(content['words'])
        return 'running', ''

    def events(self, since: int = 0) -> list[dict[str, Any]]:
        """What happened, from number `since` on: ``n``, ``t`` [s from the start], ``kind`` and more."""
        try:
            lines = (self.folder / EVENTS).read_text(encoding='utf-8').splitlines()
        except OSError:
            return []
        found = []
        for line in lines[since:]:
            with suppress(ValueError):  # the last line may be half written
                found.append(json.loads(line))
        return found

    @property
    def files(self) -> dict[str, Path]:
        """The results that are there: ``result`` (JSON), ``parameters``, ``report``, ``curves``, ``summary`` (words)."""
        named = {what: self.folder / name for what, name in FILES.items()}
        return {what: path for what, path in named.items() if path.exists()}

    def result(self) -> dict[str, Any]:
        """What the command writes with ``--json``. Raises UserError where there is none."""
        path = self.folder / RESULT
        try:
            found: dict[str, Any] = json.loads(path.read_text(encoding='utf-8'))
        except FileNotFoundError as error:
            raise UserError(f'step {self.number} ({self.stage}) has no result: {self.words}') from error
        except (OSError, ValueError) as error:
            raise UserError(f'{path} cannot be read: {error}; start this step again') from error
        return found

    def curves(self) -> dict[str, dict[str, Vector]]:
        """By run, ``time`` (k,) [s] and by channel ``measured.alpha``, ``model.alpha`` and so on (k,), SI units."""
        path, found = self.folder / CURVES, dict[str, dict[str, Vector]]()
        try:
            with np.load(path, allow_pickle=False) as content:
                for name in content.files:
                    run, _, what = name.rpartition('|')
                    found.setdefault(run, {})[what] = content[name]
        except FileNotFoundError as error:
            raise UserError(f'step {self.number} ({self.stage}) has no curves: {self.words}') from error
        except (OSError, ValueError) as error:
            raise UserError(f'{path} cannot be read: {error}; start this step again') from error
        return found

    def nuisances(self, config: Config) -> dict[str, Nuisance]:
        """By run, its nuisances in a comparison. Raises UserError where there are none."""
        unknown_zero = config.structure.is_quasi_static
        return {
            name: Nuisance(
                float(curves['nuisance.delay']),
                tuple(curves['nuisance.start'].tolist()),
                tuple(curves['nuisance.switches'].tolist()),
                unknown_zero,
                beginning=Beginning.of_parts(
                    {what.partition('.')[2]: of.tolist() for what, of in curves.items() if what.startswith('beginning.')}
                ),
            )
            for name, curves in self.curves().items()
            if 'nuisance.delay' in curves
        }

    def stop(self) -> None:
        """Ask it to end with what it has, as Ctrl-C does."""
        (self.folder / STOP).touch()

    def command_options(self) -> list[str]:
        """The options as words of the command that does the same."""
        options, words = self.options, list[str]()
        if options.get('free') is not None:
            words += ['--free', ','.join(options['free'])]
        for name in ('model', 'starts', 'seed'):
            words += [f'--{name}', str(options[name])] if name in options else []
        words += ['--robust'] if options.get('robust') else []
        for limit in options.get('limits') or ():
            words += ['--limit', limit]
        return words + [f'--no-{name}' for name in ('equation', 'variants') if not options.get(name, True)]

    def as_data(self) -> dict[str, Any]:
        """The job for JSON."""
        state, words = self.read_state()
        words = self.words if state == 'running' else words
        return {
            'number': self.number,
            'stage': self.stage,
            'version': self.version,
            'options': dict(self.options),
            'time': self.time,
            'seconds': self.seconds,
            'state': state,
            'words': words,
            'files': {name: str(path) for name, path in self.files.items()},
        }


def jobs_in(session: Path) -> tuple[Job, ...]:
    """The jobs of a session, in the order of starting; folders that are none are left out."""
    folder = session / JOBS
    numbers = sorted(int(path.name) for path in folder.glob('*') if path.name.isdecimal()) if folder.exists() else []
    return tuple(job for number in numbers if (job := job_in(session, number)) is not None)


def job_in(session: Path, number: int) -> Job | None:
    """A job by its number; None where its request cannot be read."""
    folder = session / JOBS / f'{number:04}'
    with suppress(OSError, ValueError, KeyError, TypeError):
        content = json.loads((folder / REQUEST).read_text(encoding='utf-8'))
        stage, version, data, time = (content[name] for name in ('stage', 'version', 'data', 'time'))
        datetime.fromisoformat(time)
        return Job(folder, number, str(stage), int(version), dict(content['options']), str(data), str(time))
    return None


def write_curves(path: Path, curves: Mapping[str, Vector]) -> None:
    """Write arrays by name, whole or not at all."""
    with whole_file(path) as temporary, temporary.open('wb') as file:
        save: Any = np.savez_compressed  # typed with keywords of newer versions
        save(file, **curves)


def new_folder(home: Path) -> tuple[int, Path]:
    """A new numbered folder in another, and its number. Raises UserError."""
    try:
        home.mkdir(exist_ok=True)
        number = 1 + max((int(path.name) for path in home.iterdir() if path.name.isdecimal()), default=0)
        folder = home / f'{number:04}'
        folder.mkdir()
    except OSError as error:
        raise UserError(f'cannot write {home}: {error.strerror}') from error
    return number, folder


def new_job(session: Path, stage: str, version: int, options: Mapping[str, Any], data: str) -> Job:
    """Write what is asked of a new job. Raises UserError."""
    number, home = new_folder(session / JOBS)
    now = datetime.now(timezone.utc).isoformat(timespec='seconds')
    job = Job(home, number, stage, version, dict(options), data, now)
    entries = {name: value for name, value in asdict(job).items() if name not in ('folder', 'number')}
    write_json(home / REQUEST, entries)
    return job


def start_process(session: Path, job: Job) -> subprocess.Popen[bytes]:
    """The process that does a job; Ctrl-C in the terminal does not reach it."""
    words = [sys.executable, '-m', 'sma_sim.explore.worker', str(session), str(job.number)]
    with (job.folder / LOG).open('wb') as log:
        return subprocess.Popen(words, stdin=subprocess.DEVNULL, stdout=log, stderr=log, start_new_session=True)
