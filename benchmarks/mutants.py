"""How many small random faults in solver, model and estimation the quick tests notice.

    python benchmarks/mutants.py --count 200 --jobs 2 --file mutants.jsonl

Each mutant is one change of one place: a comparison or an arithmetic operator exchanged, a number changed, a condition
negated, a returned value replaced. `frozen=True` of a dataclass and `strict=True` of zip are left alone: without them
nothing changes as long as the code keeps to them. The tests of a mutant run in a copy of the tree until the first fails.
Results are appended to the file, and what it holds already is not run again. Faults of model and solver run as plain Python
first (NUMBA_DISABLE_JIT), where most are noticed before a compiler would be ready; a second run with `--native` takes those
that survived to native code, with all tests that touch it.
"""

from __future__ import annotations

import argparse
import ast
import json
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from queue import SimpleQueue

ROOT = Path(__file__).resolve().parents[1]
ROOMS = ('sma_sim/solver', 'sma_sim/model', 'sma_sim/evidence/estimation')
# Quick as plain Python, in an order in which faults show soon; then those that need native code.
INTERPRETED_TESTS = (
    'closed_forms', 'effect_equations', 'material', 'paper_equations', 'effects', 'conservation', 'energy', 'order',
    'solver', 'messages', 'init', 'optional_packages', 'fields_read',
)  # fmt: skip
SLOW_AS_PYTHON = (
    'over_a_run', 'over_random_runs', 'second_law_over', 'does_not_jump', 'jumps_keep', 'leaves_out', 'random_commands',
    'runs_in_every_system', 'sensor_lag', 'accumulates', 'edited', 'convection_cools', 'wrong_effect_files', 'order_of',
    'samples_between', 'measured_order', 'follows_the', 'between_steps', 'converge_with', 'to_and_fro', 'hours', 'pulses',
    'switching_ends', 'ringing', 'many_steps', 'keeps_its_order', 'is_continued',
)  # fmt: skip
COMPILED_TESTS = (
    'solver', 'order', 'conservation', 'energy', 'hard_cases', 'effects_module', 'effects_wire', 'memory', 'effects', 'live',
    'reference', 'init', 'plot', 'packaging', 'messages', 'paper', 'interpreted',
    'closed_forms', 'effect_equations', 'compile', 'stalls', 'untrusted_data', 'optional_packages', 'fields_read',
    'sampled_channels', 'material', 'paper_equations', 'robot_description', 'recordings',
)  # fmt: skip
ESTIMATION_TESTS = (
    'fit_parts', 'jitter', 'noise', 'uncertainty', 'calibrate', 'many_runs', 'fit_command', 'paper_calibration', 'compare',
)  # fmt: skip
GUARDS = ('frozen', 'strict')
COMPARED = {
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In,
}  # fmt: skip
COMPUTED = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.Pow: ast.Mult, ast.FloorDiv: ast.Div,
    ast.Mod: ast.Mult, ast.BitAnd: ast.BitOr, ast.BitOr: ast.BitAnd,
}  # fmt: skip


@dataclass(frozen=True)
class Mutant:
    """One change of the source: characters `begin` to `end` of a file become `text`."""

    path: str
    line: int
    begin: int
    end: int
    before: str
    text: str

    @property
    def key(self) -> str:
        """What a result is found by again."""
        return f'{self.path}:{self.line}: {self.before} -> {self.text}'


def changes(node: ast.AST) -> Iterator[ast.expr]:
    """What may stand in the place of an expression."""
    if isinstance(node, ast.Compare) and len(node.ops) == 1 and type(node.ops[0]) in COMPARED:
        yield ast.Compare(node.left, [COMPARED[type(node.ops[0])]()], node.comparators)
    elif isinstance(node, ast.BinOp) and type(node.op) in COMPUTED:
        yield ast.BinOp(node.left, COMPUTED[type(node.op)](), node.right)
    elif isinstance(node, ast.BoolOp):
        yield ast.BoolOp(ast.Or() if isinstance(node.op, ast.And) else ast.And(), node.values)
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.Not, ast.USub)):
        yield node.operand
    elif isinstance(node, ast.IfExp):
        yield ast.IfExp(node.test, node.orelse, node.body)
    elif isinstance(node, ast.Constant) and type(node.value) in (int, float, bool):
        yield ast.Constant(other_number(node.value))


