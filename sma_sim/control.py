"""Controllers that follow a target: `PI` alone, `FeedforwardPI` with the heating that a model says, and
`PredictiveController`, which plans from what an observer estimates."""

from sma_sim.evidence.control.feedforward import Feedforward, FeedforwardPI
from sma_sim.evidence.control.pi import PI
from sma_sim.evidence.control.plan import Target
from sma_sim.evidence.control.predictive import PredictiveController

__all__ = ['PI', 'Feedforward', 'FeedforwardPI', 'PredictiveController', 'Target']
