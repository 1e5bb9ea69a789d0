"""What travels to a Dask cluster: large arrays once, whatever is sent beside them."""

from concurrent.futures import Future, ThreadPoolExecutor
from types import SimpleNamespace

import numpy as np

from sma_sim.evidence.estimation.dask_cluster import LARGE, DaskExecutor
from sma_sim.evidence.estimation.executors import in_turn


class Client:
    """A client of two workers that keeps what is sent, and does the work itself."""

    def __init__(self):
        self.put, self.sent = [], []

    def nthreads(self):
        return {'one': 1, 'two': 1}

    def scatter(self, arrays, workers, hash):
        self.put.append((workers, [array.copy() for array in arrays]))
        return self.put[-1][1]

    def get_executor(self, pure):
        return self

    def submit(self, work, task, *arrays):
        self.sent.append((len(task), len(arrays)))
        found = Future()
        found.set_result(work(task, *arrays))
        return found

    def shutdown(self, wait, cancel_futures):
        self.sent.clear()


def total(data, factor):
    return factor * (data.large.sum() + data.other.sum() + data.small.sum())


def test_an_array_is_put_on_a_worker_when_it_is_sent_again():
    client, count = Client(), LARGE // 8
    executor = DaskExecutor(client)
    data = [SimpleNamespace(large=np.full(count, k), other=np.ones((2, count)), small=np.ones(3)) for k in (1.0, 2.0)]
    for factor in (1.0, 2.0, 3.0):
        for k, one in enumerate(data, 1):
            assert executor.submit(total, one, factor=factor).result() == factor * ((k + 2.0) * count + 3.0)
    assert [arrays for _, arrays in client.sent] == [0, 0, 2, 2, 2, 2]
    assert all(size > 3 * LARGE for size, _ in client.sent[:2]) and all(size < LARGE for size, _ in client.sent[2:])
    assert [(workers, len(arrays)) for workers, arrays in client.put] == [(['one'], 2), (['two'], 2)]


def test_a_cluster_gets_several_tasks_together():
    """So few that each worker has two parts, and never many."""
    for tasks, parts in ((3, 3), (24, 4), (23, 4), (200, 13)):
        client = Client()
        assert list(in_turn(DaskExecutor(client), abs, range(-tasks, 0))) == list(range(tasks, 0, -1))
        assert len(client.sent) == parts


def test_an_array_that_takes_the_place_of_another_is_sent_itself():
    client = Client()
    executor = DaskExecutor(client)
    for k in range(20):
        array = np.full(LARGE, float(k))
        assert [executor.submit(np.sum, array).result() for _ in range(2)] == [k * LARGE] * 2
        del array
    executor.shutdown()
    assert not client.sent


def test_tasks_may_come_from_any_thread():
    client, arrays = Client(), [np.full(LARGE, float(k)) for k in range(4)]
    executor = DaskExecutor(client)
    with ThreadPoolExecutor(4) as threads:
        found = list(threads.map(lambda k: executor.submit(np.sum, arrays[k % 4]).result(), range(40)))
    assert found == [k % 4 * LARGE for k in range(40)] and len(client.put) == 4
