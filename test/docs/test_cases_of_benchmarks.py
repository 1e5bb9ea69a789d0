"""Benchmarks of cases can be stopped and continued."""

import os
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).resolve().parents[2] / 'benchmarks'
SCRIPT = """
import argparse
import sys
import time

sys.path.insert(0, {folder!r})
from cases import add_options, solved


def solve(seconds, pool):
    time.sleep(seconds)
    return {{}}


def interrupted_with_locks(first):
    '''Ctrl-C comes again where the main thread has just taken the locks of the futures that it waits for.'''
    import signal
    from concurrent.futures import _base

    take = _base._AcquireFutures.__enter__

    def taken(futures):
        take(futures)
        signal.raise_signal(signal.SIGINT)

    _base._AcquireFutures.__enter__ = taken
    return first


if __name__ == '__main__':
    parser = argparse.ArgumentParser()
    add_options(parser, 'cases.jsonl', 60.0)
    line = interrupted_with_locks if {interrupts_itself} else str
    done = solved([(0.0,), (600.0,)], solve, parser.parse_args(), line)
    print('table of', [one['case'] for one in done], flush=True)
"""


def start(folder, interrupts_itself):
    """A benchmark of two cases, of which the second takes ten minutes, when the first is finished."""
    (folder / 'script.py').write_text(SCRIPT.format(folder=str(BENCHMARKS), interrupts_itself=interrupts_itself))
    running = subprocess.Popen(
        [sys.executable, 'script.py'], cwd=folder, stdout=subprocess.PIPE, text=True, start_new_session=True
    )
    assert running.stdout.readline().startswith("{'case': [0.0]")
    return running


def to_its_group(running):
    """Ctrl-C of a terminal: the processes of the cases get it too."""
    os.killpg(running.pid, signal.SIGINT)


def to_itself_alone(running):
    running.send_signal(signal.SIGINT)


def at_a_bad_time(running):
    """It has interrupted itself."""


@pytest.mark.parametrize('interrupt', [to_its_group, to_itself_alone, at_a_bad_time])
def test_ctrl_c_ends_with_what_there_is(tmp_path, interrupt):
    """The unfinished case is given up, and not kept."""
    running = start(tmp_path, interrupt is at_a_bad_time)
    try:
        interrupt(running)
        assert running.communicate(timeout=100)[0] == 'table of [[0.0]]\n'
    finally:
        with suppress(ProcessLookupError):
            os.killpg(running.pid, signal.SIGKILL)
    assert running.returncode == 0
    assert len((tmp_path / 'cases.jsonl').read_text().splitlines()) == 1
