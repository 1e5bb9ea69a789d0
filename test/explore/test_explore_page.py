"""The page of `sma-sim explore`: what it shows, who may ask for it, and that it equals what `simulate` computes."""

import http.client
import json
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path
from threading import Event

import numpy as np
import pytest
from browser import open_browser
from explore_server import CURVE, READY, ask, opened, refused, serving, slide, until
from test_messages import OWN

from sma_sim.explore.command import input_of
from sma_sim.model.config import read_config
from sma_sim.model.structures.discovery import package_structures
from sma_sim.solver.model import Model
from sma_sim.solver.simulate import simulate

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope='module')
def server(tmp_path_factory):
    with serving(tmp_path_factory.mktemp('explore') / 'session') as one:
        yield one


@pytest.fixture(scope='module')
def browser():
    one = open_browser(1500, 950)
    yield one
    one.quit()


# who may ask


def test_it_listens_on_this_machine_only(server):
    assert server.server_address[0] == '127.0.0.1' and server.token in server.address and len(server.token) >= 32


def test_what_the_page_sends_is_answered(server):
    status, content = ask(server)
    assert status == 200 and json.loads(content)['controls']['system'] == 'module'


@pytest.mark.parametrize(
    ('headers', 'status'),
    [
        ({'Host': 'evil.example'}, 403),  # DNS rebinding
        ({'Host': 'evil.example:80', 'Origin': 'http://evil.example:80'}, 403),
        ({'Host': None}, 403),
        ({'Origin': 'http://evil.example'}, 403),  # CSRF
        ({'Origin': 'http://127.0.0.1:1'}, 403),  # another server on this machine
        ({'Origin': 'null'}, 403),
        ({'Origin': None}, 403),
        ({'Sec_Fetch_Site': 'cross-site'}, 403),
        ({'Sec_Fetch_Site': 'same-site'}, 403),
        ({'Cookie': None}, 403),
        ({'Cookie': 'sma_sim_1=x'}, 403),
        ({'Content_Type': 'text/plain'}, 415),  # what a form of another page can send
        ({'Content_Length': '99999999999'}, 413),
        ({'Content_Length': None}, 411),
        ({'Content_Length': '-1'}, 411),
        ({'Content_Length': None, 'Transfer_Encoding': 'chunked'}, 411),
    ],
)
def test_what_others_send_is_refused(server, headers, status):
    assert ask(server, '/api/undo', **headers)[0] == status


def test_without_the_token_there_is_no_page(server):
    for path in ('/', '/?token=', '/?token=wrong', '/assets/app.js', '/events', '/download/run.csv?version=1'):
        status, content = ask(server, path, 'GET', Cookie=None)
        assert (status, b'Not allowed' in content) == (403, True), path
    status, content = ask(server, f'/?token={server.token}', 'GET', Cookie=None)
    assert status == 200 and server.token.encode() not in content


def test_the_page_cannot_be_framed_or_load_from_elsewhere(server):
    connection = http.client.HTTPConnection('127.0.0.1', server.port)
    connection.request('GET', f'/?token={server.token}')
    headers = connection.getresponse().headers
    connection.close()
    assert "default-src 'none'" in headers['Content-Security-Policy'] and 'unsafe' not in headers['Content-Security-Policy']
    assert headers['X-Frame-Options'] == 'DENY' and headers['Access-Control-Allow-Origin'] is None
    assert 'HttpOnly' in headers['Set-Cookie'] and 'SameSite=Strict' in headers['Set-Cookie']


@pytest.mark.parametrize(
    'path',
    [
        '/assets/../server.py',
        '/assets/..%2fserver.py',
        '/assets//etc/passwd',
        '/download/../history.json?version=1',
        '/download//etc/passwd?version=1',
        '/download/run.csv?version=../1',
        '/session.yaml',
        '//etc/passwd',
    ],
)
def test_no_other_file_is_read(server, path):
    assert ask(server, path, 'GET')[0] in (400, 403, 404)


