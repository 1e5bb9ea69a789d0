"""What keeps functions and decisions readable: few arguments, and every threshold of a diagnosis in one documented place."""

import ast
from itertools import zip_longest
from pathlib import Path

from sma_sim.compiler.compile import OUT_OF_LINE
from sma_sim.evidence.search import criteria

PACKAGE = Path(__file__).resolve().parents[2] / 'sma_sim'
MAX_ARGUMENTS, MAX_IN_SOLVER = 7, 8
MAX_THRESHOLDS = 3  # beside the score
ROOMS = ('search', 'set_up', 'diagnosis', 'model_selection')  # of a diagnosis
# Numbers of formulas, not of decisions: signs, halves, squares, per cent, the regularisation of a Cholesky factor.
FORMULA_NUMBERS = {-1.0, 0.0, 0.5, 1.0, 2.0, 100.0, 1e-9}


def functions(tree):
    return (node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef))


def argument_count(function):
    """Arguments without `self` or `cls`."""
    named = [*function.args.posonlyargs, *function.args.args]
    bound = bool(named) and named[0].arg in ('self', 'cls')
    return len(named) + len(function.args.kwonlyargs) - bound


def long_signatures(folder):
    """Functions with too many arguments, as `file:name`."""
    for file in sorted(folder.rglob('*.py')):
        most = MAX_IN_SOLVER if file.relative_to(folder).parts[0] in ('compiler', 'solver') else MAX_ARGUMENTS
        for function in functions(ast.parse(file.read_text())):
            if argument_count(function) > most:
                yield f'{file.relative_to(folder).as_posix()}:{function.name}'


def test_signatures_are_short():
    assert list(long_signatures(PACKAGE)) == []


def test_a_long_signature_is_found(tmp_path):
    (tmp_path / 'solver').mkdir()
    (tmp_path / 'solver' / 'step.py').write_text(
        'def step(a, b, c, d, e, f, g, *, h): ...\ndef far(a, b, c, d, e, f, g, h, i): ...'
    )
    (tmp_path / 'fit.py').write_text(
        'class Fit:\n    def cost(self, a, b, c, d, e, f, *, g): ...\n    def go(self, a, b, c, d, e, f, g, *, h): ...'
    )
    assert list(long_signatures(tmp_path)) == ['fit.py:go', 'solver/step.py:far']


def numbers_in(tree):
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, int | float) and not isinstance(node.value, bool):
            yield float(node.value)


def has_number(node):
    return node is not None and any(True for _ in numbers_in(node))


def thresholds_in(source):
    """Numbers that a file decides by without saying why: constants without a reason, and what no formula needs."""
    tree, lines = ast.parse(source), source.splitlines()
    for node, after in zip_longest(tree.body, tree.body[1:]):
        if isinstance(node, ast.Assign | ast.AnnAssign) and has_number(node.value):
            said = isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant)
            if not said and '  # ' not in lines[node.end_lineno - 1]:
                yield ast.unparse(node)
    for function in functions(tree):
        yield from (f'{function.name}: {number:g}' for number in numbers_in(function) if number not in FORMULA_NUMBERS)


def test_numbers_that_decide_in_a_diagnosis_have_names_and_reasons():
    files = [file for room in ROOMS for file in (PACKAGE / 'evidence' / room).glob('*.py')]
    assert len(files) > 25
    found = {file.name: list(thresholds_in(file.read_text())) for file in files}
    assert {name: numbers for name, numbers in found.items() if numbers} == {}
    decide = [node for node in ast.parse(Path(criteria.__file__).read_text()).body if isinstance(node, ast.Assign)]
    assert 0 < len(decide) <= MAX_THRESHOLDS


def test_a_threshold_without_a_reason_is_found():
    source = (
        'NEAR = 0.3\nFAR = 3.0  # as far as that\nFITS: tuple[float, ...] = (1.0,)\nMOST = 4\n"""It bounds the time."""\n'
        'def choose(error, limit=1.1):\n    return error < 0.7 * limit + 0.5'
    )
    assert list(thresholds_in(source)) == ['NEAR = 0.3', 'FITS: tuple[float, ...] = (1.0,)', 'choose: 1.1', 'choose: 0.7']


def test_functions_that_stay_out_of_line_exist():
    """They are listed by name: one that is renamed is inlined everywhere, and the first start takes longer."""
    files = [file for folder in ('model', 'compiler', 'solver') for file in (PACKAGE / folder).rglob('*.py')]
    defined = {function.name for file in files for function in functions(ast.parse(file.read_text()))}
    assert set(OUT_OF_LINE) <= defined, set(OUT_OF_LINE) - defined
