"""Entry point of the node: `ros2 run sma_sim sma_module_sim`, or `sma_module_sim` in a virtual environment."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from sma_sim.ros.entry import Program, Runner, run_node

if TYPE_CHECKING:
    from sma_sim.model.config import Config

PROGRAM = Program(
    'sma_module_sim',
    'Simulates a module: takes commands [W] on J_eq, publishes joint_states, wire_states and others.',
    'node.record:=run1',
    ('environment.T_E', 'node.J_max', 'node.command_timeout', 'node.real_time_factor', 'node.steps_per_call'),
)


def main(arguments: list[str] | None = None) -> int:
    """Run the simulated module; the exit code of `entry.run_node`."""
    return run_node(PROGRAM, simulation, arguments)


def simulation(node: Any, config: Config, settings: Mapping[str, float], use_sim_time: bool) -> Runner:
    """The simulated module; rclpy is not imported before it is known to be there."""
    from sma_sim.ros.node import ModuleSimulation

    return ModuleSimulation(node, config, settings, use_sim_time)


if __name__ == '__main__':
    sys.exit(main())
