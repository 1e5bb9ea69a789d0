"""Command a step to a running `sma_module_sim`, write what comes back: `python examples/step_response.py [step.csv]`.

A plain rclpy node: start from here for a controller of your own. Then: sma-sim plot step.csv
"""

import csv
import math
import sys

from rclpy.node import Node
from rclpy.utilities import remove_ros_args
from sensor_msgs.msg import JointState, Temperature
from std_msgs.msg import Float64

from sma_sim.ros.last_command import CommandSession

STEP, BEGIN, END, STOP = 12.0, 1.0, 8.0, 14.0  # [W], [s]
COLUMNS = ('time_s', 'J_eq_W', 'U_x_m', 'U_y_m', 'alpha_rad', 'T_1_K', 'T_2_K')


class StepResponse(Node):
    """Sends J_eq and keeps a row per joint state."""

    def __init__(self):
        """Connect to the topics of the module."""
        super().__init__('step_response')
        self.rows, self.start, self.done, self.temperatures = [], None, False, [float('nan')] * 2
        self.command = self.create_publisher(Float64, 'J_eq', 10)
        self.create_subscription(JointState, 'joint_states', self.on_joint_state, 100)
        for k, topic in enumerate(('wire_1/temperature', 'wire_2/temperature')):
            self.create_subscription(Temperature, topic, lambda message, k=k: self.on_temperature(k, message), 100)

    def on_temperature(self, wire, message):
        """Keep the latest temperature of a wire, in kelvin."""
        self.temperatures[wire] = message.temperature + 273.15

    def on_joint_state(self, message):
        """Answer every state with the command of its time."""
        now = message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec
        self.start = self.start or now
        time = now - self.start
        J_eq = STEP if BEGIN <= time < END else 0.0
        self.command.publish(Float64(data=J_eq))
        if not any(math.isnan(temperature) for temperature in self.temperatures):
            self.rows.append([f'{time:.4f}', J_eq, *message.position, *self.temperatures])
        self.done = time > STOP


with CommandSession() as session:  # whatever stops it, its last command is zero
    node = StepResponse()
    session.end_with(node.command, Float64(data=0.0))
    print('waiting for joint_states of sma_module_sim ...')
    session.spin(node, until=lambda: node.done)
if not node.rows:
    sys.exit('stopped before a joint state came: nothing is written')
words = remove_ros_args(sys.argv)
name = words[1] if len(words) > 1 else 'step.csv'
with open(name, 'w', newline='') as file:
    csv.writer(file).writerows([COLUMNS, *node.rows])
print(f'{name}: {len(node.rows)} rows, largest angle {max(row[4] for row in node.rows):.4f} rad')
