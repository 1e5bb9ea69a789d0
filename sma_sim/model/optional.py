"""Packages that not every installation has: imported where they are used, and what to install where one is missing."""

from __future__ import annotations

from importlib import import_module
from types import ModuleType

from sma_sim.model.errors import UserError

PACKAGES = ('rosbags', 'mcap', 'plotly', 'pandas', 'xarray', 'gymnasium')  # modules that pip calls the same


def require(module: str, purpose: str) -> ModuleType:
    """The module, imported; `purpose` says for what, as in 'a bag'. Raises UserError where its package is missing."""
    try:
        return import_module(module)
    except ModuleNotFoundError as error:
        raise missing(error, purpose) from error


def missing(error: ModuleNotFoundError, purpose: str) -> Exception:
    """What to raise for a module that was not found: a UserError for one of the optional packages, else the error itself."""
    name = (error.name or '').partition('.')[0]
    if name not in PACKAGES:
        return error
    return UserError(f'{purpose} needs the Python package {name}, which is not installed: pip install {name}')