def test_no_folder_of_python_files_can_be_named(server, tmp_path):
    (tmp_path / 'evil.py').write_text(f'open({str(tmp_path / "ran")!r}, "w")')
    before = ask(server)[1]
    folder = str(tmp_path)
    for values in ({'effects.paths': folder}, {'structures.paths': [folder]}, {'system': 'wire'}, {'node.record': 'x'}):
        for name in ('change', 'curves', 'frames'):
            assert refused(server, name, values=values), values
    assert refused(server, 'change', effects=['../evil'])
    assert ask(server)[1] == before and not (tmp_path / 'ran').exists()


TOO_LARGE = b'{"number": ' + b'9' * 400 + b'}'
NO_JSON = (b'', b'[]', b'{"values": {"wire.E_A": NaN}}', b'x', b'[' * 100_000, b'\xff', b'null', TOO_LARGE)


@pytest.mark.parametrize('body', NO_JSON)
def test_what_is_not_json_is_refused(server, body):
    assert ask(server, '/api/change', body=body)[0] == 400


WRONG = [
    ('change', {'values': {'wire.E_A': -1.0}}),
    ('change', {'values': {'wire.E_A': '__import__("os")'}}),
    ('change', {'values': {'wire.E_A': True}}),
    ('change', {'values': []}),
    ('change', {'effects': 'gravity'}),
    ('change', {'effects': ['gravity', 'gravity']}),
    ('change', {'values': {'nothing.E': 1.0}}),
    ('change', {'values': {'wire.E_A': 1e10}, 'expected': 99}),
    ('go_to', {'number': 99}),
    ('go_to', {'number': '1'}),
    ('rename', {'number': 1, 'name': 'x' * 1000}),
    ('curves', {'window': [1]}),
    ('curves', {'window': [2, 1]}),
    ('curves', {'beside': 99}),
    ('curves', {'pixels': 'many'}),
    ('command', {'command': {'kind': 'shell'}}),
    ('differences', {'before': 1}),
]


@pytest.mark.parametrize(('name', 'body'), WRONG)
def test_a_wrong_request_changes_nothing_and_says_why(server, name, body):
    before = ask(server)[1]
    words = refused(server, name, **body)
    assert len(words) > 10 and 'Traceback' not in words
    assert ask(server)[1] == before


def test_a_fault_is_told_on_the_page_and_in_the_terminal(server, monkeypatch, capfd):
    monkeypatch.setitem(server.application.verbs, 'undo', lambda body: {}['nothing'])
    status, words = ask(server, '/api/undo')
    assert status == 500 and b"fault of sma_sim (KeyError: 'nothing')" in words and 'Traceback' in capfd.readouterr().err
    assert ask(server)[0] == 200


def test_an_unknown_verb_is_not_found(server):
    assert ask(server, '/api/__init__')[0] == 404 and ask(server, '/api/')[0] == 404


# in a browser


def shown_equals(browser, server, **parameters):
    """Whether the page shows what `simulate` computes of the current version, to the last bit."""
    config = server.application.session.config()
    for name, value in parameters.items():
        assert config.parameters[name] == value
    source = input_of(server.application._command, config)
    run = simulate(Model(config), source, 50.0)
    for panel, column in (('alpha [deg]', 'alpha_rad'), ('T [deg C]', 'T_2_K'), ('force [N]', 'F_1_N')):
        x, y = map(np.array, browser.execute_script(CURVE, panel, column))
        at = np.searchsorted(run.time, x)
        if len(x) < 100 or not ((run.time[at] == x).all() and (run[column][at] == y).all() and y.max() == run[column].max()):
            return False
    return True


def wait_until_equal(browser, server):
    end = time.monotonic() + 30.0
    while not shown_equals(browser, server):
        assert time.monotonic() < end
        time.sleep(0.1)


