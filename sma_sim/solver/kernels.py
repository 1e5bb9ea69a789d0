"""Native code of the kernels of effects, ready within seconds of an effect file being saved."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from types import FunctionType
from typing import Any, NamedTuple

from sma_sim.model.effects.discovery import EffectError, FoundEffect
from sma_sim.model.effects.effect import Effect
from sma_sim.model.effects.meaning import POSE
from sma_sim.model.effects.ports import (
    PORT_MAY_RETURN_ONE,
    PORT_NAMES,
    PORT_OUTPUTS,
    S_J,
    S_POSE,
    S_T,
    S_T_OTHER,
    S_WIRE,
    S_X,
    S_X_OTHER,
    State,
)
from sma_sim.model.effects.scope import MASK_POSE, MASK_SHARED, MASK_SIZE, MASK_WIRE
from sma_sim.model.parameters import BeamConstants, WireConstants
from sma_sim.model.structures.discovery import FoundStructure
from sma_sim.model.structures.structure import Structure, record
from sma_sim.solver.compile import Compiler, carray, content_key, first_lines_of, write_source
from sma_sim.solver.fields_read import can_share, check_fields, check_scope, fields_read


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


class KernelTypes(NamedTuple):
    """What the kernels of an effect take, and how many coordinates their state has."""

    state: Any
    constants: Any
    coordinates: int


def native_effect(found: FoundEffect, on: FoundStructure | None = None) -> NativeEffect:
    """Compile the kernels of an effect, or load them when these very sources were compiled before.

    `on` is the structure where its coordinates or constants are not those of the module (`own_kernels`).

    An effect in a scope has the kernels of the effect itself. Raises EffectError when a kernel cannot be compiled, or reads
    what is not known yet, or what keeps the wires from sharing its states in a scope where they do.
    """
    if found.plain is not None:
        check_scope(found.effect)
    return _native_effect(found.plain or found, on)


@cache
def _native_effect(found: FoundEffect, on: FoundStructure | None) -> NativeEffect:
    effect = found.effect
    check_fields(effect)
    files, packages = (on.files, on.packages) if on else ((), ())
    compiler = Compiler(content_key(*found.files, *files), (*found.packages, *packages))
    kinds = kernel_types(effect, on.structure if on else None)
    outputs = kinds.coordinates if effect.port == 'structure_force' else PORT_OUTPUTS[PORT_NAMES.index(effect.port)]
    states = len(effect.states)
    built: list[Any] = []
    for role, kernel, count in (
        ('value', effect.kernel, outputs),
        ('rate', effect.rate, states),
        ('start', effect.start, states),
    ):
        memory = bool(states) and role != 'start'
        if kernel is None:
            built.append(None)
            continue
        one = OneKernel(role, kernel, count, memory)
        text = wrapper_text(effect, one, kinds, returns_tuple(effect, one, kinds))
        built.append(_native(effect, one, kinds, text, compiler, f'_{on.structure.name}' if on else ''))
    return NativeEffect(*built)


class OneKernel(NamedTuple):
    """A kernel of an effect, in its role: how many numbers it returns, and whether it takes the extra states."""

    role: str
    python: Callable[..., Any]
    outputs: int
    memory: bool


def own_kernels(effect: Effect, structure: Structure) -> bool:
    """Whether the kernels of an effect are compiled for this structure, as they take its coordinates or constants."""
    if structure.coordinate_names == POSE or not structure.coordinates:
        return False
    read = fields_read(effect.kernel) | fields_read(effect.rate) | fields_read(effect.start)
    return effect.port == 'structure_force' or not read.isdisjoint(pose_fields(structure))


def pose_fields(structure: Structure) -> tuple[str, ...]:
    """Names of the coordinates and of their rates, as kernels read them."""
    names = structure.coordinate_names
    return (*names, *(f'd{name}' for name in names))


def kernel_types(effect: Effect, structure: Structure | None) -> KernelTypes:
    """What the kernels of an effect take."""
    structural = effect.port == 'structure_force'
    if structure is None:
        return KernelTypes(State, BeamConstants if structural else WireConstants, len(POSE))
    state = record('State', (*State._fields[:S_POSE], *pose_fields(structure)))
    constants = type(structure.default_constants) if structural else WireConstants
    return KernelTypes(state, constants, len(structure.coordinates))


def _native(effect: Effect, one: OneKernel, kinds: KernelTypes, text: str, compiler: Compiler, suffix: str) -> Any:
    """A C function of five addresses around one kernel."""
    role, kernel = one.role, one.python
    file = compiler.folder / f'effect_{effect.name}_{role}{suffix}.py'
    write_source(file, text)
    names = [p.name for p in effect.parameters]
    namespace: dict[str, Any] = {
        '__name__': __name__,
        'carray': carray,
        'State': kinds.state,
        'Constants': kinds.constants,
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


def returns_tuple(effect: Effect, one: OneKernel, kinds: KernelTypes) -> bool:
    """Whether a kernel returns a tuple rather than a float, found by calling it once. Raises EffectError."""
    role, kernel, outputs, memory = one
    may_be_one = role == 'value' and PORT_MAY_RETURN_ONE[PORT_NAMES.index(effect.port)]
    constants, memory_type = kinds.constants, record('Memory', effect.states)
    parameters = record('Parameters', [p.name for p in effect.parameters])
    given: list[Any] = [
        kinds.state(*[0.5] * len(kinds.state._fields)),
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


def wrapper_text(effect: Effect, one: OneKernel, kinds: KernelTypes, is_tuple: bool) -> str:
    """Source of the C function: build what the kernel takes from the five addresses, store what it returns."""
    role, _, outputs, memory = one
    first = len(effect.parameters)
    groups = [('s', 'State', len(kinds.state._fields)), ('w', 'Constants', len(kinds.constants._fields))]
    groups.append(('p', 'Parameters', first))
    if memory:
        groups.append(('m', 'Memory', len(effect.states)))
    lines = [f'def {effect.name}_{role}(s, w, p, m, out):', f'    out_ = carray(out, {max(outputs, 1)})']
    lines += [f'    {letter}_ = carray({letter}, {size + MASK_SIZE * (letter == "p")})' for letter, _, size in groups]
    lines += elsewhere_lines(effect, role, outputs)
    lines += record_lines(groups, masked_state(effect, first, kinds))
    lines.append(f'    result = kernel({", ".join(f"{letter}__" for letter, _, _ in groups)})')
    values = [f'result[{i}]' for i in range(outputs)] if is_tuple else ['result'] + ['0.0'] * (outputs - 1)
    if has_pose_mask(effect, kinds) and role == 'value':
        values = [f'{value} * p_[{first + MASK_POSE + i}]' for i, value in enumerate(values)]
    lines += [f'    out_[{i}] = {value}' for i, value in enumerate(values)]
    if role == 'rate' and can_share(effect):
        lines += shared_lines(groups, values, first)
    return '\n'.join(lines) + '\n'


def record_lines(groups: Sequence[tuple[str, str, int]], state: Sequence[str], indent: str = '    ') -> list[str]:
    """Lines that build what a kernel takes; of the state from the expressions of its entries."""
    entries = {letter: [f'{letter}_[{i}]' for i in range(size)] for letter, _, size in groups} | {'s': list(state)}
    return [f'{indent}{letter}__ = {kind}({", ".join(entries[letter])})' for letter, kind, _ in groups]


def has_pose_mask(effect: Effect, kinds: KernelTypes) -> bool:
    """Whether an effect can act on some coordinates only."""
    return effect.port == 'structure_force' and kinds.coordinates == len(POSE)


def masked_state(effect: Effect, first: int, kinds: KernelTypes) -> list[str]:
    """The entries of the state that a kernel sees, of the pose and its rates those of its scope; `first`: the mask."""
    entries = [f's_[{i}]' for i in range(len(kinds.state._fields))]
    if has_pose_mask(effect, kinds):
        for i in range(len(POSE)):
            for at in (S_POSE, S_POSE + len(POSE)):
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
