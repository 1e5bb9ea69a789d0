"""The node's own bag over real DDS: replay bit for bit under load, kills, resets, refusals."""

import multiprocessing
import random
import re
import shutil
import time
from datetime import datetime

import numpy as np
import pytest

ros_client = pytest.importorskip('ros_client', reason='rclpy is not installed', exc_type=ImportError)
from diagnostic_msgs.msg import DiagnosticArray  # noqa: E402
from rclpy.serialization import deserialize_message  # noqa: E402
from rosbags.rosbag2 import Reader  # noqa: E402
from sensor_msgs.msg import JointState, Temperature  # noqa: E402
from std_msgs.msg import Float64  # noqa: E402
from std_srvs.srv import SetBool, Trigger  # noqa: E402
from visualization_msgs.msg import MarkerArray  # noqa: E402

from sma_sim.cli.main import main  # noqa: E402
from sma_sim.evidence.data.rosbag.reader import read_bag  # noqa: E402
from sma_sim.evidence.data.rosbag.salvage import open_bag, repair  # noqa: E402
from sma_sim.evidence.data.rosbag.writer import BagWriter  # noqa: E402
from sma_sim.evidence.data.tables import read_columns  # noqa: E402
from sma_sim.model.errors import UserError  # noqa: E402
from sma_sim.model.structures.module import STRUCTURE as MODULE  # noqa: E402
from sma_sim.ros.bag_names import bag_path, record_of_side  # noqa: E402
from sma_sim.ros.graph_check import type_name  # noqa: E402
from sma_sim.ros.recorder import RecordedTopic, Recorder  # noqa: E402
from sma_sim.ros.robot_recorder import RobotRecorder  # noqa: E402

JOINTS = ((JointState, 'joint_states'),)
KILLS = 3
STAMPED = {type_name(kind): kind for kind in (JointState, Temperature, MarkerArray)}
CHANGES = {'/J_eq_applied', '/T_E_applied'}


def kept_for_late_subscribers(reader):
    """The topics that a bag offers as transient local; all have one reliable profile of limited depth."""
    profiles = {connection.topic: connection.ext.offered_qos_profiles for connection in reader.connections}
    for topic, (profile,) in profiles.items():
        assert (profile.reliability.name, profile.history.name) == ('RELIABLE', 'KEEP_LAST'), topic
        assert profile.deadline.sec == profile.lifespan.sec == 9223372036  # never
    return {topic for topic, (profile,) in profiles.items() if profile.durability.name == 'TRANSIENT_LOCAL'}


def burn(stop):
    while not stop.is_set():
        sum(range(10_000))


def commands(one, values, pause):
    """Send commands some time apart, while the client goes on listening."""
    publisher = one.publisher(Float64, 'J_eq')
    for value in values:
        publisher.publish(Float64(data=value))
        end = time.monotonic() + pause
        one.until(lambda end=end: time.monotonic() > end)


@pytest.mark.slow
@pytest.mark.parametrize('rates', [(1000.0, 100.0), (3000.0, 50.0)])
def test_replays_bit_for_bit_under_load(tmp_path, rates):
    """Every column of the bag, from a node that fights for its processor."""
    stop = multiprocessing.Event()
    load = [multiprocessing.Process(target=burn, args=(stop,), daemon=True) for _ in range(3)]
    words = [
        '-p',
        f'node.record:={tmp_path / "bag"}',
        '-p',
        f'node.integration_rate:={rates[0]}',
        '-p',
        f'node.publish_rate:={rates[1]}',
    ]
    with ros_client.Simulation(*words, topics=JOINTS) as one:
        one.until(lambda: one.seen['joint_states'], ros_client.FIRST_MESSAGE)
        for process in load:
            process.start()
        ambient = one.publisher(Temperature, 'ambient_temperature')
        commands(one, (12.0, -3.0), 0.7)
        ambient.publish(Temperature(temperature=31.7))
        commands(one, (7.1, 0.0, -9.0), 0.7)
        stop.set()
        code, log = one.stop()
        assert code == 0 and 'recorded' in log, log
    for process in load:
        process.join()
    out = tmp_path / 'again.csv'
    words = ['--integration-rate', f'{rates[0]}', '--rate', f'{rates[1]}']
    assert main(['simulate', '--input', str(tmp_path / 'bag'), '--out', str(out), *words]) == 0
    recorded = read_bag(tmp_path / 'bag')
    whole = np.isfinite(recorded['alpha_rad'])
    assert len(set(recorded['J_eq_W'])) >= 5 and len(set(recorded['T_E_K'])) == 2
    again = read_columns(out, tuple(recorded))
    for name, values in recorded.items():
        if not name.startswith('mode'):
            assert np.array_equal(values[whole], again[name]), name
    with Reader(tmp_path / 'bag') as reader:
        assert {'/joint_states', '/J_eq_applied', '/wire_modes', '/markers'} <= set(reader.topics)
        assert kept_for_late_subscribers(reader) == CHANGES


