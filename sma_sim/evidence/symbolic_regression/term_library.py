"""The candidate terms of each port; docs/explanation/equations.md lists them."""

from __future__ import annotations

from functools import cache

from sma_sim.evidence.symbolic_regression.terms import ShapeParameter, Term, times

SWITCH_TIME = 0.3  # [s] over which a switch in time is smoothed: below it the solver only takes more steps
FINE_PARTS = {'rad': 1.0 / 15.0}  # of a usual change, over which friction builds up: joints slip early ...
FINE_PART = 0.3  # ... beside what slides
SENSOR_SHAPES = ('value', 'value_abs', 'value_square', 'value_cube', 'value_above', 'value_below', 'value_wave')
# A hat function of time: no term of a formula, but the basis of a partial-residual plot.
HAT_FUNCTION = Term(
    'pulse',
    'max(0.0, 1.0 - abs(s.t - {t_0}) / {width})',
    '-',
    ('t',),
    (ShapeParameter('t_0', 's', 'instant'), ShapeParameter('width', 's', 'time_constant')),
)
DECAY_POWER = ShapeParameter('power', '-', 'fixed', values=(1.5,), description='how fast it decays with the distance')
TIME_CONSTANT = ShapeParameter('tau', 's', 'time_constant', description='time constant')
CONSTANT = Term('constant', '1.0', '-', ('constant',))


def of_variable(name: str, value: str, unit: str, variable: str, offset: str = '') -> list[Term]:
    """Functions of one variable: powers, one-sided ramps, a step, a bump, wells that attract to one value, waves.

    `offset` is what powers leave out of the value (T_E of a temperature).
    """
    u = f'({value} - {offset})' if offset else value
    in_brackets = u if offset else f'({u})'
    at = ShapeParameter(f'{name}_0', unit, 'threshold', variable, description=f'{name} at which it begins, or its middle')
    width = ShapeParameter('width', unit, 'width', variable, description='width')
    wavenumber = ShapeParameter(
        'k', f'rad/({unit})' if unit != 'rad' else '-', 'wavenumber', variable, description='2 pi over the period'
    )
    phase = ShapeParameter('phase', 'rad', 'phase', description='phase')
    away = f'{value} - {{{at.name}}}'
    ratio = f'(({away}) / {{width}})'
    on = (variable,)
    return [
        Term(name, u, unit, on),
        Term(f'{name}_abs', f'abs{in_brackets} * {u}', f'{unit}^2', on),
        Term(f'{name}_square', f'{u} ** 2', f'{unit}^2', on),
        Term(f'{name}_cube', f'{u} ** 3', f'{unit}^3', on),
        Term(f'{name}_above', f'max(0.0, {away})', unit, on, (at,)),
        Term(f'{name}_below', f'max(0.0, {{{at.name}}} - {value})', unit, on, (at,)),
        Term(f'{name}_step', f'0.5 * (1.0 + math.tanh{ratio})', '-', on, (at, width)),
        Term(f'{name}_bump', f'math.exp(-{ratio} ** 2)', '-', on, (at, width)),
        Term(f'{name}_well', f'{ratio} * math.exp(-{ratio} ** 2)', '-', on, (at, width)),
        Term(f'{name}_attraction', f'{ratio} / (1.0 + {ratio} ** 2) ** {{power}}', '-', on, (at, width, DECAY_POWER)),
        Term(f'{name}_wave', f'math.sin({{k}} * {value} + {{phase}})', '-', on, (wavenumber, phase)),
    ]


@cache
def of_time() -> tuple[Term, ...]:
    """Functions of time: drift, settling, a switch, the onset of a drift, oscillation, a duty cycle."""
    instant = ShapeParameter('t_0', 's', 'instant', description='instant, counted from the beginning of the run')
    frequency = ShapeParameter('f', 'Hz', 'frequency', description='frequency')
    phase = ShapeParameter('phase', 'rad', 'phase', description='phase at the beginning of the run')
    angle = '2.0 * math.pi * {f} * s.t + {phase}'
    on = ('t',)
    return (
        Term('time', 's.t', 's', on),
        Term('settling', '1.0 - math.exp(-s.t / {tau})', '-', on, (TIME_CONSTANT,)),
        Term('switched', f'0.5 * (1.0 + math.tanh((s.t - {{t_0}}) / {SWITCH_TIME}))', '-', on, (instant,)),
        Term('since', 'max(0.0, s.t - {t_0})', 's', on, (instant,)),
        Term('oscillation', f'math.sin({angle})', '-', on, (frequency, phase)),
        Term('duty', f'0.5 * (1.0 + math.tanh(6.0 * math.sin({angle})))', '-', on, (frequency, phase)),
    )