def other_number(value: bool | int | float) -> bool | int | float:
    """The negated truth, the next integer, twice a number (one for zero)."""
    if isinstance(value, bool):
        return not value
    return value + 1 if isinstance(value, int) or value == 0.0 else 2.0 * value


def expressions(node: ast.AST) -> Iterator[tuple[ast.AST, ast.expr]]:
    """Expressions that run, with what may stand in their place; neither annotations nor texts."""
    for name, value in ast.iter_fields(node):
        if name in ('annotation', 'returns', 'type_comment') or isinstance(node, ast.JoinedStr):
            continue
        for child in value if isinstance(value, list) else [value]:
            if not isinstance(child, ast.AST) or (isinstance(child, ast.keyword) and child.arg in GUARDS):
                continue
            yield from ((child, change) for change in changes(child))
            if isinstance(node, ast.Return) and name == 'value' and not isinstance(child, ast.Constant):
                yield child, ast.Constant(None)
            if isinstance(node, (ast.If, ast.While)) and name == 'test':
                yield child, ast.UnaryOp(ast.Not(), child)
            yield from expressions(child)


def mutants_of(path: Path) -> list[Mutant]:
    """Every change of one file."""
    text = path.read_text()
    starts = [0]
    for line in text.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    found = []
    for node, change in expressions(ast.parse(text)):
        before = ast.get_source_segment(text, node)
        if before is None or not text.isascii():
            continue
        begin = starts[node.lineno - 1] + node.col_offset
        found.append(
            Mutant(str(path.relative_to(ROOT)), node.lineno, begin, begin + len(before), before, f'({ast.unparse(change)})')
        )
    return found


def drawn(count: int, seed: int) -> list[Mutant]:
    """So many different ones of all rooms, in an order that a seed decides."""
    every = [mutant for room in ROOMS for path in sorted((ROOT / room).rglob('*.py')) for mutant in mutants_of(path)]
    return random.Random(seed).sample(every, min(count, len(every)))


def tests_of(path: str, compiled: bool) -> list[str]:
    """Arguments of pytest for a file's mutants: the tests that are named like it come first."""
    estimation = 'estimation' in path
    names = list(ESTIMATION_TESTS if estimation else COMPILED_TESTS if compiled else INTERPRETED_TESTS)
    stem = Path(path).stem.split('_')[0]
    names.sort(key=lambda name: stem not in name)
    words = [f'test/test_{name}.py' for name in names if (ROOT / f'test/test_{name}.py').exists()]
    return words if compiled or estimation else [*words, '-k', f'not ({" or ".join(SLOW_AS_PYTHON)})']


def copied(folder: Path) -> Path:
    """The tree as git knows it, in a folder of its own."""
    files = subprocess.run(
        ['git', 'ls-files', '-co', '--exclude-standard'], cwd=ROOT, capture_output=True, text=True, check=True
    )
    for name in files.stdout.splitlines():
        if (ROOT / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, folder / name)
    return folder


def run_tests(tree: Path, path: str, compiled: bool, timeout: float) -> tuple[str, str]:
    """Whether the tests of a file notice: (killed | timeout | survived | broken, the test that did)."""
    environment = os.environ | {'PYTHONPATH': str(tree), 'OMP_NUM_THREADS': '1', 'PYTHONDONTWRITEBYTECODE': '1'}
    if not compiled and 'estimation' not in path:
        environment['NUMBA_DISABLE_JIT'] = '1'
    words = [
        sys.executable,
        '-m',
        'pytest',
        '-x',
        '-q',
        '-p',
        'no:cacheprovider',
        '-p',
        'no:randomly',
        *tests_of(path, compiled),
    ]
    process = subprocess.Popen(
        words, cwd=tree, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=True
    )
    try:
        said, _ = process.communicate(timeout=timeout)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, 9)
        process.communicate()
        return 'timeout', ''
    failed = [line for line in said.splitlines() if line.startswith(('FAILED', 'ERROR'))]
    outcome = {0: 'survived', 1: 'killed', 2: 'killed'}.get(process.returncode, 'killed')
    return outcome, failed[0][:200] if failed else said[-200:] if process.returncode else ''


