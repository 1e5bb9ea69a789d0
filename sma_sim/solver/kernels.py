"""Native code of the kernels of effects, ready within seconds of an effect file being saved."""

from __future__ import annotations

from collections import namedtuple
from collections.abc import Callable, Sequence
from functools import cache
from types import FunctionType
from typing import Any, NamedTuple

import numba

from sma_sim.model.effects.discovery import EffectError, FoundEffect
from sma_sim.model.effects.effect import Effect
from sma_sim.model.effects.ports import (
    PORT_MAY_RETURN_ONE,
    PORT_NAMES,
    PORT_OUTPUTS,
    S_J,
    S_POSE,
    S_POSE_RATE,
    S_T,
    S_T_OTHER,
    S_WIRE,
    S_X,
    S_X_OTHER,
    State,
)
from sma_sim.model.effects.scope import MASK_POSE, MASK_SHARED, MASK_SIZE, MASK_WIRE
from sma_sim.model.parameters import BeamConstants, WireConstants
from sma_sim.solver.compile import Compiler, content_key, write_source
from sma_sim.solver.fields_read import can_share, check_fields, check_scope

_numba: Any = numba  # its types are not declared
carray = _numba.carray


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


@cache
def native_effect(found: FoundEffect) -> NativeEffect:
    """Compile the kernels of an effect, or load them when these very sources were compiled before.

    An effect in a scope has the kernels of the effect itself. Raises EffectError when a kernel cannot be compiled, or reads
    what is not known yet, or what keeps the wires from sharing its states in a scope where they do.
    """
    if found.plain is not None:
        check_scope(found.effect)
        return native_effect(found.plain)
    effect = found.effect
    check_fields(effect)
    compiler = Compiler(content_key(*found.files), found.packages)
    outputs = PORT_OUTPUTS[PORT_NAMES.index(effect.port)]
    states = len(effect.states)
    built: list[Any] = []
    for role, kernel, count in (
        ('value', effect.kernel, outputs),
        ('rate', effect.rate, states),
        ('start', effect.start, states),
    ):
        memory = bool(states) and role != 'start'
        built.append(None if kernel is None else _native(effect, role, kernel, count, memory, compiler))
    return NativeEffect(*built)


def record(name: str, fields: Sequence[str]) -> Any:
    """A named tuple type whose fields are known only now."""
    return namedtuple(name, fields)


def constants_of(effect: Effect) -> type[BeamConstants] | type[WireConstants]:
    """The constants that the kernels of an effect read."""
    return BeamConstants if effect.port == 'structure_force' else WireConstants


def _native(effect: Effect, role: str, kernel: Callable[..., Any], outputs: int, memory: bool, compiler: Compiler) -> Any:
    """A C function of five addresses around one kernel."""
    text = wrapper_text(effect, role, outputs, memory, returns_tuple(effect, role, kernel, outputs, memory))
    file = compiler.folder / f'effect_{effect.name}_{role}.py'
    write_source(file, text)
    names = [p.name for p in effect.parameters]
    namespace: dict[str, Any] = {
        '__name__': __name__,
        'carray': carray,
        'State': State,
        'Constants': constants_of(effect),
        'Parameters': record('Parameters', names),
        'Memory': record('Memory', effect.states),
        'kernel': kernel,
    }
    exec(compile(text, str(file), 'exec'), namespace)
    wrapper = namespace[f'{effect.name}_{role}']
    assert isinstance(wrapper, FunctionType)
    try:
        return compiler.native(wrapper, kernel)
    except Exception as error:
        raise EffectError(f'effect {effect.name!r}: its {role} cannot be compiled: {first_lines_of(error)}') from error


def first_lines_of(error: Exception) -> str:
    """The first lines of the long message of the compiler that say what is wrong."""
    noise = ('Failed in', 'During:', 'File "', '^', 'This error', '[1]')
    lines = [line.strip() for line in str(error).splitlines()]
    kept = [line for line in lines if line and not line.startswith(noise)]
    return ' '.join(kept[:3]) or type(error).__name__


