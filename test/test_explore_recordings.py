"""The page of `sma-sim explore` with recordings, used as by a newcomer: only what the page offers, in a browser."""

import json

import numpy as np
import pytest
from browser import open_browser
from corrupted import TEXT
from explore_server import ask, serving, slide, until, verb
from measured_runs import truth, write_module_runs
from test_stages import BROKEN, PATIENCE

from sma_sim import Model, simulate
from sma_sim.cli.main import main
from sma_sim.evidence.data.tables import write_columns
from sma_sim.explore.command import first_command, input_of
from sma_sim.model.config import Config, read_config
from sma_sim.solver.inputs import inputs_at
from sma_sim.workflow.data_request import DataRequest

READY = 'return window.smaExplore !== undefined && smaExplore.ready'
STEP = 'smaExplore.state.steps.stages.find((one) => one.stage === arguments[0])'
CURVES = """
const chart = smaExplore.recordings.charts.get(`${arguments[0]}|${arguments[1]}`);
return chart.curves.map((one) => [Array.from(one.x), Array.from(one.y)]);
"""
CHOOSE = (
    'const one = document.getElementById(arguments[0]); one.value = arguments[1]; one.dispatchEvent(new Event("change"));'
)
ERRORS = 'return [...document.querySelectorAll("#errors td span")].map((one) => Number(one.title))'


@pytest.fixture(scope='module')
def case(tmp_path_factory):
    """A robot with the paper's values that lacks gravity: three short runs."""
    return write_module_runs(tmp_path_factory.mktemp('case'), truth(model='mas', effects=['gravity']), seconds=12.0)


@pytest.fixture(scope='module')
def browser():
    one = open_browser(1500, 950)
    yield one
    assert [entry for entry in one.get_log('browser') if ' 400 ' not in entry['message']] == []
    one.quit()


@pytest.fixture(scope='module')
def server(case, tmp_path_factory):
    """A session with the three runs."""
    start = {'words': ('model=mas',), 'data': DataRequest((case,))}
    with serving(tmp_path_factory.mktemp('explore') / 'session', **start) as one:
        yield one


def opened(browser, server):
    browser.get(server.address)
    until(browser, READY)


def begin(browser, stage):
    """Press the button of a step, which is offered."""
    until(browser, f'return document.querySelector("[data-begin={stage}]")?.disabled === false')
    browser.execute_script(f'document.querySelector("[data-begin={stage}]").click()')


def ended(browser, stage, state='done'):
    """Wait until a step has ended."""
    until(browser, f'return {STEP}.job?.state === arguments[1] && smaExplore.state.steps.running === null', stage, state,
          seconds=PATIENCE)  # fmt: skip


def take(browser, stage):
    begin(browser, stage)
    ended(browser, stage)


def offered(browser):
    """The steps whose button can be pressed."""
    buttons = '[...document.querySelectorAll("[data-begin]")].filter((one) => !one.disabled)'
    return browser.execute_script(f'return {buttons}.map((one) => one.dataset.begin)')


def test_steps_cannot_be_taken_in_the_wrong_order_and_show_what_the_commands_compute(browser, server, tmp_path):
    opened(browser, server)
    assert offered(browser) == ['check']
    assert verb(server, 'start', stage='diagnose')[0] == 400 and verb(server, 'accept')[0] == 400
    take(browser, 'check')
    until(browser, 'return document.querySelectorAll("#detail tbody tr").length === 3')
    assert offered(browser) == ['check', 'compare']
    take(browser, 'compare')
    assert offered(browser) == ['check', 'compare', 'candidates', 'calibrate', 'diagnose', 'export']
    until(browser, 'return smaExplore.recordings.charts.size === 15')
    config = server.application.session.file(1)
    out = tmp_path / 'compare.json'
    words = server.application.session.data.options()
    assert main(['compare', *words, '--config', str(config), '--json', str(out)]) == 0
    found = json.loads(out.read_text())['comparisons'][0]
    shown, runs = browser.execute_script(ERRORS), found['runs'].values()
    expected = [one['channels'][name]['over_noise'] for one in runs for name in one['channels']]
    assert [shown[k] for k in range(18) if k % 6 < 5] == expected and shown[23] == found['error']['train']
    curves = server.application.data.engine.latest('compare').curves()['run2']
    for what, (x, y) in zip(('measured', 'model'), browser.execute_script(CURVES, 'run2', 'F_1'), strict=True):
        at = np.searchsorted(curves['time'], x)
        assert (curves['time'][at] == x).all() and (curves[f'{what}.F_1'][at] == y).all() and len(x) > 200


