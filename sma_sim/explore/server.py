"""The page's server: the standard library's, on this machine only, for whoever has the token.

Who may ask: the Host header must name this server (another name that leads here is DNS rebinding), the cookie that the
address with the token has set must be there, and what is sent must come from the page itself (Origin). Files are never
looked up by a name that comes over the wire.
"""

from __future__ import annotations

import hmac
import json
import queue
import secrets
import traceback
from collections.abc import Mapping
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Lock
from typing import Any
from urllib.parse import parse_qs, urlsplit

from sma_sim.explore.application import Application
from sma_sim.model.errors import UserError

LOOPBACK = '127.0.0.1'
ASSETS = Path(__file__).parent / 'assets'
SCRIPT = 'text/javascript; charset=utf-8'
TYPES = {'page.css': 'text/css; charset=utf-8', **{path.name: SCRIPT for path in ASSETS.glob('*.js')}}
JSON, BINARY = 'application/json', 'application/octet-stream'
MAX_BODY = 25_000_000  # bytes
MAX_INT = 300  # digits
HEARTBEAT = 10.0  # [s]
IDLE = 60.0  # [s] after which a connection is closed
HEADERS = {
    'Cache-Control': 'no-store',
    'X-Content-Type-Options': 'nosniff',
    'X-Frame-Options': 'DENY',
    'Referrer-Policy': 'no-referrer',
    'Cross-Origin-Resource-Policy': 'same-origin',
    'Cross-Origin-Opener-Policy': 'same-origin',
    'Content-Security-Policy': (
        "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src 'self' data:; "
        "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    ),
}
REFUSED = 'Not allowed. Open the address that sma-sim explore has printed: it holds the key to this page.'


class Refusal(Exception):
    """A request that is not answered, with the status of HTTP."""

    def __init__(self, status: int, words: str) -> None:
        super().__init__(words)
        self.status = status


class Tabs:
    """The open tabs; what is announced goes to all of them."""

    def __init__(self) -> None:
        self._queues: set[queue.SimpleQueue[str | None]] = set()
        self._lock = Lock()

    def announce(self, kind: str, data: Mapping[str, Any]) -> None:
        """Send an event to every tab."""
        self._put(f'event: {kind}\ndata: {json.dumps(data)}\n\n')

    def close(self) -> None:
        """End the streams of all tabs."""
        self._put(None)

    def _put(self, text: str | None) -> None:
        with self._lock:
            for one in self._queues:
                one.put(text)

    def join(self) -> queue.SimpleQueue[str | None]:
        """The events of a new tab."""
        events: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        with self._lock:
            self._queues.add(events)
        return events

    def leave(self, events: queue.SimpleQueue[str | None]) -> None:
        """Forget a tab."""
        with self._lock:
            self._queues.discard(events)


class PageServer(ThreadingHTTPServer):
    """Serves one application. Raises UserError where the port is taken."""

    daemon_threads = True
    block_on_close = False
    allow_reuse_address = True

    def __init__(self, port: int) -> None:
        self.tabs, self.token = Tabs(), secrets.token_urlsafe(24)
        self.application: Application | None = None
        try:
            super().__init__((LOOPBACK, port), Handler)
        except (OSError, OverflowError) as error:
            reason = getattr(error, 'strerror', None) or str(error)
            raise UserError(
                f'--port {port}: cannot listen on {LOOPBACK}:{port}: {reason}; choose another one, or leave it out'
            ) from error

    @property
    def port(self) -> int:
        """The port that it listens on."""
        return int(self.server_address[1])

    @property
    def address(self) -> str:
        """What to open in a browser."""
        return f'http://{LOOPBACK}:{self.port}/?token={self.token}'

    @property
    def hosts(self) -> tuple[str, ...]:
        """Names under which a browser may ask for it."""
        return f'{LOOPBACK}:{self.port}', f'localhost:{self.port}'

    @property
    def cookie(self) -> str:
        """The name of the cookie: cookies of one machine are shared by its ports."""
        return f'sma_sim_{self.port}'

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A tab that closes in the middle of an answer is no fault."""


class Handler(BaseHTTPRequestHandler):
    """One connection of a browser."""

    server: PageServer
    protocol_version = 'HTTP/1.1'
    server_version, sys_version = 'sma_sim', ''
    disable_nagle_algorithm = True
    wbufsize = -1
    timeout = IDLE

    def log_message(self, format: str, *args: Any) -> None:
        """Nothing: addresses hold the token."""

    def do_GET(self) -> None:
        """The page and its parts, the stream of events, downloads."""
        self.answer(self.get)

    def do_POST(self) -> None:
        """A verb of the application."""
        self.answer(self.post)

    def answer(self, method: Any) -> None:
        """Answer, or say why not."""
        try:
            method()
        except Refusal as refusal:
            self.close_connection = True
            self.send(refusal.status, 'text/plain; charset=utf-8', str(refusal).encode())
        except UserError as error:
            # what a user asked for and cannot have is an answer, not a fault of the connection
            self.send(200 if self.command == 'POST' else 400, JSON, json.dumps({'refused': str(error)}).encode())
        except (ConnectionError, TimeoutError):
            self.close_connection = True
        except Exception as error:
            traceback.print_exc()
            words = f'A fault of sma_sim ({type(error).__name__}: {error}); the terminal says more. Please report it.'
            self.send(500, 'text/plain; charset=utf-8', words.encode())

    def get(self) -> None:
        """A GET request."""
        self.check_host()
        where = urlsplit(self.path)
        words = parse_qs(where.query)
        if where.path == '/' and self.is_token(words.get('token', [''])[0]):
            cookie = f'{self.server.cookie}={self.server.token}; HttpOnly; SameSite=Strict; Path=/'
            return self.send(200, 'text/html; charset=utf-8', (ASSETS / 'page.html').read_bytes(), {'Set-Cookie': cookie})
        self.check_cookie()
        name = where.path.removeprefix('/assets/')
        if where.path == '/':
            self.send(200, 'text/html; charset=utf-8', (ASSETS / 'page.html').read_bytes())
        elif where.path == f'/assets/{name}' and name in TYPES:
            self.send(200, TYPES[name], (ASSETS / name).read_bytes())
        elif where.path == '/events':
            self.stream()
        elif where.path.startswith('/download/'):
            self.download(where.path.removeprefix('/download/'), words)
        else:
            raise Refusal(404, 'Not found.')

    def post(self) -> None:
        """A POST request."""
        self.check_host()
        self.check_origin()
        self.check_cookie()
        body, application = self.body(), self.server.application
        verb = self.path.removeprefix('/api/')
        if application is None or self.path != f'/api/{verb}' or verb not in application.verbs:
            raise Refusal(404, 'Not found.')
        reply = application.verbs[verb](body)
        if isinstance(reply, bytes):
            self.send(200, BINARY, reply)
        else:
            self.send(200, JSON, json.dumps(reply, allow_nan=False).encode())

    def check_host(self) -> None:
        """Raise Refusal for another name that leads here."""
        if self.headers.get_all('Host', []) not in [[host] for host in self.server.hosts]:
            raise Refusal(403, REFUSED)

    def check_origin(self) -> None:
        """Raise Refusal for what another page sends."""
        origin, site = self.headers.get('Origin'), self.headers.get('Sec-Fetch-Site', 'same-origin')
        if origin != f'http://{self.headers["Host"]}' or site != 'same-origin':
            raise Refusal(403, REFUSED)

    def check_cookie(self) -> None:
        """Raise Refusal for whoever has not opened the address with the token."""
        pairs = [part.strip().partition('=') for text in self.headers.get_all('Cookie', []) for part in text.split(';')]
        if not any(name == self.server.cookie and self.is_token(value) for name, _, value in pairs):
            raise Refusal(403, REFUSED)

    def is_token(self, text: str) -> bool:
        """Whether a text is the token."""
        return hmac.compare_digest(text.encode(), self.server.token.encode())

    def body(self) -> Mapping[str, Any]:
        """The JSON that was sent. Raises Refusal."""
        length = self.headers.get('Content-Length', '')
        if not (length.isascii() and length.isdigit()) or 'Transfer-Encoding' in self.headers:
            raise Refusal(411, 'Expected a Content-Length.')
        if int(length) > MAX_BODY:
            raise Refusal(413, f'Expected at most {MAX_BODY} bytes.')
        if self.headers.get_content_type() != JSON:
            raise Refusal(415, f'Expected {JSON}.')
        try:
            found = json.loads(self.rfile.read(int(length)), parse_constant=no_constant, parse_int=short_int)
        except (ValueError, RecursionError) as error:
            raise Refusal(400, 'Expected JSON.') from error
        if not isinstance(found, dict):
            raise Refusal(400, 'Expected a JSON object.')
        return found

    def send(self, status: int, kind: str, content: bytes, further: Mapping[str, str] | None = None) -> None:
        """Send a whole answer."""
        self.send_response(status)
        headers = {**HEADERS, 'Content-Type': kind, 'Content-Length': str(len(content)), **(further or {})}
        for name, value in headers.items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(content)
        self.wfile.flush()

    def download(self, name: str, words: Mapping[str, list[str]]) -> None:
        """A version, a result or an export as a file."""
        if self.server.application is None:
            raise Refusal(404, 'Not found.')
        kind, content, shown = self.server.application.download(name, {word: values[0] for word, values in words.items()})
        self.send(200, kind, content, {'Content-Disposition': f'attachment; filename="{shown}"'})

    def stream(self) -> None:
        """Events, until the tab or the server closes."""
        self.close_connection = True
        events = self.server.tabs.join()
        try:
            self.send_response(200)
            for name, value in {**HEADERS, 'Content-Type': 'text/event-stream', 'Connection': 'close'}.items():
                self.send_header(name, value)
            self.end_headers()
            text: str | None = ': open\n\n'
            while text is not None:
                self.wfile.write(text.encode())
                self.wfile.flush()
                try:
                    text = events.get(timeout=HEARTBEAT)
                except queue.Empty:
                    text = ': still here\n\n'
        finally:
            self.server.tabs.leave(events)


def short_int(word: str) -> int:
    """A whole number that a double can hold about; larger ones are no number of the page."""
    if len(word) > MAX_INT:
        raise ValueError(word)
    return int(word)


def no_constant(word: str) -> float:
    """NaN and Infinity are not JSON."""
    raise ValueError(word)
