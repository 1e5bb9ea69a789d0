"""The page of `sma-sim explore` with recordings, used as by a newcomer: only what the page offers, in a browser."""

import json

import numpy as np
import pytest
from explore_server import ask, refused, serving, slide, until, verb
from explore_steps import (
    ERRORS,
    READY,
    STEP,
    begin,
    ended,
    gravity_case,
    offered,
    opened,
    take,
)
from test_stages import PATIENCE

from sma_sim import Model, simulate
from sma_sim.cli.main import main
from sma_sim.evidence.data.tables import write_columns
from sma_sim.explore.command import first_command, input_of
from sma_sim.model.config import Config, read_config
from sma_sim.solver.inputs import inputs_at
from sma_sim.workflow.data_request import DataRequest

CURVES = """
const chart = smaExplore.recordings.charts.get(`${arguments[0]}|${arguments[1]}`);
return chart.curves.map((one) => [Array.from(one.x), Array.from(one.y)]);
"""
CHOOSE = (
    'const one = document.getElementById(arguments[0]); one.value = arguments[1]; one.dispatchEvent(new Event("change"));'
)
CANDIDATES = ['gravity', 'sensor_gain', 'driver_lag', 'radiation', 'natural_convection', 'guide_friction']
SO_FAR = """
const bar = document.querySelector('[data-stage=candidates] progress');
const rows = document.querySelectorAll('#candidates-so-far tbody tr');
const elapsed = document.querySelector('#detail .elapsed')?.textContent;
return rows.length > 0 && bar?.max > 1 && / s; about .* s left$/.test(elapsed);
"""
GROWING = 'const place = document.getElementById("growing")?.getBoundingClientRect() ?? {};'


@pytest.fixture(scope='module')
def case(tmp_path_factory):
    return gravity_case(tmp_path_factory)


@pytest.fixture(scope='module')
def server(case, tmp_path_factory):
    """A session with the three runs."""
    start = {'words': ('model=mas',), 'data': DataRequest((case,))}
    with serving(tmp_path_factory.mktemp('explore') / 'session', **start) as one:
        yield one


def test_steps_cannot_be_taken_in_the_wrong_order_and_show_what_the_commands_compute(browser, server, case, tmp_path):
    opened(browser, server)
    assert offered(browser) == ['check']
    words = browser.find_element('id', 'detail').text
    assert case.name in words and 'not been checked yet' in words
    assert refused(server, 'start', stage='diagnose') and refused(server, 'accept')
    for stage, title in (('compare', 'Compare'), ('diagnose', 'Diagnose'), ('accept', 'Accept'), ('export', 'Export')):
        browser.find_element('css selector', f'[data-stage={stage}] .link').click()  # no step shows an empty pane
        until(browser, 'return document.querySelector("#detail h2")?.textContent === arguments[0]', title)
        assert 'check the recordings first' in browser.find_element('id', 'detail').text
    take(browser, 'check')
    until(browser, 'return document.querySelectorAll("#detail tbody tr").length === 3')
    assert offered(browser) == ['check', 'compare']
    noise = next(line for line in browser.find_element('id', 'detail').text.splitlines() if line.startswith('Noise'))
    assert [word.split()[-1] for word in noise.split(', ')] == ['um', 'mm', 'deg', 'N', 'N'], noise
    browser.find_element('css selector', '[data-stage=compare] .link').click()
    until(browser, 'return document.getElementById("detail").textContent.includes("its button is under Steps")')
    take(browser, 'compare')
    until(browser, 'return /step 2, version 1, done in [0-9]/.test(document.getElementById("detail").textContent)')
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


