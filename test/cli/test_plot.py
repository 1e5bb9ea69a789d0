"""Figures of runs and recordings: drawn from whatever columns there are, refused where there is nothing to draw."""

import sys
from pathlib import Path

import numpy as np
import pytest

from sma_sim import Config, Model, UserError, module_input, simulate
from sma_sim.cli.main import main
from sma_sim.evidence.data.tables import read_columns
from sma_sim.model.structures.geometry import shape_of
from sma_sim.report.error_reduction_figure import draw_error_reduction
from sma_sim.report.palette import MODE_COLOURS, MODE_NAMES
from sma_sim.report.run_figure import draw_run
from sma_sim.solver.fixed_rate import FixedRateRun
from sma_sim.solver.inputs import inputs_at

sys.path[:0] = [str(Path(__file__).resolve().parents[2] / folder) for folder in ('docs', 'examples')]
from draw_module import draw_module  # noqa: E402
from make_structures import draw_structures, pose_of  # noqa: E402


@pytest.fixture(scope='module')
def columns():
    source = module_input([0, 2, 10, 20], [0, 12, -12, 0])
    run = simulate(Model(), source, 20.0)
    return inputs_at(source, run.time) | run.columns


@pytest.mark.parametrize('system', ['module', 'wire'])
@pytest.mark.parametrize('ending', ['svg', 'png', 'pdf'])
def test_plot_draws_what_simulate_writes(tmp_path, system, ending):
    source, out, picture = tmp_path / 'in.csv', tmp_path / 'out.csv', tmp_path / f'out.{ending}'
    source.write_text('time_s,J_eq_W,strain\n0,10,0.0\n2,0,0.05\n4,0,0.0\n')
    assert main(['simulate', '--input', str(source), '--out', str(out), '--system', system]) == 0
    assert main(['plot', str(out), '--out', str(picture)]) == 0
    assert picture.read_bytes()[:4] in (b'<?xm', b'\x89PNG', b'%PDF')
    if ending == 'svg':
        assert picture.read_text().count('<path') > 20


def test_default_name_is_beside_the_file(tmp_path, capsys):
    file = tmp_path / 'run.csv'
    file.write_text('time_s,alpha_rad\n0,0\n1,0.1\n')
    assert main(['plot', str(file)]) == 0
    assert capsys.readouterr().out.strip() == str(tmp_path / 'run.png')
    assert sorted(path.name for path in tmp_path.iterdir()) == ['run.csv', 'run.png']


def test_all_channels_have_a_labelled_panel(columns):
    figure = draw_run(columns, 'title')
    labels = [axis.get_ylabel() for axis in figure.axes]
    assert labels == ['alpha [deg]', 'U_y [mm]', 'U_x [mm]', 'T [deg C]', 'force [N]', 'x_M [-]', 'J_eq [W]', '']
    assert [text.get_text() for text in figure.axes[-1].get_yticklabels()] == ['wire 1', 'wire 2']
    legend = [text.get_text() for text in figure.legends[0].get_texts()]
    used = set(columns['mode_1']) | set(columns['mode_2'])
    assert legend == [MODE_NAMES[mode] for mode in sorted(used)] and len(legend) >= 2
    assert MODE_COLOURS.keys() == MODE_NAMES.keys() == {1, 2, 3, 4, 5}


def test_commands_of_a_stack_are_drawn():
    """One for each pair of wires, as they hold."""
    time = np.arange(5.0)
    figure = draw_run(
        {'time_s': time, 'J_eq_1_W': 12.0 * (time > 1), 'J_eq_2_W': -6.0 * (time > 2), 'alpha_1_rad': 0.1 * time}
    )
    axis = next(axis for axis in figure.axes if axis.get_ylabel() == 'J_eq [W]')
    assert [line.get_label() for line in axis.lines] == ['pair 1', 'pair 2']
    assert [line.get_ydata()[-1] for line in axis.lines] == [12.0, -6.0]
    assert all(line.get_drawstyle() == 'steps-post' for line in axis.lines)


