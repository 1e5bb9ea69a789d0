"""The structures of the package by name: ``sma_sim.Config(system=sma_sim.structures.slider)``."""

from __future__ import annotations

from sma_sim.model.nearest import UnknownNameError, suggestion
from sma_sim.model.structures.discovery import package_structures
from sma_sim.model.structures.structure import Structure


def __getattr__(name: str) -> Structure:
    """The structure of this name."""
    found = package_structures()
    if name in found:
        return found[name]
    raise UnknownNameError(f'sma_sim.structures has no {name}{suggestion(name, found)}; it has {", ".join(sorted(found))}')


def __dir__() -> list[str]:
    """The names of all structures."""
    return sorted(package_structures())
