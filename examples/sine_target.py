"""A target that moves: a sine on `alpha_target`, for a controller to follow.

    python examples/sine_target.py --ros-args -p amplitude:=0.05 -p period:=20.0

Parameters: amplitude [rad], period [s] of the node's clock, rate [Hz].
"""

import atexit
import math
import signal
import sys

import rclpy
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import Float64


class SineTarget(Node):
    """Publishes the target."""

    def __init__(self):
        """Declare the parameters, start the timer."""
        super().__init__('sine_target')
        self.amplitude = self.declare_parameter('amplitude', 0.05).value
        self.period = self.declare_parameter('period', 20.0).value
        self.target = self.create_publisher(Float64, 'alpha_target', 10)
        self.start = None
        self.create_timer(1.0 / self.declare_parameter('rate', 20.0).value, self.on_timer)

    def on_timer(self):
        """Publish the target of this instant."""
        now = 1e-9 * self.get_clock().now().nanoseconds
        if self.start is None or now < self.start:  # the first time, or the simulation was reset
            self.start = now
        self.target.publish(Float64(data=self.amplitude * math.sin(2.0 * math.pi * (now - self.start) / self.period)))


def main():
    """Run until Ctrl-C or SIGTERM."""
    signals = []  # a list, since a signal may interrupt the one before it, and an Event would wait for its own lock
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *given: signals.append(given[0]))
        atexit.register(signal.signal, number, signal.SIG_IGN)  # launch repeats Ctrl-C
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = SineTarget()
    while not signals:
        rclpy.spin_once(node, timeout_sec=0.1)
    node.destroy_node()
    rclpy.shutdown(uninstall_handlers=False)  # uninstalling lets Ctrl-C kill for a moment
    return 0


if __name__ == '__main__':
    sys.exit(main())
