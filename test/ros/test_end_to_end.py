"""The whole story over ROS: a robot with a hidden effect is driven, recorded, diagnosed; the improved model follows it."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

ros_client = pytest.importorskip('ros_client', reason='rclpy is not installed', exc_type=ImportError)
from sensor_msgs.msg import JointState  # noqa: E402
from std_srvs.srv import Trigger  # noqa: E402

import sma_sim.challenge.truths  # noqa: E402
from sma_sim.challenge.files import write_challenge  # noqa: E402
from sma_sim.challenge.make import RecordingPlan, make_challenge  # noqa: E402
from sma_sim.cli.main import main  # noqa: E402
from sma_sim.evidence.data.rosbag.reader import read_bag  # noqa: E402

ROOT = Path(__file__).resolve().parents[2]
SPEED = 20.0
NOISE = ('U_x=2e-6', 'U_y=1e-5', 'alpha=3.5e-4', 'F_1=0.05', 'F_2=0.05', 'T_1=0.1', 'T_2=0.1')
ROBOT = f"""
/**:
  ros__parameters:
    model: mas
    wire: {{lambda: 500.0, c_V: 360.0}}
    effects:
      active: [truth_gravity]
      paths: ['{Path(sma_sim.challenge.truths.__file__).parent}']
"""
FAST = ('-p', f'node.real_time_factor:={SPEED}', '-p', 'node.publish_rate:=10.0')


def command_file(path, seed):
    """Random steps of 60 s."""
    random = np.random.default_rng(seed)
    times = np.concatenate([[0.0], np.sort(random.uniform(1.0, 55.0, 5)), [60.0]])
    levels = np.append(random.uniform(-12.0, 12.0, 6), 0.0)
    path.write_text('time_s,J_eq_W\n' + ''.join(f'{t:.3f},{J:.3f}\n' for t, J in zip(times, levels, strict=True)))
    return str(path)


def drive(folder, parameters, bag, seeds):
    """Run the node with a parameter file, play a command for each seed from the start, record each to a bag."""
    words = ('--params-file', str(parameters), *FAST, '-p', f'node.record:={folder / bag}')
    with ros_client.Simulation(*words, topics=((JointState, 'joint_states'),)) as one:
        one.until(lambda: one.seen['joint_states'], ros_client.FIRST_MESSAGE)
        reset = one.node.create_client(Trigger, '/sma_module_sim/reset')
        one.until(reset.service_is_ready)
        for number, seed in enumerate(seeds):
            if number:
                future = reset.call_async(Trigger.Request())
                one.until(future.done)
            play = [sys.executable, '-m', 'sma_sim.cli.main', 'play', command_file(folder / f'{seed}.csv', seed)]
            done = subprocess.run(
                [*play, '--speed', f'{SPEED}'],
                env=one.environment | {'PYTHONPATH': str(ROOT)},
                cwd=folder,
                capture_output=True,
                text=True,
                timeout=120,
            )
            assert done.returncode == 0, done.stderr
        code, log = one.stop()
        assert code == 0, log
    return [folder / (bag if k == 0 else f'{bag}_{k}') for k in range(len(seeds))]


def error_of(measured, parameters, folder, column='alpha_rad'):
    """RMSE of one column of a model under the very inputs of a recording."""
    out = folder / 'again.csv'
    words = ['--input', str(measured), '--config', str(parameters), '--out', str(out)]
    assert main(['simulate', *words, '--integration-rate', '1000', '--rate', '10']) == 0
    truth = read_bag(measured)
    whole = np.isfinite(truth[column])
    again = np.genfromtxt(out, delimiter=',', names=True)
    return float(np.sqrt(np.mean((again[column] - truth[column][whole]) ** 2)))


@pytest.mark.slow
def test_robot_to_improved_model(tmp_path):
    (tmp_path / 'robot.yaml').write_text(ROBOT)
    bags = drive(tmp_path, tmp_path / 'robot.yaml', 'run', (1, 2, 3))
    noise = [word for channel in NOISE for word in ('--noise', channel)]
    better, verdict = tmp_path / 'better.yaml', tmp_path / 'verdict.json'
    words = [*map(str, bags), '--model', 'mas', '--hold-out', 'run_2', *noise, '--json', str(verdict), '-o', str(better)]
    assert main(['diagnose', *words]) == 0
    found = json.loads(verdict.read_text())
    assert found['verdict'] == 'missing_effect' and found['effects'] == ['gravity']
    assert found['error'][-1]['held_out'] < 1.15 < 2.0 < found['error'][0]['held_out']
    (again,) = drive(tmp_path, better, 'improved', (3,))  # the node runs what was written
    assert np.isfinite(read_bag(again)['alpha_rad']).any()
    bare = ROOT / 'config' / 'module.yaml'
    assert error_of(bags[2], better, tmp_path) < 0.1 * error_of(bags[2], bare, tmp_path)


@pytest.mark.slow
def test_unlisted_effect_to_a_node_that_has_it(tmp_path):
    """A force that no library knows: its equation is proposed, written, and runs in the node as it was fitted."""
    case = tmp_path / 'case'
    write_challenge(
        make_challenge(seed=4, kinds=['shaking_table'], plan=RecordingPlan(duration=30.0, rate=10.0)), case, 'csv'
    )
    better, verdict, nominal = tmp_path / 'better.yaml', tmp_path / 'verdict.json', case / 'nominal.yaml'
    words = ['--config', str(nominal), '--model', 'mas', '--json', str(verdict), '-o', str(better)]
    assert main(['diagnose', str(case), *words]) == 0
    found = json.loads(verdict.read_text())
    assert found['verdict'] == 'unknown_effect'  # a known effect may explain a part
    assert found['error'][-1]['held_out'] < 1.3 < found['error'][0]['held_out']
    assert Path(found['proposed']['file']).stem in found['error'][-1]['effects']
    (again,) = drive(tmp_path, better, 'improved', (3,))
    as_fitted, without = (error_of(again, one, tmp_path, 'U_y_m') for one in (better, nominal))
    assert as_fitted < 0.02 * without  # the node's steps are fixed, and its commands arrive when they do
