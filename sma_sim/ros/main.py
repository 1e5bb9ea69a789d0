"""Entry point of the node: `ros2 run sma_sim sma_module_sim`, or `sma_module_sim` in a virtual environment."""

import sys

from sma_sim.ros.entry import Program

PROGRAM = Program(
    'sma_module_sim',
    'Simulates a module: takes commands [W] on J_eq, publishes joint_states, wire_states and others.',
    'node.record:=run1',
    ('environment.T_E', 'node.J_max', 'node.command_timeout', 'node.real_time_factor', 'node.steps_per_call'),
    'sma_sim.ros.node:ModuleSimulation',
)
main = PROGRAM.main

if __name__ == '__main__':
    sys.exit(main())
