"""An executor on a Dask cluster to which large arrays travel once: a fit sends the same recordings with every task.

Dask sends the arguments of a task by way of its scheduler, whatever they are. Arrays that are sent for the second time are
put on a worker instead, and tasks refer to them.
"""

from __future__ import annotations

import io
import pickle
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from importlib import import_module
from itertools import count
from threading import Lock
from typing import Any, ParamSpec, TypeVar
from weakref import ref

import numpy as np

from sma_sim.evidence.estimation.executors import one_thread_for_linear_algebra
from sma_sim.model.errors import UserError

Result = TypeVar('Result')
Given = ParamSpec('Given')
LARGE = 2**13  # [bytes] of an array from which on it is put on a worker: less is sent as fast as what refers to it


class Sender(pickle.Pickler):
    """Pickles a task but for arrays that were `sent` before, by their numbers; those are left in `arrays`."""

    def __init__(self, file: io.BytesIO, sent: dict[int, ref[Any]], forget: Callable[[int], None]) -> None:
        super().__init__(file, pickle.HIGHEST_PROTOCOL)
        self.arrays, self._sent, self._forget = dict[int, Any](), sent, forget

    def persistent_id(self, obj: Any) -> int | None:
        """The number of an array in `arrays`; None for what is pickled."""
        if not isinstance(obj, np.ndarray) or obj.nbytes < LARGE:
            return None
        number, forget = id(obj), self._forget  # not the pickler, which keeps all that it has pickled
        known = self._sent.get(number)
        if known is None or known() is not obj:
            self._sent[number] = ref(obj, lambda _: forget(number))
            return None
        self.arrays[number] = obj
        return number


class Receiver(pickle.Unpickler):
    """Unpickles a task with arrays that are there already, by their numbers."""

    def __init__(self, file: io.BytesIO, arrays: Mapping[int, Any]) -> None:
        super().__init__(file)
        self._arrays = arrays

    def persistent_load(self, pid: Any) -> Any:
        """The array of a number."""
        return self._arrays[pid]


def made(task: bytes, arrays: Mapping[int, Any]) -> Any:
    """What a task makes, on a worker."""
    work, arguments, options = Receiver(io.BytesIO(task), arrays).load()
    with one_thread_for_linear_algebra():  # as beside the client: BLAS threads of several tasks fight over the cores
        return work(*arguments, **options)


class DaskExecutor(Executor):
    """The executor of a Dask client. Methods may be called from any thread."""

    def __init__(self, client: Any) -> None:
        self._client, self._executor = client, client.get_executor(pure=False)
        self._sent, self._lock, self._turn = dict[int, ref[Any]](), Lock(), count()
        self._put = dict[frozenset[int], Any]()  # by arrays that tasks have together, what Dask knows them by

    def submit(self, fn: Callable[Given, Result], /, *args: Given.args, **kwargs: Given.kwargs) -> Future[Result]:
        """As of any executor."""
        with self._lock:
            file = io.BytesIO()
            sender = Sender(file, self._sent, self._forget)
            sender.dump((fn, args, kwargs))
            arrays: Any = sender.arrays and self._on_a_worker(sender.arrays)
        found: Future[Result] = self._executor.submit(made, file.getvalue(), arrays)
        return found

    def _on_a_worker(self, arrays: Mapping[int, Any]) -> Any:
        """All arrays of a task in one piece on one worker, the next in turn: Dask takes a millisecond for each piece."""
        key = frozenset(arrays)
        known = self._put.get(key)
        if known is None:
            workers = sorted(self._client.nthreads())
            to = workers[next(self._turn) % len(workers)]
            (known,) = self._client.scatter([dict(arrays)], workers=[to], hash=False)
            self._put[key] = known
        return known

    def _forget(self, number: int) -> None:
        """An array is gone, and its number may become that of another."""
        self._sent.pop(number, None)
        for key in [key for key in list(self._put) if number in key]:
            self._put.pop(key, None)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """As of any executor; the cluster goes on."""
        self._executor.shutdown(wait=wait, cancel_futures=cancel_futures)
        self._sent.clear()
        self._put.clear()


@contextmanager
def dask_executor(address: str) -> Iterator[Executor]:
    """An executor on the Dask cluster whose scheduler is at `address`, such as ``tcp://host:8786``. Raises UserError."""
    try:
        distributed: Any = import_module('distributed')
    except ImportError as error:
        raise UserError('--scheduler needs Dask: pip install "sma_sim[dask]"') from error
    try:
        client = distributed.Client(address, timeout=5)
    except (OSError, ValueError, TimeoutError) as error:
        raise UserError(f'--scheduler {address}: no Dask scheduler answers there ({error})') from error
    with client:
        yield DaskExecutor(client)
