"""Bags: written, cut off anywhere, repaired, read back; those of other recorders; wrong ones."""

import json
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from rosbags.rosbag2 import Reader, StoragePlugin, Writer

from sma_sim import Model, UserError, module_input, simulate
from sma_sim.cli.main import main
from sma_sim.evidence.data.rosbag.interface import FLOAT64, FLOAT64_ARRAY, JOINT_STATE, UINT8_ARRAY
from sma_sim.evidence.data.rosbag.reader import read_bag
from sma_sim.evidence.data.rosbag.run_writer import write_mcap
from sma_sim.evidence.data.rosbag.salvage import open_bag, repair
from sma_sim.evidence.data.rosbag.writer import BagWriter, typestore
from sma_sim.evidence.data.tables import read_columns, write_columns
from sma_sim.solver.inputs import inputs_at

MILLISECOND = 10**6


def number(value):
    return bytes(typestore().serialize_cdr(typestore().types[FLOAT64](data=value), FLOAT64))


def joint_state(nanoseconds, position, names=('U_x', 'U_y', 'alpha')):
    types = typestore().types
    stamp = types['builtin_interfaces/msg/Time'](sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9)
    header = types['std_msgs/msg/Header'](stamp=stamp, frame_id='')
    none = np.zeros(0)
    message = types[JOINT_STATE](header=header, name=list(names), position=np.array(position), velocity=none, effort=none)
    return bytes(typestore().serialize_cdr(message, JOINT_STATE))


def pair(values, kind=FLOAT64_ARRAY):
    types = typestore().types
    layout = types['std_msgs/msg/MultiArrayLayout'](dim=[], data_offset=0)
    dtype = np.uint8 if kind == UINT8_ARRAY else float
    return bytes(typestore().serialize_cdr(types[kind](layout=layout, data=np.array(values, dtype=dtype)), kind))


def fill(bag, count, first=0):
    """Numbers 0, 1, 2, ... at a millisecond's distance."""
    for k in range(first, first + count):
        bag.write(0, k * MILLISECOND, number(float(k)))


def data_of(messages):
    return [typestore().deserialize_cdr(m.cdr, m.kind).data for m in messages]


@pytest.fixture(scope='module')
def run():
    source = module_input([0, 2, 10, 20], [0, 12, -12, 0])
    trajectory = simulate(Model(), source, 20.0)
    return inputs_at(source, trajectory.time) | trajectory.columns


@pytest.mark.parametrize('limits', [{}, {'longest': 100 * MILLISECOND}, {'max_bytes': 5000}])
def test_what_was_written_is_read_by_rosbags(tmp_path, limits):
    bag = BagWriter(tmp_path / 'bag', {'key': 'value'}, **limits)
    bag.add('/J_eq', FLOAT64)
    for first in range(0, 1000, 50):
        fill(bag, 50, first)
        bag.flush()
    bag.close()
    with Reader(tmp_path / 'bag') as reader:
        assert reader.message_count == 1000 and reader.duration == 999 * MILLISECOND + 1
        assert [t for _, t, _ in reader.messages()] == [k * MILLISECOND for k in range(1000)]
        assert reader.topics['/J_eq'].msgtype == FLOAT64
    found = open_bag(tmp_path / 'bag')
    assert found.whole and found.about == {'key': 'value'} and data_of(found.messages()) == list(range(1000))
    files = len(list((tmp_path / 'bag').glob('*.mcap')))
    assert files == (10 if 'longest' in limits else 1) if 'max_bytes' not in limits else files > 2


def test_a_bag_is_never_overwritten(tmp_path):
    (tmp_path / 'bag').mkdir()
    with pytest.raises(UserError, match='exists already'):
        BagWriter(tmp_path / 'bag')
    with pytest.raises(UserError, match='cannot make'):
        BagWriter(tmp_path / 'bag' / 'metadata.yaml' / ('x' * 300))


@pytest.fixture(scope='module')
def unfinished(tmp_path_factory):
    """The bytes of a bag whose writer never came to an end; 40 flushes of 25 messages."""
    path = tmp_path_factory.mktemp('unfinished') / 'bag'
    bag = BagWriter(path, {'epoch': '0'})
    bag.add('/J_eq', FLOAT64)
    for first in range(0, 1000, 25):
        fill(bag, 25, first)
        bag.flush()
    return (path / 'bag_0.mcap').read_bytes(), (path / 'metadata.yaml').read_bytes()


