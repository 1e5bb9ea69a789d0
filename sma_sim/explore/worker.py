"""The process that does one job of a session: ``python -m sma_sim.explore.worker FOLDER NUMBER``."""

from __future__ import annotations

import os
import re
import signal
import sys
import threading
import time
import traceback
from pathlib import Path
from typing import Any

from sma_sim.explore.events import EventLog
from sma_sim.explore.jobs import EVENTS, LOCK, STATE, STOP, Job, job_in
from sma_sim.explore.lock import locked_file
from sma_sim.explore.session_files import RECORDINGS
from sma_sim.model.errors import UserError
from sma_sim.words.json_values import write_json

WAIT_FOR_LOCK = 10.0  # [s]: somebody may just be asking whether it is held
LOOK_FOR_STOP = 0.1  # [s]


def main(words: list[str]) -> int:
    """Do a job; how it ended is in its state."""
    session, number = Path(words[0]), int(words[1])
    job = job_in(session, number)
    if job is None:
        raise UserError(f'{session} has no job {number}')
    lock = locked_file(job.folder / LOCK, WAIT_FOR_LOCK)
    if lock is None:
        raise UserError(f'another process does job {number} of {session}')
    signal.signal(signal.SIGINT, signal.default_int_handler)  # it is ignored in what a shell starts in the background
    write_state(job, 'running', '')
    threading.Thread(target=interrupt_when_asked, args=(job.folder / STOP,), daemon=True).start()
    ended = 'stopped', 'stopped at its end'
    try:
        ended = outcome(session, job)
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    except KeyboardInterrupt:  # asked to stop when the work was over: that must not keep its end from being written
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    write_state(job, *ended)
    lock.close()
    return 0 if ended[0] in ('done', 'stopped') else 1


def outcome(session: Path, job: Job) -> tuple[str, str]:
    """Do the work: the state in which it ended, and words."""
    try:
        from sma_sim.explore.work import WORK, WorkOrder  # after the state was written: it imports for a second

        with EventLog(job.folder / EVENTS) as log:
            stopped = WORK[job.stage](WorkOrder(session, job, log))
        return ('stopped', 'stopped: the best so far') if stopped else ('done', 'done')
    except UserError as error:
        return 'failed', of_the_session(str(error), session)
    except KeyboardInterrupt:
        return 'stopped', 'stopped before there was a result'
    except Exception as error:
        traceback.print_exc()
        return 'failed', f'a fault of sma_sim ({type(error).__name__}: {error}), please report it with log.txt'


def of_the_session(words: str, session: Path) -> str:
    """Words without the long way to the copies of files that were chosen on the page."""
    return re.sub(re.escape(f'{session / RECORDINGS}{os.sep}') + r'\d+' + re.escape(os.sep), '', words)


def write_state(job: Job, state: str, words: str) -> None:
    """Say how far the job is, and for how long it has run [s]."""
    content: dict[str, Any] = {'state': state, 'words': words, 'seconds': job.age}
    write_json(job.folder / STATE, content)


def interrupt_when_asked(path: Path) -> None:
    """Interrupt the main thread, as Ctrl-C does, once a file is there."""
    while not path.exists():
        time.sleep(LOOK_FOR_STOP)
    main_thread = threading.main_thread().ident
    if hasattr(signal, 'pthread_kill') and main_thread is not None:
        signal.pthread_kill(main_thread, signal.SIGINT)  # wakes it from waiting
    else:
        signal.raise_signal(signal.SIGINT)


if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))
