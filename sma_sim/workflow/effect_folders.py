"""How a parameter file names the folders of the user's effects."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path


def folders_from(out: Path, folders: Sequence[Path]) -> list[str]:
    """Folders as a parameter file at `out` names them: relative to it."""
    home = out.resolve().parent
    return [os.path.relpath(folder.resolve(), home) for folder in folders]
