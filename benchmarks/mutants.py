"""How many small random faults in solver, model and estimation the quick tests notice.

    pip install coverage
    python benchmarks/mutants.py --count 200 --jobs 2 --file mutants.jsonl

Which test runs which line, and for how long, is measured once without a fault and kept beside the results: for files of
model and solver as plain Python (NUMBA_DISABLE_JIT), where coverage sees the kernels. A mutant then runs the tests that
come to its statement, the shortest first, until one fails or `--budget` seconds of them are over; where the statement
runs while the file is imported, the tests that come to the file, to a file that imports it, or name it. They run in a
fork of one process that has imported numba and SciPy, in a copy of the tree. Results are appended to the file, and what
it holds already is not run again. A second run with `--native` takes those of model and solver that survived as plain
Python to native code.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from math import inf
from pathlib import Path
from types import FrameType
from typing import Any

import matplotlib.pyplot  # noqa: F401  imported here, once for all forks
import numba
import pytest
import scipy.optimize
import scipy.stats  # noqa: F401
from coverage import Coverage, CoverageData
from mutations import Mutant, drawn, imports

ROOT = Path(__file__).resolve().parents[1]
ESTIMATION = 'sma_sim/evidence/estimation'
ROOMS = ('sma_sim/solver', 'sma_sim/model', ESTIMATION)
PLAIN, NATIVE, FITS = 'plain', 'native', 'fits'  # how tests run: as plain Python, as native code, those of estimation
TESTS = {
    PLAIN: '''
        closed_forms effect_equations material paper_equations effects conservation energy order solver messages
        init optional_packages fields_read structures own_structures effects_on_structures scopes stack
        robot_description drawing step_equations docs stalls tangents series sampled_channels beyond_the_module
        step_control structure_parts events runs_in_pieces untrusted_data flow_parts short_tangents
        solver_parts compile paper_parts single_steps ends_and_starts prediction dense_commands side_by_side
    ''',
    NATIVE: '''
        solver order conservation energy hard_cases effects_module effects_wire memory effects live reference
        interpreted closed_forms effect_equations compile stalls fields_read sampled_channels material
        paper_equations structures own_structures effects_on_structures stack messages init plot packaging paper
        untrusted_data optional_packages robot_description recordings scopes runs_in_pieces step_equations docs
        tangents series beyond_the_module structure_runs drawing trajectory step_control structure_parts
        events bench flow_parts short_tangents solver_parts paper_parts single_steps ends_and_starts
    ''',
    FITS: '''
        fit_parts jitter noise uncertainty calibrate many_runs fit_command paper_calibration compare run_estimates
        plausibility repeatability scopes characterization bench nuisances further_channels residuals resistance
        tangents verdict_text estimation_parts differing_recordings latent next variants recordings
        beyond_the_module inseparable diagnose_data minimization fit_statistics curve_features recordings_in_fits
        runs_left_out priors imposed covariance honest_intervals smoothed_commands materials
        notebook_api
    ''',
}
# Runs that take long as plain Python.
SLOW_AS_PYTHON = '''
    over_a_run over_random_runs second_law_over does_not_jump jumps_keep leaves_out random_commands
    runs_in_every_system sensor_lag accumulates edited convection_cools wrong_effect_files order_of samples_between
    measured_order follows_the between_steps converge_with to_and_fro hours pulses switching_ends ringing many_steps
    keeps_its_order is_continued radau random_runs
'''
LONGEST, MAX_FILE = 10.0, 40.0  # [s] of a test that mutants run, and of all tests of a file, with coverage
OF_DECLARATIONS = 'test_parameters_are_those_of_the_declarations'  # reads what every file declares
MAX_WAITING = 2.0  # times its processor time, which a mutant may take on the clock
CODES = {0: 'survived', 1: 'killed', 2: 'killed', 5: 'not covered'}


class Recorder:
    """A plugin of pytest that notes the tests that pass, how long each one takes, and which lines it runs.

    One that takes longer than LONGEST of processor time is stopped, and fails.
    """

    def __init__(self, times: Path, coverage: Coverage) -> None:
        """`times` gets a line of JSON for each test."""
        self.end = time.process_time() + MAX_FILE
        self.times, self.coverage, self.failed = times, coverage, set[str]()
        self.runs = False
        signal.signal(signal.SIGPROF, self.stop_test)

    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        """In an order of its own, so that those that are left out when the time is over are any."""
        random.Random(1).shuffle(items)

    @pytest.hookimpl(hookwrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        """Around each test, with its fixtures."""
        self.coverage.switch_context(item.nodeid)
        begin = time.process_time()
        yield
        self.coverage.switch_context('')
        if item.nodeid not in self.failed:
            with self.times.open('a') as out:
                out.write(json.dumps({'test': item.nodeid, 'cpu': time.process_time() - begin}) + '\n')
        if time.process_time() > self.end:
            item.session.shouldstop = f'{MAX_FILE} s are over'

    @pytest.hookimpl(hookwrapper=True)
    def pytest_pyfunc_call(self) -> Iterator[None]:
        """Around what a test does, without its fixtures."""
        signal.setitimer(signal.ITIMER_PROF, LONGEST, 1.0)  # again: an exception in a call from native code is lost
        self.runs = True
        try:
            yield
        finally:
            self.runs = False
            signal.setitimer(signal.ITIMER_PROF, 0.0)

    def stop_test(self, _: int, frame: FrameType | None) -> None:
        """Make a test fail that takes too long; not while coverage or pytest are at work."""
        file = frame.f_code.co_filename if frame else '/pluggy/'
        if self.runs and not any(name in file for name in ('/coverage/', 'pytest', '/pluggy/')):
            raise TimeoutError(f'takes more than {LONGEST} s')

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Tests that fail, or are skipped, without a fault tell nothing."""
        if report.outcome != 'passed':
            self.failed.add(report.nodeid)


