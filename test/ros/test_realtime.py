"""What keeps the steps in time: objects of the start out of garbage collections, and a real-time priority."""

import gc
import os
import subprocess
import sys

import pytest
import ros_client
from sensor_msgs.msg import JointState

from sma_sim.model.errors import UserError
from sma_sim.ros.entry import freeze_objects, use_realtime_priority

LOOKED = """
import inspect, sys
from sma_sim.ros.entry import run_node
from sma_sim.ros.main import PROGRAM

class Runner:
    def begin(self, stop): print('modules known at the start:', __file__ in inspect.modulesbyfile)
    def spin(self, stop): pass
    def close(self): pass

sys.exit(run_node(PROGRAM, lambda *_: Runner(), []))
"""  # rclpy asks `inspect` for the caller of each message
FIFO = ('-p', 'node.realtime_priority:=10.0')


def allowed(priority):
    """Whether the system gives a process this priority."""
    code = f'import os; os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param({priority}))'
    return subprocess.run([sys.executable, '-c', code], capture_output=True, check=False).returncode == 0


def test_no_object_of_the_start_is_collected_again():
    try:
        freeze_objects()
        assert gc.get_freeze_count() > 10_000 > len(gc.get_objects())
    finally:
        gc.unfreeze()


def test_the_first_message_does_not_look_through_all_modules_while_steps_wait(tmp_path):
    (tmp_path / 'start.py').write_text(LOOKED)
    done = subprocess.run([sys.executable, tmp_path / 'start.py'], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (0, 'modules known at the start: True\n'), done.stderr


def test_without_a_priority_nothing_changes():
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    use_realtime_priority(0)
    assert (os.sched_getscheduler(0), os.sched_getparam(0)) == before


def test_a_priority_that_is_not_allowed(monkeypatch):
    def refuse(*_):
        raise PermissionError

    monkeypatch.setattr(os, 'sched_setscheduler', refuse)
    with pytest.raises(UserError, match='realtime_priority = 50: .*does not allow(.|\n)*rtprio  50'):
        use_realtime_priority(50)


def test_only_the_thread_that_steps_has_the_priority():
    if not allowed(10):
        pytest.skip('this system allows no SCHED_FIFO')
    with ros_client.Simulation(*FIFO, topics=[(JointState, 'joint_states')]) as one:
        one.until(lambda: one.seen['joint_states'], ros_client.FIRST_MESSAGE)
        threads = {int(name) for name in os.listdir(f'/proc/{one.process.pid}/task')}
        fifo = {thread for thread in threads if os.sched_getscheduler(thread) & ~os.SCHED_RESET_ON_FORK == os.SCHED_FIFO}
        assert fifo == {one.process.pid} and os.sched_getparam(one.process.pid).sched_priority == 10
        code, log = one.stop()
    assert code == 0, log
