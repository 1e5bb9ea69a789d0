"""Small changes of sources: what a mutant is, which ones a file has, and which files import from which.

Each changes one place: a comparison or an arithmetic operator is exchanged, a number changed, a condition negated, a
returned value replaced. Left alone is what no result depends on: `frozen=True` of a dataclass and `strict=True` of zip,
without which nothing changes as long as the code keeps to them; `repr` of a field; the size of a cache; powers of ten from
1e-6 down, which are tolerances or keep a division from zero (the declaration of a parameter's bounds excepted); when a
search ends and what is compiled ahead (HEURISTIC); and whatever compiles to the same byte code.
"""

from __future__ import annotations

import ast
import random
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from types import CodeType

GUARDS = ('frozen', 'strict', 'repr')
CACHES = ('lru_cache',)  # functions whose arguments are sizes of caches
DECLARATIONS = ('Parameter',)  # functions whose small powers of ten are data, not tolerances
TOLERANCE = 1e-6
HEURISTIC = ('sma_sim/evidence/estimation/stop_criteria.py', 'sma_sim/solver/warm_up.py')  # a number there moves effort only
COMPARED = {
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
    ast.In: ast.NotIn,
    ast.NotIn: ast.In,
}
COMPUTED = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.Pow: ast.Mult,
    ast.FloorDiv: ast.Div,
    ast.Mod: ast.Mult,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
}
ORDERED = (ast.Lt, ast.LtE, ast.Gt, ast.GtE)


@dataclass(frozen=True)
class Mutant:
    """One change of the source: characters `begin` to `end` of a file become `text`.

    The statement has the lines `first` to `last`.
    `kind` is boundary (< for <=, which between floats seldom matters), comparison, arithmetic, number, condition or return.
    """

    path: str
    line: int
    first: int
    last: int
    begin: int
    end: int
    before: str
    text: str
    kind: str

    @property
    def key(self) -> str:
        """What a result is found by again."""
        return f'{self.path}:{self.line}: {self.before} -> {self.text}'

    def is_outer(self, source: str) -> bool:
        """Whether the statement is in no function and no class, so that it runs while the file is imported."""
        return not source.splitlines()[self.first - 1].startswith(' ')

    def applied(self, source: str) -> str:
        """The file's text with the change."""
        return source[: self.begin] + self.text + source[self.end :]


def changes(node: ast.AST) -> Iterator[tuple[str, ast.expr]]:
    """What may stand in the place of an expression, with the kind of the change."""
    if isinstance(node, ast.Compare) and len(node.ops) == 1 and type(node.ops[0]) in COMPARED:
        kind = 'boundary' if isinstance(node.ops[0], ORDERED) else 'comparison'
        yield kind, ast.Compare(node.left, [COMPARED[type(node.ops[0])]()], node.comparators)
    elif isinstance(node, ast.BinOp) and type(node.op) in COMPUTED:
        yield 'arithmetic', ast.BinOp(node.left, COMPUTED[type(node.op)](), node.right)
    elif isinstance(node, ast.BoolOp):
        yield 'condition', ast.BoolOp(ast.Or() if isinstance(node.op, ast.And) else ast.And(), node.values)
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.Not, ast.USub)):
        yield ('condition' if isinstance(node.op, ast.Not) else 'arithmetic'), node.operand
    elif isinstance(node, ast.IfExp):
        yield 'condition', ast.IfExp(node.test, node.orelse, node.body)
    elif isinstance(node, ast.Constant) and type(node.value) in (int, float, bool):
        yield 'number', ast.Constant(other_number(node.value))


def called(node: ast.AST) -> str:
    """The name of the function that an expression calls, none for other expressions."""
    return node.func.id if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) else ''


def is_tolerance(node: ast.AST) -> bool:
    """Whether an expression is a small power of ten."""
    value = node.value if isinstance(node, ast.Constant) else None
    return isinstance(value, float) and 0.0 < value <= TOLERANCE and f'{value:e}'.startswith('1.000000e')


def other_number(value: bool | int | float) -> bool | int | float:
    """The negated truth, the next integer, twice a number (one for zero)."""
    if isinstance(value, bool):
        return not value
    return value + 1 if isinstance(value, int) or value == 0.0 else 2.0 * value


