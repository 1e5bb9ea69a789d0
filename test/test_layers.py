"""What needs no measurement is model, what needs one is evidence, what meets a person or ROS is shell."""

import ast
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / 'sma_sim'
LAYERS = {'model': 0, 'solver': 1, 'evidence': 2, 'challenge': 3, 'report': 4, 'ros': 4, 'cli': 4}
SOURCES = sorted(file for file in PACKAGE.rglob('*.py') if file.parent != PACKAGE)
COMPILING = {'compile.py', 'kernels.py', 'fragments.py', 'by_reference.py'}


def imported(file):
    """Full names of what a file imports, anywhere in it."""
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f'{file}: relative import'
            yield node.module


def folder(file):
    return file.relative_to(PACKAGE).parts[0]


@pytest.mark.parametrize('file', SOURCES, ids=lambda file: str(file.relative_to(PACKAGE)))
def test_imports_point_back_only(file):
    for name in imported(file):
        parts = name.split('.')
        if parts[0] == 'sma_sim':
            assert len(parts) > 1, f'{file}: import the module that defines a thing, not the package'
            assert LAYERS[parts[1]] <= LAYERS[folder(file)], f'{file} imports {name}'
        if parts[0] in ('numba', 'llvmlite'):
            assert folder(file) == 'solver' and file.name in COMPILING, f'{file} compiles'
        if parts[0] in ('rclpy', 'std_msgs', 'sensor_msgs'):
            assert folder(file) == 'ros', f'{file} knows ROS'
        if parts[0] in ('matplotlib', 'plotly'):
            assert folder(file) == 'report', f'{file} draws'


def test_sizes():
    """Files that one can hold in the head."""
    for file in SOURCES:
        text = file.read_text()
        assert len(text.splitlines()) <= 400, f'{file}: split it'
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.FunctionDef):
                assert node.end_lineno - node.lineno < 45, f'{file}: {node.name} is too long'
