"""The HTML page: self-contained and small, and a real browser draws every figure of it without a complaint."""

import base64
import html
import json
import re
import time
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import plotly.graph_objects as go
import pytest
from browser import open_browser
from measured_runs import truth, write_isotherm, write_module_runs

from sma_sim import UserError
from sma_sim.cli.main import main
from sma_sim.explore.differences import differences
from sma_sim.model.config import Config, read_config
from sma_sim.report.html.figures import envelope, log_axis, new_figure, stretches
from sma_sim.report.html.page import (
    GAP,
    Bullets,
    Grid,
    Paragraph,
    Plot,
    Section,
    Table,
    Tabs,
    elapsed_words,
    figure_json,
    packed_curve,
    write_page,
)

PATIENCE = 60.0  # [s]
MAX_BYTES = 3e6


@pytest.fixture(scope='module')
def page(tmp_path_factory):
    """The page of a fit of a module with gravity missing from the model, a run held out."""
    folder = write_module_runs(tmp_path_factory.mktemp('runs'), truth(effects=['gravity'], wire__lambda=1.1))
    path = folder / 'fit.html'
    words = ['fit', str(folder), '--hold-out', 'run3', '--free', 'wire.lambda,beam.E', '--model', 'hybrid', '--starts', '1']
    assert main([*words, '--report', str(path)]) == 0
    return path


class Links(HTMLParser):
    """Collects what a page would load, and its headings."""

    def __init__(self):
        super().__init__()
        self.loaded, self.headings, self.heading = [], [], False

    def handle_starttag(self, tag, attributes):
        given = dict(attributes)
        if tag in ('script', 'img', 'iframe', 'link'):
            self.loaded += [given[name] for name in ('src', 'href') if name in given]
        self.heading = tag == 'h2'

    def handle_data(self, data):
        if self.heading:
            self.headings.append(data)
            self.heading = False


def test_page_is_one_file_that_loads_nothing(page):
    links = Links()
    links.feed(page.read_text())
    assert links.loaded == ['data:,']
    assert links.headings == [
        'How well it fits',
        'Parameters',
        'Where the error is',
        'Measured against model',
        'Hysteresis',
        'Residual over state',
        'Data',
        'How this page was made',
    ]
    assert page.stat().st_size < MAX_BYTES


@pytest.mark.parametrize(
    ('seconds', 'words'),
    [(0.04, '0.0 s'), (9.94, '9.9 s'), (9.96, '10 s'), (59.6, '1 min 0 s'), (200.0, '3 min 20 s'), (3725.0, '1 h 2 min')],
)
def test_times_as_people_say_them(seconds, words):
    assert elapsed_words(seconds) == words


def test_what_made_the_page_stands_in_it(page):
    """The command as it was typed, and the model that it was given, which makes the same again."""
    text = html.unescape(page.read_text())
    assert f'sma-sim fit {page.parent} --hold-out run3' in text and str(Path.cwd()) in text
    listing = re.search(r'given: without a parameter file</summary><pre>(.*?)</pre>', text, re.DOTALL).group(1)
    (page.parent / 'again.yaml').write_text(listing)
    assert differences(read_config(page.parent / 'again.yaml'), Config()) == ()


@pytest.mark.slow
def test_page_of_thirty_runs_stays_small(tmp_path):
    write_module_runs(tmp_path, truth(), count=30, seconds=100.0)
    path = tmp_path / 'many.html'
    assert main(['compare', str(tmp_path), '--no-nuisance', '--report', str(path)]) == 0
    assert path.stat().st_size < MAX_BYTES


def until(driver, script, what):
    """Wait until a script's answer is true."""
    end = time.monotonic() + PATIENCE
    while not driver.execute_script(f'return {script}'):
        assert time.monotonic() < end, f'waited {PATIENCE} s for {what}: {driver.execute_script("return window.smaPage")}'
        time.sleep(0.05)


IN_VIEW = "[...document.querySelectorAll('.plot')].filter(p => p.offsetParent !== null)"
TABS = "[...document.querySelectorAll('[role=tablist]')]"
RUNS = "[...document.querySelectorAll('section')].find(s => s.querySelector('h2').textContent === 'Measured against model')"


