"""Data name code, and it is not run: folders of effects in a bag's metadata and beside recordings."""

import json
from pathlib import Path

import numpy as np
import pytest

from sma_sim import UserError, read_config
from sma_sim.cli.main import main
from sma_sim.evidence.data.rosbag.reader import read_bag
from sma_sim.evidence.data.rosbag.salvage import open_bag
from sma_sim.evidence.data.rosbag.writer import BagWriter
from sma_sim.evidence.data.tables import read_columns
from sma_sim.model.config import flat_parameters

EFFECT = """
from pathlib import Path
from sma_sim import Effect, Parameter
Path({marker!r}).touch()
def kernel(s, w, p):
    return -p.k * (s.T - 298.0)
EFFECT = Effect(
    name='own', port='wire_heat', equation='Q = -k (T - 298 K)', source='a test', description='more cooling',
    parameters=(Parameter('k', 1e-3, 'W/K', (0.0, 1.0), 'loss', '', 0.0),), kernel=kernel, systems=('module', 'wire'),
)
"""
OWN = {'effects.active': ['own'], 'effects.own.k': 2e-4}
REPLAY = ('--integration-rate', '1000', '--rate', '50')


@pytest.fixture
def marker(tmp_path):
    """The file that shows that an effect file was imported."""
    return tmp_path / 'the effect file was run'


def effect_folder(folder, marker):
    folder.mkdir(parents=True)
    (folder / 'own.py').write_text(EFFECT.format(marker=str(marker)))
    return folder


@pytest.fixture
def run(tmp_path, marker):
    """A run with the user's own effect as an mcap file, the folder of the effect, and the run's parameters."""
    home = effect_folder(tmp_path / 'my effects', marker)
    (tmp_path / 'command.csv').write_text('time_s,J_eq_W\n0,0\n1,12\n5,-6\n8,0\n9,0\n')
    words = ['--set', f'effects.paths={home}', '--effect', 'own:k=2e-4']
    out = tmp_path / 'run.mcap'
    assert main(['simulate', '--input', str(tmp_path / 'command.csv'), '--out', str(out), *REPLAY, *words]) == 0
    marker.unlink()
    return out, home, flat_parameters(read_config(words=[f'effects.paths={home}'], effects=['own:k=2e-4']))


def recorded_bag(path, run, parameters, inside=None):
    """The run as a bag of a node with these parameters, which may name a folder that lies inside the bag."""
    bag = BagWriter(path, {'epoch': '0', 'integration_rate': '1000.0', 'parameters': json.dumps(parameters)})
    numbers = {}
    for message in open_bag(run).messages():
        if message.topic not in numbers:
            numbers[message.topic] = bag.add(message.topic, message.kind)
        bag.write(numbers[message.topic], message.log_time, message.cdr)
    bag.close()
    if inside is not None:
        effect_folder(path / 'inside', inside)
    return path


def test_a_folder_inside_a_bag_is_not_opened(tmp_path, run, marker, capsys):
    marker.unlink(missing_ok=True)
    folder, out = tmp_path / 'bag' / 'inside', tmp_path / 'out.csv'
    bag = recorded_bag(tmp_path / 'bag', run[0], {**OWN, 'effects.paths': [str(folder)]}, inside=marker)
    capsys.readouterr()
    assert main(['simulate', '--input', str(bag), '--out', str(out)]) == 2
    said = capsys.readouterr().err
    assert not marker.exists() and not out.exists()
    assert f'--set effects.paths={folder}' in said and f'recorded in {bag}' in said and 'not run' in said
    assert main(['simulate', '--input', str(bag), '--out', str(out), '--effect', 'own']) == 2 and not marker.exists()
    assert main(['simulate', '--input', str(bag), '--out', str(out), '--set', f'effects.paths={folder}']) == 0
    assert marker.exists() and out.exists()


def test_a_folder_that_nothing_needs_is_not_opened_either(tmp_path, run, marker, capsys):
    marker.unlink(missing_ok=True)
    folder = tmp_path / 'bag' / 'inside'
    bag = recorded_bag(tmp_path / 'bag', run[0], {'effects.paths': [str(folder)]}, inside=marker)
    assert main(['simulate', '--input', str(bag), '--out', str(tmp_path / 'out.csv')]) == 0
    assert not marker.exists() and f"names folders of effects, ['{folder}']: not opened" in capsys.readouterr().err


