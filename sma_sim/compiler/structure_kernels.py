"""Native code of a structure's kernels, ready within seconds of its file being saved."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from functools import cache, partial
from types import FunctionType
from typing import Any, NamedTuple

import numpy as np

from sma_sim.compiler.compile import Compiler, carray, code_of, compiled_with, content_key, first_lines_of, write_source
from sma_sim.model.arrays import Matrix, Vector
from sma_sim.model.layout import O_DEPS, O_DL, O_EPS, O_F, O_LENGTH, O_RATIO, O_V, RANGE
from sma_sim.model.parameters import is_number
from sma_sim.model.structures.discovery import StructureError
from sma_sim.model.structures.structure import Place, Structure, numbers, record

SERIES = 'QVF'  # letters of the coordinates, their rates and the forces of all segments in series
STEP = 1e-2  # of the differences of lengths, relative to the scale of a coordinate
WEIGHTS = (45.0 / 60.0, -9.0 / 60.0, 1.0 / 60.0)  # of sixth order: at this step their error is rounding
AGREEMENT = 1e-6  # of gradients by hand with differences, relative to the largest
LITTLE_STRAIN = 0.1  # by STEP of which differences of strain are made
TINY = 1e-300  # of what is divided by, where there is no spring
OF_EFFECTS = ('stiffness', 'gravity')  # which effects call, not the structure's own kernels
TRIED_POSE = 0.1  # relative to the scale of each coordinate
MAX_EFFECTS = 64  # on one structure
CHECKED_POSES = (0.0, 0.7, -1.3)  # relative to the scales of the coordinates


class NativeStructure(NamedTuple):
    """Native functions of a structure (`StructureTable`), None where it has none. Keep it alive while in use."""

    kinematics: Any
    speeds: Any
    motion: Any

    @property
    def addresses(self) -> tuple[int, int, int]:
        """Addresses of the three, 0 for none."""
        kinematics, speeds, motion = (0 if f is None else int(f.address) for f in self)
        return kinematics, speeds, motion


class Kernel(NamedTuple):
    """A kernel of a structure: the letters of what it takes, how many numbers it returns, and whether in a tuple."""

    python: Callable[..., Any]
    takes: str
    returns: int
    in_tuple: bool


def native_structure(structure: Structure) -> NativeStructure:
    """Compile the kernels of a structure, or load them when these very sources were compiled before.

    Raises StructureError where one fails, cannot be compiled, returns another number of values, or where a gradient is not
    that of the lengths.
    """
    one = segment_of(structure)
    functions = (one.lengths, one.gradients, one.strain, one.forces, structure.accelerations)
    return _native_structure(structure, code_of(*functions))


@cache
def _native_structure(structure: Structure, code: str) -> NativeStructure:
    if not structure.coordinates:
        return NativeStructure(None, None, None)
    kernels = checked_kernels(structure)
    functions = [kernel.python for kernel in kernels.values()]
    compiler = Compiler(content_key(*structure.files, code=code), compiled_with(structure.files, *functions))
    texts = (kinematics_text(structure, kernels), speeds_text(structure), motion_text(structure, kernels))
    return NativeStructure(*(compiled(structure, text, kernels, compiler) for text in texts))


def records_of(structure: Structure) -> dict[str, Any]:
    """The named tuples that kernels take, by the letter of the argument; poses are those of one segment."""
    pose = record('Pose', segment_of(structure).coordinate_names)
    drives = record('Drives', [drive.name for drive in structure.loads])
    return {'q': pose, 'v': pose, 'f': pose, 'p': type(structure.default_constants), 'u': drives}


def segment_of(structure: Structure) -> Structure:
    """What lengths, gradients and forces are evaluated of: one segment of a series, else the whole structure."""
    return structure.segment or structure


def checked_kernels(structure: Structure) -> dict[str, Kernel]:
    """The kernels by role, each called once. Raises StructureError."""
    one = segment_of(structure)
    n, driven = len(one.coordinates), 'u' if structure.loads else ''
    constants, kinds = structure.default_constants, records_of(structure)
    example: dict[str, Any] = {
        letter: kinds[letter](*(TRIED_POSE * c.size(constants) for c in one.coordinates)) for letter in 'qvf'
    }
    example |= {'p': constants, 'u': kinds['u'](*(0.5 for _ in structure.loads)), 'k': 0, 'g': 1.0}
    example |= {letter: np.full((structure.segments, n), 1e-3) for letter in SERIES}
    example['l'] = numbers(one.lengths(example['q'], constants))[0] if one.strain and one.lengths else 0.0
    example['w'] = Place(0, example['Q'])
    kernels = {}
    for role, python, takes, returns in (
        ('lengths', one.lengths, 'qp', one.wires),
        ('gradients', one.gradients, 'qp', n * one.wires),
        ('strain', one.strain, 'lp', 2),
        ('forces', one.forces, 'qvp' + driven, n),
        ('accelerations', structure.accelerations, f'k{SERIES}p' if structure.segment else 'qvfp', n),
        ('stiffness', one.stiffness, 'qpg', n),
        ('gravity', structure.gravity, 'wpggg' if structure.segment else 'qpggg', n),
    ):
        if python is not None:
            value = checked_value(structure, role, python, tuple(example[letter] for letter in takes), returns)
            kernels[role] = Kernel(python, takes, returns, isinstance(value, tuple))
    check_agreement(structure)
    return {role: kernel for role, kernel in kernels.items() if role not in OF_EFFECTS}


def checked_value(structure: Structure, role: str, python: Callable[..., Any], given: tuple[Any, ...], returns: int) -> Any:
    """What a kernel returns. Raises StructureError where it fails, or returns what cannot be."""
    one = segment_of(structure)
    try:
        value = python(*given)
    except Exception as error:
        raise StructureError(f'structure {structure.name!r}: its {role} fails: {type(error).__name__}: {error}') from error
    count = len(numbers(value))
    if count != returns:
        raise StructureError(
            f'structure {structure.name!r}: its {role} returns {count} number(s); expected {returns}, for '
            f'{one.wires} wire(s) and {len(one.coordinates)} coordinate(s)'
        )
    if not all(map(is_number, numbers(value))) or not np.isfinite(numbers(value)).all():
        raise StructureError(
            f'structure {structure.name!r}: its {role} returns {value} at the default parameters, with each coordinate at a '
            'tenth of its scale; expected finite numbers'
        )
    return value


def check_agreement(structure: Structure) -> None:
    """Raise StructureError where what a structure declares twice over does not agree, at some poses.

    Poses at which a function has no value say nothing.
    """
    one = segment_of(structure)
    constants, pose = structure.default_constants, record('Pose', one.coordinate_names)
    scales = np.array([c.size(constants) for c in one.coordinates])
    still, found = pose(*np.zeros(len(scales))), list[str]()
    with suppress(ArithmeticError, ValueError):
        for part in CHECKED_POSES:
            found += disagreements(structure, part * scales, scales)
        found += odd_stiffness(structure, [pose(*part * scales) for part in CHECKED_POSES], still)
    if found:
        raise StructureError(f'structure {structure.name!r}: its {found[0]}')


def disagreements(structure: Structure, at: Vector, scales: Vector) -> Iterator[str]:
    """What functions give by hand at a pose, and differences of others do not."""
    one, constants, l0 = segment_of(structure), structure.default_constants, structure.default_values['wire.l0']
    pose, names = record('Pose', one.coordinate_names), one.coordinate_names
    lengths, strain, energy, forces = one.lengths, one.strain, structure.energy, structure.forces
    assert lengths is not None
    if one.gradients is not None:
        by_hand = np.reshape(numbers(one.gradients(pose(*at), constants)), (one.wires, -1))
        slopes = slopes_of(lambda q: numbers(lengths(pose(*q), constants)), at, scales)
        for (i, j), value in odd_slopes(by_hand, slopes):
            yield (
                f'gradients give {value:g} for wire {i + 1} in {names[j]}, differences of its lengths {slopes[i, j]:g}; '
                'leave gradients out to have them found'
            )
    for length in numbers(lengths(pose(*at), constants)) if strain is not None else ():
        assert strain is not None
        eps = partial(strain_at, strain, constants, l0)
        slopes = slopes_of(eps, np.array([length]), np.array([LITTLE_STRAIN * l0]))
        for _, value in odd_slopes(np.array([[strain(length, constants)[1]]]), slopes):
            yield (
                f'strain gives {value:g} as its second value at l = {length:g} m, wire.l0 times differences of its first '
                f'{slopes[0, 0]:g}: expected l0 deps/dl'
            )
    if energy is not None and forces is not None and not (structure.segment or structure.loads):
        still = pose(*np.zeros(len(scales)))
        slopes = slopes_of(lambda q: (-energy(pose(*q), still, constants),), at, scales)
        for (_, j), value in odd_slopes(np.array([numbers(forces(pose(*at), still, constants))]), slopes):
            yield f'forces give {value:g} in {names[j]} at rest, differences of its energy {slopes[0, j]:g}'


def strain_at(strain: Callable[..., Any], constants: Any, l0: float, length: Vector) -> tuple[float]:
    """l0 times what a `strain` gives for a length (1,) [m]."""
    return (l0 * strain(length[0], constants)[0],)


def slopes_of(function: Callable[[Vector], Any], at: Vector, scales: Vector) -> Matrix:
    """The derivatives of a function's values (values, arguments), by differences."""
    columns = []
    for step in STEP * np.diag(scales):
        pairs = ((w, np.subtract(function(at + k * step), function(at - k * step))) for k, w in enumerate(WEIGHTS, start=1))
        columns.append(sum(w * change for w, change in pairs) / step.sum())
    return np.transpose(columns)


