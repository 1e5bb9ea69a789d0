"""The example controller: its law, and the loop that it closes over real DDS."""

import importlib.util
import math
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

ros_client = pytest.importorskip('ros_client', reason='rclpy is not installed', exc_type=ImportError)
import rclpy  # noqa: E402
from rcl_interfaces.srv import GetParameters, SetParameters, SetParametersAtomically  # noqa: E402
from rclpy.parameter import Parameter  # noqa: E402
from sensor_msgs.msg import JointState  # noqa: E402
from std_msgs.msg import Float64  # noqa: E402
from std_srvs.srv import SetBool, Trigger  # noqa: E402

from sma_sim.cli.main import main  # noqa: E402
from sma_sim.report.style import save  # noqa: E402

ROOT = Path(__file__).resolve().parents[2]
EXAMPLE = ROOT / 'examples' / 'controller.py'


def example(name):
    """An example as a module."""
    spec = importlib.util.spec_from_file_location(f'example_{name}', ROOT / 'examples' / f'{name}.py')
    loaded = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(loaded)
    return loaded


controller, tracking = example('controller'), example('tracking')

TOPICS = ((JointState, 'joint_states'), (Float64, 'J_eq'), (Float64, 'J_eq_applied'))
ALPHA = 2
ERRORS = st.lists(st.floats(-0.5, 0.5), min_size=1, max_size=50)


@given(ERRORS, st.floats(0.0, 2000.0), st.floats(0.0, 2000.0))
def test_law_stays_within_its_limit_and_never_winds_up(errors, kp, ki):
    law = controller.PI(kp, ki, 20.0)
    for error in errors:
        assert abs(law(error, 0.02)) <= 20.0
        assert abs(law.integral) <= 20.0 + kp * 0.5 + ki * 0.5 * 0.02


def test_law_leaves_its_limit_at_once():
    law = controller.PI(10.0, 800.0, 20.0)
    assert [law(0.5, 0.02) for _ in range(1000)][-1] == 20.0
    assert law(-0.1, 0.02) < 20.0 - 1.0
    assert controller.PI(10.0, 5.0, 20.0)(0.1, 0.2) == pytest.approx(10.0 * 0.1 + 5.0 * 0.1 * 0.2)


