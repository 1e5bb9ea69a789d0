"""What a request of the page may say: numbers, windows of time, names, each checked before it is used."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from sma_sim.model.errors import UserError

PIXELS = (50, 8000)
Body = Mapping[str, Any]
Reply = bytes | dict[str, Any]


def window_in(body: Body) -> tuple[float, float] | None:
    """The stretch of time [s] that is looked at, None for all. Raises UserError."""
    window = body.get('window')
    if window is None:
        return None
    good = isinstance(window, list) and len(window) == 2 and all(is_number(end) for end in window)
    if not good or not window[0] < window[1]:
        raise UserError('window: expected two increasing times')
    return float(window[0]), float(window[1])


def pixels_in(body: Body) -> int:
    """The width of a panel, within what is sensible."""
    return min(max(as_int(body.get('pixels', 1000), 'pixels'), PIXELS[0]), PIXELS[1])


def as_int(value: Any, name: str) -> int:
    """A whole number. Raises UserError."""
    if isinstance(value, bool) or not isinstance(value, int):
        raise UserError(f'{name}: expected a whole number, got {value!r}')
    return value


def number(value: Any, name: str) -> float:
    """A finite number. Raises UserError."""
    if not is_number(value):
        raise UserError(f'{name}: expected a number, got {value!r}')
    return float(value)


def text(value: Any, name: str, longest: int = 200) -> str:
    """A text of limited length. Raises UserError."""
    if not isinstance(value, str) or len(value) > longest:
        raise UserError(f'{name}: expected a text of at most {longest} characters')
    return value


def is_number(value: Any) -> bool:
    """Whether a value is a finite number."""
    return not isinstance(value, bool) and isinstance(value, int | float) and math.isfinite(value)


def json_number(value: Any) -> Any:
    """A value for JSON, which knows no NaN."""
    return None if isinstance(value, float) and not math.isfinite(value) else value
