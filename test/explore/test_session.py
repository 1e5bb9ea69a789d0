"""A session's folder: versions that are never lost, one process at a time, messages for what is broken or foreign."""

import json
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from sma_sim import UserError, read_config
from sma_sim.cli.main import main
from sma_sim.explore import session as session_module
from sma_sim.explore.history import History, Version, history_from
from sma_sim.explore.jobs import new_job
from sma_sim.explore.lock import FolderBusyError
from sma_sim.explore.session import ConflictError, Start, open_session
from sma_sim.explore.stages import Engine
from sma_sim.explore.worker import write_state
from sma_sim.model.config import flat_parameters
from sma_sim.workflow.data_request import DataRequest

OWN_EFFECT = """
from sma_sim import Effect, Parameter

EFFECT = Effect(name='cooler', title='Cooler', port='wire_heat', equation='Q = -p.q', description='d', source='test',
    signature='s', parameters=(Parameter('q', 0.1, 'W', (0.0, 1.0), 'heat lost', '', 0.0, (0.05, 0.5)),),
    kernel=lambda s, w, p: -p.q)
"""


@pytest.fixture
def folder(tmp_path):
    return tmp_path / 'session'


def test_changes_are_versions(folder):
    with open_session(folder, Start(words=('beam.E=1.9e9',))) as session:
        second = session.change({'wire.E_A': 12.5e9}, ['gravity'], words='a stiffer wire')
        third = session.change({'effects.gravity.g_x': 1.0, 'model': 'mas'})
        assert [second.number, third.number, third.parent] == [2, 3, 2]
        assert second.words == 'a stiffer wire' and third.words == 'model hybrid -> mas, effects.gravity.g_x 0 -> 1 m/s^2'
        assert session.config().parameters['beam.E'] == 1.9e9 and session.config().simulated_kinetics == 'mas'
        assert session.config(2).parameters['wire.E_A'] == 12.5e9 and session.config(2).simulated_kinetics == 'hybrid'
        assert session.change({'wire.E_A': 12.5e9}) == third, 'nothing changed'
        assert session.change(effects=[]).words == 'gravity off'


def test_undo_redo_and_branches(folder):
    with open_session(folder) as session:
        for value in (2.1e9, 2.2e9):
            session.change({'beam.E': value})
        assert [session.undo().number, session.undo().number] == [2, 1]
        assert not session.can_undo and session.can_redo
        with pytest.raises(UserError, match='nothing to undo'):
            session.undo()
        assert session.redo().number == 2
        branch = session.change({'beam.E': 2.3e9})
        assert (branch.number, branch.parent) == (4, 2) and not session.can_redo
        with pytest.raises(UserError, match='nothing to redo'):
            session.redo()
        assert session.go_to(3).number == 3 and session.config().parameters['beam.E'] == 2.2e9
        assert session.undo().number == 2 and session.redo().number == 3, 'redo leads back to where undo came from'
        with pytest.raises(UserError, match='no version 9: expected 1 to 4'):
            session.go_to(9)


def test_names_and_differences(folder):
    with open_session(folder) as session:
        session.change({'beam.E': 2.2e9}, ['gravity'])
        assert session.rename(2, ' with\ngravity ').name == 'with gravity'
        found = {one.name: one for one in session.differences(1, 2)}
        assert list(found) == ['effects.gravity', 'beam.E', 'effects.gravity.g_y', 'effects.gravity.g_x']
        assert (found['beam.E'].before, found['beam.E'].after, found['beam.E'].unit) == (2e9, 2.2e9, 'Pa')
        assert (found['effects.gravity'].before, found['effects.gravity.g_y'].before) == (False, None)
        assert session.differences(2, 2) == ()
        json.dumps(session.as_data(), allow_nan=False)


