"""Beyond the linear problem: a hypothesis is simulated with its inputs, and estimated again around them.

How far a linear model may be trusted is not known in advance. With a larger noise variance (a tempered likelihood) estimates
stay nearer to where they began: several variances, and fractions of each step, are simulated, and the best is taken.
Simulation alone decides which hypotheses are followed.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from sma_sim.evidence.estimation.executors import run_in_threads, workers_of
from sma_sim.evidence.estimation.injection_points import Port
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.latent_input.design_matrix import LinearizationPoint, Stopped, design_matrix
from sma_sim.evidence.latent_input.hypotheses import InputHypothesis
from sma_sim.evidence.latent_input.ranking import (
    HypothesisEvidence,
    error_from_squares,
    estimate_of,
    evidence_of,
    inflation_from,
    noise_inflation,
)
from sma_sim.model.arrays import Vector
from sma_sim.solver.simulate import SimulationError

STEP_FRACTIONS = (1.0, 0.5, 0.25, 0.1)  # of a linear step that are simulated
INFLATION_COUNT = 3  # noise variances, from what the linear model would leave to what is left now
TEMPERING_POWERS = (0.5, 0.25)  # of the present inflation, under which the prior is chosen; the first alone at first
MAX_FINALISTS = 5  # quantities that are simulated for more than one step, which takes most of the time
# Ratio to the least error above which a hypothesis is given up, by step: the first ones are lenient, since a linear estimate
# may start far from where it leads. One whose error falls to FAST_REDUCTION in a step stays as long as the first allows.
GIVE_UP_RATIOS, FAST_REDUCTION = (3.0, 1.3, 1.15, 1.1), 0.75
CONVERGED_REDUCTION = 0.95  # fraction of the squares before: a step that leaves more is the last


@dataclass(frozen=True)
class RefinedHypothesis:
    """A hypothesis between steps: the point that its inputs have reached, its linear problem around an earlier one.

    `squares`: over the bins, left by the simulation; `inflation`: the factor on the noise variance that these residuals call
    for; `converged`: no step leaves less; `reduction`: the error after the last step over that before.
    """

    point: LinearizationPoint
    evidence: HypothesisEvidence
    squares: float
    inflation: float
    converged: bool = False
    reduction: float = 1.0

    @property
    def hypothesis(self) -> InputHypothesis:
        """What may be missing."""
        return self.evidence.hypothesis

    @property
    def error(self) -> float:
        """Normalized RMSE that the simulation leaves."""
        return error_from_squares(self.evidence.design, self.squares)

    @property
    def u(self) -> Vector:
        """The inputs (m,), in probes, by run and port."""
        ports = self.hypothesis.ports
        return np.concatenate([inputs[port] / port.probe for inputs in self.point.inputs for port in ports])


def refine_hypotheses(
    start: LinearizationPoint, evidences: Sequence[HypothesisEvidence], context: SearchContext
) -> list[RefinedHypothesis]:
    """The best after one step of all, followed to where they lead; the best first. Raises Stopped."""
    stop, workers = context.stop, workers_of(context.pool)
    squares, inflation = simulated_squares(start, context.pool)
    context.on_progress(f'simulating each of {len(evidences)} hypotheses')
    refined = [
        RefinedHypothesis(with_zero_inputs(start, evidence.hypothesis), evidence, squares, inflation)
        for evidence in evidences
    ]
    first_steps = [partial(best_step, hypothesis, TEMPERING_POWERS[:1], context) for hypothesis in refined]
    refined = best_by_quantity(run_in_threads(first_steps, stop, workers))
    if stop.is_set():
        raise Stopped
    given_up: list[RefinedHypothesis] = []
    for ratio in GIVE_UP_RATIOS:
        given_up += [hypothesis for hypothesis in refined if not is_contender(hypothesis, refined[0], ratio)]
        refined = [hypothesis for hypothesis in refined if is_contender(hypothesis, refined[0], ratio)]
        if all(hypothesis.converged for hypothesis in refined):
            break
        context.on_progress(
            f'simulating {hypothesis_names([hypothesis for hypothesis in refined if not hypothesis.converged])}'
        )
        try:
            refined = run_in_threads([partial(relinearized, hypothesis, context) for hypothesis in refined], stop)
        except Stopped:
            break
        next_steps = [partial(best_step, hypothesis, TEMPERING_POWERS, context) for hypothesis in refined]
        refined = by_squares(run_in_threads(next_steps, stop, workers))
    limit = GIVE_UP_RATIOS[-1] * refined[0].error
    near = [hypothesis for hypothesis in refined if hypothesis.error <= limit]
    return by_squares([*refined, *given_up, *single_wire_variants(near, context)])


def hypothesis_names(refined: Sequence[RefinedHypothesis]) -> str:
    """Their names, for a message."""
    return ', '.join(hypothesis.hypothesis.name for hypothesis in refined)


def is_contender(hypothesis: RefinedHypothesis, best: RefinedHypothesis, ratio: float) -> bool:
    """Whether another step is worth its time."""
    fast = hypothesis.reduction <= FAST_REDUCTION
    return hypothesis.error <= ratio * best.error or (fast and hypothesis.error <= GIVE_UP_RATIOS[0] * best.error)


def single_wire_variants(refined: Sequence[RefinedHypothesis], context: SearchContext) -> list[RefinedHypothesis]:
    """Hypotheses of both wires on either of them alone, after two steps."""
    variants = [
        replace(
            both,
            converged=False,
            evidence=replace(both.evidence, hypothesis=InputHypothesis(port.name, (port,))),
            point=replace(both.point, inputs=tuple({port: inputs[port]} for inputs in both.point.inputs)),
        )
        for both in refined
        for port in both.hypothesis.ports
        if len(both.hypothesis.ports) > 1
    ]
    if not variants:
        return []
    context.on_progress(f'simulating {hypothesis_names(variants)}')
    try:
        return run_in_threads(
            [partial(two_steps, variant, context) for variant in variants], context.stop, workers_of(context.pool)
        )
    except Stopped:
        return []


def two_steps(hypothesis: RefinedHypothesis, context: SearchContext) -> RefinedHypothesis:
    """Two steps from what the simulation leaves at its point. Raises Stopped."""
    squares, inflation = simulated_squares(hypothesis.point, context.pool)
    first = best_step(replace(hypothesis, squares=squares, inflation=inflation), TEMPERING_POWERS, context)
    return best_step(relinearized(first, context), TEMPERING_POWERS, context)


def by_squares(refined: Sequence[RefinedHypothesis]) -> list[RefinedHypothesis]:
    """What leaves the least first."""
    return sorted(refined, key=lambda hypothesis: hypothesis.squares)


def with_zero_inputs(start: LinearizationPoint, hypothesis: InputHypothesis) -> LinearizationPoint:
    """The point with inputs of zero at the ports of a hypothesis."""
    zero = np.zeros(sum(len(grid.knots) for grid in start.grids) * len(hypothesis.ports))
    return replace(start, inputs=tuple(inputs_by_run(start, hypothesis, zero)))


def best_by_quantity(refined: Sequence[RefinedHypothesis]) -> list[RefinedHypothesis]:
    """The quantities that leave the least, the best first; on both wires, from where the best on one or both has come."""
    best: dict[str, RefinedHypothesis] = {}
    widest = {
        hypothesis.hypothesis.group: hypothesis
        for hypothesis in sorted(refined, key=lambda hypothesis: len(hypothesis.hypothesis.ports))
    }
    for hypothesis in by_squares(refined):
        best.setdefault(hypothesis.hypothesis.group, hypothesis)
    extended = [extended_to(hypothesis, widest[group]) for group, hypothesis in best.items()]
    return extended[:MAX_FINALISTS]


def extended_to(best: RefinedHypothesis, both: RefinedHypothesis) -> RefinedHypothesis:
    """A hypothesis with all ports of the other one, whose inputs are zero where it has none yet."""
    inputs = tuple(
        {port: own.get(port, 0.0 * next(iter(own.values()))) for port in both.hypothesis.ports} for own in best.point.inputs
    )
    return replace(best, point=replace(best.point, inputs=inputs), evidence=both.evidence)


def relinearized(hypothesis: RefinedHypothesis, context: SearchContext) -> RefinedHypothesis:
    """With the linear problem around its point. Raises Stopped."""
    if hypothesis.converged:
        return hypothesis
    silent = replace(context, on_progress=lambda words: None)
    design = design_matrix(hypothesis.point, hypothesis.hypothesis.ports, silent)
    return replace(hypothesis, evidence=replace(hypothesis.evidence, design=design))


def best_step(hypothesis: RefinedHypothesis, powers: Sequence[float], context: SearchContext) -> RefinedHypothesis:
    """The best of several steps; converged where none leaves much less than before."""
    if hypothesis.converged or context.stop.is_set():
        return hypothesis
    best = hypothesis
    for evidence, point in trial_steps(hypothesis, powers):
        squares, inflation = simulated_squares(point, context.pool)
        if squares < best.squares:
            best = RefinedHypothesis(point, evidence, squares, inflation)
    if best.squares > CONVERGED_REDUCTION * hypothesis.squares:
        return replace(hypothesis, converged=True, reduction=1.0)
    return replace(best, reduction=best.error / hypothesis.error)


def trial_steps(
    refined: RefinedHypothesis, powers: Sequence[float]
) -> Iterator[tuple[HypothesisEvidence, LinearizationPoint]]:
    """Priors of the inputs, and the points to which they lead."""
    point, design = refined.point, refined.evidence.design
    low, high = point.problem.limits()
    for power in powers:
        evidence = evidence_of(design, refined.hypothesis, refined.inflation**power, mixed=False)
        least = min(noise_inflation(evidence, 1.0), refined.inflation)
        for inflation in dict.fromkeys(np.geomspace(least, refined.inflation, INFLATION_COUNT).tolist()):
            estimate = estimate_of(evidence, inflation)
            target, z = inputs_by_run(point, refined.hypothesis, estimate.u), design.z + estimate.z
            for fraction in STEP_FRACTIONS:
                pairs = zip(point.inputs, target, strict=True)
                yield (
                    evidence,
                    replace(
                        point,
                        z=np.clip(point.z + fraction * (z - point.z), low, high),
                        inputs=tuple(
                            {port: (1.0 - fraction) * now[port] + fraction * u for port, u in then.items()}
                            for now, then in pairs
                        ),
                    ),
                )


def simulated_squares(point: LinearizationPoint, pool: Executor) -> tuple[float, float]:
    """Sum of the squared residuals and the noise inflation they call for; inf where a run cannot be simulated."""
    try:
        by_run = point.residuals(pool)
    except SimulationError:
        return np.inf, np.inf
    residuals = [run for run in by_run if run is not None]
    if len(residuals) < len(by_run):
        return np.inf, np.inf
    return float(sum(np.sum(run**2) for run in residuals)), inflation_from(residuals)


def inputs_by_run(point: LinearizationPoint, hypothesis: InputHypothesis, u: Vector) -> list[dict[Port, Vector]]:
    """u (m,), in probes, by run and port, in the ports' units."""
    by_run, at = [], 0
    for grid in point.grids:
        inputs = {}
        for port in hypothesis.ports:
            inputs[port] = port.probe * u[at : at + len(grid.knots)]
            at += len(grid.knots)
        by_run.append(inputs)
    return by_run
