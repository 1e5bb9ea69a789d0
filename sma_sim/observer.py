"""Estimates of what cannot be measured of a running robot's wires: `Observer` and its `Estimate`."""

from sma_sim.evidence.state_estimation.estimate import Estimate
from sma_sim.evidence.state_estimation.observer import Observer

__all__ = ['Estimate', 'Observer']
