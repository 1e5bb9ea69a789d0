"""What the page can ask for of a robot that runs: listen to it beside the model, and record it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path

from sma_sim.explore.data_verbs import BAG, recorded_bags
from sma_sim.explore.jobs import new_folder
from sma_sim.explore.live import LiveFeed
from sma_sim.explore.request_values import Body, Reply, as_int, text
from sma_sim.explore.session import Session
from sma_sim.explore.session_files import RECORDINGS
from sma_sim.model.errors import UserError


class LiveVerbs:
    """The model of a session beside a robot; verbs may be called from several threads."""

    def __init__(self, session: Session) -> None:
        self._session, self._feed = session, LiveFeed()
        self._shown: Path | None = None  # the file of the version that runs beside the robot
        self.verbs: Mapping[str, Callable[[Body], Reply]] = {
            'live': self.live,
            'live_start': self.start,
            'live_stop': self.stop,
            'record': self.record,
        }

    def live(self, body: Body) -> Reply:
        """What was heard from sample number `since` on."""
        return self._heard(max(as_int(body.get('since', 0), 'since'), 0))

    def start(self, body: Body) -> Reply:
        """Listen, beside the model of the current version."""
        domain = body.get('domain')
        self._shown = self._session.file()
        self._feed.start(
            self._shown,
            text(body.get('namespace', ''), 'namespace'),
            None if domain is None else as_int(domain, 'domain'),
        )
        return self._heard()

    def stop(self, _: Body) -> Reply:
        """Listen no more."""
        self._feed.stop()
        return self._heard()

    def record(self, body: Body) -> Reply:
        """Begin (`on`) or end a bag in the session."""
        if not isinstance(on := body.get('on'), bool):
            raise UserError('on: expected true or false')
        if on:
            number = 1 + len(recorded_bags(self._session.folder))
            _, folder = new_folder(self._session.folder / RECORDINGS)
            self._feed.record(folder / f'{BAG}_{number}')
        else:
            self._feed.record(None)
        return self._heard()

    def follow(self) -> None:
        """Let the model beside the robot be the current version."""
        file = self._session.file()
        if file != self._shown and self._feed.listens:
            self._shown = file
            with suppress(UserError):  # it ends just now, which the page sees
                self._feed.use(file)

    def _heard(self, since: int = 0) -> Reply:
        """What was heard; the model as the number of its version."""
        found = self._feed.read(since)
        stem = Path(found['model']['path']).stem
        return found | {'model': found['model'] | {'version': int(stem) if stem else None}}

    def close(self) -> None:
        """End the listening process."""
        self._feed.stop()
