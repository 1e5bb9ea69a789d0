"""A lock on a folder that ends with its process, however that ends, on every system."""

from __future__ import annotations

import json
import os
import sqlite3
from contextlib import suppress
from datetime import datetime, timezone
from pathlib import Path

from sma_sim.evidence.data.tables import write_whole
from sma_sim.model.errors import UserError

OWNER = 'owner.json'


class FolderBusyError(UserError):
    """Another process has the folder."""


class FolderLock:
    """Held from its making until `release` or the end of the process.

    The lock of an SQLite file is used because the operating system frees it when a process is killed, and Python has no
    other such lock that is the same on every system.
    """

    def __init__(self, folder: Path) -> None:
        """Lock a folder. Raises FolderBusyError, and UserError where the folder cannot be written."""
        self._folder = folder
        self._connection = locked_file(folder / '.lock')
        if self._connection is None:
            raise FolderBusyError(
                f'{folder} is in use by another process{owner_words(folder)}: use that one, or end it first'
            )
        owner = {'process': os.getpid(), 'since': datetime.now(timezone.utc).isoformat(timespec='seconds')}
        write_whole(folder / OWNER, lambda file: file.write(json.dumps(owner) + '\n'))

    def release(self) -> None:
        """Let others have the folder."""
        if self._connection is not None:
            (self._folder / OWNER).unlink(missing_ok=True)
            self._connection.close()
            self._connection = None


def locked_file(path: Path, wait: float = 0.0) -> sqlite3.Connection | None:
    """A connection that holds the lock of a file, None where another has it, also after `wait` [s]. Raises UserError."""
    try:
        connection = sqlite3.connect(path, timeout=wait, isolation_level=None, check_same_thread=False)
    except sqlite3.Error as error:
        raise UserError(f'cannot write {path}: {error}') from error
    try:
        connection.execute('BEGIN EXCLUSIVE')
    except sqlite3.OperationalError as error:
        connection.close()
        if 'locked' in str(error):
            return None
        raise UserError(f'cannot write {path}: {error}') from error
    except sqlite3.DatabaseError as error:
        connection.close()
        raise UserError(f'{path} is not the lock of a session: move it elsewhere') from error
    return connection


def is_locked(path: Path) -> bool:
    """Whether a process holds the lock of a file; not where there is none."""
    if not path.exists():
        return False
    connection = locked_file(path)
    if connection is None:
        return True
    connection.close()
    return False


def owner_words(folder: Path) -> str:
    """Who has a folder, as far as that can be read."""
    with suppress(OSError, ValueError, KeyError, TypeError):
        owner = json.loads((folder / OWNER).read_text(encoding='utf-8'))
        return f' (process {int(owner["process"])}, since {owner["since"]})'
    return ''