def test_panels_of_every_structure():
    """Coordinates of any name, any number of bundles."""
    names = ('J_1_W', 'J_2_W', 'T_E_K', 'position_m', 'gamma_rad', 'F_1_N', 'T_1_K', 'T_12_K', 'x_M_1', 'mode_1')
    figure = draw_run({'time_s': np.arange(3.0)} | {name: np.array([1.0, 2.0, 3.0]) for name in names})
    labels = [axis.get_ylabel() for axis in figure.axes]
    assert labels == ['position [mm]', 'gamma [deg]', 'T [deg C]', 'force [N]', 'x_M [-]', 'J [W]', '']
    shown = {axis.get_ylabel(): [line.get_label() for line in axis.lines] for axis in figure.axes}
    assert shown['T [deg C]'] == ['wire 1', 'wire 12', 'ambient'] and shown['J [W]'] == ['bundle 1', 'bundle 2']
    assert figure.axes[0].lines[0].get_ydata() == pytest.approx([1e3, 2e3, 3e3])


def test_one_wire_alone_is_named(columns):
    """Otherwise nobody knows whose temperature it is."""
    figure = draw_run({name: columns[name] for name in ('time_s', 'T_2_K')})
    assert [text.get_text() for text in figure.axes[0].get_legend().get_texts()] == ['wire 2']


def test_nothing_is_drawn_over_anything(columns):
    """Legends, labels and panels keep apart."""
    figure = draw_run(columns)
    figure.draw_without_rendering()
    legend = figure.legends[0].get_window_extent()
    for axis in figure.axes:
        assert not legend.overlaps(axis.get_tightbbox())
    boxes = [axis.get_window_extent() for axis in figure.axes]
    assert all(upper.y0 > lower.y1 for upper, lower in zip(boxes, boxes[1:], strict=False))
    assert all(axis.get_tightbbox().x0 >= 0.0 for axis in figure.axes)


def labels_in_view(axis):
    """The labels of the ticks within the limits, of each of the two axes."""
    for one, (low, high) in ((axis.xaxis, sorted(axis.get_xlim())), (axis.yaxis, sorted(axis.get_ylim()))):
        texts = [tick.label1.get_text() for tick in one.get_major_ticks() if low <= tick.get_loc() <= high]
        yield [text for text in texts if text]


