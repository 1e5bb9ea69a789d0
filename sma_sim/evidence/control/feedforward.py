"""Feedforward: the heating with which a model follows a target, and a PI controller for what the model does not know."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping

import numpy as np

from sma_sim.evidence.control.pi import PI
from sma_sim.evidence.control.plan import Planner, Target
from sma_sim.evidence.state_estimation.estimate import RobotState
from sma_sim.model.argument_checks import as_finite, as_kelvin, expect
from sma_sim.model.arrays import Vector
from sma_sim.model.config import Config
from sma_sim.model.errors import PhysicsWarning, UserError
from sma_sim.model.expected_units import mismatch_of
from sma_sim.solver.columns import sample_columns
from sma_sim.solver.fixed_rate import FixedRateRun
from sma_sim.solver.integrate import PER_WIRE, WIRE_COLUMNS
from sma_sim.solver.model import Model

ITERATIONS = 3  # of a plan: its run begins where the one before went, so that few are needed
MAX_PAUSE = 60.0  # [s] between steps: wires are at rest long before, and the model would take minutes to make up for more
EARLY = 1e-6  # [s] by which a period may begin early


class Feedforward:
    """Inverts a model along a target, one period after the other, by a run of the model that follows it.

    ``target(times)`` gives the wanted values of the coordinate at times (k,) [s]; it is asked for the times up to
    ``control.horizon`` ahead, since wires have to be left to cool before a target turns.

    Parameters
    ----------
    config : Config
        The model, the parameters ``control.*``, and the limits ``guard.T_max``, ``guard.stress_max`` and ``node.J_max``.

    Raises
    ------
    UserError
        For a structure that more than one heating command moves.
    SimulationError
        If the model has no start at rest.

    Examples
    --------
    >>> import numpy as np, sma_sim
    >>> from sma_sim.control import Feedforward
    >>> feedforward = Feedforward(sma_sim.Config())
    >>> J_eq = [feedforward.step(lambda times: 0.02 * np.minimum(times, 1.0)) for _ in range(50)]
    >>> bool(max(J_eq) <= 30.0), bool(abs(feedforward.value - 0.02) < 2e-3)
    (True, True)
    """

    def __init__(self, config: Config) -> None:
        expect('config', config, Config)
        self._planner, self.model = Planner(config, ITERATIONS), Model(config)
        self.T_E, self._rate = config.parameters['environment.T_E'], 1.0 / self._planner.period
        self.coordinate = self._planner.coordinate
        self._nothing = np.zeros(self.model.wires)
        self.restart()

    def restart(self) -> None:
        """The model is at rest again, at time 0."""
        self._run = FixedRateRun(self.model, self._rate, np.array([0.0, self.T_E]))
        self._planner.restart()

    @property
    def time(self) -> float:
        """How far the model has gone [s]."""
        return self._run.time

    @property
    def value(self) -> float:
        """What the sensor of the coordinate shows of the model at `time` [rad or m]."""
        return self._run.shown(self.coordinate)

    @property
    def temperatures(self) -> Vector:
        """Temperatures of the model's wires at `time` (wires,) [K]."""
        return self._of_wires('T')

    @property
    def stresses(self) -> Vector:
        """Stresses of the model's wires at `time` (wires,) [Pa]."""
        return self._of_wires('sigma')

    @property
    def bounds(self) -> tuple[float, float]:
        """Least and largest command [W], as of `Planner.bounds`."""
        return self._planner.bounds(self.T_E)

    def _of_wires(self, name: str) -> Vector:
        rows = self._run.sample[sample_columns(self.model.structure).wires].reshape(-1, PER_WIRE)
        return np.array(rows[:, WIRE_COLUMNS.index(name)])

    def step(self, target: Target) -> float:
        """The command [W] for the period from `time` on, over which the model goes on. Raises SimulationError."""
        expect('target', target, Target)
        none = self._nothing
        start = RobotState(
            self.time, self.model, self._run.run, none + 1.0, self.T_E, np.zeros(len(self.model.structure.channels)),
            none, none,
        )  # fmt: skip
        J_eq = self._planner.plan(start, target)
        self._run.step(np.array([J_eq, self.T_E]))
        return J_eq


