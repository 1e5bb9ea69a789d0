"""What all steps of a search share: where they are computed, what ends them, whom they report to."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from sma_sim.model.config import MODELS

OnProgress = Callable[[str], None]  # what is being done, in words
OnModel = Callable[[str, tuple[str, ...], str, float], None]
"""A model of a diagnosis: `nominal`, `candidate` or `accepted`; its effects, its kinetics, its normalized RMSE."""
OnIteration = Callable[[str, int, float], None]  # which minimisation, its iteration, its cost


class Stop(Protocol):
    """What ends a search early, such as a `threading.Event`."""

    def is_set(self) -> bool:
        """Whether to end now."""

    def set(self) -> None:
        """Ask everything that shares it to end."""


def silent(words: str) -> None:
    """Report no progress."""


def iteration_words(label: str, iteration: int, cost: float) -> str:
    """What a fit is doing."""
    return f'{label}, step {iteration}, cost {cost:.4g}'


def silent_iteration(label: str, iteration: int, cost: float) -> None:
    """Report no iteration."""


def silent_model(kind: str, effects: tuple[str, ...], kinetics: str, error: float) -> None:
    """Report no model."""


@dataclass(frozen=True)
class SearchContext:
    """Shared by all steps of a search.

    `pool`: runs the simulations; `stop`: set by Ctrl-C; `folders`: the user's own effects; `seed`: of bootstrap and draws;
    `variants`: whether effects are tried in a part of their places too; `kinetics`: those that a model may have.
    """

    pool: Executor
    stop: Stop
    on_progress: OnProgress = silent
    folders: tuple[Path, ...] = ()
    seed: int = 0
    on_iteration: OnIteration = silent_iteration
    variants: bool = True
    kinetics: tuple[str, ...] = MODELS
    on_model: OnModel = silent_model
