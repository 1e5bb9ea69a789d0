"""The launch files, by the `ros2` command where it is installed, and what the demo starts, over real DDS."""

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

ros_client = pytest.importorskip('ros_client', reason='rclpy is not installed', exc_type=ImportError)
from sensor_msgs.msg import JointState  # noqa: E402

ROOT = Path(__file__).resolve().parents[2]
ROS2 = shutil.which('ros2', path=f'{Path(sys.executable).parent}{os.pathsep}{os.environ["PATH"]}')
FILES = sorted(file.name for file in (ROOT / 'launch').iterdir() if file.is_file())
NODE = f'#!/bin/sh\nexec "{sys.executable}" -m sma_sim.ros.main "$@"\n'
ALPHA = 2

by_ros2 = pytest.mark.skipif(ROS2 is None, reason='the ros2 command is not installed; it is not among the wheels')


def test_the_demo_moves_both_ways():
    """What closed_loop.launch.py demo:=true starts: the module, the controller and a target that is a sine."""
    with ros_client.Simulation('-p', 'node.real_time_factor:=4.0', topics=[(JointState, 'joint_states')]) as module:
        followers = [
            subprocess.Popen([sys.executable, str(ROOT / 'examples' / name), '--ros-args', *words], env=module.environment)
            for name, words in (('controller.py', []), ('sine_target.py', ['-p', 'period:=8.0']))
        ]
        try:
            module.until(lambda: any(state.position[ALPHA] > 0.02 for state in module.seen['joint_states']), 300)
            module.until(lambda: module.seen['joint_states'][-1].position[ALPHA] < -0.02)
        finally:
            for process in followers:
                process.send_signal(signal.SIGINT)
            codes = [process.wait(60) for process in followers]
        assert codes == [0, 0] and module.stop()[0] == 0


@pytest.fixture(scope='module')
def environment(tmp_path_factory):
    """That of an installation of these sources: what `pip install -e .` makes (test_install.py)."""
    prefix = tmp_path_factory.mktemp('prefix')
    index, share, lib = (
        prefix / name for name in ('share/ament_index/resource_index/packages', 'share/sma_sim', 'lib/sma_sim')
    )
    for folder in (index, share, lib):
        folder.mkdir(parents=True)
    (index / 'sma_sim').touch()
    for name in ('config', 'examples', 'launch'):  # ros2 launch does not look behind links
        shutil.copytree(ROOT / name, share / name, ignore=shutil.ignore_patterns('__pycache__'))
    shutil.copy(ROOT / 'package.xml', share)
    (lib / 'sma_module_sim').write_text(NODE)
    (lib / 'sma_module_sim').chmod(0o755)
    path = os.pathsep.join([str(prefix), os.environ.get('AMENT_PREFIX_PATH') or sys.prefix])
    return {**os.environ, 'AMENT_PREFIX_PATH': path, 'PYTHONPATH': str(ROOT), 'ROS_LOG_DIR': str(prefix / 'log')}


def launch(environment, *words):
    """What a launch that starts nothing prints."""
    done = subprocess.run([ROS2, 'launch', 'sma_sim', *words], env=environment, capture_output=True, text=True, timeout=60)
    return done.returncode, done.stdout + done.stderr


class Launched:
    """A launch that runs, and a client that collects joint states of the given topics."""

    def __init__(self, environment, log, topics, *words):
        self.log, self.seen = log, {topic: [] for topic in topics}
        self.domain = str(ros_client.any_domain())
        with log.open('w') as file:
            self.process = subprocess.Popen(
                [ROS2, 'launch', 'sma_sim', *words],
                env={**environment, 'ROS_DOMAIN_ID': self.domain},
                stdout=file,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )

    def until(self, condition, patience=ros_client.FIRST_MESSAGE):
        """Collect until the condition on `seen` holds."""
        with ros_client.listener(self.domain) as node:
            executor = ros_client.rclpy.executors.SingleThreadedExecutor(context=node.context)
            executor.add_node(node)
            for topic, messages in self.seen.items():
                node.create_subscription(JointState, topic, messages.append, 10)
            end = time.monotonic() + patience
            while not condition(self.seen):
                assert self.process.poll() is None and time.monotonic() < end, self.log.read_text()
                executor.spin_once(timeout_sec=0.1)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        """Ctrl-C in a terminal: every process gets it, and again from launch."""
        if self.process.poll() is not None:
            return
        os.killpg(self.process.pid, signal.SIGINT)
        try:
            self.process.wait(60)
        except subprocess.TimeoutExpired:
            os.killpg(self.process.pid, signal.SIGKILL)
            raise


@by_ros2
@pytest.mark.parametrize('file', FILES)
def test_every_argument_is_described(environment, file):
    code, text = launch(environment, file, '--show-args')
    described = dict(re.findall(r"^    '(\w+)':\n        (.+)$", text, re.M))
    expected = {
        'model',
        'system',
        'effects',
        'params_file',
        'namespace',
        'use_sim_time',
        'log_level',
        'rviz',
        'controller',
        'record',
        'alpha_target',
        'demo',
        'joint_prefix',
        'guard',
    }
    assert code == 0 and set(described) == expected, text
    assert 'no description given' not in text