def test_a_slider_an_effect_undo_reload_and_a_second_tab(browser, tmp_path):
    with serving(tmp_path / 'session') as server:
        opened(browser, server)
        assert server.token not in browser.current_url and shown_equals(browser, server)
        session = server.application.session
        slide(browser, 'wire.dsigma', 700, let_go=False)
        assert session.current.number == 1  # a preview only
        slide(browser, 'wire.dsigma', 700)
        assert session.current.number == 2 and session.config().parameters['wire.dsigma'] == 19.065e6
        wait_until_equal(browser, server)
        browser.find_element('id', 'tab-effects').click()
        browser.execute_script('document.querySelector("[data-effect=gravity] input").click()')
        until(browser, 'return smaExplore.state.controls.active.includes("gravity")')
        wait_until_equal(browser, server)
        slide(browser, 'effects.gravity.g_y', 500)
        assert session.current.number == 4
        browser.find_element('id', 'undo').click()
        until(browser, 'return smaExplore.state.history.current === 3')
        browser.refresh()
        until(browser, READY)
        assert browser.execute_script('return smaExplore.state.history.current') == 3
        wait_until_equal(browser, server)
        first = browser.current_window_handle
        browser.switch_to.new_window('tab')
        opened(browser, server)
        browser.find_element('id', 'redo').click()
        until(browser, 'return smaExplore.state.history.current === 4')
        browser.close()
        browser.switch_to.window(first)
        until(browser, 'return smaExplore.state.history.current === 4')
        assert browser.get_log('browser') == []


def test_two_versions_side_by_side_a_command_and_a_wrong_value(browser, tmp_path):
    with serving(tmp_path / 'session', words=('model=mas',)) as server:
        opened(browser, server)
        slide(browser, 'beam.E', 800)
        browser.execute_script('document.getElementById("tab-history").click()')
        compare = '[...document.querySelectorAll("#history button")].filter((b) => b.textContent === "Compare")'
        browser.execute_script(f'{compare}.at(-1).click()')
        until(browser, 'return smaExplore.charts.get("alpha [deg]").curves.length === 2')
        until(browser, 'return document.querySelector("#differences table") !== null')
        assert 'beam.E' in browser.find_element('id', 'differences').text
        browser.find_element('id', 'tab-command').click()
        kind = 'const kind = document.getElementById("kind"); kind.value = "sine";'
        browser.execute_script(f'{kind} kind.dispatchEvent(new Event("change"));')
        until(browser, 'return smaExplore.state.command.kind === "sine"')
        wait_until_equal(browser, server)
        number = 'const box = document.querySelector("[data-name=\\"wire.eps_T\\"] input[type=number]");'
        browser.execute_script(f'{number} box.value = "7"; box.dispatchEvent(new Event("change"));')
        until(browser, 'return document.getElementById("message").textContent.includes("wire.eps_T = 7")')
        assert server.application.session.current.number == 2
        assert browser.get_log('browser') == []
    with serving(tmp_path / 'session') as again:
        assert again.application.session.current.number == 2 and again.application._command.kind == 'sine'


KEYS = """
const slider = () => document.querySelector('[data-name="wire.dsigma"] input[type=range]');
slider().focus();
const presses = [...Array(30).keys()];
const press = () => {  // as a key that is held down: a step and both events of a slider with each repetition
  const one = document.activeElement;
  one.dispatchEvent(new KeyboardEvent('keydown', { key: 'ArrowRight', bubbles: true }));
  one.stepUp();
  one.dispatchEvent(new Event('input', { bubbles: true }));
  one.dispatchEvent(new Event('change', { bubbles: true }));
  if (presses.pop() !== 0) setTimeout(press, arguments[0]);
};
window.firstStep = Number(slider().value);
press();
"""


