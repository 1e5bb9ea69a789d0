"""What a structure is: one small file that declares it.

A structure is what wires pull on: its coordinates, its inertia, its own forces, and how long each wire is in every pose.
"""

from __future__ import annotations

import math
import re
from collections import namedtuple
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sma_sim.model.argument_checks import check_fields, expect
from sma_sim.model.errors import UserError
from sma_sim.model.parameters import INITIAL_PARAMETERS, KELVIN, Parameter, initial_fraction
from sma_sim.model.program_parameters import DEFAULTS
from sma_sim.model.renamed import itself
from sma_sim.model.structures.links import AXES, Drawing, LinkTree

Constants = Any  # a named tuple of numbers, the structure's own
UNITS_WITHOUT_SUFFIX = ('-', '')
COUPLED = 1e-9  # part of its own stiffness above which a coordinate is coupled to another
CONTROL, TEMPERATURE = 'bench.control', 'bench.temperature'  # options
BALANCE: Mapping[str, str] = MappingProxyType({TEMPERATURE: 'balance'})
TEMPERATURE_OF_WIRE = re.compile(r'T_\d+_K')
CHECK_PAGE = 'docs/reference/model-check.md'
CHANNEL_NOISE = {  # of usual sensors
    'F': (0.05, 'N'),
    'T': (1.0, 'K'),
    'stress': (1e6, 'Pa'),
    'strain': (1e-5, '-'),
    'R': (0.01, 'ohm'),
}
NOISE_PART = 1e-2  # of the noise of a coordinate in its usual change
WIRE_STATES = (('x_M', ''), ('mode', ''), ('T', '_K'))  # of every wire, sampled after the sensor channels; with their unit
MAX_WIRES = 29  # whose part in the flow is told by bits of one number (model.system)


class Place(NamedTuple):
    """A segment in a series: its number `k`, from 0 on, and the coordinates `Q` (segments, coordinates of one) of all."""

    k: int
    Q: NDArray[np.float64]


class NamedEffect(NamedTuple):
    """What a sentence calls an effect on a structure, and by which of the structure's parameters (full names) those of the
    effect go there."""

    title: str
    parameters: Mapping[str, str]


@dataclass(frozen=True)
class Coordinate:
    """A generalised coordinate of a structure.

    Attributes
    ----------
    name, unit, description : str
        What it is; its column in files is ``name_unit``.
    scale : float or callable
        A usual change of it, in its unit; a callable takes the structure's constants.
    rate_scale : callable, optional
        A usual change of its rate; without it, that of an undamped vibration by `scale`.
    sensor_scale : float, optional
        A usual change of what its sensor shows (default `scale`).
    limit : float
        Beyond it the structure has lost its stability.
    motion : str
        One word for a change of it, such as ``'rotation'`` (default its name).
    joint : bool
        Whether a joint or a rail guides it, in which there may be friction and play.
    axis : str
        In pictures: ``'x'``, ``'y'`` or ``'z'``, along which it moves or about which it turns. Without it, coordinates in
        m are along x, y, z and those in rad about z, y, x, in their order.
    force : str
        What a sentence calls a generalised force on it (default: force along it, or moment about it).
    small_force : float
        A small but visible generalised force on it; without it, a part of what wires and springs exert.
    law : str
        The coordinate on which an unknown force on it most likely depends (default itself).
    """

    name: str
    unit: str
    scale: float | Callable[[Constants], float]
    description: str = ''
    rate_scale: Callable[[Constants], float] | None = None
    sensor_scale: float | None = None
    limit: float = math.inf
    motion: str = ''
    joint: bool = True
    axis: str = ''
    force: str = ''
    small_force: float = 0.0
    law: str = ''

    def __post_init__(self) -> None:
        expect('coordinate, name', self.name, str)
        check_fields(self, f'coordinate {self.name!r}, ')
        if self.axis and self.axis not in AXES:
            raise UserError(f'coordinate {self.name!r}: expected an axis x, y or z, got {self.axis!r}')
        if not self.limit > 0.0:
            raise UserError(f'coordinate {self.name!r}: limit = {self.limit:g} {self.unit}; expected more than 0')

    @property
    def column(self) -> str:
        """Its column in files."""
        return self.name if self.unit in UNITS_WITHOUT_SUFFIX else f'{self.name}_{self.unit}'

    def sensor_size(self, constants: Constants) -> float:
        """The usual change of what its sensor shows."""
        return self.sensor_scale or self.size(constants)

    def size(self, constants: Constants) -> float:
        """The usual change, of a structure with these constants."""
        return float(self.scale(constants) if callable(self.scale) else self.scale)


