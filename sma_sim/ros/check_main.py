"""Entry point of the live check: `ros2 run sma_sim sma_model_check`, or `sma_model_check` in a virtual environment."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from sma_sim.ros.entry import Program, Runner, run_node

if TYPE_CHECKING:
    from sma_sim.model.config import Config

PROGRAM = Program(
    'sma_model_check',
    'Runs the model beside a robot and warns when the measurement departs from it.',
    'check.noise_alpha:=1.0e-3',
    ('environment.T_E',),
)


def main(arguments: list[str] | None = None) -> int:
    """Run the model beside a robot; the exit code of `entry.run_node`."""
    return run_node(PROGRAM, model_check, arguments)


def model_check(node: Any, config: Config, settings: Mapping[str, float], use_sim_time: bool) -> Runner:
    """The model beside the robot; rclpy is not imported before it is known to be there."""
    from sma_sim.ros.check_node import ModelCheck

    return ModelCheck(node, config, settings, use_sim_time)


if __name__ == '__main__':
    sys.exit(main())
