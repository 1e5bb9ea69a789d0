"""What may have been meant by a name that is not known."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

from sma_sim.model.errors import UserError


class UnknownNameError(UserError, AttributeError, KeyError):
    """An attribute or a key that there is not, with those that may have been meant."""

    def __str__(self) -> str:
        return str(self.args[0])


def suggestion(name: object, known: Iterable[str]) -> str:
    """The end of a message: the nearest known names, or nothing where none is near."""
    close = nearest(str(name), list(known))
    return f'; did you mean {" or ".join(close)}?' if close else ''


def nearest(name: str, known: list[str]) -> list[str]:
    """Up to three known names: those that differ in their case only, else the most similar."""
    same = [one for one in known if one.lower() == name.lower()]
    return same or difflib.get_close_matches(name, known, n=3, cutoff=0.4)
