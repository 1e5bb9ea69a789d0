"""A session: a folder in which every version of a model is kept, so that nothing is lost and the commands can read it all.

The folder holds ``session.yaml`` (which recordings), ``history.json`` (the versions and the current one) and
``versions/0001.yaml`` and so on, ROS 2 parameter files for ``--config`` and the nodes (docs/reference/session.md).
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from datetime import datetime, timezone
from functools import cache
from pathlib import Path
from threading import RLock
from typing import Any

from sma_sim.evidence.data.tables import write_whole
from sma_sim.explore.differences import Difference, Value, difference_words, differences
from sma_sim.explore.history import History, Version
from sma_sim.explore.lock import OWNER, FolderLock
from sma_sim.explore.session_files import HISTORY, SETTINGS, VERSIONS, read_history, read_settings, write_settings
from sma_sim.model.config import Config, checked, folders_of, only_named_in_data, read_config
from sma_sim.model.errors import UserError
from sma_sim.model.given import RawValue, effect_folders_of, given_values, named_folders, structure_folders_of
from sma_sim.model.parameter_file import parameter_file
from sma_sim.workflow.data_request import DataRequest

OWN_FILES = (SETTINGS, VERSIONS, OWNER)  # of a session that was cut off before its first version
FROM_SESSION = 'in this session'
CODE = {'effects.paths': 'an effect of its own', 'structures.paths': 'a structure of its own'}  # folders of Python files


class ConflictError(UserError):
    """A change that was made to a version that is not the current one any more, as in a second tab."""


@dataclass(frozen=True)
class Start:
    """What a new session begins with: a parameter file and what the command line puts over it, and recordings, if any."""

    config: Path | None = None
    words: tuple[str, ...] = ()
    effects: tuple[str, ...] = ()
    data: DataRequest | None = None

    def read(self) -> Config:
        """The configuration. Raises UserError."""
        return read_config(self.config, self.words, self.effects)

    def folders(self) -> list[str]:
        """The folders of the user's effects, as absolute paths."""
        return [os.path.abspath(folder) for folder in effect_folders_of(self.config, self.words)]

    def trusted(self) -> frozenset[Path]:
        """The folders of Python files that the user has named: no others are imported."""
        named = [*effect_folders_of(self.config, self.words), *structure_folders_of(self.config, self.words)]
        return frozenset(folder.resolve() for folder in named)

    @property
    def names_a_model(self) -> bool:
        """Whether the command line says anything of the model, beyond where the user's own effects and structures are."""
        words = [word for word in self.words if word.partition('=')[0].strip() not in CODE]
        return bool(self.config or words or self.effects)


