"""Every parameter of the model: its default, unit, range and source.

The names are those of the YAML file, of ``--set`` and of the ROS parameters. `WireConstants` and
`BeamConstants` are what the equations read: the same numbers, with derived quantities beside them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from numbers import Real
from typing import NamedTuple

PAPER = 'Mandolino, Ferrante and Rizzello, RA-L 2021, section IV'
RESISTIVITY = 'usual NiTi actuator wires; law: Furst and Seelecke, J. Intell. Mater. Syst. Struct. 23 (2012) 1233'
ZERO_CELSIUS = 273.15  # [K]
KELVIN = (150.0, 2000.0)  # [K] of what is near a wire: smaller numbers are degrees Celsius
K_B = 1.380649e-23  # Boltzmann constant [J/K], exact by definition of the SI


def kelvin_hint(value: float) -> str:
    """What a temperature out of `KELVIN` is if degrees Celsius were meant."""
    kelvin = value + ZERO_CELSIUS
    return f'\n{value:g} deg C are {kelvin:g} K' if KELVIN[0] <= kelvin <= KELVIN[1] else ''


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


def declared_in(source: str, *parameters: Parameter) -> tuple[Parameter, ...]:
    """Parameters whose defaults come from the same source, but for those that say their own."""
    return tuple(replace(parameter, source=parameter.source or source) for parameter in parameters)


def fault_of(parameter: Parameter) -> str:
    """What is wrong with a declaration, '' for nothing."""
    if not isinstance(parameter, Parameter):
        return f'expected a Parameter among its parameters, got {parameter!r}'
    name, unit, bounds = parameter.name, parameter.unit, parameter.bounds
    if not (isinstance(bounds, tuple) and len(bounds) == 2 and all(map(is_number, (parameter.default, *bounds)))):
        return f'parameter {name}: expected numbers, got default {parameter.default!r}, bounds {bounds!r}'
    if not unit:
        return f"parameter {name}: expected a unit, such as 'N/m' ('-' for none), got ''"
    low, high = bounds
    for kind, value in (('default', parameter.default), ('neutral', parameter.neutral)):
        if value is not None and not low <= value <= high:
            return f'parameter {name}: {kind} {value:g} {unit}; expected {low:g} to {high:g}'
    return ''


def is_number(value: object) -> bool:
    """Whether a value is one number."""
    return isinstance(value, Real) and not isinstance(value, bool)


WIRE_PARAMETERS = declared_in(
    PAPER,
    Parameter('E_A', 12.3e9, 'Pa', (1e8, 1e12), "Young's modulus of austenite"),
    Parameter('E_M', 7.8e9, 'Pa', (1e8, 1e12), "Young's modulus of martensite"),
    Parameter('eps_T', 0.067, '-', (1e-3, 0.3), 'transformation strain'),
    Parameter('sigma_T', 2.13e6, 'Pa/K', (0.0, 1e8), 'slope of the transformation stresses over temperature'),
    Parameter('c_V', 380.0, 'J/(kg K)', (1.0, 1e5), 'specific heat'),
    Parameter('lambda', 450.0, 'W/(m^2 K)', (0.0, 1e6), 'convective cooling coefficient'),
    Parameter('sigma_MW0', 121.35e6, 'Pa', (0.0, 1e10), 'Maxwell stress sigma_MW at T0'),
    Parameter('dsigma', 12.3e6, 'Pa', (1e3, 1e10), 'height of the stress-strain hysteresis'),
    Parameter('T0', 323.0, 'K', KELVIN, 'reference temperature of sigma_MW0'),
    Parameter('r0', 75e-6, 'm', (1e-6, 1e-2), 'radius of one wire'),
    Parameter('l0', 95.7e-3, 'm', (1e-4, 10.0), 'undeformed length of a wire'),
    Parameter('rho', 7745.0, 'kg/m^3', (1.0, 1e5), 'density'),
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
    Parameter('W', 10e-3, 'm', (1e-4, 10.0), 'width of the plate: distance of the two bundles'),
    Parameter('m_H', 10e-3, 'kg', (1e-6, 1e4), 'mass of the plate'),
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

NODE_PARAMETERS = declared_in(
    'docs/reference/node.md',
    Parameter('integration_rate', 1000.0, 'Hz', (1.0, 100000.0), 'steps of the simulation per second'),
    Parameter('publish_rate', 100.0, 'Hz', (0.1, 10000.0), 'messages per second and topic'),
    Parameter('real_time_factor', 1.0, '-', (0.0, 1000.0), 'simulated over wall time; 0: as fast as possible'),
    Parameter('command_timeout', 10.0, 's', (0.0, 1e6), 'without a command for this long, heating is off; 0: never'),
    Parameter('J_max', 30.0, 'W', (0.0, 1e6), 'commands beyond it are clipped'),
    Parameter('steps_per_call', 1.0, '-', (1.0, 1e9), 'steps that one call of ~/step makes'),
    Parameter('record_duration', 0.0, 's', (0.0, 1e6), "simulated time in one of the bag's files; 0: no limit"),
    Parameter('record_size', 0.0, 'MB', (0.0, 1e6), "size of one of the bag's files; 0: no limit"),
    Parameter('realtime_priority', 0.0, '-', (0.0, 99.0), 'SCHED_FIFO priority of the thread that steps; 0: none'),
)

CHECK_PARAMETERS = declared_in(
    'docs/reference/node.md',
    Parameter('threshold', 3.0, '-', (0.01, 1e9), 'running normalized RMSE above which the model misses a channel'),
    Parameter('window', 5.0, 's', (0.01, 1e4), 'the running RMSE is over it; the model has left when it misses for as long'),
    Parameter('burn_in', 20.0, 's', (0.0, 1e6), 'after a start of the model, without a verdict'),
    Parameter('latency', 0.1, 's', (0.0, 10.0), 'wait after a measured sample for commands that are on their way'),
    Parameter('longest_gap', 10.0, 's', (0.001, 1e4), 'gap in the measurement after which the model starts anew'),
    Parameter('diagnosis_period', 10.0, 's', (0.0, 1e6), 'between two looks for the cause of a deviation; 0: none'),
    Parameter('noise_U_x', 2e-6, 'm', (1e-15, 1.0), 'standard deviation of the noise of U_x'),
    Parameter('noise_U_y', 1e-5, 'm', (1e-15, 1.0), 'standard deviation of the noise of U_y'),
    Parameter('noise_alpha', 3.5e-4, 'rad', (1e-15, 1.0), 'standard deviation of the noise of alpha'),
    Parameter('noise_F_1', 0.05, 'N', (1e-12, 1e6), 'standard deviation of the noise of F_1'),
    Parameter('noise_F_2', 0.05, 'N', (1e-12, 1e6), 'standard deviation of the noise of F_2'),
    Parameter('noise_T_1', 1.0, 'K', (1e-9, 1e3), 'standard deviation of the noise of T_1'),
    Parameter('noise_T_2', 1.0, 'K', (1e-9, 1e3), 'standard deviation of the noise of T_2'),
)

OBSERVER_PARAMETERS = declared_in(
    'docs/how-to/estimate-the-wire-temperature.md',
    Parameter('parameter_std', 0.1, '-', (1e-6, 1.0), 'relative standard deviation of parameters that have none in priors'),
    Parameter('length_std', 0.002, '-', (1e-6, 1.0), 'the same of lengths'),
    Parameter('parameter_time', 300.0, 's', (0.1, 1e9), 'how long what was learned of parameters is kept'),
    Parameter('power_std', 0.03, '-', (1e-6, 1.0), 'by which part the heating of a wire may differ from the command'),
    Parameter('power_time', 60.0, 's', (0.1, 1e9), 'how long such a difference lasts'),
    Parameter('T_E_std', 1.0, 'K', (1e-6, 100.0), 'by how much the ambient temperature may differ'),
    Parameter('T_E_time', 300.0, 's', (0.1, 1e9), 'how long such a difference lasts'),
    Parameter(
        'discrepancy',
        0.02,
        '-',
        (1e-6, 1.0),
        'by which part of its usual change a channel may differ from the model, beside noise',
    ),
    Parameter('discrepancy_time', 10.0, 's', (0.01, 1e9), 'how long such a difference lasts'),
    Parameter('T_walk', 0.5, 'K/s^0.5', (0.0, 1e3), 'random walk of the temperatures'),
    Parameter('x_M_walk', 0.003, '1/s^0.5', (0.0, 1.0), 'random walk of the fractions'),
    Parameter('initial_T_std', 1.0, 'K', (1e-3, 1e3), 'of the temperatures at the start'),
    Parameter('initial_x_M_std', 0.01, '-', (1e-4, 1.0), 'of the fractions at the start'),
    Parameter('latency', 0.02, 's', (0.0, 1.0), 'wait of the node after a sample for messages that belong to it'),
)
GUARD_PARAMETERS = declared_in(
    'docs/how-to/guard-the-wires.md',
    Parameter('T_max', 400.0, 'K', KELVIN, 'no wire may get hotter'),
    Parameter('stress_max', 5e8, 'Pa', (1e3, 1e12), 'no wire may be under more stress'),
    Parameter('strain_max', 0.1, '-', (1e-6, 1.0), 'no wire that is longer is heated'),
    Parameter('cycles_max', 1e9, '-', (0.0, 1e12), 'transformation cycles after which a wire is no longer heated'),
    Parameter('horizon', 0.05, 's', (0.005, 10.0), 'how long a command may stay in force before the next one is judged'),
    Parameter('margin', 2.0, '-', (0.0, 10.0), 'standard deviations of the estimate that limits keep clear of'),
    Parameter('T_std_max', 20.0, 'K', (0.1, 1e3), 'standard deviation of a temperature that is too uncertain to heat'),
    Parameter('silence', 0.15, 's', (0.005, 10.0), 'without a message for so long, robot and observer are silent'),
)
CONTROL_PAGE = 'docs/how-to/control-the-robot.md'
CONTROL_PARAMETERS = (
    Parameter('rate', 50.0, 'Hz', (1.0, 1000.0), 'commands per second', source=CONTROL_PAGE),
    Parameter('horizon', 1.0, 's', (0.01, 1e3), 'how far a plan looks ahead', source=CONTROL_PAGE),
    Parameter(
        'smoothness',
        0.003,
        '-',
        (1e-6, 10.0),
        'error, as a part of the usual change, that a change of the command by what keeps a wire at guard.T_max is worth',
        source=CONTROL_PAGE,
    ),
    Parameter('target', 0.0, 'rad or m', (-1e3, 1e3), 'held from the start on, with control.hold', source=CONTROL_PAGE),
    Parameter('silence', 0.5, 's', (0.01, 1e3), 'without joint_states for so long, heating is off', source=CONTROL_PAGE),
    Parameter('kp', 1000.0, 'W/rad or W/m', (0.0, 1e9), 'proportional gain beside the feedforward', source=CONTROL_PAGE),
    Parameter('ki', 800.0, 'W/(rad s) or W/(m s)', (0.0, 1e9), 'integral gain beside it', source=CONTROL_PAGE),
)


@dataclass(frozen=True)
class Setting:
    """A parameter of the nodes that is no number: a text or a switch, by the type of its default."""

    name: str
    default: str | bool
    description: str


def joint_name_setting(name: str) -> Setting:
    """What a coordinate is called in the robot's joint_states."""
    return Setting(f'name_{name}', name, f"name of {name} in the robot's joint_states")


