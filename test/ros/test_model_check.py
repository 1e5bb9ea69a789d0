"""The model beside a robot over real DDS: a simulated module of ours, and robots that misbehave."""

import json
import math
import subprocess
import sys
import time
from contextlib import contextmanager
from functools import cache

import numpy as np
import pytest

ros_client = pytest.importorskip('ros_client', reason='rclpy is not installed', exc_type=ImportError)
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus  # noqa: E402
from rclpy.qos import QoSProfile, ReliabilityPolicy  # noqa: E402
from sensor_msgs.msg import JointState, Temperature  # noqa: E402
from std_msgs.msg import Float32, Float64, Float64MultiArray, String  # noqa: E402
from std_srvs.srv import Trigger  # noqa: E402

from sma_sim import Config, Input, Model  # noqa: E402
from sma_sim.evidence.monitoring.live_diagnosis import CauseFinding, LiveFinding  # noqa: E402
from sma_sim.model.effects.ports import CHANNELS  # noqa: E402
from sma_sim.model.structures.module import STRUCTURE as MODULE  # noqa: E402
from sma_sim.model.structures.spatial import STRUCTURE as SPATIAL  # noqa: E402
from sma_sim.ros.cause_watch import CauseWatch  # noqa: E402
from sma_sim.solver.columns import sample_columns  # noqa: E402
from sma_sim.solver.fixed_rate import FixedRateRun, simulate_fixed_rate  # noqa: E402

CHECK = 'sma_sim.ros.check_main'
QUICK = ('-p', 'check.burn_in:=1.0', '-p', 'check.window:=1.0')
TOPICS = (
    (JointState, 'model_joint_states'),
    (JointState, 'residuals'),
    (Float64MultiArray, 'channel_residuals'),
    (Float64MultiArray, 'error_over_noise'),
    (DiagnosticArray, '/diagnostics'),
)
ROBOT = ((JointState, 'joint_states'), (Float64, 'J_eq_applied'))
PACE = 0.004  # [s] of wall time from sample to sample of a FakeRobot


@cache
def rest():
    """What the model shows at rest: pose, forces, temperatures."""
    return FixedRateRun(Model(Config()), 1000.0, np.array([0.0, 298.0])).sample[sample_columns(MODULE).sensed]


def stamp(message):
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


def status(one):
    """The last that sma_model_check said of itself."""
    found = [s for m in one.seen['/diagnostics'] for s in m.status if s.name.endswith('sma_model_check')]
    return found[-1] if found else DiagnosticStatus()


def value(one, key):
    return {pair.key: pair.value for pair in status(one).values}.get(key)


def worst(one, channel, begin=0):
    """The largest residual so far, from one message on."""
    at = CHANNELS.index(channel)
    return np.nanmax([abs(message.data[at]) for message in one.seen['channel_residuals'][begin:]])


