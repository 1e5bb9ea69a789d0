"""How the page of `sma-sim explore` is laid out and what its charts say, in a browser."""

import time

import pytest
from browser import open_browser
from explore_server import opened, serving

from sma_sim.explore.command import first_command

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


# What is written on a chart, each with the width for which there is room.
WRITTEN = """
const chart = smaExplore.charts.get(arguments[0]), { context } = chart, found = [], plain = context.fillText.bind(context);
context.fillText = (text, x, y, most) => {
  found.push([text, context.measureText(text).width / (most ?? Infinity)]);
  plain(text, x, y);
};
chart.draw();
delete context.fillText;
return found;
"""


@pytest.fixture(scope='module')
def browser():
    one = open_browser(*SIZES['screen'][:2])
    yield one
    one.quit()


def test_rounding_is_no_curve_and_its_axis_can_be_read(browser, tmp_path):
    """The spatial beam bends in one plane when only its first bundle is heated: across it there is nothing but rounding."""
    with serving(tmp_path / 'session', words=('system=spatial',)) as server:
        first = first_command(server.application.session.config()).as_data()
        first['rows'] = [[time, J_1, 0.0, 0.0] for time, J_1, *_ in first['rows']]
        server.application.set_command({'command': first})
        opened(browser, server)
        run = server.application.run(server.application.session.config()).columns
        assert 0.0 < abs(run['U_z_m']).max() < 1e-15
        assert browser.execute_script('const [low, high] = smaExplore.charts.get("U_z [mm]").y; return high - low') > 1e-4
        for chart in ('U_z [mm]', 'beta [deg]', 'alpha [deg]', 'loop fraction'):
            written = browser.execute_script(WRITTEN, chart)
            assert len(written) > 5 and max(share for _, share in written) < 1.3, written  # squeezed a little at most
        assert browser.get_log('browser') == []


def test_every_column_of_a_command_can_be_edited(browser, tmp_path):
    """Nine bundles: the table is wider than the controls, and is scrolled."""
    with serving(tmp_path / 'session', words=('system=stack', 'stack.modules=9')) as server:
        opened(browser, server)
        browser.find_element('id', 'tab-command').click()
        last = browser.find_elements('css selector', '#command tr:last-child button')[-1]
        browser.execute_script('arguments[0].scrollIntoView({inline: "end"})', last)
        place = 'const [one, all] = [arguments[0], document.querySelector("aside")].map((e) => e.getBoundingClientRect());'
        assert browser.execute_script(f'{place} return one.right <= all.right && one.left >= all.left', last)


def test_every_wire_of_a_stack_is_in_the_legends(browser, tmp_path):
    with serving(tmp_path / 'session', words=('system=stack',)) as server:
        opened(browser, server)
        for chart in ('loop stress', 'loop fraction'):
            texts = [text for text, _ in browser.execute_script(WRITTEN, chart)]
            assert texts.count('\u2026') == 0 and {'1', '2', '3', '4', '5', '6'} <= set(texts), texts