def judged(mutant: Mutant, tree: Path, native: bool, timeout: float) -> dict[str, object]:
    """The record of one mutant."""
    file = tree / mutant.path
    whole, begin = file.read_text(), time.monotonic()
    try:
        file.write_text(whole[: mutant.begin] + mutant.text + whole[mutant.end :])
        outcome, by = run_tests(tree, mutant.path, native, timeout)
    finally:
        file.write_text(whole)
    return asdict(mutant) | {'key': mutant.key, 'outcome': outcome, 'by': by, 'seconds': round(time.monotonic() - begin, 1)}


def summary(file: Path) -> str:
    """Counts by room, of the last run of each mutant."""
    records = {record['key']: record for record in map(json.loads, file.read_text().splitlines())}
    lines = []
    for room in (*ROOMS, 'sma_sim'):
        counts = Counter(record['outcome'] for record in records.values() if record['path'].startswith(room))
        total, noticed = sum(counts.values()), counts['killed'] + counts['timeout']
        lines.append(f'{room}: {noticed} of {total} noticed ({100.0 * noticed / max(total, 1):.0f} %), {dict(counts)}')
    return '\n'.join(lines)


def check_without_mutant(trees: SimpleQueue[Path], wanted: list[Mutant], native: bool, timeout: float) -> None:
    """End where the tests fail without any change: then they would tell nothing."""
    tree = trees.get()
    for room in sorted({'sma_sim/evidence/estimation' if 'estimation' in mutant.path else 'sma_sim' for mutant in wanted}):
        outcome, by = run_tests(tree, room, native, 4.0 * timeout)
        if outcome != 'survived':
            raise SystemExit(f'without a mutant: {outcome} {by}')
    trees.put(tree)


def main() -> None:
    """Draw, run what is missing, and count."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--count', type=int, default=200)
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--jobs', type=int, default=2)
    parser.add_argument('--timeout', type=float, default=900.0, help='[s]')
    parser.add_argument('--native', action='store_true', help='run those that survived as plain Python again')
    parser.add_argument('--room', default='', help='only files whose path contains this')
    parser.add_argument('--file', type=Path, default=Path('mutants.jsonl'))
    given = parser.parse_args()
    lines = given.file.read_text().splitlines() if given.file.exists() else []
    done = {record['key']: record for record in map(json.loads, lines)}
    wanted = drawn(given.count, given.seed)
    if given.native:
        survived = {key for key, record in done.items() if record['outcome'] == 'survived'}
        wanted = [mutant for mutant in wanted if mutant.key in survived and 'estimation' not in mutant.path]
    else:
        wanted = [mutant for mutant in wanted if mutant.key not in done]
    wanted = [mutant for mutant in wanted if given.room in mutant.path]
    with tempfile.TemporaryDirectory() as home, ThreadPoolExecutor(given.jobs) as pool:
        trees: SimpleQueue[Path] = SimpleQueue()
        for k in range(given.jobs):
            trees.put(copied(Path(home) / f'tree{k}'))
        check_without_mutant(trees, wanted, given.native, given.timeout)

        def run(mutant: Mutant) -> None:
            tree = trees.get()
            try:
                record = judged(mutant, tree, given.native, given.timeout)
            finally:
                trees.put(tree)
            with given.file.open('a') as out:
                out.write(json.dumps(record) + '\n')
            print(record['outcome'], record['seconds'], mutant.key, record['by'], flush=True)

        list(pool.map(run, wanted))
    print(summary(given.file))


if __name__ == '__main__':
    main()
