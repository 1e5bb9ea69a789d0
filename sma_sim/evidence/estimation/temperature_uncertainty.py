"""What isobaric tests show beyond the uncertainty of the specimen's temperature.

A thermocouple is at one point of a specimen whose temperature differs by some kelvins from end to end. A model that
transforms sharply is then off by its whole strain in a few samples, and gradual transformation within these kelvins would be
a property of the furnace. A residual counts by its distance from all that the model shows within the uncertainty.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.estimation.residuals import FitData, model_columns
from sma_sim.model.structures.discovery import known_structures

Vector = NDArray[np.float64]
UNCERTAINTY = 2.0  # [K] of a specimen's temperature: a thermocouple is at one point of it


def error_beyond_temperature(fit: FitResult) -> float:
    """Error over noise of the strain of all isobaric tests beyond that uncertainty; NaN where there are none."""
    problem, config, squares = fit.problem, fit.config, []
    for run, indices in zip(problem.runs, problem.indices(), strict=True):
        if not np.isnan(run.level) and 'strain' in run.channels:
            shown = model_columns(config, run, problem.nuisance(run, fit.z[indices]))['strain']
            k = run.channels.index('strain')
            away = distance(run.measured[k], shown, temperature_of(run))
            squares.append((away * run.weight[k])[run.weight[k] > 0.0] ** 2)
    return float(np.sqrt(np.mean(np.concatenate(squares)))) if squares else float('nan')


def temperature_of(run: FitData) -> Vector:
    """The imposed temperature [K] at the samples of a run."""
    column = run.source.values[:, known_structures()[run.bench].imposed_temperature]
    return np.interp(run.time, run.source.times, column)


def distance(measured: Vector, shown: Vector, T: Vector, uncertainty: float = UNCERTAINTY) -> Vector:
    """How far measured values (k,) lie from all that is shown next to them at temperatures within `uncertainty`."""
    found = np.empty(len(T))
    for i, value in enumerate(measured):
        apart = np.abs(T - T[i]) > uncertainty
        before, after = np.flatnonzero(apart[:i]), np.flatnonzero(apart[i:])
        near = shown[before[-1] + 1 if len(before) else 0 : i + after[0] if len(after) else len(T)]
        found[i] = max(near.min() - value, value - near.max(), 0.0)
    return found
