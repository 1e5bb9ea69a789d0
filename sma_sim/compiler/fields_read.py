"""Which fields of the state the kernel of an effect reads, from the compiler's own view of it.

The solver has to know: x_M is an implicit function where what effects add depends on it, and a flow that depends on time
has a derivative in time. The compiler's first stage turns a kernel into single operations; those on the state are
reads of a field by its name, or calls of functions that read in turn. Where the state is used in any other way (by
index, unpacked, handed to a function that is not compiled from Python), the kernel is taken to read every field.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import lru_cache
from types import FunctionType
from typing import Any

from numba.core import ir
from numba.core.compiler import run_frontend
from numba.core.errors import NumbaError

from sma_sim.model.effects.discovery import EffectError
from sma_sim.model.effects.effect import Effect
from sma_sim.model.effects.ports import PORT_NAMES, RATE_UNKNOWN, VALUE_UNKNOWN, State
from sma_sim.model.effects.scope import Scope

frontend: Any = run_frontend  # its types are not declared
EVERY_FIELD = frozenset(State._fields)
WIRE = 1  # position of the constants of a wire among a kernel's arguments
Visited = set[tuple[Callable[..., Any], int]]


@lru_cache(4096)
def fields_read(kernel: Callable[..., Any] | None, position: int = 0) -> frozenset[str]:
    """Names of the fields that a kernel, or a function that it calls, reads of its argument at `position`: of the state.

    All fields of the state, where that is not clear.
    """
    return frozenset() if kernel is None else _read_through(kernel, position, set())


def warn_of_old_names(effect: Effect) -> None:
    """Warn of constants that kernels read by a name that they had before."""
    kernels = (effect.kernel, effect.rate, effect.start)
    if effect.port != 'structure_force' and any('area' in fields_read(kernel, WIRE) for kernel in kernels):
        warnings.warn(
            f'effect {effect.name!r} reads w.area, which is called w.surface now: the lateral surface of a wire [m^2]; '
            'its cross section is w.section',
            FutureWarning,
            stacklevel=2,
        )


def uses_time(effect: Effect) -> bool:
    """Whether a kernel reads the time ``s.t``, so that the flow depends on it."""
    return 't' in fields_read(effect.kernel) | fields_read(effect.rate)


def check_fields(effect: Effect) -> None:
    """Raise EffectError where a kernel reads a field that is not known yet when its port is evaluated."""
    port = PORT_NAMES.index(effect.port)
    for role, kernel, unknown in (
        ('value', effect.kernel, VALUE_UNKNOWN[port]),
        ('rate', effect.rate, RATE_UNKNOWN[port]),
    ):
        fields = fields_read(kernel)
        early = sorted(fields.intersection(unknown)) if fields != EVERY_FIELD else []
        if early:
            raise EffectError(
                f'effect {effect.name!r}: its {role} reads s.{", s.".join(early)}, not known yet when port {effect.port} is '
                f'evaluated; known are {", ".join(name for name in State._fields if name not in unknown)}'
            )


def can_share(effect: Effect) -> bool:
    """Whether wires can share the extra states of an effect: they lie outside the wires, and all begin alike."""
    return effect.port == 'wire_heat' and bool(effect.states) and effect.start is None


def check_scope(effect: Effect) -> None:
    """Raise EffectError where an effect cannot act in its scope."""
    if effect.scope.shared and not can_share(effect):
        raise EffectError(f'effect {effect.name!r}: wires can share states of wire_heat that begin at zero')
    field = effect.scope.field
    if field and field not in fields_read(effect.kernel):
        known = ', '.join(sorted(fields_read(effect.kernel)))
        raise EffectError(
            f'effect {effect.name!r}: another form needs a field that its law depends on ({known}), not {field}'
        )


def forms_of_law(effect: Effect) -> tuple[Scope, ...]:
    """The other forms that the law of an effect has: of all (`Effect.forms`) those in a field that its kernel reads."""
    read = fields_read(effect.kernel)
    return tuple(form for form in effect.forms if read != EVERY_FIELD and form.field in read)


def _read_through(function: Any, position: int, visited: Visited) -> frozenset[str]:
    """Fields read from the argument at `position` of a function."""
    python = getattr(function, 'py_func', function)  # of one that the user has compiled
    if not isinstance(python, FunctionType):
        return EVERY_FIELD
    if (python, position) in visited:
        return frozenset()
    visited.add((python, position))
    try:
        code = frontend(python)
    except (NumbaError, NotImplementedError):
        return EVERY_FIELD  # it cannot be compiled either, which is reported where it is tried
    statements = [statement for block in code.blocks.values() for statement in block.body]
    names = _names_of_argument(statements, position)
    fields: frozenset[str] = frozenset()
    for statement in statements:
        fields |= _read_by(statement, names, code, visited)
    return fields


def _names_of_argument(statements: list[Any], position: int) -> set[str]:
    """Names of the variables that may hold the argument at `position`."""
    names: set[str] = set()
    while True:
        known = len(names)
        for statement in statements:
            if isinstance(statement, ir.Assign) and _is_argument(statement.value, position, names):
                names.add(statement.target.name)
        if len(names) == known:
            return names


def _is_argument(value: Any, position: int, names: set[str]) -> bool:
    """Whether a value is the argument itself, or a copy of a variable that holds it."""
    if isinstance(value, ir.Arg):
        return bool(value.index == position)
    if isinstance(value, ir.Expr) and value.op == 'cast':
        value = value.value
    return isinstance(value, ir.Var) and value.name in names


def _read_by(statement: Any, names: set[str], code: Any, visited: Visited) -> frozenset[str]:
    """Fields that one statement reads from the variables `names`."""
    if isinstance(statement, ir.Del) or not any(used.name in names for used in statement.list_vars()):
        return frozenset()
    value = statement.value if isinstance(statement, ir.Assign) else None
    if _is_argument(value, -1, names) or isinstance(value, ir.Arg):
        return frozenset()
    if isinstance(value, ir.Expr) and value.op == 'getattr':
        return frozenset([value.attr])
    if isinstance(value, ir.Expr) and value.op == 'call':
        return _read_by_call(value, names, code, visited)
    return EVERY_FIELD


def _read_by_call(call: Any, names: set[str], code: Any, visited: Visited) -> frozenset[str]:
    """Fields that a called function reads from the variables `names`."""
    if call.kws or call.vararg is not None:
        return EVERY_FIELD
    callee = _value_of(call.func, code)
    positions = [k for k, argument in enumerate(call.args) if argument.name in names]
    if callee is getattr and positions == [0]:
        field = _value_of(call.args[1], code)
        return frozenset([field]) if isinstance(field, str) else EVERY_FIELD
    fields: frozenset[str] = frozenset()
    for position in positions:
        fields |= _read_through(callee, position, visited)
    return fields


def _value_of(variable: Any, code: Any) -> Any:
    """The value of a variable that is a constant, a global name, or an attribute of one; None where that is not clear."""
    try:
        definition = code.get_definition(variable)
    except KeyError:
        return None
    if isinstance(definition, ir.Global | ir.FreeVar | ir.Const):
        return definition.value
    if isinstance(definition, ir.Expr) and definition.op == 'getattr':
        return getattr(_value_of(definition.value, code), definition.attr, None)
    return None
