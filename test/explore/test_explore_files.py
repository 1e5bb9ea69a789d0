"""Recordings that are chosen on the page of `sma-sim explore`: files, bags, broken ones, the whole way from there."""

import json
from base64 import b64encode

import pytest
from corrupted import TEXT
from explore_server import ask, refused, serving, until, verb
from explore_steps import (
    ERRORS,
    STEP,
    begin,
    gravity_case,
    offered,
    opened,
    take,
)
from test_stages import BROKEN, PATIENCE

from sma_sim.cli.main import main
from sma_sim.model.config import read_config


@pytest.fixture(scope='module')
def case(tmp_path_factory):
    return gravity_case(tmp_path_factory)


@pytest.fixture(scope='module')
def server(tmp_path_factory):
    with serving(tmp_path_factory.mktemp('explore') / 'session') as one:
        yield one


@pytest.mark.parametrize(
    'name',
    [
        '../evil.csv',
        '/etc/x.csv',
        '.hidden.csv',
        'a/../b.csv',
        'a//b.csv',
        'a/b/c/d.csv',
        'run.py',
        'a/own.py',
        'x' * 200 + '.csv',
        'a\0.csv',
        'a\n.csv',
        '-o.csv',
        'C:\\x.csv',
        '',
        3,
    ],
)
def test_names_of_files_lead_nowhere_else(server, name):
    before, known = ask(server)[1], list(server.application.session.folder.rglob('*'))
    assert len(refused(server, 'upload', batch=None, name=name, at=0, data=b64encode(TEXT.encode()).decode())) > 10
    assert ask(server)[1] == before and list(server.application.session.folder.rglob('*')) == known


def test_files_come_in_pieces_and_in_order(server):
    batch = json.loads(verb(server, 'upload', batch=None, name='a.csv', at=0, data='YWI=')[1])['batch']
    for body in ({'at': 1}, {'at': 0}, {'at': 2, 'data': 'x'}, {'at': 2, 'batch': 999}, {'at': 2, 'batch': '../1'}):
        assert len(refused(server, 'upload', **{'batch': batch, 'name': 'a.csv', 'data': 'YWI=', **body})) > 10, body
    assert json.loads(verb(server, 'upload', batch=batch, name='a.csv', at=2, data='YWI=')[1]) == {'batch': batch}
    assert (server.application.session.folder / 'recordings' / f'{batch:04}' / 'a.csv').read_text() == 'abab'


def test_files_are_chosen_on_the_page_held_out_and_kept(browser, case, tmp_path):
    files = '\n'.join(str(case / f'run{k}.csv') for k in (1, 2, 3))
    with serving(tmp_path / 'session', words=('model=mas',)) as server:
        opened(browser, server)
        assert browser.execute_script('return smaExplore.view') == 'model'
        browser.find_element('id', 'view-data').click()
        browser.find_element('id', 'recordings-files').send_keys(files)
        until(browser, 'return smaExplore.state.steps.data !== null')
        take(browser, 'check')
        until(browser, 'return document.querySelectorAll("#detail tbody input").length === 3')
        browser.execute_script('[...document.querySelectorAll("#detail tbody input")][2].click()')
        until(browser, 'return smaExplore.state.steps.data.hold_out.length === 1')
        session = server.application.session
        assert session.data.hold_out == ('run3',) and all(path.parent.name == '0001' for path in session.data.data)
        assert offered(browser) == ['check']  # what is held out is part of what is checked
        assert (session.data.data[0]).read_text() == (case / 'run1.csv').read_text()
    with serving(tmp_path / 'session') as again:
        assert again.application.session.data.hold_out == ('run3',)


