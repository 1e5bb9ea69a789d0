"""Every parameter of the model: its default, unit, range and source.

The names are those of the YAML file, of ``--set`` and of the ROS parameters. `WireConstants` and
`BeamConstants` are what the equations read: the same numbers, with derived quantities beside them.
"""

from __future__ import annotations

import keyword
import math
import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace
from numbers import Real
from typing import NamedTuple

from sma_sim.model.materials import SPECIFIC_HEAT, usual_cooling, usual_range

PAPER = 'Mandolino, Ferrante and Rizzello, RA-L 2021, section IV'
RESISTIVITY = 'usual NiTi actuator wires; law: Furst and Seelecke, J. Intell. Mater. Syst. Struct. 23 (2012) 1233'
ZERO_CELSIUS = 273.15  # [K]
KELVIN = (150.0, 2000.0)  # [K] of what is near a wire: smaller numbers are degrees Celsius
DENSITIES = (5e3, 1.1e4)  # [kg/m^3] of shape-memory alloys, from those of titanium and niobium to those with platinum
COOLING = usual_cooling(1e-3)[0], usual_cooling(25e-6)[1]  # [W/(m^2 K)] of the thickest and the thinnest wires
LOADS = (1e6, 1e9)  # [Pa] at which wires transform: less moves nothing, more breaks them
SIZES, MASSES = (1e-3, 0.1), (1e-3, 0.1)  # [m], [kg] of parts and loads that bundles of thin wires move
QUANTITIES = ('', 'force', 'rate', 'change', '1/change^2', 'instant')  # of effects, as `Parameter.quantity`
K_B = 1.380649e-23  # Boltzmann constant [J/K], exact by definition of the SI


@dataclass(frozen=True)
class Parameter:
    """One number of the model.

    Attributes
    ----------
    name, unit, description, source : str
        What it is, and where its default comes from.
    default : float
        Value in SI units.
    bounds : tuple of float
        Hard limits; beyond them the equations lose their meaning.
    neutral : float or None
        For the parameter of an effect: the value at which the effect vanishes.
    realistic : tuple of float or None
        The range met in practice, by which a diagnosis judges whether a value is plausible.
    usual : tuple of float or None
        Of a parameter without a realistic range, what real robots have: a value far outside is asked for its unit.
    quantity : str
        For the parameter of an effect on any coordinate, what of it it is: ``'force'``, ``'rate'``, ``'change'`` or
        ``'1/change^2'``. The numbers are for the rotation of the paper's module; on another structure they are converted to
        the size and the unit of its coordinate. ``'instant'``: a time in a recording, whose starting values in a search are
        instants at which residuals change.
    """

    name: str
    default: float
    unit: str
    bounds: tuple[float, float]
    description: str
    source: str = ''
    neutral: float | None = None
    realistic: tuple[float, float] | None = None
    quantity: str = ''
    usual: tuple[float, float] | None = None


def declared_in(source: str, *parameters: Parameter) -> tuple[Parameter, ...]:
    """Parameters whose defaults come from the same source, but for those that say their own."""
    return tuple(replace(parameter, source=parameter.source or source) for parameter in parameters)


def fault_of(parameter: Parameter) -> str:
    """What is wrong with a declaration, '' for nothing."""
    if not isinstance(parameter, Parameter):
        return f'expected a Parameter among its parameters, got {parameter!r}'
    name, unit, bounds = parameter.name, parameter.unit, parameter.bounds
    if not (isinstance(name, str) and name.replace('.', '_').isidentifier()):
        return f'parameter {name!r}: expected a name of letters, digits and _'
    if keyword.iskeyword(name.rpartition('.')[2]):
        return f'parameter {name!r}: a word of Python, which no kernel could read; expected another one, such as {name}_'
    if not (isinstance(bounds, tuple) and len(bounds) == 2 and all(map(is_number, (parameter.default, *bounds)))):
        return f'parameter {name}: expected numbers, got default {parameter.default!r}, bounds {bounds!r}'
    if not (parameter.neutral is None or is_number(parameter.neutral)):
        return f'parameter {name}: expected a number, got neutral {parameter.neutral!r}'
    if not (unit and isinstance(unit, str)):
        return f"parameter {name}: expected a unit, such as 'N/m' ('-' for none), got {unit!r}"
    if parameter.quantity not in QUANTITIES:
        return f'parameter {name}: quantity {parameter.quantity!r}; expected one of {", ".join(filter(None, QUANTITIES))}'
    low, high = bounds
    ranges = {'bounds': bounds, 'realistic': parameter.realistic or bounds, 'usual': parameter.usual or bounds}
    for kind, ends in ranges.items():
        if not (isinstance(ends, tuple) and len(ends) == 2 and all(map(is_number, ends))):
            return f'parameter {name}: expected two numbers, got {kind} {ends!r}'
    for kind, (low_end, high_end) in ranges.items():
        if low_end > high_end:
            return f'parameter {name}: {kind} {low_end:g} to {high_end:g} {unit}; expected the lower end first'
    for kind, value in (('default', parameter.default), ('neutral', parameter.neutral)):
        if value is not None and not low <= value <= high:
            return f'parameter {name}: {kind} {value:g} {unit}; expected {low:g} to {high:g}'
    least, most = ranges['realistic']
    if not low <= least <= most <= high:
        return (
            f'parameter {name}: realistic {least:g} to {most:g} {unit}; expected a part of its bounds, {low:g} to {high:g}'
        )
    if not least <= parameter.default <= most and parameter.default != parameter.neutral:
        return f'parameter {name}: default {parameter.default:g} {unit}; expected a realistic one, {least:g} to {most:g}'
    return ''


