"""Entry point of the live check: `ros2 run sma_sim sma_model_check`, or `sma_model_check` in a virtual environment."""

import sys

from sma_sim.ros.entry import Program

PROGRAM = Program(
    'sma_model_check',
    'Runs the model beside a robot and warns when the measurement departs from it.',
    'check.noise_alpha:=1.0e-3',
    ('environment.T_E',),
    'sma_sim.ros.check_node:ModelCheck',
)
main = PROGRAM.main

if __name__ == '__main__':
    sys.exit(main())
