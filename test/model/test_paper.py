"""The paper's results again: the page and its figures are written, sane, and refused where they should be."""

import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from sma_sim import Model, UserError
from sma_sim.cli import paper as verb
from sma_sim.cli.main import main
from sma_sim.solver import paper_experiments
from sma_sim.solver.paper_experiments import (
    MODEL_KINDS,
    complete_run,
    paper_module,
    random_steps,
    slow_sine,
    stress_strain_loop,
)
from sma_sim.solver.simulate import STOPPED

ROOT = Path(__file__).resolve().parents[2]
FILES = ['hysteresis.png', 'loops.png', 'paper.md', 'random.png']


@pytest.fixture(scope='module')
def paper(tmp_path_factory):
    folder = tmp_path_factory.mktemp('page') / 'paper'
    assert main(['paper', '--out', str(folder), '--runs', '2', '--seed', '3']) == 0
    return folder


def rows(page, first):
    """Numbers in the cells of the table rows that begin with `first`."""
    lines = [line for line in page.splitlines() if re.match(rf'\| {first}', line)]
    assert lines, f'no row {first}'
    return [[float(number) for number in re.findall(r'-?\d+(?:\.\d+)?(?:e-?\d+)?', line)] for line in lines]


def test_page_links_to_its_figures(paper):
    page = (paper / 'paper.md').read_text()
    links = re.findall(r'\]\((\w+\.png)\)', page)
    assert sorted(links) == [name for name in FILES if name.endswith('png')]
    for link in links:
        assert 10_000 < (paper / link).stat().st_size < 200_000
    assert '{' not in page and 'nan' not in page and '--runs 2 --seed 3' in page
    assert sorted(os.listdir(paper)) == FILES
    assert [name for name in os.listdir(paper.parent) if name.startswith('.')] == []


def test_models_differ_a_little(paper):
    page = (paper / 'paper.md').read_text()
    for name, least, most in [(r'alpha \[deg\]', 0.005, 0.1), (r'U_y \[um\]', 1, 100), ('T of wire 1', 1e-4, 0.1)]:
        ((mean, rms, largest),) = [row[-3:] for row in rows(page, name)]
        assert mean <= rms <= largest and least < largest < most


def test_plateaus_are_where_the_closed_form_says(paper):
    table = rows((paper / 'paper.md').read_text(), '(?:292|315|338) ')
    assert [row[0] for row in table] == [292, 315, 338]
    for T_E, sigma_A, sigma_M, up, down, mas_up, mas_down in table:
        assert (sigma_A + sigma_M) / 2 == pytest.approx(121.35 + 2.13 * (T_E - 323))
        assert sigma_A - sigma_M == pytest.approx(12.3)
        assert (up, down) == (sigma_A, sigma_M)
        assert 0.3 < sigma_A - mas_up < 0.8 and 0.3 < mas_down - sigma_M < 0.8


def test_times_and_errors_are_sane(paper):
    page = (paper / 'paper.md').read_text()
    assert '| 1.75 s | 8.66 s | 80 % |' in page
    equal_error, default = rows(page, '... its largest error')
    assert max(equal_error) < 1e-3 and max(default) < 1e-4
    for hybrid, mas, saved in rows(page, '... mean time of a run'):
        assert saved == pytest.approx(100 * (1 - hybrid / mas), abs=1.5)
    assert rows(page, '... mean number of steps')[0][0] < rows(page, '... mean number of steps')[0][1]


def test_page_in_the_documentation_is_of_this_program(paper):
    def words(page):
        return re.sub(r'[-\d.e]+', '#', re.sub(r'Made by .*', '', page)).split()

    assert words((ROOT / 'docs' / 'reference' / 'paper.md').read_text()) == words((paper / 'paper.md').read_text())


def test_commands_repeat_with_their_seed():
    one, same, other = (random_steps(np.random.default_rng(seed)) for seed in (1, 1, 2))
    assert np.array_equal(one.values, same.values) and not np.array_equal(one.times, other.times)
    assert one.times[0] == 0.0 and one.times[-1] == 100.0
    assert np.abs(one.values[:, 0]).max() <= 15.0 and np.diff(one.times)[:-1].min() >= 2.0


def test_slow_sine_is_a_closed_symmetric_loop():
    sine = slow_sine()
    half = len(sine.J_eq) // 2
    for kind in MODEL_KINDS:
        alpha = np.degrees(sine.alpha[kind])
        assert alpha[0] == pytest.approx(alpha[-1], abs=1e-3)
        assert alpha[:half] == pytest.approx(-alpha[half:-1], abs=1e-3)
        assert 1.0 < alpha[half] - alpha[0] < 2.0
    assert np.degrees(np.abs(sine.alpha['hybrid'] - sine.alpha['mas'])).max() < 0.1


