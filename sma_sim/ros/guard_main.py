"""Entry point of the guard: `ros2 run sma_sim sma_guard`, or `sma_guard` in a virtual environment."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from sma_sim.ros.entry import Program, Runner, run_node

if TYPE_CHECKING:
    from sma_sim.model.config import Config

PROGRAM = Program(
    'sma_guard',
    'Stands between a controller and a robot, and takes away heating that would spoil a wire.',
    'guard.T_max:=380.0',
    ('environment.T_E',),
)


def main(arguments: list[str] | None = None) -> int:
    """Guard a robot; the exit code of `entry.run_node`."""
    return run_node(PROGRAM, guard, arguments)


def guard(node: Any, config: Config, settings: Mapping[str, float], use_sim_time: bool) -> Runner:
    """The guard; rclpy is not imported before it is known to be there."""
    from sma_sim.ros.guard_node import WireGuard

    return WireGuard(node, config, use_sim_time)


if __name__ == '__main__':
    sys.exit(main())
