"""Native code of the kernels of effects, ready within seconds of an effect file being saved."""

from __future__ import annotations

from functools import cache
from types import FunctionType
from typing import Any, NamedTuple

from sma_sim.model.effects.discovery import EffectError, FoundEffect
from sma_sim.model.effects.effect import Effect
from sma_sim.model.effects.meaning import POSE, acting_coordinates
from sma_sim.model.effects.ports import PORT_MAY_RETURN_ONE, PORT_NAMES, PORT_OUTPUTS, S_POSE, State
from sma_sim.model.parameters import BeamConstants, WireConstants
from sma_sim.model.structures.discovery import FoundStructure, package_structures
from sma_sim.model.structures.module import STRUCTURE as MODULE
from sma_sim.model.structures.structure import Structure, record
from sma_sim.solver.compile import Compiler, carray, content_key, first_lines_of, write_source
from sma_sim.solver.fields_read import check_fields, check_scope, fields_read
from sma_sim.solver.kernel_text import (
    FUNCTIONS,
    KernelTypes,
    OneKernel,
    force_text,
    functions_of,
    parameter_fields,
    part_of,
    wrapper_text,
)


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


def native_effect(found: FoundEffect, on: FoundStructure | None = None) -> NativeEffect:
    """Compile the kernels of an effect, or load them when these very sources were compiled before.

    `on` is the structure where its coordinates or constants are not those of the module (`own_kernels`).

    An effect in a scope has the kernels of the effect itself. Raises EffectError when a kernel cannot be compiled, or reads
    what is not known yet, or what keeps the wires from sharing its states in a scope where they do.
    """
    if found.plain is not None:
        check_scope(found.effect)
    plain = found.plain or found
    if plain.effect.needs and on is None:
        on = package_structures()['module']
    if plain.effect.by_channel and on is not None:
        plain = plain.on(on.structure)
    return _native_effect(plain, on)


@cache
def _native_effect(found: FoundEffect, on: FoundStructure | None) -> NativeEffect:
    effect = found.effect
    check_fields(effect)
    files, packages = (on.files, on.packages) if on else ((), ())
    compiler = Compiler(content_key(*found.files, *files), (*found.packages, *packages))
    kinds = kernel_types(effect, on.structure if on else None)
    states = len(effect.states)
    built: list[Any] = []
    for role, kernel, count in (
        ('value', effect.kernel, outputs_of(effect, kinds)),
        ('rate', effect.rate, states),
        ('start', effect.start, states),
    ):
        memory = bool(states) and role != 'start'
        if kernel is None:
            built.append(None)
            continue
        one = OneKernel(role, kernel, count, memory)
        text = (force_text if effect.needs else wrapper_text)(effect, one, kinds, returns_tuple(effect, one, kinds))
        built.append(_native(effect, one, kinds, text, compiler, f'_{on.structure.name}' if on else ''))
    return NativeEffect(*built)


def outputs_of(effect: Effect, kinds: KernelTypes) -> int:
    """How many numbers the kernel of an effect returns."""
    if effect.needs and not functions_of(effect):
        return 1
    return kinds.coordinates if effect.port == 'structure_force' else PORT_OUTPUTS[PORT_NAMES.index(effect.port)]


def own_kernels(effect: Effect, structure: Structure) -> bool:
    """Whether the kernels of an effect are compiled for this structure, as they take its coordinates or constants."""
    if effect.needs:
        return True
    if structure.coordinate_names == POSE or not structure.coordinates:
        return False
    if effect.by_channel:
        return True
    read = fields_read(effect.kernel) | fields_read(effect.rate) | fields_read(effect.start)
    return effect.port == 'structure_force' or not read.isdisjoint(pose_fields(structure))


def pose_fields(structure: Structure) -> tuple[str, ...]:
    """Names of the coordinates and of their rates, as kernels read them; a name that the state has already gets a mark."""
    names = (*structure.coordinate_names, *(f'd{name}' for name in structure.coordinate_names))
    return tuple(f'{name}_' if name in State._fields[:S_POSE] else name for name in names)


def kernel_types(effect: Effect, structure: Structure | None) -> KernelTypes:
    """What the kernels of an effect take."""
    structural = effect.port == 'structure_force'
    if structure is None:
        return KernelTypes(State, BeamConstants if structural else WireConstants, MODULE)
    own = ('q', 'dq', *(('f', 'k') if 'spring' in effect.needs else ())) if effect.needs else pose_fields(structure)
    state = record('State', (*State._fields[:S_POSE], *own))
    constants = type(structure.default_constants) if structural else WireConstants
    return KernelTypes(state, constants, structure, acting_coordinates(effect.needs, structure))


def _native(effect: Effect, one: OneKernel, kinds: KernelTypes, text: str, compiler: Compiler, suffix: str) -> Any:
    """A C function of five addresses around one kernel."""
    role, kernel = one.role, one.python
    part = part_of(kinds.structure)
    functions = {name: getattr(part, name) for name in FUNCTIONS if effect.needs}
    file = compiler.folder / f'effect_{effect.name}_{role}{suffix}.py'
    write_source(file, text)
    namespace: dict[str, Any] = {
        '__name__': __name__,
        'carray': carray,
        'State': kinds.state,
        'Constants': kinds.constants,
        'Parameters': record('Parameters', parameter_fields(effect)),
        'Memory': record('Memory', effect.states),
        'Pose': record('Pose', part.coordinate_names),
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


def returns_tuple(effect: Effect, one: OneKernel, kinds: KernelTypes) -> bool:
    """Whether a kernel returns a tuple rather than a float, found by calling it once. Raises EffectError."""
    role, kernel, outputs, memory = one
    may_be_one = role == 'value' and PORT_MAY_RETURN_ONE[PORT_NAMES.index(effect.port)]
    constants, fields = kinds.constants, kinds.state._fields
    parameters = record('Parameters', parameter_fields(effect))
    whole = role == 'value' and functions_of(effect)
    part = part_of(kinds.structure)
    pose = record('Pose', part.coordinate_names)(*[0.5] * len(part.coordinates)) if whole else 0.5
    outputs = len(part.coordinates) if whole else outputs
    given: list[Any] = [
        kinds.state(*(pose if field in ('q', 'dq') else 0.5 for field in fields)),
        constants(*[0.5] * len(constants._fields)),
        parameters(*[p.default for p in effect.parameters][: len(parameters._fields)]),
    ]
    if memory:
        given.append(record('Memory', effect.states)(*[pose] * len(effect.states)))
    if whole:
        given += [getattr(part, name) for name in functions_of(effect)]
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
