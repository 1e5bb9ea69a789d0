"""What the commands of the two nodes answer to arguments that are not for ROS, and to --help."""

import subprocess
import sys
from pathlib import Path

import pytest

from sma_sim.ros.entry import outside_ros_args

ROOT = Path(__file__).resolve().parents[2]
NODES = {
    'sma_module_sim': 'sma_sim.ros.main',
    'sma_model_check': 'sma_sim.ros.check_main',
    'sma_observer': 'sma_sim.ros.observer_main',
    'sma_guard': 'sma_sim.ros.guard_main',
    'sma_controller': 'sma_sim.ros.controller_main',
}


def run(node, *words):
    command = [sys.executable, '-m', NODES[node], *words]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=60)


@pytest.mark.parametrize('node', NODES)
@pytest.mark.parametrize(
    ('words', 'form'),
    [
        (['-p', 'node.record:=x'], '--ros-args -p node.record:=x'),
        (['--params-file', 'my robot.yaml'], "--ros-args --params-file 'my robot.yaml'"),
        (['robot.yaml'], '--ros-args -p '),
        (['--ros-args', '-p', 'model:=mas', '--', '-r', '__ns:=/left'], '--ros-args -r __ns:=/left'),
    ],
)
def test_arguments_that_ros_ignores_are_refused(node, words, form):
    done = run(node, *words)
    assert done.returncode == 2 and f'{node} {form}' in done.stderr and 'Traceback' not in done.stderr, done.stderr


@pytest.mark.parametrize('node', NODES)
@pytest.mark.parametrize('word', ['--help', '-h'])
def test_help_prints_the_usage(node, word):
    done = run(node, word)
    assert done.returncode == 0 and done.stdout.startswith(f'usage: {node} ') and '--params-file' in done.stdout


@pytest.mark.parametrize('node', NODES)
def test_ctrl_c_is_heard_before_anything_is_loaded_that_takes_long(node):
    """Python answers Ctrl-C with a traceback until the node listens to signals."""
    code = f'import sys, {NODES[node]}; print({{"numpy", "rclpy", "numba", "yaml"}} & set(sys.modules))'
    done = subprocess.run([sys.executable, '-c', code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout == 'set()\n'


def test_arguments_of_ros_are_those_between_its_marks():
    assert outside_ros_args(['--ros-args', '-p', 'a:=1', '--', '--ros-args', '-r', '__ns:=/b']) == []
    assert outside_ros_args(['a', '--ros-args', '-p', 'b', '--', 'c']) == ['a', 'c']


SLOW = """
import sys, time
from sma_sim.ros import entry
from sma_sim.ros.main import PROGRAM

class Runner:
    def __init__(self, *_): time.sleep(float(sys.argv[1]))
    def begin(self, stop): pass
    def spin(self, stop): pass
    def close(self): pass

entry.SLOW_START = 0.5
sys.exit(entry.run_node(PROGRAM, Runner, []))
"""


@pytest.mark.parametrize(('seconds', 'told'), [(0.0, False), (3.0, True)])
def test_a_start_that_takes_long_says_so(seconds, told):
    done = subprocess.run([sys.executable, '-c', SLOW, str(seconds)], capture_output=True, text=True, check=False)
    assert done.returncode == 0 and ('first start on a machine compiles it' in done.stdout + done.stderr) == told