def averaged_term(name: str, value: str, unit: str, variables: tuple[str, ...], expression: str) -> Term:
    """A term `expression` that reads ``m.z``, the slow first-order average of `value`."""
    return Term(name, expression, unit, (*variables, 'memory'), (TIME_CONSTANT,), f'({value} - m.z) / {{tau}}', scale=10.0)


@cache
def heat_terms() -> tuple[Term, ...]:
    """Heat into a wire: of its temperature, its phase and the time; what scales with the power is electrical."""
    above = Term('dT', 's.T - s.T_E', 'K', ('T',))
    fraction = Term('x', 's.x', '-', ('x',))
    return (
        CONSTANT,
        *of_variable('T', 's.T', 'K', 'T', 's.T_E')[:8],
        fraction,
        times(fraction, above),
        times(Term('speed', 'abs(s.deps)', '1/s', ('deps',)), above),
        Term('exchange', 's.T_other - s.T', 'K', ('T_other', 'T')),
        Term('forming', 'max(0.0, s.dx)', '1/s', ('dx',)),
        Term('reverting', 'max(0.0, -s.dx)', '1/s', ('dx',)),
        *of_time(),
        *(times(above, term) for term in of_time()),
        averaged_term('heat_reservoir', '(s.T - s.T_E)', 'K', ('T',), 'm.z - (s.T - s.T_E)'),
        averaged_term('slow_other', '(s.T_other - s.T_E)', 'K', ('T_other',), 'm.z'),
    )


@cache
def power_terms() -> tuple[Term, ...]:
    """Electrical heating: all in proportion to a power of the command of the wire."""
    command = Term('J', 's.J', 'W', ('J',))
    onset = ShapeParameter('J_0', 'W', 'width', 'J', description='power above which it is proportional')
    return (
        *(term for term in of_variable('J', 's.J', 'W', 'J') if term.name in ('J', 'J_square', 'J_cube', 'J_above')),
        Term('J_soft_onset', 's.J * math.tanh(s.J / {J_0})', 'W', ('J',), (onset,)),
        times(command, Term('x', 's.x', '-', ('x',))),
        times(command, Term('x_square', 's.x ** 2', '-', ('x',))),
        times(command, Term('dT', 's.T - s.T_E', 'K', ('T',))),
        *(times(command, term) for term in of_time()),
        averaged_term('supply_sag', 's.J', 'W^2', ('J',), 's.J * m.z'),
    )


@cache
def strain_terms() -> tuple[Term, ...]:
    """Offsets of strain, or shifts of both transformation stresses: of temperature, time and the history of the wire."""
    reach = ShapeParameter(
        'z_0', '-', 'fixed', values=(1.0, 5.0), description='transformation after which 63 % of it is reached'
    )
    threshold = ShapeParameter('T_0', 'K', 'threshold', 'T', description='temperature at which it begins')
    scale = ShapeParameter('T_w', 'K', 'fixed', values=(10.0, 25.0), description='temperature over which it grows e-fold')
    return (
        CONSTANT,
        *of_variable('T', 's.T', 'K', 'T', 's.T_E')[:8],
        *of_time(),
        Term('accumulated_transformation', 'm.z', '-', ('dx', 'memory'), (), 'abs(s.dx)'),
        Term('training', '1.0 - math.exp(-m.z / {z_0})', '-', ('dx', 'memory'), (reach,), 'abs(s.dx)'),
        Term('thermal_exposure', 'm.z', 'K s', ('T', 'memory'), (threshold,), 'max(0.0, s.T - {T_0})', scale=100.0),
        Term('activated', 'm.z', 's', ('T', 'memory'), (scale,), 'math.exp((s.T - s.T_E - 30.0) / {T_w})', scale=10.0),
        averaged_term('slow_T', '(s.T - s.T_E)', 'K', ('T',), 'm.z'),
    )


