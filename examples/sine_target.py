"""A target that moves: a sine on `alpha_target`, for a controller to follow.

    python examples/sine_target.py --ros-args -p amplitude:=0.05 -p period:=20.0

Parameters: amplitude [rad], period [s] of the node's clock, rate [Hz].
"""

import math
import sys

from rclpy.node import Node
from std_msgs.msg import Float64

from sma_sim.ros.last_command import CommandSession


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
    """Run until a signal stops it; the last target is zero."""
    with CommandSession() as session:
        node = SineTarget()
        session.end_with(node.target, Float64(data=0.0))
        session.spin(node)
    return 0


if __name__ == '__main__':
    sys.exit(main())