def returns_tuple(effect: Effect, role: str, kernel: Callable[..., Any], outputs: int, memory: bool) -> bool:
    """Whether a kernel returns a tuple rather than a float, found by calling it once. Raises EffectError."""
    may_be_one = role == 'value' and PORT_MAY_RETURN_ONE[PORT_NAMES.index(effect.port)]
    constants, memory_type = constants_of(effect), record('Memory', effect.states)
    parameters = record('Parameters', [p.name for p in effect.parameters])
    given: list[Any] = [
        State(*[0.5] * len(State._fields)),
        constants(*[0.5] * len(constants._fields)),
        parameters(*[p.default for p in effect.parameters]),
    ]
    if memory:
        given.append(memory_type(*[0.5] * len(effect.states)))
    try:
        value = kernel(*given)
    except ArithmeticError:
        return outputs != 1 and not may_be_one
    except Exception as error:
        raise EffectError(f'effect {effect.name!r}: its {role} fails: {type(error).__name__}: {error}') from error
    count = len(value) if isinstance(value, tuple) else 1
    if count != outputs and not (count == 1 and may_be_one):
        what = f'port {effect.port} takes' if role == 'value' else f'its states {", ".join(effect.states)} are'
        wanted = f'1 or {outputs}' if may_be_one else f'{outputs}'
        raise EffectError(f'effect {effect.name!r}: its {role} returns {count} numbers, {what} {wanted}')
    return isinstance(value, tuple)


def wrapper_text(effect: Effect, role: str, outputs: int, memory: bool, is_tuple: bool) -> str:
    """Source of the C function: build what the kernel takes from the five addresses, store what it returns."""
    constants, first = constants_of(effect), len(effect.parameters)
    groups = [('s', 'State', len(State._fields)), ('w', 'Constants', len(constants._fields))]
    groups.append(('p', 'Parameters', first))
    if memory:
        groups.append(('m', 'Memory', len(effect.states)))
    lines = [f'def {effect.name}_{role}(s, w, p, m, out):', f'    out_ = carray(out, {max(outputs, 1)})']
    lines += [f'    {letter}_ = carray({letter}, {size + MASK_SIZE * (letter == "p")})' for letter, _, size in groups]
    lines += elsewhere_lines(effect, role, outputs)
    lines += record_lines(groups, masked_state(effect, first))
    lines.append(f'    result = kernel({", ".join(f"{letter}__" for letter, _, _ in groups)})')
    values = [f'result[{i}]' for i in range(outputs)] if is_tuple else ['result'] + ['0.0'] * (outputs - 1)
    if effect.port == 'structure_force' and role == 'value':
        values = [f'{value} * p_[{first + MASK_POSE + i}]' for i, value in enumerate(values)]
    lines += [f'    out_[{i}] = {value}' for i, value in enumerate(values)]
    if role == 'rate' and can_share(effect):
        lines += shared_lines(groups, values, first)
    return '\n'.join(lines) + '\n'


def record_lines(groups: Sequence[tuple[str, str, int]], state: Sequence[str], indent: str = '    ') -> list[str]:
    """Lines that build what a kernel takes; of the state from the expressions of its entries."""
    entries = {letter: [f'{letter}_[{i}]' for i in range(size)] for letter, _, size in groups} | {'s': list(state)}
    return [f'{indent}{letter}__ = {kind}({", ".join(entries[letter])})' for letter, kind, _ in groups]


def masked_state(effect: Effect, first: int) -> list[str]:
    """The entries of the state that a kernel sees, of the pose and its rates those of its scope; `first`: the mask."""
    entries = [f's_[{i}]' for i in range(len(State._fields))]
    if effect.port == 'structure_force':
        for i in range(3):
            for at in (S_POSE, S_POSE_RATE):
                entries[at + i] += f' * p_[{first + MASK_POSE + i}]'
    return entries


def elsewhere_lines(effect: Effect, role: str, outputs: int) -> list[str]:
    """Lines that return nothing (on actuation: the value as it is) for a wire in which the effect does not act."""
    if effect.port in ('structure_force', 'sensing'):
        return []
    wire = f'p_[{len(effect.parameters) + MASK_WIRE}]'
    passed = f's_[{S_J}]' if effect.port == 'actuation' and role == 'value' else '0.0'
    nothing = [f'        out_[{i}] = {passed}' for i in range(outputs)]
    return [f'    if {wire} >= 0.0 and {wire} != s_[{S_WIRE}]:', *nothing, '        return']


def shared_lines(groups: Sequence[tuple[str, str, int]], values: Sequence[str], first: int) -> list[str]:
    """Lines that make the rates of both wires their mean, where the wires share the states: each keeps a copy of them."""
    state = [f's_[{i}]' for i in range(len(State._fields))]
    for a, b in ((S_T, S_T_OTHER), (S_X, S_X_OTHER)):
        state[a], state[b] = state[b], state[a]
    state[S_WIRE] = f'1.0 - s_[{S_WIRE}]'
    return [
        f'    if p_[{first + MASK_SHARED}] > 0.0:', record_lines(groups[:1], state, '        ')[0],
        f'        result = kernel({", ".join(f"{letter}__" for letter, _, _ in groups)})',
        *(f'        out_[{i}] = 0.5 * (out_[{i}] + {value})' for i, value in enumerate(values)),
    ]  # fmt: skip