def is_number(value: object) -> bool:
    """Whether a value is one number, and none that is too large for a float."""
    is_real = isinstance(value, Real) and not isinstance(value, bool)
    return is_real and not (isinstance(value, int) and abs(value) > sys.float_info.max)


WIRE_PARAMETERS = declared_in(
    PAPER,
    Parameter('E_A', 12.3e9, 'Pa', (1e8, 1e12), "Young's modulus of austenite", usual=usual_range('E_A')),
    Parameter('E_M', 7.8e9, 'Pa', (1e8, 1e12), "Young's modulus of martensite", usual=usual_range('E_M')),
    Parameter('eps_T', 0.067, '-', (1e-3, 0.3), 'transformation strain', usual=usual_range('eps_T')),
    Parameter(
        'sigma_T',
        2.13e6,
        'Pa/K',
        (0.0, 1e8),
        'slope of the transformation stresses over temperature',
        usual=usual_range('sigma_T'),
    ),
    Parameter('c_V', 380.0, 'J/(kg K)', (1.0, 1e5), 'specific heat', usual=SPECIFIC_HEAT),
    Parameter('lambda', 450.0, 'W/(m^2 K)', (0.0, 1e6), 'convective cooling coefficient', usual=COOLING),
    Parameter('sigma_MW0', 121.35e6, 'Pa', (0.0, 1e10), 'Maxwell stress sigma_MW at T0', usual=LOADS),
    Parameter('dsigma', 12.3e6, 'Pa', (1e3, 1e10), 'height of the stress-strain hysteresis', usual=usual_range('dsigma')),
    Parameter('T0', 323.0, 'K', KELVIN, 'reference temperature of sigma_MW0'),
    Parameter('r0', 75e-6, 'm', (1e-6, 1e-2), 'radius of one wire'),
    Parameter('l0', 95.7e-3, 'm', (1e-4, 10.0), 'undeformed length of a wire'),
    Parameter('rho', 7745.0, 'kg/m^3', (1.0, 1e5), 'density', usual=DENSITIES),
    Parameter('omega_x', 100.0, '1/s', (1e-3, 1e9), 'attempt frequency of the MAS kinetics'),
    Parameter('V_L', 5e-23, 'm^3', (1e-27, 1e-18), 'volume of a mesoscopic layer (MAS kinetics)'),
    Parameter('n', 10.0, '-', (1.0, 10000.0), 'wires in one bundle'),
    *declared_in(
        RESISTIVITY,
        Parameter('resistivity_A', 8.9e-7, 'ohm m', (1e-9, 1e-3), 'resistivity of austenite at 293.15 K'),
        Parameter('resistivity_M', 1.02e-6, 'ohm m', (1e-9, 1e-3), 'resistivity of oriented martensite at 293.15 K'),
        Parameter(
            'resistivity_T_A',
            2e-4,
            '1/K',
            (-0.01, 0.01),
            'its relative slope over temperature, austenite',
            realistic=(0.0, 1.5e-3),
        ),
        Parameter(
            'resistivity_T_M',
            3e-4,
            '1/K',
            (-0.01, 0.01),
            'its relative slope over temperature, martensite',
            realistic=(0.0, 2e-3),
        ),
    ),
)
BEAM_PARAMETERS = declared_in(
    PAPER,
    Parameter('L', 0.1, 'm', (1e-3, 10.0), 'length of the beam'),
    Parameter('E', 2e9, 'Pa', (1e5, 1e13), "Young's modulus of the beam"),
    Parameter('h', 2.5e-3, 'm', (1e-5, 1.0), 'radius of the beam: A = pi h^2, I = pi h^4/4'),
    Parameter('b_x', 2.0, 'N s/m', (0.0, 1e6), 'damping of U_x'),
    Parameter('b_y', 2.0, 'N s/m', (0.0, 1e6), 'damping of U_y'),
    Parameter('b_alpha', 2.0, 'N m s', (0.0, 1e6), 'damping of alpha'),
)
PLATE_PARAMETERS = declared_in(
    PAPER,
    Parameter('W', 10e-3, 'm', (1e-4, 10.0), 'width of the plate: distance of the two bundles', usual=SIZES),
    Parameter('m_H', 10e-3, 'kg', (1e-6, 1e4), 'mass of the plate', usual=MASSES),
)
ENVIRONMENT_PARAMETERS = declared_in(PAPER, Parameter('T_E', 298.0, 'K', KELVIN, 'ambient temperature'))


