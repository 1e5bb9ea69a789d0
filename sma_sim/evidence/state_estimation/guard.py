"""A guard between a controller and a robot: it takes away as little heating as keeps every wire within its limits.

Over the time h that a command may stay in force, a wire of heat capacity C that is heated with J/n is no hotter than

    T(h) = T d + (T_E + J/(n lambda A_s)) (1 - d),      d = exp(-lambda A_s h/C),

because heating lets it transform to austenite, which takes latent heat in addition (L3). Its stress rises by sigma_T for
each kelvin at most: that is the slope of the stress at which it transforms back (MAS8), which it does not exceed. Both are
linear in the heating, so the largest part of a command that keeps all limits is found at once.

An estimate that is older than the command is carried on by the same bounds, under all that was let through since, so that
less is let through where the next estimate does not come, or comes late. A command counts until the one after the next: it
stays in force while that one is on its way.
"""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from sma_sim.evidence.data.rosbag.commands import refusal
from sma_sim.evidence.data.tables import write_whole
from sma_sim.evidence.state_estimation.estimate import Estimate
from sma_sim.evidence.state_estimation.heat_balance import heat_balance
from sma_sim.model.argument_checks import as_array, expect
from sma_sim.model.arrays import Vector
from sma_sim.model.config import Config
from sma_sim.model.errors import UserError
from sma_sim.model.system import commanded_heating
from sma_sim.solver.model import Model

CYCLE = 0.1  # of x_M, by which a wire must have transformed to and fro for a cycle
OVER = 'temperature', 'stress', 'strain', 'cycles'
UNKNOWN, UNCERTAIN, REFUSED = 'no estimate', 'uncertain estimate', 'a command that a robot refuses'


@dataclass(frozen=True)
class Decision:
    """What a guard lets through.

    Attributes
    ----------
    J_eq : tuple of float
        Commands [W]: those that were asked for, times `scale`.
    scale : float
        From 0 to 1.
    kind : str
        Why it is less than 1, in a word; empty where it is not.
    reason : str
        The same as a sentence.
    """

    J_eq: tuple[float, ...]
    scale: float
    kind: str
    reason: str


@dataclass
class Counters:
    """What a guard has done, also before it was started: `interventions` by kind, transformation `cycles` of each wire."""

    interventions: Counter[str] = field(default_factory=Counter)
    cycles: list[float] = field(default_factory=list)

    def save(self, path: str | Path) -> None:
        """Write a JSON file, whole or not at all. Raises UserError."""
        data = {'interventions': dict(self.interventions), 'cycles': self.cycles}
        expect('path', path, str | Path)
        write_whole(Path(path), lambda file: file.write(json.dumps(data, indent=2) + '\n'))

    @staticmethod
    def read(path: str | Path, wires: int) -> Counters:
        """What a file says, nothing where there is none. Raises UserError for one that says something else."""
        expect('path', path, str | Path)
        path = Path(path)
        if not path.exists():
            return Counters(cycles=[0.0] * wires)
        try:
            data: Any = json.loads(path.read_text(encoding='utf-8'))
            counts = Counter({str(name): int(number) for name, number in data['interventions'].items()})
            cycles = [float(number) for number in data['cycles']]
        except (OSError, ValueError, OverflowError, TypeError, KeyError, AttributeError) as error:
            raise UserError(
                f'guard.counters = {path}: expected a JSON file with interventions and cycles, as the guard writes it'
            ) from error
        if len(cycles) != wires or not all(math.isfinite(number) and number >= 0.0 for number in cycles):
            raise UserError(f'guard.counters = {path}: it has cycles {cycles}; expected those of {wires} wire(s)')
        return Counters(counts, cycles)