@dataclass(frozen=True)
class Reach:
    """Which tests come to which line of each file, and how long each test takes [s]."""

    lines: Mapping[str, Mapping[int, frozenset[str]]]
    seconds: Mapping[str, float]

    def tests_of(self, mutant: Mutant, budget: float) -> list[str]:
        """The tests to run: those that come to the statement, the shortest first."""
        lines = self.lines.get(mutant.path, {})
        own = set().union(*(lines.get(k, frozenset()) for k in range(mutant.first, mutant.last + 1)))
        first, reached = set[str](), own
        if not own or mutant.is_outer((ROOT / mutant.path).read_text()):  # it runs while the file is imported
            first = {name for name in self.seconds if name.endswith(OF_DECLARATIONS)}
            reached = first | own | self.naming(mutant.path) | self.of_import(mutant.path)
        chosen, total = [], 0.0
        order = {name: (name not in first, name not in own, self.seconds[name]) for name in reached & self.seconds.keys()}
        for name in sorted(order, key=order.__getitem__):
            total += self.seconds[name]
            if chosen and total > budget:
                break
            chosen.append(name)
        return chosen

    def naming(self, path: str) -> set[str]:
        """Tests of the files that name a file, or that it names."""
        stem = Path(path).stem
        files = {test.partition('::')[0] for test in self.seconds}
        naming = {file for file in files if stem in file or stem in (ROOT / file).read_text()}
        return {test for test in self.seconds if test.partition('::')[0] in naming}

    def of_import(self, path: str) -> set[str]:
        """Tests that come to a file or to one that imports it, else to one that imports those, and so on."""
        files, known, found = {path}, set[str](), set[str]()
        while files and not found:
            known |= files
            files = {user for user, used in imports(ROOT).items() if used & files} - known
            found = set().union(*(tests for file in known | files for tests in self.lines.get(file, {}).values()))
        return found


def reach_in(folder: Path, way: str) -> Reach:
    """What was measured without a fault."""
    data = CoverageData(str(folder / f'{way}.coverage'))
    data.read()
    lines: dict[str, dict[int, frozenset[str]]] = {}
    for file in data.measured_files():
        name = file[file.rindex('/sma_sim/') + 1 :] if '/sma_sim/' in file else ''
        if name:
            found = lines.setdefault(name, {})  # a file may have been measured in several trees
            for line, tests in data.contexts_by_lineno(file).items():
                found[line] = found.get(line, frozenset()) | (frozenset(tests) - {''})
    rows = map(json.loads, (folder / f'{way}.times.jsonl').read_text().splitlines())
    return Reach(lines, {row['test']: row['cpu'] for row in rows})


def way_of(mutant: Mutant, native: bool) -> str:
    """How the tests of a mutant run."""
    return FITS if mutant.path.startswith(ESTIMATION) else NATIVE if native else PLAIN


def words_of(way: str, root: Path) -> list[str]:
    """Arguments of pytest that name all tests that may run this way."""
    files = [
        str(file.relative_to(root)) for name in TESTS[way].split() for file in (root / 'test').glob(f'*/test_{name}.py')
    ]
    return [*files, '-k', f'not ({" or ".join(SLOW_AS_PYTHON.split())})'] if way == PLAIN else files


