"""Entry point of the controllers with a model: `ros2 run sma_sim sma_controller`, or `sma_controller`."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from sma_sim.ros.entry import Program, Runner, run_node

if TYPE_CHECKING:
    from sma_sim.model.config import Config

PROGRAM = Program(
    'sma_controller',
    'Moves a robot along a target by a model of it: predictive control, or feedforward with a PI controller.',
    'control.law:=feedforward',
    ('environment.T_E',),
)


def main(arguments: list[str] | None = None) -> int:
    """Control a robot; the exit code of `entry.run_node`."""
    return run_node(PROGRAM, controller, arguments)


def controller(node: Any, config: Config, settings: Mapping[str, float], use_sim_time: bool) -> Runner:
    """The controller; rclpy is not imported before it is known to be there."""
    from sma_sim.ros.controller_node import ModelController

    return ModelController(node, config, use_sim_time)


if __name__ == '__main__':
    sys.exit(main())
