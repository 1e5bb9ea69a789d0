"""The page of `sma-sim explore` in a real browser: from a slider's move to the drawn curves, the first page, memory.

python benchmarks/explore.py [--moves 300] [--repeats 1000] [--minutes 0] [--json FILE]

Three recordings of 100 s with five channels of 5,000 samples each, made by the simulator, are beside the model. It needs
chromium, chromedriver and selenium (the `test` extra). With --minutes 60 the page then stays open for an hour, in
which one slider moves every ten seconds.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from common import report

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'test'))

from browser import open_browser
from measured_runs import CHANNELS, truth, write_run

from sma_sim import module_input
from sma_sim.words.json_values import write_json

RUNS, SECONDS, RATE = 3, 100.0, 50.0
SLIDERS = ('wire.sigma_T', 'wire.lambda', 'beam.E', 'wire.eps_T', 'wire.dsigma')
# A move, and the time until the page has drawn what it asked for: the frame after that is on the screen.
MOVE = """
const [name, step, done] = arguments, slider = document.querySelector(`[data-name="${name}"] input[type=range]`);
const drawn = smaExplore.drawn, begin = performance.now();
slider.value = step;
slider.dispatchEvent(new Event('input'));
const shown = () => requestAnimationFrame(() => done(performance.now() - begin));
const look = () => (smaExplore.drawn > drawn ? shown() : setTimeout(look, 1));
look();
"""


def write_runs(folder: Path) -> None:
    """The recordings: random steps of the command."""
    for k in range(RUNS):
        random = np.random.default_rng(10 + k)
        times = np.round(np.sort(random.uniform(0.5, SECONDS - 4.0, 5)), 2)
        source = module_input([0.0, *times, SECONDS], [*random.uniform(-14.0, 14.0, 6), 0.0])
        write_run(folder / f'run{k + 1}.csv', truth(effects=['gravity']), source, RATE, seed=k)
    write_json(folder / 'meta.json', {'noise_std': {name: CHANNELS[name] for name in list(CHANNELS)[:5]}})


def memory_of(pid: int) -> float:
    """Resident memory of a process and all that it has started [MB]."""
    found = 0.0
    for path in (Path('/proc') / str(pid)).glob('task/*/children'):
        found += sum(memory_of(int(child)) for child in path.read_text().split())
    lines = (Path('/proc') / str(pid) / 'status').read_text().splitlines()
    return found + sum(float(line.split()[1]) / 1024.0 for line in lines if line.startswith('VmRSS'))


def processor_of(pid: int) -> float:
    """Processor time of a process and of all that it has started [s]."""
    found = 0.0
    for path in (Path('/proc') / str(pid)).glob('task/*/children'):
        found += sum(processor_of(int(child)) for child in path.read_text().split())
    words = (Path('/proc') / str(pid) / 'stat').read_text().rpartition(')')[2].split()
    return found + sum(map(int, words[11:15])) / os.sysconf('SC_CLK_TCK')


def until(browser: Any, script: str, longest: float = 300.0) -> None:
    """Wait until a script is true."""
    end = time.monotonic() + longest
    while not browser.execute_script(f'return {script}'):
        if time.monotonic() > end:
            raise TimeoutError(script)
        time.sleep(0.02)


def opened(browser: Any, folder: Path, *words: str) -> tuple[subprocess.Popen[str], float]:
    """The program with its first page drawn, and the time from its start to that [s]."""
    begin = time.perf_counter()
    command = [sys.executable, '-m', 'sma_sim.cli.main', 'explore', '--no-browser', '--session', str(folder), *words]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    assert process.stdout is not None
    browser.get(process.stdout.readline().split()[-1])
    until(browser, 'window.smaExplore !== undefined && smaExplore.ready')
    return process, time.perf_counter() - begin


def moved(browser: Any, moves: int) -> list[float]:
    """Durations from moves of sliders to the drawn curves [ms]."""
    browser.set_script_timeout(60)
    random = np.random.default_rng(0)
    found = []
    for k in range(moves):
        name = SLIDERS[k % len(SLIDERS)]
        found.append(browser.execute_async_script(MOVE, name, int(random.integers(300, 700))))
        if k % len(SLIDERS) == len(SLIDERS) - 1:
            browser.execute_script('smaExplore.values = {}')
    return found


def take(browser: Any, stage: str) -> None:
    """Take a step by its button, and wait for its end."""
    until(browser, f'document.querySelector("[data-begin={stage}]") !== null')
    browser.execute_script(f'document.querySelector("[data-begin={stage}]").click()')
    job = 'candidates' if stage == 'candidates' else f'stages.find((one) => one.stage === "{stage}").job'
    until(browser, f'smaExplore.state.steps.{job}?.state === "done"')


def heap(browser: Any) -> float:
    """Memory of the page's script after a collection [MB]."""
    browser.execute_cdp_cmd('HeapProfiler.collectGarbage', {})
    return float(browser.execute_script('return performance.memory.usedJSHeapSize')) / 1e6


