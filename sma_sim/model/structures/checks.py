"""What is wrong with a structure as it is declared, in one sentence: names, units, parameters, functions at rest.

Values near rest and gradients are checked where the functions are compiled (`compiler.structure_kernels`).
"""

from __future__ import annotations

import keyword
import math
from collections.abc import Iterator

from sma_sim.model.parameters import fault_of as fault_of_parameter
from sma_sim.model.parameters import is_number
from sma_sim.model.program_parameters import DEFAULTS
from sma_sim.model.structures.structure import Coordinate, Structure, numbers, record


def fault_of(structure: Structure) -> str:
    """What is wrong with a declaration, '' if nothing is found."""
    for faults in (coordinate_faults, parameter_faults, scale_faults, reference_faults, function_faults):  # as they need
        for fault in faults(structure):
            return f'structure {structure.name!r}: {fault}'
    return ''


def coordinate_faults(structure: Structure) -> Iterator[str]:
    """Of the structure's name and its coordinates."""
    if not structure.name.isidentifier():
        yield 'expected a name of letters, digits and _'
    names = [getattr(coordinate, 'name', '') for coordinate in structure.coordinates]
    for coordinate in structure.coordinates:
        if not isinstance(coordinate, Coordinate):
            yield f'expected a Coordinate among its coordinates, got {coordinate!r}'
        elif not coordinate.name.isidentifier():
            yield f'coordinate {coordinate.name!r}: expected a name of letters, digits and _'
        elif keyword.iskeyword(coordinate.name):
            yield f'coordinate {coordinate.name!r}: a word of Python, which no function could read; expected another one'
        elif names.count(coordinate.name) > 1:
            yield f'coordinate {coordinate.name} is there twice; give each a name of its own'
        elif not coordinate.unit:
            yield f"coordinate {coordinate.name}: expected a unit, such as 'm' or 'rad' ('-' for none), got ''"
        elif not callable(coordinate.scale) and not 0.0 < coordinate.scale < math.inf:
            yield f'coordinate {coordinate.name}: scale = {coordinate.scale:g} {coordinate.unit}; expected more than 0'
        elif coordinate.law and coordinate.law not in names:
            yield f'coordinate {coordinate.name}: law {coordinate.law!r}; expected one of {", ".join(names)}'


def parameter_faults(structure: Structure) -> Iterator[str]:
    """Of its parameters."""
    yield from filter(None, map(fault_of_parameter, structure.parameters))
    names = [one.name if '.' in one.name else f'{structure.original}.{one.name}' for one in structure.parameters]
    yield from (f'parameter {name} is there twice; give each a name of its own' for name in names if names.count(name) > 1)


def scale_faults(structure: Structure) -> Iterator[str]:
    """Of the functions that say usual sizes, on which the noise of channels depends."""
    try:
        of, constants = 'its constants', structure.constants_before_noise
        for coordinate in structure.coordinates:
            of = f'coordinate {coordinate.name}: its scale'
            yield from size_faults(of, coordinate.scale(constants) if callable(coordinate.scale) else coordinate.scale)
            if coordinate.rate_scale is not None:
                of = f'coordinate {coordinate.name}: its rate_scale'
                yield from size_faults(of, coordinate.rate_scale(constants))
    except Exception as error:
        yield failure(of, error)


def size_faults(of: str, value: object) -> Iterator[str]:
    """Of what is to be a number above 0."""
    if not (is_number(value) and 0.0 < value < math.inf):  # type: ignore[operator]
        yield f'{of} is {value!r}; expected a number above 0'


def failure(of: str, error: Exception) -> str:
    """What a function raised."""
    return f'{of} fails: {type(error).__name__}: {error}'


def reference_faults(structure: Structure) -> Iterator[str]:
    """Of the parameters that it names elsewhere."""
    known = structure.declared.keys() | DEFAULTS.keys() | {parameter.name for parameter in structure.initial}
    size = (structure.size_parameter,) if structure.size_parameter else ()
    for words, names in (('fitted', structure.fitted), ('defaults', structure.defaults), ('size_parameter', size)):
        for name in names:
            if name not in known:
                own = ', '.join(structure.declared) or 'none'
                yield f'{words} names {name}, which is no parameter; its own are {own}'
    for name, value in structure.defaults.items():
        (low, high), unit = structure.all_parameters[name].bounds, structure.all_parameters[name].unit
        if not low <= value <= high:
            yield f'defaults, {name} = {value:g} {unit}'.removesuffix(' -') + f': expected {low:g} to {high:g}'


def function_faults(structure: Structure) -> Iterator[str]:
    """Of the functions that are called before anything is compiled, where all coordinates are 0."""
    role = 'constants'
    try:
        constants = structure.default_constants
        rest = record('Pose', structure.coordinate_names)(*(0.0 for _ in structure.coordinates))
        role = 'stiffness'
        if structure.stiffness is not None:
            structure.stiffness(rest, constants, 1.0)
        role = 'inertia'
        inertia = () if structure.inertia is None else numbers(structure.inertia(constants))
        role = 'gravity'
        weight = structure.weight(0.0, 0.0, 0.0)
        role = 'lengths'
        lengths = () if structure.lengths is None else numbers(structure.lengths(rest, constants))
    except Exception as error:
        yield failure(f'its {role}', error)
        return
    for words, found in (('inertia', inertia), ('gravity', weight)):
        if not all(map(is_number, found)):
            yield f'its {words} gives {found!r}; expected a number for each of {", ".join(structure.coordinate_names)}'
    for i, length in enumerate(lengths, start=1):
        if not is_number(length):
            yield f'its lengths give {length!r} for wire {i}; expected a number for one wire, a tuple of numbers for several'
        elif not 0.0 < length < math.inf:
            yield f'its lengths give {length:g} m for wire {i} where all coordinates are 0; expected more than 0'
