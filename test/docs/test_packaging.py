"""What is installed beside the Python code, and that ROS is told of every package that is used."""

import ast
import importlib.util
import re
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from importlib import metadata
from pathlib import Path

import pytest
import yaml

import sma_sim
from sma_sim.model import effects, plugins

tomllib = pytest.importorskip('tomllib', reason='Python 3.11 reads TOML')

ROOT = Path(__file__).resolve().parents[2]
PROJECT = tomllib.loads((ROOT / 'pyproject.toml').read_text())
INSTALLED = {
    folder: sorted(file for pattern in patterns for file in ROOT.glob(pattern))
    for folder, patterns in PROJECT['tool']['setuptools']['data-files'].items()
}
PYTHON = {
    'yaml': 'python3-yaml',
    'numpy': 'python3-numpy',
    'scipy': 'python3-scipy',
    'numba': 'python3-numba',
    'matplotlib': 'python3-matplotlib',
}


def test_public_names_have_the_types_that_checkers_see():
    """What is imported when asked for is what `if TYPE_CHECKING` says."""
    tree = ast.parse(Path(sma_sim.__file__).read_text())
    seen = {
        (alias.name, node.module)
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
        if node.module.startswith('sma_sim.')
    }
    assert seen == {(name, f'sma_sim.{home}') for home, names in sma_sim._EXPORTS.items() for name in names}
    assert {getattr(sma_sim, name).__name__ for name in sma_sim.__all__} == set(sma_sim.__all__)
    with pytest.raises(AttributeError, match='sma_sim has no simulat; did you mean simulate'):
        _ = sma_sim.simulat


def loaded_by(statement):
    """The modules that a statement loads in a Python of its own."""
    words = [sys.executable, '-c', f'import sys; {statement}\nprint(*sys.modules)']
    return subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=True).stdout.splitlines()[-1].split()


def test_a_verb_loads_nothing_of_others():
    loaded = loaded_by('from sma_sim.cli.main import main; main(["effects"])')
    assert 'sma_sim.cli.effects' in loaded and 'sma_sim.evidence' not in loaded and 'numba' not in loaded


@pytest.mark.parametrize('words', [['--help'], ['fti'], []])
def test_help_and_a_misspelt_verb_load_no_verb(words):
    """They answer at once; all verbs together take seconds to load."""
    loaded = loaded_by(
        f'import contextlib; from sma_sim.cli.main import main\nwith contextlib.suppress(SystemExit): main({words})'
    )
    assert 'sma_sim.cli.main' in loaded and 'numpy' not in loaded


def test_what_only_estimates_or_writes_bags_is_not_loaded_before_a_run():
    """Each would take a quarter of a short run."""
    assert not {'scipy.special', 'scipy.linalg', 'rosbags', 'mcap'} & set(loaded_by('import sma_sim.cli.simulate'))
    if importlib.util.find_spec('rclpy'):
        assert not {'scipy.special', 'scipy.linalg'} & set(loaded_by('import sma_sim.ros.node'))


def test_installed_packages_are_searched_once(monkeypatch):
    """Effects and structures of others; to open hundreds of packages takes a tenth of a short run."""
    searched = []
    monkeypatch.setattr(plugins, 'entry_points', lambda: searched.append(1) or metadata.entry_points())
    plugins.installed_entry_points.cache_clear()
    for group in ('sma_sim.effects', 'sma_sim.structures'):
        assert list(plugins.package_plugins(effects, 'NOTHING', group)) == []
    assert searched == [1]


def test_every_pattern_finds_something():
    for folder, patterns in PROJECT['tool']['setuptools']['data-files'].items():
        for pattern in patterns:
            assert list(ROOT.glob(pattern)), f'{folder}: {pattern}'


@pytest.mark.parametrize('folder', ['config', 'launch', 'examples', 'layouts'])
def test_folders_are_installed_whole(folder):
    files = sorted(file for file in (ROOT / folder).iterdir() if file.is_file())
    assert INSTALLED[f'share/sma_sim/{folder}'] == files


def test_launch_files_use_what_is_installed():
    """What they name in share/."""
    texts = [file.read_text() for file in (*(ROOT / 'launch').glob('*.py'), ROOT / 'sma_sim' / 'ros' / 'launching.py')]
    names = {name for text in texts for name in re.findall(r"share\('(\w+)', '([\w.]+)'\)", text)}
    assert {('config', 'module.yaml'), ('examples', 'controller.py'), ('examples', 'sine_target.py')} <= names
    for folder, name in names:
        if (ROOT / folder).exists():  # without a configuration of its own, RViz starts with its default
            assert ROOT / folder / name in INSTALLED[f'share/sma_sim/{folder}']


