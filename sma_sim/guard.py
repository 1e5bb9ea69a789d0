"""What keeps wires within their limits, whatever a controller asks for: `Guard`, its `Decision`, and its `Counters`."""

from sma_sim.evidence.state_estimation.guard import Counters, Decision, Guard

__all__ = ['Counters', 'Decision', 'Guard']
