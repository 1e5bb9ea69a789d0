"""Finds structures: those of the package, files in folders of the user's own, entry points of other packages."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from pathlib import Path

import sma_sim.model.structures as package
from sma_sim.model.argument_checks import as_folders, checked
from sma_sim.model.errors import UserError
from sma_sim.model.plugins import OWN, package_plugins, user_plugins
from sma_sim.model.structures.checks import fault_of
from sma_sim.model.structures.structure import Structure

ENTRY_POINTS = 'sma_sim.structures'
NOT_SI = ('mm', 'cm', 'um', 'deg', 'mrad')  # of coordinates: times a generalised force they give no energy [J]
KNOWN: dict[str, FoundStructure] = {}  # of the user's folders, and of other sizes, that were named in this process


class StructureError(UserError):
    """A structure file that cannot be used; the message names the file and what is wrong."""


@dataclass(frozen=True, repr=False)
class FoundStructure:
    """A structure and the files that its kernels depend on."""

    structure: Structure
    files: tuple[Path, ...]
    packages: tuple[str, ...]  # prefixes of the modules whose functions are compiled with the kernels

    def __hash__(self) -> int:
        """Of what tells structures apart nearly always: it is asked for with every model."""
        return hash((self.structure.name, self.files))

    def __repr__(self) -> str:
        return f'FoundStructure({self.structure.name})'


@cache
def package_structures() -> dict[str, FoundStructure]:
    """The structures of the package and of installed packages that declare an entry point, by name."""
    plugins = package_plugins(package, 'STRUCTURE', ENTRY_POINTS)
    return {
        structure.name: FoundStructure(structure, plugin.files, plugin.packages)
        for plugin in plugins
        for structure in plugin.value.family_members
    }


def found_structure(structure: Structure) -> FoundStructure:
    """A structure that is given as an object: one of the package, or one of your own, known by its name from now on.

    Raises StructureError where the declaration has a fault, or another structure of the package has its name.
    """
    name = structure.name
    if name in package_structures():
        if package_structures()[name].structure is not structure:
            raise StructureError(f'a structure named {name!r} exists already; choose another name')
        return package_structures()[name]
    if fault := fault_of(structure):
        raise StructureError(fault)
    check_channels(structure, package_structures().values(), None)
    kernels = (structure.lengths, structure.forces, structure.inertia, structure.gradients, structure.stiffness)
    further = (structure.strain, structure.gravity, structure.accelerations, structure.constants)
    modules = {kernel.__module__.partition('.')[0] for kernel in (*kernels, *further) if kernel is not None}
    for variant in structure.family_members:
        KNOWN[variant.name] = FoundStructure(variant, (), (*OWN, *sorted(modules)))
    return KNOWN[name]


@checked
def find_structures(folders: str | Path | Iterable[str | Path] = ()) -> dict[str, FoundStructure]:
    """All structures by name: those of the package and those in the given folders.

    Parameters
    ----------
    folders : str or Path, or several
        Folders of structure files of your own. Importing them runs them.

    Returns
    -------
    dict
        A `FoundStructure` (the `Structure` and its files) by name.

    Raises
    ------
    StructureError
        For a folder that does not exist, a file that cannot be imported, a declaration with a fault, or a name that exists
        already.

    Examples
    --------
    >>> import sma_sim
    >>> sma_sim.find_structures()['module'].structure.coordinate_names
    ('U_x', 'U_y', 'alpha')
    """
    found = dict(package_structures())
    for folder in as_folders('structures.paths', folders):
        for plugin in user_plugins(folder, 'structures.paths', Structure, StructureError):
            for variant in plugin.value.family_members:
                if variant.name in found:
                    raise StructureError(
                        f'{plugin.file}: a structure named {variant.name!r} exists already; choose another name'
                    )
                if fault := fault_of(variant):
                    raise StructureError(f'{plugin.file}: {fault}')
                check_channels(variant, found.values(), plugin.file)
                found[variant.name] = KNOWN[variant.name] = FoundStructure(variant, plugin.files, plugin.packages)
    return found


def structure_of_size(found: FoundStructure, values: Mapping[str, float]) -> FoundStructure:
    """A structure in the size that the values by full name say. Raises StructureError."""
    structure = found.structure
    if structure.of_size is None:
        return found
    declared = structure.declared[structure.size_name]
    size = float(values.get(structure.size_name, declared.default))
    if size == declared.default:
        return found
    low, high = declared.bounds
    if not low <= size <= high or size != int(size):
        raise StructureError(f'{structure.size_name} = {size:g}: expected a whole number from {low:g} to {high:g}')
    return resized(found, int(size))


@lru_cache(256)
def resized(found: FoundStructure, size: int) -> FoundStructure:
    """A structure in another size, known by its name from now on."""
    assert found.structure.of_size is not None
    other = replace(found, structure=found.structure.of_size(size))
    for variant in other.structure.family_members:
        KNOWN[variant.name] = replace(found, structure=variant)
    return other


def check_channels(structure: Structure, others: Iterable[FoundStructure], file: Path | None) -> None:
    """Raise StructureError where a channel has the name of another structure's in another unit: files could not tell.

    Nor may a coordinate be in a unit that is not SI.
    """
    for other in others:
        columns = dict(zip(other.structure.channels, other.structure.channel_columns, strict=True))
        for channel, column in zip(structure.channels, structure.channel_columns, strict=True):
            if columns.get(channel, column) != column:
                raise StructureError(
                    f'{file}: the coordinate {channel} would be the column {column}, which is {columns[channel]} of the '
                    f'structure {other.structure.name}; choose another name'
                )
    for coordinate in structure.coordinates:
        if coordinate.unit in NOT_SI:
            raise StructureError(
                f'structure {structure.name!r}: coordinate {coordinate.name}: unit {coordinate.unit!r}; '
                'expected an SI unit, such as m or rad'
            )


def known_structures() -> dict[str, Structure]:
    """The structures of the package, and those of folders and of other sizes that were named in this process, by name."""
    return {name: found.structure for name, found in found_structures().items()}


def found_structures() -> dict[str, FoundStructure]:
    """The same with their files."""
    return package_structures() | KNOWN