# A record (attachment, 32 bytes) whose data have a size beyond all memory.
HUGE_ATTACHMENT = b'\x09' + (32).to_bytes(8, 'little') + bytes(24) + b'\xff' * 8


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(part=st.floats(0.0, 1.0), noise=st.binary(max_size=40), with_metadata=st.booleans())
@example(part=1.0, noise=HUGE_ATTACHMENT, with_metadata=False)
def test_cut_off_anywhere(unfinished, tmp_path_factory, part, noise, with_metadata):
    """All whole chunks before the cut are there, in order; nothing is invented."""
    content, metadata = unfinished
    path = tmp_path_factory.mktemp('cut') / 'bag'
    path.mkdir()
    cut = int(part * len(content))
    (path / 'bag_0.mcap').write_bytes(content[:cut] + noise)
    if with_metadata:
        (path / 'metadata.yaml').write_bytes(metadata)
    bag = open_bag(path)
    read = data_of(bag.messages())
    assert not bag.whole and read == list(range(len(read))) and len(read) >= 25 * int(40 * part - 2)
    fixed = path.parent / 'fixed'
    if not read:
        with pytest.raises(UserError, match='nothing to repair'):
            repair(path, fixed)
        return
    assert repair(path, fixed) == len(read)
    with Reader(fixed) as reader:
        assert reader.message_count == len(read)
    assert open_bag(fixed).about == {'epoch': '0'}


FULL_DISK = """
import resource, sys
from pathlib import Path
from sma_sim.ros.recorder import RecordedTopic, Recorder
resource.setrlimit(resource.RLIMIT_FSIZE, (300_000, 300_000))
told = []
topics = [RecordedTopic('/J_eq', 'std_msgs/msg/Float64', {})]
one = Recorder(Path(sys.argv[1]), topics, {'epoch': '0'}, 0.0, 0.0, told.append)
import os, time
for k in range(20_000):
    one.write(0, k * 10**6, bytes(4) + os.urandom(8))
    if k % 1000 == 0:
        time.sleep(0.1)
one.close()
print(one.failed, '|', *told)
"""