def test_every_axis_has_two_labelled_ticks(columns):
    halves = {name: column[: len(column) // 20] for name, column in columns.items()}
    errors = [(1.05, 1.0), (1.6, 1.02), (7.5, 1.0), (40.0, 9.6, 1.0), (3000.0, 20.0, 1.0)]
    reductions = [
        draw_error_reduction(
            [{'effects': ['gravity'] * (k > 0), 'train': e, 'held_out': 1.3 * e} for k, e in enumerate(part)]
        )
        for part in errors
    ]
    for figure in (draw_run(columns), draw_run(halves), draw_module(columns, [9.0], Model().constants), *reductions):
        figure.draw_without_rendering()
        for axis in figure.axes:
            if axis.axison:
                x, y = labels_in_view(axis)
                assert len(y) >= 2, axis.get_ylabel()
                assert len(x) >= 2 or axis.get_shared_x_axes().get_siblings(axis) != [axis], axis.get_ylabel()


def test_bands_follow_the_modes():
    time = np.array([0.0, 1.0, 2.0, 3.0, 4.0])
    figure = draw_run({'time_s': time, 'mode': np.array([3.0, 3.0, np.nan, 4.0, 4.0])})
    bands = [(bar.get_x(), bar.get_width()) for bar in figure.axes[0].patches]
    assert bands == [(0.0, 3.0), (3.0, 1.0)]


def test_recordings_with_empty_cells_are_drawn(tmp_path):
    """A row without measured cells says when the command changed."""
    file = tmp_path / 'run.csv'
    file.write_text('time_s,J_eq_W,alpha_rad,T_1_K,U_y_m\n0,0,0.0,298,\n0.5,5,,,\n1,5,0.1,nan,\n2,5,0.2,300,\n')
    assert main(['plot', str(file), '--out', str(tmp_path / 'run.svg')]) == 0
    columns = read_columns(file, ('time_s',), ('J_eq_W',), ('alpha_rad', 'T_1_K', 'U_y_m'))
    figure = draw_run(columns)
    assert [axis.get_ylabel() for axis in figure.axes] == ['alpha [deg]', 'T [deg C]', 'J_eq [W]']
    time, alpha = figure.axes[0].lines[0].get_xydata().T
    assert list(time) == [0.0, 1.0, 2.0] and np.radians(alpha) == pytest.approx([0.0, 0.1, 0.2])


@pytest.mark.parametrize(
    ('content', 'name', 'message'),
    [
        ('time_s,speed\n0,1\n1,2\n', 'a.png', 'run.csv: nothing to draw: expected some of the columns alpha_rad'),
        ('time_s,alpha_rad\n0,\n1,\n', 'a.png', 'nothing to draw'),
        ('t,alpha_rad\n0,1\n', 'a.png', 'has no column time_s'),
        ('', 'a.png', 'run.csv is empty'),
        ('time_s,alpha_rad\n', 'a.png', 'run.csv has a header but no rows'),
        ('time_s,alpha_rad\n0,1\n', 'a.png', 'run.csv: column time_s: expected at least two rows'),
        ('time_s,alpha_rad\n1,1\n0,1\n', 'a.png', 'with times that increase'),
        ('time_s,alpha_rad\n0,1\n,1\n', 'a.png', "row 3, column time_s: expected a number, got 'nothing'"),
        ('time_s,alpha_rad\n0,1\n1,much\n', 'a.png', "row 3, column alpha_rad: expected a number, got 'much'"),
        ('time_s,alpha_rad\n0,1\n1,inf\n', 'a.png', "row 3, column alpha_rad: expected a number, got 'inf'"),
        ('time_s,alpha_rad\n0,1\n1\n', 'a.png', "row 3, column alpha_rad: expected a number, got 'nothing'"),
        ('time_s,J_eq_W,alpha_rad\n0,1,1\n1,,1\n', 'a.png', "row 3, column J_eq_W: expected a number, got 'nothing'"),
        ('time_s,alpha_rad\n0,1\n1,2\n', 'a.jpeg', 'expected a name that ends in .png, .svg or .pdf'),
        ('time_s,alpha_rad\n0,1\n1,2\n', 'no/a.png', 'there is no folder'),
    ],
)
def test_plot_refuses(tmp_path, capsys, content, name, message):
    file = tmp_path / 'run.csv'
    file.write_text(content)
    assert main(['plot', str(file), '--out', str(tmp_path / name)]) == 2
    said = capsys.readouterr().err
    assert message in said and said.count('\n') == 1
    assert [path.name for path in tmp_path.iterdir()] == ['run.csv']


def test_plot_of_no_file(tmp_path, capsys):
    assert main(['plot', str(tmp_path / 'run.csv')]) == 2
    assert 'cannot read' in capsys.readouterr().err


def test_draw_run_says_what_it_can_draw():
    with pytest.raises(UserError, match='nothing to draw'):
        draw_run({'time_s': np.arange(3.0)})


def test_drawn_beam_ends_at_the_plate():
    along, across = shape_of(-6e-5, 2e-3, 0.08, Model().constants).beam.T
    assert (along[-1], across[-1]) == pytest.approx((0.1 - 6e-5, 2e-3))
    slope = np.gradient(across, along, edge_order=2)
    assert slope[0] == pytest.approx(0.0, abs=2e-3) and slope[-1] == pytest.approx(0.08, abs=2e-3)


def test_heated_wire_is_drawn_on_the_side_to_which_the_module_leans(columns):
    """Wire 1, heated, shortens; a positive angle leans to its side (EB-B2a)."""
    heated = int(np.searchsorted(columns['time_s'], 9.0))
    assert columns['alpha_rad'][heated] > 0.0 and columns['U_y_m'][heated] > 0.0
    figure = draw_module(columns, [9.0, 99.0], Model().constants)  # beyond the end: the last sample
    beam, wire_1, wire_2 = figure.axes[0].lines[:3]
    assert beam.get_xdata()[-1] > 0.0
    assert wire_1.get_xdata()[0] > wire_2.get_xdata()[0]
    assert wire_1.get_color() == MODE_COLOURS[int(columns['mode_1'][heated])]


def test_structures_are_drawn_at_rest_and_moved():
    """One panel each; wires in the colour of their mode, grey lines as at rest."""
    lever, stack = (
        FixedRateRun(Model(Config(system=name)), 1000.0, np.array(u))
        for name, u in (('lever', [0.0, 298.0]), ('stack', [0.0, 0.0, 0.0, 298.0]))
    )
    at_rest = [pose_of(lever), pose_of(stack)]
    lever.step(np.array([2.0, 298.0]), 3000, 3000)
    figure = draw_structures([lever, stack], at_rest)
    assert [axis.get_title() for axis in figure.axes[:2]] == ['lever', 'stack']
    lines = figure.axes[0].lines
    assert len(lines) == 2 * 4 and lines[-2].get_color() == MODE_COLOURS[pose_of(lever).modes[0]]
    moved = np.abs(np.subtract(lines[4].get_ydata(), lines[0].get_ydata())).max()  # the lever itself comes first
    assert moved > 5e-3 and len(figure.axes[1].lines) == 2 * (6 + 6)
