"""Entry point of the guard: `ros2 run sma_sim sma_guard`, or `sma_guard` in a virtual environment."""

import sys

from sma_sim.ros.entry import Program

PROGRAM = Program(
    'sma_guard',
    'Stands between a controller and a robot, and takes away heating that would spoil a wire.',
    'guard.T_max:=380.0',
    ('environment.T_E',),
    'sma_sim.ros.guard_node:WireGuard',
)
main = PROGRAM.main

if __name__ == '__main__':
    sys.exit(main())
