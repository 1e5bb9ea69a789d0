"""Which recordings are meant, and how they are to be read: what the commands and a session of `explore` share."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from hashlib import sha256
from pathlib import Path
from typing import Any

from sma_sim.evidence.data.recording import Dataset
from sma_sim.evidence.data.recordings import read_dataset
from sma_sim.evidence.data.rosbag.commands import limits_in
from sma_sim.evidence.data.sources import META_FILE
from sma_sim.evidence.data.train_test_split import held_out_files, split_dataset
from sma_sim.model.config import Config
from sma_sim.model.errors import UserError

TEXTS, LISTS = ('map', 'namespace'), ('data', 'hold_out')


@dataclass(frozen=True)
class DataRequest:
    """Recordings as a command line names them.

    Attributes
    ----------
    data : tuple of Path
        CSV files, bags, or folders of them.
    hold_out : tuple of str
        Recordings that are not fitted: a file, a folder, or the name of one in `data`.
    map : Path, optional
        YAML file that maps foreign columns and units.
    noise : mapping
        Standard deviation of the noise by channel, SI units.
    namespace : str, optional
        The module's namespace, in bags of several.
    """

    data: tuple[Path, ...]
    hold_out: tuple[str, ...] = ()
    map: Path | None = None
    noise: Mapping[str, float] = field(default_factory=dict)
    namespace: str | None = None

    def read(self, config: Config) -> Dataset:
        """All recordings of the system of a configuration, with its ambient temperature and limits. Raises UserError."""
        known = {path.resolve() for path in self.data}
        inside = {file.resolve() for path in self.data if path.is_dir() for file in path.iterdir()}
        further = [file for file in held_out_files(self.hold_out) if file.resolve() not in known | inside]
        return read_dataset(
            [*self.data, *further],
            config.structure.name,
            config.parameters['environment.T_E'],
            self.map,
            self.noise,
            self.namespace,
            limits_in(config.parameters),
        )

    def split(self, dataset: Dataset) -> tuple[Dataset, Dataset | None]:
        """The recordings to fit, and those held out. Raises UserError."""
        return split_dataset(dataset, self.hold_out)

    def absolute(self) -> DataRequest:
        """The same from any working directory; what is held out by the name of a recording stays a name."""
        words = [os.path.abspath(word) if Path(word).exists() else word for word in self.hold_out]
        mapping = None if self.map is None else Path(os.path.abspath(self.map))
        return replace(
            self, data=tuple(Path(os.path.abspath(path)) for path in self.data), hold_out=tuple(words), map=mapping
        )

    def options(self) -> list[str]:
        """The words of a command line that stand for this request."""
        words = list(map(str, self.data))
        words += ['--hold-out', *self.hold_out] if self.hold_out else []
        words += ['--map', str(self.map)] if self.map else []
        words += [word for name, value in self.noise.items() for word in ('--noise', f'{name}={value!r}')]
        return words + (['--namespace', self.namespace] if self.namespace else [])

    def as_data(self) -> dict[str, Any]:
        """The request as YAML and JSON can hold it."""
        return {
            'data': list(map(str, self.data)),
            'hold_out': list(self.hold_out),
            'map': str(self.map) if self.map else None,
            'noise': dict(self.noise),
            'namespace': self.namespace,
        }


def fingerprint(request: DataRequest) -> str:
    """What tells whether recordings have changed: a hash of the request, and of names, sizes and times of its files."""
    named = [*request.data, *(Path(word) for word in request.hold_out), *([request.map] if request.map else [])]
    files: set[Path] = set()
    for path in named:
        files |= {file for file in path.rglob('*') if file.is_file()} if path.is_dir() else {path, path.parent / META_FILE}
    stamps = [(str(file), file.stat().st_size, file.stat().st_mtime_ns) for file in sorted(files) if file.is_file()]
    return sha256(repr((request.as_data(), stamps)).encode()).hexdigest()


def data_request_from(content: Any, where: str) -> DataRequest | None:
    """The request that `as_data` wrote, None for a session without data. Raises UserError, which names `where`."""
    if content is None:
        return None
    if not isinstance(content, Mapping) or not set(content) <= {*TEXTS, *LISTS, 'noise'}:
        raise UserError(f'{where}: expected a mapping with data, hold_out, map, noise and namespace, got {content!r}')
    texts = {name: content.get(name) for name in TEXTS}
    lists = {name: content.get(name) or [] for name in LISTS}
    noise = content.get('noise') or {}
    wrong = [name for name, value in texts.items() if value is not None and not isinstance(value, str)]
    wrong += [name for name, value in lists.items() if not is_texts(value)]
    wrong += [] if isinstance(noise, Mapping) and all(isinstance(std, int | float) for std in noise.values()) else ['noise']
    wrong += ['data'] if not lists['data'] else []
    if wrong:
        raise UserError(f'{where}: {wrong[0]} = {content.get(wrong[0])!r}: expected {expected(wrong[0])}')
    return DataRequest(
        tuple(map(Path, lists['data'])),
        tuple(lists['hold_out']),
        Path(texts['map']) if texts['map'] else None,
        {str(name): float(std) for name, std in noise.items()},
        texts['namespace'],
    )


def is_texts(value: Any) -> bool:
    """Whether a value is a list of texts."""
    return isinstance(value, Sequence) and not isinstance(value, str) and all(isinstance(word, str) for word in value)


def expected(name: str) -> str:
    """What an entry may be, in words."""
    if name == 'noise':
        return 'standard deviations by channel'
    return 'a text or nothing' if name in TEXTS else 'a list of files' if name == 'data' else 'a list of texts'
