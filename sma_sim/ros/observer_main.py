"""Entry point of the observer: `ros2 run sma_sim sma_observer`, or `sma_observer` in a virtual environment."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from sma_sim.ros.entry import Program, Runner, run_node

if TYPE_CHECKING:
    from sma_sim.model.config import Config

PROGRAM = Program(
    'sma_observer',
    'Estimates temperatures, fractions and stresses of the wires of a running robot.',
    'check.noise_alpha:=1.0e-3',
    ('environment.T_E',),
)


def main(arguments: list[str] | None = None) -> int:
    """Observe a robot; the exit code of `entry.run_node`."""
    return run_node(PROGRAM, observer, arguments)


def observer(node: Any, config: Config, settings: Mapping[str, float], use_sim_time: bool) -> Runner:
    """The observer; rclpy is not imported before it is known to be there."""
    from sma_sim.ros.observer_node import WireObserver

    return WireObserver(node, config, use_sim_time)


if __name__ == '__main__':
    sys.exit(main())
