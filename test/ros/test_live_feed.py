"""What a page hears of the model beside a robot: a process that may end, fail, or say nonsense."""

import json
import sys
import time

import pytest

from sma_sim import UserError, read_config
from sma_sim.explore import live
from sma_sim.explore.live import LiveFeed
from sma_sim.model.parameter_file import parameter_file

PATIENCE = 120.0  # [s]
LINES = [
    {'kind': 'channels', 'channels': ['U_x', 'alpha']},
    {'kind': 'state', 'state': 'burn-in', 'problems': [], 'samples': 0},
    *(
        {'kind': 'sample', 'stamp': float(k), 'measured': [0.0, None], 'model': [1.0, 2.0], 'error': [3.0, None]}
        for k in range(5)
    ),
    {'kind': 'state', 'state': 'comparing', 'problems': ['the model has left'], 'samples': 5},
]


def feed(tmp_path, program):
    """A feed whose process runs a Python program."""
    (tmp_path / 'feed.py').write_text(program)
    return LiveFeed([sys.executable, str(tmp_path / 'feed.py')])


def until(condition):
    end = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.02)


def saying(lines, then=''):
    return f'import sys, time, os\nfor line in {list(map(json.dumps, lines))!r}:\n    print(line, flush=True)\n{then}\n'


def test_what_is_heard(tmp_path):
    one = feed(tmp_path, saying(LINES, 'print(sys.argv, os.environ["ROS_DOMAIN_ID"], file=sys.stderr)\ntime.sleep(600)'))
    assert one.read()['state'] == 'off'
    one.start(tmp_path / 'a.yaml', 'robot_1', 7)
    try:
        until(lambda: one.read()['state'] == 'comparing' and one._said)
        found = one.read(3)
        assert [sample['stamp'] for sample in found['samples']] == [3.0, 4.0] and found['next'] == 5
        assert found['channels'] == ['U_x', 'alpha'] and found['compared'] == 5
        assert found['problems'] == ['the model has left']
        assert one.read(5)['samples'] == [] and len(one.read()['samples']) == 5
        assert '__ns:=/robot_1' in one._said[0] and one._said[0].endswith(' 7') and 'a.yaml' in one._said[0]
        with pytest.raises(UserError, match='already'):
            one.start(tmp_path / 'a.yaml')
        json.dumps(found, allow_nan=False)
    finally:
        one.stop()
    assert one.read()['state'] == 'ended' and one.read()['next'] == 5
    one.start(tmp_path / 'b.yaml', '', 8)
    assert one.read()['next'] <= 5 and one.read()['state'] != 'ended'
    one.stop()


def test_a_process_that_fails_and_one_that_talks_nonsense(tmp_path):
    one = feed(tmp_path, saying(LINES[:3], 'print("no ROS here", file=sys.stderr)\nsys.exit(2)'))
    one.start(tmp_path / 'a.yaml')
    until(lambda: one.read()['state'] == 'failed' and one.read()['problems'] == ['no ROS here'])
    assert len(one.read()['samples']) == 1
    other = feed(
        tmp_path, 'print("{"); print("[3]"); print(\'{"kind": "state"}\'); print("\\x00", flush=True)\n' + saying(LINES)
    )
    other.start(tmp_path / 'a.yaml')
    until(lambda: other.read()['state'] == 'ended' and other.read()['next'] == 5)


def test_only_the_last_minutes_are_kept(tmp_path, monkeypatch):
    monkeypatch.setattr(live, 'KEPT', 3)
    one = feed(tmp_path, saying(LINES))
    one.start(tmp_path / 'a.yaml')
    until(lambda: one.read()['next'] == 5)
    assert [sample['stamp'] for sample in one.read()['samples']] == [2.0, 3.0, 4.0] and len(one.read(4)['samples']) == 1


def test_another_model_has_its_own_samples(tmp_path):
    """Samples of the model before are gone, those of the new one come anew; one that cannot be run leaves the one before."""
    told = [{**sample, 'model': [7.0, 8.0]} for sample in LINES[5:7]]
    answers = [
        {'path': 'v/0002.yaml', 'failed': '', 'samples': told},
        {'path': 'v/0003.yaml', 'failed': 'why', 'samples': []},
    ]
    lines = [json.dumps({'kind': 'model', **answer}) for answer in answers]
    one = feed(
        tmp_path, saying(LINES, f'for answer in {lines!r}:\n    asked = input()\n    print(answer, flush=True)\ninput()')
    )
    one.start(tmp_path / '0001.yaml')
    until(lambda: one.read()['next'] == 5)
    one.use(tmp_path / '0002.yaml')
    until(lambda: one.read()['model']['changes'] == 1)
    found = one.read(5)  # as a page asks that knows all samples of the model before
    assert [sample['model'] for sample in found['samples']] == [[7.0, 8.0]] * 2 and found['next'] == 7
    assert one.read()['samples'] == found['samples'] and found['model']['path'] == 'v/0002.yaml'
    one.use(tmp_path / '0003.yaml')
    until(lambda: one.read()['model']['failed'] == 'why')
    assert one.read()['model']['path'] == 'v/0002.yaml' and len(one.read()['samples']) == 2
    one.stop()
    with pytest.raises(UserError, match='does not listen'):
        one.use(tmp_path / '0004.yaml')


@pytest.mark.parametrize(('namespace', 'domain'), [('a b', None), ('-p x:=1', None), ('', 233), ('', -1), ('1a', None)])
def test_wrong_wishes(tmp_path, namespace, domain):
    with pytest.raises(UserError, match='namespace|domain'):
        LiveFeed().start(tmp_path / 'a.yaml', namespace, domain)


def test_beside_a_node_that_ends(tmp_path):
    """Nothing breaks when the robot goes: that is said, and what was heard stays."""
    ros_client = pytest.importorskip('ros_client', reason='no ROS here')
    parameters, one = tmp_path / 'version.yaml', LiveFeed()
    parameters.write_text(parameter_file(read_config(words=['check.burn_in=0.5', 'check.window=0.5'])))
    with ros_client.Simulation('-r', '__ns:=/robot_1') as robot:
        one.start(parameters, 'robot_1', int(robot.environment['ROS_DOMAIN_ID']))
        try:
            until(lambda: one.read()['state'] == 'comparing' and one.read()['compared'] > 20)
            robot.stop()
            until(lambda: any('joint_states' in words for words in one.read()['problems']))
        finally:
            one.stop()
    found = one.read()
    assert found['state'] == 'ended' and found['channels'][:3] == ['U_x', 'U_y', 'alpha']
    last = found['samples'][-1]
    assert max(last['error'][:3]) < 1e-3 and last['measured'][2] == pytest.approx(last['model'][2], abs=1e-9)