def test_keys_that_are_held_down_lose_no_step_and_make_one_version(browser, tmp_path):
    """Also while the server answers: what was committed meanwhile does not set the slider back."""
    with serving(tmp_path / 'session') as server:
        opened(browser, server)
        session, value = server.application.session, '[data-name="wire.dsigma"] input[type=range]'
        browser.execute_script(KEYS, 30)
        until(browser, f'return Number(document.querySelector({value!r}).value) === firstStep + 30')
        until(browser, 'return smaExplore.state.history.current > 1')
        assert session.current.number == 2
        shown = browser.execute_script(
            'return Number(document.querySelector(\'[data-name="wire.dsigma"] input[type=number]\').value)'
        )
        assert session.config().parameters['wire.dsigma'] == 1e6 * shown
        assert browser.execute_script(f'return Number(document.querySelector({value!r}).value) === firstStep + 30')
        assert browser.execute_script('return document.activeElement.type') == 'range'
        change, held = server.application.verbs['change'], Event()

        def slow(body):
            held.wait(2.0)
            return change(body)

        server.application.verbs = {**server.application.verbs, 'change': slow}
        browser.execute_script(KEYS, 0)
        until(browser, 'return Number(document.activeElement.value) === firstStep + 30')
        time.sleep(0.8)  # the first change is on its way
        browser.execute_script(KEYS, 0)
        until(browser, 'return Number(document.activeElement.value) === firstStep + 30')
        held.set()
        until(browser, 'return smaExplore.state.history.current === 4 && Object.keys(smaExplore.values).length === 0')
        assert browser.execute_script('return Number(document.activeElement.value) === firstStep + 30')
        browser.execute_script(KEYS, 0)
        until(browser, 'return Number(document.activeElement.value) === firstStep + 30')
        browser.find_element('id', 'undo').click()  # takes back what was just moved, not what came before
        until(browser, 'return smaExplore.state.history.versions.length === 5 && smaExplore.state.history.current === 4')
        assert [version.number for version in session.versions] == [1, 2, 3, 4, 5]


@pytest.mark.parametrize('size', [(390, 844, True), (1280, 720, False)])
def test_nothing_is_wider_than_the_screen(server, size):
    phone = open_browser(*size[:2], phone=size[2])
    try:
        opened(phone, server)
        assert phone.execute_script('return document.documentElement.scrollWidth <= innerWidth')
        unnamed = """return [...document.querySelectorAll('input, button, select, canvas')].filter((one) =>
            !one.textContent && !one.ariaLabel && !one.labels?.length && !one.title).map((one) => one.outerHTML)"""
        assert phone.execute_script(unnamed) == []
    finally:
        phone.quit()


@pytest.mark.slow
def test_every_structure_is_drawn_and_changed(browser, tmp_path):
    for system in package_structures():
        with serving(tmp_path / system, words=(f'system={system}',)) as server:
            opened(browser, server)
            assert browser.execute_script('return smaExplore.state.controls.system') == system
            slide(browser, 'wire.dsigma', 700)
            wire = f'x_M{"_1" if "x_M_1" in server.application.run(server.application.session.config()).columns else ""}'
            x, y = map(np.array, browser.execute_script(CURVE, 'x_M [-]', wire))
            run = server.application.run(server.application.session.config()).columns
            at = np.searchsorted(run['time_s'], x)
            assert len(x) > 100 and (run[wire][at] == y).all() and np.ptp(y) > 0.0, system
            assert browser.execute_script('return document.getElementById("message").hidden'), system


def test_an_effect_that_does_not_compile_is_said_and_leaves_the_page_as_it_was(browser, tmp_path):
    folder = tmp_path / 'effects'
    folder.mkdir()
    (folder / 'own.py').write_text(OWN.format(port='wire_heat', kernel='lambda s, w, p: float(str(p.a))'))
    with serving(tmp_path / 'session', words=(f'effects.paths={folder}',)) as server:
        opened(browser, server)
        browser.find_element('id', 'tab-effects').click()
        browser.execute_script('document.querySelector("[data-effect=own] input").click()')
        until(browser, 'return document.getElementById("message").textContent.includes("own")')
        words = browser.find_element('id', 'message').text
        assert 'compile' in words and 'Traceback' not in words
        if server.application.session.can_undo:
            browser.find_element('id', 'undo').click()
        until(browser, 'return !smaExplore.state.controls.active.includes("own")')
        slide(browser, 'wire.dsigma', 600)
        wait_until_equal(browser, server)
        assert browser.get_log('browser') == []