# Without a key, or only used by some commands, which say what to install (test_optional_packages.py); the last two are what
# one that is declared brings: llvmlite is numba's, zstandard is mcap's.
UNDECLARED = {
    'plotly',
    'threadpoolctl',
    'distributed',
    'llvmlite',
    'zstandard',
    'openpyxl',
    'gymnasium',
}
KEYS = PYTHON | {'rosbags': 'python3-rosbags-pip', 'mcap': 'mcap-ros2-support'}


def imported(file):
    """Top-level names that a file imports, wherever in it, which are neither of Python itself nor ours."""
    found = set()
    for node in ast.walk(ast.parse(file.read_text(encoding='utf-8'))):
        if isinstance(node, ast.Import):
            found |= {alias.name.partition('.')[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            found.add(node.module.partition('.')[0])
    return found - set(sys.stdlib_module_names) - {'sma_sim'}


def siblings(file):
    """Names of the examples beside a file: each is started with its own folder as the first place to import from."""
    return {other.stem for other in file.parent.glob('*.py')} if file.parent.name == 'examples' else set()


def test_one_version_and_everything_imported_is_declared():
    manifest = ElementTree.parse(ROOT / 'package.xml').getroot()
    assert manifest.findtext('version') == PROJECT['project']['version']
    declared = {element.text for element in manifest.findall('exec_depend')}
    files = [file for folder in ('sma_sim', 'launch', 'examples') for file in (ROOT / folder).rglob('*.py')]
    assert len(files) > 200
    for file in files:
        for name in imported(file) - UNDECLARED - siblings(file):
            assert KEYS.get(name, name) in declared, f'{file} imports {name}: add it to package.xml'


# Keys of https://github.com/ros/rosdistro, rosdep/base.yaml and python.yaml, looked up on 2026-11-22 for Ubuntu noble, on
# which Jazzy and Kilted are. There are none for plotly, threadpoolctl, distributed, and none that is called python3-mcap.
ROSDEP_KEYS = {
    'python3-numpy',
    'python3-scipy',
    'python3-yaml',
    'python3-matplotlib',
    'python3-numba',
    'python3-rosbags-pip',
    'mcap-ros2-support',
    'python3-hypothesis',
    'python3-pytest',
    'python3-pytest-xdist',
    'python3-selenium',
    'python3-jinja2',
    'python3-setuptools',
}
ROS_PACKAGES = {  # released in both
    'rclpy',
    'rcl_interfaces',
    'builtin_interfaces',
    'std_msgs',
    'sensor_msgs',
    'std_srvs',
    'diagnostic_msgs',
    'visualization_msgs',
    'geometry_msgs',
    'rosgraph_msgs',
    'trajectory_msgs',
    'tf2_msgs',
    'control_msgs',
    'simulation_interfaces',
    'launch',
    'launch_ros',
    'ros2launch',
    'ament_index_python',
}


def test_rosdep_knows_every_key():
    manifest = ElementTree.parse(ROOT / 'package.xml').getroot()
    keys = {element.text for element in manifest if element.tag.endswith('depend')}
    assert len(keys) > 15 and keys - ROSDEP_KEYS - ROS_PACKAGES == set()


def test_contributing_names_what_exists():
    """Folders and tests for each thing to add; the tests that it names run by pytest."""
    text = (ROOT / 'CONTRIBUTING.md').read_text(encoding='utf-8')
    paths = set(re.findall(r'`((?:sma_sim|test|\.ci)/[\w./]*)`', text)) | set(re.findall(r'\]\(([^)#]+)', text))
    assert len(paths) > 30 and [path for path in paths if not (ROOT / path).exists()] == []
    assert len(re.findall(r'^\| an? [^|]+\| [^|]+\| `test/', text, re.M)) == 11


def test_citation_and_hooks():
    citation = yaml.safe_load((ROOT / 'CITATION.cff').read_text(encoding='utf-8'))
    assert citation['version'] == PROJECT['project']['version'] and citation['license'] == 'Apache-2.0'
    assert {'cff-version', 'message', 'title', 'authors'} <= set(citation) and citation['references'][0]['year'] == 2021
    hooks = yaml.safe_load((ROOT / '.pre-commit-config.yaml').read_text(encoding='utf-8'))['repos'][0]['hooks']
    assert [hook['entry'].split()[0] for hook in hooks] == ['ruff', 'ruff', 'mypy']
    assert all(hook['language'] == 'system' for hook in hooks)
