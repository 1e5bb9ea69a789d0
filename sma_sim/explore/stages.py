"""The steps from recordings to an improved model, each offered when what it needs is there.

check -> compare -> calibrate, diagnose -> accept -> export. `Engine` says what comes next, starts steps as processes
(`sma_sim.explore.jobs`), and finds them again.
"""

from __future__ import annotations

import subprocess
from collections.abc import Mapping
from dataclasses import dataclass, field
from threading import RLock
from typing import Any

from sma_sim.evidence.estimation.calibrate import limits_from
from sma_sim.explore.history import Version
from sma_sim.explore.jobs import PARAMETERS, Job, job_in, jobs_in, new_job, start_process
from sma_sim.explore.session import Session
from sma_sim.explore.traces import part_of_residual
from sma_sim.model.config import MODELS
from sma_sim.model.errors import UserError
from sma_sim.model.given import effect_folders_of
from sma_sim.workflow.data_request import fingerprint

STAGES = ('check', 'compare', 'calibrate', 'diagnose', 'accept', 'export')
KINETICS = (*MODELS, 'auto')
NUMBERS: dict[str, tuple[int, int]] = {'starts': (1, 100), 'seed': (0, 2**31)}
LISTS = {'free': 'names', 'effects': 'names', 'limits': 'NAME=LOW:HIGH in SI units'}
SWITCHES = ('robust', 'equation', 'variants')
OPTIONS: dict[str, tuple[str, ...]] = {
    'check': (),
    'compare': (),
    'calibrate': ('free', 'model', 'starts', 'robust', 'seed', 'limits'),
    'diagnose': ('model', 'seed', 'equation', 'variants', 'limits'),
    'candidates': ('effects',),
}
USABLE = ('done', 'stopped')