@dataclass(frozen=True)
class Drive:
    """What is imposed on a structure beside heating, such as the strain of a wire on a test bench; linear between rows.

    A set point of the node beyond `bounds` is refused.
    """

    name: str
    unit: str
    description: str = ''
    bounds: tuple[float, float] = (-math.inf, math.inf)

    @property
    def column(self) -> str:
        """Its column in files."""
        return self.name if self.unit in UNITS_WITHOUT_SUFFIX else f'{self.name}_{self.unit}'


@dataclass(frozen=True, repr=False)
class Structure:
    """A structure, declared as data.

    Attributes
    ----------
    name, title : str
        The system's name, and what a sentence calls it.
    coordinates : tuple of Coordinate
        Generalised coordinates q; none for a wire whose strain is imposed.
    wires : int
        Bundles of wires; all are of the same alloy, ``wire.n`` wires in each.
    lengths : callable
        ``lengths(q, p)`` returns the length [m] of every wire, as a float or a tuple; `q` has the coordinates by name, `p`
        the constants.
    forces : callable
        ``forces(q, v, p)`` returns the generalised force of all but the wires on every coordinate [N or N m]: springs,
        damping, weight. `v` has the rates by the names of the coordinates. Where more than temperatures is imposed it is
        ``forces(q, v, p, u)``.
    inertia : callable
        ``inertia(p)`` returns the inertia of every coordinate [kg or kg m^2].
    gradients : callable, optional
        ``gradients(q, p)`` returns dl/dq, wire by wire, in one tuple; without it central differences of sixth order.
    strain : callable, optional
        ``strain(l, p)`` returns the equivalent strain of a wire whose ends are `l` [m] apart, and l0 times its derivative in
        `l`: of one that is wound to a coil, which is twisted. Its force is then n Om sigma deps/dl, by virtual work. Without
        it wires are straight: l/l0 - 1, and 1.
    stiffness : callable, optional
        ``stiffness(q, p, part)`` returns the generalised forces K q that hold against the springs, of which a `part` of the
        stiffness is there (1: as in `forces`). Effects such as creep act where it is declared.
    gravity : callable, optional
        ``gravity(q, p, g_x, g_y, g_z)`` returns the generalised forces of the weight in a gravity with these components
        [m/s^2], for a structure whose `forces` leave it out. Of segments in series those on one of them: `q` is then a
        `Place`.
    accelerations : callable, optional
        ``accelerations(q, v, f, p)`` from the generalised forces `f`, in place of f over `inertia`. Of segments in series
        ``accelerations(k, q, v, f, p)`` returns those of segment `k`, from 0 on; `q`, `v` and `f` are arrays (segments,
        coordinates of one). It may depend on the rates of all segments before it, and for the rest on its neighbours only.
    parameters : tuple of Parameter
        The structure's parameters. A name without a point belongs to the group with the system's name.
    constants : callable, optional
        From the values by full name to the named tuple `p`; without it `p` has the parameters by name.
    antagonistic : bool
        One command J_eq for two wires: positive heats wire 1, negative wire 2. Else one command for each wire. Of segments
        in series one command for each segment.
    drives : tuple of Drive
        What is imposed beside heating.
    size_parameter : str
        Full name of the parameter that `wire.l0` has to fit, named where wires are far too long or too short.
    fitted : tuple of str
        Full names of what a fit changes beside the material when nothing else is asked for.
    defaults : mapping
        Values by full name in place of the package's own defaults.
    links : callable, optional
        From values by full name to the tree of links, which URDF and TF show; without it, one joint after another.
    drawing : Drawing, optional
        Where the wires are in a pose, for pictures and TF; without it, side by side, as long as they are.
    energy : callable, optional
        ``energy(q, v, p)`` is the kinetic and potential energy [J]; at rest `forces` are its negative slope.
    segment : Structure, optional
        One of the equal segments of a structure in series (`structures.series`); lengths, gradients and forces that are
        compiled are this one's.
    system, size_name : str
        Of a structure whose size is a parameter: the system's name, which differs from `name` where the size is not the
        default one, and the full name of that parameter.
    of_size : callable, optional
        From the value of that parameter, a whole number, to the structure.
    named_effects : mapping
        By the name of an effect that the structure's own parameters describe, a `NamedEffect`.
    options : mapping
        Words by the name of a parameter, such as ``bench.control: strain``, by which this structure is chosen among its
        `variants`.
    variants : tuple of Structure
        What the structure becomes with other options; without any, `at_imposed_temperature`.
    variant_of : str
        Of a variant, the name of the system whose variant it is.
    description, source : str
        Remarks, and where the equations come from.
    files : tuple of Path
        Not for structure files: those that its native code depends on, beside the package's own.
    """

    name: str
    title: str
    coordinates: tuple[Coordinate, ...]
    wires: int
    lengths: Callable[..., Any] | None = None
    forces: Callable[..., Any] | None = None
    inertia: Callable[..., Any] | None = None
    gradients: Callable[..., Any] | None = None
    strain: Callable[..., Any] | None = None
    stiffness: Callable[..., Any] | None = None
    gravity: Callable[..., Any] | None = None
    accelerations: Callable[..., Any] | None = None
    parameters: tuple[Parameter, ...] = ()
    constants: Callable[[Mapping[str, float]], Constants] | None = None
    antagonistic: bool = False
    drives: tuple[Drive, ...] = ()
    size_parameter: str = ''
    fitted: tuple[str, ...] = ()
    defaults: Mapping[str, float] = field(default_factory=dict)
    links: Callable[[Mapping[str, float]], LinkTree] | None = None
    drawing: Drawing | None = None
    energy: Callable[..., Any] | None = None
    segment: Structure | None = None
    system: str = ''
    size_name: str = ''
    of_size: Callable[[int], Structure] | None = None
    named_effects: Mapping[str, NamedEffect] = field(default_factory=dict)
    options: Mapping[str, str] = field(default_factory=lambda: BALANCE)
    variants: tuple[Structure, ...] = ()
    variant_of: str = ''
    description: str = ''
    source: str = ''
    files: tuple[Path, ...] = field(default=(), compare=False)
    structure = itself('structure')

    def __post_init__(self) -> None:
        expect('name', self.name, str)
        check_fields(self, f'structure {self.name!r}, ')
        if self.coordinates and not (self.lengths and self.forces and (self.inertia or self.accelerations)):
            raise UserError(f'structure {self.name!r}: coordinates need lengths, forces and inertia')
        if self.antagonistic and self.wires != 2 * self.segments:
            raise UserError(f'structure {self.name!r}: antagonistic heating is of 2 wires, got {self.wires}')
        if self.segment and (self.loads or not self.accelerations):
            raise UserError(f'structure {self.name!r}: segments in series need accelerations; only temperatures are imposed')
        if not 1 <= self.wires <= MAX_WIRES:
            raise UserError(f'structure {self.name!r}: expected 1 to {MAX_WIRES} wires, got {self.wires}')

    def __deepcopy__(self, memo: Any) -> Structure:
        return self  # nothing of it changes

    def __repr__(self) -> str:
        return f'Structure({self.name}: {", ".join(self.channel_columns)})'

    def __hash__(self) -> int:
        """Of what tells structures apart nearly always: it is asked for with every model."""
        return hash(self.name)

    @cached_property
    def declared(self) -> dict[str, Parameter]:
        """The structure's parameters by full name; those that say no source have the structure's."""
        known = (replace(p, source=p.source or self.source) for p in self.parameters)
        return {p.name if '.' in p.name else f'{self.original}.{p.name}': p for p in known}

    @property
    def family(self) -> str:
        """The name of the system, whatever its size."""
        return self.system or self.name

    @property
    def original(self) -> str:
        """The name of the system whose variant it is; its own, of one that is no variant."""
        return self.variant_of or self.family

    def is_like(self, other: Structure) -> bool:
        """Whether both are one structure, perhaps with different options."""
        return self.original == other.original and self.wires == other.wires

    @cached_property
    def family_members(self) -> tuple[Structure, ...]:
        """The structure itself and its variants; where it declares none, the one whose wires have imposed temperatures."""
        if self.variants or self.variant_of:
            return (self, *(replace(variant, files=self.files) for variant in self.variants))
        return self, at_imposed_temperature(self)

    @cached_property
    def segments(self) -> int:
        """How many equal segments are in series."""
        return len(self.coordinates) // len(self.segment.coordinates) if self.segment else 1

    @cached_property
    def initial(self) -> tuple[Parameter, ...]:
        """x_M at the start of the wires beyond the second."""
        return in_group('initial', (initial_fraction(i) for i in range(len(INITIAL_PARAMETERS) + 1, self.wires + 1)))

    @cached_property
    def constants_before_noise(self) -> Constants:
        """The constants at the default values, of which the noise of channels follows."""
        values = {name: parameter.default for name, parameter in (dict(DEFAULTS) | self.declared).items()}
        return self.constants_of(values | dict(self.defaults))

    @cached_property
    def noise(self) -> dict[str, Parameter]:
        """The noise of channels for the live check, by full name, beside that of channels that the module has too."""
        constants, found = self.constants_before_noise, dict(CHANNEL_NOISE)
        for coordinate in self.coordinates:
            usual = coordinate.sensor_scale or coordinate.size(constants)
            found[coordinate.name] = (float(f'{NOISE_PART * usual:.1g}'), coordinate.unit)
        known = {
            channel: found.get(channel) or found.get(channel.partition('_')[0], (1.0, '-')) for channel in self.channels
        }
        noise = {
            f'check.noise_{channel}': Parameter(
                f'noise_{channel}',
                std,
                unit,
                (1e-15, 1e12),
                f'standard deviation of the noise of {channel}',
                source=CHECK_PAGE,
            )
            for channel, (std, unit) in known.items()
        }
        return {name: parameter for name, parameter in noise.items() if name not in DEFAULTS}

    @property
    def all_parameters(self) -> dict[str, Parameter]:
        """All parameters of a model with this structure, by full name."""
        initial = {parameter.name: parameter for parameter in self.initial}
        return dict(DEFAULTS) | initial | self.declared | self.noise

    @property
    def default_values(self) -> dict[str, float]:
        """Their default values."""
        return {name: parameter.default for name, parameter in self.all_parameters.items()} | dict(self.defaults)

    @cached_property
    def default_constants(self) -> Constants:
        """The constants at the default values."""
        return self.constants_of(self.default_values)

    def strains(self, lengths: Iterable[float], values: Mapping[str, float]) -> list[tuple[float, float]]:
        """Strain of wires of these lengths [m], and l0 times its derivative, with parameters `values` by full name."""
        if self.strain is None:
            return [(length / values['wire.l0'] - 1.0, 1.0) for length in lengths]
        constants = self.constants_of(values)
        return [self.strain(length, constants) for length in lengths]

    @cached_property
    def sprung(self) -> tuple[int, ...]:
        """The coordinates that a spring of their own holds: K q there depends on nothing else, and nothing else on them."""
        n, constants, stiffness = len(self.coordinates), self.default_constants, self.stiffness
        if stiffness is None:
            return ()
        pose, sizes = record('Pose', self.coordinate_names), [c.size(constants) for c in self.coordinates]
        rest = numbers(stiffness(pose(*[0.0] * n), constants, 1.0))
        moved = [numbers(stiffness(pose(*(s * (j == k) for k, s in enumerate(sizes))), constants, 1.0)) for j in range(n)]
        work = [[abs(moved[j][i] - rest[i]) * sizes[i] for j in range(n)] for i in range(n)]  # symmetric, as K is
        return tuple(
            j for j in range(n) if work[j][j] > 0.0 and all(work[i][j] <= COUPLED * work[j][j] for i in range(n) if i != j)
        )

    def weight(self, g_x: float, g_y: float, g_z: float) -> tuple[float, ...]:
        """Generalised forces of the weight in this gravity [m/s^2], each coordinate at its usual change; () without any."""
        if self.gravity is None:
            return ()
        constants = self.default_constants
        sizes = [coordinate.size(constants) for coordinate in self.coordinates]
        if self.segment is None:
            return numbers(self.gravity(record('Pose', self.coordinate_names)(*sizes), constants, g_x, g_y, g_z))
        Q = np.reshape(sizes, (self.segments, -1))
        return tuple(f for k in range(self.segments) for f in self.gravity(Place(k, Q), constants, g_x, g_y, g_z))

    @property
    def coordinate_names(self) -> tuple[str, ...]:
        """Names of the coordinates."""
        return tuple(coordinate.name for coordinate in self.coordinates)

    def constants_of(self, values: Mapping[str, float]) -> Constants:
        """The constants that the kernels read, from values by full name."""
        if self.constants is not None:
            return self.constants(values)
        names = [name.rpartition('.')[2] for name in self.declared]
        return record('Constants', names)(*(float(values[name]) for name in self.declared))

    @cached_property
    def commands(self) -> tuple[str, ...]:
        """Names of the heating commands, in the order of the input."""
        if self.antagonistic:
            return tuple(f'J_eq_{k + 1}' for k in range(self.segments)) if self.segment else ('J_eq',)
        return ('J',) if self.wires == 1 else tuple(f'J_{i + 1}' for i in range(self.wires))

    @cached_property
    def input_columns(self) -> tuple[str, ...]:
        """Columns of the input in files: drives, heating, ambient temperature."""
        return (*(drive.column for drive in self.drives), *(f'{name}_W' for name in self.commands), 'T_E_K')

    @property
    def needed_columns(self) -> tuple[str, ...]:
        """Columns of the input that every recording has: what is imposed; without that, the heating."""
        columns = self.input_columns
        return columns[: len(self.drives) or len(self.commands)]

    @property
    def has_one_command(self) -> bool:
        """Whether a single heating command is all that moves it."""
        return len(self.commands) == 1 and not self.drives

    @cached_property
    def imposed_temperature(self) -> int:
        """Number of the drive that imposes the temperature of wire 1, before those of all others; -1: a heat balance."""
        names, first = [drive.name for drive in self.drives], f'T{self.wire_suffixes[0]}'
        return names.index(first) if first in names else -1

    @property
    def loads(self) -> tuple[Drive, ...]:
        """What is imposed, but for temperatures."""
        first = self.imposed_temperature
        return self.drives if first < 0 else (*self.drives[:first], *self.drives[first + self.wires :])

    @property
    def has_own_columns(self) -> bool:
        """Whether columns of a file can tell it: not where temperatures alone are imposed, which others have as sensors."""
        return not self.drives or bool(self.loads)

    @property
    def is_quasi_static(self) -> bool:
        """Whether both stress and temperature of the wires are imposed, as in an isobaric test, whose time says nothing."""
        return self.imposed_temperature >= 0 and any(drive.name == 'stress' for drive in self.drives)

    @cached_property
    def wire_suffixes(self) -> tuple[str, ...]:
        """What the names of channels and columns of each wire end with: its number, where there are several."""
        return ('',) if self.wires == 1 else tuple(f'_{i}' for i in range(1, self.wires + 1))

    @cached_property
    def _channels(self) -> tuple[tuple[str, str], ...]:
        """The channels with their columns; a temperature that is imposed is none."""
        forces = [(f'F{suffix}', f'F{suffix}_N') for suffix in self.wire_suffixes]
        shown = [(c.name, c.column) for c in self.coordinates] + forces if self.coordinates else [('stress', 'stress_Pa')]
        temperatures = [(f'T{suffix}', f'T{suffix}_K') for suffix in self.wire_suffixes]
        resistances = [(f'R{suffix}', f'R{suffix}_ohm') for suffix in self.wire_suffixes]
        return (*shown, *(temperatures if self.imposed_temperature < 0 else ()), *resistances)

    @property
    def resistance_columns(self) -> tuple[str, ...]:
        """Columns of the resistances of the wires."""
        return self.channel_columns[-self.wires :]

    @cached_property
    def channels(self) -> tuple[str, ...]:
        """What sensors can show: the coordinates; force, temperature and electrical resistance of every wire."""
        return tuple(name for name, _ in self._channels)

    @cached_property
    def channel_columns(self) -> tuple[str, ...]:
        """Columns of the channels in files."""
        return tuple(column for _, column in self._channels)

    @cached_property
    def sampled_columns(self) -> tuple[str, ...]:
        """Columns of all that is sampled: the channels, then WIRE_STATES of the wires."""
        states = (f'{name}{suffix}{unit}' for name, unit in WIRE_STATES for suffix in self.wire_suffixes)
        return (*self.channel_columns, *states)


