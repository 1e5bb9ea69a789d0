"""Follow trajectories of the angle: JointTrajectory messages and, with control_msgs, the FollowJointTrajectory action.

    python examples/trajectory_follower.py --ros-args -p kp:=1000.0

Names, meanings and answers are those of ros2_control's joint_trajectory_controller: the topic `~/joint_trajectory` and the
action `~/follow_joint_trajectory`. Positions alone are joined by lines, with velocities by cubic and with accelerations by
quintic polynomials. A new trajectory replaces the one that is followed and starts from where that one is; one without points
holds the present target, and so do a canceled goal and one that has failed. A new `alpha_target` ends the trajectory.
The parameters are those of controller.py, whose law is used, and, for goals that give none, goal_tolerance [rad] and
goal_time_tolerance [s] (0: without a limit).
"""

import math
import sys

from controller import PARAMETERS, AlphaController, run
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.parameter import Parameter
from rclpy.task import Future
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from sma_sim.ros.joint_path import INVALID_GOAL, JointPath, RefusedError, check, seconds

try:
    from control_msgs.action import FollowJointTrajectory
except ImportError:  # no wheel has it; apt install ros-$ROS_DISTRO-control-msgs
    FollowJointTrajectory = None

DEFAULTS = {'goal_tolerance': 0.01, 'goal_time_tolerance': 0.0}


class Goal:
    """A goal of the action that is being followed."""

    def __init__(self, handle, node):
        """The goal's handle; what it leaves open is as the node's parameters say."""
        self.handle, self.decided = handle, Future(executor=node.executor)
        request = handle.request
        self.path_tolerance = tolerance_of(request.path_tolerance, math.inf)
        self.goal_tolerance = tolerance_of(request.goal_tolerance, node.get_parameter('goal_tolerance').value or math.inf)
        default = node.get_parameter('goal_time_tolerance').value or math.inf
        asked = seconds(request.goal_time_tolerance)
        self.patience = math.inf if asked < 0.0 else asked or default

    def decide(self, state, code, words):
        """Say how it ends: 'succeed', 'abort' or 'canceled', the name of the error code, why."""
        if not self.decided.done():
            self.decided.set_result((state, code, words))

    def judge(self, now, path, error):
        """Decide, where time [s] and error [rad] allow it."""
        if self.handle.is_cancel_requested:
            self.decide('canceled', 'SUCCESSFUL', 'canceled')
        elif now < path.end and abs(error) > self.path_tolerance:
            self.decide('abort', 'PATH_TOLERANCE_VIOLATED', f'error {error:.4g} rad, allowed {self.path_tolerance:g}')
        elif now >= path.end and abs(error) <= self.goal_tolerance:
            self.decide('succeed', 'SUCCESSFUL', f'error {error:.4g} rad')
        elif now > path.end + self.patience:
            words = f'error {error:.4g} rad, allowed {self.goal_tolerance:g}, {self.patience:g} s after the end'
            self.decide('abort', 'GOAL_TOLERANCE_VIOLATED', words)


def tolerance_of(tolerances, default):
    """The tolerance of the angle in a goal's list [rad]: 0 there means the default, a negative one none."""
    value = tolerances[0].position if tolerances else 0.0
    return default if value == 0.0 else math.inf if value < 0.0 else value


