"""Finds structures: those of the package, files in folders of the user's own, entry points of other packages."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import cache, lru_cache
from pathlib import Path

import sma_sim.model.structures as package
from sma_sim.model.argument_checks import as_folders, checked
from sma_sim.model.errors import UserError
from sma_sim.model.likely_unit import si_unit
from sma_sim.model.plugins import package_plugins, user_plugins
from sma_sim.model.structures.checks import fault_of
from sma_sim.model.structures.structure import Structure

ENTRY_POINTS = 'sma_sim.structures'
KNOWN: dict[str, Structure] = {}  # of the user's folders, and of other sizes, that were named in this process


class StructureError(UserError):
    """A structure file that cannot be used; the message names the file and what is wrong."""


@cache
def package_structures() -> dict[str, Structure]:
    """The structures of the package and of installed packages that declare an entry point, by name."""
    declared = package_plugins(package, 'STRUCTURE', ENTRY_POINTS)
    return {member.name: member for structure in declared for member in structure.family_members}


def declared_structure(structure: Structure) -> Structure:
    """A structure that is given as an object: one of the package, or one of your own, known by its name from now on.

    Raises StructureError where the declaration has a fault, or another structure of the package has its name.
    """
    name = structure.name
    if name in package_structures():
        if package_structures()[name] != structure:
            raise StructureError(f'a structure named {name!r} exists already; choose another name')
        return package_structures()[name]
    if fault := fault_of(structure):
        raise StructureError(fault)
    check_channels(structure, package_structures().values(), None)
    KNOWN.update({member.name: member for member in structure.family_members})
    return structure


@checked
def find_structures(folders: str | Path | Iterable[str | Path] = ()) -> dict[str, Structure]:
    """All structures by name: those of the package and those in the given folders.

    Parameters
    ----------
    folders : str or Path, or several
        Folders of structure files of your own. Importing them runs them.

    Returns
    -------
    dict
        A `Structure` by name.

    Raises
    ------
    StructureError
        For a folder that does not exist, a file that cannot be imported, a declaration with a fault, or a name that exists
        already.

    Examples
    --------
    >>> import sma_sim
    >>> sma_sim.find_structures()['module'].coordinate_names
    ('U_x', 'U_y', 'alpha')
    """
    found = dict(package_structures())
    for folder in as_folders('structures.paths', folders):
        for file, structure in user_plugins(folder, 'structures.paths', Structure, StructureError):
            for member in structure.family_members:
                if member.name in found:
                    raise StructureError(f'{file}: a structure named {member.name!r} exists already; choose another name')
                if fault := fault_of(member):
                    raise StructureError(f'{file}: {fault}')
                check_channels(member, found.values(), file)
                found[member.name] = KNOWN[member.name] = member
    return found


def structure_of_size(structure: Structure, values: Mapping[str, float]) -> Structure:
    """A structure in the size that the values by full name say. Raises StructureError."""
    if structure.of_size is None:
        return structure
    declared = structure.declared[structure.size_name]
    size = float(values.get(structure.size_name, declared.default))
    if size == declared.default:
        return structure
    low, high = declared.bounds
    if not low <= size <= high or size != int(size):
        raise StructureError(f'{structure.size_name} = {size:g}: expected a whole number from {low:g} to {high:g}')
    return resized(structure, int(size))


@lru_cache(256)
def resized(structure: Structure, size: int) -> Structure:
    """A structure in another size, known by its name from now on."""
    assert structure.of_size is not None
    other = replace(structure.of_size(size), files=structure.files)
    KNOWN.update({member.name: member for member in other.family_members})
    return other


def check_channels(structure: Structure, others: Iterable[Structure], file: Path | None) -> None:
    """Raise StructureError where a channel has the name of another structure's in another unit: files could not tell.

    Nor may a coordinate be in a unit that is not SI.
    """
    where = f'structure {structure.name!r}' if file is None else file
    for other in others:
        columns = dict(zip(other.channels, other.channel_columns, strict=True))
        for channel, column in zip(structure.channels, structure.channel_columns, strict=True):
            if columns.get(channel, column) != column:
                raise StructureError(
                    f'{where}: the coordinate {channel} would be the column {column}, which is {columns[channel]} of the '
                    f'structure {other.name}; choose another name'
                )
    for coordinate in structure.coordinates:
        if si_unit(coordinate.unit) != coordinate.unit:  # times a generalised force it gives no energy [J]
            raise StructureError(
                f'structure {structure.name!r}: coordinate {coordinate.name}: unit {coordinate.unit!r}; '
                'expected an SI unit, such as m or rad'
            )


def known_structures() -> dict[str, Structure]:
    """The structures of the package, and those of folders and of other sizes that were named in this process, by name."""
    return package_structures() | KNOWN