@contextmanager
def beside(one, *arguments):
    """`sma_model_check` in the domain of a running robot; gives a list that holds its log afterwards."""
    words = [sys.executable, '-m', CHECK, '--ros-args', *QUICK, *arguments]
    process = subprocess.Popen(
        words, cwd=ros_client.ROOT, env=one.environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    log = []
    try:
        one.until(lambda: one.seen['error_over_noise'], ros_client.FIRST_MESSAGE)
        yield log
        process.send_signal(2)
        log.append(process.communicate(timeout=60)[0])
        assert process.returncode == 0 and 'Traceback' not in log[0], log
    finally:
        process.kill()
        process.communicate()


@contextmanager
def robot(*arguments):
    with ros_client.Simulation(*arguments, topics=(*TOPICS, *ROBOT)) as one:
        one.until(lambda: one.seen['joint_states'], ros_client.FIRST_MESSAGE)
        yield one
        code, log = one.stop()
        assert code == 0, log


@contextmanager
def moved(*commands):
    """A robot and its model, at rest and then moved by commands, each held for 3 s of the robot's time: what they said, the
    largest residual of alpha in each of these, and the log of the check, complete afterwards."""
    largest = []
    with robot() as one, beside(one, '-p', 'check.window:=3.0', '-p', 'check.threshold:=1000.0') as log:
        command = one.node.create_publisher(Float64, 'J_eq', 10)
        one.until(lambda: command.get_subscription_count() >= 2 and value(one, 'state') == 'comparing')
        assert [worst(one, channel) for channel in CHANNELS[:7]] == [0.0] * 7
        for J_eq in commands:
            command.publish(Float64(data=J_eq))
            end, begin = stamp(one.seen['joint_states'][-1]) + 3 * 10**9, len(one.seen['channel_residuals'])
            one.until(lambda end=end: stamp(one.seen['joint_states'][-1]) >= end)
            largest.append(worst(one, 'alpha', begin))
        one.until(lambda: float(value(one, 'J_eq [W]')) == commands[-1])
        assert status(one).level == DiagnosticStatus.OK, status(one)
        yield one, largest, log


def test_a_robot_that_is_the_model_leaves_no_residual_at_rest():
    with moved(12.0) as (one, _, log):
        pass
    assert np.ptp([message.position[2] for message in one.seen['joint_states']]) > 0.02
    last = one.seen['residuals'][-1]
    assert list(last.name) == ['U_x', 'U_y', 'alpha'] and len(last.velocity) == len(last.effort) == 3
    measured = {stamp(message): message for message in one.seen['joint_states']}
    models = {stamp(message): message for message in one.seen['model_joint_states']}
    both = [message for message in one.seen['residuals'] if stamp(message) in measured.keys() & models.keys()]
    assert len(both) > 50  # a busy machine loses some
    robot_poses, poses, differences = (
        np.array([message.position for message in messages])
        for messages in ([measured[stamp(message)] for message in both], [models[stamp(message)] for message in both], both)
    )
    assert np.abs(robot_poses - poses - differences).max() < 1e-15
    assert 'U_x, U_y, alpha, F_1, F_2, T_1, T_2' in one.seen['error_over_noise'][-1].layout.dim[0].label
    assert 'J_eq_applied is published: the model follows it' in log[0]
    assert 'has left' not in log[0] and 'restarts' not in log[0]


@pytest.mark.slow
def test_a_robot_that_is_the_model_leaves_little_when_it_moves():
    """What the sampling of commands leaves: an instant is known to a few steps, on a busy computer some are known worse."""
    with moved(12.0, -5.0, 12.0, -5.0) as (one, largest, _):
        pass
    assert min(largest) < 0.05 * np.ptp([message.position[2] for message in one.seen['joint_states']]), largest


@pytest.mark.slow
def test_an_effect_that_the_model_lacks_is_noticed_at_rest():
    with robot('-p', 'effects.active:=[gravity]') as one, beside(one) as log:
        one.until(lambda: status(one).level == DiagnosticStatus.WARN)
        assert 'the model has left the measurement: normalized RMSE' in status(one).message
    assert 'U_y' in log[0].split('has left the measurement')[1].splitlines()[0]


@pytest.mark.slow
def test_a_beam_that_is_stiffer_is_noticed_when_it_moves():
    with robot('-p', 'beam.E:=2.2e9') as one, beside(one) as log:
        command = one.node.create_publisher(Float64, 'J_eq', 10)
        one.until(lambda: command.get_subscription_count() >= 2 and value(one, 'state') == 'comparing')
        command.publish(Float64(data=12.0))
        one.until(lambda: 'alpha' in status(one).message and status(one).level == DiagnosticStatus.WARN)
    assert 'has left the measurement' in log[0] and 'check.threshold 3' in log[0]
    assert 'not both bundles were heated since the model started' in log[0]


class FakeRobot:
    """A client that publishes joint_states as it likes: the model at rest, 10 ms from stamp to stamp, unless told else."""

    def __init__(self, one, quality=10):
        self.one, self.time = one, 1000.0
        self.joints = one.node.create_publisher(JointState, 'joint_states', quality)
        one.until(lambda: self.joints.get_subscription_count() > 0, ros_client.FIRST_MESSAGE)

    def say(self, names=('U_x', 'U_y', 'alpha'), position=None, at=None, step=0.01):
        self.time = self.time + step if at is None else at
        message = JointState(name=list(names), position=list(rest()[:3] if position is None else position))
        message.header.stamp.sec, message.header.stamp.nanosec = int(self.time), int(1e9 * (self.time % 1.0))
        self.joints.publish(message)
        end = time.monotonic() + PACE
        while time.monotonic() < end:
            self.one.executor.spin_once(timeout_sec=PACE)

    def until(self, condition, **how):
        end = time.monotonic() + ros_client.REACTION
        while not condition():
            assert self.one.process.poll() is None, self.one.process.stdout.read()
            assert time.monotonic() < end, f'waited {ros_client.REACTION} s in vain'
            self.say(**how)


@contextmanager
def check(*arguments, quality=10):
    """`sma_model_check` beside a FakeRobot."""
    with ros_client.Simulation(*QUICK, *arguments, topics=TOPICS, module=CHECK) as one:
        log = []
        yield FakeRobot(one, quality), log
        code, words = one.stop()
        log.append(words)
        assert code == 0 and 'Traceback' not in words, words


def comparing(one):
    return lambda: value(one, 'state') == 'comparing'


def test_other_names_another_order_and_a_missing_joint():
    best_effort = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
    with check('-p', 'check.name_alpha:=tilt', '-p', 'check.name_U_y:=sway', quality=best_effort) as (fake, _):
        names, position = ('finger', 'tilt', 'sway'), (7.0, rest()[2] + 0.01, rest()[1] - 1e-3)
        fake.until(lambda: fake.one.seen['residuals'] and fake.one.seen['error_over_noise'], names=names, position=position)
        residual = fake.one.seen['residuals'][-1]
        assert list(residual.name) == ['U_x', 'U_y', 'alpha'] and len(residual.velocity) == len(residual.effort) == 0
        assert math.isnan(residual.position[0])
        assert residual.position[1:] == pytest.approx([-1e-3, 0.01], abs=1e-9)
        ratio = fake.one.seen['error_over_noise'][-1].data
        assert ratio[1:3] == pytest.approx([1e-3 / 1e-5, 0.01 / 3.5e-4]) and all(map(math.isnan, [ratio[0], *ratio[3:]]))


@pytest.mark.slow
def test_it_leaves_and_comes_back_and_outliers_do_not_count():
    with check() as (fake, log):
        one = fake.one
        fake.until(comparing(one))
        for _ in range(2):
            fake.say(position=(0.0, 1.0, 1.0))
            end = fake.time + 3.0
            fake.until(lambda end=end: fake.time > end)
        one.seen['/diagnostics'].clear()
        fake.until(lambda: status(one).values)
        assert status(one).level == DiagnosticStatus.OK, status(one)
        fake.until(lambda: status(one).level == DiagnosticStatus.WARN, position=(rest()[0], rest()[1], rest()[2] + 0.01))
        assert status(one).message.count('the model has left the measurement: normalized RMSE alpha') == 1
        fake.until(lambda: status(one).level == DiagnosticStatus.OK)
    assert log[0].index('has left the measurement') < log[0].index('the model is back in the measurement')


def test_it_says_that_the_model_follows():
    with check('-p', 'check.burn_in:=0.5') as (fake, log):
        one = fake.one
        fake.until(lambda: value(one, 'verdict on the model') == 'follows the measurement')
        assert status(one).message == 'comparing; the model follows the measurement' and value(one, 'state') == 'comparing'
    assert 'the model follows the measurement: normalized RMSE U_x 0, U_y 0, alpha 0 over the last 1 s' in log[0]


def test_an_offset_at_rest_is_said_before_the_burn_in_is_over():
    with check('-p', 'check.burn_in:=1e6') as (fake, log):
        away = (*rest()[:2], rest()[2] + 0.01)
        count = len(fake.one.seen['/diagnostics'])
        fake.until(lambda: fake.time > 1003.0 and fake.one.seen['error_over_noise'], position=away)
        fake.until(lambda: len(fake.one.seen['/diagnostics']) > count + 1, position=away)
        assert status(fake.one).level == DiagnosticStatus.OK and value(fake.one, 'verdict on the model') == 'none yet'
    words = (
        'at rest, before any wire is heated, the robot differs from the model: alpha 28.6 times the noise (0.573 deg). Zero'
    )
    assert log[0].count(words) == 1 and 'has left' not in log[0], log[0]


@pytest.mark.slow
def test_no_verdict_before_the_burn_in_is_over():
    with check('-p', 'check.burn_in:=1e6') as (fake, log):
        away = (0.0, 0.01, 0.1)
        fake.until(lambda: fake.time > 1010.0 and fake.one.seen['error_over_noise'], position=away)
        count = len(fake.one.seen['/diagnostics'])
        fake.until(lambda: len(fake.one.seen['/diagnostics']) > count + 1, position=away)
        assert status(fake.one).level == DiagnosticStatus.OK and value(fake.one, 'state') == 'burn-in'
        assert fake.one.seen['error_over_noise'][-1].data[2] > 100.0
    assert 'which the robot may not be in: no verdict for check.burn_in = 1e+06 s' in log[0]
    assert 'has left' not in log[0]


def test_clocks_that_jump_and_gaps():
    """Back, or beyond the longest gap: the model restarts; a short gap is stepped through; repeats are left out."""
    with check() as (fake, log):
        one, seen = fake.one, fake.one.seen['model_joint_states']
        fake.until(comparing(one))
        fake.until(lambda: value(one, 'starts of the model') == '1')
        fake.say(at=fake.time + 8.0)
        fake.until(lambda: stamp(seen[-1]) / 1e9 >= 1008.0)
        fake.say(at=500.0)
        fake.until(lambda: stamp(seen[-1]) / 1e9 < 600.0)
        fake.until(lambda: value(one, 'starts of the model') == '2')
        fake.say(at=5e8)
        fake.until(lambda: stamp(seen[-1]) / 1e9 > 4e8)
        fake.until(lambda: value(one, 'starts of the model') == '3')
        count = len(seen)
        for _ in range(50):
            fake.say(step=0.0)
        fake.until(lambda: value(one, 'joint_states whose stamp repeats') is not None)
        assert len({stamp(message) for message in seen[count:]}) == len(seen[count:])
    assert 'the stamps of joint_states went back by 5' in log[0]
    assert 'nothing was measured for 4999994' in log[0]
    assert 'joint_states whose stamp repeats: they are not compared; is header.stamp filled in?' in log[0]


def test_reset_starts_the_model_anew():
    with check() as (fake, log):
        fake.until(comparing(fake.one))
        client = fake.one.node.create_client(Trigger, '/sma_model_check/reset')
        fake.one.until(client.service_is_ready)
        future = client.call_async(Trigger.Request())
        fake.until(future.done)
        fake.until(lambda: value(fake.one, 'starts of the model') == '2')
    assert '~/reset was called: the model restarts' in log[0]


WRONG_JOINTS = (
    ({'position': (math.nan, 0.0, 0.0)}, 'joint_states that are not finite'),
    ({'position': (0.0, math.inf, 0.0)}, 'joint_states that are not finite'),
    ({'position': (0.0,)}, 'joint_states with too few positions'),
    ({'names': ('left', 'right'), 'position': (0.0, 0.0)}, 'joint_states without the joints that are expected'),
    ({'names': (), 'position': ()}, 'joint_states without the joints that are expected'),
)


def test_wrong_messages_are_said_and_survived():
    with check() as (fake, log):
        one = fake.one
        fake.until(lambda: one.seen['residuals'])
        for how, words in WRONG_JOINTS:
            fake.until(lambda words=words: value(one, words) is not None, **how)
        fake.say(position=(1e300, -1e300, 1e300))
        for topic, message, words in (
            ('wire_forces', Float64MultiArray(data=[1.0]), 'wire_forces that cannot be used'),
            ('wire_forces', Float64MultiArray(data=[1.0, math.nan]), 'wire_forces that cannot be used'),
            ('wire_1/temperature', Temperature(temperature=math.nan), 'temperatures of wire_1 that are not finite'),
            ('J_eq', Float64(data=math.nan), 'rejected commands'),
            ('J_eq', Float64(data=1e9), 'clipped commands'),
            ('J_eq_applied', Float64(data=math.inf), 'J_eq_applied that cannot be used'),
            ('T_E_applied', Float64(data=-20.0), 'T_E_applied that cannot be used'),
            ('ambient_temperature', Temperature(temperature=-400.0), 'rejected ambient temperatures'),
        ):
            publisher = one.node.create_publisher(type(message), topic, 10)

            def said(publisher=publisher, message=message, words=words):
                publisher.publish(message)  # again and again: a best-effort reader may miss the first
                return value(one, words) not in (None, '0')

            fake.until(said)
        one.node.create_publisher(Float32, 'wire_2/temperature', 10)
        fake.until(lambda: 'Float32 is published on wire_2/temperature: expected sensor_msgs' in status(one).message)
        count = len(one.seen['residuals'])
        fake.until(lambda: len(one.seen['residuals']) > count + 10)
    assert 'got left, right, expected U_x, U_y, alpha: see check.name_*' in log[0]


def test_commands_that_are_only_asked_for_and_the_timeout():
    """Without J_eq_applied the model is heated by J_eq, and by no more than the robot's command_timeout allows."""
    with check('-p', 'node.command_timeout:=1.0') as (fake, log):
        one = fake.one
        command = one.node.create_publisher(Float64, 'J_eq', 10)
        fake.until(lambda: one.seen['residuals'] and command.get_subscription_count() > 0)
        command.publish(Float64(data=12.0))
        begin = fake.time
        fake.until(lambda: fake.time > begin + 1.5)
        end = round(1e9 * fake.time)
        fake.until(lambda: stamp(one.seen['model_joint_states'][-1]) > end)
        alpha = max(message.position[2] for message in one.seen['model_joint_states'])
        assert value(one, 'command') == 'J_eq'
    times, values = np.array([0.0, 1.0, 1.5]), np.array([[12.0, 298.0], [0.0, 298.0], [0.0, 298.0]])
    heated = simulate_fixed_rate(Model(Config()), Input(times, values, (False, False)), 1000.0, 100.0)['alpha_rad'].max()
    assert alpha == pytest.approx(heated, rel=1e-2)
    assert 'J_eq_applied is published' not in log[0]


def test_it_says_that_nothing_is_measured():
    with ros_client.Simulation(*QUICK, topics=TOPICS, module=CHECK) as one:
        one.until(lambda: 'no joint_states for' in status(one).message, ros_client.FIRST_MESSAGE)
        assert status(one).level == DiagnosticStatus.WARN and value(one, 'state') == 'waiting for joint_states'
        code, log = one.stop()
    assert code == 0 and 'no joint_states: is the robot running, in this namespace?' in log


WRONG_PARAMETERS = {
    'check.threshold:=-1.0': 'check.threshold = -1',
    'check.noise_alpha:=0.0': 'check.noise_alpha = 0 rad',
    'check.name_alpha:=3': 'check.name_alpha = 3',
    'check.name_alpha:=U_x': 'check.name_*: expected three different names, got U_x, U_y, U_x',
    'check.tolerance:=1.0': 'unknown parameter check.tolerance',
    'system:=wire': 'a wire has no joints',
}


def test_wrong_parameters_stop_it():
    """One process starts it with each of them."""
    code = f'from {CHECK} import main\nfor words in {list(WRONG_PARAMETERS)}: print(main(["--ros-args", "-p", words]))'
    words = [sys.executable, '-u', '-c', code]
    output = {'stdout': subprocess.PIPE, 'stderr': subprocess.STDOUT, 'text': True}
    done = subprocess.run(words, cwd=ros_client.ROOT, timeout=120, **output)
    assert done.returncode == 0 and 'Traceback' not in done.stdout, done.stdout
    said = done.stdout.split('\n2\n')
    assert said.pop() == '' and len(said) == len(WRONG_PARAMETERS), done.stdout
    for words, message in zip(said, WRONG_PARAMETERS.values(), strict=True):
        said_of_it = words.splitlines()[-1]  # a start that takes long says so before
        assert said_of_it.startswith('sma_model_check: ') and message in said_of_it


@pytest.mark.slow
def test_beside_a_structure_with_a_command_for_each_wire():
    words = ('-p', 'system:=spatial')

    def follows():
        moved = np.ptp([message.position[1] for message in one.seen['joint_states']])
        return moved > 3e-4 and abs(one.seen['channel_residuals'][-1].data[1]) < 0.02 * moved

    with robot(*words) as one, beside(one, *words, '-p', 'check.window:=3.0') as log:
        command = one.node.create_publisher(Float64MultiArray, 'J', 10)
        one.until(lambda: command.get_subscription_count() >= 2 and value(one, 'state') == 'comparing')
        assert np.nanmax(np.abs([message.data for message in one.seen['channel_residuals']])) == 0.0
        command.publish(Float64MultiArray(data=[8.0, 0.0, 2.0]))
        one.until(lambda: value(one, 'J [W]') == '8, 0, 2')
        assert value(one, 'command') == 'J_applied' and status(one).level == DiagnosticStatus.OK, status(one)
        one.until(follows)  # a command without a stamp may arrive late: for a while the model is behind
    last, names = one.seen['channel_residuals'][-1].data, list(one.seen['residuals'][-1].name)
    assert names == list(SPATIAL.channels[:6]) and len(last) == len(SPATIAL.channels)
    shown, resistances = last[: -SPATIAL.wires], last[-SPATIAL.wires :]  # which the robot does not publish
    assert np.isfinite(shown).all() and np.isnan(resistances).all() and 'J_applied is published' in log[0]


def test_what_has_changed_is_said_with_its_probability_and_a_command_that_would_tell():
    """Beside a module with gravity a model without it: a change, its causes, and what would tell them apart."""
    topics = ((DiagnosticArray, 'diagnosis'), (String, 'diagnosis/json'), (Float64MultiArray, 'error_over_noise'))
    with ros_client.Simulation('-p', 'effects.active:=[gravity]', topics=topics) as one:
        with beside(one, '-p', 'check.diagnosis_period:=1.0') as log:
            one.until(lambda: any(json.loads(m.data)['changed'] for m in one.seen['diagnosis/json']), 300.0)
            found = json.loads(one.seen['diagnosis/json'][-1].data)
            one.until(lambda: one.seen['diagnosis'][-1].status[0].level == DiagnosticStatus.WARN, 30.0)
            answer = one.ask(Trigger, 'sma_model_check/propose_command', Trigger.Request())
        assert sum(found['probabilities'].values()) == pytest.approx(1.0) and 'nothing' in found['probabilities']
        assert found['since'] is not None and found['error'] > 3.0 * found['left']
        proposed = json.loads(answer.message)
        assert answer.success and len(proposed['between']) == 2 and proposed['command'][-1][1] == 0.0
    assert 'changed since about' in log[0]


def finding_of(name, probability, log_odds):
    return LiveFinding(9, 4, (CauseFinding(name, name, probability),), log_odds, 3.0, 1.1)


@pytest.mark.parametrize(
    ('finding', 'words'),
    [
        (None, 'its cause is being looked for'),
        (finding_of('nothing', 1.0, -math.inf), 'other values of its parameters explain it'),
        (finding_of('gravity', 0.6, 1.0), 'no cause is certain yet; the most probable: gravity (60 %)'),
        (finding_of('gravity', 0.97, 9.0), 'changed since about 0 s: gravity (97 %)'),
    ],
)
def test_why_the_model_has_left_is_said_as_far_as_it_is_known(finding, words):
    with ros_client.listener(ros_client.any_domain()) as node:
        watch = CauseWatch(node, Config(), np.ones(9), 1e6, None)
        watch.last = finding
        assert words in watch.reason()
        watch.close()
        assert CauseWatch(node, Config(), np.ones(9), 0.0, None).reason() == ''