def expressions(
    node: ast.AST, lines: tuple[int, int] = (1, 1), declared: bool = False
) -> Iterator[tuple[ast.expr, str, ast.expr, tuple[int, int]]]:
    """Expressions that run, with what may stand in their place and the lines of their statement; no annotations or texts.

    `declared`: within the declaration of a parameter.
    """
    declared = declared or called(node) in DECLARATIONS
    for name, value in ast.iter_fields(node):
        if name in ('annotation', 'returns', 'type_comment') or isinstance(node, ast.JoinedStr) or called(node) in CACHES:
            continue
        for child in value if isinstance(value, list) else [value]:
            if not isinstance(child, ast.AST) or (isinstance(child, ast.keyword) and child.arg in GUARDS):
                continue
            if isinstance(child, ast.stmt):
                lines = (child.lineno, child.end_lineno or child.lineno)
            if isinstance(child, ast.expr):
                own = lines if not hasattr(node, 'body') else (child.lineno, child.end_lineno or child.lineno)
                if declared or not is_tolerance(child):
                    yield from ((child, kind, change, own) for kind, change in changes(child))
                if isinstance(node, ast.Return) and name == 'value' and not isinstance(child, ast.Constant):
                    yield child, 'return', ast.Constant(None), own
                if isinstance(node, (ast.If, ast.While)) and name == 'test':
                    yield child, 'condition', ast.UnaryOp(ast.Not(), child), own
                yield from expressions(child, own, declared)
            else:
                yield from expressions(child, lines, declared)


def mutants_of(path: Path, root: Path) -> list[Mutant]:
    """Every change of one file."""
    source = path.read_text()
    where_from = path.relative_to(root).as_posix()
    if not source.isascii() or where_from in HEURISTIC:  # columns count bytes
        return []
    starts = [0]
    for line in source.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    found = []
    for node, kind, change, (first, last) in expressions(ast.parse(source)):
        begin = starts[node.lineno - 1] + node.col_offset
        end = starts[(node.end_lineno or node.lineno) - 1] + (node.end_col_offset or 0)
        where = (where_from, node.lineno, first, last, begin, end)
        found.append(Mutant(*where, source[begin:end], f'({ast.unparse(change)})', kind))
    return found


def changes_nothing(mutant: Mutant, source: str) -> bool:
    """Whether the change compiles to the same byte code."""
    return same_code(compile(source, mutant.path, 'exec'), compile(mutant.applied(source), mutant.path, 'exec'))


def same_code(first: CodeType, second: CodeType) -> bool:
    """Whether two pieces of byte code do the same, wherever they stand."""
    if first.co_code != second.co_code or first.co_names != second.co_names or len(first.co_consts) != len(second.co_consts):
        return False
    pairs = zip(first.co_consts, second.co_consts, strict=True)
    return all(same_code(a, b) if isinstance(a, CodeType) else repr(a) == repr(b) for a, b in pairs)


def drawn(root: Path, rooms: Iterable[str], count: int, seed: int, part: str = '') -> list[Mutant]:
    """So many different ones of all files in rooms whose path contains a part, in an order that a seed decides."""
    files = [path for room in rooms for path in sorted((root / room).rglob('*.py'))]
    every = [mutant for path in files if part in path.relative_to(root).as_posix() for mutant in mutants_of(path, root)]
    chosen: list[Mutant] = []
    for mutant in random.Random(seed).sample(every, len(every)):
        if len(chosen) == count:
            break
        if not changes_nothing(mutant, (root / mutant.path).read_text()):
            chosen.append(mutant)
    return chosen


@lru_cache(1)
def imports(root: Path) -> dict[str, frozenset[str]]:
    """Which files of the package each one imports from."""
    files = {file.relative_to(root).as_posix(): file.read_text() for file in (root / 'sma_sim').rglob('*.py')}
    dotted = {name: name.removesuffix('.py').replace('/', '.') for name in files}
    return {
        user: frozenset(name for name, module in dotted.items() if f'from {module} import' in text)
        for user, text in files.items()
    }
