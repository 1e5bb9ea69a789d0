"""How the page of `sma-sim explore` is laid out and what its charts say, in a browser."""

import time

import pytest
from browser import open_browser
from explore_server import opened, serving

SIZES = {'phone': (360, 740, True), 'tablet': (768, 1024, True), 'screen': (1400, 900, False), '4K': (3840, 2160, False)}
PICTURE = 'return document.querySelector("#drawing canvas").clientHeight'
MOVE = 'const one = document.getElementById("instant"); one.value = arguments[0]; one.dispatchEvent(new Event("input"))'
REDRAWS = 20


@pytest.fixture(scope='module')
def server(tmp_path_factory):
    with serving(tmp_path_factory.mktemp('layout') / 'session') as one:
        yield one


@pytest.mark.parametrize('size', SIZES)
def test_the_picture_keeps_its_size_while_it_moves(server, size):
    """A canvas has the proportions of what is drawn on it: without care its row grows with each redraw."""
    width, height, phone = SIZES[size]
    browser = open_browser(width, height, phone=phone)
    try:
        opened(browser, server)
        before = browser.execute_script(PICTURE)
        for k in range(REDRAWS):
            browser.execute_script(MOVE, 40 * k)
            time.sleep(0.03)
        assert 100 < before < height / 2 and browser.execute_script(PICTURE) == before
        assert browser.get_log('browser') == []
    finally:
        browser.quit()
