"""Steps in time: no long garbage collection, no long wait for the interpreter, a real-time priority where asked for."""

from __future__ import annotations

import gc
import inspect
import os
import sys

from sma_sim.model.errors import UserError

SWITCH_INTERVAL = 5e-4  # [s] after which a thread hands over the interpreter; Python's own 5 ms are five steps


def switch_threads_often() -> None:
    """Let the thread that steps have the interpreter at once, while the recorder's or the executor's works."""
    sys.setswitchinterval(SWITCH_INTERVAL)


def freeze_objects() -> None:
    """Keep what the start has made out of all later garbage collections, each of which would take a tenth of a second."""
    gc.collect()
    gc.freeze()


def prepare_logging() -> None:
    """Let `inspect`, by which rclpy finds the caller of a message, look through all modules now: its first time is long."""
    inspect.getmodule(inspect.currentframe())


def use_realtime_priority(priority: int) -> None:
    """Give the calling thread a priority of SCHED_FIFO, 1 to 99; 0 leaves it as it is.

    Raises UserError where the system has no such priorities or doesn't allow this one.
    """
    if priority == 0:
        return
    if not hasattr(os, 'sched_setscheduler'):
        raise UserError(f'node.realtime_priority = {priority}: this system has no SCHED_FIFO; set it to 0')
    try:
        # not for the threads that this one starts, such as the recorder's
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(priority))
    except PermissionError as error:
        raise UserError(
            f'node.realtime_priority = {priority}: the system does not allow it. Allow it with a line such as\n'
            f'  <user>  -  rtprio  {priority}\n'
            'in /etc/security/limits.conf and log in again, or set it to 0'
        ) from error