def copied(folder: Path) -> Path:
    """The tree as git knows it, in a folder of its own."""
    listing = ['git', 'ls-files', '-co', '--exclude-standard']
    files = subprocess.run(listing, cwd=ROOT, capture_output=True, text=True, check=True)
    for name in files.stdout.splitlines():
        if (ROOT / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, folder / name)
    return folder


class Fork:
    """A process that runs tests in a tree; a mutant's native code goes to a cache of its own, which ends with it."""

    def __init__(self, tree: Path, way: str, words: Sequence[str], record: Path | None = None, limit: float = 0.0) -> None:
        """`record`: measure the reach of tests into this folder. `limit`: most processor time [s], 0 for no limit."""
        self.log = Path(tempfile.mkstemp(suffix='.log')[1])
        self.cache = Path(tempfile.mkdtemp()) if way == NATIVE and record is None else None
        self.begin = time.monotonic()
        self.end = self.begin + MAX_WAITING * limit if limit else inf
        self.process = os.fork()
        if not self.process:
            code = 3
            try:
                code = self.run(tree, way, words, record, limit)
            finally:
                os._exit(code)

    def run(self, tree: Path, way: str, words: Sequence[str], record: Path | None, limit: float) -> int:
        """In the fork: the exit code of pytest."""
        os.setsid()
        output = os.open(self.log, os.O_WRONLY)
        os.dup2(output, 1)
        os.dup2(output, 2)
        if limit:
            resource.setrlimit(resource.RLIMIT_CPU, (int(limit), int(limit)))
        os.chdir(tree)
        os.environ |= {'PYTHONPATH': str(tree), 'PYTHONDONTWRITEBYTECODE': '1', 'OMP_NUM_THREADS': '1'}
        if self.cache:
            os.environ['XDG_CACHE_HOME'] = str(self.cache)
        if way == PLAIN:
            os.environ['NUMBA_DISABLE_JIT'] = '1'
            numba.config.DISABLE_JIT = 1
        sys.dont_write_bytecode = True
        sys.path[:1] = [str(tree)]
        words = ['-q', '-p', 'no:cacheprovider', '-p', 'no:randomly', *words]
        return int(measured(words, record, way) if record else pytest.main(['-x', *words]))

    def result(self) -> tuple[str, str] | None:
        """(killed | timeout | survived | not covered, the test that noticed) once it has ended."""
        process, status = os.waitpid(self.process, os.WNOHANG)
        if not process:
            if time.monotonic() > self.end:
                os.killpg(self.process, signal.SIGKILL)  # it waits for something that never comes
            return None
        said = self.log.read_text(errors='replace')
        self.log.unlink()
        if self.cache:
            shutil.rmtree(self.cache, ignore_errors=True)
        if os.WIFSIGNALED(status):
            return 'timeout', ''
        failed = [line for line in said.splitlines() if line.startswith(('FAILED', 'ERROR'))]
        outcome = CODES.get(os.WEXITSTATUS(status), 'killed')
        return outcome, (failed[0][:200] if failed else '' if outcome == 'survived' else said[-300:])


def measured(words: Sequence[str], folder: Path, way: str) -> int:
    """Run tests without a fault and note their reach; tests that fail then are left out, as they would tell nothing."""
    (folder / f'{way}.times.jsonl').write_text('')
    coverage = Coverage(str(folder / f'{way}.coverage'), source_pkgs=['sma_sim'], data_suffix=False, config_file=False)
    coverage.start()
    files = [word for word in words if word.endswith('.py')]
    for file in files:
        own = [file, *(word for word in words if word not in files)]
        pytest.main(own, plugins=[Recorder(folder / f'{way}.times.jsonl', coverage)])
    coverage.stop()
    coverage.save()
    return 0


def waited(fork: Fork) -> tuple[str, str]:
    """The result of a fork that runs alone."""
    while (result := fork.result()) is None:
        time.sleep(0.1)
    return result


def record_of(mutant: Mutant, way: str, result: tuple[str, str], seconds: float) -> dict[str, Any]:
    """A line of the results."""
    return asdict(mutant) | {
        'key': mutant.key,
        'way': way,
        'outcome': result[0],
        'by': result[1],
        'seconds': round(seconds, 1),
    }


def results_in(file: Path) -> dict[str, dict[str, Any]]:
    """The last result of each mutant, by its key."""
    lines = file.read_text().splitlines() if file.exists() else []
    return {record['key']: record for record in map(json.loads, lines)}


