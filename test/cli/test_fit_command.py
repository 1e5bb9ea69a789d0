"""`sma-sim fit`: what it finds, what it writes, what it says when it is used wrongly."""

import html
import json
import os
import re
import signal
from pathlib import Path

import numpy as np
import pytest
from measured_runs import truth, write_isotherm, write_module_runs

import sma_sim.cli.fit as fit_command
from sma_sim.cli.main import main
from sma_sim.model.config import read_config
from sma_sim.model.given import read_yaml

TRUE = {'wire.lambda': 1.1 * 450.0, 'beam.E': 0.94 * 2e9}
FREE = ['--free', 'wire.lambda,beam.E', '--model', 'hybrid', '--starts', '1']


@pytest.fixture(scope='module')
def runs(tmp_path_factory):
    return write_module_runs(tmp_path_factory.mktemp('runs'), truth(wire__lambda=1.1, beam__E=0.94))


@pytest.fixture(scope='module')
def fitted(runs, tmp_path_factory):
    """What a fit with one run held out writes: parameter file, data for programs, page."""
    folder = tmp_path_factory.mktemp('fitted')
    out, data, page = folder / 'fitted.yaml', folder / 'fit.json', folder / 'fit.html'
    words = ['fit', str(runs), '--hold-out', 'run3', *FREE, '-o', str(out), '--json', str(data), '--report', str(page)]
    assert main(words) == 0
    return out, json.loads(data.read_text()), page


def test_known_parameters_come_back(fitted):
    parameters = fitted[1]['parameters']
    for name, value in TRUE.items():
        assert parameters[name]['value'] == pytest.approx(value, rel=5e-3)
        assert parameters[name]['low'] < value < parameters[name]['high']
    assert fitted[1]['implausible'] == []
    by_recording = fitted[1]['by_recording']
    assert by_recording['agree'] and by_recording['recording'] is None
    assert set(by_recording['parameters']['wire.lambda']['recordings']) == {'run1', 'run2'}
    assert by_recording['text'] in html.unescape(fitted[2].read_text())
    assert 0.9 < fitted[1]['error']['train'] < 1.1
    assert 0.9 < fitted[1]['error']['held_out'] < 1.1


def test_held_out_runs_stand_beside_the_fitted_ones(fitted):
    assert {name: run['held_out'] for name, run in fitted[1]['error']['runs'].items()} == {
        'run1': False,
        'run2': False,
        'run3': True,
    }
    assert 'run3 (held out)' in fitted[2].read_text()


def test_the_parameter_file_is_one_for_ros_and_for_us(fitted):
    text = fitted[0].read_text()
    assert text.startswith('# Fitted by sma-sim fit to run1, run2') and 'ros__parameters:' in text
    assert read_yaml(fitted[0])['wire']['lambda'] == fitted[1]['parameters']['wire.lambda']['value']
    config = read_config(fitted[0])
    assert config.parameters['beam.E'] == fitted[1]['parameters']['beam.E']['value']
    assert np.isfinite(config.parameters['initial.x_M_1'])


def test_the_node_runs_the_parameter_file(fitted):
    pytest.importorskip('rclpy', reason='no ROS here')
    import ros_client
    from std_msgs.msg import Float64MultiArray

    with ros_client.Simulation('--params-file', str(fitted[0]), topics=[(Float64MultiArray, 'phase_fractions')]) as one:
        one.until(lambda: one.seen['phase_fractions'], ros_client.FIRST_MESSAGE)
        start = one.seen['phase_fractions'][0].data[0]
        code, log = one.stop()
    assert code == 0, log
    assert start == pytest.approx(read_config(fitted[0]).parameters['initial.x_M_1'], abs=1e-3)


def test_terminal_shows_a_short_table(runs, capsys):
    assert main(['fit', str(runs), '--hold-out', 'run2', 'run3', *FREE]) == 0
    out = capsys.readouterr().out
    for word in ('wire.lambda', '95 % interval', 'W/(m^2 K)', 'fitted runs', 'run3 (held out)', 'delay of the measurement'):
        assert word in out


def test_hold_out_takes_files_outside_the_data(runs, tmp_path, capsys):
    words = ['fit', str(runs / 'run1.csv'), '--hold-out', str(runs / 'run3.csv'), *FREE, '--json', str(tmp_path / 'a.json')]
    assert main(words) == 0
    found = json.loads((tmp_path / 'a.json').read_text())['error']['runs']
    assert {name: run['held_out'] for name, run in found.items()} == {'run1': False, 'run3': True}


def test_ctrl_c_leaves_the_best_so_far(runs, tmp_path, monkeypatch, capsys):
    told, words = [], fit_command.iteration_words

    def interrupting(label, iteration, cost):
        told.append(cost)
        if len(told) == 3:
            os.kill(os.getpid(), signal.SIGINT)
        return words(label, iteration, cost)

    monkeypatch.setattr(fit_command, 'iteration_words', interrupting)
    out = tmp_path / 'best.yaml'
    assert main(['fit', str(runs), '--model', 'hybrid', '--starts', '1', '-o', str(out)]) == 130
    assert 'stopped: the best so far' in capsys.readouterr().out
    assert read_config(out).parameters['beam.E'] != 2e9


def test_own_effects_are_fitted_and_found_again(runs, tmp_path):
    """The fitted file names the folder of the effect from where it lies itself."""
    out = tmp_path / 'elsewhere' / 'fitted.yaml'
    out.parent.mkdir()
    config = Path(__file__).resolve().parents[2] / 'examples' / 'own_effect' / 'robot.yaml'
    words = ['fit', str(runs), '--config', str(config), '--free', 'wire.lambda,beam.E,effects.harness.k']
    assert main([*words, '--model', 'hybrid', '--starts', '1', '-o', str(out)]) == 0
    effect = read_config(out).effects[0]
    assert effect.effect.name == 'harness' and effect.values[0] != 0.3


