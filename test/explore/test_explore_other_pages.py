"""Another page in the same browser is tried against the page of `sma-sim explore`."""

from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Thread

from browser import open_browser
from explore_server import opened, serving, slide, until

EVIL = """<!DOCTYPE html><form id="form" method="post" target="frame" enctype="text/plain" action="http://HOST/api/undo">
<input name='{"x": "' value='"}'></form><iframe name="frame"></iframe><img src="http://HOST/download/run.csv?version=1">
<script>
const types = [{ 'Content-Type': 'text/plain' }, { 'Content-Type': 'application/json' }];
const asked = types.flatMap((headers) => ['no-cors', 'cors'].map((mode) => fetch('http://HOST/api/undo',
  { method: 'POST', body: '{}', headers, mode, credentials: 'include' }).then((one) => one.text(), () => '')));
window.stream = new EventSource('http://HOST/events', { withCredentials: true });
document.getElementById('form').submit();
Promise.all(asked).then((texts) => setTimeout(() => { window.done = texts.join(''); }, 500));
</script>"""


def test_another_page_in_the_same_browser_cannot_drive_it(tmp_path):
    """CSRF from a server on another port of this machine, to which a browser sends our cookie; DNS rebinding."""
    rebinding = open_browser(further=('host-resolver-rules=MAP evil.example 127.0.0.1',))
    try:
        with serving(tmp_path / 'session') as server, ThreadingHTTPServer(('127.0.0.1', 0), EvilHandler) as evil:
            Thread(target=evil.serve_forever, daemon=True).start()
            opened(rebinding, server)
            slide(rebinding, 'wire.dsigma', 700)
            EvilHandler.content = EVIL.replace('HOST', f'127.0.0.1:{server.port}').encode()
            rebinding.get(f'http://127.0.0.1:{evil.server_address[1]}/')
            until(rebinding, 'return window.done !== undefined')
            assert rebinding.execute_script('return [window.done, stream.readyState]') == ['', 2]
            assert server.application.session.current.number == 2
            rebinding.get(f'http://evil.example:{server.port}/?token={server.token}')
            assert 'Not allowed' in rebinding.find_element('tag name', 'body').text
            evil.shutdown()
    finally:
        rebinding.quit()


class EvilHandler(BaseHTTPRequestHandler):
    """Serves one page."""

    content = b''

    def do_GET(self):
        self.send_response(200)
        self.send_header('Content-Type', 'text/html')
        self.end_headers()
        self.wfile.write(self.content)

    def log_message(self, *_):
        pass