@dataclass
class Engine:
    """The steps of an open session. All methods may be called from any thread."""

    session: Session
    _processes: dict[int, subprocess.Popen[bytes]] = field(default_factory=dict)
    _lock: RLock = field(default_factory=RLock)

    @property
    def jobs(self) -> tuple[Job, ...]:
        """All jobs of the session, the oldest first."""
        with self._lock:
            for process in self._processes.values():
                process.poll()  # lets the operating system forget those that have ended
        return jobs_in(self.session.folder)

    def job(self, number: int) -> Job:
        """A job by its number. Raises UserError for one that is not there."""
        found = job_in(self.session.folder, number)
        if found is None:
            raise UserError(f'there is no step {number} in this session')
        return found

    def running(self) -> Job | None:
        """The job that runs, if one does."""
        return next((job for job in reversed(self.jobs) if job.state == 'running'), None)

    def latest(self, stage: str) -> Job | None:
        """The last job of a stage on the recordings as they are; comparisons are those of the current version."""
        data, version = self.data(), self.session.current.number
        for job in reversed(self.jobs):
            if (
                job.stage == stage
                and job.data == data
                and (stage not in ('compare', 'candidates') or job.version == version)
            ):
                return job
        return None

    def last_comparison(self) -> Job | None:
        """The last job that has compared a version, whichever, with the recordings as they are."""
        data = self.data()
        compared = (job for job in reversed(self.jobs) if job.stage == 'compare' and job.data == data)
        return next((job for job in compared if 'curves' in job.files), None)

    def data(self) -> str:
        """What tells whether the recordings are still the same; empty without any."""
        return fingerprint(self.session.data) if self.session.data else ''

    def reason(self, stage: str) -> str:
        """What has to come before a stage, empty where nothing has. Raises UserError for no stage."""
        if stage not in (*STAGES, 'candidates'):
            raise UserError(f'there is no stage {stage}: expected one of {", ".join(STAGES)}')
        if self.session.data is None:
            return 'this session has no recordings: begin it with some, as in sma-sim explore run1.csv run2.csv run3.csv'
        if stage != 'check' and (missing := self.lacking('check', 'check the recordings first')):
            return missing
        if stage in ('calibrate', 'diagnose', 'export', 'candidates'):
            what = f'compare version {self.session.current.number} with the recordings first'
            return self.lacking('compare', what)
        if stage == 'accept' and self.acceptable() is None:
            return 'there is nothing to accept: calibrate or diagnose first'
        return ''

    def lacking(self, stage: str, words: str) -> str:
        """`words` where a stage has no result, and why; else empty."""
        job = self.latest(stage)
        if job is None:
            return words
        state, said = job.read_state()
        if state == 'running':
            return f'{words}: it is still running'
        return '' if 'result' in job.files and state in USABLE else f'{words}: {said}'

    def acceptable(self) -> Job | None:
        """The last calibration or diagnosis with a model that can be accepted."""
        found = [self.latest('calibrate'), self.latest('diagnose')]
        usable = [job for job in found if job and job.state in USABLE and (job.folder / PARAMETERS).exists()]
        return max(usable, key=lambda job: job.number, default=None)

    def overview(self) -> list[dict[str, Any]]:
        """By stage, whether it can be taken, what must come first, and its last job, for JSON."""
        found = []
        for stage in STAGES:
            reason = self.reason(stage)
            job = self.latest(stage) if stage in OPTIONS else self.acceptable() if stage == 'accept' else None
            found.append({'stage': stage, 'ready': not reason, 'reason': reason, 'job': job.as_data() if job else None})
        return found

    def start(self, stage: str, **options: Any) -> Job:
        """Begin a stage in a process of its own, on the current version.

        Options are those of the command: ``free`` (names), ``model``, ``starts``, ``robust``, ``seed`` and ``limits``
        ('NAME=LOW:HIGH', SI) to calibrate; ``model``, ``seed``, ``equation``, ``variants`` and ``limits`` to diagnose;
        ``effects`` (names) to switch candidates on. Raises UserError where something must come first, where another step
        runs, and for options that are wrong.
        """
        with self._lock:
            if stage not in OPTIONS:
                raise UserError(f'{stage} is no step to start: expected one of {", ".join(OPTIONS)}')
            if reason := self.reason(stage):
                raise UserError(f'{stage}: {reason}')
            if (other := self.running()) is not None:
                raise UserError(f'{stage}: {other.stage} is running (step {other.number}): wait for it, or stop it')
            checked = checked_options(stage, options)
            job = new_job(self.session.folder, stage, self.session.current.number, checked, self.data())
            self._processes[job.number] = start_process(self.session.folder, job)
            return job

    def wait(self, job: Job, seconds: float | None = None) -> Job:
        """Wait until a job that was started here has ended, at most so long. Raises UserError where it takes longer."""
        process = self._processes.get(job.number)
        if process is not None:
            try:
                process.wait(seconds)
            except subprocess.TimeoutExpired as error:
                raise UserError(f'step {job.number} ({job.stage}) is still running') from error
        return job

    def accept(self, number: int | None = None) -> Version:
        """The model of a calibration or diagnosis, by default the last one, as the current version, once only.

        Raises UserError where there is none.
        """
        job = self.acceptable() if number is None else self.job(number)
        if job is None:
            raise UserError(f'accept: {self.reason("accept")}')
        path = job.folder / PARAMETERS
        if job.state not in USABLE or not path.exists():
            raise UserError(f'accept: step {job.number} ({job.stage}) has no model: {job.words}')
        if known := [version for version in self.session.versions if version.step == job.number]:
            return self.session.go_to(known[-1].number)
        what = {'calibrate': 'calibrated', 'diagnose': 'diagnosed'}.get(job.stage, job.stage)
        words = f'{what} from version {job.version} (step {job.number})'
        return self.session.adopt(self.session.read(path), words, effect_folders_of(path, ()), job.number)

    def part_of_residual(self, where: tuple[str, str], times: tuple[float, float]) -> dict[str, Any]:
        """What is known of the residual of (run, channel) between two times [s] (`sma_sim.explore.traces`).

        Effects are named once the stage ``candidates`` was taken. Raises UserError where the version was not compared, and
        for a part that is not there.
        """
        compared, candidates = self.latest('compare'), self.latest('candidates')
        if compared is None or self.reason('candidates'):
            raise UserError(f'residual: compare version {self.session.current.number} with the recordings first')
        known = candidates is not None and candidates.state in USABLE and 'curves' in candidates.files
        usable = candidates if known else None
        return part_of_residual(compared, self.session.config(compared.version), usable, where, times)

    def close(self) -> None:
        """Ask the job that runs to end with what it has."""
        if (job := self.running()) is not None:
            job.stop()


def checked_options(stage: str, options: Mapping[str, Any]) -> dict[str, Any]:
    """The options of a stage. Raises UserError for one that is unknown or wrong."""
    for name, value in options.items():
        if name not in OPTIONS[stage]:
            raise UserError(f'{stage} has no option {name}: expected {", ".join(OPTIONS[stage]) or "none"}')
        if name == 'model' and value not in KINETICS:
            raise UserError(f'{stage}, model = {value!r}: expected one of {", ".join(KINETICS)}')
        if name in SWITCHES and not isinstance(value, bool):
            raise UserError(f'{stage}, {name} = {value!r}: expected true or false')
        if name in NUMBERS:
            least, most = NUMBERS[name]
            if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= most:
                raise UserError(f'{stage}, {name} = {value!r}: expected a whole number from {least} to {most}')
        is_names = value is None or isinstance(value, list | tuple) and all(isinstance(one, str) for one in value)
        if name in LISTS and not is_names:
            raise UserError(f'{stage}, {name} = {value!r}: expected a list of {LISTS[name]}')
        if name == 'limits':
            limits_from(value or ())
    return dict(options)