class Loop(ros_client.Simulation):
    """A module and the controller; `words` are the controller's."""

    def __init__(self, *words, speed=4.0, node=()):
        super().__init__('-p', f'node.real_time_factor:={speed}', *node, topics=TOPICS)
        self.control = subprocess.Popen(
            [sys.executable, str(EXAMPLE), '--ros-args', *words],
            env=self.environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        self.targets = self.node.create_publisher(Float64, 'alpha_target', 10)
        self.until(lambda: self.seen['J_eq'], ros_client.FIRST_MESSAGE)
        self.until(lambda: self.targets.get_subscription_count() == 1)

    @property
    def alphas(self):
        """Angles seen so far [rad]."""
        return [message.position[ALPHA] for message in self.seen['joint_states']]

    def stays_at(self, target, tolerance, samples=100):
        """Whether the angle has been near the target for a while."""
        last = self.alphas[-samples:]
        return len(last) == samples and max(abs(alpha - target) for alpha in last) < tolerance

    def last(self, topic):
        """The last number on a topic, NaN before there was one."""
        return self.seen[topic][-1].data if self.seen[topic] else math.nan

    def __exit__(self, *words):
        if self.control.poll() is None:
            self.control.kill()
        self.control.wait()
        self.control.stdout.close()
        super().__exit__(*words)


def target_of(loop):
    request = GetParameters.Request(names=['alpha_target'])
    return loop.ask(GetParameters, 'alpha_controller/get_parameters', request).values[0].double_value


def test_reaches_its_target_and_another_one():
    with Loop('-p', 'alpha_target:=0.05') as loop:
        loop.until(lambda: loop.stays_at(0.05, 1e-3), 60.0)
        loop.targets.publish(Float64(data=-0.06))
        loop.until(lambda: loop.stays_at(-0.06, 1e-3), 60.0)
        assert target_of(loop) == -0.06  # the parameter shows what is in force
        mixed = [Parameter('alpha_target', value=0.05).to_parameter_msg(), Parameter('J_max', value=5.0).to_parameter_msg()]
        request = SetParametersAtomically.Request(parameters=mixed)
        assert not loop.ask(SetParametersAtomically, 'alpha_controller/set_parameters_atomically', request).result.successful
        assert target_of(loop) == -0.06
        loop.until(lambda: loop.stays_at(-0.06, 1e-3), 60.0)
        gain = [Parameter('kp', value=500.0).to_parameter_msg(), Parameter('J_max', value=5.0).to_parameter_msg()]
        answers = loop.ask(SetParameters, 'alpha_controller/set_parameters', SetParameters.Request(parameters=gain)).results
        assert [answer.successful for answer in answers] == [True, False]
        loop.targets.publish(Float64(data=math.nan))
        loop.targets.publish(Float64(data=0.02))
        loop.until(lambda: loop.stays_at(0.02, 1e-3), 60.0)
        loop.control.send_signal(signal.SIGINT)
        log, _ = loop.control.communicate(timeout=60)
        assert loop.control.returncode == 0 and 'alpha_target = nan rad refused' in log and 'Traceback' not in log


def test_saturates_and_leaves_the_limit_without_delay():
    with Loop('-p', 'alpha_target:=0.5', '-p', 'kp:=100.0', '-p', 'J_max:=15.0') as loop:
        loop.until(lambda: len(loop.seen['joint_states']) > 1000, 60.0)  # 10 s of simulated time
        assert loop.last('J_eq') == 15.0 and max(message.data for message in loop.seen['J_eq']) == 15.0
        count = len(loop.seen['joint_states'])
        loop.targets.publish(Float64(data=0.0))
        loop.until(lambda: loop.last('J_eq') < 0.0)
        assert len(loop.seen['joint_states']) - count < 400  # at most 4 s; wound up, the integral needs a minute and more


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_last_word_is_heating_off(number):
    with Loop('-p', 'alpha_target:=0.05') as loop:
        loop.until(lambda: loop.last('J_eq_applied') > 1.0)
        loop.control.send_signal(number)
        loop.until(lambda: loop.last('J_eq') == 0.0 and loop.last('J_eq_applied') == 0.0)
        assert loop.control.wait(20) == 0


def test_ctrl_c_that_is_repeated_kills_nothing_that_is_ending():
    """As `ros2 launch` sends it to its processes, after the terminal."""
    with Loop('-p', 'alpha_target:=0.05') as loop:
        loop.until(lambda: loop.last('J_eq_applied') > 1.0)
        for process in (loop.control, loop.process):
            while process.poll() is None:
                process.send_signal(signal.SIGINT)
                time.sleep(0.001)
        codes = loop.control.returncode, loop.process.returncode
        assert codes == (0, 0), loop.control.stdout.read() + loop.process.stdout.read()


def test_heating_off_after_the_controller_was_killed():
    """Of a module whose joints have a prefix."""
    node = ('-p', 'node.command_timeout:=1.0', '-p', 'node.joint_prefix:=arm_')
    with Loop('-p', 'alpha_target:=0.05', '-p', 'joint:=arm_alpha', node=node) as loop:
        loop.until(lambda: loop.last('J_eq_applied') > 1.0)
        loop.control.kill()
        loop.until(lambda: loop.last('J_eq_applied') == 0.0)
        assert loop.last('J_eq') > 1.0


def test_heating_off_while_joint_states_stop_and_on_again():
    with Loop('-p', 'alpha_target:=0.05') as loop:
        loop.until(lambda: loop.last('J_eq') > 1.0)
        loop.ask(SetBool, 'sma_module_sim/pause', SetBool.Request(data=True))
        loop.until(lambda: loop.last('J_eq') == 0.0)
        loop.ask(Trigger, 'sma_module_sim/reset', Trigger.Request())
        loop.ask(SetBool, 'sma_module_sim/pause', SetBool.Request(data=False))
        loop.until(lambda: loop.stays_at(0.05, 1e-3), 60.0)


def test_node_runs_a_file_of_init_as_it_is(tmp_path):
    """What `sma-sim init` wrote is a parameter file of the node."""
    robot = tmp_path / 'robot.yaml'
    assert main(['init', '--out', str(robot), '--beam-length', '120', '--wire-length', '115', '--effect', 'gravity']) == 0
    words = ('--params-file', str(robot))
    with ros_client.Simulation(*words, topics=((JointState, 'joint_states'),)) as one:
        one.until(lambda: one.seen['joint_states'], ros_client.FIRST_MESSAGE)
        assert one.seen['joint_states'][0].position[1] < -1e-5  # gravity across the beam
        assert one.stop()[0] == 0


def test_tracking_draws_and_measures_what_it_has_recorded(tmp_path):
    """Angles that come 0.2 s late, and 0.01 deg beside the target once they rest."""
    time = np.arange(0.0, tracking.END, 0.01)
    wanted = np.array([tracking.target(t) for t in time])
    begin = np.where(time < tracking.SINE, 0.0, tracking.SINE)
    alpha = np.array([tracking.target(t) for t in np.maximum(begin, time - 0.2)]) + np.radians(0.01)
    rows = np.column_stack([time, wanted, alpha, 10.0 * wanted, 300.0 + time, 300.0 - 0.0 * time])
    step, sine = tracking.errors_of(rows)
    assert step == pytest.approx(0.01, rel=1e-6)
    assert sine == pytest.approx(tracking.AMPLITUDE * 2.0 * np.pi * 0.2 / tracking.PERIOD / np.sqrt(2.0), rel=0.01)
    save(tracking.draw(rows), tmp_path / 'tracking.png')
    assert (tmp_path / 'tracking.png').stat().st_size > 20_000


@pytest.mark.slow
def test_tracking_runs_against_the_node(tmp_path):
    words = [sys.executable, str(ROOT / 'examples' / 'tracking.py'), 'tracking.png', '--speed', '8']
    with ros_client.Simulation(topics=()) as other:  # a module of somebody else does not disturb it
        done = subprocess.run(words, cwd=tmp_path, env=other.environment, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    numbers = [float(word) for word in done.stdout.split() if word[0].isdigit() and word[-1].isdigit()]
    assert len(numbers) == 2 and numbers[0] < 0.5 and numbers[1] < 3.0  # deg; 0.007 and 0.20 on a quiet machine
    assert (tmp_path / 'tracking.png').stat().st_size > 20_000


def test_the_example_takes_a_stamp_that_stands_still_for_no_sample(monkeypatch):
    """Its heating goes off once, and stays off until a stamp moves on."""
    now, sent = [1000.0], []
    monkeypatch.setattr(controller.time, 'monotonic', lambda: now[0])
    rclpy.init(args=[], domain_id=ros_client.any_domain())
    try:
        node = controller.AlphaController()
        monkeypatch.setattr(node, 'command', SimpleNamespace(publish=lambda message: sent.append(message.data)))

        def hear(*stamps):
            for stamp in stamps:
                now[0] += 0.01
                message = JointState(name=['alpha'], position=[0.1])
                message.header.stamp.sec, message.header.stamp.nanosec = int(stamp), round(1e9 * (stamp % 1.0))
                node.on_joint_state(message)
                node.on_watch()

        hear(*(7.0 + 0.01 * k for k in range(100)))
        assert sent and max(sent) < 0.0
        count = len(sent)
        hear(*[7.99] * 300)
        assert sent[count:] == [0.0]
        hear(8.0, 8.03, 8.06)
        assert len(sent) == count + 3 and max(sent[-2:]) < 0.0
        node.destroy_node()
    finally:
        rclpy.shutdown()