def see_everything(driver):
    """Open every tab and scroll to every figure."""
    for k in range(driver.execute_script(f'return Math.max(1, ...{TABS}.map(b => b.children.length))')):
        driver.execute_script(f'{TABS}.forEach(b => b.children[{k}]?.click())')
        for place in driver.execute_script(f'return {IN_VIEW}'):
            name = place.get_attribute('id')  # figures above that are drawn late may push it out of view: scroll again
            look = f"(e => (e.scrollIntoView(), e.dataset.state === 'drawn'))(document.getElementById('{name}'))"
            until(driver, look, f'the figure {name}')


AXES = """
return [...document.querySelectorAll('.plot')].filter(p => p._fullLayout).flatMap(p => {
  const shown = e => getComputedStyle(e).display !== 'none' && e.style.opacity !== '0' && e.textContent !== '';
  const isShown = ([name, a]) => /^[xy]axis[0-9]*$/.test(name) && a.visible && a.showticklabels;
  const axes = Object.entries(p._fullLayout).filter(isShown);
  return axes.map(([name, a]) => ({figure: p.id, axis: name, type: a.type, categories: (a._categories || []).length,
    labels: [...p.querySelectorAll('.' + a._id + 'tick text')].filter(shown).map(e => e.textContent)}));
})"""


def poorly_labelled(driver):
    """Axes of the figures in view with fewer than two labelled ticks; what has but one category needs no more."""
    return [axes for axes in driver.execute_script(AXES) if len(axes['labels']) < 2 and axes['categories'] != 1]


def complaints(driver):
    """What the browser's console says."""
    return [entry['message'] for entry in driver.get_log('browser') if entry['level'] in ('SEVERE', 'WARNING')]


@pytest.fixture(scope='module')
def desktop(page):
    driver = open_browser()
    driver.get(page.as_uri())
    yield driver
    driver.quit()


def test_every_figure_is_drawn_without_an_error(desktop):
    see_everything(desktop)
    found = desktop.execute_script('return window.smaPage')
    assert found['total'] > 30 and found['drawn'] == found['total'] and found['failed'] == []
    empty = "p => p.querySelectorAll('.trace, .hm').length === 0"
    assert desktop.execute_script(f"return [...document.querySelectorAll('.plot')].filter({empty}).length") == 0
    assert complaints(desktop) == []


def test_every_axis_has_two_labelled_ticks(desktop):
    for k in range(desktop.execute_script(f'return Math.max(1, ...{TABS}.map(b => b.children.length))')):
        desktop.execute_script(f'{TABS}.forEach(b => b.children[{k}]?.click())')
        assert poorly_labelled(desktop) == []


@pytest.mark.parametrize(('width', 'phone'), [(1400, False), (900, False), (390, True)])
def test_no_heading_of_the_menu_is_out_of_sight(page, width, phone):
    """All of them are on the screen, whatever its width, and what is jumped to is not behind the menu."""
    driver = open_browser(width, 800, phone)
    try:
        driver.get(page.as_uri())
        links = 'return [...document.querySelectorAll("nav a")].map((one) => one.getBoundingClientRect())'
        assert all(one['left'] >= 0 and one['right'] <= width for one in driver.execute_script(links))
        assert driver.execute_script('return document.documentElement.scrollWidth <= innerWidth')
        menu = 'document.querySelector("header").getBoundingClientRect().bottom'
        jump = 'const top = document.getElementById("part2").getBoundingClientRect().top;'
        driver.execute_script('document.querySelectorAll("nav a")[2].click()')
        until(driver, f'(() => {{ {jump} return Math.max({menu}, 0) <= top + 1 && top < innerHeight / 2; }})()', 'the jump')
    finally:
        driver.quit()