def odd_slopes(by_hand: Matrix, slopes: Matrix) -> Iterator[tuple[tuple[int, int], float]]:
    """Where derivatives are not those by differences, and what they are."""
    largest = max(1e-3, float(np.abs(by_hand).max()))
    for i, j in np.argwhere(~(np.abs(slopes - by_hand) <= AGREEMENT * largest)).tolist():
        yield (i, j), float(by_hand[i, j])


def odd_stiffness(structure: Structure, poses: Sequence[Any], still: Any) -> Iterator[str]:
    """Of a stiffness that is not in proportion to its part, or many times the springs that `forces` have.

    Forces may depend on the pose by more than springs, as by weights: what the two differ by is then another function.
    """
    one, constants = segment_of(structure), structure.default_constants
    stiffness, forces = one.stiffness, one.forces
    if stiffness is None or forces is None or structure.loads:
        return
    whole, half = (np.array([numbers(stiffness(q, constants, g)) for q in (still, *poses)]) for g in (1.0, 0.5))
    if np.abs(whole - 2.0 * half).max() > AGREEMENT * np.abs(whole).max():
        yield 'stiffness is not in proportion to its part: expected the forces of the springs, times part'
    shown = np.array([numbers(forces(q, still, constants)) for q in (still, *poses)])
    springs, left = whole - whole[0], shown - shown[0] + whole - whole[0]
    share = float(np.vdot(left, springs)) / max(float(np.vdot(springs, springs)), TINY)
    if abs(share) > AGREEMENT and np.abs(left - share * springs).max() <= AGREEMENT * np.abs(springs).max():
        yield (
            f'stiffness with part 1 gives other springs than its forces, which have {1.0 - share:g} times as much: expected '
            'that these hold -stiffness(q, p, 1)'
        )


