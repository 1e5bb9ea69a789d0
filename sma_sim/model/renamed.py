"""Names of arguments and attributes that have been replaced: they go on working, with a warning."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import fields
from functools import wraps
from inspect import signature
from typing import Any, TypeVar

from sma_sim.model.argument_checks import check_keywords
from sma_sim.model.errors import UserError

Class = TypeVar('Class', bound=type)


def renamed(**names: str) -> Callable[[Class], Class]:
    """A decorator of a class whose arguments and attributes `old=new` have other names now, and unknown ones are said.

    In ``dataclasses.replace(options, model='mas')`` the old argument overrides the new one, which is among all others there.
    """

    def decorated(kind: Class) -> Class:
        known = signature(kind).parameters
        init = getattr(kind, '__init__')  # noqa: B009 - mypy takes an instance's for unsound

        @wraps(init)
        def with_old_names(self: Any, *given: Any, **named: Any) -> None:
            for old in names.keys() & named.keys():
                warn_of(kind, old, names[old])
                value, new = named.pop(old), names[old]
                is_replaced = all(field.name in named for field in fields(kind) if field.init)
                if new in named and named[new] != value and not is_replaced:
                    raise UserError(f'{kind.__name__}: {old} = {value!r}, but {new} = {named[new]!r}: leave {old} out')
                named[new] = value
            check_keywords(kind.__name__, known, named)
            init(self, *given, **named)

        setattr(kind, '__init__', with_old_names)  # noqa: B010
        setattr(kind, 'old_names', names)  # noqa: B010 - files of older versions have them
        for old, new in names.items():
            if old not in vars(kind):
                setattr(kind, old, old_attribute(kind, old, new))
        return kind

    return decorated


def old_attribute(kind: type, old: str, new: str) -> property:
    """An attribute that has another name now."""

    def value(self: Any) -> Any:
        warn_of(kind, old, new)
        return getattr(self, new)

    return property(value, doc=f'Old name of `{new}`.')


def itself(old: str) -> property:
    """The old spelling of an object that was wrapped once, as an attribute of it."""

    def value(self: Any) -> Any:
        warnings.warn(f'.{old} is the object itself now: leave it out', DeprecationWarning, stacklevel=2)
        return self

    return property(value, doc='Old spelling of the object itself.')


def warn_of(kind: type, old: str, new: str) -> None:
    """Warn, at the line that used the old name."""
    warnings.warn(f'{kind.__name__}: {old} is called {new} now', DeprecationWarning, stacklevel=3)