class TrajectoryFollower(AlphaController):
    """The controller of the angle, with a target that moves along a trajectory."""

    def __init__(self):
        """Connect to the topic and, where control_msgs is installed, to the action."""
        super().__init__('alpha_trajectory_controller')
        self.path, self.goal = None, None
        for name, value in DEFAULTS.items():
            self.declare_parameter(name, value)
        self.desired = self.create_publisher(JointTrajectoryPoint, '~/desired', 10)
        self.create_subscription(JointTrajectory, '~/joint_trajectory', self.on_trajectory, 10)
        if FollowJointTrajectory is None:
            self.get_logger().info('no action follow_joint_trajectory: the package control_msgs is not installed')
            return
        self.server = ActionServer(
            self,
            FollowJointTrajectory,
            '~/follow_joint_trajectory',
            self.follow,
            goal_callback=self.on_goal,
            cancel_callback=lambda _: CancelResponse.ACCEPT,
        )

    def on_trajectory(self, message):
        """Follow what the topic brings, instead of a goal."""
        try:
            self.start(message, 'replaced by a trajectory on the topic')
        except RefusedError as error:
            self.warn(f'joint_trajectory refused: {error.args[1]}')

    def on_goal(self, request):
        """Accept a goal that can be followed."""
        try:
            self.path_of(request.trajectory)
        except RefusedError as error:
            self.warn(f'goal refused: {": ".join(error.args)}')
            return GoalResponse.REJECT
        return GoalResponse.ACCEPT

    async def follow(self, handle):
        """Follow a goal until it is decided; the action's result."""
        goal = Goal(handle, self)
        try:
            self.start(handle.request.trajectory, 'replaced by another goal', goal)
            state, code, words = await goal.decided
        except RefusedError as error:  # it has ended between the two
            state, code, words = 'abort', *error.args
        getattr(handle, state)()
        self.get_logger().info(f'goal: {code}, {words}')
        return FollowJointTrajectory.Result(error_code=getattr(FollowJointTrajectory.Result, code), error_string=words)

    def path_of(self, trajectory):
        """The path of a trajectory that starts now; None for one without points. Raises RefusedError."""
        _, low, high, _, _ = PARAMETERS['alpha_target']
        check(trajectory, self.joint, low, high)
        if self.last_stamp is None:
            raise RefusedError(INVALID_GOAL, 'no joint_states yet')
        return JointPath(trajectory, self.last_stamp, self.motion()) if trajectory.points else None

    def motion(self):
        """Where the desired motion is: angle [rad], rate [rad/s], acceleration [rad/s^2]."""
        return [self.target, 0.0, 0.0] if self.path is None else self.path.at(self.last_stamp)

    def start(self, trajectory, words, goal=None):
        """Follow a trajectory instead of what was followed, whose goal ends with `words`. Raises RefusedError."""
        path = self.path_of(trajectory)
        self.hold(words)
        self.path, self.goal = path, goal
        if path is None and goal is not None:
            goal.decide('succeed', 'SUCCESSFUL', 'no points: holds its target')

    def hold(self, words):
        """End the trajectory where it is; an undecided goal is aborted with `words`."""
        target = self.motion()[0]
        self.path, goal, self.goal = None, self.goal, None
        if goal is not None:
            goal.decide('abort', 'INVALID_GOAL', words)
        if target != self.target:
            self.set_parameters([Parameter('alpha_target', value=target)])

    def on_parameters(self, parameters):
        """A new target ends the trajectory."""
        if self.path is not None and any(parameter.name == 'alpha_target' for parameter in parameters):
            self.path, goal, self.goal = None, self.goal, None
            if goal is not None:
                goal.decide('abort', 'INVALID_GOAL', 'replaced by a new alpha_target')
        super().on_parameters(parameters)

    def interrupted(self):
        """What was followed has no time any more: joint states stopped, or the simulation was reset."""
        self.hold('joint_states stopped or restarted')
        super().interrupted()

    def target_at(self, now, alpha):
        """The desired angle [rad] at a time [s]; decides the goal."""
        if self.path is None:
            return self.target
        wanted = self.path.at(now)
        self.desired.publish(point(wanted))
        if self.goal is not None:
            self.report(now, wanted, alpha)
            self.goal.judge(now, self.path, wanted[0] - alpha)
        if now >= self.path.end and self.goal is None or self.goal is not None and self.goal.decided.done():
            self.last_stamp = now
            self.hold('')
        return wanted[0]

    def report(self, now, wanted, alpha):
        """Send the action's feedback."""
        feedback = FollowJointTrajectory.Feedback(joint_names=[self.joint], desired=point(wanted))
        feedback.header.stamp = self.stamp
        feedback.actual, feedback.error = point([alpha]), point([wanted[0] - alpha])
        self.goal.handle.publish_feedback(feedback)


def point(values):
    """An angle [rad] and, where given, its rate and acceleration as a message."""
    names = ('positions', 'velocities', 'accelerations')
    return JointTrajectoryPoint(**{name: [value] for name, value in zip(names, values, strict=False)})


if __name__ == '__main__':
    sys.exit(run(TrajectoryFollower))