def test_a_cluster_does_the_work(runs, tmp_path):
    distributed = pytest.importorskip('distributed', reason='Dask is not installed')
    here, there = tmp_path / 'here.json', tmp_path / 'there.json'
    words = ['fit', str(runs / 'run1.csv'), '--free', 'beam.E', '--model', 'hybrid', '--starts', '1']
    assert main([*words, '--json', str(here)]) == 0
    with distributed.LocalCluster(n_workers=1, threads_per_worker=2, processes=True, dashboard_address=None) as cluster:
        assert main([*words, '--json', str(there), '--scheduler', cluster.scheduler_address]) == 0
    one, two = (json.loads(path.read_text())['parameters']['beam.E']['value'] for path in (here, there))
    assert one == pytest.approx(two, rel=1e-6)


def test_a_wire_is_told_run_by_run(tmp_path, capsys):
    """Two temperatures that one dsigma does not fit."""
    for T_E, width in ((300.0, 1.0), (320.0, 1.0), (340.0, 1.6)):
        write_isotherm(tmp_path / f'at_{T_E:.0f}K.csv', truth('wire', wire__dsigma=width), T_E)
    words = ['fit', str(tmp_path), '--system', 'wire', '--model', 'hybrid', '--starts', '1', '--noise', 'stress=1e6']
    assert main([*words, '--free', 'wire.sigma_MW0,wire.dsigma', '--json', str(tmp_path / 'a.json')]) == 0
    assert 'one dsigma does not fit all runs' in capsys.readouterr().out
    found = json.loads((tmp_path / 'a.json').read_text())['run_by_run']
    assert [run['temperature'] for run in found['runs']] == pytest.approx([300.0, 320.0, 340.0])
    widths = [run['dsigma'][0] for run in found['runs']]
    assert widths == pytest.approx([12.3e6, 12.3e6, 1.6 * 12.3e6], rel=0.1)


@pytest.mark.parametrize(
    ('words', 'message'),
    [
        (['{runs}', '--hold-out', 'run9'], r'--hold-out run9: no such file and no such recording.*run1, run2, run3'),
        (['{runs}', '--hold-out', 'run1', 'run2', 'run3'], r'that is all there is .*leave some to fit'),
        (['{runs}', '--free', 'wire.lamda'], r'free wire.lamda: .*did you mean wire.lambda'),
        (['{runs}', '--starts', '0'], r'starts = 0: expected a whole number, 1 or more'),
        (['{runs}', '--noise', 'alpha'], r'--noise alpha: expected CHANNEL=STD'),
        (['{runs}', '--noise', 'alpha=small'], r'--noise alpha=small: expected CHANNEL=STD'),
        (['{runs}', '--noise', 'beta=1'], r'beta'),
        (['{runs}', '--report', 'page.pdf'], r'page.pdf: expected a name that ends in .html'),
        (['{runs}', '--json', 'out.txt'], r'out.txt: expected a name that ends in .json'),
        (['{runs}', '-o', '{runs}/none/fitted.yaml'], r'cannot write .*there is no folder'),
        (['{runs}', '--system', 'wire'], r'strain'),
        (['{runs}/none.csv'], r'cannot read .*none.csv'),
        (['{runs}', '--scheduler', 'nowhere'], r'--scheduler'),
        (['{runs}', '--set', 'wire.E_A=-1'], r'wire.E_A = -1 Pa'),
        (['{runs}', '--effect', 'gravty'], r'unknown effect gravty.*did you mean gravity'),
    ],
)
def test_wrong_use_is_said(runs, words, message, capsys):
    words = [word.replace('{runs}', str(runs)) for word in words]
    assert main(['fit', *words]) == 2
    error = capsys.readouterr().err.splitlines()[-1]
    assert error.startswith('sma-sim fit: ')
    assert re.search(message, error), error


@pytest.mark.parametrize('words', [[], ['--model', 'both', 'x.csv'], ['x.csv', '--starts', 'many']])
def test_words_that_the_parser_refuses(words, capsys):
    with pytest.raises(SystemExit) as stop:
        main(['fit', *words])
    assert stop.value.code == 2


def test_no_output_takes_the_place_of_what_is_read(tmp_path, capsys):
    """Recordings of a folder, the noise that is stated beside them, the model; and nothing is called what it is not."""
    (tmp_path / 'case').mkdir()
    case = write_module_runs(tmp_path / 'case', truth())
    meta, model, run = case / 'meta.json', tmp_path / 'model.yaml', next(case.glob('*.csv'))
    meta.write_text('{"noise_std": {"alpha": 0.0003}}')
    model.write_text('/**:\n  ros__parameters:\n    beam: {E: 2.0e+9}\n')
    given, before = [str(case), '--config', str(model)], [path.read_text() for path in (meta, model, run)]
    for words, said in (
        (['fit', *given, '--json', str(meta)], f'it is read as {meta}, and would be lost'),
        (['fit', *given, '-o', str(model)], f'it is read as {model}, and would be lost'),
        (['next', *given, '-o', str(run)], f'it is read as {run}, and would be lost'),
        (['next', *given, '-o', str(tmp_path / 'next.xlsx')], 'no Excel workbook is written; expected a table as text'),
        (['latent', *given, '-o', 'a.html', '--report', 'b.html'], '-o a.html and --report b.html are the same page'),
    ):
        assert main(words) == 2
        assert said in capsys.readouterr().err
    assert [path.read_text() for path in (meta, model, run)] == before
