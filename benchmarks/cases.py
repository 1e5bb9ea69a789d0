"""Cases of a benchmark: solved several at once, kept in a file as soon as they are, so that a run can be continued."""

from __future__ import annotations

import argparse
import hashlib
import json
import multiprocessing
import os
import signal
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor, wait
from contextlib import contextmanager
from itertools import islice
from math import inf
from pathlib import Path
from typing import Any

from scipy.stats import binomtest

from sma_sim.evidence.estimation.executors import one_thread_for_linear_algebra
from sma_sim.model.errors import UserError

Case = tuple[Any, ...]  # of what JSON can hold
Result = dict[str, Any]  # 'case', and what solving it gave; or 'case' and 'failed', why it could not be solved
Solve = Callable[..., Result]  # of a case's entries and an executor


def add_options(parser: argparse.ArgumentParser, file: str, minutes: float) -> None:
    """What all benchmarks of cases ask."""
    parser.add_argument('--file', type=Path, default=Path(file), help='of finished cases, a line of JSON each')
    parser.add_argument('--minutes', type=float, default=minutes, help='no case starts later; 0: only the table')
    parser.add_argument(
        '--share', type=float, default=1.0, help='of the cases that are run; a larger one has those of a smaller'
    )
    parser.add_argument('--at-once', type=int, default=1, help='cases side by side, each on its share of the cores')


def drawn(cases: Sequence[Case], share: float, group: Callable[[Case], Any] = tuple) -> list[Case]:
    """A share of the cases, in an order that has nothing to do with what they are; those of one group stay together."""
    ordered = sorted(cases, key=lambda case: hashlib.sha256(json.dumps(group(case)).encode()).hexdigest())
    return ordered[: max(1, round(share * len(ordered)))]


def of(count: int, total: int) -> str:
    """A number of cases of all, and the 95 % interval of the share (Wilson)."""
    if not total:
        return '0 of 0'
    low, high = binomtest(count, total).proportion_ci(method='wilson')
    return f'{count} of {total} ({100.0 * low:.0f} to {100.0 * high:.0f} %)'


def held_out(stage: dict[str, Any]) -> float:
    """The normalized RMSE of the held-out run, infinite for a model that cannot make it."""
    return inf if stage['held_out'] is None else float(stage['held_out'])


def kept(file: Path) -> list[Result]:
    """The cases that were solved before."""
    return [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []


def solved(cases: Iterable[Case], solve: Solve, asked: argparse.Namespace, line_of: Callable[[Result], str]) -> list[Result]:
    """All results in the file, after solving what is missing as long as there is time; `line_of` says how one went.

    Ctrl-C ends that: cases that are not finished are given up, and the results are those so far. It is noted here only:
    a KeyboardInterrupt would leave the pool's code anywhere, with locks held that its threads then wait for.
    """
    done, end = kept(asked.file), time.monotonic() + 60.0 * asked.minutes
    known = {key(case['case']) for case in done}
    missing = (case for case in cases if key(case) not in known)
    threads = max(1, (os.cpu_count() or 1) // asked.at_once)
    with interrupts_noted() as interrupts, pool_of_processes(asked.at_once) as pool:
        waiting: set[Future[Result]] = set()
        while not interrupts:
            if time.monotonic() < end:
                free = asked.at_once - len(waiting)
                waiting |= {pool.submit(one_case, solve, case, threads) for case in islice(missing, free)}
            if not waiting:
                return done
            ready, waiting = wait(waiting, timeout=0.5, return_when=FIRST_COMPLETED)
            for case in ready if not interrupts else ():
                done.append(case.result())
                with asked.file.open('a') as file:
                    file.write(json.dumps(done[-1]) + '\n')
                print(line_of(done[-1]) if 'failed' not in done[-1] else done[-1], flush=True)
        for process in multiprocessing.active_children():
            process.terminate()
        return done


@contextmanager
def interrupts_noted() -> Iterator[list[int]]:
    """The interrupts (Ctrl-C) that came meanwhile, instead of a KeyboardInterrupt."""
    noted: list[int] = []
    before = signal.signal(signal.SIGINT, lambda number, frame: noted.append(number))
    try:
        yield noted
    finally:
        signal.signal(signal.SIGINT, before)


def pool_of_processes(count: int) -> ProcessPoolExecutor:
    """Processes that leave Ctrl-C, which a terminal sends to all of them, to the one that has started them."""
    context = multiprocessing.get_context('spawn')
    return ProcessPoolExecutor(count, context, signal.signal, (signal.SIGINT, signal.SIG_IGN))


def one_case(solve: Solve, case: Case, threads: int) -> Result:
    """One case in a process of its own."""
    with one_thread_for_linear_algebra(), ThreadPoolExecutor(threads) as pool:
        return {'case': list(case), **answer(solve, case, pool)}


def answer(solve: Solve, case: Case, pool: Executor) -> Result:
    """What solving it gave; a case that the program refuses is a result too."""
    t_start = time.perf_counter()
    try:
        found = solve(*case, pool)
    except UserError as error:
        found = {'failed': str(error)}
    return {**found, 'seconds': time.perf_counter() - t_start}


def key(case: Iterable[Any]) -> str:
    """What tells cases apart."""
    return json.dumps(list(case))
