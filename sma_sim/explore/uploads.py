"""Files that are chosen on the page: they come in pieces, and are kept in the session under names that lead nowhere else."""

from __future__ import annotations

import base64
import binascii
import re
from collections.abc import Mapping
from pathlib import Path
from threading import Lock
from typing import Any

from sma_sim.evidence.data.sources import META_FILE, recordings_in
from sma_sim.explore.jobs import new_folder
from sma_sim.explore.request_values import Body, Reply, as_int, text
from sma_sim.explore.session_files import RECORDINGS
from sma_sim.model.errors import UserError
from sma_sim.workflow.data_request import DataRequest

NAME = re.compile(r'\w[\w. ()+-]{0,99}')
OF_BAG = 'metadata.yaml'
ENDINGS = ('.csv', '.mcap', '.db3', '.yaml', '.yml', META_FILE)
MAX_FOLDERS, MAX_FILES, MAX_BYTES = 2, 200, 4_000_000_000
MAX_PIECE = 12_000_000  # characters


class Uploads:
    """What the page sends; `take` may be called from several threads."""

    def __init__(self, session: Path) -> None:
        self._home = session / RECORDINGS
        self._sizes: dict[int, dict[str, int]] = {}  # bytes of each file, by batch
        self._lock = Lock()

    def take(self, body: Body) -> Reply:
        """A piece of a file: its `name`, where it begins (`at`), its bytes as base64 (`data`), and the `batch` of files that
        it belongs to, null for the first piece of a new one. Answers with the batch.

        Raises UserError for names that could lead elsewhere, for pieces out of order, and for too much.
        """
        name, content = checked_name(body.get('name')), decoded(body)
        with self._lock:
            batch = body.get('batch')
            number = self.new_batch() if batch is None else as_int(batch, 'batch')
            sizes = self._sizes.get(number)
            if sizes is None:
                raise UserError(f'batch: no files were sent as {number}')
            if as_int(body.get('at'), 'at') != sizes.get(name, 0):
                raise UserError(f'{name}: a piece at {body["at"]} after {sizes.get(name, 0)} bytes')
            if len({name, *sizes}) > MAX_FILES or sum(sizes.values()) + len(content) > MAX_BYTES:
                raise UserError(f'{name}: expected at most {MAX_FILES} files of {MAX_BYTES} bytes together')
            append(self._home / f'{number:04}' / name, content)
            sizes[name] = sizes.get(name, 0) + len(content)
        return {'batch': number}

    def new_batch(self) -> int:
        """The number of a batch without files yet."""
        number, _ = new_folder(self._home)
        self._sizes[number] = {}
        return number

    def request(self, number: int) -> DataRequest:
        """The recordings among the files of a batch, with the column map, if one was sent. Raises UserError."""
        names = self._sizes.get(number)
        if not names:
            raise UserError(f'batch: no files were sent as {number}')
        folder = self._home / f'{number:04}'
        tops = {Path(name).parts[0] for name in names}
        if all('/' in name for name in names) and len(tops) == 1:  # a folder that was chosen as a whole
            folder /= tops.pop()
        maps = [path for path in (*folder.glob('*.yaml'), *folder.glob('*.yml')) if path.name != OF_BAG]
        if len(maps) > 1:
            raise UserError(f'{maps[0].name}, {maps[1].name}: expected one YAML file at most, the map of columns')
        return DataRequest(tuple(recordings_in(folder)), map=maps[0] if maps else None)


def checked_name(value: Any) -> str:
    """The name of a file, perhaps with the folders that it lies in. Raises UserError for one that could lead elsewhere."""
    name = text(value, 'name', 400)
    parts = name.split('/')
    if len(parts) > MAX_FOLDERS + 1 or not all(NAME.fullmatch(part) for part in parts):
        raise UserError(
            f'{name}: expected names of letters, digits, spaces, dots, _, +, - and parentheses, in at most {MAX_FOLDERS} '
            'folders; rename it'
        )
    if not name.lower().endswith(ENDINGS):
        raise UserError(
            f'{name}: expected CSV files or bags (.mcap, .db3), beside them {OF_BAG} of a bag, {META_FILE}, or a column map '
            '(.yaml)'
        )
    return name


def decoded(body: Mapping[str, Any]) -> bytes:
    """The bytes of a piece. Raises UserError."""
    try:
        return base64.b64decode(text(body.get('data'), 'data', MAX_PIECE), validate=True)
    except (binascii.Error, ValueError) as error:
        raise UserError('data: expected base64') from error


def append(path: Path, content: bytes) -> None:
    """Add bytes to a file, which is made where it is not there. Raises UserError."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open('ab') as file:
            file.write(content)
    except OSError as error:
        raise UserError(f'cannot write {path}: {error.strerror}') from error
