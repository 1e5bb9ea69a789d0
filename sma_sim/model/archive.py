"""Results as files, without pickle: one compressed NPZ with the arrays, and JSON for all that holds them.

Records are written with the name of their class and their fields; on reading, only classes of this package are made, so that
a file runs no code. Effects and structures are written by name; those of your own are given again on reading.
"""

from __future__ import annotations

import json
import zipfile
from collections.abc import Iterable, Mapping
from dataclasses import fields, is_dataclass
from importlib import import_module
from pathlib import Path
from types import FunctionType
from typing import Any

import numpy as np

from sma_sim.model.argument_checks import checked
from sma_sim.model.effects.conversion import effect_on
from sma_sim.model.effects.discovery import declared_effect, package_effects, with_scopes
from sma_sim.model.effects.effect import Effect
from sma_sim.model.errors import UserError
from sma_sim.model.files import whole_file
from sma_sim.model.parameters import Parameter
from sma_sim.model.structures.discovery import declared_structure, package_structures, structure_of_size
from sma_sim.model.structures.structure import Structure

FORMAT, SUFFIX, PACKAGE = 'sma_sim result 1', '.npz', 'sma_sim.'
CONFIG = 'sma_sim.model.config:Config'  # which says itself what makes it again
CONTENT = 'content'  # the array that holds the JSON
MOVED = {  # modules that files name, and where their classes are now
    'sma_sim.evidence.estimation.limits': 'sma_sim.evidence.estimation.calibrate',
    'sma_sim.evidence.model_selection.pooled_refit': 'sma_sim.evidence.diagnosis.conclusion',
    'sma_sim.evidence.residual_analysis.findings': 'sma_sim.evidence.residual_analysis.summary',
    'sma_sim.evidence.residual_analysis.patterns': 'sma_sim.evidence.residual_analysis.summary',
}


@checked
def save(result: Any, path: str | Path) -> Path:
    """Write a result of this package to a file (.npz), whole or not at all. Raises UserError."""
    target = Path(path)
    if target.suffix != SUFFIX:
        raise UserError(f'{target}: expected a name that ends in {SUFFIX}')
    writer = Writer()
    content = {'format': FORMAT, 'result': writer.plain(result), 'objects': writer.objects}
    text = np.frombuffer(json.dumps(content).encode(), dtype=np.uint8)
    with whole_file(target) as temporary, temporary.open('wb') as file:
        np.savez_compressed(file, **(writer.arrays | {CONTENT: text}))
    return target


