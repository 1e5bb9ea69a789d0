"""The steps of the page of `sma-sim explore` for tests: only what the page offers, in a browser."""

from explore_server import until
from measured_runs import truth, write_module_runs

PATIENCE = 300.0  # [s]
READY = 'return window.smaExplore !== undefined && smaExplore.ready'
STEP = 'smaExplore.state.steps.stages.find((one) => one.stage === arguments[0])'
ERRORS = 'return [...document.querySelectorAll("#errors td span")].map((one) => Number(one.title))'


def gravity_case(tmp_path_factory):
    """A robot with the paper's values that lacks gravity: three short runs."""
    return write_module_runs(tmp_path_factory.mktemp('case'), truth(model='mas', effects=['gravity']), seconds=12.0)


def opened(browser, server):
    browser.get(server.address)
    until(browser, READY)


def begin(browser, stage):
    """Press the button of a step, which is offered."""
    until(browser, f'return document.querySelector("[data-begin={stage}]")?.disabled === false')
    browser.execute_script(f'document.querySelector("[data-begin={stage}]").click()')


def ended(browser, stage, state='done'):
    """Wait until a step has ended."""
    until(
        browser,
        f'return {STEP}.job?.state === arguments[1] && smaExplore.state.steps.running === null',
        stage,
        state,
        seconds=PATIENCE,
    )


def take(browser, stage):
    begin(browser, stage)
    ended(browser, stage)


def offered(browser):
    """The steps whose button can be pressed."""
    buttons = '[...document.querySelectorAll("[data-begin]")].filter((one) => !one.disabled)'
    return browser.execute_script(f'return {buttons}.map((one) => one.dataset.begin)')