def test_a_bag_has_one_time_base(tmp_path):
    """Stamps are log times, also after a pause, in which the published ones go on; both begin with the logged stamp."""
    path = tmp_path / 'bag'
    with ros_client.Simulation('-p', f'node.record:={path}', '-p', 'node.stamped_topics:=true', topics=JOINTS) as one:
        seen = one.seen['joint_states']
        one.until(lambda: len(seen) > 5, ros_client.FIRST_MESSAGE)
        for paused in (True, False):
            one.ask(SetBool, '/sma_module_sim/pause', SetBool.Request(data=paused))
            end = time.monotonic() + 0.3
            one.until(lambda end=end: time.monotonic() > end)
        count = len(seen)
        one.until(lambda: len(seen) > count + 5)
        code, log = one.stop()
        assert code == 0, log
    bag = open_bag(path)
    stamps = {}
    for message in bag.messages():
        if message.kind in STAMPED:
            decoded = deserialize_message(message.cdr, STAMPED[message.kind])
            for each in getattr(decoded, 'markers', [decoded]):
                stamp = each.header.stamp.sec * 10**9 + each.header.stamp.nanosec
                stamps.setdefault(message.topic, []).append(stamp - message.log_time)
    assert {'/joint_states', '/wire_1/temperature', '/markers', '/wire_forces_stamped'} <= set(stamps)
    assert {lag for lags in stamps.values() for lag in lags} == {0}
    seconds, nanoseconds = re.search(r'simulated time 0 has the stamp ([0-9]+)\.([0-9]+)', log).groups()
    epoch = int(bag.about['epoch'])
    assert epoch == int(seconds) * 10**9 + int(nanoseconds)
    published = [message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec for message in seen]
    recorded = [message.log_time for message in bag.messages({'/joint_states'})]
    assert np.diff(published).max() > 0.2 and set(np.diff(recorded)) == {10_000_000}


def test_killed_while_recording(tmp_path):
    """SIGKILL at random moments: nothing older than a second before is lost."""
    for number in range(KILLS):
        bag = tmp_path / f'bag{number}'
        words = ('-p', f'node.record:={bag}', '-p', 'node.stamps_follow_clock:=false')  # simulated time, as in the bag
        with ros_client.Simulation(*words, topics=JOINTS) as one:
            seen = one.seen['joint_states']
            one.until(lambda seen=seen: seen, ros_client.FIRST_MESSAGE)
            end = time.monotonic() + random.uniform(1.0, 2.5)
            one.until(lambda end=end: time.monotonic() > end)
            one.process.kill()
            one.process.wait()
            last = seen[-1].header.stamp
            first = seen[0].header.stamp
        columns = read_bag(bag)
        lasted = (last.sec - first.sec) + 1e-9 * (last.nanosec - first.nanosec)
        assert columns['time_s'][-1] > lasted - 1.0 and np.diff(columns['time_s']) == pytest.approx(0.01, abs=0.01)
        count = repair(bag, tmp_path / f'fixed{number}')
        with Reader(tmp_path / f'fixed{number}') as reader:
            assert reader.message_count == count
            assert kept_for_late_subscribers(reader) == CHANGES


def test_a_reset_begins_another_bag(tmp_path):
    bag = tmp_path / 'bag'
    with ros_client.Simulation('-p', f'node.record:={bag}', topics=JOINTS) as one:
        one.until(lambda: len(one.seen['joint_states']) > 5, ros_client.FIRST_MESSAGE)
        reset = one.node.create_client(Trigger, '/sma_module_sim/reset')
        one.until(reset.service_is_ready)
        commands(one, (10.0,), 0.5)
        future = reset.call_async(Trigger.Request())
        one.until(future.done)
        count = len(one.seen['joint_states'])
        one.until(lambda: len(one.seen['joint_states']) > count + 5)
        commands(one, (-4.0,), 0.5)
        assert one.stop()[0] == 0
    first, second = read_bag(bag), read_bag(tmp_path / 'bag_1')
    assert open_bag(bag).whole and set(first['J_eq_W']) == {0.0, 10.0} and set(second['J_eq_W']) == {0.0, -4.0}
    assert first['time_s'][0] == second['time_s'][0] == 0.0