@checked
def load(path: str | Path, effects: Iterable[Effect] = (), structures: Iterable[Structure] = ()) -> Any:
    """A result from the file that its `save` wrote.

    Parameters
    ----------
    path : str or Path
        The file (.npz).
    effects : iterable of Effect
        Effects of your own that the result has: a file runs no code, and does not hold them. They must have the parameters
        of the saved ones, by name and unit; what their kernels do is not compared.
    structures : iterable of Structure
        Likewise, with the coordinates and parameters of the saved ones.

    Returns
    -------
    Trajectory, Recording, Dataset, Calibration, Comparison, Diagnosis, LatentInputs or Plan
        What was saved.

    Raises
    ------
    UserError
        For a file that cannot be read or is no result, and for effects or structures of your own that are not given, or are
        others of the same name.

    Examples
    --------
    >>> import sma_sim, tempfile
    >>> run = sma_sim.simulate(sma_sim.Model(), sma_sim.module_input([0.0, 5.0], [3.0, 0.0]), 10.0)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     sma_sim.load(run.save(f'{folder}/run.npz')) == run
    True
    """
    source = Path(path)
    try:
        with np.load(source, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        content = json.loads(arrays.pop(CONTENT).tobytes())
        if content['format'] != FORMAT:
            raise UserError(f'{source}: format {content["format"]!r}; expected {FORMAT!r}: it is of another version')
    except OSError as error:
        raise UserError(f'cannot read {source}: {error.strerror or error}') from error
    except (ValueError, KeyError, TypeError, AttributeError, EOFError, zipfile.BadZipFile) as error:
        if isinstance(error, UserError):
            raise
        raise UserError(f'{source} is no result of sma_sim: expected a file that `save` wrote') from error
    own = {one.name: declared_effect(one) for one in effects}
    of_user = {one.name: declared_structure(one) for one in structures}
    try:
        return Reader(source, arrays, content['objects'], own, of_user).value(content['result'])
    except (ArithmeticError, AttributeError, LookupError, StopIteration, TypeError, ValueError) as error:
        if isinstance(error, UserError):
            raise
        raise UserError(f'{source} is no result of sma_sim: expected a file as `save` wrote it, not edited') from error


def pickled(value: Any) -> tuple[Any, ...]:
    """How pickle takes a record apart, for other processes. Raises UserError where it has code of the user's own."""
    writer = Writer()
    plain = writer.plain(value)
    for record in writer.objects:
        for kind, known in (('effect', package_effects()), ('structure', package_structures())):
            if kind in record and record[kind] not in known and record.get('family') not in known:
                own = f'{kind} {record[kind]} is your own, and a pickle holds no code'
                raise UserError(f'{own}: make the configuration in the other process')
    return unpickled, (plain, writer.objects, writer.arrays)


def unpickled(plain: Any, objects: list[Any], arrays: Mapping[str, Any]) -> Any:
    """The record that `pickled` took apart."""
    return Reader(Path('a pickle'), arrays, objects, {}, {}).value(plain)


class Saved:
    """For results: `save` writes a file, `load` reads it."""

    def save(self, path: str | Path) -> Path:
        """Write it to a file that ends in .npz, whole or not at all; `load` reads it. Raises UserError."""
        return save(self, path)

    @classmethod
    def load(cls, path: str | Path, effects: Iterable[Effect] = (), structures: Iterable[Structure] = ()) -> Any:
        """What `save` wrote, as `sma_sim.load`. Raises UserError for another kind of result, too."""
        found = load(path, effects, structures)
        if not isinstance(found, cls):
            raise UserError(f'{path} holds a {type(found).__name__}; expected a {cls.__name__}')
        return found


class Writer:
    """Values as plain data; every record and array once, however often it is met."""

    def __init__(self) -> None:
        self.arrays: dict[str, Any] = {}
        self.objects: list[Any] = []
        self._known: dict[int, tuple[int, Any]] = {}  # with the value itself, whose id is not to be given again

    def plain(self, value: Any) -> Any:
        """A value in types of JSON. Raises UserError for one that no file can hold."""
        if value is None or isinstance(value, bool | int | float | str):
            return value.item() if isinstance(value, np.generic) else value
        if isinstance(value, np.generic):
            return value.item()
        if isinstance(value, np.ndarray) or is_dataclass(value):
            if id(value) not in self._known:
                at = len(self.objects)
                self.objects.append(None)
                self._known[id(value)] = (at, value)
                self.objects[at] = self._record(value)
            return {'object': self._known[id(value)][0]}
        if isinstance(value, Mapping):
            return {'map': [[self.plain(key), self.plain(one)] for key, one in value.items()]}
        if isinstance(value, tuple | list | set | frozenset):
            kind = next(name for name, one in COLLECTIONS.items() if isinstance(value, one))
            parts = [self.plain(one) for one in value]
            return {kind: parts} | ({'class': class_name(value)} if hasattr(value, '_fields') else {})
        if isinstance(value, Path):
            return {'path': str(value)}
        if isinstance(value, FunctionType) and resolved(class_name(value)) is value:
            return {'function': class_name(value)}
        raise UserError(f'a {type(value).__name__} cannot be saved: {value!r}')

    def _record(self, value: Any) -> Any:
        if isinstance(value, np.ndarray):
            name = f'array_{len(self.arrays)}'
            self.arrays[name] = value
            return {'array': name}
        if hasattr(value, 'from_saved'):
            return {'config': self.plain(value.saved())}
        if isinstance(value, Effect):
            shown: dict[str, Any] = {'scope': value.scope.name, 'parameters': value.parameters, 'title': value.title}
            return {'effect': value.plain_name, 'fields': self.plain(shown | {'structure': value.structure})}
        if isinstance(value, Structure):
            return {'structure': value.name, 'family': value.family, 'declared': declared_names(value)}
        return {'class': class_name(value), 'fields': {f.name: self.plain(getattr(value, f.name)) for f in fields(value)}}


def declared_names(structure: Structure) -> dict[str, str]:
    """The units of a structure's coordinates and parameters by name."""
    return {one.name: one.unit for one in structure.coordinates} | {n: p.unit for n, p in structure.declared.items()}


COLLECTIONS: Mapping[str, type] = {'tuple': tuple, 'list': list, 'frozenset': frozenset, 'set': set}


def class_name(value: Any) -> str:
    """Module and name of a class, of that of an object, or of a function."""
    kind = value if isinstance(value, type | FunctionType) else type(value)
    return f'{kind.__module__}:{kind.__qualname__}'


def resolved(name: str) -> Any:
    """What `class_name` names; None where this version does not have it, or where it is not of this package."""
    module, _, inner = str(name).partition(':')
    if not module.startswith(PACKAGE) or not inner.isidentifier():
        return None
    try:
        return getattr(import_module(MOVED.get(module, module)), inner, None)
    except ImportError:
        return None


class Reader:
    """Plain data as values again. Raises UserError for what this version does not have."""

    def __init__(
        self,
        path: Path,
        arrays: Mapping[str, Any],
        objects: list[Any],
        effects: Mapping[str, Effect],
        structures: Mapping[str, Structure],
    ) -> None:
        self._path, self._arrays, self._objects, self._made = path, arrays, objects, dict[int, Any]()
        self._effects, self._structures = package_effects() | dict(effects), package_structures() | dict(structures)

    def value(self, plain: Any) -> Any:
        """The value of plain data."""
        if not isinstance(plain, dict):
            return plain
        if 'object' in plain:
            at = plain['object']
            if at not in self._made:
                self._made[at] = self._record(self._objects[at])
            return self._made[at]
        if 'map' in plain:
            return {self.value(key): self.value(one) for key, one in plain['map']}
        if 'path' in plain:
            return Path(plain['path'])
        if 'function' in plain:
            return self._named(plain['function'], FunctionType)
        kind = next(name for name in COLLECTIONS if name in plain)
        parts = [self.value(one) for one in plain[kind]]
        return self._named(plain['class'], type)(*parts) if 'class' in plain else COLLECTIONS[kind](parts)

    def _named(self, name: str, kind: type) -> Any:
        found = resolved(name)
        if not isinstance(found, kind) or kind is type and not (is_dataclass(found) or hasattr(found, '_fields')):
            raise UserError(f'{self._path} has a {name.rpartition(":")[2]}, which this version of sma_sim does not have')
        return found

    def _record(self, plain: dict[str, Any]) -> Any:
        if 'array' in plain:
            return self._arrays[plain['array']]
        if 'config' in plain:
            return resolved(CONFIG).from_saved(self.value(plain['config']))
        if 'effect' in plain:
            return self._effect(plain['effect'], self.value(plain['fields']))
        if 'structure' in plain:
            return self._structure(plain['structure'], plain['family'], plain.get('declared'))
        kind = self._named(plain['class'], type)
        names, renamed = {field.name for field in fields(kind)}, getattr(kind, 'old_names', {})
        given = {renamed.get(name, name): one for name, one in plain['fields'].items()}
        if given.keys() - names:
            raise UserError(f'{self._path}: its {kind.__name__} has fields that this version of sma_sim does not have')
        values, later = {name: self.value(one) for name, one in given.items()}, [f.name for f in fields(kind) if not f.init]
        made = kind(**{name: one for name, one in values.items() if name not in later})  # with its checks
        for name in values.keys() & {*later}:
            object.__setattr__(made, name, values[name])
        return made

    def _effect(self, name: str, shown: dict[str, Any]) -> Effect:
        if name not in self._effects:
            raise UserError(f'{self._path} has an effect of your own, {name}: give load(..., effects=[...]) the effect')
        found = effect_on(self._effects[name], shown['structure'])
        if shown['scope']:
            found = with_scopes({name: found}, [f'{name}@{shown["scope"]}'])[f'{name}@{shown["scope"]}']
        parameters: tuple[Parameter, ...] = shown['parameters']
        of_file, given = [{one.name: one.unit for one in some} for some in (parameters, found.parameters)]
        if found.is_own and of_file != given:
            raise self._differs('effect', name, of_file, given)
        is_same = found.parameters == parameters and found.title == shown['title']
        return found if is_same else found.derived(parameters=parameters, title=shown['title'])

    def _differs(self, kind: str, name: str, of_file: Mapping[str, str], given: Mapping[str, str]) -> UserError:
        """An error for what the user gave and what has only its name in common with what was saved."""
        had, has = (', '.join(f'{one} [{unit}]' for one, unit in names.items()) or 'none' for names in (of_file, given))
        return UserError(f'{self._path} was saved with {kind} {name} of {had}; expected the same, got one of {has}')

    def _structure(self, name: str, family: str, of_file: Mapping[str, str] | None) -> Structure:
        base = self._structures.get(name) or self._structures.get(family)
        if base is None:
            raise UserError(f'{self._path} has a structure of your own, {name}: give load(..., structures=[...]) it')
        size = base.size_name
        low, high = base.declared[size].bounds if size else (0.0, -1.0)
        sizes = (structure_of_size(base, {size: float(k)}) for k in range(int(low), int(high) + 1))
        found = base if base.name == name else next(one for one in sizes if one.name == name)
        if of_file is not None and found.original not in package_structures() and of_file != declared_names(found):
            raise self._differs('structure', name, of_file, declared_names(found))
        return found