SETTINGS: Mapping[str, Setting] = {
    f'{group}.{setting.name}': setting
    for group, setting in (
        ('node', Setting('record', '', 'bag to write (mcap); NAME/: a new one in this folder; none: nothing is recorded')),
        ('node', Setting('ros2_control', False, "robot_description has ros2_control's topic-based hardware")),
        ('node', Setting('joint_prefix', '', 'stands before the names of the joints in joint_states and in the URDF')),
        ('node', Setting('stamped_topics', False, 'publish variants with a header too, such as wire_forces_stamped')),
        ('node', Setting('publish_resistances', False, 'publish the electrical resistance of every wire')),
        ('node', Setting('publish_clock', False, 'be the source of /clock; stamps then begin at 0')),
        ('node', Setting('stamps_follow_clock', True, 'after a pause or an overrun, stamps are those of the clock again')),
        *(('check', joint_name_setting(name)) for name in ('U_x', 'U_y', 'alpha')),
        ('control', Setting('law', 'predictive', 'predictive or feedforward')),
        ('control', Setting('coordinate', '', 'what follows the target; empty: the last coordinate')),
        (
            'control',
            Setting('hold', False, 'control.target is held from the start; else nothing is heated before a target comes'),
        ),
        ('control', Setting('behind_guard', False, 'commands go to sma_guard, as J_eq_requested')),
        ('guard', Setting('counters', '', 'file in which counts of interventions and cycles survive a restart')),
    )
}

GROUPS: Mapping[str, tuple[Parameter, ...]] = {
    'wire': WIRE_PARAMETERS,
    'beam': BEAM_PARAMETERS,
    'plate': PLATE_PARAMETERS,
    'environment': ENVIRONMENT_PARAMETERS,
    'initial': INITIAL_PARAMETERS,
    'solver': SOLVER_PARAMETERS,
    'node': NODE_PARAMETERS,
    'check': CHECK_PARAMETERS,
    'observer': OBSERVER_PARAMETERS,
    'guard': GUARD_PARAMETERS,
    'control': CONTROL_PARAMETERS,
}
DEFAULTS: Mapping[str, Parameter] = {
    f'{group}.{parameter.name}': parameter for group, members in GROUPS.items() for parameter in members
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
