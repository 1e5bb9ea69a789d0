"""What works without the packages that rosdep does not know or only some commands use, and what is said without them."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
OPTIONAL = ('rosbags', 'mcap', 'plotly', 'threadpoolctl')
NODE = 'from sma_sim.ros.main import main; sys.exit(main(sys.argv[1:]))'
CHECK = 'from sma_sim.ros.check_main import main; sys.exit(main(sys.argv[1:]))'
COMMAND = 'from sma_sim.cli.main import main; sys.exit(main(sys.argv[1:]))'


def program(code, *words, hidden=OPTIONAL):
    """What runs `code` as if the packages of `hidden` were not installed."""
    hide = f'import sys; sys.modules.update(dict.fromkeys({hidden!r}))'
    return [sys.executable, '-c', f'{hide}; {code}', *words]


def run(code, *words, folder, hidden=OPTIONAL):
    environment = {**os.environ, 'PYTHONPATH': str(ROOT)}
    return subprocess.run(
        program(code, *words, hidden=hidden), cwd=folder, env=environment, capture_output=True, text=True, timeout=300
    )


@pytest.mark.parametrize(('code', 'running'), [(NODE, 'running: '), (CHECK, 'waiting for joint_states')])
def test_a_node_starts_without_them(code, running):
    pytest.importorskip('rclpy')
    with subprocess.Popen(program(code), cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as process:
        log = []
        for line in process.stderr:
            log.append(line)
            if running in line:
                process.send_signal(signal.SIGINT)
                break
        assert process.wait(60) == 0 and running in log[-1], ''.join(log)


def test_a_node_without_the_interfaces_of_simulators_says_so_once():
    pytest.importorskip('rclpy')
    words = program(NODE, hidden=('simulation_interfaces',))
    with subprocess.Popen(words, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as process:
        log = []
        for line in process.stderr:
            log.append(line)
            if 'running: ' in line:
                process.send_signal(signal.SIGINT)
                break
        assert process.wait(60) == 0 and ''.join(log).count('the package simulation_interfaces is not installed') == 1


@pytest.mark.parametrize('package', ['rosbags', 'mcap'])
def test_a_node_that_shall_record_says_what_to_install(tmp_path, package):
    pytest.importorskip('rclpy')
    done = run(NODE, '--ros-args', '-p', f'node.record:={tmp_path / "bag"}', folder=ROOT, hidden=(package,))
    assert done.returncode == 2 and f'pip install {package}' in done.stderr and 'Traceback' not in done.stderr, done.stderr
    assert not (tmp_path / 'bag').exists()


@pytest.mark.parametrize('verb', ['fit', 'compare', 'diagnose', 'latent'])
def test_a_report_is_refused_at_once_without_plotly(tmp_path, verb):
    done = run(COMMAND, verb, 'data', '--report', 'page.html', folder=tmp_path, hidden=('plotly',))
    assert done.returncode == 2 and 'pip install plotly' in done.stderr and 'Traceback' not in done.stderr, done.stderr


def test_a_command_that_reads_bags_says_what_to_install(tmp_path):
    done = run(COMMAND, 'bag', 'info', 'run1', folder=tmp_path, hidden=('rosbags',))
    assert done.returncode == 2 and 'pip install rosbags' in done.stderr and 'Traceback' not in done.stderr, done.stderr


def test_work_is_spread_without_threadpoolctl(tmp_path):
    code = (
        'from sma_sim.evidence.estimation.executors import executor_or_threads\n'
        'with executor_or_threads(None) as threads: print(threads.submit(abs, -3).result())'
    )
    done = run(f'exec({code!r})', folder=tmp_path, hidden=('threadpoolctl',))
    assert done.stdout == '3\n', done.stderr
