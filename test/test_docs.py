"""The code blocks of the documentation run as they stand; its links and its promises hold."""

import ast
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PAGES = [ROOT / 'README.md', *sorted(page for page in (ROOT / 'docs').rglob('*.md') if '_build' not in page.parts)]
BLOCK = re.compile(r'(?:<!-- (?P<mark>run|not run: [^>]+) -->\n)?```(?P<language>\w*)\n(?P<text>.*?)```', re.S)
SHELLS = ('bash', 'console', 'sh')


def blocks():
    for page in PAGES:
        for number, match in enumerate(BLOCK.finditer(page.read_text())):
            yield pytest.param(page, match['mark'], match['language'], match['text'], id=f'{page.name}-{number}')


def environment():
    """The scripts of this Python first, and the package from its sources."""
    scripts = str(Path(sys.executable).parent)
    return os.environ | {'PATH': scripts + os.pathsep + os.environ['PATH'], 'PYTHONPATH': str(ROOT)}


@pytest.mark.parametrize(('page', 'mark', 'language', 'text'), list(blocks()))
def test_block(page, mark, language, text, tmp_path):
    if language in SHELLS:
        assert mark, f'{page}: say <!-- run --> or <!-- not run: why --> before this block:\n{text}'
        if not mark.startswith('run'):
            return
        command = ['bash', '-euo', 'pipefail', '-c', text]
    elif language == 'python':
        command = [sys.executable, '-c', text]
    else:
        return
    (tmp_path / 'examples').symlink_to(ROOT / 'examples')
    done = subprocess.run(command, cwd=tmp_path, env=environment(), capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize('page', PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page):
    for link in re.findall(r'\]\(([^)#]+)', page.read_text()):
        assert link.startswith('http') or (page.parent / link).exists(), link


def test_continuous_integration_runs_the_readmes_test_command():
    command = re.search(r'## Set up and test.*?```bash\n(.*?)\n```', (ROOT / 'README.md').read_text(), re.S).group(1)
    assert command in (ROOT / '.ci' / 'run').read_text().splitlines()


def test_every_effect_is_in_the_documentation():
    from sma_sim import find_effects

    page = (ROOT / 'docs' / 'reference' / 'effects.md').read_text()
    assert [name for name in find_effects() if f'`{name}`' not in page] == []


ARCHITECTURE = ROOT / 'docs' / 'explanation' / 'architecture.md'


def test_architecture_is_that_of_the_imports(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / 'docs'))
    import make_architecture

    assert make_architecture.page_with_table() == ARCHITECTURE.read_text(), 'run python docs/make_architecture.py'


def test_what_the_architecture_names_exists():
    quoted = re.findall(r'`(?:sma_sim/)?([a-z_]+/[a-z_/]*[a-z_]+\.py)(?:::(\w+))?`', ARCHITECTURE.read_text())
    assert len(quoted) > 20
    for path, name in quoted:
        file = ROOT / 'sma_sim' / path
        assert file.exists(), path
        body = ast.parse(file.read_text()).body
        defined = {node.name for node in body if isinstance(node, ast.FunctionDef | ast.ClassDef)}
        assert not name or name in defined, f'{path}::{name}'
