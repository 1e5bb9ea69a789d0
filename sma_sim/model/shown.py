"""What a result shows of itself: one line where it is printed, a table in a notebook."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from html import escape

MAX_LIST = 8  # names in one line


class Shown:
    """For results: their `facts` are their repr, and their table in a notebook."""

    def facts(self) -> Mapping[str, str]:
        """What is to be known at a glance, by its name; values with their units."""
        raise NotImplementedError

    def __repr__(self) -> str:
        return f'<{type(self).__name__}: {"; ".join(f"{name} {words}" for name, words in self.facts().items())}>'

    def summary(self) -> str:
        """What is to be known, a line each, as text."""
        return '\n'.join(f'{name}: {words}' for name, words in self.facts().items())

    def _repr_html_(self) -> str:
        rows = (
            f'<tr><th style="text-align:left">{escape(k)}</th><td>{escape(v)}</td></tr>' for k, v in self.facts().items()
        )
        return f'<table><caption>{escape(type(self).__name__)}</caption>{"".join(rows)}</table>'


def listed(names: Iterable[str], most: int = MAX_LIST) -> str:
    """Names in words, of very many the first."""
    given = list(names)
    more = f' and {len(given) - most} more' if len(given) > most else ''
    return (', '.join(given[:most]) or 'none') + more


def counted(count: int, noun: str) -> str:
    """``1 row``, ``2 rows``."""
    return f'{count} {noun}{"s" * (count != 1)}'


def joined_words(words: Sequence[str], link: str = 'and') -> str:
    """`a, b and c`."""
    *first, last = words or ['']
    return f'{", ".join(first)} {link} {last}' if first else last


def text_table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table as text: the first column to the left, the others to the right."""
    lines = [header, *rows]
    widths = [max(len(line[k]) for line in lines) for k in range(len(header))]
    shown = ([line[0].ljust(widths[0]), *(c.rjust(w) for c, w in zip(line[1:], widths[1:], strict=True))] for line in lines)
    return '\n'.join('  '.join(cells).rstrip() for cells in shown)