@pytest.mark.slow
def test_restarts_with_one_setting_make_a_bag_each(tmp_path):
    """A name that ends in / is the folder of the bags; a reset makes another one, too."""
    for _ in range(2):
        with ros_client.Simulation('-p', f'node.record:={tmp_path}/runs/', topics=JOINTS) as one:
            one.until(lambda: len(one.seen['joint_states']) > 5, ros_client.FIRST_MESSAGE)
            reset = one.node.create_client(Trigger, '/sma_module_sim/reset')
            one.until(reset.service_is_ready)
            one.until(reset.call_async(Trigger.Request()).done)
            code, log = one.stop()
            assert code == 0, log
    bags = sorted((tmp_path / 'runs').iterdir())
    assert len(bags) == 4 and all(open_bag(bag).whole for bag in bags)
    assert all(re.match(r'sma_sim_\d{4}_\d\d_\d\d-\d\d_\d\d_\d\d', bag.name) for bag in bags), bags


def test_names_of_bags(tmp_path):
    now = datetime(2026, 3, 5, 7, 8, 9)
    automatic = bag_path(f'{tmp_path}/', now)
    assert automatic == tmp_path / 'sma_sim_2026_03_05-07_08_09'
    automatic.mkdir()
    assert bag_path(f'{tmp_path}/', now) == tmp_path / 'sma_sim_2026_03_05-07_08_09_1'
    assert bag_path(f'{tmp_path}/run_%Y%m%d_%H%M%S_50%%_50%_heat', now).name == 'run_20260305_070809_50%_50%_heat'
    assert bag_path(f'{tmp_path}/run', now) == tmp_path / 'run'
    (tmp_path / 'run').mkdir()
    assert bag_path(f'{tmp_path}/run', now, after_reset=True) == tmp_path / 'run_1'
    with pytest.raises(UserError, match='exists already .*/run/.*_%Y%m%d_%H%M%S'):
        bag_path(f'{tmp_path}/run', now)
    sides = [record_of_side(record, 'left') for record in ('', 'run1', 'runs/')]
    assert sides == ['', 'run1_left', 'runs/left/']


@pytest.mark.parametrize(
    ('name', 'message'),
    [('taken', 'in that folder at each start'), ('a_file/bag', 'cannot make'), ('x' * 300, 'cannot make')],
)
def test_a_bag_that_cannot_be_made_stops_the_node(tmp_path, name, message):
    (tmp_path / 'taken').mkdir()
    (tmp_path / 'a_file').touch()
    with ros_client.Simulation('-p', f'node.record:={tmp_path / name}') as one:
        log, _ = one.process.communicate(timeout=ros_client.FIRST_MESSAGE)
        assert one.process.returncode == 2 and message in log and 'Traceback' not in log, log


@pytest.mark.slow
def test_a_bag_whose_files_end_and_diagnostics(tmp_path):
    """Files of half a second; the recorder's state is on /diagnostics, also when its folder is gone."""
    topics = (*JOINTS, (DiagnosticArray, '/diagnostics'))
    bag = tmp_path / 'bag'
    with ros_client.Simulation('-p', f'node.record:={bag}', '-p', 'node.record_duration:=0.5', topics=topics) as one:
        one.until(lambda: len(one.seen['joint_states']) > 300, ros_client.FIRST_MESSAGE)
        values = {value.key: value.value for value in one.seen['/diagnostics'][-1].status[0].values}
        assert values['recording'] == 'yes' and values['bag'] == str(bag) and int(values['messages in the bag']) > 1000
        assert len(list(bag.glob('*.mcap'))) >= 5
        shutil.rmtree(bag)
        one.until(lambda: 'recording failed' in one.seen['/diagnostics'][-1].status[0].message)
        count = len(one.seen['joint_states'])
        one.until(lambda: len(one.seen['joint_states']) > count + 50)
        code, log = one.stop()
        assert code == 0 and 'No such file' in log, log


def ask(one, name):
    """Whether a service of the recording succeeds, and what it says."""
    client = one.node.create_client(Trigger, f'/sma_module_sim/record_{name}')
    one.until(client.service_is_ready, ros_client.FIRST_MESSAGE)
    future = client.call_async(Trigger.Request())
    one.until(future.done)
    return future.result().success, future.result().message


