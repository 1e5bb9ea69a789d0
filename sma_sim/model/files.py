"""Files that are written whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from sma_sim.model.errors import UserError


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """A temporary name beside `path` to write to, with its suffix; renamed at the end of the block, removed after an error.

    A link stays: what is replaced is the file that it names. What is there and is no file (``/dev/null``, a pipe) is
    written to as it is: to replace it would break the device for every program. Raises UserError where the block or the
    renaming raises OSError.
    """
    try:
        is_file = path.is_file() or not path.exists()
        target = Path(os.path.realpath(path)) if is_file else path
    except (OSError, ValueError) as error:  # too long a name, or a character that none may have
        raise UserError(f'cannot write {str(path)!r}: {getattr(error, "strerror", None) or error}') from error
    temporary = target.with_name(f'.{target.stem}.{os.getpid()}.part{target.suffix}') if is_file else target
    try:
        yield temporary
        if is_file:
            temporary.replace(target)
    except OSError as error:
        raise UserError(f'cannot write {path}: {error.strerror}') from error
    finally:
        with suppress(OSError):  # a disk that has become read-only has said so already
            if is_file:
                temporary.unlink(missing_ok=True)