def is_open(record: Mapping[str, Any] | None) -> bool:
    """Whether native code may still notice what plain Python did not."""
    return record is not None and record['way'] == PLAIN and record['outcome'] in ('survived', 'not covered')


def summary(file: Path) -> str:
    """Counts by room and by kind of change, of the last run of each mutant, with a 95 % interval."""
    records = results_in(file).values()
    lines = []
    for room in (*ROOMS, 'sma_sim'):
        lines.append(line_of(room, [record for record in records if record['path'].startswith(room)]))
    for kind in sorted({record['kind'] for record in records}):
        lines.append(line_of(kind, [record for record in records if record['kind'] == kind]))
    return '\n'.join(lines)


def line_of(name: str, records: Sequence[Mapping[str, Any]]) -> str:
    """How many were noticed."""
    counts = Counter(record['outcome'] for record in records)
    total, noticed = sum(counts.values()), counts['killed'] + counts['timeout']
    if not total:
        return f'{name}: none'
    low, high = scipy.stats.binomtest(noticed, total).proportion_ci(method='wilson')
    shares = f'{100.0 * noticed / total:.0f} %, 95 % interval {100.0 * low:.0f} to {100.0 * high:.0f} %'
    return f'{name}: {noticed} of {total} noticed ({shares}), {dict(counts)}'


def run_all(wanted: list[Mutant], trees: list[Path], reach: Mapping[str, Reach], given: argparse.Namespace) -> None:
    """Run the mutants, one in each tree at a time."""
    running: dict[Path, tuple[Mutant, Fork, str]] = {}
    waiting, end = list(wanted), time.monotonic() + 60.0 * given.minutes
    while running or (waiting and time.monotonic() < end):
        for tree in trees:
            if tree not in running and waiting and time.monotonic() < end:
                running[tree] = started(waiting.pop(0), tree, reach, given)
            elif tree in running and (result := running[tree][1].result()) is not None:
                mutant, fork, source = running.pop(tree)
                (tree / mutant.path).write_text(source)
                record = record_of(mutant, way_of(mutant, given.native), result, time.monotonic() - fork.begin)
                with given.file.open('a') as out:
                    out.write(json.dumps(record) + '\n')
                print(record['outcome'], record['seconds'], mutant.key, record['by'], flush=True)
        time.sleep(0.05)


def started(mutant: Mutant, tree: Path, reach: Mapping[str, Reach], given: argparse.Namespace) -> tuple[Mutant, Fork, str]:
    """Put a mutant into a tree and start its tests."""
    way = way_of(mutant, given.native)
    source = (tree / mutant.path).read_text()
    (tree / mutant.path).write_text(mutant.applied(source))
    known = reach[way]
    names = known.tests_of(mutant, given.budget)
    expected = sum(known.seconds[name] for name in names)
    words = names or ['test/docs/test_layers.py', '-k', 'no_test_comes_here']
    return mutant, Fork(tree, way, words, limit=60.0 + 4.0 * expected), source


def main() -> None:
    """Draw, measure what tests reach, run what is missing, and count."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--count', type=int, default=200)
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--jobs', type=int, default=2)
    parser.add_argument('--budget', type=float, default=60.0, help='most processor time of the tests of a mutant [s]')
    parser.add_argument('--minutes', type=float, default=600.0, help='no mutant starts later')
    parser.add_argument('--native', action='store_true', help='run those that survived as plain Python again')
    parser.add_argument('--room', default='', help='draw from files whose path contains this')
    parser.add_argument('--file', type=Path, default=Path('mutants.jsonl'))
    given = parser.parse_args()
    done = results_in(given.file)
    wanted = drawn(ROOT, ROOMS, given.count, given.seed, given.room)
    wanted = [mutant for mutant in wanted if (is_open(done.get(mutant.key)) if given.native else mutant.key not in done)]
    with tempfile.TemporaryDirectory() as home:
        trees = [copied(Path(home) / f'tree{k}') for k in range(given.jobs)]
        folder = given.file.resolve().with_suffix('.reach')
        folder.mkdir(exist_ok=True)
        reach = {}
        for way in sorted({way_of(mutant, given.native) for mutant in wanted}):
            if not (folder / f'{way}.coverage').exists():
                print(f'what tests reach, {way}:', *waited(Fork(trees[0], way, words_of(way, trees[0]), folder)), flush=True)
            reach[way] = reach_in(folder, way)
        run_all(wanted, trees, reach, given)
    print(summary(given.file))


if __name__ == '__main__':
    main()