def test_a_recording_is_stopped_started_and_split_while_the_node_runs(tmp_path):
    """Each part is a whole bag with the command in force from its start; between two parts no sample is lost."""
    bag = tmp_path / 'bag'
    with ros_client.Simulation('-p', f'node.record:={bag}', topics=JOINTS) as one:
        one.until(lambda: one.seen['joint_states'], ros_client.FIRST_MESSAGE)
        commands(one, (9.0,), 0.3)
        success, message = ask(one, 'start')
        assert not success and f'{bag} is being recorded' in message
        assert ask(one, 'stop') == (True, str(bag)) and open_bag(bag).whole
        assert not any(ask(one, name)[0] for name in ('stop', 'split'))
        assert ask(one, 'start') == (True, str(tmp_path / 'bag_1'))
        commands(one, (4.0,), 0.3)
        assert ask(one, 'split') == (True, str(tmp_path / 'bag_1')) and open_bag(tmp_path / 'bag_1').whole
        commands(one, (), 0.0)
        count = len(one.seen['joint_states'])
        one.until(lambda: len(one.seen['joint_states']) > count + 20)
        assert one.stop()[0] == 0
    first, second, third = (read_bag(tmp_path / name) for name in ('bag', 'bag_1', 'bag_2'))
    assert open_bag(tmp_path / 'bag_2').whole and first['time_s'][0] == 0.0
    assert second['J_eq_W'][0] == 9.0 and second['J_eq_W'][-1] == 4.0 and set(third['J_eq_W']) == {4.0}
    assert second['time_s'][0] > first['time_s'][-1] and third['time_s'][0] >= second['time_s'][-1]
    samples = np.concatenate([part['time_s'][np.isfinite(part['alpha_rad'])] for part in (second, third)])
    assert np.diff(samples) == pytest.approx(0.01, abs=1e-6)


def test_a_recording_that_no_parameter_names_begins_where_the_node_was_started(tmp_path):
    with ros_client.Simulation(topics=JOINTS, folder=tmp_path) as one:
        one.until(lambda: one.seen['joint_states'], ros_client.FIRST_MESSAGE)
        success, message = ask(one, 'start')
        count = len(one.seen['joint_states'])
        one.until(lambda: len(one.seen['joint_states']) > count + 5)
        client = one.node.create_client(Trigger, '/sma_module_sim/record_split')
        one.until(client.service_is_ready)
        future = client.call_async(Trigger.Request())  # while the node ends
        one.executor.spin_once(timeout_sec=0.0)
        code, log = one.stop()
        assert success and code == 0 and 'Traceback' not in log, log
        assert not future.done() or future.result() is not None
    bags = sorted(tmp_path.iterdir())
    assert message == str(bags[0]) and bags[0].name.startswith('sma_sim_2') and all(open_bag(bag).whole for bag in bags)
    assert len(read_bag(bags[0])['time_s']) >= 5


def test_a_reset_whose_bag_cannot_be_made_goes_on_without(tmp_path):
    folder = tmp_path / 'bags'
    topics = (*JOINTS, (DiagnosticArray, '/diagnostics'))
    with ros_client.Simulation('-p', f'node.record:={folder}/bag', topics=topics) as one:
        one.until(lambda: one.seen['joint_states'], ros_client.FIRST_MESSAGE)
        shutil.rmtree(folder)
        folder.touch()
        reset = one.node.create_client(Trigger, '/sma_module_sim/reset')
        one.until(reset.service_is_ready)
        future = reset.call_async(Trigger.Request())
        one.until(future.done)
        told = one.seen['/diagnostics']
        one.until(lambda: told and 'recording failed' in told[-1].status[0].message)
        success, message = ask(one, 'start')
        assert not success and 'cannot make the bag' in message
        code, log = one.stop()
        assert code == 0 and future.result().success and 'the run after the reset is not recorded' in log, log


@pytest.mark.parametrize('method', ['write_metadata', 'add'])
def test_nothing_is_left_of_a_bag_that_cannot_be_begun(tmp_path, monkeypatch, method):
    """Its folder would be in the way of the next try, on a disk that has space again."""

    def fail(*_, **__):
        raise OSError(28, 'No space left on device')

    def begin():
        return Recorder(tmp_path / 'run', [RecordedTopic('/J_eq', type_name(Float64), {})], {}, 0.0, 0.0, print)

    with monkeypatch.context() as full:
        full.setattr(BagWriter, method, fail)
        with pytest.raises(UserError, match='No space left on device'):
            begin()
    assert not (tmp_path / 'run').exists()
    begin().close()
    assert (tmp_path / 'run' / 'metadata.yaml').is_file()


def test_what_is_recorded_of_a_robot_has_its_stamped_commands(tmp_path):
    """It takes them like the others, so that without them a recording would tell of another command."""
    with ros_client.listener(ros_client.any_domain()) as node:
        recorder = RobotRecorder(node, MODULE, (0.0, 0.0))
        recorder.start(tmp_path / 'run')
        topics = {subscription.topic_name for subscription in node.subscriptions}
        recorder.stop()
    assert {'/J_eq', '/J_eq_stamped'} <= topics
