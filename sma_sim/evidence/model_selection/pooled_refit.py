"""Is a held-out run beyond the model, or only beyond what the fitted runs tell of its parameters?

A run that goes further than the fitted ones needs parameters that these hardly determine: its error is large, and nothing is
missing. Then one set of parameters explains all runs; where something is missing, none does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sma_sim.evidence.data.recording import Dataset
from sma_sim.evidence.estimation.calibrate import FitOptions, problem_for
from sma_sim.evidence.estimation.cross_validation import RunFit, own_unknowns, pooled_error, run_fits
from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.estimation.levenberg_marquardt import start_point
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.estimation.stop_criteria import FROM_PRIORS
from sma_sim.evidence.model_selection.criteria import CRITERIA, fits_all
from sma_sim.evidence.model_selection.refit import refit


@dataclass(frozen=True)
class PooledErrors:
    """Errors over noise of the training and the held-out runs when one model is fitted to all of them."""

    train: float
    held_out: float

    def explained(self, limit: float = CRITERIA.unexplained) -> bool:
        """Whether nothing is left in either; `limit`: the error above which something is missing."""
        return max(self.train, self.held_out) <= fits_all(limit)


def pooled_refit(
    training: Dataset, held_out: Dataset, last: FitResult, predicted: Sequence[RunFit], options: FitOptions,
    context: SearchContext,
) -> PooledErrors | None:  # fmt: skip
    """The last model fitted to the held-out runs too, from where it is and where they are `predicted` to start.

    None where it cannot be run, or was stopped.
    """
    both = replace(training, recordings=(*training.recordings, *held_out.recordings))
    problem = replace(problem_for(both, last.problem.config, options, 1), free=last.problem.free)
    own = [z for run in predicted for z in own_unknowns(run)]
    z = start_point(problem, np.concatenate([last.z, own]))
    context.on_progress('fitting the held-out runs too')
    found = refit(problem, z, context, FROM_PRIORS)
    if found is None or context.stop.is_set():
        return None
    fits = run_fits(problem, found.z, context.pool)
    count = len(training.recordings)
    return PooledErrors(pooled_error(fits[:count])[0], pooled_error(fits[count:])[0])
