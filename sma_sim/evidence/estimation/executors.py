"""Work that is spread over threads, processes or a cluster through a `concurrent.futures.Executor`."""

from __future__ import annotations

import os
import pickle
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor, wait
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from dataclasses import dataclass, field, replace
from functools import cache, lru_cache
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeVar

from sma_sim.evidence.estimation.search_context import Stop
from sma_sim.model.config import Config, folders_of
from sma_sim.model.effects.discovery import ActiveEffect, effects_on, find_effects
from sma_sim.model.errors import UserError
from sma_sim.model.structures.discovery import find_structures
from sma_sim.solver.model import Model

Result = TypeVar('Result')
Task = TypeVar('Task')
Factors = tuple[tuple[str, float], ...]  # by parameter
# Parts of a campaign that a worker of a cluster gets, so that none waits long for another in the end; and the most
# recordings of one, which is a large message when it is sent for the first time
PARTS, MOST_TOGETHER = 2, 16
RECENT = 256  # configurations that a worker keeps: those of a point, beside it, and at both ends of all intervals


@dataclass(frozen=True)
class PickledConfig:
    """A configuration that can be sent to another process: effects travel by name, not as functions."""

    config: Config
    _models: dict[tuple[str, float, Factors], Model] = field(default_factory=dict, init=False, repr=False, compare=False)

    def model(self, bench: str, looser: float = 1.0, factors: Factors = ()) -> Model:
        """The model on a bench, at so many times its solver.rtol, with some parameters multiplied: one for all runs."""
        if (bench, looser, factors) not in self._models:
            tolerance = {'solver.rtol': looser} if looser != 1.0 else {}
            self._models[bench, looser, factors] = Model(self.config.on_bench(bench).scaled({**dict(factors), **tolerance}))
        return self._models[bench, looser, factors]

    def __reduce__(self) -> tuple[Any, ...]:
        config = self.config
        files = [file for active in config.effects for file in active.effect.files]
        folders = sorted({str(file.parent) for file in files})
        changed = [file.stat().st_mtime_ns for file in (*files, *config.structure.files)]
        effects = [(active.effect.name, active.values) for active in config.effects]
        kind = config.system, config.kinetics, folders_of(config.structure)
        return unpickled_config, (pickle.dumps((dict(config.parameters), kind, effects, folders, changed)),)


@lru_cache(RECENT)
def unpickled_config(pickled: bytes) -> PickledConfig:
    """The configuration in the other process: one for all runs of a campaign, so that its models are made once.

    What is pickled has the times at which its files changed last too, so that one that was edited is read again.
    """
    parameters, (system, model, homes), effects, folders, _ = pickle.loads(pickled)
    own = find_structures([Path(home) for home in homes])[system] if homes else None
    config = Config(MappingProxyType(parameters), system, model, own_structure=own)
    if effects:
        found, names = find_effects([Path(folder) for folder in folders]), [name for name, _ in effects]
        found = effects_on(found, names, config.structure, parameters)
        config = replace(config, effects=tuple(ActiveEffect(found[name], values) for name, values in effects))
    return PickledConfig(config)


def is_cluster(executor: Executor) -> bool:
    """Whether tasks of an executor travel to a Dask cluster."""
    return getattr(executor, '_client', None) is not None


def workers_of(executor: Executor) -> int:
    """How many tasks an executor runs at once, as far as it tells."""
    client = getattr(executor, '_client', None)
    if client is not None:
        return max(1, sum(int(threads) for threads in client.nthreads().values()))
    most: object = getattr(executor, '_max_workers', None)
    return most if isinstance(most, int) else os.cpu_count() or 1


def in_turn(executor: Executor, work: Callable[[Task], Result], tasks: Sequence[Task]) -> Iterator[Result]:
    """What `work` makes of each task, in their order, where only some more than the workers have are under way at once.

    So results that are reduced as they come do not fill the memory, however many tasks there are. A cluster, which takes
    milliseconds each time, gets several tasks together: so few that every worker has PARTS of such parts.
    """
    under_way, workers = deque[Future[list[Result]]](), workers_of(executor)
    size = min(max(1, -(-len(tasks) // (PARTS * workers))), MOST_TOGETHER) if is_cluster(executor) else 1
    for first in range(0, len(tasks), size):
        under_way.append(executor.submit(together, work, tasks[first : first + size]))
        if len(under_way) >= 2 * workers:
            yield from under_way.popleft().result()
    while under_way:
        yield from under_way.popleft().result()


def together(work: Callable[[Task], Result], tasks: Sequence[Task]) -> list[Result]:
    """What `work` makes of each of some tasks."""
    return [work(task) for task in tasks]


def one_thread_for_linear_algebra() -> AbstractContextManager[object]:
    """A context in which BLAS starts no threads of its own, where threadpoolctl is installed."""
    known = linear_algebra()
    if known is None:
        return nullcontext()
    limits: AbstractContextManager[object] = known.limit(limits=1, user_api='blas')
    return limits


@cache
def linear_algebra() -> Any | None:
    """What sets the threads of BLAS, which takes a millisecond to find; None without threadpoolctl."""
    with suppress(ModuleNotFoundError):
        import scipy.linalg  # noqa: F401  # which has a BLAS of its own
        from threadpoolctl import ThreadpoolController

        return ThreadpoolController()
    return None


@contextmanager
def executor_or_threads(executor: Executor | None) -> Iterator[Executor]:
    """The given executor, or threads on all cores (compiled runs release the interpreter lock).

    Linear algebra then keeps to the thread that asks for it, which the given executor's may be too: a second set of threads
    would fight with these over the cores, and take several times the processor time of all runs. Without threadpoolctl, for
    which rosdep has no key, it does not, and only time is lost.
    """
    with one_thread_for_linear_algebra():
        if executor is not None:
            try:
                executor.submit(int)
            except RuntimeError as error:
                raise UserError(f'executor: {error}; expected one that has not been shut down') from error
            yield executor
            return
        with ThreadPoolExecutor(os.cpu_count()) as threads:
            yield threads


def run_in_threads(jobs: Sequence[Callable[[], Result]], stop: Stop, at_once: int | None = None) -> list[Result]:
    """The answers of jobs that run in threads of their own (so many at once); Ctrl-C asks them to come to an end."""
    if not jobs:
        return []
    with ThreadPoolExecutor(at_once or len(jobs)) as threads:
        futures = [threads.submit(job) for job in jobs]
        try:
            wait(futures)
        except KeyboardInterrupt:
            stop.set()
        return [future.result() for future in futures]