def kinematics_text(structure: Structure, kernels: dict[str, Kernel]) -> str:
    """Source of the C function that stores length, strain and dl/dq of every wire."""
    one = segment_of(structure)
    n, l0 = len(one.coordinates), constants_in(structure) + 2 * len(structure.coordinates)
    lines = [f'lengths_ = {call(kernels, "lengths")}']
    for i in range(one.wires):
        lines.append(f'obs[{at(structure, i, O_LENGTH)}] = lengths_[{i}]')
        if 'strain' in kernels:
            found = call(kernels, 'strain', f'lengths_[{i}]')
            lines.append(f'obs[{at(structure, i, O_EPS)}], obs[{at(structure, i, O_RATIO)}] = {found}')
        else:
            lines.append(f'obs[{at(structure, i, O_EPS)}] = lengths_[{i}] / p_[{l0}] - 1.0')
            lines.append(f'obs[{at(structure, i, O_RATIO)}] = 1.0')
    if 'gradients' in kernels:
        lines.append(f'slopes_ = {call(kernels, "gradients")}')
        lines += [f'obs[{at(structure, i, O_DL + j)}] = slopes_[{i * n + j}]' for i in range(one.wires) for j in range(n)]
    else:
        lines += [line for j in range(n) for line in difference_lines(structure, kernels, j)]
    return text_of(structure, 'kinematics', [f'obs = carray(out, {size_of_obs(structure)})', *in_each(structure, lines)])


def difference_lines(structure: Structure, kernels: dict[str, Kernel], j: int) -> list[str]:
    """Lines that store the derivatives of all lengths in coordinate `j`."""
    one = segment_of(structure)
    lines = [f'h_ = {STEP!r} * p_[{constants_in(structure) + j}]']
    for k in range(1, len(WEIGHTS) + 1):
        for name, sign in ((f'ahead{k}_', '+'), (f'behind{k}_', '-')):
            q = [state_entry(structure, i) for i in range(len(one.coordinates))]
            q[j] += f' {sign} {float(k)!r} * h_'
            pose = f'Q({", ".join(q)})'
            lines.append(f'{name} = {call(kernels, "lengths", pose)}')
    for i in range(one.wires):
        terms = (f'{w!r} * (ahead{k}_[{i}] - behind{k}_[{i}])' for k, w in enumerate(WEIGHTS, start=1))
        lines.append(f'obs[{at(structure, i, O_DL + j)}] = ({" + ".join(terms)}) / h_')
    return lines


