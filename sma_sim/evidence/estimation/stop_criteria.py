"""When a minimisation ends, for every kind of fit."""

from __future__ import annotations

from dataclasses import dataclass, replace


@dataclass(frozen=True)
class StopCriteria:
    """How a minimisation starts and when it ends.

    `damping`: of the first step, in units of the priors' curvature: a direction is followed to the end at once where the
    data know it better than its prior by the square root of that. It ends after `max_iterations`, which bounds the time of a
    fit that creeps, when the next step is predicted to lower the cost by at most `min_decrease` times the square of the
    normalized RMSE (d moves no estimate by more than sqrt(2 d) of its standard deviation: 0.01 by 0.14, 0.3 by 0.8, enough
    to compare models), or when the last step gained less than the fraction `relative_decrease` of the cost: a model that
    lacks something goes on to gain a little for ever. `central`: central differences from the first iteration on. `secant`:
    from a point near the optimum, where a linearisation serves several steps.
    """

    max_iterations: int
    damping: float
    min_decrease: float
    relative_decrease: float
    central: bool
    secant: bool = False


# From the middle of the priors, on thinned samples: strong damping keeps what data hardly see near its prior.
FROM_PRIORS = StopCriteria(max_iterations=20, damping=1e4, min_decrease=0.3, relative_decrease=3e-4, central=False)
# The same with weak damping: either may miss a valley that the other one finds.
WEAKLY_DAMPED = replace(FROM_PRIORS, damping=1e2)
# The model without further effects: a model that lacks an effect creeps along valleys that end nowhere.
NOMINAL_MODEL = replace(FROM_PRIORS, max_iterations=12, relative_decrease=1e-3)
# With a new effect, from the fit without it.
ADDED_EFFECT = StopCriteria(max_iterations=12, damping=10.0, min_decrease=0.3, relative_decrease=1e-3, central=False)
# A model that has weight, whose score is compared to a nat: to the end.
SETTLED = replace(ADDED_EFFECT, max_iterations=60, relative_decrease=0.0)
# A tempered likelihood, whose weights change from stage to stage.
TEMPERED = StopCriteria(max_iterations=15, damping=1.0, min_decrease=0.01, relative_decrease=3e-3, central=False)
# The reported fit, on all samples.
ALL_SAMPLES = StopCriteria(
    max_iterations=12, damping=1.0, min_decrease=0.01, relative_decrease=0.0, central=True, secant=True
)
# The unknowns of a run under fixed parameters: few of them, found from far away, to the end.
RUN_UNKNOWNS = replace(FROM_PRIORS, min_decrease=ALL_SAMPLES.min_decrease, relative_decrease=0.0)
SKETCH_DECREASE = 1e-3  # predicted decrease at which a sketch of a fit ends, as a fraction of the cost or of the samples
