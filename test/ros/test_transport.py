"""Programs talk over UDP unless the environment says otherwise: nobody then waits for a listener that was killed."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ros_client = pytest.importorskip('ros_client', reason='rclpy is not installed', exc_type=ImportError)

from sma_sim.ros.transport import late_commands  # noqa: E402

ROOT = Path(__file__).resolve().parents[2]
PROFILES = ('FASTDDS_DEFAULT_PROFILES_FILE', 'FASTRTPS_DEFAULT_PROFILES_FILE')  # that of the tests would decide
PROGRAMS = {  # and what each logs once it has publishers
    'a node': (['-m', 'sma_sim.ros.guard_main'], 'no heating until'),
    'a program that commands': ([str(ROOT / 'examples' / 'controller.py')], 'waiting for joint_states'),
}
of_fast_dds = pytest.mark.skipif(
    'fastrtps' not in ros_client.rclpy.get_rmw_implementation_identifier() or not sys.platform.startswith('linux'),
    reason='looks into /proc for the shared memory of Fast DDS',
)


@of_fast_dds
@pytest.mark.parametrize('says', ['', 'DEFAULT'])
@pytest.mark.parametrize('name', PROGRAMS)
def test_shared_memory_is_used_only_where_the_environment_asks_for_it(name, says):
    words, ready = PROGRAMS[name]
    environment = {one: value for one, value in os.environ.items() if one not in PROFILES}
    environment |= {'PYTHONPATH': str(ROOT), 'ROS_DOMAIN_ID': str(ros_client.any_domain())}
    environment |= {'FASTDDS_BUILTIN_TRANSPORTS': says} if says else {}
    with subprocess.Popen(
        [sys.executable, *words], env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    ) as program:
        try:
            said = ''
            while ready not in said:
                line = program.stdout.readline()
                said += line
                assert line, said
            mapped = Path(f'/proc/{program.pid}/maps').read_text()
        finally:
            program.kill()
    shared = {line.split()[-1] for line in mapped.splitlines() if '/dev/shm/' in line and 'fast' in line}
    assert bool(shared) == bool(says)
    assert ('may use shared memory' in said) == (bool(says) and name == 'a node')


@pytest.mark.parametrize(
    ('environment', 'setting'),
    [
        ({}, ''),
        ({'FASTDDS_BUILTIN_TRANSPORTS': 'UDPv6'}, ''),
        ({'FASTDDS_BUILTIN_TRANSPORTS': 'SHM'}, 'FASTDDS_BUILTIN_TRANSPORTS=SHM'),
        ({'FASTDDS_BUILTIN_TRANSPORTS': 'UDPv4', 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}, 'RANGE=LOCALHOST'),
    ],
)
def test_settings_that_let_commands_wait_are_named(environment, setting):
    said = late_commands(environment)
    assert bool(said) == bool(setting) and setting in said
