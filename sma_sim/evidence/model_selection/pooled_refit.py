"""Is a held-out run beyond the model, or only beyond what the fitted runs tell of its parameters?

A run that goes further than the fitted ones needs parameters that these hardly tell: its error is large, and nothing is
missing. Then one set of parameters explains all runs; where something is missing, none does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sma_sim.evidence.data.recording import Campaign
from sma_sim.evidence.estimation.calibrate import Options, problem_for
from sma_sim.evidence.estimation.cross_validation import RunFit, own_unknowns, run_fits, summed_up
from sma_sim.evidence.estimation.levenberg_marquardt import FIRST, start_point
from sma_sim.evidence.model_selection.forward_selection import SearchContext
from sma_sim.evidence.model_selection.refit import FitResult, refit

ALL = 1.05  # error over noise of runs that one model explains: more is no chance in some hundred samples, but small


@dataclass(frozen=True)
class PooledErrors:
    """Errors over noise of the training and the held-out runs when one model is fitted to all of them."""

    train: float
    held_out: float

    @property
    def explained(self) -> bool:
        """Whether nothing is left in either."""
        return max(self.train, self.held_out) <= ALL


def pooled_refit(
    training: Campaign, out: Campaign, last: FitResult, predicted: Sequence[RunFit], options: Options, context: SearchContext
) -> PooledErrors | None:
    """The last model fitted to the held-out runs too, from where it is and they are `predicted` to begin.

    None where it cannot be run, or was stopped.
    """
    both = replace(training, recordings=(*training.recordings, *out.recordings))
    problem = replace(problem_for(both, last.problem.config, options, 1), free=last.problem.free)
    own = [z for fit in predicted for z in own_unknowns(fit)]
    z = start_point(problem, np.concatenate([last.z, own]))
    context.on_progress('the held-out runs fitted too')
    found = refit(problem, z, context.pool, context.stop, FIRST)
    if found is None or context.stop.is_set():
        return None
    fits = run_fits(problem, found.z, context.pool)
    count = len(training.recordings)
    return PooledErrors(summed_up(fits[:count])[0], summed_up(fits[count:])[0])
