"""Native code of the kernels of effects, ready within seconds of an effect file being saved."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cache
from itertools import count, islice
from types import FunctionType
from typing import Any, NamedTuple

import numpy as np

from sma_sim.compiler.compile import Compiler, carray, code_of, compiled_with, content_key, first_lines_of, write_source
from sma_sim.compiler.fields_read import check_fields, check_scope, fields_read, warn_of_old_names
from sma_sim.compiler.kernel_text import (
    KernelTypes,
    OneKernel,
    force_text,
    function_of,
    functions_of,
    of_series,
    parameter_fields,
    part_of,
    wrapper_text,
)
from sma_sim.model.effects.conversion import effect_on
from sma_sim.model.effects.discovery import EffectError
from sma_sim.model.effects.effect import Effect
from sma_sim.model.effects.meaning import FUNCTIONS, POSE, acting_coordinates
from sma_sim.model.effects.ports import PORT_MAY_RETURN_ONE, PORT_NAMES, PORT_OUTPUTS, S_POSE, State
from sma_sim.model.parameters import BeamConstants, WireConstants
from sma_sim.model.structures.module import STRUCTURE as MODULE
from sma_sim.model.structures.structure import Place, Structure, numbers, record

NEUTRAL = 1e-9  # what may be left of an effect at neutral values, for a state of the size of 1


class NativeEffect(NamedTuple):
    """Native functions of an effect; `rate` and `start` are None where it has none. Keep it alive while in use."""

    value: Any
    rate: Any
    start: Any

    @property
    def addresses(self) -> tuple[int, int, int]:
        """Addresses of the three, 0 for none."""
        value, rate, start = (0 if f is None else int(f.address) for f in self)
        return value, rate, start


def native_effect(effect: Effect, on: Structure | None = None) -> NativeEffect:
    """Compile the kernels of an effect, or load them when these very sources were compiled before.

    `on` is the structure where its coordinates, constants or parameters are not those of the module (`own_kernels`).

    An effect in a scope has the kernels of the effect itself. Raises EffectError when a kernel cannot be compiled, or reads
    what is not known yet, or what keeps the wires from sharing its states in a scope where they do.
    """
    if effect.plain is not None:
        check_scope(effect)
    plain = effect.plain or effect
    if plain.needs and on is None:
        on = MODULE
    if on is not None and (plain.by_channel or plain.each_bundle or plain.in_space or plain.kernels):
        plain = effect_on(plain, on)
        if plain.by_channel and [p.name for p in plain.parameters] != [p.name for p in effect.parameters]:
            plain = plain.derived(parameters=effect.parameters)  # in a scope of another bench, or saved by another version
    called = [function_of(on, name) for name in FUNCTIONS] if on else []
    functions = (plain.kernel, plain.rate, plain.start, *called)
    return _native_effect(plain, on, functions, code_of(*functions))


@cache
def _native_effect(
    effect: Effect, on: Structure | None, functions: tuple[Callable[..., Any] | None, ...], code: str
) -> NativeEffect:
    check_fields(effect)
    if effect.is_own:
        warn_of_old_names(effect)
    files = (*effect.files, *(on.files if on else ()))
    compiler = Compiler(content_key(*files, code=code), compiled_with(files, *functions))
    kinds = kernel_types(effect, on)
    states = len(effect.states)
    built: list[Any] = []
    for role, kernel, outputs in (
        ('value', effect.kernel, outputs_of(effect, kinds)),
        ('rate', effect.rate, states),
        ('start', effect.start, states),
    ):
        memory = bool(states) and role != 'start'
        if kernel is None:
            built.append(None)
            continue
        one = OneKernel(role, kernel, outputs, memory)
        if role == 'value' and effect.is_own:
            check_neutral(effect, one, kinds)
        text = (force_text if effect.needs else wrapper_text)(effect, one, kinds, returns_tuple(effect, one, kinds))
        built.append(_native(effect, one, kinds, text, compiler, f'_{on.name}' if on else ''))
    return NativeEffect(*built)


def outputs_of(effect: Effect, kinds: KernelTypes) -> int:
    """How many numbers the kernel of an effect returns."""
    if effect.needs and not functions_of(effect):
        return 1
    return kinds.coordinates if effect.port == 'structure_force' else PORT_OUTPUTS[PORT_NAMES.index(effect.port)]


def own_kernels(effect: Effect, structure: Structure) -> bool:
    """Whether the kernels of an effect are compiled for this structure, as they take its coordinates or constants, or have
    parameters of its channels."""
    if effect.needs or any(each.numbers(structure.wires) for each in effect.each_bundle):
        return True
    if effect.by_channel and effect.structure.name != MODULE.name:
        return True
    if structure.coordinate_names == POSE or not structure.coordinates:
        return False
    read = fields_read(effect.kernel) | fields_read(effect.rate) | fields_read(effect.start)
    return effect.port == 'structure_force' or not read.isdisjoint(pose_fields(structure))


def pose_fields(structure: Structure) -> tuple[str, ...]:
    """Names of the coordinates and of their rates, as kernels read them; a name that the state has already gets a mark."""
    names = (*structure.coordinate_names, *(f'd{name}' for name in structure.coordinate_names))
    return tuple(f'{name}_' if name in State._fields[:S_POSE] else name for name in names)


def coordinate_fields(structure: Structure) -> dict[str, tuple[str, str]]:
    """By the name of a coordinate, what kernels call it and its rate."""
    names, count = pose_fields(structure), len(structure.coordinates)
    return dict(zip(structure.coordinate_names, zip(names[:count], names[count:], strict=True), strict=True))


def kernel_types(effect: Effect, structure: Structure | None) -> KernelTypes:
    """What the kernels of an effect take."""
    structural = effect.port == 'structure_force'
    if structure is None:
        return KernelTypes(State, BeamConstants if structural else WireConstants, MODULE)
    posed = structure if structure.coordinates else MODULE  # whose pose is 0 where there are no coordinates
    own = ('q', 'dq', *(('f', 'k') if 'spring' in effect.needs else ())) if effect.needs else pose_fields(posed)
    state = record('State', (*State._fields[:S_POSE], *own))
    constants = type(structure.default_constants) if structural else WireConstants
    return KernelTypes(state, constants, structure, acting_coordinates(effect.needs, structure))


def _native(effect: Effect, one: OneKernel, kinds: KernelTypes, text: str, compiler: Compiler, suffix: str) -> Any:
    """A C function of five addresses around one kernel."""
    role, kernel = one.role, one.python
    part = part_of(kinds.structure)
    functions = {name: function_of(kinds.structure, name) for name in FUNCTIONS if effect.needs}
    file = compiler.folder / f'effect_{effect.name}_{role}{suffix}.py'
    write_source(file, text)
    namespace: dict[str, Any] = {
        '__name__': __name__,
        'carray': carray,
        'math': math,
        'State': kinds.state,
        'Constants': kinds.constants,
        'Parameters': record('Parameters', parameter_fields(effect)),
        'Memory': record('Memory', effect.states),
        'Pose': record('Pose', part.coordinate_names),
        'Place': Place,
        'kernel': kernel,
        **functions,
    }
    exec(compile(text, str(file), 'exec'), namespace)
    wrapper = namespace[f'{effect.name}_{role}']
    assert isinstance(wrapper, FunctionType)
    try:
        return compiler.native(wrapper, kernel, *(python for python in functions.values() if python is not None))
    except Exception as error:
        raise EffectError(f'effect {effect.name!r}: its {role} cannot be compiled: {first_lines_of(error)}') from error


def arguments_of(effect: Effect, one: OneKernel, kinds: KernelTypes, values: Sequence[float]) -> list[Any]:
    """What a kernel takes, for a trial: parameters at `values`, all else numbers of which no two are the same."""
    some = count(0.5, 0.01)
    fields, part, whole = kinds.state._fields, part_of(kinds.structure), one.role == 'value' and functions_of(effect)

    def pose() -> Any:
        return record('Pose', part.coordinate_names)(*islice(some, len(part.coordinates))) if whole else next(some)

    known = {p.name: value for p, value in zip(effect.parameters, values, strict=True)}
    more = (*effect.in_space, *(p for p, *_ in effect.each_bundle))
    known = {p.name: 0.0 if p.neutral is None else p.neutral for p in more} | known
    given: list[Any] = [
        kinds.state(*(pose() if field in ('q', 'dq') else next(some) for field in fields)),
        kinds.constants(*islice(some, len(kinds.constants._fields))),
        record('Parameters', parameter_fields(effect))(*(known.get(name, values[0]) for name in parameter_fields(effect))),
    ]
    if whole and of_series(effect, kinds.structure):
        given[0] = given[0]._replace(q=Place(0, np.full((kinds.structure.segments, len(part.coordinates)), next(some))))
    if one.memory:
        given.append(record('Memory', effect.states)(*(pose() for _ in effect.states)))
    return given + ([function_of(kinds.structure, name) for name in functions_of(effect)] if whole else [])


def state_at_start(effect: Effect, given: Sequence[Any]) -> list[Any]:
    """The first values of the extra states, for what a kernel takes."""
    if effect.start is not None:
        started = effect.start(*given[:3])
        return [started] if len(effect.states) == 1 and isinstance(given[3][0], tuple) else list(numbers(started))
    return [one._replace(**dict.fromkeys(one._fields, 0.0)) if hasattr(one, '_fields') else 0.0 for one in given[3]]


def check_neutral(effect: Effect, one: OneKernel, kinds: KernelTypes) -> None:
    """Raise EffectError where an effect acts although its parameters are at their neutral values."""
    if not any(parameter.neutral is not None for parameter in effect.parameters):
        return
    neutral = [p.default if p.neutral is None else p.neutral for p in effect.parameters]
    given = arguments_of(effect, one, kinds, neutral)
    passed = {'actuation': 'J', 'sensing': 'value'}.get(effect.port)
    nothing = getattr(given[0], passed) if passed else 0.0
    try:
        if one.memory:
            given[3] = given[3]._make(state_at_start(effect, given))
        values = numbers(one.python(*given))
        acts = any(abs(value - nothing) > NEUTRAL for value in values)
    except Exception:  # a fault of the kernel is said where it is compiled
        return
    if acts:
        at = ', '.join(f'{p.name} = {value:g}' for p, value in zip(effect.parameters, neutral, strict=True))
        returned, expected = ', '.join(f'{value:g}' for value in values), f's.{passed} as it is' if passed else '0'
        raise EffectError(
            f'effect {effect.name!r}: its kernel returns {returned} at its neutral values ({at}); expected {expected}: '
            'change the kernel, or what is declared as neutral'
        )


def returns_tuple(effect: Effect, one: OneKernel, kinds: KernelTypes) -> bool:
    """Whether a kernel returns a tuple rather than a float, found by calling it once. Raises EffectError."""
    role, kernel, outputs, _ = one
    may_be_one = role == 'value' and PORT_MAY_RETURN_ONE[PORT_NAMES.index(effect.port)]
    outputs = len(part_of(kinds.structure).coordinates) if role == 'value' and functions_of(effect) else outputs
    given = arguments_of(effect, one, kinds, [p.default for p in effect.parameters])
    try:
        value = kernel(*given)
    except ArithmeticError:
        return outputs != 1 and not may_be_one
    except Exception as error:
        raise EffectError(f'effect {effect.name!r}: its {role} fails: {type(error).__name__}: {error}') from error
    returned = len(numbers(value))
    if returned != outputs and not (returned == 1 and may_be_one):
        what = f'port {effect.port} takes' if role == 'value' else f'its states {", ".join(effect.states)} are'
        wanted = f'1 or {outputs}' if may_be_one else f'{outputs}'
        raise EffectError(f'effect {effect.name!r}: its {role} returns {returned} numbers, {what} {wanted}')
    return isinstance(value, tuple)
