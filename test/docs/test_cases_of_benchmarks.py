"""Benchmarks of cases can be stopped and continued."""

import signal
import subprocess
import sys
from pathlib import Path

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


if __name__ == '__main__':
    parser = argparse.ArgumentParser()
    add_options(parser, 'cases.jsonl', 60.0)
    done = solved([(0.0,), (600.0,)], solve, parser.parse_args(), lambda one: 'first')
    print('table of', [one['case'] for one in done], flush=True)
"""


def test_ctrl_c_ends_with_what_there_is(tmp_path):
    """The unfinished case is given up, and not kept."""
    (tmp_path / 'script.py').write_text(SCRIPT.format(folder=str(BENCHMARKS)))
    running = subprocess.Popen(
        [sys.executable, 'script.py'], cwd=tmp_path, stdout=subprocess.PIPE, text=True, start_new_session=True
    )
    assert running.stdout.readline() == 'first\n'
    running.send_signal(signal.SIGINT)
    assert running.communicate(timeout=300)[0] == 'table of [[0.0]]\n'
    assert running.returncode == 0
    assert len((tmp_path / 'cases.jsonl').read_text().splitlines()) == 1
