"""How a parameter file names the folders of the user's effects and structures."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from sma_sim.evidence.data.tables import write_whole
from sma_sim.model.argument_checks import checked
from sma_sim.model.config import Config, folders_of
from sma_sim.model.errors import UserError
from sma_sim.model.parameter_file import parameter_file


def folders_from(out: Path, folders: Sequence[Path]) -> list[str]:
    """Folders as a parameter file at `out` names them: relative to it."""
    home = out.resolve().parent
    return [os.path.relpath(folder.resolve(), home) for folder in folders]


@checked
def write_config(config: Config, path: str | Path) -> Path:
    """Write a parameter file, which `read_config`, every command and the node read, whole or not at all.

    Parameters
    ----------
    config : Config
        The configuration.
    path : str or Path
        The file (.yaml).

    Returns
    -------
    Path
        The file.

    Raises
    ------
    UserError
        For a file that cannot be written, and for an effect or a structure of your own that is in no file.

    Examples
    --------
    >>> import sma_sim, tempfile
    >>> config = sma_sim.Config({'beam.E': 2.2e9}, effects=sma_sim.effects.gravity)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     sma_sim.read_config(sma_sim.write_config(config, f'{folder}/robot.yaml')) == config
    True
    """
    target = Path(path)
    own = [active.effect for active in config.effects if active.effect.is_own and not active.effect.files]
    if own or (config.own_structure is not None and not config.own_structure.files):
        name = own[0].name if own else config.system
        raise UserError(f'{name} is in no file: write it as EFFECT or STRUCTURE to one, and name its folder')
    effect_folders = sorted({file.parent for active in config.effects for file in active.effect.files})
    text = parameter_file_at(target, config, folders_from(target, effect_folders))
    write_whole(target, lambda file: file.write(text))
    return target


def parameter_file_at(out: Path, config: Config, effect_folders: Sequence[str]) -> str:
    """The text of a parameter file at `out`, which names the structure's folder relative to it, and these of effects."""
    return parameter_file(
        config, effect_folders, folders_from(out, [Path(folder) for folder in folders_of(config.structure)])
    )
