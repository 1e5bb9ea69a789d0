"""How a parameter file names the folders of the user's effects and structures."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from sma_sim.model.config import Config, folders_of
from sma_sim.model.parameter_file import parameter_file


def folders_from(out: Path, folders: Sequence[Path]) -> list[str]:
    """Folders as a parameter file at `out` names them: relative to it."""
    home = out.resolve().parent
    return [os.path.relpath(folder.resolve(), home) for folder in folders]


def parameter_file_at(out: Path, config: Config, effect_folders: Sequence[str]) -> str:
    """The text of a parameter file at `out`, which names the structure's folder relative to it, and these of effects."""
    return parameter_file(
        config, effect_folders, folders_from(out, [Path(folder) for folder in folders_of(config.structure)])
    )