def test_a_preview_writes_nothing_and_is_checked(folder):
    with open_session(folder) as session:
        revision = session.revision
        assert session.preview({'beam.E': 2.2e9}, ['gravity']).effects[0].effect.name == 'gravity'
        assert session.revision == revision and len(list((folder / 'versions').iterdir())) == 1
        for values, effects, words in (
            ({'beam.E': -1.0}, None, 'beam.E = -1 Pa'),
            ({'beam.X': 1.0}, None, 'unknown parameter beam.X'),
            ({'beam.E': float('nan')}, None, 'expected'),
            ({}, ['gravitation'], 'unknown effect gravitation'),
            ({'model': 'x'}, None, 'hybrid, mas'),
            ({}, ['gravity', 'gravity'], 'twice'),
            ({'beam.E': [1]}, None, 'number'),
            ({}, [3], 'list of names'),
        ):
            with pytest.raises(UserError, match=words):
                session.change(values, effects)
        assert session.revision == revision


def test_found_again_and_read_by_the_commands(folder, capsys):
    with open_session(folder) as session:
        session.change({'beam.E': 2.2e9 / 3.0}, ['gravity', 'natural_convection'])
        session.change({'wire.E_A': 1.23456789012345e10})
        session.undo()
        before, file = session.as_data(), session.file()
    with open_session(folder) as again:
        assert again.as_data() == before
        assert again.redo().number == 3
    assert flat_parameters(read_config(file))['beam.E'] == 2.2e9 / 3.0
    assert main(['add', 'sensor_misalignment', '--config', str(file), '-o', str(folder.parent / 'more.yaml')]) == 0
    assert 'gravity, natural_convection, sensor_misalignment' in capsys.readouterr().out


def test_a_session_that_exists_takes_what_is_given(folder, tmp_path):
    data = DataRequest((tmp_path / 'a.csv',), ('a',), tmp_path / 'map.yaml', {'alpha': 3.5e-4}, 'robot')
    with open_session(folder, Start(data=data)) as session:
        assert session.data == data
    with open_session(folder, Start(words=('beam.E=2.2e9',), effects=('gravity',))) as session:
        assert session.data == data and session.current.number == 2 and session.config().parameters['beam.E'] == 2.2e9
    with open_session(folder, Start(data=DataRequest((tmp_path / 'b.csv',)))) as session:
        assert session.current.number == 2
    with open_session(folder) as session:
        assert session.data == DataRequest((tmp_path / 'b.csv',))


def test_a_version_is_made_of_the_one_that_was_seen(folder):
    with open_session(folder) as session:
        session.change({'beam.E': 2.2e9}, expected=1)
        for stale in (
            lambda: session.change({'beam.E': 2.3e9}, expected=1),
            lambda: session.undo(expected=1),
            lambda: session.go_to(1, expected=1),
        ):
            with pytest.raises(ConflictError, match='gone to version 2'):
                stale()
        assert session.current.number == 2


def test_many_tabs_at_once(folder):
    with open_session(folder) as session, ThreadPoolExecutor(8) as tabs:
        list(tabs.map(lambda k: session.change({'beam.E': 2e9 + k}), range(1, 25)))
        versions = session.versions
    assert [version.number for version in versions] == list(range(1, 26))
    with open_session(folder) as again:
        assert again.versions == versions
        assert {again.config(v.number).parameters['beam.E'] for v in versions} == {2e9 + k for k in range(25)}


def test_one_process_at_a_time(folder):
    with open_session(folder):
        with pytest.raises(FolderBusyError, match='in use by another process .process'):
            open_session(folder)
        program = 'from pathlib import Path\nfrom sma_sim.explore.session import open_session\n'
        program += f'open_session(Path({str(folder)!r}))'
        done = subprocess.run([sys.executable, '-c', program], capture_output=True, text=True)
        assert done.returncode != 0 and 'is in use by another process' in done.stderr
    with open_session(folder) as session:
        assert session.current.number == 1


def test_a_killed_process_loses_nothing(folder):
    program = (
        'import os, signal\nfrom pathlib import Path\nfrom sma_sim.explore.session import open_session\n'
        f'session = open_session(Path({str(folder)!r}))\nsession.change({{"beam.E": 2.2e9}})\n'
        'os.kill(os.getpid(), signal.SIGKILL)'
    )
    assert subprocess.run([sys.executable, '-c', program]).returncode == -9
    with open_session(folder) as session:
        assert session.current.number == 2 and session.config().parameters['beam.E'] == 2.2e9


