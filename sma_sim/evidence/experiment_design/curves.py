"""Curves of a designed experiment: what each hypothesis predicts, and what a rival leaves after it was refitted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sma_sim.evidence.experiment_design.plan import Plan
from sma_sim.evidence.experiment_design.utilities import linearized_rival
from sma_sim.model.arrays import Matrix


@dataclass(frozen=True)
class HypothesisCurves:
    """Channels (c, n) in SI units that a hypothesis predicts, and their standard deviations in its posterior.

    `remainder` (c, n): if the best hypothesis is true, its channels less those of this one after it was refitted to
    recordings and experiment together (linearized), over the noise of a sample; None for the best itself.
    """

    name: str
    mean: Matrix
    std: Matrix
    remainder: Matrix | None


def best_hypothesis(plan: Plan) -> int:
    """The hypothesis that the recordings favour most."""
    return max(range(len(plan.hypotheses)), key=lambda k: plan.hypotheses[k].log_evidence)


def hypothesis_curves(plan: Plan) -> tuple[HypothesisCurves, ...]:
    """The curves of all hypotheses of a design, in their order, at the samples of its run."""
    return tuple(curves_of(plan, k) for k in range(len(plan.hypotheses)))


def curves_of(plan: Plan, number: int) -> HypothesisCurves:
    """The curves of one hypothesis."""
    weight, prediction, best = plan.run.weight, plan.predictions[number], best_hypothesis(plan)
    mean = prediction.centres[0].reshape(weight.shape) / weight
    std = np.sqrt(np.sum(prediction.jacobians[0].reshape(-1, *weight.shape) ** 2, axis=0)) / weight
    remainder = None
    if number != best:
        rival = linearized_rival(prediction)
        difference = plan.predictions[best].centres[0] - rival.centre
        remainder = rival.residual(difference).reshape(weight.shape) / np.sqrt(plan.every)
    return HypothesisCurves(plan.hypotheses[number].name, mean, std, remainder)
