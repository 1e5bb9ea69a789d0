"""Closed loop on the angle: a PI controller from `joint_states` to `J_eq`, as a plain rclpy node to start yours from.

    python examples/controller.py --ros-args -p alpha_target:=0.05

Parameters: kp [W/rad], ki [W/(rad s)], alpha_target [rad], J_max [W], rate [Hz], state_timeout [s]; the first three may be
changed while it runs. `joint` is the name of the angle in joint_states: alpha, after the module's node.joint_prefix. A
std_msgs/Float64 on `alpha_target` [rad] sets the target too, and so does a sensor_msgs/JointState on `joint_commands`, which
ros2_control's topic-based hardware sends. Time is that of the stamps of `joint_states`, so the loop is the same at any
real-time factor. The heating goes off when joint_states stop or their stamps stand still, and at the end.
"""

import math
import sys
import time

import rclpy
from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor
from rclpy.node import Node
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64

from sma_sim.evidence.control.pi import PI
from sma_sim.ros.last_command import CommandSession

JOINT = 'alpha'
PARAMETERS = {  # name: default, smallest, largest, unit, whether it can be changed while running
    'kp': (1000.0, 0.0, 1e6, 'W/rad', True),
    'ki': (800.0, 0.0, 1e6, 'W/(rad s)', True),
    'alpha_target': (0.0, -math.pi, math.pi, 'rad', True),
    'J_max': (20.0, 0.0, 1e6, 'W', False),
    'rate': (50.0, 0.1, 1e4, 'Hz', False),
    'state_timeout': (0.5, 0.01, 1e3, 's', False),
}
WATCH_PERIOD, WARNING_PERIOD = 0.1, 5.0  # [s]


class AlphaController(Node):
    """Answers joint states with commands."""

    def __init__(self, name='alpha_controller'):
        """Declare the parameters, connect to the topics."""
        super().__init__(name)
        kp, ki, self.target, limit, rate, self.timeout = (self.declare(name) for name in PARAMETERS)
        words = ParameterDescriptor(description='name of the angle in joint_states', read_only=True)
        self.joint = self.declare_parameter('joint', JOINT, words).value
        self.law, self.period = PI(kp, ki, limit), 1.0 / rate
        self.last_stamp, self.last_arrival, self.stamp = None, None, None
        self.newest = None  # time [s] of the stamp of the last sample
        self.command = self.create_publisher(Float64, 'J_eq', 10)
        self.create_subscription(JointState, 'joint_states', self.on_joint_state, 10)
        self.create_subscription(Float64, 'alpha_target', lambda message: self.on_target(message.data), 10)
        self.create_subscription(JointState, 'joint_commands', self.on_joint_command, 10)
        self.add_post_set_parameters_callback(self.on_parameters)  # after all of a request were accepted
        self.watch = self.create_timer(WATCH_PERIOD, self.on_watch, clock=rclpy.clock.Clock())
        self.get_logger().info('waiting for joint_states')

    def declare(self, name):
        """Declare one parameter with its range; its value."""
        default, low, high, unit, live = PARAMETERS[name]
        bounds = FloatingPointRange(from_value=low, to_value=high)
        words = ParameterDescriptor(description=f'[{unit}]', read_only=not live, floating_point_range=[bounds])
        return self.declare_parameter(name, default, words).value

    def on_parameters(self, parameters):
        """Take new gains or a new target."""
        for parameter in parameters:
            if parameter.name == 'alpha_target':
                self.target = parameter.value
            elif parameter.name in ('kp', 'ki'):
                setattr(self.law, parameter.name, parameter.value)

    def on_target(self, angle):
        """Take a new target [rad], if it is an angle."""
        _, low, high, _, _ = PARAMETERS['alpha_target']
        if low <= angle <= high:
            self.set_parameters([Parameter('alpha_target', value=angle)])  # on_parameters takes it from there
        else:
            self.warn(f'alpha_target = {angle} rad refused: expected {low:.4g} to {high:.4g}')

    def on_joint_command(self, message):
        """Take the position that is commanded; one that is not finite is none yet."""
        angle = self.position_in(message, 'joint_commands')
        if angle is not None and angle != self.target:
            self.on_target(angle)

    def position_in(self, message, topic):
        """The finite position of the joint in a JointState; else None, with a warning."""
        if self.joint not in message.name or len(message.position) != len(message.name):
            self.warn(f'{topic} without a position of {self.joint} (parameter joint): {list(message.name)}')
            return None
        angle = message.position[list(message.name).index(self.joint)]
        if not math.isfinite(angle):
            self.warn(f'{self.joint} = {angle} in {topic}: not used')
            return None
        return angle

    def target_at(self, now, alpha):
        """The target [rad] at a time of the stamps [s], the measured angle [rad] being known."""
        return self.target

    def interrupted(self):
        """The joint states are the first ones, or the simulation was reset, or they were away."""
        self.law.integral = 0.0

    def on_joint_state(self, message):
        """Answer with a command, `rate` times per second."""
        alpha = self.position_in(message, 'joint_states')
        if alpha is None:
            return
        self.stamp = message.header.stamp
        now = self.stamp.sec + 1e-9 * self.stamp.nanosec
        if now == self.newest:  # it says nothing of how the robot is now
            self.warn('joint_states whose stamp repeats: they are no new samples; is header.stamp filled in?')
            return
        self.newest, self.last_arrival = now, time.monotonic()
        if self.last_stamp is None or not 0.0 <= now - self.last_stamp < self.timeout + self.period:
            self.interrupted()
            self.last_stamp = now
        elif now - self.last_stamp > self.period * (1.0 - 1e-6):
            error = self.target_at(now, alpha) - alpha
            self.command.publish(Float64(data=self.law(error, now - self.last_stamp)))
            self.last_stamp = now

    def on_watch(self):
        """Heating off once joint states have stopped."""
        if self.last_arrival is not None and time.monotonic() - self.last_arrival > self.timeout:
            self.warn(f'no new {self.joint} in joint_states for {self.timeout:g} s: heating off until they come back')
            self.interrupted()
            self.last_stamp, self.last_arrival = None, None
            self.heating_off()

    def heating_off(self):
        """Command zero."""
        self.command.publish(Float64(data=0.0))

    def warn(self, words):
        """Log a warning, not too often."""
        self.get_logger().warning(words, throttle_duration_sec=WARNING_PERIOD)


def run(kind):
    """Run a controller of a kind until a signal stops it; whatever does, the last message is a command of zero."""
    with CommandSession() as session:
        node = kind()
        session.end_with(node.command, Float64(data=0.0))
        session.spin(node)
    print('stopped: heating off', file=sys.stderr)
    return 0


if __name__ == '__main__':
    sys.exit(run(AlphaController))