@pytest.mark.parametrize('last', ['history.json', '0002.yaml'])
def test_a_disk_that_fills_up(folder, monkeypatch, last):
    whole = session_module.write_whole

    def full(path, fill):
        if path.name == last:
            raise UserError(f'cannot write {path}: No space left on device')
        whole(path, fill)

    with open_session(folder) as session:
        before = session.as_data()
        monkeypatch.setattr(session_module, 'write_whole', full)
        with pytest.raises(UserError, match='No space left'):
            session.change({'beam.E': 2.2e9})
        assert session.as_data() == before
        monkeypatch.undo()
        assert session.change({'beam.E': 2.3e9}).number == (3 if last == 'history.json' else 2)
    with open_session(folder) as session:
        assert session.config().parameters['beam.E'] == 2.3e9


def own_effect(folder, name='own', further=''):
    """A folder with an effect, which is named as `effects.paths` of a command line."""
    (folder / name).mkdir()
    (folder / name / 'cooler.py').write_text(OWN_EFFECT + further)
    return f'effects.paths={folder / name}'


def test_effects_of_the_users_own(tmp_path):
    named = own_effect(tmp_path)
    (tmp_path / 'robot.yaml').write_text('effects: {paths: [own], active: [cooler]}\n')
    with open_session(tmp_path / 's', Start(tmp_path / 'robot.yaml')) as session:
        session.change({'effects.cooler.q': 0.2})
        session.change({'beam.E': 2.2e9})
    shutil.move(tmp_path / 's', tmp_path / 'moved')
    with open_session(tmp_path / 'moved', Start(words=(named,))) as session:
        (active,) = session.config().effects
        assert active.effect.name == 'cooler' and active.values == (0.2,)
        assert session.current.number == 3, 'folders that are named again are no other model'


def test_effects_of_the_users_own_join_a_session_that_exists(tmp_path):
    open_session(tmp_path / 's', Start(words=('beam.E=2.2e9',))).close()
    with open_session(tmp_path / 's', Start(words=(own_effect(tmp_path),))) as session:
        assert session.current.number == 2 and session.config().parameters['beam.E'] == 2.2e9
        assert session.change(effects=['cooler']).words == 'cooler on'


@pytest.mark.parametrize('place', ['outside', 'inside', 'a version gone to', 'a model that is accepted', 'a structure'])
def test_python_files_that_only_a_session_names_are_not_run(tmp_path, place):
    """A session may be somebody else's: what its files name is not imported, and the message says how it would be."""
    folder, ran = tmp_path / 's', tmp_path / 'ran'
    with open_session(folder) as session:
        session.change({'beam.E': 2.2e9})
    named = own_effect(folder if place == 'inside' else tmp_path, further=f'open({str(ran)!r}, "w")')
    where, group = named.partition('=')[2], 'structures' if place == 'a structure' else 'effects'
    job = new_job(folder, 'calibrate', 2, {}, '')
    files = {
        'a version gone to': folder / 'versions' / '0001.yaml',
        'a model that is accepted': job.folder / 'parameters.yaml',
    }
    file = files.get(place, folder / 'versions' / '0002.yaml')
    write_state(job, 'done', 'done')
    file.write_text(f'{group}: {{paths: ["{where}"]}}\n')
    words = f'only data name its folder.*--set {group}.paths={where}'
    with pytest.raises(UserError, match=words), open_session(folder) as session:
        assert place in files
        Engine(session).accept(job.number) if 'accepted' in place else session.undo()
    assert not ran.exists()
    if place != 'a structure':
        with open_session(folder, Start(words=(named,))) as session:
            Engine(session).accept(job.number) if 'accepted' in place else session.go_to(int(file.stem))
            assert session.change(effects=['cooler']).number > 2 and ran.exists()


