"""Entry point of the controllers with a model: `ros2 run sma_sim sma_controller`, or `sma_controller`."""

import sys

from sma_sim.ros.entry import Program

PROGRAM = Program(
    'sma_controller',
    'Moves a robot along a target by a model of it: predictive control, or feedforward with a PI controller.',
    'control.law:=feedforward',
    ('environment.T_E',),
    'sma_sim.ros.controller_node:ModelController',
)
main = PROGRAM.main

if __name__ == '__main__':
    sys.exit(main())
