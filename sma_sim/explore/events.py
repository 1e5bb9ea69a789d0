"""What happens during a job, a line of JSON each, for whoever looks on."""

from __future__ import annotations

import json
import time
from pathlib import Path
from threading import Lock
from typing import Any

from sma_sim.words.json_values import finite


class EventLog:
    """Appends events to a file; any thread may."""

    def __init__(self, path: Path) -> None:
        self._file, self._count, self._start = path.open('a', encoding='utf-8'), 0, time.monotonic()
        self._lock = Lock()

    def __enter__(self) -> EventLog:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def write(self, kind: str, **content: Any) -> None:
        """One event."""
        with self._lock:
            event = {'n': self._count, 't': round(time.monotonic() - self._start, 3), 'kind': kind, **finite(content)}
            self._file.write(json.dumps(event) + '\n')
            self._file.flush()
            self._count += 1

    def progress(self, words: str) -> None:
        """What is being done."""
        self.write('progress', words=words)

    def iteration(self, label: str, iteration: int, cost: float) -> None:
        """A step of a minimisation."""
        self.write('iteration', label=label, iteration=iteration, cost=cost)

    def model(self, role: str, effects: tuple[str, ...], kinetics: str, error: float) -> None:
        """A model that a diagnosis has fitted: a point of the figure in which the error falls."""
        self.write('model', role=role, effects=effects, model=kinetics, error=error)
