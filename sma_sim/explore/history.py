"""The versions of a model in a session: a tree of changes, and the place in it. Nothing here touches files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from typing import Any

from sma_sim.model.errors import UserError

FORMAT = 1  # of the file


@dataclass(frozen=True)
class Version:
    """One version: its `number` (from 1), the one that it was made from (`parent`), its `name` (empty unless the user gave
    one), what was done in `words`, when (`time`, ISO 8601, UTC), and the job whose model it is (`step`), if it is one's.
    """

    number: int
    parent: int | None
    name: str
    words: str
    time: str
    step: int | None = None


@dataclass(frozen=True)
class History:
    """All versions, which is `current`, and `forward`: by version, the one that redo leads to.

    Nothing is ever removed: a change after undo begins a branch, and what was undone can still be gone back to.
    `revision` rises with every step.
    """

    versions: tuple[Version, ...] = ()
    current: int = 0
    forward: Mapping[int, int] = field(default_factory=dict)
    revision: int = 0

    def __getitem__(self, number: int) -> Version:
        for version in self.versions:
            if version.number == number:
                return version
        raise UserError(f'there is no version {number}: expected {self.versions[0].number} to {self.versions[-1].number}')

    def added(self, version: Version) -> History:
        """With one version more, which becomes the current one."""
        return replace(self, versions=(*self.versions, version)).at(version.number)

    def at(self, number: int) -> History:
        """With another current version; redo leads back along the way by which it was made."""
        forward, one = dict(self.forward), self[number]
        while one.parent is not None:
            forward[one.parent] = one.number
            one = self[one.parent]
        return replace(self, current=number, forward=forward, revision=self.revision + 1)

    def undone(self) -> History:
        """At the version before. Raises UserError at the first."""
        parent = self[self.current].parent
        if parent is None:
            raise UserError('there is nothing to undo: this is the first version')
        return replace(self, current=parent, forward={**self.forward, parent: self.current}, revision=self.revision + 1)

    def redone(self) -> History:
        """At the version that was left by undo. Raises UserError where there is none."""
        if self.current not in self.forward:
            raise UserError('there is nothing to redo: this version was not left by undo')
        return replace(self, current=self.forward[self.current], revision=self.revision + 1)

    def renamed(self, number: int, name: str) -> History:
        """With another name of a version."""
        renamed = replace(self[number], name=name)
        versions = tuple(renamed if version.number == number else version for version in self.versions)
        return replace(self, versions=versions, revision=self.revision + 1)

    def as_data(self) -> dict[str, Any]:
        """The history as JSON can hold it."""
        return {
            'format': FORMAT,
            'current': self.current,
            'revision': self.revision,
            'forward': {str(before): after for before, after in self.forward.items()},
            'versions': [asdict(version) for version in self.versions],
        }


def history_from(content: Any) -> History:
    """The history that `as_data` made. Raises ValueError, which says what is wrong."""
    if not isinstance(content, dict) or content.get('format') != FORMAT:
        raise ValueError(f'expected a history of format {FORMAT}')
    kinds = {'number': int, 'parent': int | None, 'name': str, 'words': str, 'time': str, 'step': int | None}
    entries = content.get('versions')
    if not isinstance(entries, list) or not entries:
        raise ValueError('expected a list of versions')
    for entry in entries:
        if not isinstance(entry, dict) or not all(isinstance(entry.get(f.name), kinds[f.name]) for f in fields(Version)):
            raise ValueError(f'{entry!r} is no version: expected {", ".join(kinds)}')
    versions = tuple(Version(**{name: entry[name] for name in kinds}) for entry in entries)
    numbers, forward = [version.number for version in versions], content.get('forward')
    if len(set(numbers)) < len(numbers) or any(v.parent is not None and v.parent >= v.number for v in versions):
        raise ValueError('numbers of versions are there twice, or one comes before what it was made from')
    if not isinstance(forward, dict) or not all(str(a).isdecimal() and b in numbers for a, b in forward.items()):
        raise ValueError('forward: expected numbers of versions by number')
    if content.get('current') not in numbers or not {v.parent for v in versions} <= {None, *numbers}:
        raise ValueError('the current version, or one that another was made from, is not there')
    if not isinstance(content.get('revision'), int):
        raise ValueError('revision: expected a number')
    return History(versions, content['current'], {int(a): b for a, b in forward.items()}, content['revision'])
