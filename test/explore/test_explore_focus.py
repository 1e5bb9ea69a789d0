"""The page of `sma-sim explore` by keys: controls are made anew with each change, and nobody loses his place in them."""

import pytest
from explore_server import serving, until
from explore_steps import STEP, ended, gravity_case, opened

from sma_sim.workflow.data_request import DataRequest

FOCUSED = 'const one = document.activeElement; return one.dataset.begin ?? one.dataset.stop ?? one.ariaLabel ?? one.id'


@pytest.fixture(scope='module')
def server(tmp_path_factory):
    start = {'words': ('model=mas',), 'data': DataRequest((gravity_case(tmp_path_factory),))}
    with serving(tmp_path_factory.mktemp('focus') / 'session', **start) as one:
        yield one


def press(browser, *keys):
    """Keys to whatever has the focus, also where it is made anew just now."""
    chain = pytest.importorskip('selenium.webdriver').ActionChains(browser)
    chain.send_keys(*keys).perform()


def test_steps_are_taken_one_after_another_by_keys(browser, server):
    """From a step that was taken the next one is a Tab or two away; while it runs, the key that started it stops it."""
    keys = pytest.importorskip('selenium.webdriver').Keys
    opened(browser, server)
    browser.execute_script('document.querySelector("[data-begin=check]").focus()')
    for stage, next_stage in (('check', 'compare'), ('compare', 'candidates')):
        press(browser, keys.ENTER)
        until(browser, f'return {STEP}.job !== null', stage)
        ended(browser, stage)
        until(browser, f'return document.querySelector("[data-begin={next_stage}]") !== null')
        assert browser.execute_script(FOCUSED) == stage
        for _ in range(2):
            if browser.execute_script(FOCUSED) != next_stage:
                press(browser, keys.TAB)
        assert browser.execute_script(FOCUSED) == next_stage


def test_a_control_that_cannot_be_used_any_more_leaves_the_focus_to_its_neighbour(browser, server):
    keys = pytest.importorskip('selenium.webdriver').Keys
    server.application.session.change({'beam.E': 2.1e9})
    server.application.changed()
    until(browser, 'return smaExplore.state.history.can_undo')
    browser.execute_script('document.getElementById("undo").focus()')
    press(browser, keys.ENTER)
    until(browser, 'return !smaExplore.state.history.can_undo')
    assert browser.execute_script(FOCUSED) == 'redo'


def test_what_is_being_typed_and_chosen_outlasts_a_change_from_another_tab(browser, server):
    opened(browser, server)
    browser.find_element('id', 'tab-history').click()
    name = 'document.querySelector("[data-version=\\"1\\"] input")'
    browser.execute_script(f'{name}.focus()')
    press(browser, 'half a na')
    options = 'document.querySelector("[data-stage=diagnose] details")'
    switch = f'[...{options}.querySelectorAll("input")].at(-1)'
    until(browser, f'return {options} !== null')
    browser.execute_script(f'{options}.open = true; {switch}.click();')
    number = server.application.session.change({'beam.E': 2.2e9}).number
    server.application.changed()
    until(browser, 'return smaExplore.state.history.current === arguments[0]', number)
    assert browser.execute_script(FOCUSED) == 'Name of version 1'
    press(browser, 'me')
    assert browser.execute_script(f'return {name}.value') == 'half a name'
    server.application.session.undo()
    server.application.changed()
    until(browser, f'return smaExplore.state.history.current === 1 && {options} !== null')
    assert browser.execute_script(f'return {switch}.checked') is False