def test_loop_ends_unstrained():
    assert stress_strain_loop(315.0).strain[-1] == pytest.approx(0.0, abs=1e-12)
    assert abs(stress_strain_loop(315.0).stress['mas'][-1]) < 1e3


def test_a_run_that_is_cut_short_is_no_result(monkeypatch):
    def stopped(progress, reason):
        return type('Run', (), {'reason': reason, 'completed': False, 'end': 1.0})()

    source = random_steps(np.random.default_rng(1))
    monkeypatch.setattr(paper_experiments, 'simulate', lambda *_: stopped(_, STOPPED))
    with pytest.raises(KeyboardInterrupt):
        complete_run(Model(), source)
    monkeypatch.setattr(paper_experiments, 'simulate', lambda *_: stopped(_, 'step limit reached'))
    with pytest.raises(RuntimeError, match='mas: the run ended at 1 s: step limit reached'):
        complete_run(paper_module('mas', 1e-5), source)


@pytest.mark.skipif(sys.platform == 'win32', reason='signals')
def test_ctrl_c_leaves_nothing_behind(tmp_path, paper):
    command = [sys.executable, '-m', 'sma_sim.cli.main', 'paper', '--out', 'page', '--runs', '5000']
    environment = os.environ | {'PYTHONPATH': str(ROOT)}
    with subprocess.Popen(command, cwd=tmp_path, env=environment, stderr=subprocess.PIPE, text=True) as process:
        while 'random run 3 ' not in (line := process.stderr.readline()):
            assert line, 'ended by itself'
        process.send_signal(signal.SIGINT)
        said = process.stderr.read()
    assert process.returncode == 130 and said.endswith('sma-sim paper: stopped\n') and 'Traceback' not in said
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ('words', 'message'),
    [
        (['--runs', '0'], '--runs 0: expected at least 1'),
        (['--seed', '-1'], '--seed -1: expected 0 or more'),
        (['--out', '/nowhere/paper'], 'there is no folder /nowhere'),
    ],
)
def test_paper_refuses(words, message, capsys):
    assert main(['paper', *words]) == 2
    assert message in capsys.readouterr().err


def test_paper_does_not_overwrite(paper, capsys):
    before = (paper / 'paper.md').stat()
    assert main(['paper', '--out', str(paper), '--runs', '2']) == 2
    said = capsys.readouterr().err
    assert f'{paper} exists already' in said and '--overwrite' in said
    assert (paper / 'paper.md').stat() == before


@pytest.fixture
def quick(monkeypatch):
    """The verb without its simulations."""

    def write(folder, seed):
        (folder / 'paper.md').write_text(f'seed {seed}')

    monkeypatch.setattr(verb, 'repeat_paper', lambda runs, seed, on_progress: seed)
    monkeypatch.setattr(verb, 'write_paper', write)


def test_overwrite_replaces_only_its_own_files(quick, tmp_path, capsys):
    out = tmp_path / 'paper'
    out.mkdir()
    assert main(['paper', '--out', str(out), '--seed', '7']) == 0  # an empty folder is nobody's
    assert main(['paper', '--out', str(out), '--seed', '8', '--overwrite']) == 0
    assert (out / 'paper.md').read_text() == 'seed 8'
    (out / 'notes.txt').write_text('mine')
    assert main(['paper', '--out', str(out), '--overwrite']) == 2
    assert f'{out} holds other files (notes.txt)' in capsys.readouterr().err
    assert sorted(os.listdir(out)) == ['notes.txt', 'paper.md']
    assert os.listdir(tmp_path) == ['paper']


def test_a_file_in_its_place_is_left_alone(quick, tmp_path, capsys):
    out = tmp_path / 'paper'
    out.write_text('mine')
    assert main(['paper', '--out', str(out), '--overwrite']) == 2
    assert 'it is a file' in capsys.readouterr().err and out.read_text() == 'mine'


def test_files_that_come_meanwhile_are_left_alone(monkeypatch, tmp_path):
    out = tmp_path / 'paper'

    def write(folder, results):
        out.mkdir()
        (out / 'notes.txt').write_text('mine')

    monkeypatch.setattr(verb, 'repeat_paper', lambda runs, seed, on_progress: None)
    monkeypatch.setattr(verb, 'write_paper', write)
    assert main(['paper', '--out', str(out)]) == 2
    assert os.listdir(tmp_path) == ['paper'] and os.listdir(out) == ['notes.txt']
    with pytest.raises(UserError, match='holds other files'):
        verb.check_output_folder(out, True)
