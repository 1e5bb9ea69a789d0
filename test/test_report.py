"""Figures and the page of the paper: written, sane, refused where they should be."""

import re

import numpy as np
import pytest

from sma_sim import Model, module_input, simulate
from sma_sim.cli.main import main
from sma_sim.report.module_figure import beam_line


@pytest.fixture(scope='module')
def paper(tmp_path_factory):
    folder = tmp_path_factory.mktemp('page') / 'paper'
    assert main(['paper', '--out', str(folder), '--runs', '2']) == 0
    return folder


def test_page_links_to_its_figures(paper):
    page = (paper / 'paper.md').read_text()
    links = re.findall(r'\]\((\w+\.png)\)', page)
    assert sorted(links) == ['hysteresis.png', 'loops.png', 'random.png']
    for link in links:
        assert (paper / link).stat().st_size > 10_000
    assert '{' not in page


def test_numbers_of_the_page_are_sane(paper):
    page = (paper / 'paper.md').read_text()
    assert 0.005 < float(re.search(r'at most\n([0-9.]+) deg in alpha', page).group(1)) < 0.1
    assert '| 1.75 s | 8.66 s | 80 % |' in page
    rows = [row.strip('| ') for row in page.splitlines() if re.match(r'\| (292|315|338) ', row)]
    loops = [[float(cell) for cell in row.split('|')] for row in rows]
    assert [row[0] for row in loops] == [292, 315, 338]
    for row in loops:
        assert row[1] - row[2] == pytest.approx(12.3) and 0.0 < row[3] < 1.0


@pytest.mark.parametrize(
    ('words', 'message'),
    [(['--runs', '0'], 'expected at least 1'), (['--out', '/nowhere/paper'], 'there is no folder /nowhere')],
)
def test_paper_refuses(words, message, capsys):
    assert main(['paper', *words]) == 2
    assert message in capsys.readouterr().err


def test_paper_does_not_overwrite(paper, capsys):
    assert main(['paper', '--out', str(paper), '--runs', '2']) == 2
    assert 'exists already' in capsys.readouterr().err


@pytest.mark.parametrize('system', ['module', 'wire'])
def test_plot_draws_what_simulate_writes(tmp_path, system):
    source, out, picture = tmp_path / 'in.csv', tmp_path / 'out.csv', tmp_path / 'out.svg'
    source.write_text('time_s,J_eq_W,strain\n0,10,0.0\n2,0,0.05\n4,0,0.0\n')
    assert main(['simulate', '--input', str(source), '--out', str(out), '--system', system]) == 0
    assert main(['plot', str(out), '--out', str(picture)]) == 0
    drawn = picture.read_text()
    assert drawn.startswith('<?xml') and drawn.count('<path') > 20


@pytest.mark.parametrize(
    ('content', 'name', 'message'),
    [
        ('time_s,speed\n0,1\n1,2\n', 'a.png', 'nothing to draw: expected some of the columns alpha_rad'),
        ('t,alpha_rad\n0,1\n', 'a.png', 'has no column time_s'),
        ('time_s,alpha_rad\n0,1\n1,2\n', 'a.jpeg', 'expected a name that ends in .png, .svg or .pdf'),
    ],
)
def test_plot_refuses(tmp_path, capsys, content, name, message):
    file = tmp_path / 'run.csv'
    file.write_text(content)
    assert main(['plot', str(file), '--out', str(tmp_path / name)]) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / name).exists()


def test_drawn_beam_ends_at_the_plate():
    along, across = beam_line(-6e-5, 2e-3, 0.08, 0.1)
    assert (along[-1], across[-1]) == pytest.approx((0.1 - 6e-5, 2e-3))
    slope = np.gradient(across, along, edge_order=2)
    assert slope[0] == pytest.approx(0.0, abs=2e-3) and slope[-1] == pytest.approx(0.08, abs=2e-3)


def test_heated_wire_is_drawn_on_the_side_to_which_the_module_leans():
    """Wire 1, heated, shortens; a positive angle leans to its side (EB-B2a)."""
    run = simulate(Model(), module_input([0, 10], [12, 12]), 1.0)
    assert run['alpha_rad'][-1] > 0.0 and run['U_y_m'][-1] > 0.0