def test_sliders_and_candidates_move_the_curves_of_all_runs(browser, server):
    """What a slider shows is a preview, and says so; an effect that is tried makes no version, one that is kept does."""
    browser.find_element('id', 'tab-effects').click()
    before = browser.execute_script(ERRORS)[-1]
    browser.find_element('id', 'tab-parameters').click()
    slide(browser, 'wire.dsigma', 900, let_go=False)
    assert browser.execute_script("return document.getElementById(\"basis\").textContent").startswith("Preview")
    assert browser.execute_script(ERRORS)[-1] != before and server.application.session.current.number == 1
    browser.refresh()
    until(browser, f'{READY} && smaExplore.recordings.charts.size === 15')
    assert verb(server, 'start', stage='candidates', options={'effects': ['gravity', 'sensor_gain']})[0] == 200
    until(browser, 'return smaExplore.state.steps.candidates?.state === "done"', seconds=PATIENCE)
    explained = region(browser)
    assert 'mode of wire 1' in explained and 'gravity' in explained and 'direction of motion' in explained
    browser.execute_script('smaExplore.stages.choose("candidates")')
    until(browser, 'return document.querySelectorAll("#detail tbody button").length === 4')
    browser.execute_script('document.querySelector("#detail tbody button").click()')
    until(browser, 'return smaExplore.tried?.name === "gravity"')
    until(browser, f'{ERRORS.replace("return ", "const e = ")}; return e[e.length - 1] < 1.2')
    assert server.application.session.current.number == 1
    browser.execute_script('[...document.querySelectorAll("#detail tbody button")][1].click()')
    until(browser, 'return smaExplore.state.history.current === 2')
    assert 'gravity' in [one.found.effect.name for one in server.application.session.config().effects]
    look = 'one.textContent === "Compare" && !one.disabled'
    browser.execute_script(f'[...document.querySelectorAll("#history button")].find((one) => {look}).click()')
    until(browser, 'return smaExplore.recordings.charts.get("run1|alpha").curves.length === 3')  # measured, both versions
    browser.find_element('id', 'undo').click()
    until(browser, 'return smaExplore.state.history.current === 1')


def region(browser):
    """What the page says of a part of a residual that was clicked on."""
    browser.execute_script(CHOOSE, 'drawn', 'residuals')
    until(browser, 'return [...smaExplore.recordings.charts.values()].every((chart) => chart.shade)')
    canvas = browser.execute_script('return smaExplore.recordings.charts.get("run1|U_y").canvas')
    for kind in ('pointerdown', 'pointerup'):
        browser.execute_script(
            'arguments[0].dispatchEvent(new PointerEvent(arguments[1], '
            '{clientX: arguments[0].getBoundingClientRect().x + 200, bubbles: true}))', canvas, kind,
        )  # fmt: skip
    until(browser, 'return document.querySelectorAll("#region table").length === 2')
    browser.execute_script(CHOOSE, 'drawn', 'curves')
    return browser.find_element('id', 'region').text


def test_reload_and_a_second_tab_amid_a_diagnosis_that_is_stopped(browser, server):
    """The step goes on, both tabs find it, either may end it; what it has can be accepted and undone."""
    browser.execute_script(
        'const models = [...document.querySelectorAll("[data-stage=diagnose] select")]; models[0].value = "mas";'
        'for (const one of document.querySelectorAll("[data-stage=diagnose] input")) one.checked = false;'
    )
    begin(browser, 'diagnose')
    until(browser, f'return {STEP}.job?.state === "running"', 'diagnose')
    browser.refresh()
    until(browser, f'{READY} && document.querySelector("[data-stop=diagnose]") !== null')
    assert offered(browser) == []
    first = browser.current_window_handle
    browser.switch_to.new_window('tab')
    opened(browser, server)
    until(browser, 'return document.querySelector("[data-stop=diagnose]") !== null')
    until(browser, 'return smaExplore.stages.events.length > 0', seconds=PATIENCE)
    assert verb(server, 'recordings', hold_out=['run3'])[0] == 400  # not while it runs
    browser.execute_script('document.querySelector("[data-stop=diagnose]").click()')
    ended(browser, 'diagnose', 'stopped')
    browser.close()
    browser.switch_to.window(first)
    ended(browser, 'diagnose', 'stopped')
    options = server.application.data.engine.latest('diagnose').options
    assert options == {'model': 'mas', 'equation': False, 'variants': False}


def test_calibrate_accept_export_and_what_is_exported(browser, server, tmp_path):
    browser.execute_script(
        'const step = document.querySelector("[data-stage=calibrate]"); step.querySelector("select").value = "mas";'
        'step.querySelector("input[type=text]").value = "beam.E"; step.querySelector("input[type=number]").value = "1";'
    )
    begin(browser, 'calibrate')
    until(browser, 'return document.getElementById("growing") !== null')
    ended(browser, 'calibrate')
    until(browser, 'return document.querySelector("#detail h2").textContent.startsWith("Calibration")')
    value = server.application.data.engine.latest('calibrate').result()['parameters']['beam.E']['value']
    assert 'beam.E' in browser.find_element('id', 'detail').text
    begin(browser, 'accept')
    until(browser, 'return smaExplore.state.history.current > 2')
    assert server.application.session.config().parameters['beam.E'] == value
    take(browser, 'compare')
    begin(browser, 'export')
    until(browser, 'return document.querySelectorAll("#detail a[download]").length === 6')
    where = browser.execute_script('return document.querySelector("#detail a[download]").getAttribute("href")')
    status, content = ask(server, where, 'GET')
    (tmp_path / 'parameters.yaml').write_bytes(content)
    assert status == 200 and read_config(tmp_path / 'parameters.yaml').parameters['beam.E'] == value


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


