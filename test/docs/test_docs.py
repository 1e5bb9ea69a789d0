"""The code blocks of the documentation run as they stand and print what it says; its links and its promises hold."""

import ast
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / 'README.md', *sorted(page for page in (ROOT / 'docs').rglob('*.md') if '_build' not in page.parts)]
MARK = r'(?:<!-- (?P<mark>run(?: at night)?|not run: [^>]+|printed) -->\n)?'
BLOCK = re.compile(MARK + r'```(?P<language>\w*)\n(?P<text>.*?)```', re.S)
NUMBER = re.compile(r'\d+(?:\.(?P<decimals>\d+))?(?:e(?P<exponent>[-+]?\d+))?')
SHELLS = ('bash', 'console', 'sh')
# Half a minute and more.
SEARCHES = re.compile(r'sma-sim (?:diagnose|latent|next|tour)|(?:diagnose|propose|estimate_latent_inputs|next_experiment)\(')


def blocks(*languages):
    """Page, mark and text of every code block in these languages."""
    for page in PAGES:
        for number, match in enumerate(BLOCK.finditer(page.read_text())):
            if match['language'] in languages:
                yield f'{page.name}-{number}', page, match['mark'], match['text']


def scripts():
    """Blocks of Python that do not say why not, those of the shell that say so; of a tutorial all in one folder."""
    for page in PAGES:
        own = [block for block in map(as_script, blocks_with_output(page)) if block]
        for together in [own] if page.parent.name == 'tutorials' and own else [[block] for block in own]:
            takes_long = any(SEARCHES.search(command[-1]) or mark == 'run at night' for command, _, mark in together)
            parts = [(command, output) for command, output, _ in together]
            yield pytest.param(parts, id=f'{page.stem}-{len(parts)}', marks=[pytest.mark.slow] * takes_long)


def blocks_with_output(page):
    """The blocks of a page, each with what the page says that it prints."""
    found = list(BLOCK.finditer(page.read_text()))
    for block, after in zip(found, [*found[1:], None], strict=False):
        yield block, after['text'] if after and after['mark'] == 'printed' else ''


def as_script(block_and_output):
    """Command, output and mark of a block that runs."""
    block, output = block_and_output
    language, mark = block['language'], block['mark'] or ('run' if block['language'] == 'python' else '')
    if not mark.startswith('run'):
        return None
    words = [sys.executable] if language == 'python' else ['bash', '-euo', 'pipefail']
    return [*words, '-c', block['text']], output, mark


def is_said(line, said):
    """Whether a line is what a page says, with numbers to 2 % or a unit of the last digit: processors round differently."""
    numbers = zip(NUMBER.finditer(line), NUMBER.finditer(said), strict=False)
    return NUMBER.sub('#', line.rstrip()) == NUMBER.sub('#', said.rstrip()) and all(
        abs(float(one[0]) - float(other[0])) <= max(0.02 * float(other[0]), unit(other)) for one, other in numbers
    )


def unit(number):
    """One in the last digit of a number, as it is written."""
    return 10.0 ** (int(number['exponent'] or 0) - len(number['decimals'] or ''))


def environment():
    """The scripts of this Python first, and the package from its sources."""
    folder = str(Path(sys.executable).parent)
    return os.environ | {'PATH': folder + os.pathsep + os.environ['PATH'], 'PYTHONPATH': str(ROOT)}


def test_every_shell_block_says_whether_it_runs():
    assert [name for name, _, mark, _ in blocks(*SHELLS) if not mark] == []  # <!-- run --> or <!-- not run: why -->


@pytest.mark.blocks
@pytest.mark.parametrize('parts', list(scripts()))
def test_block(parts, tmp_path):
    (tmp_path / 'examples').symlink_to(ROOT / 'examples')
    for command, output in parts:
        done = subprocess.run(command, cwd=tmp_path, env=environment(), capture_output=True, text=True, timeout=600)
        assert done.returncode == 0, done.stderr
        printed = iter(done.stdout.splitlines())
        for said in output.splitlines():
            assert said == '...' or any(is_said(line, said) for line in printed), f'{said!r} is not in\n{done.stdout}'


def test_numbers_of_output_are_compared():
    assert is_said('3 steps, 9.1e-06 deg', '3 steps, 9.0e-06 deg') and is_said('1.01 nats', '1.0 nats')
    assert not is_said('83 %', '93 %') and not is_said('3 steps', '3 jumps') and not is_said('9.4e-06', '9.0e-06')


def test_what_python_blocks_import_is_there():
    """Of those too that run at night only."""
    texts = [text for _, _, _, text in blocks('python')]
    imports = {line for text in texts for line in text.splitlines() if line.startswith(('import sma_sim', 'from sma_sim'))}
    assert len(imports) > 5
    for line in imports:
        exec(line, {})


def test_links_lead_somewhere():
    for page in PAGES:
        for link in re.findall(r'\]\(([^)#]+)', page.read_text()):
            assert link.startswith('http') or (page.parent / link).exists(), f'{page}: {link}'


def test_continuous_integration_runs_the_readmes_test_command():
    command = re.search(r'## Set up and test.*?```bash\n(.*?)\n```', (ROOT / 'README.md').read_text(), re.S).group(1)
    assert command in (ROOT / '.ci' / 'run').read_text().splitlines()


def test_every_effect_is_in_the_documentation():
    from sma_sim import find_effects

    page = (ROOT / 'docs' / 'reference' / 'effects.md').read_text()
    assert [name for name in find_effects() if f'`{name}`' not in page] == []


ARCHITECTURE = ROOT / 'docs' / 'explanation' / 'architecture.md'


def test_parameters_are_those_of_the_declarations(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / 'docs'))
    import make_parameters

    assert make_parameters.page() == make_parameters.PAGE.read_text(), 'run python docs/make_parameters.py'


def test_architecture_is_that_of_the_imports(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / 'docs'))
    import make_architecture

    assert make_architecture.page_with_table() == ARCHITECTURE.read_text(), 'run python docs/make_architecture.py'


def test_what_the_architecture_names_exists():
    quoted = re.findall(r'`(?:sma_sim/)?(?!test/)([a-z_]+/[a-z_/]*[a-z_]+\.py)(?:::(\w+))?`', ARCHITECTURE.read_text())
    assert len(quoted) > 20
    for path, name in quoted:
        file = ROOT / 'sma_sim' / path
        assert file.exists(), path
        body = ast.parse(file.read_text()).body
        defined = {node.name for node in body if isinstance(node, ast.FunctionDef | ast.ClassDef)}
        assert not name or name in defined, f'{path}::{name}'


def test_places_where_things_are_put_exist():
    """Files, folders and names in the table: whoever follows it finds them at the first try."""
    table = ARCHITECTURE.read_text().split('## Where do I put')[1].split('\n## ')[0]
    places = re.findall(r'`([\w./]+(?:\.(?:py|js|toml)|/))`', table)
    assert len(places) > 40
    known = {file.name for file in (ROOT / 'sma_sim').rglob('*')}
    missing = [one for one in places if not (ROOT / one).exists() and not ('/' not in one and one in known)]
    assert [one for one in missing if not (ROOT / 'sma_sim' / one).exists()] == []
    sources = '\n'.join(file.read_text() for file in (ROOT / 'sma_sim').rglob('*.py'))
    assert [name for name in re.findall(r'`(\w+)`', table) if not re.search(rf'\b{name}\b', sources)] == []
