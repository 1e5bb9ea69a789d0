"""Whether an argument is what a function takes: the message says what was given, and what makes the right one."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sma_sim.model.errors import UserError

MAKERS = {  # of the arguments of public functions, by their class
    'Config': 'sma_sim.Config(...) or read_config(...)',
    'Model': 'sma_sim.Model(config)',
    'Input': 'sma_sim.module_input(...) or wire_input(...)',
    'Recording': 'sma_sim.Recording(...)',
    'Dataset': 'sma_sim.read_dataset(...) or Dataset(...)',
}


def expect(name: str, value: object, *kinds: type) -> None:
    """Raise UserError for a value that is of none of these kinds; None is one where it is named."""
    if isinstance(value, kinds):
        return
    words = [kind.__name__ for kind in kinds if kind is not type(None)]
    maker = MAKERS.get(words[0], '')
    raise UserError(f'{name}: expected {" or ".join(words)}{maker and f", from {maker}"}; got {type(value).__name__}')


def as_array(name: str, value: Any, like: str = '') -> NDArray[np.float64]:
    """An array of numbers. Raises UserError."""
    try:
        return np.asarray(value, dtype=float)
    except (TypeError, ValueError) as error:
        raise UserError(f'{name}: expected numbers{like and f" {like}"}, got {value!r}') from error


def as_folders(name: str, given: str | Path | Iterable[str | Path]) -> list[Path]:
    """Folders as they may be given: one, or several. Raises UserError."""
    every = [given] if isinstance(given, str | Path) else list(given)
    for folder in every:
        if not isinstance(folder, str | Path):
            raise UserError(f'{name}: expected a folder, got {folder!r}')
    return [Path(folder) for folder in every]
