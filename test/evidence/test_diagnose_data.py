"""Data and wishes of all kinds: what a diagnosis makes of them, and what it says of those that it can make nothing of."""

import argparse
import json
from dataclasses import replace

import numpy as np
import pytest
from simulated_data import NOISE

from sma_sim import Config, Dataset, Recording, module_input
from sma_sim.challenge.files import recording_columns, write_challenge
from sma_sim.challenge.make import RecordingPlan, make_challenge
from sma_sim.cli import diagnose as diagnose_command
from sma_sim.cli.common.recording_options import read_data
from sma_sim.cli.main import main
from sma_sim.evidence.data.rosbag.run_writer import messages_of
from sma_sim.evidence.data.rosbag.writer import BagWriter, typestore
from sma_sim.evidence.diagnosis.diagnose import diagnose
from sma_sim.evidence.diagnosis.review import reviewed
from sma_sim.evidence.estimation.calibrate import FitOptions
from sma_sim.evidence.model_selection.nominal_fit import DiagnosisRequest
from sma_sim.report.html.diagnosis_page import write_diagnosis_page
from sma_sim.words.diagnosis_text import as_text

QUICK = DiagnosisRequest('mas', options=FitOptions(starts=1, intervals=False))


@pytest.fixture(scope='module')
def robot():
    """A robot that lacks gravity: three short runs."""
    return make_challenge(2, 1, kinds=['gravity'], forces=True, plan=RecordingPlan(duration=20.0, rate=10.0))


@pytest.fixture(scope='module')
def folder(robot, tmp_path_factory):
    home = tmp_path_factory.mktemp('data') / 'robot'
    write_challenge(robot, home, 'csv')
    return home


def without(recording, *channels, empty=()):
    """A recording with fewer channels; those of `empty` have no sample."""
    kept = {name: values for name, values in recording.channels.items() if name not in channels}
    return replace(recording, channels=kept | {name: np.full(len(recording.time), np.nan) for name in empty})


@pytest.mark.slow
def test_runs_with_different_channels_of_which_one_is_empty(tmp_path):
    """Two runs of a robot that lacks nothing: none is held out, and that is said."""
    robot = make_challenge(2, 0, forces=True, plan=RecordingPlan(duration=20.0, rate=10.0))
    one, two, _ = robot.dataset.recordings
    runs = Dataset((without(one, 'F_1', 'F_2'), without(two, 'U_x', empty=('F_1',))), robot.dataset.noise_std)
    found = diagnose(runs, robot.nominal, request=QUICK)
    assert found.verdict == 'none' and found.held_out == () and np.isnan(found.stages[-1].held_out)
    assert set(found.stages[-1].channel_errors) == {'U_x', 'U_y', 'alpha', 'F_2'} and found.stages[-1].train < 1.1
    assert any('No run was held out' in line for line in as_text(found))
    write_diagnosis_page(tmp_path / 'why.html', reviewed(found, runs, None, robot.nominal))
    assert 'No run was held out' in (tmp_path / 'why.html').read_text()


def test_a_robot_that_never_moved():
    """Nothing can be missed where nothing happens."""
    random, time = np.random.default_rng(0), np.arange(200) / 10.0
    still = {'U_x': -5.6e-5, 'U_y': 0.0, 'alpha': 0.0}
    source = module_input([0.0, 20.0], [0.0, 0.0])
    runs = tuple(
        Recording(f'run{k}', 'module', time, {c: v + NOISE[c] * random.normal(size=200) for c, v in still.items()}, source)
        for k in range(3)
    )
    found = diagnose(Dataset(runs, NOISE), Config(), request=QUICK)
    assert found.verdict == 'none' and found.stages[0].held_out < 1.2