@dataclass
class Session:
    """An open session; made by `open_session`. All methods may be called from any thread.

    `data`: the recordings, None without any. `trusted`: the folders of Python files that its versions may name.
    """

    folder: Path
    data: DataRequest | None
    trusted: frozenset[Path]
    _lock: FolderLock
    _history: History = field(default_factory=History)
    _thread_lock: RLock = field(default_factory=RLock)

    def __enter__(self) -> Session:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Let other processes open the folder."""
        self._lock.release()

    @property
    def versions(self) -> tuple[Version, ...]:
        """All versions, the oldest first."""
        return self._history.versions

    @property
    def current(self) -> Version:
        """The version that is worked on."""
        return self._history[self._history.current]

    def version(self, number: int) -> Version:
        """A version by its number. Raises UserError for one that is not there."""
        return self._history[number]

    @property
    def revision(self) -> int:
        """A number that rises with every change of the history."""
        return self._history.revision

    @property
    def can_undo(self) -> bool:
        """Whether the current version was made from another."""
        return self.current.parent is not None

    @property
    def can_redo(self) -> bool:
        """Whether the current version was left by undo for another."""
        return self._history.current in self._history.forward

    def file(self, number: int | None = None) -> Path:
        """The parameter file of a version, by default of the current one. Raises UserError for one that is not there."""
        return (
            self.folder / VERSIONS / f'{self._history[self._history.current if number is None else number].number:04}.yaml'
        )

    def config(self, number: int | None = None) -> Config:
        """The configuration of a version, by default of the current one. Raises UserError."""
        return self.read(self.file(number))

    def read(self, path: Path) -> Config:
        """The configuration in a parameter file of the session. Raises UserError, also where it names folders of code."""
        return config_in(*stamped(path), self.trusted)

    def preview(self, values: Mapping[str, Value] | None = None, effects: Sequence[str] | None = None) -> Config:
        """The current configuration with other values by full name, and with these effects active (None: as they are).

        Nothing is written. Raises UserError for what is unknown or out of bounds.
        """
        given = dict(given_in(*stamped(self.file()), self.trusted))
        if effects is not None:
            given['effects.active'] = RawValue(list(effects), FROM_SESSION)
        more = {name: RawValue(value, FROM_SESSION, recorded=True) for name, value in (values or {}).items()}  # beside units
        return checked(given | more)

    def change(
        self,
        values: Mapping[str, Value] | None = None,
        effects: Sequence[str] | None = None,
        *,
        words: str = '',
        expected: int | None = None,
    ) -> Version:
        """A new version with other values or effects, as `preview` has them; the current one where nothing changes.

        `words`: what was done, by default what differs. `expected`: the version that the change was meant for. Raises
        UserError, and ConflictError where another is the current one by now.
        """
        with self._thread_lock:
            self.check_expected(expected)
            return self.adopt(self.preview(values, effects), words)

    def adopt(self, config: Config, words: str = '', folders: Sequence[Path] = (), step: int | None = None) -> Version:
        """A new version from a whole configuration; the current one where nothing changes. Raises UserError.

        `folders`: of effects of the user's own that the current version does not name. `step`: the job whose model it is.
        """
        with self._thread_lock:
            text = self.text_of(config, folders)
            if text == self.text_of(self.config()):
                return self.current
            words = words or difference_words(differences(self.config(), config))
            return self.add(text, words, self._history.current, step)

    def effect_folders(self, further: Sequence[Path] = ()) -> list[str]:
        """The folders of the user's effects, as a version's file names them."""
        return self.names_of([*effect_folders_of(self.file(), ()), *further])

    def names_of(self, folders: Sequence[Path]) -> list[str]:
        """Folders as a version's file names them: absolute, or relative to it where they lie in the session."""
        home, inside = (self.folder / VERSIONS).resolve(), self.folder.resolve()
        known = [folder.resolve() for folder in folders]
        named = [os.path.relpath(one, home) if one.is_relative_to(inside) else str(one) for one in known]
        return list(dict.fromkeys(named))

    def text_of(self, config: Config, folders: Sequence[Path] = ()) -> str:
        """A configuration as a version's file; `folders` are further ones of effects."""
        structure = self.names_of([Path(folder) for folder in folders_of(config.structure)])
        return parameter_file(config, self.effect_folders(folders), structure)

    def undo(self, expected: int | None = None) -> Version:
        """Go back to the version before. Raises UserError at the first one."""
        return self.step(History.undone, expected)

    def redo(self, expected: int | None = None) -> Version:
        """Go to the version that was left by undo. Raises UserError where there is none."""
        return self.step(History.redone, expected)

    def go_to(self, number: int, expected: int | None = None) -> Version:
        """Go to any version. Raises UserError for one that is not there."""
        return self.step(lambda history: history.at(number), expected)

    def rename(self, number: int, name: str) -> Version:
        """Give a version a name. Raises UserError for one that is not there."""
        with self._thread_lock:
            self.write(self._history.renamed(number, ' '.join(name.split())))
            return self._history[number]

    def differences(self, before: int, after: int) -> tuple[Difference, ...]:
        """In what two versions differ. Raises UserError."""
        return differences(self.config(before), self.config(after))

    def set_data(self, data: DataRequest) -> None:
        """Let the session be about other recordings. Raises UserError."""
        with self._thread_lock:
            write_settings(self.folder, data.absolute())
            self.data = data.absolute()

    def as_data(self) -> dict[str, Any]:
        """The history for JSON."""
        with self._thread_lock:
            versions = [asdict(version) | {'file': str(self.file(version.number))} for version in self.versions]
            return {
                'folder': str(self.folder),
                'versions': versions,
                'current': self.current.number,
                'can_undo': self.can_undo,
                'can_redo': self.can_redo,
                'revision': self.revision,
                'data': self.data.as_data() if self.data else None,
            }

    def check_expected(self, expected: int | None) -> None:
        """Raise ConflictError where the current version is another than somebody thinks."""
        if expected not in (None, self._history.current):
            raise ConflictError(
                f'version {expected} is not the current one any more: another tab has gone to version '
                f'{self.current.number}; look at that one, then change it'
            )

    def step(self, move: Callable[[History], History], expected: int | None) -> Version:
        """Another place in the history, whose file is read first: one that is broken is not gone to."""
        with self._thread_lock:
            self.check_expected(expected)
            moved = move(self._history)
            self.config(moved.current)
            self.write(moved)
            return self.current

    def add(self, text: str, words: str, parent: int | None, step: int | None = None) -> Version:
        """Write a version: its file first, so that the history never names one that is not there."""
        known = [int(path.stem) for path in (self.folder / VERSIONS).glob('*.yaml') if path.stem.isdecimal()]
        words, number = ' '.join(words.split()), 1 + max([version.number for version in self.versions] + known, default=0)
        now = datetime.now(timezone.utc).isoformat(timespec='seconds')
        write_whole(self.folder / VERSIONS / f'{number:04}.yaml', lambda file: file.write(f'# {words}\n{text}'))
        self.write(self._history.added(Version(number, parent, '', words, now, step)))
        return self.current

    def write(self, history: History) -> None:
        """Write the history, then hold it to be true."""
        text = json.dumps(history.as_data(), indent=1)
        write_whole(self.folder / HISTORY, lambda file: file.write(text + '\n'))
        self._history = history