def test_the_users_own_effects_replay_bit_for_bit(tmp_path, run, marker, capsys):
    """Once the folder is named; also where it has been moved since, or in a parameter file."""
    recording, home, parameters = run
    bag = recorded_bag(tmp_path / 'bag', recording, parameters)
    assert parameters['effects.paths'] == [str(home)]
    out = tmp_path / 'again.csv'
    marker.unlink(missing_ok=True)
    assert main(['simulate', '--input', str(bag), '--out', str(out), *REPLAY]) == 2 and not marker.exists()
    assert f"--set effects.paths='{home}'" in capsys.readouterr().err  # as a shell wants it: there is a space in it
    moved = home.rename(tmp_path / 'moved')
    (tmp_path / 'own.yaml').write_text('effects: {paths: [moved], active: [own], own: {k: 2.0e-4}}')
    before = read_bag(bag)
    for words in (['--set', f'effects.paths={moved}'], ['--config', str(tmp_path / 'own.yaml')]):
        assert main(['simulate', '--input', str(bag), '--out', str(out), *REPLAY, *words]) == 0
        again = read_columns(out, tuple(before))
        whole = np.isfinite(before['alpha_rad'])
        for name in ('U_x_m', 'U_y_m', 'alpha_rad', 'F_1_N', 'F_2_N', 'x_M_1', 'x_M_2'):
            assert np.array_equal(before[name][whole], again[name]), name


@pytest.mark.parametrize(
    ('words', 'stopped_at'),
    [
        (['fit', 'DATA'], 'sma_sim.cli.fit.calibrate'),
        (['compare', 'DATA'], 'sma_sim.cli.compare.compare'),
        (['diagnose', 'DATA'], 'sma_sim.cli.diagnose.diagnose'),
        (['latent', 'DATA'], 'sma_sim.cli.latent.estimate_latent_inputs'),
        (['next', 'DATA'], 'sma_sim.cli.next.next_experiment'),
        (['play', 'BAG'], 'sma_sim.ros.player.play'),
        (['plot', 'BAG'], None),
        (['bag', 'info', 'BAG'], None),
        (['bag', 'repair', 'BAG'], None),
        (['bag', 'convert', 'BAG', 'BAG.csv'], None),
        (['challenge', 'reveal', 'DATA'], None),
    ],
)
def test_no_command_opens_a_folder_named_in_data(tmp_path, run, marker, monkeypatch, words, stopped_at):
    """Up to where the command computes, with what it has read."""
    data = tmp_path / 'data'
    data.mkdir()
    named = {**OWN, 'effects.paths': [str(data / 'bag' / 'inside'), 'bag/inside', 'inside']}
    bag = recorded_bag(data / 'bag', run[0], named, inside=marker)
    (data / 'meta.json').write_text(json.dumps({'noise_std': {'alpha': 3e-4}, 'effects': named, **named}))
    marker.unlink(missing_ok=True)
    monkeypatch.chdir(data)
    reached = []

    def stop(*_, **__):
        reached.append(True)
        raise UserError('far enough')

    if stopped_at:
        if words[0] == 'play':
            pytest.importorskip('rclpy', reason='rclpy is not installed')
        monkeypatch.setattr(stopped_at, stop)
    main([word.replace('DATA', str(data)).replace('BAG', str(bag)) for word in words])
    assert not marker.exists() and bool(reached) == bool(stopped_at)


def test_parameters_that_are_no_parameters_are_said(tmp_path, run, capsys):
    for number, text in enumerate(('{', '[1]', '"x"')):
        bag = tmp_path / f'bag{number}'
        BagWriter(bag, {'epoch': '0', 'parameters': text}).close()
        for words in (['simulate', '--input', str(bag), '--out', str(tmp_path / 'out.csv')], ['bag', 'info', str(bag)]):
            assert main(words) == 2 and str(bag) in capsys.readouterr().err


@pytest.mark.parametrize('name', ['sma_module_sim', 'sma_model_check'])
def test_no_other_node_can_name_a_folder(tmp_path, marker, name):
    """`effects.paths` of a running node is its user's: a request to set it is refused, and nothing is imported."""
    rclpy = pytest.importorskip('rclpy', reason='rclpy is not installed')
    from sma_sim.ros.parameters import configure

    folder = effect_folder(tmp_path / 'remote', marker)
    context = rclpy.Context()
    rclpy.init(context=context, args=[])
    node = rclpy.node.Node(name, context=context, automatically_declare_parameters_from_overrides=True)
    try:
        configure(node)
        for parameter in ('effects.paths', 'effects.active'):
            (answer,) = node.set_parameters([rclpy.Parameter(parameter, value=[str(folder)])])
            assert not answer.successful and 'read-only' in answer.reason
        assert not marker.exists()
    finally:
        node.destroy_node()
        rclpy.try_shutdown(context=context)


def test_read_config_does_not_open_recorded_folders(tmp_path, marker):
    folder = effect_folder(tmp_path / 'folder', marker)
    recorded = {**OWN, 'effects.paths': [str(folder)]}
    with pytest.raises(UserError, match=r'recorded in a\.bag'):
        read_config(recorded=recorded, source='a.bag')
    assert not marker.exists()
    config = read_config(words=[f'effects.paths={folder}'], recorded=recorded)
    assert marker.exists() and config.effects[0].values == (2e-4,)
    assert Path(config.effects[0].effect.files[0]).parent == folder