def speeds_text(structure: Structure) -> str:
    """Source of the C function that stores the rates of length and strain of every wire."""
    one, n = segment_of(structure), len(structure.coordinates)
    l0, lines = constants_in(structure) + 2 * n, []
    for i in range(one.wires):
        terms = (f'obs[{at(structure, i, O_DL + j)}] * {state_entry(structure, n + j)}' for j in range(len(one.coordinates)))
        lines.append(f'obs[{at(structure, i, O_V)}] = {" + ".join(terms)}')
        stretching = f'obs[{at(structure, i, O_RATIO)}] * ' if one.strain else ''
        lines.append(f'obs[{at(structure, i, O_DEPS)}] = {stretching}obs[{at(structure, i, O_V)}] / p_[{l0}]')
    return text_of(structure, 'speeds', [f'obs = carray(out, {size_of_obs(structure)})', *in_each(structure, lines)])


def motion_text(structure: Structure, kernels: dict[str, Kernel]) -> str:
    """Source of the C function that stores dq/dt and dv/dt, under wires and effects."""
    n, loads, first = len(structure.coordinates), structure.loads, constants_in(structure)
    lines = [
        f'obs, dy = carray(findings, {size_of_obs(structure)}), carray(out, {2 * n})',
        f'added = carray(effects, {effects_room(structure)})',
    ]
    if loads:
        lines.append(f'u = U({", ".join(f"added[{structure.drives.index(load)}]" for load in loads)})')
    if structure.segment:
        return text_of(structure, 'motion', [*lines, *series_lines(structure, kernels)])
    lines += force_lines(structure, kernels)
    if 'accelerations' in kernels:
        lines += [f'f = F({", ".join(f"f_{j}" for j in range(n))})', f'rates_ = {call(kernels, "accelerations")}']
    for j in range(n):
        rate = f'rates_[{j}]' if 'accelerations' in kernels else f'f_{j} / p_[{first + n + j}]'
        lines += [f'dy[{j}] = q_[{n + j}]', f'dy[{n + j}] = {rate}']
    return text_of(structure, 'motion', lines)


def force_lines(structure: Structure, kernels: dict[str, Kernel]) -> list[str]:
    """Lines that sum the generalised forces ``f_0``, ``f_1``, ... on the coordinates, of a series on those of a segment."""
    one, n, drives = segment_of(structure), len(structure.coordinates), len(structure.drives)
    own, first = range(len(one.coordinates)), 'first_ + ' if structure.segment else ''
    lines = [f'forces_ = {call(kernels, "forces")}']
    for j in own:
        pulls = (f' - obs[{at(structure, i, O_DL + j)}] * obs[{at(structure, i, O_F)}]' for i in range(one.wires))
        lines.append(f'f_{j} = forces_[{j}]{"".join(pulls)}')
    lines.append(f'for k in range(int(added[{drives}])):')
    return lines + [f'    f_{j} += added[{drives + 1} + {n} * k + {first}{j}]' for j in own]


def series_lines(structure: Structure, kernels: dict[str, Kernel]) -> list[str]:
    """Lines of `motion_text` for segments in series: the forces on some, then the accelerations of some."""
    n, own, count = len(structure.coordinates), len(segment_of(structure).coordinates), structure.segments
    sums = range_at(structure) + RANGE
    stored = [f'added[{sums} + first_ + {j}] = f_{j}' for j in range(own)]
    return [
        *in_each(structure, [*force_lines(structure, kernels), *stored]),
        f'y2_ = carray(state, ({2 * count}, {own}))',
        f'Q2, V2, F2 = y2_[:{count}], y2_[{count}:], added[{sums}:].reshape(({count}, {own}))',
        f'for s_ in range(int(added[{sums - 2}]), int(added[{sums - 1}])):',
        '    rates_ = accelerations(s_, Q2, V2, F2, p)',
        f'    first_ = {own} * s_',
        *(f'    dy[first_ + {j}] = V2[s_, {j}]' for j in range(own)),
        *(f'    dy[{n} + first_ + {j}] = rates_[{j}]' for j in range(own)),
    ]


