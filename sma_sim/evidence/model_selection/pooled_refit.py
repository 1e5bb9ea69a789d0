"""Is a held-out run beyond the model, or only beyond what the fitted runs tell of its parameters?

A run that goes further than the fitted ones needs parameters that these hardly determine: its error is large, and nothing is
missing. Then one set of parameters explains all runs; where something is missing, none does. Nor does it mean anything
if the ambient temperature of each run, which nobody measured, is all that it takes.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from sma_sim.evidence.data.recording import Dataset
from sma_sim.evidence.estimation.calibrate import FitOptions, multistart_search, problem_for
from sma_sim.evidence.estimation.curve_features import curve_features
from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.estimation.held_out_prediction import RunFit, own_unknowns, pooled_error, run_fits
from sma_sim.evidence.estimation.levenberg_marquardt import start_point
from sma_sim.evidence.estimation.prepared_fit import PreparedFit
from sma_sim.evidence.estimation.problem import linearize
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.estimation.stop_criteria import FROM_PRIORS
from sma_sim.evidence.estimation.uncertainty import AmbientDifference, information_of, uncertainty
from sma_sim.evidence.model_selection.criteria import CRITERIA, fits_all
from sma_sim.evidence.model_selection.differing_recordings import AMBIENT, with_difference
from sma_sim.evidence.model_selection.refit import refit
from sma_sim.solver.simulate import SimulationError


@dataclass(frozen=True)
class PooledErrors:
    """Errors over noise of the training and the held-out runs when one model is fitted to all of them.

    `ambient`: by recording, how far its ambient temperature is from that of its input [K], where that had to differ;
    `above_first`: and from that of the first recording.
    """

    train: float
    held_out: float
    ambient: Mapping[str, float] = field(default_factory=dict)
    above_first: Mapping[str, AmbientDifference] = field(default_factory=dict)

    def explained(self, limit: float = CRITERIA.unexplained) -> bool:
        """Whether nothing is left in either; `limit`: the error above which something is missing."""
        return max(self.train, self.held_out) <= fits_all(limit)


def pooled_refit(
    datasets: tuple[Dataset, Dataset],
    last: FitResult,
    predicted: Sequence[RunFit],
    options: FitOptions,
    context: SearchContext,
    limit: float = CRITERIA.unexplained,
) -> PooledErrors | None:
    """The last model fitted to the training and the held-out runs, from where it is and where they are `predicted` to start.

    The first of several fits that leaves no more than `limit` allows, else the first one. None where it cannot be run, or
    was stopped.
    """
    training, held_out = datasets
    both = replace(training, recordings=(*training.recordings, *held_out.recordings))
    first: PooledErrors | None = None
    for fit in refits(both, last, predicted, options, context):
        if context.stop.is_set():
            return None
        errors = None if fit is None else errors_of(fit, training, context)
        if errors is not None and errors.explained(limit):
            return errors
        first = first or errors
    return first


def refits(
    both: Dataset, last: FitResult, predicted: Sequence[RunFit], options: FitOptions, context: SearchContext
) -> Iterator[FitResult | None]:
    """Fits of the last model to all runs, one after the other as they are asked for; None for one that cannot be made.

    From where it is and where the held-out runs are `predicted` to start; from all starts of a fit; with an ambient
    temperature for each run, where these have none yet and their wires have a balance of heat.
    """
    problem = replace(problem_for(both, last.problem.config, options, 1), free=last.problem.free)
    own = [z for run in predicted for z in own_unknowns(run)]
    z = start_point(problem, np.concatenate([last.z, own]))
    context.on_progress('fitting the held-out runs too')
    found = refit(problem, z, context, FROM_PRIORS)
    yield found
    context.on_progress('fitting all runs from the start')
    names = tuple(parameter.name for parameter in last.problem.free)
    try:
        start = PreparedFit(both, last.problem.config, curve_features(both), context.kinetics)
        yield multistart_search(start, replace(options, free=names), context, FROM_PRIORS)
    except SimulationError:
        yield None
    if found is not None and all(run.ambient_std == 0.0 and problem.wires(run) for run in problem.runs):
        context.on_progress('fitting all runs, each with an ambient temperature of its own')
        yield refit(*with_difference(problem, found.z, AMBIENT), context, FROM_PRIORS)


def errors_of(fit: FitResult, training: Dataset, context: SearchContext) -> PooledErrors:
    """The errors of a fit to the training runs and those held out, in this order."""
    fits = run_fits(fit.problem, fit.z, context.pool)
    count = len(training.recordings)
    ambient = {run.name: run.ambient for run in fits if run.ambient_std > 0.0}
    known: Mapping[str, AmbientDifference] = {}
    if ambient:
        linear = linearize(fit.problem, fit.z, context.pool)
        said = [information_of(data, run, fit.problem.robust) for data, run in zip(fit.problem.runs, linear, strict=True)]
        known = uncertainty(fit.problem, fit.z, said).ambient
    return PooledErrors(pooled_error(fits[:count])[0], pooled_error(fits[count:])[0], ambient, known)