def test_full_disk(tmp_path):
    """Recording ends with a message, what was written before can be read and repaired."""
    pytest.importorskip('rclpy', reason='rclpy is not installed')
    words = [sys.executable, '-c', FULL_DISK, str(tmp_path / 'bag')]
    done = subprocess.run(words, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0 and 'File too large' in done.stdout and 'bag repair' in done.stdout, done.stderr
    count = sum(1 for _ in open_bag(tmp_path / 'bag').messages())
    assert 100 < count < 20_000
    assert main(['bag', 'repair', str(tmp_path / 'bag')]) == 0
    with Reader(tmp_path / 'bag_repaired') as reader:
        assert reader.message_count == count


def test_round_trip_of_a_run(tmp_path, run, capsys):
    """CSV to mcap to CSV: the same numbers."""
    write_columns(tmp_path / 'run.csv', run)
    assert main(['bag', 'convert', str(tmp_path / 'run.csv'), str(tmp_path / 'run.mcap')]) == 0
    assert main(['bag', 'convert', str(tmp_path / 'run.mcap'), str(tmp_path / 'again.csv')]) == 0
    assert main(['bag', 'info', str(tmp_path / 'run.mcap')]) == 0
    assert '/joint_states' in capsys.readouterr().out
    again = read_columns(tmp_path / 'again.csv', tuple(run))
    for name, values in run.items():
        assert again[name] == pytest.approx(values, rel=1e-12, abs=1e-12), name


def test_simulate_from_a_bag_and_plot(tmp_path, run):
    write_mcap(tmp_path / 'run.mcap', run)
    for source in ('run.mcap', 'run.csv'):
        if source.endswith('csv'):
            write_columns(tmp_path / source, run)
        files = ['--input', str(tmp_path / source), '--out', str(tmp_path / f'{source}.out.csv')]
        assert main(['simulate', *files, '--integration-rate', '1000']) == 0
    assert (tmp_path / 'run.mcap.out.csv').read_bytes() == (tmp_path / 'run.csv.out.csv').read_bytes()
    assert main(['simulate', '--input', str(tmp_path / 'run.mcap'), '--out', str(tmp_path / 'b.mcap')]) == 0
    assert main(['plot', str(tmp_path / 'b.mcap'), '--out', str(tmp_path / 'b.png')]) == 0
    assert (tmp_path / 'b.png').stat().st_size > 10_000


@pytest.mark.parametrize('storage', list(StoragePlugin))
@pytest.mark.parametrize('offset', [0, 1_700_000_000 * 10**9])
def test_a_robots_own_bag(tmp_path, storage, offset):
    """Recorded by another program: stamps of a clock of their own, log times late by some milliseconds."""
    generator = np.random.default_rng(1)
    with Writer(tmp_path / 'bag', version=9, storage_plugin=storage) as writer:
        joints = writer.add_connection('/arm/joint_states', JOINT_STATE, typestore=typestore())
        forces = writer.add_connection('/arm/wire_forces', FLOAT64_ARRAY, typestore=typestore())
        command = writer.add_connection('/arm/J_eq', FLOAT64, typestore=typestore())
        writer.add_connection('/arm/other', FLOAT64, typestore=typestore())
        for k in range(200):
            stamp = 5 * 10**9 + k * 20 * MILLISECOND
            log = stamp + offset + int(generator.uniform(0.2, 1.5) * MILLISECOND)
            state = joint_state(stamp, [0.3 * k, 1e-3 * k, 1e-5 * k], ('alpha', 'U_y', 'U_x'))
            writer.write(joints, log, state)
            writer.write(forces, log + MILLISECOND, pair([10.0 + k, 20.0 + k]))
            if k % 50 == 25:
                writer.write(command, log + 7 * MILLISECOND, number(float(k)))
    columns = read_bag(tmp_path / 'bag')
    whole = np.isfinite(columns['alpha_rad'])
    assert whole.sum() == 200 and np.isfinite(columns['F_1_N'])[whole].all()
    assert columns['time_s'][whole] == pytest.approx(0.02 * np.arange(200), abs=1e-9)
    assert columns['alpha_rad'][whole] == pytest.approx(0.3 * np.arange(200))
    assert columns['F_2_N'][whole] == pytest.approx(20.0 + np.arange(200))
    changes = np.flatnonzero(np.diff(columns['J_eq_W'])) + 1
    assert columns['J_eq_W'][changes] == pytest.approx([25.0, 75.0, 125.0, 175.0])
    assert columns['time_s'][changes] == pytest.approx(0.02 * np.array([25, 75, 125, 175]) + 0.007, abs=2e-3)
    assert 'T_E_K' not in columns and 'T_1_K' not in columns


def test_a_killed_sqlite_recording_is_read_without_its_metadata(tmp_path):
    with Writer(tmp_path / 'bag', version=9) as writer:
        command = writer.add_connection('/J_eq', FLOAT64, typestore=typestore())
        for k in range(10):
            writer.write(command, k * MILLISECOND, number(float(k)))
    (tmp_path / 'bag' / 'metadata.yaml').unlink()
    assert data_of(open_bag(tmp_path / 'bag').messages()) == list(range(10))
    assert repair(tmp_path / 'bag', tmp_path / 'fixed') == 10


def two_modules(path):
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for number_, name in enumerate(('left', 'right')):
            command = writer.add_connection(f'/{name}/J_eq', FLOAT64, typestore=typestore())
            for k in range(10):
                writer.write(command, k * MILLISECOND, number(float(10 * number_ + k)))


def test_several_modules_in_a_bag(tmp_path):
    two_modules(tmp_path / 'bag')
    with pytest.raises(UserError, match='--namespace'):
        read_bag(tmp_path / 'bag')
    with pytest.raises(UserError, match='no module in namespace /top; there is /left, /right'):
        read_bag(tmp_path / 'bag', 'top')
    assert read_bag(tmp_path / 'bag', 'right')['J_eq_W'] == pytest.approx(np.arange(10.0) + 10.0)


def bag_with(path, topic, kind, cdr):
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        writer.write(writer.add_connection(topic, kind, typestore=typestore()), 1, cdr)


WRONG = {
    'nothing there': (lambda p: None, 'no such bag'),
    'an empty folder': (lambda p: p.mkdir(), 'is not a bag'),
    'a text file': (lambda p: p.write_text('hello'), 'is not a bag'),
    'only metadata': (lambda p: (p.mkdir(), (p / 'metadata.yaml').write_text('{}')), 'no file'),
    'no module': (lambda p: bag_with(p, '/chatter', FLOAT64, number(1.0)), 'holds no module'),
    'no command': (lambda p: bag_with(p, '/joint_states', JOINT_STATE, joint_state(1, [1, 2, 3])), 'has no command'),
    'wrong type': (lambda p: bag_with(p, '/J_eq', FLOAT64_ARRAY, pair([1, 2])), 'expected messages of std_msgs/msg/Float64'),
    'short message': (lambda p: bag_with(p, '/J_eq', FLOAT64, b'\0\1\0\0\0'), 'message of 5 bytes is not'),
}


@pytest.mark.parametrize('case', WRONG)
def test_wrong_bags(tmp_path, case):
    make, message = WRONG[case]
    make(tmp_path / 'bag')
    with pytest.raises(UserError, match=message):
        read_bag(tmp_path / 'bag')


def test_parameters_of_the_recording_node_are_used(tmp_path, run, capsys):
    write_mcap(tmp_path / 'plain.mcap', run)
    recorded = {'system': 'module', 'model': 'mas', 'beam.E': 3e9, 'effects.active': ['gravity'], 'effects.gravity.g_y': 5.0}
    about = {'epoch': '0', 'integration_rate': '1000.0', 'parameters': json.dumps(recorded)}
    bag = BagWriter(tmp_path / 'bag', about)
    numbers = {}
    for message in open_bag(tmp_path / 'plain.mcap').messages():
        if message.topic not in numbers:
            numbers[message.topic] = bag.add(message.topic, message.kind)
        bag.write(numbers[message.topic], message.log_time, message.cdr)
    bag.close()
    out = str(tmp_path / 'out.csv')
    assert main(['simulate', '--input', str(tmp_path / 'bag'), '--out', out]) == 0
    assert 'parameters as recorded' in capsys.readouterr().err
    words = ['--model', 'mas', '--set', 'beam.E=3e9', '--effect', 'gravity:g_y=5']
    assert main(['simulate', '--input', str(tmp_path / 'plain.mcap'), '--out', f'{out}.csv', *words]) == 0
    assert (tmp_path / 'out.csv').read_bytes() == (tmp_path / 'out.csv.csv').read_bytes()