def at_imposed_temperature(structure: Structure, description: str = '') -> Structure:
    """The same structure with wires whose temperatures are measured or set, as in a furnace or a bath: columns T_K, or
    T_1_K, T_2_K, ..."""
    of_size = structure.of_size
    drives = tuple(
        Drive(f'T{suffix}', 'K', f'temperature of wire{suffix.replace("_", " ")}', KELVIN)
        for suffix in structure.wire_suffixes
    )
    return replace(
        structure,
        name=f'{structure.name}_at_T',
        drives=(*structure.drives, *drives),
        variant_of=structure.original,
        options={**structure.options, TEMPERATURE: 'prescribed'},
        variants=(),
        system=structure.system and f'{structure.system}_at_T',
        of_size=None if of_size is None else lambda size: at_imposed_temperature(of_size(size)),
        description=description or f'wires whose temperature is measured or set; {structure.description}'.removesuffix('; '),
    )


def shared_temperature(columns: Iterable[str], present: Collection[str]) -> dict[str, str]:
    """By column of a wire's imposed temperature that is not `present`: T_K, where that is, one temperature of all wires."""
    numbered = (column for column in columns if TEMPERATURE_OF_WIRE.fullmatch(column) and column not in present)
    return dict.fromkeys(numbered, 'T_K') if 'T_K' in present else {}


def in_group(group: str, parameters: Iterable[Parameter]) -> tuple[Parameter, ...]:
    """The parameters under the names that they have in a group."""
    return tuple(replace(parameter, name=f'{group}.{parameter.name}') for parameter in parameters)


def record(name: str, fields: Sequence[str]) -> Any:
    """A named tuple type whose fields are known only now; the same one for the same fields."""
    return _record(name, tuple(fields))


@lru_cache(1024)
def _record(name: str, fields: tuple[str, ...]) -> Any:
    return namedtuple(name, fields)


def numbers(value: Any) -> tuple[float, ...]:
    """What a kernel returned, a tuple or a single number."""
    return value if isinstance(value, tuple) else (value,)