def in_each(structure: Structure, lines: list[str]) -> list[str]:
    """The lines, for each segment of a series that is asked for."""
    if structure.segment is None:
        return lines
    asked, one = range_at(structure), structure.segment
    repeated = [
        f'first_, wires_ = {len(one.coordinates)} * s_, {one.wires * row_of_obs(structure)} * s_',
        *pose_lines(structure),
        *lines,
    ]
    return [
        f'asked_ = carray(effects, {effects_room(structure)})',
        f'for s_ in range(int(asked_[{asked}]), int(asked_[{asked + 1}])):',
        *(f'    {line}' for line in repeated),
    ]


def pose_lines(structure: Structure) -> list[str]:
    """Lines that name the coordinates and rates, of a series those of a segment."""
    n, own = len(structure.coordinates), range(len(segment_of(structure).coordinates))
    return [
        f'q = Q({", ".join(state_entry(structure, j) for j in own)})',
        f'v = V({", ".join(state_entry(structure, n + j) for j in own)})',
    ]


def call(kernels: dict[str, Kernel], role: str, pose: str = 'q') -> str:
    """A call of a kernel, as a tuple."""
    kernel = kernels[role]
    made = f'{role}({", ".join([pose, *kernel.takes[1:]])})'
    return made if kernel.in_tuple else f'({made},)'


def state_entry(structure: Structure, i: int) -> str:
    """Entry `i` of the state; of a series `i` counts from the segment's first."""
    return f'q_[first_ + {i}]' if structure.segment else f'q_[{i}]'


def at(structure: Structure, wire: int, column: int) -> str:
    """Where the findings of the flow have a column of a wire, of a series a segment's wire."""
    place = wire * row_of_obs(structure) + column
    return f'wires_ + {place}' if structure.segment else f'{place}'


def row_of_obs(structure: Structure) -> int:
    """Numbers in the findings of the flow for a wire."""
    return O_DL + len(segment_of(structure).coordinates)


def size_of_obs(structure: Structure) -> int:
    """Numbers in the findings of the flow."""
    return structure.wires * row_of_obs(structure)


def constants_in(structure: Structure) -> int:
    """How many constants of its own a structure has."""
    return len(records_of(structure)['p']._fields)


def range_at(structure: Structure) -> int:
    """Where the range of the segments stands in `StructureTable.effects`."""
    return len(structure.drives) + 1 + MAX_EFFECTS * len(structure.coordinates)


def effects_room(structure: Structure) -> int:
    """Numbers in `StructureTable.effects`."""
    return range_at(structure) + (RANGE + len(structure.coordinates) if structure.segment else 0)


def new_effects(structure: Structure) -> Vector:
    """`StructureTable.effects` of a structure, with all segments of a series asked for."""
    room = np.zeros(effects_room(structure))
    if structure.segment:
        room[range_at(structure) + 1 : range_at(structure) + RANGE : 2] = structure.segments
    return room


def text_of(structure: Structure, role: str, lines: list[str]) -> str:
    """Source of a C function of five addresses: state (q, then v), constants, what `role` takes, and what it stores."""
    n, own = len(structure.coordinates), constants_in(structure)
    head = [
        f'def {structure.name}_{role}(state, constants, effects, findings, out):',
        f'    q_, p_ = carray(state, {2 * n}), carray(constants, {own + 2 * n + 1})',
        f'    p = P({", ".join(f"p_[{i}]" for i in range(own))})',
        *(() if structure.segment else (f'    {line}' for line in pose_lines(structure))),
    ]
    return '\n'.join([*head, *(f'    {line}' for line in lines)]) + '\n'


def compiled(structure: Structure, text: str, kernels: dict[str, Kernel], compiler: Compiler) -> Any:
    """The C function of a source."""
    name = text.split('(')[0].removeprefix('def ')
    file = compiler.folder / f'structure_{name}.py'
    write_source(file, text)
    namespace: dict[str, Any] = {'__name__': __name__, 'carray': carray}
    namespace |= {letter.upper(): kind for letter, kind in records_of(structure).items()}
    namespace |= {role: kernel.python for role, kernel in kernels.items()}
    exec(compile(text, str(file), 'exec'), namespace)
    wrapper = namespace[name]
    assert isinstance(wrapper, FunctionType)
    try:
        return compiler.native(wrapper, *(kernel.python for kernel in kernels.values()))
    except Exception as error:
        what = name.removeprefix(f'{structure.name}_')
        raise StructureError(
            f'structure {structure.name!r}: its {what} cannot be compiled: {first_lines_of(error)}'
        ) from error
