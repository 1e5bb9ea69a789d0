"""The ports on which physical effects act, and what the kernel of an effect sees there."""

from __future__ import annotations

import ctypes
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

ACTUATION, WIRE_HEAT, WIRE_STRAIN, TRANSFORMATION_STRESS, WIRE_FORCE, STRUCTURE_FORCE, SENSING = range(7)
PORT_NAMES = (
    'actuation',
    'wire_heat',
    'wire_strain',
    'transformation_stress',
    'wire_force',
    'structure_force',
    'sensing',
)
PORT_OUTPUTS = (1, 2, 3, 2, 1, 3, 1)  # numbers that a kernel returns
PORT_MAY_RETURN_ONE = (False, True, True, False, False, False, False)  # the others are zero then

# Fields of the state that are not known yet when the values, and the rates, of a port's effects are evaluated.
_SENSING_ONLY = ('value', 'channel', 'neighbours')
_AFTER_PHASES = ('x_other', 'sigma', 'dx', 'F', *_SENSING_ONLY)
VALUE_UNKNOWN = (
    ('dx', 'F', *_SENSING_ONLY),
    ('F', *_SENSING_ONLY),
    _AFTER_PHASES,
    _AFTER_PHASES,
    _SENSING_ONLY,
    _SENSING_ONLY,
    (),
)
RATE_UNKNOWN = (
    ('dx', 'F', *_SENSING_ONLY),
    _SENSING_ONLY,
    ('F', *_SENSING_ONLY),
    ('F', *_SENSING_ONLY),
    _SENSING_ONLY,
    _SENSING_ONLY,
    (),
)

# Channels of sensors that effects name, by the number that kernels see as ``s.channel``; other structures' follow them.
CHANNELS = ('U_x', 'U_y', 'alpha', 'F_1', 'F_2', 'T_1', 'T_2', 'stress', 'T')


class State(NamedTuple):
    """What a kernel may read as ``s.<field>`` (SI), but for what its port does not know yet (VALUE_UNKNOWN, RATE_UNKNOWN).

    What a kernel reads is inferred from it (compiler.fields_read).

    Per wire: T, x, eps, deps (its rate), l, v, and of the other wire T_other and x_other (of `others` wires: their
    mean); J [W], the heating of one wire, on its way through the actuation chain; sigma [Pa]; dx [1/s]; F [N], the force of
    one wire, on its way to the structure. For all: t, T_E, the pose (U_x, U_y, alpha) and its rates. Sensing: `value` on
    its way through the chain, its `channel`, an index into CHANNELS, and `neighbours`, the sum of the true values of all
    other channels of its kind (forces, temperatures, resistances, coordinates in one unit). `wire` counts from 0. `strain`
    is what the effects before it have added on wire_strain.

    Order: strain and stress ports (there J is the command, before the actuation chain), actuation, wire_heat,
    wire_force, structure_force, sensing. Heat may depend on dx, in proportion to it for each sign.
    """

    t: float
    T_E: float
    wire: float
    T: float
    x: float
    eps: float
    deps: float
    length: float
    v: float
    J: float
    sigma: float
    dx: float
    F: float
    T_other: float
    x_other: float
    others: float
    value: float
    channel: float
    neighbours: float
    strain: float
    U_x: float
    U_y: float
    alpha: float
    dU_x: float
    dU_y: float
    dalpha: float


(
    S_TIME,
    S_T_E,
    S_WIRE,
    S_T,
    S_X,
    S_EPS,
    S_DEPS,
    S_LENGTH,
    S_V,
    S_J,
    S_SIGMA,
    S_DX,
    S_F,
    S_T_OTHER,
    S_X_OTHER,
    S_OTHERS,
    S_VALUE,
    S_CHANNEL,
    S_NEIGHBOURS,
    S_STRAIN,
    S_POSE,
) = range(21)  # the coordinates, then their rates


class EffectTable(NamedTuple):
    """The active effects as the compiled right-hand side reads them, sorted by port and place in its chain.

    Shapes: `port_start` (8,), `slot` (effects, channels), `code` and `kind` (channels,), all others one entry per effect,
    except for the flat `parameters`, the `scale` of every extra state, and the scratch arrays. `value`, `rate` and `start`
    are addresses of native kernels, 0 for none. After an effect's `parameters` stands the mask of its scope. `states` counts
    the extra states of one instance (one wire, one channel, or the structure); instance i of effect k has its states at
    ``state_start[k] + i states[k]`` in the state vector. `slot` gives the instance of a sensing effect on a channel, -1
    where it does not act; `code` is what kernels see as its ``s.channel``; `kind` is the same for channels that are alike.
    `shared` is 1 where the wires have their extra
    states in common: each keeps a copy, whose rate is the mean of what all say. `s` (wires, S_POSE + twice the coordinates)
    is the state that kernels read, a row per wire; `row` is the one that an effect on the structure or a sensor reads,
    -1 for those on wires, which read their wire's. `constants` are the addresses of `wire` or `structure`. `out` takes
    what kernels return; `contribution` (effects, 3) keeps what those on wire_strain add, of which those from
    `series_start` on are in series with the wire, and first the heat capacity of those on wire_heat. What effects add on
    strain and stress ports depends on x, eps and t, on wire_heat on dx, and on sensing on neighbours and t, where
    `depends_on_x` and its like are 1.
    """

    port_start: NDArray[np.int64]
    value: NDArray[np.int64]
    rate: NDArray[np.int64]
    start: NDArray[np.int64]
    states: NDArray[np.int64]
    state_start: NDArray[np.int64]
    scale: NDArray[np.float64]
    slot: NDArray[np.int64]
    code: NDArray[np.int64]
    kind: NDArray[np.int64]
    shared: NDArray[np.int64]
    depends_on_x: NDArray[np.int64]
    depends_on_eps: NDArray[np.int64]
    depends_on_dx: NDArray[np.int64]
    depends_on_t: NDArray[np.int64]
    depends_on_neighbours: NDArray[np.int64]
    parameter_start: NDArray[np.int64]
    parameters: NDArray[np.float64]
    row: NDArray[np.int64]
    constants: NDArray[np.int64]
    s: NDArray[np.float64]
    wire: NDArray[np.float64]
    structure: NDArray[np.float64]
    out: NDArray[np.float64]
    contribution: NDArray[np.float64]
    series_start: int


_KERNEL = ctypes.CFUNCTYPE(None, *([ctypes.c_ssize_t] * 5))


def call_kernel(address: int, s: int, w: int, p: int, m: int, out: int) -> None:
    """Call the native kernel at `address` with five data addresses (the compiler puts a direct call here)."""
    _KERNEL(int(address))(s, w, p, m, out)


def call_effect(address: int, k: int, instance: int, y: NDArray[np.float64], e: EffectTable) -> None:
    """Call one kernel of effect `k` on the state in ``e.s``; what it returns is then in ``e.out``."""
    call_effect_in(address, k, e.row[k] if e.row[k] >= 0 else instance, instance, y, e)


def call_effect_in(address: int, k: int, row: int, instance: int, y: NDArray[np.float64], e: EffectTable) -> None:
    """As `call_effect`, on the state in a given row of ``e.s``."""
    call_kernel(
        address,
        e.s.ctypes.data + 8 * e.s.shape[1] * row,
        e.constants[k],
        e.parameters.ctypes.data + 8 * e.parameter_start[k],
        y.ctypes.data + 8 * (e.state_start[k] + instance * e.states[k]),
        e.out.ctypes.data,
    )