def measure(arguments: argparse.Namespace) -> dict[str, Any]:
    """Latency of both views, the first page, memory of program and page."""
    rows: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / 'data').mkdir()
        write_runs(folder / 'data')
        browser = open_browser(1500, 950)
        try:
            warm, _ = opened(browser, folder / 'warm')
            warm.terminate()
            process, first = opened(browser, folder / 'session', str(folder / 'data'))
            rows['first page'] = {'s': first}
            try:
                rows |= measured_session(browser, process.pid, arguments)
            finally:
                process.terminate()
                process.wait()
        finally:
            browser.quit()
    return rows


def measured_session(browser: Any, pid: int, arguments: argparse.Namespace) -> dict[str, Any]:
    """Latency and memory of an open session."""
    rows: dict[str, Any] = {}
    seconds, before = {}, processor_of(pid)
    for stage in ('check', 'compare', 'candidates'):
        begin = time.perf_counter()
        take(browser, stage)
        after = processor_of(pid)
        seconds[stage] = {'wall_s': time.perf_counter() - begin, 'processor_s': after - before}
        before = after
    rows['steps'] = seconds
    browser.execute_script('document.getElementById("tab-parameters").click()')
    for view, words in (('model', 'the model alone'), ('data', 'beside three recordings of 5,000 samples and 5 channels')):
        browser.execute_script(
            f'document.getElementById("view-{view}").click(); document.getElementById("tab-parameters").click()'
        )
        until(browser, f'smaExplore.view === "{view}"')
        moved(browser, 20)
        times = moved(browser, arguments.moves)
        rows[f'slider to curves, {words}'] = dict(
            zip(('median_ms', 'p95_ms', 'largest_ms'), map(float, np.percentile(times, [50, 95, 100])), strict=True)
        )
    before = memory_of(pid), heap(browser)
    moved(browser, arguments.repeats)
    after = memory_of(pid), heap(browser)
    rows[f'memory over {arguments.repeats} moves'] = {
        'program_before_MB': before[0],
        'program_after_MB': after[0],
        'page_before_MB': before[1],
        'page_after_MB': after[1],
    }
    if arguments.minutes:
        rows['memory while it is open'] = memory_while_open(browser, pid, arguments.minutes)
    return rows


def memory_while_open(browser: Any, pid: int, minutes: int) -> dict[str, dict[str, float]]:
    """Memory of program and page every five minutes, while a slider moves every ten seconds."""
    rows, begin = {}, time.monotonic()
    for minute in range(0, minutes + 1, 5):
        while time.monotonic() < begin + 60.0 * minute:
            moved(browser, 1)
            time.sleep(10.0)
        rows[f'after {minute} minutes'] = {'program_MB': memory_of(pid), 'page_MB': heap(browser)}
    return rows


if __name__ == '__main__':
    report('explore in a browser', measure, moves=300, repeats=1000, minutes=0)