def write_structure_run(folder, system):
    """A run of a structure as it would be measured, under the command that the page begins with."""
    config = Config(system=system)
    source = input_of(first_command(config), config)
    run, random = simulate(Model(config), source, 5.0), np.random.default_rng(0)
    shown = {name: column for name, column in run.columns.items() if not name.startswith(('mode', 'x_M'))}
    noise = {name: (1e-3 * np.ptp(column) + 1e-9) * random.normal(size=len(run.time)) for name, column in shown.items()}
    write_columns(folder / 'run.csv', inputs_at(source, run.time) | {name: shown[name] + noise[name] for name in shown})
    return folder


SLOWER = [pytest.param(system, marks=pytest.mark.slow) for system in ('slider', 'spatial', 'stack')]


@pytest.mark.parametrize('system', ['lever', 'wire', *SLOWER])
def test_every_structure_beside_recordings_has_the_errors_of_the_command(system, tmp_path):
    request = DataRequest((write_structure_run(tmp_path, system) / 'run.csv',))
    with serving(tmp_path / 'session', words=(f'system={system}',), data=request) as server:
        engine = server.application.data.engine
        for stage in ('check', 'compare'):
            assert engine.wait(engine.start(stage), PATIENCE).state == 'done', engine.jobs[-1].words
        status, content = verb(server, 'overlay')
        shown = json.loads(content[4 : 4 + int.from_bytes(content[:4], 'little')])
        assert status == 200 and shown['exact'] and 0.5 < shown['error']['train'] < 2.0
        assert shown['error']['train'] == engine.latest('compare').result()['comparisons'][0]['error']['train']


@pytest.mark.parametrize(
    'name', ['../evil.csv', '/etc/x.csv', '.hidden.csv', 'a/b.csv', 'run.py', 'x' * 200 + '.csv', 'a\0.csv']
)
def test_names_of_files_lead_nowhere_else(server, name):
    before = ask(server)[1]
    status, content = verb(server, 'recordings', files=[{'name': name, 'text': TEXT}])
    assert status == 400 and len(json.loads(content)['error']) > 10 and ask(server)[1] == before


WRONG = [
    ('start', {'stage': 'shell'}), ('start', {'stage': 'check', 'options': []}),
    ('start', {'stage': 'check', 'options': {'x': 1}}), ('start', {'stage': 'calibrate', 'options': {'starts': 0}}),
    ('job', {'number': 99}), ('job', {'number': '../1'}), ('job', {'number': 1, 'since': 'x'}),
    ('overlay', {'beside': 99}), ('overlay', {'window': [2, 1]}), ('overlay', {'curves': ['x']}),
    ('accept', {'number': 99}),
    ('part', {'run': 'run1', 'channel': 'alpha', 't0': 0}), ('part', {'run': 'x', 'channel': 'alpha', 't0': 0, 't1': 1}),
    ('recordings', {'files': []}), ('recordings', {'files': ['x']}), ('recordings', {'hold_out': ['nothing']}),
    ('recordings', {'hold_out': 'run1'}), ('recordings', {'recorded': True}), ('record', {'on': True}), ('record', {}),
    ('live_start', {'namespace': '-p x:=1'}), ('live_start', {'domain': 1.5}), ('live_start', {'domain': 999}),
]  # fmt: skip


def test_wrong_requests_change_nothing_and_say_why(server):
    for name, body in WRONG:
        before = ask(server)[1]
        status, content = verb(server, name, **body)
        assert status == 400 and len(json.loads(content)['error']) > 10 and 'Traceback' not in content.decode(), (name, body)
        assert ask(server)[1] == before, (name, body)


@pytest.mark.parametrize(
    'path',
    ['report.html?job=../1', 'report.html?job=99', 'log.txt?job=1', '../request.json?job=1', 'owner.json?export=1',
     'parameters.yaml?export=../..', 'parameters.yaml', 'report.html?job=%C2%B2'],
)  # fmt: skip
def test_no_other_file_is_downloaded(server, path):
    assert ask(server, f'/download/{path}', 'GET')[0] in (400, 404)


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
                assert path.name in words and 'fault' not in words and offered(browser) == ['check'], kind
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
        assert browser.execute_script(ERRORS)[-1] < 1.1
        begin(browser, 'export')
        until(browser, 'return document.querySelectorAll("#detail a[download]").length === 6')
        exported = server.application.session.folder / 'export' / '0002' / 'parameters.yaml'
        assert 'gravity' in [one.found.effect.name for one in read_config(exported).effects]