def test_logarithmic_axes_are_labelled_within_a_decade_and_over_many(tmp_path):
    plots = []
    for low, high in ((0.97, 1.04), (0.8, 2.0), (0.7, 6.9), (2.0, 9.0), (0.3, 70.0), (1e-6, 3e-4), (0.8, 4e4)):
        figure = new_figure()
        figure.add_scatter(x=[low, high], y=[low, high])
        figure.update_xaxes(**log_axis(low, high))
        figure.update_yaxes(**log_axis(low, high))
        plots.append(Plot(figure, f'{low:g} to {high:g}', 300))
    write_page(tmp_path / 'page.html', 'Axes', [Section('Axes', [Grid(plots)])])
    driver = open_browser()
    try:
        driver.get((tmp_path / 'page.html').as_uri())
        see_everything(driver)
        assert driver.execute_script('return window.smaPage.drawn') == len(plots)
        assert poorly_labelled(driver) == []
        numbers = [[float(label) for label in axes['labels']] for axes in driver.execute_script(AXES)]
        assert all(found == sorted(found) for found in numbers)  # whole numbers, not the digits between two decades
    finally:
        driver.quit()


def runs_figure(driver):
    """The first figure of measured against model, brought into view."""
    driver.execute_script(f"{RUNS}.querySelector('[role=tab]').click()")
    figure = driver.execute_script(f"return {RUNS}.querySelector('.plot')")
    driver.execute_script('arguments[0].scrollIntoView()', figure)
    until(driver, f"{RUNS}.querySelector('.plot').dataset.state === 'drawn'", 'the figure')
    return figure


def time_ranges(driver, figure):
    """The ranges of all time axes of a figure."""
    axes = 'Object.entries(arguments[0]._fullLayout).filter(one => /^xaxis/.test(one[0]))'
    return driver.execute_script(f'return {axes}.map(one => one[1].range)', figure)


def test_zoom_moves_all_axes_and_double_click_goes_back(desktop):
    from selenium.webdriver import ActionChains

    figure = runs_figure(desktop)
    low, high = time_ranges(desktop, figure)[0]
    axis = f"document.getElementById('{figure.get_attribute('id')}')._fullLayout.xaxis"
    drag = desktop.execute_script("return arguments[0].querySelector('.nsewdrag')", figure)
    mouse = ActionChains(desktop).move_to_element_with_offset(drag, -100, 0)
    mouse.click_and_hold().move_by_offset(200, 0).release().perform()
    until(desktop, f'{axis}.range[0] > {low} && {axis}.range[1] < {high}', 'the zoom')
    zoomed = time_ranges(desktop, figure)
    assert len(zoomed) > 5 and all(axes == zoomed[0] for axes in zoomed)
    end = time.monotonic() + PATIENCE
    while not desktop.execute_script(f'return Math.abs({axis}.range[0] - {low}) < 1e-6'):
        assert time.monotonic() < end, 'no double click led back'
        ActionChains(desktop).double_click(drag).pause(1.0).perform()  # on a busy machine it may come as two clicks


def test_legend_switches_a_curve_off_in_every_channel(desktop):
    figure = runs_figure(desktop)
    visible = "return arguments[0]._fullData.filter(t => t.name === 'model').map(t => t.visible)"
    assert desktop.execute_script(visible, figure) == [True] * 5
    entry = desktop.execute_script(
        "return [...arguments[0].querySelectorAll('.legendtoggle')].find(e => e.parentNode.textContent === 'model')", figure
    )
    entry.click()
    number = figure.get_attribute('id')
    until(
        desktop,
        f"document.getElementById('{number}')._fullData.filter(t => t.name === 'model')"
        f".every(t => t.visible === 'legendonly')",
        'the curves to go',
    )


@pytest.mark.slow
def test_page_fits_a_phone(page):
    driver = open_browser(390, 844, phone=True)
    try:
        driver.get(page.as_uri())
        see_everything(driver)
        assert driver.execute_script('return document.documentElement.scrollWidth') <= 390
        wide = "[...document.querySelectorAll('.plot .main-svg')].filter(p => p.getBoundingClientRect().width > 390).length"
        assert driver.execute_script(f'return {wide}') == 0
        assert complaints(driver) == []
    finally:
        driver.quit()


def test_page_of_a_wire_is_drawn_too(tmp_path):
    for T_E, width in ((300.0, 1.0), (330.0, 1.4)):
        write_isotherm(tmp_path / f'at_{T_E:.0f}K.csv', truth('wire', wire__dsigma=width), T_E)
    path = tmp_path / 'wire.html'
    words = ['fit', str(tmp_path), '--system', 'wire', '--model', 'hybrid', '--starts', '1', '--noise', 'stress=1e6']
    assert main([*words, '--free', 'wire.sigma_MW0,wire.dsigma', '--report', str(path)]) == 0
    assert 'one dsigma does not fit all runs' in path.read_text()
    driver = open_browser()
    try:
        driver.get(path.as_uri())
        see_everything(driver)
        assert complaints(driver) == []
    finally:
        driver.quit()


