"""A long campaign: processor time and memory of a fit by the number of its recordings, one of two hours, and a Dask cluster.

python benchmarks/campaign.py [--largest 200] [--json FILE]
python benchmarks/campaign.py --fit 48 threads          # one of its fits; 'one thread', cluster

Recordings of the module have five channels at 50 Hz: 100 s with 10 random steps of the command each, or one of two hours
with 720. Each is fitted with the parameters that are free by default, from one start, with intervals, in a process of its
own. `data`: what the recordings take; `beyond`: the most that the process took while it fitted, less what it took with the
recordings read. On a cluster of two workers with a thread each the same fit is made once more: `useful` is the processor
time of the fit in one thread over that of all processes of the cluster and its client. `apart`: the same of two processes
at once that have nothing to do with each other, which is what the processors of a machine leave of two at best.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import threading
import time
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np
from common import DURATION, module, random_command, report

from sma_sim import Dataset, FitOptions, Input, Recording, calibrate, module_input, simulate
from sma_sim.challenge.robot import NOISE_STD
from sma_sim.evidence.data.recording import CHANNEL_COLUMNS
from sma_sim.evidence.estimation.dask_cluster import dask_executor

RATE, HOURS, TRUTH, RTOL = 50.0, 2.0, {'wire.lambda': 430.0, 'beam.E': 2.1e9}, 1e-5
OPTIONS = FitOptions(kinetics='hybrid', starts=1)
EVERY = 0.02  # [s] between two looks at the memory
KINDS = ('threads', 'one thread', 'cluster')


def campaign(runs: int) -> Dataset:
    """So many recordings of 100 s; one of two hours for 0."""
    model = type(module('hybrid', RTOL))(module('hybrid', RTOL).config.variant(TRUTH))
    random, found = np.random.default_rng(0), []
    for k, command in enumerate([long_command(random)] if runs == 0 else map(random_command, range(runs))):
        times = np.arange(0.0, command.times[-1], 1.0 / RATE)
        shown = simulate(model, command, times, channels=tuple(NOISE_STD))
        channels = {
            name: shown[CHANNEL_COLUMNS[name]] + std * random.standard_normal(len(times)) for name, std in NOISE_STD.items()
        }
        found.append(Recording(f'run{k}', 'module', times, channels, command))
    return Dataset(tuple(found), NOISE_STD)


def long_command(random: np.random.Generator) -> Input:
    """Two hours with as many random steps as recordings of 100 s have."""
    steps = int(HOURS * 3600.0 / DURATION * 10)
    times = np.r_[0.0, np.sort(random.uniform(0.0, HOURS * 3600.0, steps - 1)), HOURS * 3600.0]
    return module_input(times.tolist(), random.uniform(-15.0, 15.0, steps + 1).tolist())


def memory() -> float:
    """Resident memory of this process [MB]."""
    return int(Path('/proc/self/statm').read_text().split()[1]) * os.sysconf('SC_PAGE_SIZE') / 1e6


def processor(pids: list[int]) -> float:
    """Processor time of processes [s]."""
    stats = (Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split() for pid in pids)
    return sum(int(stat[11]) + int(stat[12]) for stat in stats) / os.sysconf('SC_CLK_TCK')


class Watch:
    """The most memory that the process takes while it watches [MB]."""

    def __init__(self) -> None:
        self.most, self._done = memory(), threading.Event()
        self._thread = threading.Thread(target=self._look)
        self._thread.start()

    def _look(self) -> None:
        while not self._done.wait(EVERY):
            self.most = max(self.most, memory())

    def end(self) -> float:
        """What was the most."""
        self._done.set()
        self._thread.join()
        return self.most


def fitted(runs: int, kind: str) -> dict[str, Any]:
    """Time and memory of a fit, and the value of a parameter."""
    calibrate(campaign(2), module('hybrid', RTOL).config, OPTIONS)  # compiles
    dataset = campaign(runs)
    if kind == 'cluster':
        return on_cluster(dataset)
    with nullcontext() if kind == 'threads' else ThreadPoolExecutor(1) as executor:
        return measured(dataset, executor, [os.getpid()])


def on_cluster(dataset: Dataset) -> dict[str, Any]:
    """The same by a Dask cluster of two workers with a thread each."""
    import distributed

    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None) as cluster,
        dask_executor(cluster.scheduler_address) as executor,
    ):
        calibrate(campaign(4), module('hybrid', RTOL).config, OPTIONS, executor)  # loads the code
        return measured(dataset, executor, [os.getpid(), *(worker.pid for worker in cluster.workers.values())])


def measured(dataset: Dataset, executor: Executor | None, pids: list[int]) -> dict[str, Any]:
    """A fit with its processor time and memory."""
    before, watch, begin = memory(), Watch(), (processor(pids), time.perf_counter())
    found = calibrate(dataset, module('hybrid', RTOL).config, OPTIONS, executor)
    seconds, wall = processor(pids) - begin[0], time.perf_counter() - begin[1]
    size = sum(8 * len(run.time) * (1 + len(run.channels)) for run in dataset.recordings) / 1e6
    return {
        'processor_s': seconds,
        'wall_s': wall,
        'data_MB': size,
        'beyond_MB': watch.end() - before,
        'iterations': found.iterations,
        'lambda': found.values['wire.lambda'],
    }


def apart(runs: int, kind: str) -> dict[str, Any]:
    """The same in a process of its own."""
    words = [sys.executable, __file__, '--fit', str(runs), kind]
    made = subprocess.run(words, check=True, capture_output=True, text=True)
    found: dict[str, Any] = json.loads(made.stdout.splitlines()[-1])
    return found


def measure(arguments: argparse.Namespace) -> dict[str, Any]:
    """All numbers."""
    counts = [arguments.largest // 4, arguments.largest // 2, arguments.largest]
    rows = {f'{count} recordings of 100 s': apart(count, 'threads') for count in counts}
    rows[f'one of {HOURS:g} h'] = apart(0, 'threads')
    kinds = {kind: apart(counts[1], kind) for kind in KINDS[1:]}
    with ThreadPoolExecutor(2) as both:
        kinds['two apart'] = max(both.map(apart, [counts[1]] * 2, [KINDS[1]] * 2), key=lambda one: float(one['processor_s']))
    shares = {
        name: kinds['one thread']['processor_s'] / kinds[kind]['processor_s']
        for name, kind in (('useful', 'cluster'), ('apart', 'two apart'))
    }
    return {'a fit': rows, f'{counts[1]} recordings': kinds, 'cluster': shares}


if __name__ == '__main__':
    if sys.argv[1:2] == ['--fit']:
        print(json.dumps(fitted(int(sys.argv[2]), sys.argv[3])))
    else:
        report(__doc__ or '', measure, largest=200)
