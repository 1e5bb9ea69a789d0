"""Every example runs as its reader would run it."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from sma_sim.cli.main import main

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / 'examples'


def run(*words, folder):
    done = subprocess.run([sys.executable, *map(str, words)], cwd=folder, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_five_lines(tmp_path):
    assert 'largest angle: 0.0' in run(EXAMPLES / 'five_lines.py', folder=tmp_path)


def test_closed_loop_reaches_its_targets(tmp_path):
    words = run(EXAMPLES / 'closed_loop_offline.py', folder=tmp_path).split()
    errors = [float(words[k - 1]) for k, word in enumerate(words) if word.startswith('deg')]
    assert len(errors) == 2 and max(np.abs(errors)) < 0.1


def test_draw_module(tmp_path):
    run(EXAMPLES / 'draw_module.py', 'picture.png', folder=tmp_path)
    assert (tmp_path / 'picture.png').stat().st_size > 10_000


def test_own_effect_turns_the_plate_back(tmp_path, capsys):
    command = tmp_path / 'step.csv'
    command.write_text('time_s,J_eq_W\n0,0\n1,12\n20,0\n')
    largest = []
    for words in ([], ['--config', str(EXAMPLES / 'own_effect' / 'robot.yaml')]):
        out = tmp_path / f'run{len(largest)}.csv'
        assert main(['simulate', '--input', str(command), '--out', str(out), *words]) == 0
        table = np.genfromtxt(out, delimiter=',', names=True)
        largest.append(table['alpha_rad'].max())
    assert largest[1] < 0.95 * largest[0]
    assert main(['effects', 'harness', '--config', str(EXAMPLES / 'own_effect' / 'robot.yaml')]) == 0
    assert 'stiffness of the harness' in capsys.readouterr().out


@pytest.mark.parametrize('file', sorted(EXAMPLES.rglob('*.py')), ids=lambda file: file.name)
def test_is_named_here(file):
    tests = (
        Path(__file__),
        ROOT / 'test' / 'ros' / 'test_node.py',
        ROOT / 'test' / 'ros' / 'test_controller.py',
        ROOT / 'test' / 'ros' / 'test_launch.py',
        ROOT / 'test' / 'model' / 'test_structures.py',
        ROOT / 'test' / 'gym' / 'test_gym.py',
    )
    assert any(file.stem in test.read_text() for test in tests)