def stamped(path: Path) -> tuple[Path, int]:
    """A file and the time of its last change [ns]."""
    return path, path.stat().st_mtime_ns if path.exists() else 0


@cache
def given_in(path: Path, _: int, trusted: frozenset[Path]) -> Mapping[str, RawValue]:
    """What a file says, read once as long as the file is the same.

    Raises UserError where it names a folder of Python files that the user has not named: a session may be somebody else's.
    """
    given = given_values(path, ())
    for name, what in CODE.items():
        folders = named_folders(name, given.get(name, RawValue([], '')))
        if not {folder.resolve() for folder in folders} <= trusted:
            words = [str(folder.resolve()) for folder in folders]
            raise UserError(only_named_in_data(what, name, RawValue(words, f'the session, in {path}')))
    return given


@cache
def config_in(path: Path, time: int, trusted: frozenset[Path]) -> Config:
    """The configuration in a file, read once as long as the file is the same."""
    return checked(given_in(path, time, trusted))


def open_session(folder: Path, start: Start | None = None) -> Session:
    """Open a session's folder, or begin one in a folder that is empty or not there.

    Parameters
    ----------
    folder : Path
        The session's folder.
    start : Start, optional
        What the command line gave: what a new session begins with. In a session that exists, a model that is given becomes
        a new version, and data that are given replace those it had. Folders of Python files are imported only if they
        are named here (``effects.paths``, ``structures.paths``), whatever the session's files name.

    Returns
    -------
    Session
        A context manager; `close` lets other processes have the folder.

    Raises
    ------
    UserError
        For a folder that another process has open, that holds other things, or whose files are broken, and for a session
        that needs folders of Python files which `start` does not name.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from sma_sim.explore.session import open_session
    >>> with open_session(Path(tempfile.mkdtemp())) as session:
    ...     changed = session.change({'beam.E': 2.2e9}, ['gravity'])
    ...     back = session.undo()
    ...     changed.words, back.number, session.redo().number
    ('gravity on, beam.E 2e+09 -> 2.2e+09 Pa', 1, 2)
    """
    start, folder = start or Start(), Path(os.path.abspath(folder))
    config, data = start.read(), start.data.absolute() if start.data else None
    make_folder(folder)
    lock = FolderLock(folder)
    try:
        if (folder / HISTORY).exists():
            return reopened(folder, start, data, lock)
        session = Session(folder, data, start.trusted(), lock)
        write_settings(folder, data)
        session.add(parameter_file(config, start.folders()), 'the model that the session began with', None)
        return session
    except BaseException:
        lock.release()
        raise


def make_folder(folder: Path) -> None:
    """Make the folders of a session. Raises UserError for a folder that holds other things."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        names = [] if (folder / HISTORY).exists() else sorted(path.name for path in folder.iterdir())
        others = [name for name in names if name not in OWN_FILES and not name.startswith('.')]
        if others:
            raise UserError(
                f'{folder} is no session: it holds {", ".join(others[:3])}, but no {HISTORY}; give a new or an empty folder'
            )
        (folder / VERSIONS).mkdir(exist_ok=True)
    except FileExistsError as error:
        raise UserError(f'{error.filename} is a file: expected a folder for the session') from error
    except OSError as error:
        raise UserError(f'cannot write {folder}: {error.strerror}') from error


def reopened(folder: Path, start: Start, data: DataRequest | None, lock: FolderLock) -> Session:
    """A session that was left, with what the command line gives this time."""
    known, folders = read_settings(folder), [Path(one) for one in start.folders()]
    session = Session(folder, data or known, start.trusted(), lock, read_history(folder))
    session.config()
    if data is not None and data != known:
        write_settings(folder, data)
    if start.names_a_model:
        session.adopt(start.read(), 'given on the command line', folders)
    elif folders:
        session.adopt(session.config(), 'folders of effects given on the command line', folders)
    return session
