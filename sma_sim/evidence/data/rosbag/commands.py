"""Which commands were in force: what a robot refuses, clips and turns off.

The node goes by these rules, and so does the reading of a bag that tells what was asked for, but not what was applied.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sma_sim.model.arrays import Vector
from sma_sim.model.parameters import ZERO_CELSIUS
from sma_sim.model.program_parameters import DEFAULTS

Times = NDArray[np.int64]


@dataclass(frozen=True)
class CommandLimits:
    """What a robot accepts: heating up to `J_max` [W], for `timeout` seconds after the last command (0: for ever)."""

    J_max: float = DEFAULTS['node.J_max'].default
    timeout: float = DEFAULTS['node.command_timeout'].default


NODE_LIMITS = CommandLimits()  # by default
UNLIMITED = CommandLimits(math.inf, 0.0)


def limits_in(parameters: Mapping[str, float]) -> CommandLimits:
    """The limits in the parameters of a configuration."""
    return CommandLimits(parameters['node.J_max'], parameters['node.command_timeout'])


def refusal(J: Sequence[float], count: int, signed: bool, sizes: Sequence[int] = (), offset: int = 0) -> str:
    """Why a robot refuses a heating command of `count` numbers as a whole; empty where it does not.

    `signed`: a number heats either of two wires; `sizes` and `offset` of the layout of an array.
    """
    one_each = f'{count} numbers [W], one for each {"pair of wires" if signed else "wire"}'
    one_each = 'expected ' + ('one number [W]' if count == 1 else one_each)
    if len(J) != count:
        return f'{one_each}, got {len(J)}'
    if offset or sizes and math.prod(sizes) != len(J):
        return f'{one_each}, got a layout of the sizes {list(sizes)} and the offset {offset}'
    if not all(map(math.isfinite, J)):
        return 'expected ' + ('a finite number' if count == 1 else 'finite numbers')
    if not signed and min(J) < 0.0:
        return 'expected no negative number: a wire is heated or it is not'
    return ''


def ambient_refusal(celsius: float) -> str:
    """Why a robot refuses a message with an ambient temperature [deg C]; empty where it does not.

    As in files a number that is too small for kelvin is in deg C, so one that can be kelvin is no message in deg C.
    """
    low, high = DEFAULTS['environment.T_E'].bounds
    if low - ZERO_CELSIUS <= celsius < low:
        return ''
    expected = f'expected {low - ZERO_CELSIUS:g} deg C to less than {low:g}'
    if not low <= celsius <= high:
        return expected
    meant = f'{celsius:g} K are {celsius - ZERO_CELSIUS:g} deg C'
    return f'{expected}; {meant} (where it is so hot, set environment.T_E, in kelvin)'


def commanded_positions(names: Sequence[str], count: int, wanted: Sequence[str]) -> list[int] | None:
    """Which of the `count` efforts of a stamped command are those of the wanted names, or without names all of them; None
    where some are missing."""
    if not names and count == len(wanted):
        return list(range(count))
    if set(wanted) <= set(names) and count == len(names):
        return [list(names).index(name) for name in wanted]
    return None


def clipped(J: float, J_max: float) -> float:
    """A heating command [W], not beyond J_max."""
    return min(max(J, -J_max), J_max)


def in_force(times: Times, J: Vector, limits: CommandLimits, end: int) -> tuple[Times, Vector]:
    """When the heating in force changes [ns], and to what [W], by the commands J (k, m) at `times` (k,) [ns] until `end`.

    The times are in order; a command of which a number is NaN was refused.
    """
    good = np.isfinite(J).all(axis=1)
    times, J = times[good], np.clip(J[good], -limits.J_max, limits.J_max)
    if limits.timeout <= 0.0:
        return times, J
    off = times + round(limits.timeout * 1e9)
    off = off[off < np.append(times[1:], end)]
    order = np.argsort(np.concatenate([times, off]), kind='stable')
    return np.concatenate([times, off])[order], np.concatenate([J, np.zeros((len(off), J.shape[1]))])[order]