@pytest.mark.parametrize(
    ('name', 'text', 'words'),
    [
        ('history.json', '', 'history.json is broken'),
        ('history.json', '[]', 'format 1'),
        ('history.json', '{"format": 2}', 'format 1'),
        ('history.json', '{"format": 1, "versions": []}', 'list of versions'),
        ('history.json', '{"format": 1, "versions": [3]}', 'no version'),
        ('history.json', '[' * 99999, 'broken'),
        ('history.json', '\x00', 'broken'),
        ('session.yaml', '', 'expected a mapping'),
        ('session.yaml', 'a: [', 'not YAML'),
        ('session.yaml', 'recordings: 3', 'expected a mapping with data'),
        ('session.yaml', 'recordings: {data: 3}', 'expected a list of files'),
        ('session.yaml', 'recordings: {data: []}', 'expected a list of files'),
        ('session.yaml', 'recordings: {data: [a], noise: [1]}', 'standard deviations'),
        ('session.yaml', 'recordings: {data: [a], map: 3}', 'expected a text'),
        ('versions/0001.yaml', 'beam: {E: -1}', '0001.yaml'),
        ('versions/0001.yaml', 'a: [', '0001.yaml is not YAML'),
        ('versions/0001.yaml', None, 'cannot read'),
        ('session.yaml', None, 'cannot read'),
    ],
)
def test_broken_files(folder, name, text, words):
    open_session(folder).close()
    (folder / name).unlink() if text is None else (folder / name).write_text(text)
    with pytest.raises(UserError, match=words) as caught:
        open_session(folder)
    assert str(folder) in str(caught.value)
    (folder / name).unlink(missing_ok=True)
    shutil.rmtree(folder)
    open_session(folder).close()  # and the lock was let go


@pytest.mark.parametrize(
    ('entry', 'value'),
    [('current', 7), ('forward', {'x': 1}), ('forward', {'1': 9}), ('revision', None), ('versions', {})],
)
def test_a_history_that_contradicts_itself(folder, entry, value):
    open_session(folder).close()
    content = json.loads((folder / 'history.json').read_text()) | {entry: value}
    (folder / 'history.json').write_text(json.dumps(content))
    with pytest.raises(UserError, match=r'is broken.*versions/\*.yaml'):
        open_session(folder)


def test_foreign_folders(tmp_path):
    (tmp_path / 'run.csv').write_text('time_s\n')
    with pytest.raises(UserError, match='is no session: it holds run.csv'):
        open_session(tmp_path)
    with pytest.raises(UserError, match='is a file'):
        open_session(tmp_path / 'run.csv')
    (tmp_path / 's').mkdir()
    (tmp_path / 's' / '.lock').write_text('this is not the lock of anything ' * 40)
    with pytest.raises(UserError, match='not the lock of a session'):
        open_session(tmp_path / 's')
    with pytest.raises(UserError, match='unknown parameter'):
        open_session(tmp_path / 't', Start(words=('beam.X=1',)))
    assert not (tmp_path / 't').exists()


def test_a_version_that_was_broken_is_not_gone_to(folder):
    with open_session(folder) as session:
        session.change({'beam.E': 2.2e9})
        (folder / 'versions' / '0001.yaml').write_text('beam: {E: -1}')
        with pytest.raises(UserError, match='0001.yaml'):
            session.undo()
        assert session.current.number == 2


@settings(max_examples=60, deadline=None)
@given(st.lists(st.sampled_from(['change', 'undo', 'redo', *range(1, 5)]), max_size=20))
def test_nothing_leaves_a_history(steps):
    """Whatever is done, versions stay, redo undoes undo, and JSON gives the same back."""
    history = History().added(Version(1, None, '', '', ''))
    for step in steps:
        before = history
        try:
            if step == 'change':
                history = history.added(Version(len(history.versions) + 1, history.current, '', '', ''))
            elif step in ('undo', 'redo'):
                history = history.undone() if step == 'undo' else history.redone()
            else:
                history = history.at(step)
        except UserError:
            continue
        assert history.versions[: len(before.versions)] == before.versions and history.revision > before.revision
        if step == 'undo':
            assert history.redone().current == before.current
        assert history_from(json.loads(json.dumps(history.as_data()))) == history


def test_paths_are_those_of_no_working_directory(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path('a.csv').write_text('')
    with open_session(Path('s'), Start(data=DataRequest((Path('a.csv'),), ('a.csv', 'run2'), Path('map.yaml')))):
        settings_of = yaml.safe_load(Path('s/session.yaml').read_text())['recordings']
    assert settings_of['data'] == [str(tmp_path / 'a.csv')] and settings_of['map'] == str(tmp_path / 'map.yaml')
    assert settings_of['hold_out'] == [str(tmp_path / 'a.csv'), 'run2']
