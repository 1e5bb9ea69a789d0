"""How well values are known together: the covariance that a fit leaves, as a parameter file has it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sma_sim.model.comparable import Comparable
from sma_sim.model.given import RawValue
from sma_sim.model.nearest import suggestion
from sma_sim.model.parameter_yaml import ConfigError
from sma_sim.model.parameters import Parameter, is_number

NAMES, MATRIX = 'covariance.names', 'covariance.matrix'
ROUNDING = 1e-9  # relative: by so much a matrix may differ from a symmetric one without negative eigenvalues


@dataclass(frozen=True, eq=False)
class ParameterCovariance(Comparable):
    """The covariance of parameters whose values were estimated.

    Attributes
    ----------
    names : tuple of str
        Full names (p,).
    matrix : array
        (p, p): of the logarithm of a parameter that is positive by its nature, else of its value [SI].
    """

    names: tuple[str, ...]
    matrix: NDArray[np.float64]

    def of(self, names: Sequence[str]) -> ParameterCovariance:
        """That of some of these parameters, whatever the others are."""
        kept = [self.names.index(name) for name in names]
        return ParameterCovariance(tuple(names), self.matrix[np.ix_(kept, kept)])


def covariance_given(
    given: ParameterCovariance | Mapping[str, RawValue] | None, declared: Mapping[str, Parameter], active: Sequence[str]
) -> ParameterCovariance | None:
    """A covariance of `declared` parameters, as such or by the names of a file; effects that are not `active` are left out.

    None where there is none. Raises ConfigError.
    """
    if isinstance(given, ParameterCovariance):
        where = 'in with_covariance'
        given = {NAMES: RawValue(given.names, where), MATRIX: RawValue(given.matrix, where)} if given.names else None
    if not given:
        return None
    if given.keys() != {NAMES, MATRIX}:
        raise ConfigError(f'{next(iter(given))} ({next(iter(given.values())).where}): expected both {NAMES} and {MATRIX}')
    names, matrix = given[NAMES], given[MATRIX]
    said = f'{NAMES} and {MATRIX} ({names.where})'
    listed = list(names.value) if isinstance(names.value, list | tuple) else [names.value]
    for name in listed:
        gone = isinstance(name, str) and name.startswith('effects.') and name.split('.')[1] not in active
        if name not in declared and not gone:
            raise ConfigError(f'{NAMES} ({names.where}): no fit of this model changes {name}{suggestion(name, declared)}')
    if len(set(listed)) < len(listed):
        raise ConfigError(f'{NAMES} ({names.where}): a name is there twice')
    values = np.array(entries(matrix))
    if values.size != len(listed) ** 2 or not np.isfinite(values).all():
        count = len(listed) ** 2
        raise ConfigError(f'{said}: {values.size} numbers for {len(listed)} names; expected {count}, one row after another')
    square = values.reshape(len(listed), len(listed))
    size = float(np.abs(square).max(initial=0.0))
    eigenvalues = np.linalg.eigvalsh(0.5 * (square + square.T))
    if np.abs(square - square.T).max(initial=0.0) > ROUNDING * size or (eigenvalues < -ROUNDING * size).any():
        raise ConfigError(f'{said}: expected a covariance, symmetric and without negative eigenvalues')
    if not (np.diag(square) > 0.0).all():
        raise ConfigError(f'{said}: expected variances, on the diagonal, above 0')
    known = [name for name in listed if name in declared]
    return ParameterCovariance(tuple(listed), square).of(known) if known else None


def entries(matrix: RawValue) -> list[float]:
    """The numbers of a matrix that is given as a list. Raises ConfigError."""
    given: Any = matrix.value.tolist() if isinstance(matrix.value, np.ndarray) else matrix.value
    given = given if isinstance(given, list | tuple) else [given]
    flat = [one for row in given for one in (row if isinstance(row, list | tuple) else [row])]
    if not all(is_number(one) for one in flat):
        raise ConfigError(f'{MATRIX} ({matrix.where}): expected a list of numbers, one row after another')
    return [float(one) for one in flat]
