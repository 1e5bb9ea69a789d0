"""Sources of the C functions around the kernels of effects: build what a kernel takes, call it, store what it returns."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from sma_sim.model.effects.effect import Effect
from sma_sim.model.effects.meaning import FUNCTIONS
from sma_sim.model.effects.ports import CHANNELS, S_CHANNEL, S_J, S_POSE, S_T, S_T_E, S_WIRE
from sma_sim.model.effects.scope import FORM_PORTS, FORM_SIZE, MASK_COORDINATE, MASK_FIELD, MASK_SIZE, MASK_WIRE
from sma_sim.model.structures.structure import Structure

OWN = 'own'  # what kernels call the parameter of their channel


class KernelTypes(NamedTuple):
    """What the kernels of an effect take: named tuples, and the structure with the coordinates in which it acts.

    `by_hand` is whether the structure's stiffness returns a single number.
    """

    state: Any
    constants: Any
    structure: Structure
    acting: tuple[int, ...] = ()

    @property
    def coordinates(self) -> int:
        """How many coordinates the state has."""
        return len(self.structure.coordinates)


class OneKernel(NamedTuple):
    """A kernel of an effect, in its role: how many numbers it returns, and whether it takes the extra states."""

    role: str
    python: Callable[..., Any]
    outputs: int
    memory: bool


def functions_of(effect: Effect) -> tuple[str, ...]:
    """The functions of a structure that the kernel of an effect takes; it is then of all coordinates at once."""
    return tuple(name for name in FUNCTIONS if name in effect.needs)


def parameter_fields(effect: Effect) -> list[str]:
    """Names of the parameters as kernels read them."""
    return list(parameter_entries(effect, effect.structure))


def parameter_entries(effect: Effect, structure: Structure) -> dict[str, str]:
    """Expressions of the parameters by the names by which kernels read them: of those of the channel, and of the bundle."""
    place = {p.name: f'p_[{k}]' for k, p in enumerate(effect.parameters)}
    found = {OWN: parameter_of_channel(effect, structure)} if effect.by_channel else {}
    numbered = {f'{p.name}_{i}' for p, *_ in effect.each_bundle for i in range(1, structure.wires + 1)}
    found |= {p.name: place[p.name] for p in effect.shared_parameters if p.name not in numbered}
    found |= {p.name: f'{p.neutral!r}' for p in effect.in_space if p.name not in place}
    for p, *_ in effect.each_bundle:
        expression = place.get(p.name, f'{p.neutral!r}')
        for i in range(1, structure.wires + 1):
            if f'{p.name}_{i}' in place:
                expression = f'{place[f"{p.name}_{i}"]} if s_[{S_WIRE}] == {float(i - 1)!r} else {expression}'
        found[p.name] = f'({expression})'
    return found


def wrapper_text(effect: Effect, one: OneKernel, kinds: KernelTypes, is_tuple: bool) -> str:
    """Source of the C function of an effect that names what it reads."""
    role, _, outputs, memory = one
    count = len(effect.parameters)
    groups = [('s', 'State', len(kinds.state._fields)), ('w', 'Constants', len(kinds.constants._fields))]
    groups.append(('p', 'Parameters', count))
    if memory:
        groups.append(('m', 'Memory', len(effect.states)))
    sizes = {letter: size for letter, _, size in groups} | {'p': count + MASK_SIZE + FORM_SIZE}
    lines = [f'def {effect.name}_{role}(s, w, p, m, out):', f'    out_ = carray(out, {max(outputs, 1)})']
    lines += [f'    {letter}_ = carray({letter}, {sizes[letter]})' for letter, _, _ in groups]
    lines += elsewhere_lines(effect, role, outputs)
    entries = {letter: [f'{letter}_[{i}]' for i in range(size)] for letter, _, size in groups}
    entries['p'] = list(parameter_entries(effect, kinds.structure).values())
    if effect.port == 'structure_force':
        lines += mask_lines(count, range(kinds.coordinates))
        for j in range(2 * kinds.coordinates):
            entries['s'][S_POSE + j] += f' * k_{j % kinds.coordinates}'
    lines += [f'    {letter}__ = {kind}({", ".join(entries[letter])})' for letter, kind, _ in groups]
    lines.append(f'    result = kernel({", ".join(f"{letter}__" for letter, _, _ in groups)})')
    values = [f'result[{i}]' for i in range(outputs)] if is_tuple else ['result'] + ['0.0'] * (outputs - 1)
    if effect.port in FORM_PORTS and role == 'value':
        lines += form_lines(count, f's_[int(f)] - (s_[{S_T_E}] if f == {S_T}.0 else 0.0)')
        values = [value if value == '0.0' else f'{value} * g' for value in values]
    if effect.port == 'structure_force' and role == 'value':
        values = [f'{value} * k_{j}' for j, value in enumerate(values)]
    return '\n'.join([*lines, *(f'    out_[{i}] = {value}' for i, value in enumerate(values))]) + '\n'


def form_lines(parameters: int, field: str) -> list[str]:
    """Lines that find the multiple `g` of a law, 1.0 where it has no other form; `field`: what that depends on."""
    at = [f'p_[{parameters + MASK_SIZE + k}]' for k in range(FORM_SIZE)]
    return [
        f'    f = p_[{parameters + MASK_FIELD}]',
        '    g = 1.0',
        '    if f >= 0.0:',
        f'        r = ({field}) / {at[2]}',
        f'        g = math.exp({at[0]} * math.tanh(r) + {at[1]} * r * r / (1.0 + r * r))',
    ]


def mask_lines(parameters: int, coordinates: Sequence[int]) -> list[str]:
    """Lines that say whether the effect acts in each coordinate, 1.0 or 0.0."""
    at = f'p_[{parameters + MASK_COORDINATE}]'
    return [f'    k_{j} = 1.0 if {at} < 0.0 or {at} == {float(j)!r} else 0.0' for j in coordinates]


def elsewhere_lines(effect: Effect, role: str, outputs: int) -> list[str]:
    """Lines that return nothing (on actuation: the value as it is) for a wire in which the effect does not act."""
    if effect.port in ('structure_force', 'sensing'):
        return []
    wire = f'p_[{len(effect.parameters) + MASK_WIRE}]'
    passed = f's_[{S_J}]' if effect.port == 'actuation' and role == 'value' else '0.0'
    nothing = [f'        out_[{i}] = {passed}' for i in range(outputs)]
    return [f'    if {wire} >= 0.0 and {wire} != s_[{S_WIRE}]:', *nothing, '        return']


def parameter_of_channel(effect: Effect, structure: Structure) -> str:
    """Expression of the parameter of the channel."""
    codes = {name: float(CHANNELS.index(name)) for name in CHANNELS}
    codes |= {name: float(len(CHANNELS) + k) for k, name in enumerate(structure.channels) if name not in CHANNELS}
    place = {p.name: k for k, p in enumerate(effect.parameters)}
    own = [(codes[name], place[p.name]) for name in codes if (p := effect.of_channel(name)) is not None]
    expression = f'p_[{own[-1][1]}]'
    for code, k in own[-2::-1]:
        expression = f'p_[{k}] if s_[{S_CHANNEL}] == {code!r} else {expression}'
    return f'({expression})'


def force_text(effect: Effect, one: OneKernel, kinds: KernelTypes, is_tuple: bool) -> str:
    """Source of the C function of an effect that says what it needs of a structure: all coordinates at once, or each."""
    n, acting, parameters = kinds.coordinates, kinds.acting, len(effect.parameters)
    states, count = len(effect.states), n if one.role == 'value' else len(effect.states) * len(kinds.acting)
    constants = len(kinds.constants._fields)
    lines = [
        f'def {effect.name}_{one.role}(s, w, p, m, out):',
        f'    out_ = carray(out, {max(count, 1)})',
        f'    s_, w_ = carray(s, {S_POSE + 2 * n}), carray(w, {constants})',
        f'    p_, m_ = carray(p, {parameters + MASK_SIZE + FORM_SIZE}), carray(m, {max(1, states * len(acting))})',
        f'    w__ = Constants({", ".join(f"w_[{i}]" for i in range(constants))})',
        f'    p__ = Parameters({", ".join(parameter_entries(effect, kinds.structure).values())})',
        *mask_lines(parameters, range(n)),
    ]
    if one.role == 'value' and functions_of(effect):
        lines += whole_lines(effect, one, kinds, is_tuple)
    else:
        lines += each_lines(effect, one, kinds, is_tuple)
    return '\n'.join(lines) + '\n'


def whole_lines(effect: Effect, one: OneKernel, kinds: KernelTypes, is_tuple: bool) -> list[str]:
    """Lines that call a kernel of all coordinates at once, of segments in series for each segment."""
    n, states = kinds.coordinates, len(effect.states)
    place, together = {j: i for i, j in enumerate(kinds.acting)}, len(part_of(kinds.structure).coordinates)
    given = ['s__', 'w__', 'p__', *(['m__'] if one.memory else []), *functions_of(effect)]
    lines = []
    for begin in range(0, n, together):
        part = range(begin, begin + together)
        q, dq = (', '.join(f's_[{S_POSE + first + j}] * k_{j}' for j in part) + ',' for first in (0, n))
        memory = [
            ', '.join(f'm_[{place[j] * states + k}]' if j in place else '0.0' for j in part) + ',' for k in range(states)
        ]
        pose = f'Pose({q})'
        if of_series(effect, kinds.structure):
            pose = f'Place({begin // together}, s_[{S_POSE}:{S_POSE + n}].reshape(({n // together}, {together})))'
        lines += [
            f'    s__ = State({wire_fields()}, {pose}, Pose({dq}))',
            *([f'    m__ = Memory({", ".join(f"Pose({each})" for each in memory)})'] if one.memory else []),
            f'    result = kernel({", ".join(given)})',
            *(f'    out_[{j}] = result{f"[{j - begin}]" if is_tuple else ""} * k_{j}' for j in part),
        ]
    return lines


def of_series(effect: Effect, structure: Structure) -> bool:
    """Whether the kernel of an effect takes the weight of segments in series, which depends on all of them."""
    return structure.segment is not None and 'gravity' in effect.needs


def function_of(structure: Structure, name: str) -> Any:
    """A function of a structure that kernels take, of segments in series that of one, but for their weight."""
    return getattr(structure if name == 'gravity' else part_of(structure), name)


def part_of(structure: Structure) -> Structure:
    """Of what the functions of a structure are: of a segment, where there are several in series."""
    return structure.segment or structure


def each_lines(effect: Effect, one: OneKernel, kinds: KernelTypes, is_tuple: bool) -> list[str]:
    """Lines that call a kernel of one coordinate, for each in which the effect acts."""
    n, states, sprung = kinds.coordinates, len(effect.states), 'spring' in effect.needs
    lines = spring_lines(kinds) if sprung else []
    if one.role == 'value':
        lines += [f'    out_[{j}] = 0.0' for j in range(n) if j not in kinds.acting]
    for i, j in enumerate(kinds.acting):
        fields = [f's_[{S_POSE + j}] * k_{j}', f's_[{S_POSE + n + j}] * k_{j}', *([f'f_{j}', f'c_{j}'] if sprung else [])]
        memory = ', '.join(f'm_[{i * states + k}]' for k in range(states)) + ','
        given = [f's_{j}__', 'w__', 'p__', *([f'Memory({memory})'] if one.memory else [])]
        lines += [f'    s_{j}__ = State({wire_fields()}, {", ".join(fields)})', f'    r_{j} = kernel({", ".join(given)})']
        if one.role == 'value':
            lines += form_lines(len(effect.parameters), f's_[{S_POSE + j}] if f == {S_POSE}.0 else s_[{S_POSE + n + j}]')
            lines.append(f'    out_[{j}] = r_{j} * k_{j} * g')
        else:
            lines += [f'    out_[{i * states + k}] = r_{j}{f"[{k}]" if is_tuple else ""}' for k in range(states)]
    return lines


def spring_lines(kinds: KernelTypes) -> list[str]:
    """Lines that find the force of the spring of each coordinate, and its stiffness as a difference."""
    n, structure = len(part_of(kinds.structure).coordinates), kinds.structure
    lines = []
    for j in kinds.acting:
        h, k = structure.coordinates[j].size(structure.default_constants), j % n
        here = [f's_[{S_POSE + j - k + i}]' for i in range(n)]
        at = [', '.join(pose) for pose in (here, [*here[:k], f'{here[k]} + {h!r}', *here[k + 1 :]])]
        index = f'[{k}]' if n > 1 else ''
        lines += [
            f'    f_{j} = stiffness(Pose({at[0]}), w__, 1.0){index}',
            f'    c_{j} = (stiffness(Pose({at[1]}), w__, 1.0){index} - f_{j}) / {h!r}',
        ]
    return lines


def wire_fields() -> str:
    """The entries of the state before those of the coordinates."""
    return ', '.join(f's_[{i}]' for i in range(S_POSE))