@pytest.mark.slow
def test_by_keyboard_alone_and_in_dark(browser, tmp_path):
    """Every control is reached by Tab, is seen to have the focus, and does what a click does."""
    keys = pytest.importorskip('selenium.webdriver').Keys
    browser.execute_cdp_cmd('Emulation.setEmulatedMedia', {'features': [{'name': 'prefers-color-scheme', 'value': 'dark'}]})
    with serving(tmp_path / 'session') as server:
        opened(browser, server)
        ground, ink = browser.execute_script(
            'const found = getComputedStyle(document.body); return [found.backgroundColor, found.color]'
        )
        assert ground == 'rgb(20, 23, 27)' and ink == 'rgb(230, 233, 237)'

        def focused():
            return browser.switch_to.active_element

        def tab_to(found):
            for _ in range(400):
                if browser.execute_script(f'return document.activeElement.matches({found!r})'):
                    return
                focused().send_keys(keys.TAB)
            raise AssertionError(f'{found} is not reached')

        tab_to('[data-name="wire.dsigma"] input[type=range]')
        assert browser.execute_script('return getComputedStyle(document.activeElement).outlineStyle') != 'none'
        focused().send_keys(keys.ARROW_RIGHT)
        until(browser, 'return smaExplore.state.history.current === 2')
        focused().send_keys(keys.CONTROL, 'z')
        until(browser, 'return smaExplore.state.history.current === 1')
        browser.find_element('id', 'tab-parameters').send_keys(keys.ARROW_RIGHT)
        tab_to('[data-effect="driver_lag"] input')
        focused().send_keys(keys.SPACE)
        until(browser, 'return smaExplore.state.controls.active.includes("driver_lag")')
        browser.find_element('id', 'view-data').send_keys(keys.ENTER)
        until(browser, 'return document.getElementById("recordings-files").offsetParent !== null')
        assert browser.get_log('browser') == []
    browser.execute_cdp_cmd('Emulation.setEmulatedMedia', {'features': []})


# the command


def start(folder, *words):
    environment = {**os.environ, 'PYTHONPATH': str(ROOT)}
    return subprocess.Popen(
        [sys.executable, '-m', 'sma_sim.cli.main', 'explore', '--no-browser', *words],
        cwd=folder,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def test_the_command_serves_until_ctrl_c(tmp_path):
    with start(tmp_path, '--set', 'beam.E=2.2e9', '--model', 'mas') as process:
        address = process.stdout.readline().split()[-1]
        assert address.startswith('http://127.0.0.1:') and '?token=' in address
        process.send_signal(signal.SIGINT)
        assert process.wait(60) == 130 and 'Traceback' not in process.stderr.read()
    config = read_config(tmp_path / 'explore-session' / 'versions' / '0001.yaml')
    assert config.simulated_kinetics == 'mas' and config.parameters['beam.E'] == 2.2e9


def test_a_port_that_is_taken_is_said(tmp_path):
    with socket.socket() as other:
        other.bind(('127.0.0.1', 0))
        other.listen()
        with start(tmp_path, '--port', str(other.getsockname()[1])) as process:
            words = process.stderr.read()
            assert process.wait(60) == 2 and 'choose another one' in words and 'Traceback' not in words


WRONG_WORDS = [
    ('--port', '70000'),
    ('--port', '-1'),
    ('--system', 'nothing'),
    ('--set', 'wire.E_A=-1'),
    ('nothing.csv',),
    ('--hold-out', 'run1'),
]


@pytest.mark.parametrize('words', WRONG_WORDS)
def test_wrong_options(tmp_path, words):
    from sma_sim.cli.main import main

    assert main(['explore', '--no-browser', '--session', str(tmp_path / 's'), *words]) == 2