def friction(name: str, rate: str, unit: str, variable: str, scale: float) -> list[Term]:
    """Damping, dry friction, and hysteresis that begins elastically and may relax at rest."""
    speed = ShapeParameter('w', f'{unit}/s', 'fixed', values=(scale, 10.0 * scale), description='speed of full friction')
    reach = ShapeParameter(
        'z_0', unit, 'fixed', values=(0.3 * scale, scale, 3.0 * scale), description='travel over which it builds up'
    )
    leak = ShapeParameter('tau', 's', 'time_constant', description='time in which it decays at rest')
    on, builds_up = (f'd{variable}', 'memory'), f'{rate} - abs({rate}) * m.z / {{z_0}}'
    return [
        Term(f'{name}_damping', rate, f'{unit}/s', on[:1]),
        Term(f'{name}_friction', f'math.tanh({rate} / {{w}})', '-', on[:1], (speed,)),
        Term(f'{name}_hysteresis', 'm.z / {z_0}', '-', on, (reach,), builds_up, scale=scale),
        Term(f'{name}_leaking', 'm.z / {z_0}', '-', on, (reach, leak), f'{builds_up} - m.z / {{tau}}', scale=scale),
        Term(f'{name}_relaxing', 'm.z', unit, on, (leak,), f'{rate} - m.z / {{tau}}', scale=10.0 * scale),
    ]


def mean_temperature(wires: int) -> str:
    """Mean temperature of all wires above ambient, as the effects of a structure see it."""
    if wires == 1:
        return 's.T - s.T_E'
    return '0.5 * (s.T + s.T_other) - s.T_E' if wires == 2 else '(s.T + s.others * s.T_other) / (s.others + 1.0) - s.T_E'


@cache
def coordinate_terms(name: str, rate: str, unit: str, size: float, guided: bool, wires: int) -> tuple[Term, ...]:
    """A force along a coordinate or a moment about it; those in a joint, which is `guided`, have more shapes.

    `name`, `rate`: what kernels call the coordinate and its rate; `size`: its usual change, in its `unit`.
    """
    scale = float(f'{FINE_PARTS.get(unit, FINE_PART) * size:.2g}')
    shapes = of_variable(name, f's.{name}', unit, name)
    gradient = [Term('gradient', '(s.T_other - s.T) * (2.0 * s.wire - 1.0)', 'K', ('T',))] if wires == 2 else []
    width = ShapeParameter('width', unit, 'width', name, description='width')
    return (
        CONSTANT,
        *(shapes if guided else shapes[:6]),
        Term(f'{name}_saturating', f'math.tanh(s.{name} / {{width}})', '-', (name,), (width,)),
        *friction('hinge' if unit == 'rad' else 'slide', f's.{rate}', unit, name, scale),
        Term('mean_temperature', mean_temperature(wires), 'K', ('T',)),
        *(gradient if guided else ()),
        *of_time(),
        *(times(shapes[0], term) for term in of_time() if guided),
    )


@cache
def stiffness_terms(wires: int) -> tuple[Term, ...]:
    """A part of the beam's stiffness that is lost (its force is the term times K q)."""
    mean = mean_temperature(wires)
    return (
        Term('bending', 's.alpha ** 2', 'rad^2', ('alpha',)),
        Term('mean_temperature', mean, 'K', ('T',)),
        averaged_term('slow_mean_temperature', f'({mean})', 'K', ('T',), 'm.z'),
        *of_time(),
    )


@cache
def sensor_terms(rate: str) -> tuple[Term, ...]:
    """An error of the shown value; with hysteresis where kernels know the `rate` of what is shown."""
    play = ShapeParameter('half', 'unit', 'width', 'value', description='half of the play')
    ahead = f'(1.0 - 0.5 * min(1.0, abs(m.z / {{half}})) ** 8 * (1.0 + math.copysign(1.0, s.{rate} * m.z)))'
    backlash = Term('play', '-m.z', 'unit', ('value', 'memory'), (play,), f's.{rate} * {ahead}', scale=0.1)
    return (
        CONSTANT,
        *(term for term in of_variable('value', 's.value', 'unit', 'value') if term.name in SENSOR_SHAPES),
        *of_time(),
        *([backlash] if rate else ()),
    )
