"""Robots as a fit knows them: parameters drawn from the normal distribution that its intervals and correlations describe."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh

from sma_sim.model.errors import UserError

REACH = 1.959964  # standard deviations of a 95 % interval, beyond which nothing is drawn


@dataclass(frozen=True, eq=False)
class Posterior:
    """Parameters of a robot with their uncertainty.

    Attributes
    ----------
    names : tuple of str
        Full names of the parameters.
    values, stds : array (p,)
        Their values [SI], and standard deviations: of the logarithm where `log`, else in their unit.
    log : array (p,) of bool
        Whether a parameter is distributed as its logarithm.
    root : array (p, p)
        L with L L' the correlations.
    """

    names: tuple[str, ...]
    values: NDArray[np.float64]
    stds: NDArray[np.float64]
    log: NDArray[np.bool_]
    root: NDArray[np.float64]

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Posterior:
        """What ``sma-sim fit --json FILE`` wrote. A parameter that the data do not determine keeps its fitted value.

        Raises UserError for a file without intervals.
        """
        try:
            given = json.loads(Path(path).read_text(encoding='utf-8'))
            return cls.from_fit(given)
        except OSError as error:
            raise UserError(f'cannot read {path}: {error.strerror}') from error
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            raise UserError(f'{path} has no intervals of a fit: expected what sma-sim fit --json FILE writes') from error

    @classmethod
    def from_fit(cls, given: Mapping[str, Any]) -> Posterior:
        """The same of the data themselves. Raises KeyError, TypeError or ValueError for others."""
        found = given['parameters']
        correlation = np.asarray(given['correlation'], dtype=float).reshape(len(found), len(found))
        seen = np.array([bool(one['seen']) for one in found.values()])
        eigenvalues, vectors = eigh(np.where(np.outer(seen, seen), np.nan_to_num(correlation), np.eye(len(found))))
        return cls(
            tuple(found),
            np.array([float(one['value']) for one in found.values()]),
            np.where(seen, [float(one['std']) for one in found.values()], 0.0),
            np.array([bool(one['log']) for one in found.values()]),
            vectors * np.sqrt(np.maximum(eigenvalues, 0.0)),
        )

    def draw(self, random: np.random.Generator) -> dict[str, float]:
        """One robot: values by full name."""
        z = np.clip(self.root @ random.standard_normal(len(self.names)), -REACH, REACH) * self.stds
        drawn = np.where(self.log, self.values * np.exp(np.where(self.log, z, 0.0)), self.values + z)
        return dict(zip(self.names, drawn.tolist(), strict=True))
