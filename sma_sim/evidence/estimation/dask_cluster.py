"""An executor on a Dask cluster to which large arrays travel once: a fit sends the same recordings with every task.

Dask sends the arguments of a task by way of its scheduler, whatever they are. An array that is sent for the second time is
put on a worker instead, and tasks refer to it.
"""

from __future__ import annotations

import io
import pickle
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from functools import partial
from importlib import import_module
from itertools import count
from threading import Lock
from typing import Any, NamedTuple, ParamSpec, TypeVar
from weakref import ref

import numpy as np

from sma_sim.evidence.estimation.executors import one_thread_for_linear_algebra
from sma_sim.model.errors import UserError

Result = TypeVar('Result')
Given = ParamSpec('Given')
LARGE = 2**13  # [bytes] of an array from which on it is put on a worker: less is sent as fast as what refers to it


class Sent(NamedTuple):
    """An array that was sent, and what Dask knows it by once it is on a worker."""

    array: ref[Any]
    future: Any = None


def forget(sent: dict[int, Sent], key: int, _: object) -> None:
    """An array is gone, and its number may become that of another."""
    sent.pop(key, None)


class Sender(pickle.Pickler):
    """Pickles a task but for arrays that were `sent` before; those are left in `arrays`."""

    def __init__(self, file: io.BytesIO, sent: dict[int, Sent]) -> None:
        super().__init__(file, pickle.HIGHEST_PROTOCOL)
        self.arrays, self._sent = list[Any](), sent

    def persistent_id(self, obj: Any) -> int | None:
        """The place of an array in `arrays`; None for what is pickled."""
        if not isinstance(obj, np.ndarray) or obj.nbytes < LARGE:
            return None
        known = self._sent.get(id(obj))
        if known is None or known.array() is not obj:
            self._sent[id(obj)] = Sent(ref(obj, partial(forget, self._sent, id(obj))))
            return None
        self.arrays.append(obj)
        return len(self.arrays) - 1


class Receiver(pickle.Unpickler):
    """Unpickles a task with arrays that are there already."""

    def __init__(self, file: io.BytesIO, arrays: tuple[Any, ...]) -> None:
        super().__init__(file)
        self._arrays = arrays

    def persistent_load(self, pid: Any) -> Any:
        """The array of a place."""
        return self._arrays[pid]


def made(task: bytes, *arrays: Any) -> Any:
    """What a task makes, on a worker."""
    work, arguments, options = Receiver(io.BytesIO(task), arrays).load()
    with one_thread_for_linear_algebra():  # as beside the client: BLAS threads of several tasks fight over the cores
        return work(*arguments, **options)


class DaskExecutor(Executor):
    """The executor of a Dask client. Methods may be called from any thread."""

    def __init__(self, client: Any) -> None:
        self._client, self._executor = client, client.get_executor(pure=False)
        self._sent, self._lock, self._turn = dict[int, Sent](), Lock(), count()

    def submit(self, fn: Callable[Given, Result], /, *args: Given.args, **kwargs: Given.kwargs) -> Future[Result]:
        """As of any executor."""
        with self._lock:
            file = io.BytesIO()
            sender = Sender(file, self._sent)
            sender.dump((fn, args, kwargs))
            self._put([array for array in sender.arrays if self._sent[id(array)].future is None])
            futures = [self._sent[id(array)].future for array in sender.arrays]
        found: Future[Result] = self._executor.submit(made, file.getvalue(), *futures)
        return found

    def _put(self, arrays: list[Any]) -> None:
        """Put the arrays of one task on one worker, the next in turn."""
        if arrays:
            workers = sorted(self._client.nthreads())
            futures = self._client.scatter(arrays, workers=[workers[next(self._turn) % len(workers)]], hash=False)
            for array, future in zip(arrays, futures, strict=True):
                self._sent[id(array)] = self._sent[id(array)]._replace(future=future)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """As of any executor; the cluster goes on."""
        self._executor.shutdown(wait=wait, cancel_futures=cancel_futures)
        self._sent.clear()


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
