"""A server of the page of `sma-sim explore` for tests: requests as the page sends them, and what a browser does there."""

import contextlib
import http.client
import json
import time
from threading import Thread

from sma_sim.explore.application import Application
from sma_sim.explore.server import PageServer
from sma_sim.explore.session import Start, open_session
from sma_sim.model.given import effect_folders_of

READY = 'return window.smaExplore !== undefined && smaExplore.ready && smaExplore.pictures > 0'
CURVE = """
const [panel, column] = arguments, chart = smaExplore.charts.get(panel);
const curve = chart.curves.find((one) => one.column === column && !one.beside);
return [Array.from(curve.x), Array.from(curve.y)];
"""
SLIDE = """
const slider = document.querySelector(`[data-name="${arguments[0]}"] input[type=range]`);
slider.value = arguments[1];
slider.dispatchEvent(new Event('input'));
if (arguments[2]) slider.dispatchEvent(new Event('change'));
"""


@contextlib.contextmanager
def serving(folder, **start):
    """A server with a session in `folder`."""
    with open_session(folder, Start(**start)) as session, PageServer(0) as server:
        folders = effect_folders_of(None, start.get('words', ()))
        server.application = Application(session, folders, server.tabs.announce)
        thread = Thread(target=server.serve_forever, kwargs={'poll_interval': 0.02})
        thread.start()
        try:
            yield server
        finally:
            server.tabs.close()
            server.shutdown()
            thread.join()


def ask(server, path='/api/state', method='POST', body=b'{}', **headers):
    """Status and content of a request: as our page would send it, but for `headers` (None: without)."""
    host = f'127.0.0.1:{server.port}'
    own = {
        'Host': host,
        'Origin': f'http://{host}',
        'Cookie': f'{server.cookie}={server.token}',
        'Content-Type': 'application/json',
        'Content-Length': str(len(body)),
    }
    given = own | {name.replace('_', '-'): value for name, value in headers.items()}
    connection = http.client.HTTPConnection('127.0.0.1', server.port, timeout=60)
    try:
        connection.putrequest(method, path, skip_host=True, skip_accept_encoding=True)
        for name, value in given.items():
            if value is not None and not (method == 'GET' and name.startswith('Content')):
                connection.putheader(name, value)
        connection.endheaders(body if method == 'POST' else None)
        answer = connection.getresponse()
        return answer.status, answer.read()
    finally:
        connection.close()


def verb(server, verb_name, /, **body):
    return ask(server, f'/api/{verb_name}', body=json.dumps(body).encode())


def refused(server, verb_name, /, **body):
    """Why a request is refused; empty where it is not."""
    status, content = verb(server, verb_name, **body)
    return json.loads(content).get('refused', '') if status == 200 and content[:1] == b'{' else ''


def opened(browser, server):
    browser.get(server.address)
    until(browser, READY)


def until(browser, script, *arguments, seconds=60.0):
    """Wait for a script to say true: to ask takes time of the browser and of what it waits for, so less and less often."""
    end, pause = time.monotonic() + seconds, 0.02
    while not browser.execute_script(script, *arguments):
        assert time.monotonic() < end, f'{script}: {browser.execute_script("return document.body.innerText")}'
        time.sleep(pause)
        pause = min(1.2 * pause, 0.2)


def slide(browser, name, step, let_go=True):
    """Move a slider, and wait for its curve; let go, also for the version."""
    before = browser.execute_script('return [smaExplore.drawn, smaExplore.state.history.revision]')
    browser.execute_script(SLIDE, name, step, let_go)
    until(browser, 'return smaExplore.drawn > arguments[0]', before[0])
    if let_go:
        until(browser, 'return smaExplore.state.history.revision > arguments[0]', before[1])
        until(browser, 'return Object.keys(smaExplore.values).length === 0')
