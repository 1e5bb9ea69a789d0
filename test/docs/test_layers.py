"""What needs no measurement is model, what needs one is evidence, what meets a person or ROS is shell."""

import ast
from functools import cache
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[2] / 'sma_sim'
# From the lowest to the highest: a room imports from itself and from those before it.
ROOMS = (
    'model',
    'compiler',
    'solver',
    'evidence.data',
    'evidence.estimation',
    'evidence.state_estimation',
    'evidence.control',
    'evidence.residual_analysis',
    'evidence.model_selection',
    'evidence.symbolic_regression',
    'evidence.search',
    'evidence.set_up',
    'evidence.experiment_design',
    'evidence.diagnosis',
    'evidence.latent_input',
    'evidence.monitoring',
    'challenge',
    'words',
    'report',
    'workflow',
    'gym',
    'ros',
    'explore',
    'cli.common',
    'cli',
)
ONLY_IN = {'rclpy': 'ros', 'std_msgs': 'ros', 'sensor_msgs': 'ros', 'matplotlib': 'report', 'plotly': 'report'}


@cache
def sources():
    """The tree of every file that is not empty."""
    return {file: ast.parse(file.read_text()) for file in sorted(PACKAGE.rglob('*.py')) if file.stat().st_size}


def imported(tree):
    """Full names of what a file imports, anywhere in it; a relative import as dots."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield '.' * node.level + (node.module or '')


def room_of(module):
    """The room that a module of the package (without its name) is in, the innermost one; None for none."""
    return max((room for room in ROOMS if f'{module}.'.startswith(f'{room}.')), key=len, default=None)


def module_of(file):
    return '.'.join(file.relative_to(PACKAGE).with_suffix('').parts)


def wrong_imports(file, tree):
    """What a file imports and must not."""
    home = room_of(module_of(file))
    for name in imported(tree):
        top, _, rest = name.partition('.')
        if top == 'sma_sim' and home and (not rest or ROOMS.index(room_of(rest)) > ROOMS.index(home)):
            yield f'{file} imports {name}: expected a module of {home} or of a room before it'
        if not top:
            yield f'{file}: relative import'
        if top in ('numba', 'llvmlite') and home != 'compiler':
            yield f'{file} compiles'
        if top in ONLY_IN and home != ONLY_IN[top]:
            yield f'{file} imports {top}, which is for {ONLY_IN[top]}'


def test_every_file_is_in_a_room():
    assert [file for file in sources() if file.parent != PACKAGE and room_of(module_of(file)) is None] == []


def test_imports_point_back_only():
    assert len(sources()) > 200
    assert [words for file, tree in sources().items() for words in wrong_imports(file, tree)] == []


def test_the_check_sees_what_is_wrong():
    """An import upwards, of the package, relative, of a compiler and of a tool for pictures."""
    text = 'import sma_sim\nfrom sma_sim.evidence.diagnosis import diagnose\nfrom . import x\nimport numba, plotly.io'
    assert len(list(wrong_imports(PACKAGE / 'evidence' / 'data' / 'units.py', ast.parse(text)))) == 5
