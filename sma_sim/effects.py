"""The effects of the package by name: ``sma_sim.effects.gravity(g_y=-9.81)`` is one with a value, for `Config`."""

from __future__ import annotations

from sma_sim.model.effects.discovery import package_effects
from sma_sim.model.effects.effect import Effect
from sma_sim.model.nearest import UnknownNameError, suggestion


def __getattr__(name: str) -> Effect:
    """The effect of this name."""
    found = package_effects()
    if name in found:
        return found[name]
    raise UnknownNameError(f'sma_sim.effects has no {name}{suggestion(name, found)}; it has {", ".join(sorted(found))}')


def __dir__() -> list[str]:
    """The names of all effects."""
    return sorted(package_effects())