@pytest.mark.parametrize('size', [(390, 844), (1366, 768), (3840, 2160)])
def test_results_and_curves_fit_the_screen(browser, server, size):
    """From a phone to 4K: nothing is cut off at the side, sliders and curves are seen together."""
    metrics = {'width': size[0], 'height': size[1], 'deviceScaleFactor': 1, 'mobile': size[0] < 500}
    browser.execute_cdp_cmd('Emulation.setDeviceMetricsOverride', metrics)
    try:
        for stage in ('check', 'compare'):
            browser.execute_script('smaExplore.stages.choose(arguments[0])', stage)
            until(browser, 'return document.querySelector("#detail h2") !== null')
            assert browser.execute_script('return document.documentElement.scrollWidth <= innerWidth')
        for tab in ('parameters', 'effects', 'history'):
            browser.execute_script('document.getElementById(`tab-${arguments[0]}`).click(); scrollTo(0, 0)', tab)
            wide = (
                '[...document.querySelectorAll("aside, #curves, header")].filter((one) => one.scrollWidth > one.clientWidth)'
            )
            assert browser.execute_script(f'return {wide}.map((one) => one.outerHTML.slice(0, 80))') == []
            seen = 'const {top, bottom, height} = document.querySelector(arguments[0]).getBoundingClientRect();'
            for part in ('aside', '#curves'):
                top, bottom, height, screen = browser.execute_script(
                    f'{seen} return [top, bottom, height, innerHeight]', part
                )
                assert top >= 0 and height > 200 and min(bottom, screen) - top > 200, (part, size)
                assert bottom <= screen + 1 or (part == '#curves' and size[0] > 960), 'a wide page scrolls as a whole'
        browser.execute_script('document.getElementById("tab-steps").click()')
    finally:
        browser.execute_cdp_cmd('Emulation.clearDeviceMetricsOverride', {})


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
    assert verb(server, 'start', stage='candidates', options={'effects': CANDIDATES})[0] == 200
    browser.execute_script('smaExplore.stages.choose("candidates")')
    until(browser, SO_FAR, seconds=PATIENCE)
    until(browser, 'return smaExplore.state.steps.candidates?.state === "done"', seconds=PATIENCE)
    explained = region(browser)
    assert ' deg C' in explained and ' K' not in explained
    assert 'mode of wire 1' in explained and 'gravity' in explained and 'direction of motion' in explained
    by_keys = region_by_keys(browser)
    assert 'run1, U_y, 6' in by_keys and 'mode of wire 1' in by_keys and 'gravity' in by_keys
    browser.execute_script('smaExplore.stages.choose("candidates")')
    until(browser, 'return document.querySelectorAll("#detail tbody button").length >= 4')
    assert 'g_y \u22129.8' in browser.find_element('id', 'detail').text
    browser.execute_script('document.querySelector("#detail tbody button").click()')
    until(browser, 'return smaExplore.tried?.name === "gravity"')
    until(browser, f'{ERRORS.replace("return ", "const e = ")}; return e[e.length - 1] < 1.2')
    assert server.application.session.current.number == 1
    browser.execute_script('[...document.querySelectorAll("#detail tbody button")][1].click()')
    until(browser, 'return smaExplore.state.history.current === 2')
    assert 'gravity' in [one.effect.name for one in server.application.session.config().effects]
    look = 'one.textContent === "Compare" && !one.disabled'
    browser.execute_script(f'[...document.querySelectorAll("#history button")].find((one) => {look}).click()')
    until(browser, 'return smaExplore.recordings.charts.get("run1|alpha").curves.length === 3')  # measured, both versions
    browser.find_element('id', 'undo').click()
    until(browser, 'return smaExplore.state.history.current === 1')


