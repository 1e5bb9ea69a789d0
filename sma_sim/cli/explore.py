"""`sma-sim explore`: the model in the browser, every parameter a slider and every effect a switch."""

from __future__ import annotations

import argparse
import sys
import webbrowser
from pathlib import Path
from threading import Thread
from typing import Any

from sma_sim.cli.common.commands import add_command, add_kinetics
from sma_sim.cli.common.config_options import add_config_options
from sma_sim.cli.common.recording_options import add_recording_options, data_request
from sma_sim.explore.application import Application
from sma_sim.explore.server import PageServer
from sma_sim.explore.session import Session, Start, open_session
from sma_sim.model.errors import UserError
from sma_sim.model.given import effect_folders_of
from sma_sim.solver import first_start
from sma_sim.workflow.data_request import DataRequest

DEFAULT_FOLDER = Path('explore-session')
HIGHEST_PORT = 65535


def add_parser(verbs: Any) -> None:
    """Declare the verb."""
    parser = add_command(verbs, 'explore')
    add_recording_options(parser, nargs='*')
    add_kinetics(parser, ('hybrid', 'mas'), 'those of the configuration, else hybrid')
    parser.add_argument(
        '--session',
        type=Path,
        default=DEFAULT_FOLDER,
        metavar='FOLDER',
        help=f'folder that keeps every version of the model (default ./{DEFAULT_FOLDER})',
    )
    parser.add_argument('--port', type=int, default=0, metavar='N', help='port on this machine (default: any that is free)')
    parser.add_argument('--no-browser', action='store_true', help='only print the address')
    add_config_options(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Serve the page until Ctrl-C."""
    if not 0 <= arguments.port <= HIGHEST_PORT:
        raise UserError(f'--port {arguments.port}: expected 0 to {HIGHEST_PORT}')
    chosen = [f'{name}={getattr(arguments, name)}' for name in ('system', 'model') if getattr(arguments, name)]
    words = (*arguments.words, *chosen)
    data = recordings_of(arguments)
    start = Start(arguments.config, words, tuple(arguments.effects), data)
    folders = effect_folders_of(arguments.config, words)
    with open_session(arguments.session, start) as session, PageServer(arguments.port) as server:
        server.application = Application(session, folders, server.tabs.announce)
        first_start.announce_compilation(lambda line: say(server, line))
        try:
            serve(server, session, with_browser=not arguments.no_browser)
        finally:
            server.application.close()
            server.tabs.close()
            server.shutdown()
    return 0


def recordings_of(arguments: argparse.Namespace) -> DataRequest | None:
    """The recordings that were named, None without any. Raises UserError for those that are not there."""
    if not arguments.data:
        if arguments.hold_out or arguments.map or arguments.noise or arguments.namespace:
            raise UserError(
                '--hold-out, --map, --noise and --namespace are about recordings: name them too, as in '
                'sma-sim explore run1.csv run2.csv --hold-out run2'
            )
        return None
    for path in arguments.data:
        if not path.exists():
            raise UserError(f'cannot read {path}: No such file or directory')
    return data_request(arguments)


def serve(server: PageServer, session: Session, with_browser: bool) -> None:
    """Start to answer, say where, and wait; ends with KeyboardInterrupt."""
    assert server.application is not None
    serving = Thread(target=server.serve_forever, kwargs={'poll_interval': 0.1}, daemon=True)
    serving.start()
    Thread(target=server.application.first_run, daemon=True).start()  # compiled code is loaded while a browser starts
    print(f'The page is at {server.address}', flush=True)
    print(f'Every version is kept in {session.folder}. Ctrl-C ends the program.', file=sys.stderr, flush=True)
    if with_browser:
        webbrowser.open_new_tab(server.address)
    while serving.is_alive():
        serving.join(1.0)


def say(server: PageServer, line: str) -> None:
    """A line on the terminal and in the page."""
    print(line, file=sys.stderr, flush=True)
    server.tabs.announce('notice', {'words': line})