def initial_fraction(i: int) -> Parameter:
    """The declaration of x_M of wire `i` at the start, from 1 on."""
    return Parameter(
        f'x_M_{i}',
        math.nan,
        '-',
        (0.0, 1.0),
        f'martensite fraction of wire {i} at the start; NaN: sigma = sigma_A(T_E) in static equilibrium',
        source='the paper gives none; the wire was stretched from austenite',
    )


INITIAL_PARAMETERS = (initial_fraction(1), initial_fraction(2))  # those of further wires: Structure.initial
SOLVER_PARAMETERS = declared_in(
    'docs/explanation/solver.md',
    Parameter('rtol', 1e-5, '-', (1e-12, 1e-1), 'relative tolerance of a step'),
)

MODEL_GROUPS: Mapping[str, tuple[Parameter, ...]] = {
    'wire': WIRE_PARAMETERS,
    'beam': BEAM_PARAMETERS,
    'plate': PLATE_PARAMETERS,
    'environment': ENVIRONMENT_PARAMETERS,
    'initial': INITIAL_PARAMETERS,
    'solver': SOLVER_PARAMETERS,
}


class WireConstants(NamedTuple):
    """What the equations of one wire read, SI units."""

    E_A: float
    E_M: float
    eps_T: float
    sigma_T: float
    c_V: float
    lambda_: float
    sigma_MW0: float
    dsigma: float
    T0: float
    r0: float
    l0: float
    rho: float
    omega_x: float
    V_L: float
    n: float
    resistivity_A: float
    resistivity_M: float
    resistivity_T_A: float
    resistivity_T_M: float
    section: float  # pi r0^2 [m^2]
    surface: float  # A_s = 2 pi r0 l0 [m^2]
    volume: float  # Om = pi r0^2 l0 [m^3]
    d: float  # 1/E_M - 1/E_A [1/Pa]
    area: float  # the surface by its old name, which kernels may still read


class BeamConstants(NamedTuple):
    """What the equations of the structure read, SI units."""

    L: float
    W: float
    m_H: float
    J_H: float  # W^2 m_H/12 [kg m^2]
    k_x: float  # E A/L [N/m]
    k_y: float  # 12 E I/L^3 [N/m]
    k_ya: float  # 6 E I/L^2 [N]
    k_a: float  # 4 E I/L [N m]
    b_x: float
    b_y: float
    b_alpha: float


def wire_constants(values: Mapping[str, float]) -> WireConstants:
    """Wire constants from parameters named ``wire.*``."""
    given = {p.name: float(values[f'wire.{p.name}']) for p in WIRE_PARAMETERS}
    section, surface = math.pi * given['r0'] ** 2, 2.0 * math.pi * given['r0'] * given['l0']
    given['lambda_'] = given.pop('lambda')
    return WireConstants(
        **given,
        section=section,
        surface=surface,
        volume=section * given['l0'],
        d=1.0 / given['E_M'] - 1.0 / given['E_A'],
        area=surface,
    )


def beam_constants(values: Mapping[str, float]) -> BeamConstants:
    """Constants of the structure (paper, EB-Ba to EB-Bc) from parameters named ``beam.*`` and ``plate.*``."""
    L, E, h = (float(values[f'beam.{name}']) for name in ('L', 'E', 'h'))
    W, m_H = float(values['plate.W']), float(values['plate.m_H'])
    bending = E * math.pi * h**4 / 4.0
    return BeamConstants(
        L=L,
        W=W,
        m_H=m_H,
        J_H=W**2 * m_H / 12.0,
        k_x=E * math.pi * h**2 / L,
        k_y=12.0 * bending / L**3,
        k_ya=6.0 * bending / L**2,
        k_a=4.0 * bending / L,
        b_x=float(values['beam.b_x']),
        b_y=float(values['beam.b_y']),
        b_alpha=float(values['beam.b_alpha']),
    )
