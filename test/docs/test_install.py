"""What ROS needs is found after `pip install .` and after `pip install -e .`, as in the README."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PARTS = (
    'config',
    'examples',
    'launch',
    'layouts',
    'resource',
    'sma_sim',
    'pyproject.toml',
    'setup.py',
    'setup.cfg',
    'package.xml',
    'README.md',
    'LICENSE',
)
NODES = ('sma_module_sim', 'sma_model_check', 'sma_observer', 'sma_guard', 'sma_controller')
IMPOSSIBLE = ('No matching distribution found for setuptools', 'No module named pip')


def copy_of_sources(folder):
    """What is installed, without what earlier builds have left."""
    for name in PARTS:
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns('__pycache__', '*.nb*'))
        else:
            shutil.copy(ROOT / name, folder / name)
    return folder


@pytest.fixture(scope='module', params=[False, pytest.param(True, marks=pytest.mark.slow)], ids=['plain', 'editable'])
def prefix(request, tmp_path_factory):
    """An environment into which pip has installed the package without its dependencies."""
    sources, prefix = copy_of_sources(tmp_path_factory.mktemp('sources')), tmp_path_factory.mktemp('prefix')
    words = [
        '--no-deps',
        '--no-compile',
        '--ignore-installed',
        '--prefix',
        str(prefix),
        *(['-e'] if request.param else []),
        '.',
    ]
    done = subprocess.run(
        [sys.executable, '-m', 'pip', 'install', *words], cwd=sources, capture_output=True, text=True, timeout=300
    )
    if any(reason in done.stderr for reason in IMPOSSIBLE):
        pytest.skip('no pip here, or no network from which it gets setuptools')
    assert done.returncode == 0, done.stderr
    return prefix / 'local' if (prefix / 'local').is_dir() else prefix  # Debian's pip installs into local/


def test_share_is_found_by_the_ament_index(prefix):
    index = prefix / 'share' / 'ament_index' / 'resource_index' / 'packages' / 'sma_sim'
    share = prefix / 'share' / 'sma_sim'
    assert index.is_file() and (share / 'package.xml').read_bytes() == (ROOT / 'package.xml').read_bytes()
    for folder in ('config', 'launch', 'layouts'):
        installed = {file.name for file in (share / folder).iterdir() if file.is_file()}
        assert installed == {file.name for file in (ROOT / folder).iterdir() if file.is_file()}
    packages = pytest.importorskip('ament_index_python.packages')
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv('AMENT_PREFIX_PATH', str(prefix))
        assert packages.get_package_share_directory('sma_sim') == str(share)


def test_ros2_run_finds_every_node(prefix):
    """`ros2 run` takes what is executable in lib/sma_sim; that must work with any PATH and without being activated."""
    text = (ROOT / 'pyproject.toml').read_text(encoding='utf-8').partition('[project.scripts]')[2]
    assert set(re.findall(r'^([\w-]+) = "sma_sim\.ros\.', text, re.M)) == set(NODES)
    environment = {**os.environ, 'PYTHONPATH': str(ROOT), 'PATH': '/usr/bin:/bin'}
    for name in NODES:
        file = prefix / 'lib' / 'sma_sim' / name
        assert os.access(file, os.X_OK), file
        words = [str(file), '--help']
        done = subprocess.run(words, env=environment, cwd='/', capture_output=True, text=True, timeout=120)
        assert done.returncode == 0 and done.stdout.startswith(f'usage: {name}'), done.stderr
