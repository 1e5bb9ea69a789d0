"""Is a held-out run beyond the model, or only beyond what the fitted runs tell of its parameters?

A run that goes further than the fitted ones needs parameters that these hardly determine: its error is large, and nothing is
missing. Then one set of parameters explains all runs; where something is missing, none does. Nor does it mean anything
if the ambient temperature of each run, which nobody measured, is all that it takes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from sma_sim.evidence.data.recording import Dataset
from sma_sim.evidence.estimation.calibrate import FitOptions, multistart_search, problem_for
from sma_sim.evidence.estimation.cross_validation import RunFit, own_unknowns, pooled_error, run_fits
from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.estimation.levenberg_marquardt import start_point
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.estimation.stop_criteria import FROM_PRIORS
from sma_sim.evidence.model_selection.criteria import CRITERIA, fits_all
from sma_sim.evidence.model_selection.differing_recordings import AMBIENT, with_difference
from sma_sim.evidence.model_selection.refit import refit


@dataclass(frozen=True)
class PooledErrors:
    """Errors over noise of the training and the held-out runs when one model is fitted to all of them.

    `ambient`: by recording, how far its ambient temperature is from that of its input [K], where that had to differ.
    """

    train: float
    held_out: float
    ambient: Mapping[str, float] = field(default_factory=dict)

    def explained(self, limit: float = CRITERIA.unexplained) -> bool:
        """Whether nothing is left in either; `limit`: the error above which something is missing."""
        return max(self.train, self.held_out) <= fits_all(limit)


def pooled_refit(
    datasets: tuple[Dataset, Dataset], last: FitResult, predicted: Sequence[RunFit], options: FitOptions,
    context: SearchContext, limit: float = CRITERIA.unexplained,
) -> PooledErrors | None:  # fmt: skip
    """The last model fitted to the training and the held-out runs, from where it is and where they are `predicted` to start.

    Where that leaves more than `limit` allows, each run may have its own ambient temperature. None where it cannot be run,
    or was stopped.
    """
    training, held_out = datasets
    both = replace(training, recordings=(*training.recordings, *held_out.recordings))
    problem = replace(problem_for(both, last.problem.config, options, 1), free=last.problem.free)
    own = [z for run in predicted for z in own_unknowns(run)]
    z = start_point(problem, np.concatenate([last.z, own]))
    context.on_progress('fitting the held-out runs too')
    found = refit(problem, z, context, FROM_PRIORS)
    if found is None or context.stop.is_set():
        return None
    errors = errors_of(found, training, context)
    if errors.explained(limit):
        return errors
    context.on_progress('fitting all runs from the start')
    names = tuple(parameter.name for parameter in last.problem.free)
    again = multistart_search(both, last.problem.config, replace(options, free=names), context, FROM_PRIORS)
    further = errors_of(again, training, context)
    if further.explained(limit) or any(run.ambient_std > 0.0 or not problem.wires(run) for run in problem.runs):
        return further if further.explained(limit) else errors
    context.on_progress('fitting all runs, each with an ambient temperature of its own')
    differing = refit(*with_difference(problem, found.z, AMBIENT), context, FROM_PRIORS)
    if differing is None or context.stop.is_set():
        return errors
    in_own_rooms = errors_of(differing, training, context)
    return in_own_rooms if in_own_rooms.explained(limit) else errors


def errors_of(fit: FitResult, training: Dataset, context: SearchContext) -> PooledErrors:
    """The errors of a fit to the training runs and those held out, in this order."""
    fits = run_fits(fit.problem, fit.z, context.pool)
    count = len(training.recordings)
    ambient = {run.name: run.ambient for run in fits if run.ambient_std > 0.0}
    return PooledErrors(pooled_error(fits[:count])[0], pooled_error(fits[count:])[0], ambient)