def region_by_keys(browser):
    """What the page says of a part of a residual that was marked by keys alone; then back to the curve."""
    keys = pytest.importorskip('selenium.webdriver').Keys
    canvas = residual(browser)
    for _ in range(200):
        if browser.switch_to.active_element == canvas:
            break
        browser.switch_to.active_element.send_keys(keys.TAB)
    canvas.send_keys(keys.HOME, *5 * [keys.PAGE_UP], keys.SHIFT, *5 * [keys.ARROW_RIGHT])
    assert browser.execute_script('return arguments[0].ariaValueText', canvas).startswith('6.6')
    canvas.send_keys(keys.NULL, keys.ENTER)
    until(browser, 'return document.activeElement.id === "region"')
    words = browser.find_element('id', 'region').text
    assert browser.execute_script('return smaExplore.recordings.marked.range.map((one) => Number(one.toFixed(2)))') == [
        6.0,
        6.6,
    ]
    while browser.switch_to.active_element.text != 'Close':
        browser.switch_to.active_element.send_keys(keys.TAB)
    browser.switch_to.active_element.send_keys(keys.ENTER)
    assert browser.switch_to.active_element == canvas and not browser.find_element('id', 'region').is_displayed()
    browser.execute_script(CHOOSE, 'drawn', 'curves')
    return words


def residual(browser):
    """A chart of residuals over noise."""
    browser.execute_script(CHOOSE, 'drawn', 'residuals')
    until(browser, 'return [...smaExplore.recordings.charts.values()].every((chart) => chart.shade)')
    return browser.execute_script('return smaExplore.recordings.charts.get("run1|U_y").canvas')


def region(browser):
    """What the page says of a part of a residual that was clicked on."""
    canvas = residual(browser)
    for kind in ('pointerdown', 'pointerup'):
        browser.execute_script(
            'arguments[0].dispatchEvent(new PointerEvent(arguments[1], '
            '{clientX: arguments[0].getBoundingClientRect().x + 200, bubbles: true}))',
            canvas,
            kind,
        )
    until(browser, 'return document.querySelectorAll("#region table").length === 2')
    browser.execute_script(CHOOSE, 'drawn', 'curves')
    return browser.find_element('id', 'region').text


def test_reload_and_a_second_tab_amid_a_diagnosis_that_is_stopped(browser, server):
    """The step goes on, both tabs find it, either may end it; what it has can be accepted and undone."""
    browser.execute_script(
        'const models = [...document.querySelectorAll("[data-stage=diagnose] select")]; models[0].value = "mas";'
        'for (const one of document.querySelectorAll("[data-stage=diagnose] input")) one.checked = false;'
    )
    browser.execute_script('window.scrollTo(0, document.body.scrollHeight)')
    begin(browser, 'diagnose')
    until(browser, f'return {STEP}.job?.state === "running"', 'diagnose')
    until(browser, f'{GROWING} return 0 < place.top && place.bottom < innerHeight')  # it is seen to grow
    browser.refresh()
    until(browser, f'{READY} && document.querySelector("[data-stop=diagnose]") !== null')
    assert offered(browser) == []
    first = browser.current_window_handle
    browser.switch_to.new_window('tab')
    opened(browser, server)
    until(browser, 'return document.querySelector("[data-stop=diagnose]") !== null')
    until(browser, 'return smaExplore.stages.events.some((one) => one.kind === "model")', seconds=PATIENCE)
    assert refused(server, 'recordings', hold_out=['run3'])  # not while it runs
    browser.execute_script('document.querySelector("[data-stop=diagnose]").click()')
    ended(browser, 'diagnose', 'stopped')
    browser.close()
    browser.switch_to.window(first)
    ended(browser, 'diagnose', 'stopped')
    until(browser, 'return document.querySelector("#detail table, #detail .words, #detail .file") !== null')
    move = 'document.getElementById("growing").dispatchEvent(new PointerEvent("pointermove", {clientX: arguments[0]}))'
    browser.execute_script(move, browser.execute_script(f'{GROWING} return place.x + 0.05 * place.width'))
    words = browser.find_element('css selector', '#detail output').text
    assert words.startswith('model as it is (mas): ') and ' in the fitted runs' in words
    options = server.application.data.engine.latest('diagnose').options
    assert options == {'model': 'mas', 'equation': False, 'variants': False}


