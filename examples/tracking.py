"""How well examples/controller.py tracks: runs it against the node, draws steps and a sine.

    python examples/tracking.py [tracking.png] [--speed 2]

Both run as processes of their own, in the namespace /tracking, and talk over ROS.
"""

import argparse
import math
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
from rclpy.node import Node
from sensor_msgs.msg import JointState, Temperature
from std_msgs.msg import Float64

from sma_sim.report.palette import BLUE, GREY, ORANGE, RED
from sma_sim.report.style import axes_of, save, sized_figure
from sma_sim.ros.last_command import CommandSession

NAMESPACE = '/tracking'
STEPS = ((0.0, 0.0), (2.0, 4.0), (17.0, -6.0), (37.0, 2.0))  # from [s], angle [deg]
SINE, AMPLITUDE, PERIOD, END = 52.0, 3.0, 20.0, 102.0  # from [s], [deg], [s], [s]
STEP_ENDS, SETTLED = (17.0, 37.0, 52.0), 0.5  # [s]
PATIENCE = 180.0  # [s]; the first start ever compiles


def target(t):
    """Wanted angle [rad] at t [s]."""
    if t >= SINE:
        return math.radians(AMPLITUDE * math.sin(2.0 * math.pi * (t - SINE) / PERIOD))
    return math.radians(next(angle for begin, angle in reversed(STEPS) if t >= begin))


class Tracking(Node):
    """Sends targets by the clock of the simulation and keeps what comes back."""

    def __init__(self):
        """Connect to both."""
        super().__init__('tracking', namespace=NAMESPACE)
        self.start, self.J_eq, self.temperatures, self.rows = None, 0.0, [math.nan] * 2, []
        self.targets = self.create_publisher(Float64, 'alpha_target', 10)
        self.commands = self.create_subscription(Float64, 'J_eq', self.on_command, 10)
        self.create_subscription(JointState, 'joint_states', self.on_joint_state, 100)
        for k, topic in enumerate(('wire_1/temperature', 'wire_2/temperature')):
            self.create_subscription(Temperature, topic, lambda message, k=k: self.on_temperature(k, message), 100)

    def on_command(self, message):
        """What the controller commands [W]."""
        self.J_eq = message.data

    def on_temperature(self, wire, message):
        """In deg C."""
        self.temperatures[wire] = message.temperature

    def on_joint_state(self, message):
        """A row, and the next target, once the controller is there."""
        if self.targets.get_subscription_count() == 0 or self.commands_publishers() == 0:
            return
        now = message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec
        self.start = now if self.start is None else self.start
        t = now - self.start
        self.targets.publish(Float64(data=target(t)))
        self.rows.append((t, target(t), message.position[2], self.J_eq, *self.temperatures))

    def commands_publishers(self):
        """How many send commands."""
        return self.count_publishers('J_eq')

    @property
    def time(self):
        """Simulated seconds since the first row."""
        return self.rows[-1][0] if self.rows else 0.0


def collect(speed):
    """The rows (k, 6): time [s], target [rad], angle [rad], J_eq [W], temperatures [deg C]."""
    ns = ['-r', f'__ns:={NAMESPACE}']
    controller = str(Path(__file__).with_name('controller.py'))
    commands = (
        [sys.executable, '-m', 'sma_sim.ros.main', '--ros-args', *ns, '-p', f'node.real_time_factor:={speed}'],
        [sys.executable, controller, '--ros-args', *ns],
    )
    end = time.monotonic() + PATIENCE + END / speed
    with CommandSession([]) as session:
        parts = [subprocess.Popen(command) for command in commands]
        try:
            node = Tracking()
            session.end_with(node.targets, Float64(data=0.0))
            session.spin(
                node, lambda: node.time >= END or time.monotonic() > end or any(part.poll() is not None for part in parts)
            )
        finally:
            for part in reversed(parts):  # the controller first: its last command is zero
                part.terminate()
                part.wait(20)
    if node.time < END:
        sys.exit(f'the run ended at {node.time:.1f} of {END:g} s')
    return np.array(node.rows)


def draw(rows):
    """Angle beside its target, their difference, command, temperatures."""
    time, wanted, alpha, J_eq, T_1, T_2 = rows.T
    wanted, alpha = np.degrees(wanted), np.degrees(alpha)
    figure = sized_figure(9.0, 8.0)
    angle, error, command, heat = axes_of(figure, 4, [3.0, 1.5, 1.5, 1.5])
    angle.plot(time, wanted, color=GREY, label='target')
    angle.plot(time, alpha, color=BLUE, label='alpha')
    error.plot(time, wanted - alpha, color=BLUE)
    error.set_ylim(-1.0, 1.0)
    command.plot(time, J_eq, color=ORANGE, drawstyle='steps-post')
    heat.plot(time, T_1, color=RED, label='wire 1')
    heat.plot(time, T_2, color=BLUE, label='wire 2')
    for axis, label in ((angle, 'angle [deg]'), (error, 'error [deg]'), (command, 'J_eq [W]'), (heat, 'wires [deg C]')):
        axis.set_ylabel(label)
    angle.legend(frameon=False, loc='lower right', ncols=2)
    heat.legend(frameon=False, loc='upper right', ncols=2)
    heat.set_xlabel('simulated time [s]')
    heat.set_xlim(0.0, END)
    return figure


def errors_of(rows):
    """The largest error [deg] in the last half second of a step, and its root mean square [deg] on the sine."""
    error = np.degrees(rows[:, 1] - rows[:, 2])
    at_the_end = [np.abs(error[(rows[:, 0] > end - SETTLED) & (rows[:, 0] < end)]).max() for end in STEP_ENDS]
    return max(at_the_end), np.sqrt((error[rows[:, 0] >= SINE] ** 2).mean())


def main():
    """Run, draw, say how large the errors are."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('picture', nargs='?', type=Path, default=Path('tracking.png'))
    parser.add_argument('--speed', type=float, default=2.0, help='simulated seconds per second')
    arguments = parser.parse_args()
    rows = collect(arguments.speed)
    save(draw(rows), arguments.picture)
    step, sine = errors_of(rows)
    print(
        f'{arguments.picture}: largest error in the last half second of a step {step:.3f} deg, '
        f'root mean square on the sine {sine:.2f} deg'
    )


if __name__ == '__main__':
    main()