def test_one_run_says_that_it_flatters(folder, tmp_path, capsys):
    """All the way through the command line, with every file; creep of the beam explains a single run as well as gravity."""
    outputs = [tmp_path / name for name in ('why.html', 'why.json', 'better.yaml')]
    words = ['--report', outputs[0], '--json', outputs[1], '-o', outputs[2], '--model', 'mas']
    assert main(['diagnose', *map(str, [folder / 'run1.csv', '--config', folder / 'nominal.yaml', *words])]) == 0
    said = capsys.readouterr().out
    assert 'one run was fitted' in said and all(str(path) in said and path.exists() for path in outputs)
    verdict = json.loads(outputs[1].read_text())
    assert verdict['held_out'] == [] and verdict['error'][0]['held_out'] is None
    ratios = {one['effect']: one['held_out_error_ratio'] for one in verdict['ranking'][:2]}
    assert 0.0 < ratios['gravity'] < 1.0 and verdict['probabilities']['effects']['gravity'] > 0.05


def test_a_bag_of_several_modules(robot, tmp_path, capsys):
    bag = BagWriter(tmp_path / 'both', {'epoch': '0'})
    for name, recording in zip(('left', 'right'), robot.dataset.recordings, strict=False):
        numbers = {}
        for nanoseconds, topic, kind, message in messages_of(recording_columns(recording)):
            if topic not in numbers:
                numbers[topic] = bag.add(f'/{name}/{topic}', kind)
            bag.write(numbers[topic], nanoseconds, bytes(typestore().serialize_cdr(message, kind)))
    bag.close()
    assert main(['diagnose', str(tmp_path / 'both')]) == 2
    said = capsys.readouterr().err
    assert 'several modules' in said and '/left, /right' in said and '--namespace' in said
    assert main(['diagnose', str(tmp_path / 'both'), '--namespace', 'top']) == 2
    assert 'no module in namespace /top; there is /left, /right' in capsys.readouterr().err
    chosen = data_of(['diagnose', str(tmp_path / 'both'), '--namespace', 'right'])
    assert len(chosen.recordings) == 1
    assert np.allclose(chosen.recordings[0].channels['alpha'], robot.dataset.recordings[1].channels['alpha'])


def data_of(words):
    """The recordings that a command would fit."""
    parser = argparse.ArgumentParser()
    diagnose_command.add_parser(parser.add_subparsers())
    return read_data(parser.parse_args(words), Config())[0]


def test_what_cannot_be_done_is_said(folder, tmp_path, capsys):
    empty = tmp_path / 'empty.csv'
    empty.write_text('time_s,J_eq_W,alpha_rad\n' + ''.join(f'{k / 10},1,nan\n' for k in range(50)))
    (tmp_path / 'folder.json').mkdir()
    data = [str(folder), '--config', str(folder / 'nominal.yaml')]
    for words, *said in (
        ([str(empty)], 'empty.csv', 'nothing measured in it'),
        ([*data, '--set', 'effects.paths=nowhere'], 'effects.paths', 'nowhere', 'not a folder'),
        ([*data, '--effect', 'gravitation'], 'unknown effect gravitation', 'gravity'),
        ([*data, '-o', str(tmp_path / 'no' / 'b.yaml')], 'cannot write', f'there is no folder {tmp_path / "no"}'),
        ([*data, '--report', str(tmp_path / 'no' / 'b.html')], 'cannot write', 'there is no folder'),
        ([*data, '--json', str(tmp_path / 'folder.json')], 'cannot write', 'it is a folder'),
        ([*data, '--report', 'why.txt'], 'why.txt', 'ends in .html'),
        ([*data, '--system', 'wire'], 'strain'),
        ([*data, '--hold-out', 'run1', 'run2', 'run3'], 'leave some to fit'),
        ([*data, '--model', 'mass'], 'invalid choice'),
    ):
        assert code_of(['diagnose', *words]) == 2
        message = capsys.readouterr().err
        assert 'Traceback' not in message, message
        for part in said:
            assert part in message, (words, message)


def code_of(words):
    """The exit code, also where argparse ends the program."""
    try:
        return main(words)
    except SystemExit as end:
        return end.code