@pytest.mark.slow
def test_bags_are_chosen_on_the_page(browser, tmp_path):
    """As a file, and as a folder with further files in it; the recording is the one that was chosen, byte for byte."""
    (tmp_path / 'runs').mkdir()
    source = tmp_path / 'steps.csv'
    source.write_text('time_s,J_eq_W\n0,0\n1,8\n4,-8\n8,0\n')
    for name, other in (('one', ()), ('two', ('--set', 'beam.E=2.1e9'))):
        out = tmp_path / 'runs' / f'{name}.mcap'
        assert main(['simulate', '--input', str(source), '--out', str(out), '--integration-rate', '100', *other]) == 0
    (tmp_path / 'runs' / 'notes.txt').write_text('not for the page')
    for element, chosen in (('recordings-files', tmp_path / 'runs' / 'one.mcap'), ('recordings-folder', tmp_path / 'runs')):
        with serving(tmp_path / element) as server:
            opened(browser, server)
            browser.find_element('id', 'view-data').click()
            browser.find_element('id', element).send_keys(str(chosen))
            until(browser, 'return smaExplore.state.steps.data !== null')
            kept = [file for file in server.application.session.data.data[0].parent.rglob('*') if file.is_file()]
            assert sorted(file.name for file in kept) == (['one.mcap'] if 'files' in element else ['one.mcap', 'two.mcap'])
            assert all(file.read_bytes() == (tmp_path / 'runs' / file.name).read_bytes() for file in kept)
            take(browser, 'check')
            runs = server.application.data.engine.latest('check').result()['runs']
            assert [run['name'] for run in runs] == [file.stem for file in sorted(kept)]
            assert {'alpha', 'F_1'} <= set(runs[0]['channels'])


@pytest.mark.parametrize('kinds', [('no command', 'binary'), pytest.param(tuple(BROKEN), marks=pytest.mark.slow)])
def test_broken_recordings_are_said_on_the_page(browser, tmp_path, kinds):
    """The kinds that the steps are tested with, all the way to the words that a newcomer reads: refused, or repaired."""
    with serving(tmp_path / 'session') as server:
        opened(browser, server)
        browser.find_element('id', 'view-data').click()
        for kind in kinds:
            content, path = BROKEN[kind], tmp_path / f'{kind.replace(" ", "_")}.csv'
            path.write_bytes(content if isinstance(content, bytes) else content.encode())
            before = browser.execute_script('return smaExplore.state.changes')
            browser.find_element('id', 'recordings-files').send_keys(str(path))
            until(browser, 'return smaExplore.state.changes > arguments[0]', before)
            begin(browser, 'check')
            until(browser, f'return ["done", "failed"].includes({STEP}.job?.state)', 'check', seconds=PATIENCE)
            if server.application.data.engine.latest('check').state == 'failed':
                until(browser, 'return document.querySelector("[data-stage=check] .problem") !== null')
                words = browser.find_element('css selector', '[data-stage=check] .problem').text
                assert path.name in words and offered(browser) == ['check'], kind
                assert 'fault' not in words and str(tmp_path) not in words, kind
            else:
                until(browser, 'return document.querySelector("#detail li") !== null')


@pytest.mark.slow
def test_from_three_files_to_the_improved_model_by_the_page_alone(browser, case, tmp_path):
    """What is missing is found, accepted, compared and exported, and the model predicts to the noise."""
    files = '\n'.join(str(case / f'run{k}.csv') for k in (1, 2, 3))
    with serving(tmp_path / 'session') as server:
        opened(browser, server)
        browser.find_element('id', 'view-data').click()
        browser.find_element('id', 'recordings-files').send_keys(files)
        for stage in ('check', 'compare', 'diagnose'):
            take(browser, stage)
        until(browser, 'return document.querySelector("#detail .verdict") !== null')
        assert 'gravity' in browser.find_element('css selector', '#detail .verdict').text
        begin(browser, 'accept')
        until(browser, 'return smaExplore.state.history.current === 2')
        take(browser, 'compare')
        until(browser, f'{ERRORS}.at(-1) < 1.1')
        begin(browser, 'export')
        until(browser, 'return document.querySelectorAll("#detail a[download]").length === 6')
        exported = server.application.session.folder / 'export' / '0002' / 'parameters.yaml'
        assert 'gravity' in [one.effect.name for one in read_config(exported).effects]