class Guard:
    """Limits commands so that the wires stay within ``guard.T_max``, ``stress_max``, ``strain_max`` and ``cycles_max``.

    It never adds heating. Without an estimate, with one that is too uncertain (``guard.T_std_max``), and for a command that
    a robot refuses (it would leave the one before in force), the heating is zero.

    Parameters
    ----------
    config : Config
        The model, and the limits ``guard.*``.
    counters : Counters, optional
        What was counted before.

    Examples
    --------
    >>> import numpy as np
    >>> import sma_sim
    >>> from sma_sim.guard import Guard
    >>> from sma_sim.observer import Observer
    >>> from sma_sim.solver.fixed_rate import FixedRateRun
    >>> config = sma_sim.Config({'guard.T_max': 350.0})
    >>> robot = FixedRateRun(sma_sim.Model(config), 50.0, np.array([0.0, 298.0]))
    >>> observer, guard = Observer(config), Guard(config)
    >>> for k in range(100):
    ...     seen = {name: robot.shown(name) for name in ('alpha', 'F_1', 'F_2')}
    ...     allowed = guard.limit(25.0, observer.update(0.02 * k, None, seen), 0.02 * k)
    ...     estimate = observer.update(0.02 * k, allowed.J_eq)
    ...     robot.step(np.array([*allowed.J_eq, 298.0]))
    >>> bool(330.0 < estimate.T[0] < 350.0), allowed.kind, 0.0 < allowed.scale < 0.8
    (True, 'temperature', True)
    """

    def __init__(self, config: Config, counters: Counters | None = None) -> None:
        expect('config', config, Config)
        expect('counters', counters, Counters | None)
        model = Model(config)
        self._system, self._wire = model.compiled, model.wire
        self._size, self._wires = len(model.structure.commands), model.wires
        self._signed = model.structure.antagonistic
        self._limits = {
            name.removeprefix('guard.'): value for name, value in config.parameters.items() if name.startswith('guard.')
        }
        self.T_E = config.parameters['environment.T_E']
        self.pace = 1.0  # seconds of estimates and commands in one of a clock, by which silence counts
        self.counters = counters or Counters(cycles=[0.0] * self._wires)
        self._carried: Estimate | None = None  # the last estimate, as it was at the last command
        self._last: Estimate | None = None
        self._heating, self._stretching = np.zeros((2, self._wires))  # let through [W]; rates of the stresses, if they rise
        self._commands = [(-math.inf, self._heating)]  # since when [s] which heating may have been in force
        self._kind = ''
        self._turns: list[tuple[float, int]] = []  # of each wire, the last extreme of x_M, and towards which side it goes

    def limit(self, J_eq: float | Sequence[float], estimate: Estimate | None, time: float) -> Decision:
        """The largest part of a command that keeps the limits.

        Parameters
        ----------
        J_eq : float or sequence of float
            What is asked for [W], one number for each command of the structure.
        estimate : Estimate or None
            The wires, from an `Observer`; None where there is no estimate. The same one may be given again, later.
        time : float
            When the command is to be in force [s], in the time of the estimate.

        Returns
        -------
        Decision
            What may be in force, and why it is not all that was asked for.

        Raises
        ------
        UserError
            For another number of commands or wires than the structure has.
        """
        expect('estimate', estimate, Estimate | None)
        expect('time', time, float)
        asked = np.atleast_1d(as_array('J_eq', J_eq, '[W]'))
        if asked.shape != (self._size,):
            raise UserError(f'J_eq = {J_eq}: expected {self._size} number(s) [W]')
        if estimate is not None and estimate.T.shape != (self._wires,):
            raise UserError(
                f'estimate: it is of {len(estimate.T)} wire(s); expected one of {self._wires}, as this guard has'
            )
        if estimate is not None and np.isfinite(estimate.x_M).all():
            self._count_cycles(estimate.x_M)
        scale, kind, reason = self._judged(asked, estimate, time)
        if kind and kind != self._kind:
            self.counters.interventions[kind] += 1
        self._kind = kind
        allowed = asked * scale if scale > 0.0 else np.zeros(self._size)
        before, self._heating = self._heating, self._heating_of(allowed)
        self._commands.append((time, np.maximum(before, self._heating)))
        return Decision(tuple(allowed.tolist()), scale, kind, reason)

    def passed(self, estimate: Estimate) -> list[str]:
        """The limits beyond which a wire is, whatever is commanded, in words."""
        return [
            f'{name} of wire {wire + 1} is {scale * value:.1f} {unit}, beyond guard.{name}_max {scale * most:g} {unit}'
            for name, values, scale, unit in (
                ('T', estimate.T, 1.0, 'K'),
                ('stress', estimate.stress, 1e-6, 'MPa'),
                ('strain', estimate.strain, 100.0, '%'),
            )
            for most in [self._limits[f'{name}_max']]
            for wire, value in enumerate(values.tolist())
            if value > most
        ]

    def _judged(self, asked: Vector, estimate: Estimate | None, time: float) -> tuple[float, str, str]:
        """The part of a command, the kind of intervention and its reason."""
        if wrong := refusal(asked.tolist(), self._size, self._signed):
            return 0.0, REFUSED, f'{REFUSED}: {", ".join(map(str, asked.tolist()))} W, {wrong}'
        late = math.inf if estimate is None else time - estimate.time
        known = estimate is not None and np.isfinite([*estimate.mean, *estimate.stress_std, *estimate.strain]).all()
        if estimate is None or not known or not abs(late) <= self._limits['silence'] * self.pace:
            return 0.0, UNKNOWN, f'there is no estimate of the last {self._limits["silence"]:g} s'
        most, T_std = self._limits['T_std_max'], estimate.T_std
        if not (T_std <= most).all():
            wire = int(np.argmax(T_std))
            return 0.0, UNCERTAIN, f'T of wire {wire + 1} is known to {T_std[wire]:.1f} K only (guard.T_std_max {most:g} K)'
        estimate, heating = self._as_at(estimate, time), self._heating_of(asked)
        if not heating.any():
            return 1.0, '', ''
        found = [self._by_temperature(heating, estimate), self._by_stress(heating, estimate)]
        found += [self._by_strain(estimate), self._by_cycles(heating)]
        kind = int(np.argmin([scale for scale, _ in found]))
        scale, reason = found[kind]
        return (1.0, '', '') if scale >= 1.0 else (max(scale, 0.0), OVER[kind], reason)

    def _heating_of(self, J_eq: Vector) -> Vector:
        """Of one wire of each bundle (wires,) [W]."""
        return np.array([commanded_heating(i, np.append(J_eq, 0.0), self._system) for i in range(self._wires)])

    def _as_at(self, estimate: Estimate, time: float) -> Estimate:
        """An estimate as it may be at a time [s]: no wire is hotter and none under more stress."""
        before, self._last = self._last, estimate
        if before is not estimate or self._carried is None:
            passed = 0.0 if before is None else estimate.time - before.time
            rates = np.zeros(self._wires) if before is None or passed <= 0.0 else (estimate.stress - before.stress) / passed
            self._carried, self._stretching = estimate, np.maximum(rates, 0.0)
        if self._commands[-1][0] > time:  # times have gone back: any of these may be the last
            self._commands = [(-math.inf, np.max([heating for _, heating in self._commands], axis=0))]
        while len(self._commands) > 1 and self._commands[1][0] <= estimate.time:
            del self._commands[0]
        ends = [start for start, _ in self._commands[1:]]
        for (_, heating), end in zip(self._commands, [*ends, time], strict=True):
            self._carried = self._carried_on(self._carried, heating, end)
        return self._carried

    def _carried_on(self, since: Estimate, heating: Vector, time: float) -> Estimate:
        """What may become of an estimate until a time [s], which is not before it, under a heating."""
        lasted = max(time - since.time, 0.0)
        T, rise = self._prediction(heating, since, lasted)
        stress = since.stress + np.where(
            heating > 0.0, self._wire.sigma_T * np.maximum(T + rise - since.T, 0.0), self._stretching * lasted
        )
        return replace(since, time=since.time + lasted, T=T + rise, stress=stress)

    def _prediction(self, heating: Vector, estimate: Estimate, lasted: float) -> tuple[Vector, Vector]:
        """Temperatures after so many seconds without heating, and what heating adds (wires,) [K]."""
        T, for_each_watt = heat_balance(self._wire, estimate.T, self.T_E, lasted)
        return T, for_each_watt * heating

    def _by_temperature(self, heating: Vector, estimate: Estimate) -> tuple[float, str]:
        T, rise = self._prediction(heating, estimate, self._limits['horizon'])
        limit = self._limits['T_max'] - self._limits['margin'] * estimate.T_std
        scale, wire = smallest(limit - T, rise)
        known, highest = f'known to {estimate.T_std[wire]:.1f} K', T[wire] + rise[wire]
        limits = f'guard.T_max {self._limits["T_max"]:g} K, guard.margin {self._limits["margin"]:g}'
        return scale, f'T of wire {wire + 1} would be {highest:.1f} K, {known} ({limits})'

    def _by_stress(self, heating: Vector, estimate: Estimate) -> tuple[float, str]:
        """A wire that is not heated is stretched by the others: as fast as until now, as long as they are."""
        T, rise = self._prediction(heating, estimate, self._limits['horizon'])
        slope = self._wire.sigma_T
        coasting = slope * np.minimum(T - estimate.T, 0.0)  # of a wire that cools: none is counted on where it is not heated
        heated = heating > 0.0
        without = estimate.stress + np.where(heated, coasting, 0.0)
        more = np.where(heated, slope * rise, self._stretching * self._limits['horizon'])
        limit = self._limits['stress_max'] - self._limits['margin'] * estimate.stress_std
        scale, wire = smallest(limit - without, more)
        highest = 1e-6 * (without[wire] + more[wire])
        return (
            scale,
            f'stress of wire {wire + 1} would be {highest:.0f} MPa (limit {1e-6 * self._limits["stress_max"]:g} MPa)',
        )

    def _by_strain(self, estimate: Estimate) -> tuple[float, str]:
        wire, most = int(np.argmax(estimate.strain)), self._limits['strain_max']
        strain = estimate.strain[wire]
        words = f'wire {wire + 1} is strained by {100.0 * strain:.2f} % (guard.strain_max {100.0 * most:g} %)'
        return (0.0 if strain > most else 1.0), words

    def _by_cycles(self, heating: Vector) -> tuple[float, str]:
        most = self._limits['cycles_max']
        spent = [i for i in range(self._wires) if heating[i] > 0.0 and self.counters.cycles[i] >= most]
        words = f'wire {spent[0] + 1} has done {self.counters.cycles[spent[0]]:g} cycles (guard.cycles_max)' if spent else ''
        return (0.0 if spent else 1.0), words

    def _count_cycles(self, x_M: Vector) -> None:
        """Half a cycle for every turn of x_M by more than CYCLE."""
        if not self._turns:
            self._turns = [(float(x), 0) for x in x_M]
        for i, x in enumerate(x_M.tolist()):
            extreme, side = self._turns[i]
            if side * (x - extreme) >= 0.0 and side:
                self._turns[i] = (x, side)
            elif abs(x - extreme) > CYCLE:
                self.counters.cycles[i] += 0.5 if side else 0.0  # the way to the first extreme is no turn
                self._turns[i] = (x, 1 if x > extreme else -1)


def smallest(room: Vector, added: Vector) -> tuple[float, int]:
    """The largest part of what is added (wires,) for which there is room, at most 1, and the wire that bounds it."""
    with np.errstate(divide='ignore', invalid='ignore', over='ignore'):
        parts = np.where(added > room, np.maximum(room, 0.0) / added, 1.0)
    parts = np.where((room < 0.0) & (added <= 0.0), 1.0, parts)
    wire = int(np.argmin(parts))
    return float(parts[wire]), wire
