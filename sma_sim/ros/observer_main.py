"""Entry point of the observer: `ros2 run sma_sim sma_observer`, or `sma_observer` in a virtual environment."""

import sys

from sma_sim.ros.entry import Program

PROGRAM = Program(
    'sma_observer',
    'Estimates temperatures, fractions and stresses of the wires of a running robot.',
    'check.noise_alpha:=1.0e-3',
    ('environment.T_E',),
    'sma_sim.ros.observer_node:WireObserver',
)
main = PROGRAM.main

if __name__ == '__main__':
    sys.exit(main())