def test_calibrate_accept_export_and_what_is_exported(browser, server, tmp_path):
    browser.execute_script(
        'const step = document.querySelector("[data-stage=calibrate]"); step.querySelector("select").value = "mas";'
        'step.querySelector("input[type=text]").value = "beam.E"; step.querySelector("input[type=number]").value = "1";'
        'step.querySelector("[data-option=limits]").value = "beam.E=2.2e9:3e9";'
    )
    begin(browser, 'calibrate')
    until(browser, 'return document.getElementById("growing") !== null')
    ended(browser, 'calibrate')
    until(browser, 'return document.querySelector("#detail h2").textContent.startsWith("Calibration")')
    value = server.application.data.engine.latest('calibrate').result()['parameters']['beam.E']['value']
    until(browser, 'return document.querySelector("#limits button") !== null')
    assert value == pytest.approx(2.2e9) and 'ended at a limit of the fit' in browser.find_element('id', 'limits').text
    browser.execute_script('document.querySelector("#limits button").click()')
    options = 'document.activeElement.dataset.option === "limits" && document.activeElement.value'
    until(browser, f'return {options} === arguments[0]', 'beam.E=2200000000:3000000000')
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


def write_structure_run(folder, system):
    """A run of a structure as it would be measured, under the command that the page begins with."""
    config = Config(system=system)
    source = input_of(first_command(config), config)
    run, random = simulate(Model(config), source, 5.0), np.random.default_rng(0)
    shown = {name: column for name, column in run.columns.items() if not name.startswith(('mode', 'x_M'))}
    noise = {name: (1e-3 * np.ptp(column) + 1e-9) * random.normal(size=len(run.time)) for name, column in shown.items()}
    write_columns(folder / 'run.csv', inputs_at(source, run.time) | {name: shown[name] + noise[name] for name in shown})
    return folder


@pytest.mark.slow
@pytest.mark.parametrize('system', ['lever', 'wire', 'slider', 'spatial', 'stack'])
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


WRONG = [
    ('start', {'stage': 'shell'}),
    ('start', {'stage': 'check', 'options': []}),
    ('start', {'stage': 'check', 'options': {'x': 1}}),
    ('start', {'stage': 'calibrate', 'options': {'starts': 0}}),
    ('job', {'number': 99}),
    ('job', {'number': '../1'}),
    ('job', {'number': 1, 'since': 'x'}),
    ('overlay', {'beside': 99}),
    ('overlay', {'window': [2, 1]}),
    ('overlay', {'curves': ['x']}),
    ('accept', {'number': 99}),
    ('part', {'run': 'run1', 'channel': 'alpha', 't0': 0}),
    ('part', {'run': 'x', 'channel': 'alpha', 't0': 0, 't1': 1}),
    ('recordings', {'batch': 99}),
    ('recordings', {'batch': '1'}),
    ('recordings', {'hold_out': ['nothing']}),
    ('recordings', {'hold_out': 'run1'}),
    ('recordings', {'recorded': True}),
    ('record', {'on': True}),
    ('record', {}),
    ('live_start', {'namespace': '-p x:=1'}),
    ('live_start', {'domain': 1.5}),
    ('live_start', {'domain': 999}),
]


def test_wrong_requests_change_nothing_and_say_why(server):
    for name, body in WRONG:
        before = ask(server)[1]
        words = refused(server, name, **body)
        assert len(words) > 10 and 'Traceback' not in words, (name, body)
        assert ask(server)[1] == before, (name, body)


@pytest.mark.parametrize(
    'path',
    [
        'report.html?job=../1',
        'report.html?job=99',
        'log.txt?job=1',
        '../request.json?job=1',
        'owner.json?export=1',
        'parameters.yaml?export=../..',
        'parameters.yaml',
        'report.html?job=%C2%B2',
    ],
)
def test_no_other_file_is_downloaded(server, path):
    assert ask(server, f'/download/{path}', 'GET')[0] in (400, 404)
