"""Whether an argument is what a function takes: the message says what was given, and what makes the right one."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence, Sized
from concurrent.futures import Executor
from dataclasses import fields
from functools import lru_cache, wraps
from inspect import signature
from numbers import Integral
from pathlib import Path
from types import FunctionType, NoneType, UnionType
from typing import Any, TypeVar, Union, cast, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

from sma_sim.model.errors import UserError
from sma_sim.model.frozen import frozen, own_array
from sma_sim.model.likely_unit import kelvin_hint
from sma_sim.model.nearest import suggestion
from sma_sim.model.parameters import KELVIN, is_number

MAKERS = {  # of the arguments of public functions, by their class
    'Config': 'sma_sim.Config(...) or read_config(...)',
    'Model': 'sma_sim.Model(config)',
    'Input': 'sma_sim.module_input(...) or wire_input(...)',
    'Recording': 'sma_sim.Recording(...)',
    'Dataset': 'sma_sim.read_dataset(...) or Dataset(...)',
}
WORDS: Mapping[Any, str] = {
    float: 'a number',
    int: 'a whole number',
    bool: 'True or False',
    str: 'a text',
    Path: 'a path',
    os.PathLike: 'a path',
    Executor: 'an executor such as ThreadPoolExecutor()',
}
LIKE: Mapping[Any, Any] = {Path: (str, os.PathLike), bool: (bool, np.bool_)}  # what is taken in place of a type


class UnknownArgumentError(UserError, TypeError):
    """A keyword that a function does not take, with those that may have been meant."""


Function = TypeVar('Function', bound=Callable[..., Any])
MAX_DIFFERENCE = 100.0  # [K]: of ambient temperatures; what differs by more is a temperature
MAX_SHOWN = 60  # characters of a value in a message
DATES = {  # kinds of NumPy's types, and what makes seconds of them
    'M': "for seconds write (t - t[0]) / numpy.timedelta64(1, 's')",
    'm': "for seconds write t / numpy.timedelta64(1, 's')",
}


def checked(function: Function) -> Function:
    """The function, whose arguments are checked against its annotations before it runs. It raises UserError."""
    parameters = signature(function)

    @wraps(function)
    def with_checks(*given: Any, **named: Any) -> Any:
        try:
            bound = parameters.bind(*given, **named)
        except TypeError:
            check_keywords(function.__name__, parameters.parameters, named)
            return function(*given, **named)  # says which argument is missing
        hints = hints_of(function)
        for name, value in bound.arguments.items():
            if isinstance(value, Iterator):  # what a check has read would be missing afterwards
                bound.arguments[name] = value = tuple(value)
            if name in hints:
                expect(name, value, hints[name])
        return function(*bound.args, **bound.kwargs)

    return cast(Function, with_checks)


def check_keywords(called: str, known: Collection[str], given: Iterable[str]) -> None:
    """Raise UnknownArgumentError for an argument that what is `called` so does not take."""
    for name in given:
        if name not in known:
            words = ', '.join(one for one in known if one != 'self')
            raise UnknownArgumentError(f'{called}: no argument {name!r}{suggestion(name, known)}; it takes {words}')


def check_fields(record: Any, of: str = '') -> None:
    """Raise UserError for a field of a dataclass that is not as annotated, and keep each as it is now (`frozen`).

    `of`: what messages begin with, before the name of the field.
    """
    kind: Any = type(record)
    hints = hints_of(kind)
    for field in fields(record):
        given = getattr(record, field.name)
        value = frozen(given)
        expect(f'{of}{field.name}', value if isinstance(given, Iterator) else given, hints[field.name])
        object.__setattr__(record, field.name, value)
        if isinstance(value, FunctionType) and value.__module__ is None:  # made by exec: what compiles it asks for a name
            value.__module__ = '__main__'


@lru_cache
def hints_of(annotated: Any) -> dict[str, Any]:
    """The types of arguments or fields by name."""
    return get_type_hints(annotated)


def expect(name: str, value: object, hint: Any) -> None:
    """Raise UserError for a value that is not of an annotated type."""
    if not is_like(value, hint):
        classes = [one for one in alternatives(hint) if one is not NoneType]
        maker = MAKERS.get(getattr(classes[0], '__name__', ''), '')
        words = ' or '.join(dict.fromkeys(map(words_of, classes)))
        raise UserError(f'{name}: expected {words}{maker and f", from {maker}"}; got {shown_misfit(value, classes)}')


def shown_misfit(value: object, classes: Sequence[Any]) -> str:
    """A value in a message; of several too long to be shown, the first that is not of what some of `classes` hold."""
    inner = [one for kind in classes if get_origin(kind) is not None for one in get_args(kind)[:1]]
    if isinstance(value, tuple | list) and len(repr(value)) > MAX_SHOWN and inner:
        return next((f'{shown(one)} among them' for one in value if not any(is_like(one, kind) for kind in inner)), 'others')
    return shown(value)


def shown(value: object) -> str:
    """A value in a message: as it is written, where that is short; else its type."""
    text = repr(value)
    plain = value is None or isinstance(value, str | Path | bool | int | float | tuple | list | dict)
    return text if plain and len(text) <= MAX_SHOWN else type(value).__name__


def alternatives(hint: Any) -> tuple[Any, ...]:
    """The types of a union; one that is none stands alone."""
    return get_args(hint) if get_origin(hint) in (Union, UnionType) else (hint,)


@lru_cache
def parts_of(hint: Any) -> tuple[Any, tuple[Any, ...]]:
    """What an annotated type is made of: its origin, None for a plain class, and its arguments."""
    return get_origin(hint), get_args(hint)


def is_like(value: Any, hint: Any) -> bool:
    """Whether a value is of an annotated type, as far as that can be told without reading arrays or iterators."""
    if hint is float:
        return is_number(value)
    if hint is Any:
        return True
    origin, inner = parts_of(hint)
    if origin in (Union, UnionType):
        return any(is_like(value, one) for one in inner)
    if origin is tuple and inner[-1:] != (Ellipsis,):
        return isinstance(value, tuple | list) and len(value) == len(inner) and all(map(is_like, value, inner))
    if origin is Callable or hint is Callable:
        return callable(value)
    if isinstance(origin, type) and issubclass(origin, Mapping):
        return isinstance(value, Mapping) and all(is_like(k, inner[0]) and is_like(v, inner[1]) for k, v in value.items())
    if origin is np.ndarray:
        return value is not None  # `as_array` says what is no number
    if isinstance(origin, type) and issubclass(origin, Iterable):
        return is_like_several(value, inner[0] if inner else Any)
    if hint is int:
        return isinstance(value, Integral) and not isinstance(value, bool)
    if hint is Executor:
        return hasattr(value, 'submit')
    kind = LIKE.get(hint, origin or hint)
    return not isinstance(kind, type | tuple) or getattr(kind, '_is_protocol', False) or isinstance(value, kind)


def is_like_several(value: Any, hint: Any) -> bool:
    """Whether a value is several of a type; numbers are read, and complained of, where arrays are made of them."""
    if isinstance(value, str | bytes | Mapping) or not isinstance(value, Iterable):  # of a mapping, values would be lost
        return False
    numbers = hint is float or isinstance(value, np.ndarray) or not isinstance(value, Sized)
    return numbers or all(is_like(one, hint) for one in value)


def words_of(hint: Any) -> str:
    """An annotated type in a message."""
    origin, inner = get_origin(hint), get_args(hint)
    if origin is Callable or hint is Callable:
        return 'a function'
    if origin is tuple and inner[-1:] != (Ellipsis,):
        return f'({", ".join(map(words_of, inner))})'
    if isinstance(origin, type) and issubclass(origin, Mapping):
        return f'a mapping from {words_of(inner[0])} to {words_of(inner[1])}'
    if isinstance(origin, type) and issubclass(origin, Iterable | np.ndarray):
        return 'numbers' if origin is np.ndarray else f'a list of {words_of(inner[0]).removeprefix("a ")}'
    return WORDS.get(origin or hint, getattr(hint, '__name__', str(hint)))


def as_array(name: str, value: Any, like: str = '') -> NDArray[np.float64]:
    """An array of numbers, NaN where a masked array has none. Raises UserError, for dates and complex numbers too."""
    kind = value.dtype.kind if isinstance(getattr(value, 'dtype', None), np.dtype) else ''
    if kind in DATES:  # NumPy would count their own units, such as nanoseconds
        raise UserError(f'{name}: expected numbers{like and f" {like}"}, got {value.dtype}; {DATES[kind]}')
    try:
        if kind == 'c' or np.iscomplexobj(value):  # NumPy would drop the imaginary parts
            raise TypeError
        if isinstance(value, np.ma.MaskedArray):  # NumPy would take what is masked for measured
            return np.ma.filled(value.astype(float), np.nan)
        return np.asarray(value, dtype=float)
    except (TypeError, ValueError) as error:
        raise UserError(f'{name}: expected numbers{like and f" {like}"}, got {shown(value)}') from error


def as_own_array(name: str, value: Any, like: str = '') -> NDArray[np.float64]:
    """The same, read-only: what was given may change afterwards (`own_array`)."""
    return own_array(as_array(name, value, like))


def as_finite(name: str, value: float) -> float:
    """A finite number. Raises UserError."""
    expect(name, value, float)
    if not math.isfinite(value):
        raise UserError(f'{name} = {value}: expected a finite number')
    return value


def as_kelvin(name: str, value: float) -> float:
    """A temperature [K]. Raises UserError for one that no robot's surroundings have, as in degrees Celsius."""
    expect(name, value, float)
    low, high = KELVIN
    if not low <= value <= high:
        raise UserError(f'{name} = {value:g}: expected kelvin between {low:g} and {high:g}{kelvin_hint(value)}')
    return value


def as_difference(name: str, value: float) -> float:
    """By how much an ambient temperature differs [K]. Raises UserError for what must be a temperature itself."""
    expect(name, value, float)
    if not abs(value) <= MAX_DIFFERENCE:
        raise UserError(f'{name} = {value:g}: expected a difference of temperatures [K], at most {MAX_DIFFERENCE:g}')
    return value


def as_folders(name: str, given: str | Path | Iterable[str | Path]) -> list[Path]:
    """Folders as they may be given: one, or several. Raises UserError."""
    expect(name, given, str | Path | Iterable[str | Path])
    every = [given] if isinstance(given, str | Path) else given
    return [Path(folder) for folder in every]
