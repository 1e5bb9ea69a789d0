"""The model beside a robot that runs: a process that listens to ROS 2, and the last minutes of what it found.

The process is `sma_sim.ros.live_feed`. It may end, or the robot may: this side says so and stays.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from threading import Lock, Thread
from typing import IO, Any

from sma_sim.explore.data_verbs import BAG, recorded_bags
from sma_sim.explore.jobs import new_folder
from sma_sim.explore.request_values import Body, Reply, as_int, text
from sma_sim.explore.session import Session
from sma_sim.explore.session_files import RECORDINGS
from sma_sim.model.errors import UserError

FEED = (sys.executable, '-m', 'sma_sim.ros.live_feed')
KEPT = 12_000  # samples: ten minutes at 20 a second
KEPT_CAUSES = 90  # findings of a cause: a quarter of an hour
LAST_LINES = 20  # of what the process says
HIGHEST_DOMAIN = 232
NAME = re.compile(r'/?([A-Za-z_][A-Za-z0-9_]*/?)*')
END = 10.0  # [s] that it may take to end


class LiveFeed:
    """The listening process, at most one at a time. All methods may be called from any thread.

    Parameters
    ----------
    command : sequence of str
        What is run; ROS arguments follow it.
    """

    def __init__(self, command: Sequence[str] = FEED) -> None:
        self._command, self._lock = tuple(command), Lock()
        self._process: subprocess.Popen[str] | None = None
        self._clear()

    def _clear(self) -> None:
        self._samples: deque[dict[str, Any]] = deque(maxlen=KEPT)
        self._count, self._channels = 0, list[str]()
        self._state: dict[str, Any] = {'state': 'off', 'problems': [], 'samples': 0}
        self._recording: dict[str, Any] = {'path': '', 'messages': 0, 'failed': ''}
        self._said: deque[str] = deque(maxlen=LAST_LINES)
        self._was_stopped = False
        self._model: dict[str, Any] = {'path': '', 'failed': '', 'changes': 0}
        self._causes: deque[dict[str, Any]] = deque(maxlen=KEPT_CAUSES)

    def start(self, parameters: Path, namespace: str = '', domain: int | None = None) -> None:
        """Listen to the robot in a namespace and a domain (default: the environment's) beside the model of a parameter file.

        Raises UserError where it listens already, and for a wrong namespace or domain.
        """
        if not NAME.fullmatch(namespace):
            raise UserError(f'namespace {namespace!r}: expected names joined by /, such as robot_1')
        if domain is not None and not 0 <= domain <= HIGHEST_DOMAIN:
            raise UserError(f'domain {domain}: expected 0 to {HIGHEST_DOMAIN}')
        words = [*self._command, '--ros-args', '--params-file', str(parameters)]
        words += ['-r', f'__ns:=/{namespace.strip("/")}'] if namespace.strip('/') else []
        environment = os.environ | ({} if domain is None else {'ROS_DOMAIN_ID': str(domain)})
        with self._lock:
            if self._process is not None and self._process.poll() is None:
                raise UserError('the page listens to a robot already: end that first')
            self._clear()
            self._state['state'] = 'starting'
            self._model['path'] = str(parameters)
            process = subprocess.Popen(
                words,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
                env=environment,
                encoding='utf-8',
                errors='replace',
                start_new_session=True,
            )
            self._process = process
        Thread(target=self._listen, args=(process, process.stdout), daemon=True).start()
        Thread(target=self._note, args=(process.stderr, self._said), daemon=True).start()

    def stop(self) -> None:
        """Listen no more; what was heard stays."""
        process = self._process
        if process is not None and process.poll() is None:
            self._was_stopped = True
            process.terminate()
            try:
                process.wait(END)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()

    def record(self, path: Path | None) -> None:
        """Begin a bag of what the robot publishes, or end it (None). Raises UserError where nothing is listened to."""
        self._ask('record', str(path) if path else '')

    def use(self, parameters: Path) -> None:
        """Compare with the model of another parameter file, what was heard before too. Raises UserError as `record`."""
        self._ask('model', str(parameters))

    @property
    def listens(self) -> bool:
        """Whether the process runs."""
        return self._process is not None and self._process.poll() is None

    def _ask(self, what: str, value: str) -> None:
        process = self._process
        if not self.listens or process is None or process.stdin is None:
            raise UserError(f'{what}: the page does not listen to a robot: start that first')
        try:
            process.stdin.write(json.dumps({what: value}) + '\n')
            process.stdin.flush()
        except OSError as error:
            raise UserError(f'{what}: the listening process has ended ({error.strerror})') from error

    def read(self, since: int = 0) -> dict[str, Any]:
        """What was heard from sample number `since` on, for JSON.

        ``state`` (``off``, ``starting``, ``waiting for joint_states``, ``burn-in``, ``comparing``, ``ended``, ``failed``),
        ``problems``, ``compared`` (how many samples), ``channels``, ``samples`` and ``recording`` (as
        `sma_sim.ros.live_feed` has them), ``causes`` (what has changed, in the order of time), ``model`` (``path`` of its
        parameter file; how many ``changes`` of it there were, with each of which all ``samples`` begin anew; why the last
        one ``failed``) and ``next``, the number to ask for then.
        """
        with self._lock:
            code = None if self._process is None else self._process.poll()
            known, first = dict(self._state), self._count - len(self._samples)
            if code is not None:
                stopped = code == 0 or self._was_stopped
                known['state'] = 'ended' if stopped else 'failed'
                self._recording = {**self._recording, 'path': ''}
                known['problems'] = [] if stopped else list(self._said)[-3:] or [f'it ended with code {code}']
            samples = list(self._samples)[max(0, since - first) :]
            return known | {
                'compared': known['samples'],
                'channels': self._channels,
                'samples': samples,
                'recording': dict(self._recording),
                'model': dict(self._model),
                'causes': list(self._causes),
                'next': self._count,
            }

    def _listen(self, process: subprocess.Popen[str], lines: IO[str] | None) -> None:
        for line in lines or ():
            with suppress(ValueError, TypeError, KeyError, AttributeError), self._lock:
                if process is self._process:
                    self._take(json.loads(line))

    def _take(self, content: dict[str, Any]) -> None:
        kind = content.pop('kind')
        if kind == 'channels':
            self._channels = [str(name) for name in content['channels']]
        elif kind == 'sample':
            self._samples.append(content)
            self._count += 1
        elif kind == 'model':
            self._take_model(content)
        elif kind == 'cause':
            self._causes.append(content)
        elif kind == 'recording':
            self._recording = {name: content[name] for name in ('path', 'messages', 'failed')}
        elif kind == 'state':
            self._state = {name: content[name] for name in ('state', 'problems', 'samples')}

    def _take_model(self, content: dict[str, Any]) -> None:
        """Another model, which has its own samples; one that cannot be run leaves the one before."""
        failed, samples = str(content['failed']), list(content['samples'])
        if failed:
            self._model = {**self._model, 'failed': failed}
            return
        self._model = {'path': str(content['path']), 'failed': '', 'changes': self._model['changes'] + 1}
        self._causes.clear()
        self._samples.clear()
        self._samples.extend(samples)
        self._count += len(samples)

    def _note(self, lines: IO[str] | None, said: deque[str]) -> None:
        for line in lines or ():
            said.append(line.rstrip())


class LiveVerbs:
    """The model of a session beside a robot; verbs may be called from several threads."""

    def __init__(self, session: Session) -> None:
        self._session, self._feed = session, LiveFeed()
        self._shown: Path | None = None  # the file of the version that runs beside the robot
        self.verbs: Mapping[str, Callable[[Body], Reply]] = {
            'live': self.live,
            'live_start': self.start,
            'live_stop': self.stop,
            'record': self.record,
        }

    def live(self, body: Body) -> Reply:
        """What was heard from sample number `since` on."""
        return self._heard(max(as_int(body.get('since', 0), 'since'), 0))

    def start(self, body: Body) -> Reply:
        """Listen, beside the model of the current version."""
        domain = body.get('domain')
        self._shown = self._session.file()
        self._feed.start(
            self._shown,
            text(body.get('namespace', ''), 'namespace'),
            None if domain is None else as_int(domain, 'domain'),
        )
        return self._heard()

    def stop(self, _: Body) -> Reply:
        """Listen no more."""
        self._feed.stop()
        return self._heard()

    def record(self, body: Body) -> Reply:
        """Begin (`on`) or end a bag in the session."""
        if not isinstance(on := body.get('on'), bool):
            raise UserError('on: expected true or false')
        if on:
            number = 1 + len(recorded_bags(self._session.folder))
            _, folder = new_folder(self._session.folder / RECORDINGS)
            self._feed.record(folder / f'{BAG}_{number}')
        else:
            self._feed.record(None)
        return self._heard()

    def follow(self) -> None:
        """Let the model beside the robot be the current version."""
        file = self._session.file()
        if file != self._shown and self._feed.listens:
            self._shown = file
            with suppress(UserError):  # it ends just now, which the page sees
                self._feed.use(file)

    def _heard(self, since: int = 0) -> Reply:
        """What was heard; the model as the number of its version."""
        found = self._feed.read(since)
        stem = Path(found['model']['path']).stem
        return found | {'model': found['model'] | {'version': int(stem) if stem else None}}

    def close(self) -> None:
        """End the listening process."""
        self._feed.stop()