class FeedforwardPI:
    """A `Feedforward`, and a PI controller that keeps the robot where the model is.

    Its gains are ``control.kp`` and ``control.ki``. The robot is compared with what the model's sensor shows, not with the
    target: where the target is out of reach, within limits or as fast as wires cool, nothing winds up, and what effects do
    to the sensor is no error. Nor does it where `observe` tells that a guard has taken power away. Both together command no
    more than `Planner.bounds`.

    Parameters and errors are those of `Feedforward`; `coordinate` is the name of what follows the target.
    """

    def __init__(self, config: Config) -> None:
        self.feedforward, given = Feedforward(config), config.parameters
        self.coordinate = self.feedforward.coordinate
        self._law = PI(given['control.kp'], given['control.ki'], given['node.J_max'])
        self._begin, self._before = math.nan, math.nan  # the times of the first step and of the last one
        self._shown, self._J_eq = 0.0, 0.0  # of the model, at its last step and from then on
        self._commanded, self._cut = 0.0, 0.0  # the last command, and what a guard has taken of it

    def observe(
        self,
        time: float,
        J_eq: float | None = None,
        measurements: Mapping[str, float] | None = None,
        T_E: float | None = None,
    ) -> None:
        """Take the command in force [W] and the ambient temperature [K] from now on; what is measured is nothing here."""
        if J_eq is not None:
            self._cut = self._commanded - J_eq
        if T_E is not None:
            self.feedforward.T_E = as_kelvin('T_E', T_E)

    def step(self, time: float, measurements: Mapping[str, float], target: Target) -> float:
        """The command [W] from `time` [s] on.

        At the first step the model is at rest; at later ones it goes on to their time.

        Parameters
        ----------
        time : float
            Now [s].
        measurements : mapping of str to float
            What sensors show now, of which that of the coordinate is used [rad or m].
        target : callable
            From times (k,) [s] to wanted values of the coordinate (k,) [rad or m].

        Raises
        ------
        UserError
            Where the measured coordinate is missing or not finite, and for times that go back or on by more than MAX_PAUSE.
        SimulationError
            Where the model cannot follow under any command.
        """
        expect('target', target, Target)
        expect('measurements', measurements, Mapping[str, float])
        if self.coordinate not in measurements:
            given = ', '.join(measurements) or 'nothing'
            raise UserError(f'measurements: {self.coordinate} is missing; expected a finite number, got {given}')
        measured = as_finite(f'measurements: {self.coordinate}', measurements[self.coordinate])
        if math.isnan(self._begin):
            coordinates = self.feedforward.model.structure.coordinates
            column = next(one.column for one in coordinates if one.name == self.coordinate)
            if mismatch := mismatch_of(column, np.array([measured])):
                warnings.warn(f'measurements, {self.coordinate}: {mismatch.words}', PhysicsWarning, stacklevel=2)
            self._begin = self._before = as_finite('time', time)
        if not 0.0 <= time - self._before <= MAX_PAUSE:
            raise UserError(
                f'time = {time:g} s after {self._before:g} s: expected seconds that go on by {MAX_PAUSE:g} at most; make '
                'another controller after a pause or a jump of the clock'
            )
        begin, model = self._begin, self.feedforward
        while begin + model.time <= time + EARLY:
            self._shown = model.value
            self._J_eq = model.step(lambda times: target(begin + times))
        error, lasted = self._shown - measured, time - self._before
        self._before = time
        if self._cut * error > 0.0:  # a guard holds what is asked for already: the integral stands still
            lasted = 0.0
        self._commanded = self._law(error, lasted, self._J_eq, *model.bounds)
        return self._commanded