@by_ros2
@pytest.mark.parametrize(
    ('words', 'message'),
    [
        (['modle:=mas'], 'modle:= is no argument of'),
        (['alpha_target:=far'], 'alpha_target:=far: expected an angle'),
        (['rviz:=maybe'], 'rviz:=maybe: expected true or false'),
        (['params_file:=none.yaml'], 'there is no file none.yaml'),
        (['system:=lever', 'demo:=true'], 'system:=lever has no joint alpha, which the controllers of the examples move'),
        (['controller:=none.py'], 'there is no file none.py; there are controller, trajectory_follower, predictive'),
    ],
)
def test_wrong_arguments_start_nothing(environment, words, message):
    for file in FILES:
        code, text = launch(environment, file, *words)
        assert code != 0 and message in text and 'process started' not in text, text


@by_ros2
def test_the_model_and_the_effects_are_those_asked_for(environment, tmp_path):
    words = ('module.launch.py', 'model:=mas', 'effects:=gravity,natural_convection', 'namespace:=left')
    with Launched(environment, tmp_path / 'log', ['/left/joint_states'], *words) as launched:
        launched.until(lambda seen: seen['/left/joint_states'])
    assert 'running: mas model, effects gravity, natural_convection' in (tmp_path / 'log').read_text()


@by_ros2
def test_one_line_makes_a_robot_that_moves(environment, tmp_path):
    with Launched(
        environment, tmp_path / 'log', ['/joint_states'], 'closed_loop.launch.py', 'demo:=true', 'rviz:=true'
    ) as launched:
        launched.until(lambda seen: any(state.position[ALPHA] > 0.02 for state in seen['/joint_states']))
    log = (tmp_path / 'log').read_text()
    assert 'has died' not in log and ('RViz is not installed here' in log or 'rviz2' in log), log


@by_ros2
def test_two_modules(environment, tmp_path):
    topics = ['/left/joint_states', '/right/joint_states']
    with Launched(environment, tmp_path / 'log', topics, 'two_modules.launch.py') as launched:
        launched.until(lambda seen: all(seen.values()))


@by_ros2
def test_rviz_looks_at_each_of_two_modules(environment, tmp_path):
    """What is started instead of RViz says with which names."""
    (tmp_path / 'share/ament_index/resource_index/packages').mkdir(parents=True)
    (tmp_path / 'share/ament_index/resource_index/packages/rviz2').touch()
    (tmp_path / 'lib/rviz2').mkdir(parents=True)
    (tmp_path / 'lib/rviz2/rviz2').write_text('#!/bin/sh\necho "$@" >> "$SEEN"\nexec sleep 60\n')
    (tmp_path / 'lib/rviz2/rviz2').chmod(0o755)
    seen = tmp_path / 'seen'
    with_rviz = {
        **environment,
        'SEEN': str(seen),
        'AMENT_PREFIX_PATH': f'{tmp_path}{os.pathsep}{environment["AMENT_PREFIX_PATH"]}',
    }
    with Launched(with_rviz, tmp_path / 'log', [], 'two_modules.launch.py', 'rviz:=true') as launched:
        launched.until(lambda _: seen.exists() and len(seen.read_text().splitlines()) == 2)
    lines = sorted(seen.read_text().splitlines())
    assert all(
        f'-f {side}/base' in line and f'__ns:=/{side}' in line for side, line in zip(('left', 'right'), lines, strict=True)
    )


@by_ros2
def test_an_example_follows_trajectories(environment, tmp_path):
    words = ('closed_loop.launch.py', 'controller:=trajectory_follower')
    with Launched(environment, tmp_path / 'log', ['/joint_states'], *words) as launched:
        launched.until(lambda _: 'alpha_trajectory_controller]: waiting for joint_states' in (tmp_path / 'log').read_text())


@by_ros2
@pytest.mark.parametrize('says', ['', 'DEFAULT'])
def test_a_controller_talks_over_udp_unless_the_environment_says_otherwise(environment, tmp_path, says):
    controller, seen = tmp_path / 'mine.py', tmp_path / 'seen'
    controller.write_text(
        f"import os, time\nopen({str(seen)!r}, 'w').write(os.environ['FASTDDS_BUILTIN_TRANSPORTS'])\ntime.sleep(60)\n"
    )
    said = {**environment, 'FASTDDS_BUILTIN_TRANSPORTS': says} if says else environment
    with Launched(said, tmp_path / 'log', [], 'closed_loop.launch.py', f'controller:={controller}') as launched:
        launched.until(lambda _: seen.exists() and seen.read_text())
    assert seen.read_text() == (says or 'UDPv4')