def test_blocks_are_escaped_and_shown_in_their_order(tmp_path):
    path = tmp_path / 'page.html'
    figure = go.Figure(go.Scatter(y=[1, 2], name='</script><b>'))
    blocks = [
        Paragraph('<script>alert(1)</script>'),
        Table(('<i>', 'b'), [('1', '2')], 'c & d'),
        Bullets(['x'], numbered=True),
        Tabs([('one', [Paragraph('first pane')]), ('two', [Grid([Plot(figure, 'last words')])])]),
    ]
    write_page(path, 'a < b', [Section('Part', blocks), Section('Empty', [])])
    text = path.read_text()
    body = text[text.index('<main>') : text.index('</main>')]
    assert '&lt;script&gt;alert(1)&lt;/script&gt;' in body and '<title>a &lt; b</title>' in text
    assert body.count('</script>') == 1 and 'Empty' not in body
    places = [body.index(word) for word in ('alert(1)', '&lt;i&gt;', '<ol>', 'first pane', 'last words')]
    assert places == sorted(places)


def test_a_page_that_cannot_be_written_leaves_nothing(tmp_path):
    with pytest.raises(UserError, match='cannot write'):
        write_page(tmp_path / 'none' / 'page.html', 'x', [])
    assert list(tmp_path.iterdir()) == []


def test_envelope_keeps_every_spike_and_leaves_gaps_out():
    values = np.sin(np.linspace(0.0, 3.0, 10_001))
    values[4321], values[77] = 9.0, np.nan
    at = envelope(values, 200)
    assert len(at) <= 200 and 4321 in at and 77 not in at and (np.diff(at) > 0).all()
    assert list(envelope(values[:50], 200)) == list(range(50))


def test_stretches_of_equal_labels():
    begin, end = stretches(np.array([3, 3, 4, 5, 5]))
    assert list(begin) == [0, 2, 3] and list(end) == [2, 3, 4]


def test_figures_carry_no_more_than_a_screen_shows(page):
    """Curves of the page are at most a few thousand numbers long, and none is there twice in a figure."""
    found = re.findall(r'<script type="application/json" id="data\d+">(.*?)</script>', page.read_text())
    curves = [[curve['steps'] for curve in json.loads(text)['packed']] for text in found]
    lengths = [len(base64.b64decode(steps)) // 2 for figure in curves for steps in figure]
    assert len(lengths) > 50 and max(lengths) <= 1600
    assert all(len(set(figure)) == len(figure) for figure in curves)


def test_a_packed_curve_is_as_exact_as_a_screen():
    values = np.array([298.15, np.nan, *np.linspace(-4.0, 371.3, 200)], dtype=np.float32)
    packed = packed_curve(values)
    steps = np.frombuffer(base64.b64decode(packed['steps']), dtype='<u2')
    assert list(np.flatnonzero(steps == GAP)) == [1]
    known = np.isfinite(values)
    assert packed['low'] + packed['step'] * steps[known] == pytest.approx(values[known], abs=375.3 / 130_000)


def test_a_figure_is_json_of_the_types_that_a_browser_reads():
    figure = go.Figure(go.Heatmap(z=np.arange(6, dtype=np.uint8).reshape(2, 3)))
    figure.add_scatter(
        x=np.full(20, np.float32(2.5)), y=np.full(20, np.float32(2.5)), error_y={'array': np.array([1.0, 2.0])}
    )
    figure.add_bar(x=['a', 'b'], y=[float('nan'), np.float32(2.0)])
    heatmap, curve, bar = json.loads(figure_json(figure))['data']
    assert heatmap['z'] == {'dtype': 'u1', 'bdata': 'AAECAwQF', 'shape': '2, 3'}
    assert curve['x'] == curve['y'] == {'packed': 0} and curve['error_y']['array']['dtype'] == 'f8'
    assert bar['y'] == [None, 2.0]
