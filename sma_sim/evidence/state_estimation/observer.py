"""An extended Kalman filter on the model of a robot: temperatures, fractions and stresses of its wires while it runs.

The state is that of the model, the parameters that are not known well, by which part the heating of each wire differs from
the command, the ambient temperature, and a slow difference of model and sensor in every channel:

    xi = (y, x_M, z, g, T_E, b),      z, g, T_E and b decay to their means (Ornstein and Uhlenbeck).

Between two times the model runs with tangents (`solver.propagation`), over jumps of the hybrid automaton too, so that
P+ = Phi (P + Q) Phi'. A measurement is h(y, z) + b + noise, with the derivatives of h beside the state. Parameters are
estimated beside the states (Jazwinski, Stochastic Processes and Filtering Theory, 1970, section 8.4), so that what is not
known of them is in every interval; the lasting difference b keeps the filter from learning more than the model can know.

The run that is linearised is not corrected: corrections are carried beside it, by the same tangents, until a new run starts
from the estimate. A filter that linearises about every new estimate sees its parameters from many points, takes that for
information about combinations of them that no measurement tells apart, and becomes sure of wrong values (Huang, Mourikis
and Roumeliotis, Int. J. Robotics Research 29 (2010) 502, of the same in mapping). Where a new run starts, mean and
covariance pass through coordinates in which those combinations do not depend on the state (`invariants`).

At first there are two hypotheses: that the robot is at rest, and that it has any history: any pose, wires as hot as heating
can make them, with x_M between x^(4) and x^(5), at which wires of that pose and temperature transform (paper, C_3), and
forces that balance. The latter is linearised about its first measurement, by an iterated update (Bell and Cathey, IEEE
Trans. Autom. Control 38 (1993) 294), since the stress of a wire follows its temperature along one of two lines that are
dsigma/sigma_T apart. Each has its filter, and the estimate has the mean and covariance of both by their probabilities,
until measurements have decided (Magill, IEEE Trans. Autom. Control 10 (1965) 434).

As long as innovations are larger than the filter expects, all that it says has so many times the variance (the ratio of
Birge, Phys. Rev. 40 (1932) 207). The heating is what drives a wire, and how it follows a command is not measured. Nobody
tells by which factor all power differs from the commands: c_V and lambda are those for a watt of the command
(`uncertain_parameters`). Nor are drivers linear: g is an Ornstein-Uhlenbeck process in the command too, of which a change
by J_max forgets most, so that full power for a moment does not tell the power of a lower command. And as long as that
ratio R is more than 1, the power that reaches a wire fluctuates about the command, with R - 1 times the variance
`power_std`^2 and for as long as R is averaged over: a driver that is late is then not taken for a wire of another heat
capacity, and cooling, of which the driver has no part, tells it.

A wire is not colder than its surroundings but for the heat that it takes to transform to austenite. A linear correction by
what contradicts the commands knows nothing of that; what is said of the wires, and predictions, do (`_not_too_cold`).

Sensors that are stuck show wires that no power warms. Where parameters that explain what is measured are as improbable as
that, a wire may be as hot as the commands alone would make it: the variance of T has that, by the probability of either.
"""

from __future__ import annotations

import bisect
import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import pinvh
from scipy.optimize import nnls
from scipy.special import expit, ndtr

from sma_sim.evidence.state_estimation.estimate import Estimate, RobotState
from sma_sim.evidence.state_estimation.heat_balance import heat_balance
from sma_sim.evidence.state_estimation.invariants import InvariantCoordinates
from sma_sim.evidence.state_estimation.uncertain import (
    channel_discrepancies,
    configured,
    heating_std,
    models_about,
    prior_correlation,
    uncertain_parameters,
)
from sma_sim.model.argument_checks import as_array, as_kelvin, expect
from sma_sim.model.automaton import INNER, TO_AUSTENITE, TO_MARTENSITE
from sma_sim.model.config import Config
from sma_sim.model.errors import PhysicsWarning, UserError
from sma_sim.model.expected_units import mismatch_of
from sma_sim.model.material import heat_capacity, latent_heat
from sma_sim.model.nearest import suggestion
from sma_sim.model.system import commanded_heating
from sma_sim.solver.integrate import PER_WIRE, WIRE_COLUMNS, Run
from sma_sim.solver.model import Model
from sma_sim.solver.propagation import DELTA, FRACTION_SCALE, Propagation, run_at_rest
from sma_sim.solver.simulate import SimulationError, copy_of_run

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

WINDOW = 1.0  # [s] of the past into which late messages are still put
MAX_PAUSE = 3600.0  # [s] without any message: the wires are at rest long before, and hours of steps would take minutes
LONGEST_STEP = 0.25  # [s] over which the random walks are put in at once
FIRST_RUN, LONGER, LONGEST_RUN = 2.0, 1.5, 20.0  # [s] of the first run; by how much each is longer; of all later ones
FIRST_RUN_OF_ANY = 0.1  # [s] of a robot of any history, whose first measurements move the estimate far
USUAL_TIME = 0.1  # [s] in which a pose may change by as much as it usually does
AGREEMENT_TIME = 2.0  # [s] after which hypotheses of the start agree: temperatures forget it within a second
IMPROBABLE = 14.0  # by which the log of a probability is less where a hypothesis is given up, or stuck sensors: 1e-6
ITERATIONS = 4  # of the first update of such a robot
LARGEST_INNOVATION = 4.0  # standard deviations; a larger one counts as if its noise were larger, so that it is no more
INCONSISTENCY_TIME = 2.0  # [s] of the running mean of squared innovations
LEAST_STD = {'T': 0.1, 'x_M': 0.003, 'sigma': 1e4}  # of an estimate: what the equations themselves leave out
OUTPUTS = ('T', 'x_M', 'sigma')
EARLIER = 1e-9  # [s] by which a time counts as earlier than another


class Event(NamedTuple):
    """What is heard of a time [s]: measured channels (NaN: none), and what is in force from then on (None: as before)."""

    time: float
    measured: Vector
    heating: tuple[float, ...] | None
    T_E: float | None


@dataclass(frozen=True)
class Reference:
    """The model of a run that is linearised: its parameters z (P,), parts of heating and T_E as `extra`, since when [s]."""

    propagation: Propagation
    extra: Vector
    since: float
    until: float


class Belief(NamedTuple):
    """What the filter holds at a time: nothing of it is changed in place."""

    time: float
    reference: Reference
    run: Run
    mean: Vector  # of all that is estimated, less what the run has of it
    covariance: Matrix
    heating: tuple[float, ...]
    T_E: float
    inconsistency: float
    is_corrected: bool  # by a measurement since the robot was taken to be at rest
    warmed: Vector  # by the commands alone, of which none becomes latent heat (wires,) [K] above T_E
    unheated: float  # of a wire that nothing heats and that does not transform, at the least [K]
    log_evidence: float = 0.0  # of all measurements since then
    forces_are_measured: bool = False


Hypotheses = tuple[Belief, ...]  # the most probable one first


class Observer:
    """The wires of a robot from its commands and what is measured of it.

    Parameters
    ----------
    config : Config
        The model. Its `covariance`, which a fit has left, is that of its parameters, else standard deviations in its
        `priors` are; the noise of a channel is ``check.noise_CHANNEL``; how far the robot may be from the model say the
        parameters ``observer.*``.

    Raises
    ------
    UserError
        For a structure whose runs have no derivatives.
    SimulationError
        If the model has no start at rest.

    Examples
    --------
    >>> import sma_sim
    >>> from sma_sim.observer import Observer
    >>> observer = Observer(sma_sim.Config())
    >>> estimate = observer.update(0.0, 12.0, {'alpha': 0.0})
    >>> for k in range(1, 21):
    ...     estimate = observer.update(0.05 * k, None, {'U_x': -5e-5, 'F_1': 16.0 + 0.5 * k})
    >>> estimate.T.shape, bool(estimate.T[0] > estimate.T[1] + 20.0)
    ((2,), True)
    """

    def __init__(self, config: Config) -> None:
        expect('config', config, Config)
        self.config = config
        self._structure = config.structure
        self.channels = self._structure.channels
        self._gain_std = config.parameters['observer.gain_std']
        self._free = uncertain_parameters(config, self._gain_std)
        self._noise = np.array([config.parameters[f'check.noise_{name}'] for name in self.channels])
        self._limits = np.array([(one.low, one.high) for one in self._free]).reshape(-1, 2)
        self.restarts, self.too_late = 0, 0
        self._unseen = set(self.channels)
        self._events: list[Event] = []
        self._beliefs: list[Hypotheses] = []  # after each of the events
        self._estimate: Estimate | None = None
        self._observed: tuple[Run, Vector, Matrix] | None = None  # the last run that was looked at, and what was seen
        self._agree_at = -math.inf  # [s], when one hypothesis is enough
        self._scales: Vector | None = None  # those of the first model
        first = self._reference(np.zeros(len(self._free) + self._structure.wires + 1), 0.0, FIRST_RUN)
        self._prepare(first.propagation)
        self._first = self._start(first, 0.0, (0.0,) * self._structure.wires, config.parameters['environment.T_E'])
        self._seen(self._propagated(self._first, LONGEST_STEP))  # loads compiled code now and not at the first message

    @property
    def time(self) -> float:
        """The time of the estimate [s]; NaN before the first message."""
        return self._beliefs[-1][0].time if self._beliefs else math.nan

    @property
    def parameters(self) -> dict[str, tuple[float, float]]:
        """Estimated values of the uncertain parameters by full name, and their standard deviations (SI)."""
        belief, at = self._beliefs[-1][0] if self._beliefs else self._first, self._at.parameters
        stds = np.sqrt(np.diag(belief.covariance)[at])
        found = {}
        for one, z, std in zip(self._free, belief.mean[at].tolist(), stds.tolist(), strict=True):
            value = one.value(z)
            found[one.name] = (value, std * one.scale * (value if one.log else 1.0))
        return found

    @property
    def estimate(self) -> Estimate:
        """The wires at `time`. Raises UserError before the first message."""
        if not self._beliefs:
            raise UserError('the observer has no measurement yet: call update(time, J_eq, measurements) first')
        if self._estimate is None:
            self._estimate = self._estimate_of(self._beliefs[-1])
        return self._estimate

    @property
    def state(self) -> RobotState:
        """Where a prediction begins: at `time`, with the parameters that are estimated.

        Raises UserError before the first message.
        """
        estimate, belief, at = self.estimate, self._not_too_cold(self._beliefs[-1][0]), self._at
        run, mean = self._run_from_estimate(belief)
        return RobotState(
            belief.time,
            Model(configured(self.config, self._free, mean[at.parameters])),
            run,
            np.maximum(1.0 + mean[at.heating], 0.0),
            belief.T_E + float(mean[at.T_E]),
            mean[at.count :],
            estimate.T_std,
            estimate.stress_std,
        )

    def predict(self, time: float, J_eq: float | Sequence[float] | None = None, T_E: float | None = None) -> Estimate:
        """The wires at `time` [s] without a new measurement; the rest as for `update`."""
        return self.update(time, J_eq, {}, T_E)

    def update(
        self,
        time: float,
        J_eq: float | Sequence[float] | None = None,
        measurements: Mapping[str, float] | None = None,
        T_E: float | None = None,
    ) -> Estimate:
        """Take what is known of a time.

        Parameters
        ----------
        time : float
            When it was [s]. It may be earlier than that of calls before, by WINDOW at the most; what is older is ignored and
            counted in `too_late`.
        J_eq : float or sequence of float, optional
            Heating that is in force from `time` on [W], one for each command of the structure; None: the same as before.
        measurements : mapping of str to float
            What sensors show at `time` by channel, such as ``alpha`` or ``F_1`` (SI). NaN is the same as nothing.
        T_E : float, optional
            Ambient temperature from `time` on [K]; None: the same as before, at first that of the configuration.

        Returns
        -------
        Estimate
            The wires at the latest time that the observer was told of.

        Raises
        ------
        UserError
            For a channel that the structure does not have, a wrong number of commands, values that are not finite, and a
            time more than an hour after the one before.

        Warns
        -----
        PhysicsWarning
            Where the first value of a channel cannot be in its SI unit.
        """
        self.tell(time, J_eq, measurements, T_E)
        return self.estimate

    def tell(
        self,
        time: float,
        J_eq: float | Sequence[float] | None = None,
        measurements: Mapping[str, float] | None = None,
        T_E: float | None = None,
    ) -> None:
        """The same as `update` without an estimate, where nobody asks for one: `estimate` makes it when it is read."""
        expect('time', time, float)
        expect('measurements', measurements, Mapping[str, float] | None)
        ambient = None if T_E is None else as_kelvin('T_E', T_E)
        event = Event(time, self._measured(measurements or {}), self._heating(J_eq), ambient)
        if not math.isfinite(time):
            raise UserError(f'time = {time}: expected a finite time [s]')
        if self._beliefs and time > self.time + MAX_PAUSE:
            pause = time - self.time
            raise UserError(
                f'time = {time:g} s is {pause:g} s after the one before: expected seconds, {MAX_PAUSE:g} at most; make '
                'another Observer after a pause or a jump of the clock'
            )
        if self._beliefs and time < self._beliefs[0][0].time - EARLIER:
            self.too_late += 1
            return
        at = bisect.bisect_right(self._events, time + EARLIER, key=lambda one: one.time)
        later = [event, *self._events[at:]]
        del self._events[at:], self._beliefs[at:]
        self._estimate = None
        for one in later:
            self._events.append(one)
            self._beliefs.append(self._after(one))
        self._forget()

    def forecast(self, J_eq: float | Sequence[float] | None, times: Sequence[float]) -> list[Estimate]:
        """The wires at later `times` [s], from `time` on, under a heating that stays (None: that of now).

        Nothing of the observer changes. Raises UserError before the first message, and for times before it.
        """
        if not self._beliefs:
            raise UserError('the observer has no measurement yet: call update(time, J_eq, measurements) first')
        beliefs, found, at = self._beliefs[-1], [], np.atleast_1d(as_array('times', times, '[s]'))
        if not (np.diff(at, prepend=self.time) >= 0.0).all():
            raise UserError(f'times: expected times [s] that increase from {self.time:g} s on, that of the last message')
        heating = self._heating(J_eq)
        beliefs = tuple(one._replace(heating=heating or one.heating) for one in beliefs)
        for time in at.tolist():
            beliefs = tuple(self._propagated(one, time) for one in beliefs)
            found.append(self._estimate_of(beliefs))
        return found

    def _measured(self, measurements: Mapping[str, float]) -> Vector:
        values = np.full(len(self.channels), np.nan)
        for name, value in measurements.items():
            if name not in self.channels:
                raise UserError(
                    f'measurements: {name!r} is no channel of system {self._structure.name!r}'
                    f'{suggestion(name, self.channels)}; expected some of {", ".join(self.channels)}'
                )
            if math.isinf(value):
                raise UserError(f'measurements: {name} = {value}; expected a finite number')
            if name in self._unseen and not math.isnan(value):  # a later one may be an outlier, which the filter bounds
                self._unseen.remove(name)
                column = self._structure.channel_columns[self.channels.index(name)]
                if mismatch := mismatch_of(column, np.array([value])):
                    warnings.warn(f'measurements, {name}: {mismatch.words}', PhysicsWarning, stacklevel=4)
            values[self.channels.index(name)] = value
        return values

    def _heating(self, J_eq: float | Sequence[float] | None) -> tuple[float, ...] | None:
        """The heating of each wire [W]."""
        if J_eq is None:
            return None
        commands = np.atleast_1d(as_array('J_eq', J_eq, '[W]'))
        expected = len(self._structure.commands)
        if commands.shape != (expected,) or not np.isfinite(commands).all():
            raise UserError(f'J_eq = {J_eq}: expected {expected} finite number(s) [W]')
        propagation = self._first.reference.propagation
        p, n = propagation.model.compiled, propagation.model.wire.n
        u = np.append(commands, 0.0)
        return tuple(n * commanded_heating(i, u, p) for i in range(self._structure.wires))

    def _reference(self, extra: Vector, since: float, until: float) -> Reference:
        """The model at some parameters, with its derivatives, for a run from `since` to `until` [s]."""
        propagation = Propagation(*models_about(self.config, self._free, extra[: len(self._free)]), self._scales)
        self._scales = propagation.scales
        return Reference(propagation, extra, since, until)

    def _prepare(self, propagation: Propagation) -> None:
        """Random walks, decays and the places of outputs, which do not depend on parameters."""
        u = {name.removeprefix('observer.'): value for name, value in self.config.parameters.items()}
        self._at, where = propagation.unknowns, propagation.where
        at, wires, p = self._at, self._structure.wires, propagation.model.compiled
        self._size = at.count + len(self.channels)
        self._walk, self._decay, stationary = np.zeros((3, self._size))
        temperatures = self._temperatures = slice(p.first_T, p.first_T + wires)
        self._is_mas = p.mas
        self._fractions = slice(p.first_x, p.first_x + wires) if p.mas else at.fractions
        unit = propagation.scales[p.first_x] if p.mas else FRACTION_SCALE
        self._scales_of_T = propagation.scales[temperatures]
        self._coordinates = InvariantCoordinates(
            self._free,
            self.config.parameters,
            at,
            np.arange(at.count)[temperatures],
            np.arange(at.count)[self._fractions],
            self._scales_of_T,
            np.full(wires, unit),
        )
        self._with_forces = replace(self._coordinates, by_dsigma=False)
        self._walk[temperatures] = (u['T_walk'] / self._scales_of_T) ** 2
        self._walk[self._fractions] = (u['x_M_walk'] / unit) ** 2
        for place, std, time in (
            (at.parameters, 1.0, u['parameter_time']),
            (at.heating, heating_std(self.config), u['power_time']),
            (at.T_E, u['T_E_std'], u['T_E_time']),
            (slice(at.count, self._size), channel_discrepancies(self.config), u['discrepancy_time']),
        ):
            self._decay[place], stationary[place] = 1.0 / time, np.square(std)
        self._fluctuation = 2.0 * INCONSISTENCY_TIME * u['power_std'] ** 2
        self._stationary = np.diag(stationary)
        self._stationary[at.parameters, at.parameters] = prior_correlation(self.config, self._free, self._gain_std)
        wire, of_states = propagation.model.wire, np.zeros(self._size)
        self._wire, beside_states = wire, slice(at.parameters.start, self._size)
        self._warming = self.config.parameters['node.J_max'] / (wire.n * wire.lambda_ * wire.surface)  # [K]
        self._precision = pinvh(self._stationary[beside_states, beside_states])
        of_states[temperatures] = (u['initial_T_std'] / self._scales_of_T) ** 2
        of_states[: p.coordinates] = u['discrepancy'] ** 2
        of_states[self._fractions] = (u['initial_x_M_std'] / unit) ** 2
        self._at_start = self._stationary + np.diag(of_states)
        of_states[temperatures] = (self._warming / self._scales_of_T) ** 2 / 12.0
        n = p.coordinates
        of_states[:n], of_states[n : 2 * n] = 1.0, (propagation.scales[:n] / propagation.scales[n : 2 * n] / USUAL_TIME) ** 2
        of_states[self._fractions] = 1.0  # at either transformation
        self._at_any = self._stationary + np.diag(of_states)
        self._forces = slice(p.coordinates, p.coordinates + wires)  # among channels
        self._shown = np.arange(where.sensed.start, where.sensed.stop)
        of_wire = where.wires.start + PER_WIRE * np.arange(wires)
        self._outputs = np.concatenate([of_wire + WIRE_COLUMNS.index(name) for name in OUTPUTS])
        self._mode, self._length = (of_wire + WIRE_COLUMNS.index(name) for name in ('mode', 'length'))
        self._least = np.diag(np.repeat([LEAST_STD[name] for name in OUTPUTS], wires) ** 2)

    def _start(self, reference: Reference, time: float, heating: tuple[float, ...], T_E: float) -> Belief:
        """A robot at rest."""
        propagation, at = reference.propagation, self._at
        run, spread = run_at_rest(propagation.model, T_E), np.eye(self._size)
        for j, moved in enumerate(models_about(self.config, self._free, reference.extra[: len(self._free)])[1]):
            beside = run_at_rest(moved, T_E).state
            column = spread[:, at.parameters.start + j]
            column[at.states] = (beside.y - run.state.y) / propagation.scales / DELTA
            if not propagation.model.compiled.mas:
                column[at.fractions] = (beside.x_frozen - run.state.x_frozen) / FRACTION_SCALE / DELTA
        mean = np.zeros(self._size)
        mean[at.parameters.start : at.count] = reference.extra
        covariance = spread @ self._at_start @ spread.T
        return Belief(time, reference, run, mean, covariance, heating, T_E, 1.0, False, np.zeros(len(heating)), T_E)

    def _after(self, event: Event) -> Hypotheses:
        """The beliefs after an event that follows those that there are beliefs of."""
        if self._beliefs:
            beliefs = tuple(self._propagated(one, event.time) for one in self._beliefs[-1])
        else:
            first = replace(self._first.reference, since=event.time, until=event.time + FIRST_RUN)
            belief = self._first._replace(time=event.time, reference=first)
            if event.T_E is not None and event.T_E != belief.T_E:
                belief = self._start(first, event.time, belief.heating, event.T_E)
            beliefs = (belief,)
        if np.isfinite(event.measured).any():
            beliefs = self._all_corrected(beliefs, event.measured)
        return tuple(self._told_of(one, event) for one in beliefs)

    def _told_of(self, belief: Belief, event: Event) -> Belief:
        """A belief that knows what is in force after an event."""
        if event.heating is not None:
            belief = self._commanded(belief, event.heating)
        belief = belief if event.T_E is None else belief._replace(T_E=event.T_E)
        return self._run_anew(belief) if belief.time >= belief.reference.until else belief

    def _commanded(self, belief: Belief, heating: tuple[float, ...]) -> Belief:
        """A belief under another heating (wires,) [W], at which the power of a wire differs from it by another part."""
        at, same = self._at.heating, np.ones(self._size)
        same[at] = np.exp(-np.abs(np.subtract(heating, belief.heating)) / self.config.parameters['node.J_max'])
        covariance = belief.covariance * np.outer(same, same)
        covariance[at, at] += np.diag((1.0 - same[at] ** 2) * self.config.parameters['observer.gain_change_std'] ** 2)
        return belief._replace(heating=heating, mean=belief.mean * same, covariance=covariance)

    def _all_corrected(self, beliefs: Hypotheses, measured: Vector) -> Hypotheses:
        """The beliefs after a measurement (channels,), but for those that it makes improbable."""
        rivals = [one for one in beliefs if one.is_corrected]
        if not rivals:
            self._agree_at = beliefs[0].time + AGREEMENT_TIME
            rivals = [beliefs[0], self._of_any_history(beliefs[0], measured)]
        elif rivals[0].time > self._agree_at:
            rivals = rivals[:1]
        found = [self._corrected(one, measured) for one in rivals]
        if len(found) > 1:
            evidence = [one.log_evidence + self._log_density(one, measured) for one in rivals]
            found = [after._replace(log_evidence=log) for after, log in zip(found, evidence, strict=True)]
            if not rivals[1].is_corrected:
                found[1] = self._with_pure_wires(found[1])
            found.sort(key=lambda one: -one.log_evidence)
        return tuple(one for one in found if one.log_evidence > found[0].log_evidence - IMPROBABLE)

    def _inputs(self, belief: Belief) -> Vector:
        """The heating of each wire [W] and T_E [K] of the run (wires + 1,)."""
        inputs = belief.reference.extra[len(self._free) :].copy()
        inputs[:-1] = np.maximum(1.0 + inputs[:-1], 0.0) * belief.heating
        inputs[-1] += belief.T_E
        return inputs

    def _beside(self, belief: Belief) -> Vector:
        """What the estimate has more than the run (unknowns,)."""
        away = belief.mean[: self._at.count].copy()
        away[self._at.parameters.start :] -= belief.reference.extra
        return away

    def _propagated(self, belief: Belief, time: float) -> Belief:
        """The belief at a later time."""
        if time <= belief.time:
            return belief
        count = max(1, math.ceil((time - belief.time) / LONGEST_STEP - 1e-9))
        if count == 1:
            return self._step(belief, time)
        for end in np.linspace(belief.time, time, count + 1)[1:]:
            belief = self._step(belief, float(end))
        return belief

    def _step(self, belief: Belief, time: float) -> Belief:
        dt, at, propagation = time - belief.time, self._at, belief.reference.propagation
        run = copy_of_run(propagation.model, belief.run)
        try:
            moved = propagation.advance(run, np.array([belief.time, time]), self._inputs(belief)[None])
        except SimulationError:
            self.restarts += 1
            again = self._start(self._first.reference, time, belief.heating, belief.T_E)
            return again._replace(warmed=belief.warmed, unheated=belief.unheated)
        decay, first, size = np.exp(-self._decay * dt), at.parameters.start, self._size
        transition = np.zeros((size, size))
        transition.flat[:: size + 1] = decay
        transition[:first, : at.count] = moved[:first]
        before = belief.covariance.copy()
        before.flat[:: size + 1] += self._walk * dt
        covariance = transition @ before @ transition.T + self._stationary * (1.0 - decay[:, None] * decay)
        stirred = math.sqrt(self._fluctuation * max(belief.inconsistency - 1.0, 0.0) / dt) * moved[:first, at.heating]
        covariance[:first, :first] += stirred @ stirred.T
        mean = belief.mean * decay
        mean[:first] = moved[:first] @ self._beside(belief)
        warmed, for_each_watt = heat_balance(self._wire, belief.warmed, 0.0, dt)
        warmed = warmed + for_each_watt * np.divide(belief.heating, self._wire.n)
        follows, _ = heat_balance(self._wire, np.array([belief.unheated]), belief.T_E, dt)
        unheated = min(float(follows[0]), belief.T_E)
        return belief._replace(time=time, run=run, mean=mean, covariance=covariance, warmed=warmed, unheated=unheated)

    def _seen(self, belief: Belief) -> tuple[Vector, Matrix]:
        """A whole sample at a belief, and its derivatives in all that is estimated."""
        sample, derivatives = self._seen_of_run(belief)
        whole = np.zeros((len(sample), self._size))
        whole[:, : self._at.count] = derivatives
        return sample + derivatives @ self._beside(belief), whole

    def _seen_of_run(self, belief: Belief) -> tuple[Vector, Matrix]:
        """A whole sample of the run of a belief, and its derivatives in the unknowns of a run."""
        if self._observed is None or self._observed[0] is not belief.run:  # a correction leaves the run as it is
            sample, derivatives = belief.reference.propagation.observe(belief.time, belief.run, self._inputs(belief))
            self._observed = belief.run, sample, derivatives
        return self._observed[1:]

    def _innovation(self, belief: Belief, measured: Vector) -> tuple[Vector, Vector, Matrix, Matrix]:
        """What is measured less what is expected, where it is not NaN (m,); its squares over their variances, its covariance
        (m, m), and P H' (all that is estimated, m)."""
        there = np.flatnonzero(np.isfinite(measured))
        sample, derivatives = self._seen(belief)
        biases = self._at.count + there
        H = derivatives[self._shown[there]]
        H[np.arange(len(there)), biases] = 1.0
        innovation = measured[there] - sample[self._shown[there]] - belief.mean[biases]
        gained = belief.covariance @ H.T
        expected = H @ gained
        variances = expected.reshape(-1)[:: len(there) + 1]  # its diagonal
        variances += self._noise[there] ** 2
        return innovation, innovation**2 / variances, expected, gained

    def _of_any_history(self, belief: Belief, measured: Vector) -> Belief:
        """What is believed of a robot before a first measurement (channels,), linearised about what it says."""
        reference = replace(self._first.reference, since=belief.time - FIRST_RUN_OF_ANY, until=belief.time)
        model, scales, states = reference.propagation.model, reference.propagation.scales, self._at.states
        at_rest = run_at_rest(model, belief.T_E)
        prior = at_rest.state.y / scales
        prior[self._temperatures] += 0.5 * self._warming / self._scales_of_T
        about, found = prior.copy(), belief
        for number in range(ITERATIONS):
            if number:
                about = about + self._corrected(found, measured).mean[states]
            run, mean = copy_of_run(model, at_rest), np.zeros(self._size)
            run.state.y[:] = scales * about
            spread = self._put_between_transformations(run, reference, belief)
            mean[states] = prior - about
            covariance = spread @ self._at_any @ spread.T
            found = belief._replace(reference=reference, run=run, mean=spread @ mean, covariance=covariance)
            found = self._balanced(found)
        return found

    def _put_between_transformations(self, run: Run, reference: Reference, belief: Belief) -> Matrix:
        """Give wires x_M half way between the fractions at which they transform in their pose and at their temperatures.

        Returns derivatives (size, size) of all that is estimated in the same, where x_M of a wire is replaced by where it
        is between both: -1 in mode 4, 1 in mode 5.
        """
        propagation, state, size = reference.propagation, run.state, self._at.count
        u = np.append(belief.heating, belief.T_E)
        (least, of_least), (most, of_most) = (
            propagation.fractions_of_transforming(belief.time, run, u, mode) for mode in (TO_MARTENSITE, TO_AUSTENITE)
        )
        unit, spread = self._coordinates.x_scale, np.eye(self._size)
        spread[self._fractions, :size] = 0.5 * (of_least + of_most) / unit[:, None]
        spread[self._fractions, self._fractions] = np.diag(0.5 * (most - least) / unit)
        middle = np.clip(0.5 * (least + most), 0.0, 1.0)
        state.mode[:], state.x_frozen[:] = INNER, middle
        if self._is_mas:
            state.y[self._fractions] = middle
        return spread

    def _balanced(self, belief: Belief) -> Belief:
        """A belief that knows that the forces on the structure balance but for what accelerates it usually."""
        propagation = belief.reference.propagation
        n, scales = propagation.model.compiled.coordinates, propagation.scales
        accelerations, of_unknowns = propagation.accelerations(belief.time, belief.run, self._inputs(belief))
        H = np.zeros((n, self._size))
        H[:, : self._at.count] = of_unknowns
        gained = belief.covariance @ H.T
        expected = H @ gained + np.diag((scales[:n] / USUAL_TIME**2) ** 2)
        gain = np.linalg.solve(expected, gained.T).T
        mean = belief.mean - gain @ (accelerations + H @ belief.mean)
        return belief._replace(mean=mean, covariance=belief.covariance - gain @ gained.T)

    def _with_pure_wires(self, belief: Belief) -> Belief:
        """The belief that knows that pure austenite may be hotter than where it transforms, and pure martensite colder.

        A temperature follows the stress of its wire, or lies anywhere beyond: mean and variance of both cases together.
        """
        place, scales, unit = self._temperatures, self._scales_of_T, self._coordinates.x_scale
        estimate, std = self._about(belief) + belief.mean, np.sqrt(np.diag(belief.covariance))
        T, x_M, x_M_std = scales * estimate[place], unit * estimate[self._fractions], unit * std[self._fractions]
        austenite, martensite = ndtr(-x_M / x_M_std), ndtr((x_M - 1.0) / x_M_std)
        hotter, colder = np.maximum([belief.T_E + self._warming - T, T - belief.T_E], 0.0) / scales
        follows, shift = np.ones(self._size), 0.5 * (austenite * hotter - martensite * colder)
        follows[place] -= austenite + martensite
        mean, covariance = belief.mean.copy(), belief.covariance * np.outer(follows, follows)
        mean[place] += shift
        square = follows[place] * std[place] ** 2 + (austenite * hotter**2 + martensite * colder**2) / 3.0
        covariance[place, place][np.diag_indices(len(T))] = square - shift**2
        return belief._replace(mean=mean, covariance=covariance)

    def _corrected(self, belief: Belief, measured: Vector) -> Belief:
        """The belief after a measurement (channels,), NaN where there is none."""
        innovation, squares, expected, gained = self._innovation(belief, measured)
        expected.reshape(-1)[:: len(squares) + 1] *= np.maximum(squares / LARGEST_INNOVATION**2, 1.0)
        gain = np.linalg.solve(expected, gained.T).T
        covariance = belief.covariance - gain @ gained.T
        return belief._replace(
            mean=self._within_limits(belief.mean + gain @ innovation),
            covariance=0.5 * (covariance + covariance.T),
            inconsistency=self._running(belief, float(np.mean(squares))),
            is_corrected=True,
            forces_are_measured=belief.forces_are_measured or bool(np.isfinite(measured[self._forces]).any()),
        )

    def _not_too_cold(self, belief: Belief) -> Belief:
        """The belief with a mean of which no wire is colder than its surroundings leave it.

        C d(T - T_E)/dt = J/n - lambda A_s (T - T_E) + L_x dx_M/dt with J >= 0 leaves

            T >= T_E - (1 - x_M) L_x/C :

        where both sides are the same, the left one less the right one does not decrease. After T_E has risen, in place of it
        stands the temperature of a wire that follows it. A linear correction knows no bound. A mean that is beyond is moved
        to the most probable place that is not (Simon and Chia, IEEE Trans. Aerosp. Electron. Syst. 38 (2002) 128): the least
        d' P^-1 d with inequalities, by its dual problem. The covariance stays: of a normal distribution whose mean is beyond
        a bound, what is within has a mean square about the bound of no more than the variance, and of all of it where the
        mean is at the bound.

        The filter itself goes on without: what is beyond a bound again and again is no information about parameters.
        """
        sample, derivatives = self._seen_of_run(belief)
        slopes = derivatives[self._outputs]
        T, x_M, stress = (sample[self._outputs] + slopes @ self._beside(belief)).reshape(len(OUTPUTS), -1)
        wire, least = belief.reference.propagation.model.wire, belief.unheated
        heats = np.array([latent_heat(least, max(sigma, 0.0), wire) for sigma in stress.tolist()])
        colder = np.clip(1.0 - x_M, 0.0, 1.0) * heats / heat_capacity(least, 1.0, wire)
        room = T + colder - least - belief.mean[self._at.T_E]
        if not (room < 0.0).any():
            return belief
        rows = np.zeros((len(T), self._size))
        rows[:, : self._at.count] = slopes[: len(T)]
        rows[:, self._at.T_E] -= 1.0
        gained = belief.covariance @ rows.T
        variances, directions = np.linalg.eigh(rows @ gained)
        known = variances > np.finfo(float).eps * variances[-1]
        roots, directions = np.sqrt(variances[known]), directions[:, known]
        pushes, _ = nnls(roots[:, None] * directions.T, -room @ directions / roots)
        return belief._replace(mean=self._within_limits(belief.mean + gained @ pushes))

    def _within_limits(self, mean: Vector) -> Vector:
        """All that is estimated (size,), its parameters within their limits, in place."""
        at = self._at.parameters
        mean[at] = np.clip(mean[at], self._limits[:, 0], self._limits[:, 1])
        return mean

    def _log_density(self, belief: Belief, measured: Vector) -> float:
        """Log of the density that a belief gives to a measurement (channels,), of which an outlier decides nothing."""
        innovation, squares, expected, _ = self._innovation(belief, measured)
        expected.reshape(-1)[:: len(squares) + 1] *= np.maximum(squares / LARGEST_INNOVATION**2, 1.0)
        squares = innovation @ np.linalg.solve(expected, innovation)
        return -0.5 * float(squares + np.linalg.slogdet(2.0 * np.pi * expected)[1])

    def _running(self, belief: Belief, square: float) -> float:
        """The running mean of the squared innovations with another one."""
        before = self.time if self._beliefs else belief.time
        new = -math.expm1(-max(belief.time - before, 0.0) / INCONSISTENCY_TIME)
        return (1.0 - new) * belief.inconsistency + new * square

    def _run_anew(self, belief: Belief) -> Belief:
        """The same belief about a run that starts from the estimate."""
        at, before = self._at, belief.reference
        lasted = min(LONGER * (before.until - before.since), LONGEST_RUN)
        run, mean = self._run_from_estimate(belief)
        covariance = self._coordinates_of(belief).covariance(
            belief.covariance, self._about(belief), mean, belief.T_E, self._told(belief.run)
        )
        reference = self._reference(mean[at.parameters.start : at.count].copy(), belief.time, belief.time + lasted)
        mean[: at.parameters.start] = 0.0
        return belief._replace(reference=reference, run=run, mean=mean, covariance=0.5 * (covariance + covariance.T))

    def _about(self, belief: Belief) -> Vector:
        """What the run has of all that is estimated (size,)."""
        at, state, about = self._at, belief.run.state, np.zeros(self._size)
        about[at.states] = state.y / belief.reference.propagation.scales
        about[at.fractions] = state.x_frozen / FRACTION_SCALE
        about[at.parameters.start : at.count] = belief.reference.extra
        return about

    def _whole(self, belief: Belief, about: Vector) -> Vector:
        """All that is estimated (size,), with what the run has of the states."""
        states = slice(self._at.parameters.start)
        whole = belief.mean.copy()
        whole[states] += about[states]
        return whole

    def _coordinates_of(self, belief: Belief) -> InvariantCoordinates:
        """Those in which what is not measured is one direction."""
        return self._with_forces if belief.forces_are_measured else self._coordinates

    def _told(self, run: Run) -> NDArray[np.bool_]:
        """Of which wires x_M is part of the state (wires,)."""
        told: NDArray[np.bool_] = run.state.mode == INNER
        return np.ones_like(told) if self._is_mas else told

    def _run_from_estimate(self, belief: Belief) -> tuple[Run, Vector]:
        """A run that is where the estimate says, and the mean about it."""
        at, propagation, about = self._at, belief.reference.propagation, self._about(belief)
        run, p, scales = copy_of_run(propagation.model, belief.run), propagation.model.compiled, propagation.scales
        state = run.state
        mean = self._coordinates_of(belief).mean(self._whole(belief, about), about, belief.T_E, self._told(run))
        state.y[:] = scales * mean[at.states]
        if p.mas:
            fractions = slice(p.first_x, p.first_x + p.wires)
            state.y[fractions] = np.clip(state.y[fractions], 0.0, 1.0)
        else:
            state.x_frozen[:] = np.clip(FRACTION_SCALE * mean[at.fractions], 0.0, 1.0)
        return run, mean

    def _estimate_of(self, beliefs: Hypotheses) -> Estimate:
        """Mean and covariance over all hypotheses; modes are those of the most probable one."""
        found = [self._estimate_by(one) for one in beliefs]
        if len(found) == 1:
            return found[0]
        weights = np.exp([one.log_evidence - beliefs[0].log_evidence for one in beliefs])
        weights /= weights.sum()
        means = np.array([one.mean for one in found])
        mean = weights @ means
        spread = (means - mean).T @ (weights[:, None] * (means - mean))
        covariance = np.tensordot(weights, [one.covariance for one in found], 1) + spread
        T, x_M, stress = mean.reshape(len(OUTPUTS), -1)
        return replace(found[0], T=T, x_M=x_M, stress=stress, covariance=covariance)

    def _estimate_by(self, belief: Belief) -> Estimate:
        belief = self._not_too_cold(belief)
        sample, derivatives = self._seen(belief)
        out = derivatives[self._outputs]
        about = self._about(belief)
        whole, wires = self._whole(belief, about), self._structure.wires
        out[:wires] = self._coordinates_of(belief).of_temperatures(whole, about)
        covariance = max(1.0, belief.inconsistency) * (out @ belief.covariance @ out.T + self._least)
        T, x_M, stress = sample[self._outputs].reshape(len(OUTPUTS), -1)
        hotter = np.maximum(belief.T_E + belief.warmed - T, 0.0)
        covariance[:wires, :wires] += self._doubt(whole) * np.diag(hotter**2)
        values = belief.reference.propagation.model.config.parameters
        strain = np.array([one for one, _ in self._structure.strains(sample[self._length].tolist(), values)])
        return Estimate(
            belief.time,
            T,
            np.clip(x_M, 0.0, 1.0),
            stress,
            sample[self._mode].round().astype(np.int64),
            covariance,
            strain,
            belief.inconsistency,
        )

    def _doubt(self, whole: Vector) -> float:
        """The probability that what is measured is not of this robot, by all that is estimated (size,).

        That sensors are stuck, or the structure is blocked, was improbable before; so are, given enough of it, the
        parameters, powers and biases of a model that explains it. Their log prior density less that of the most probable
        ones is minus half their squares in units of the prior.
        """
        beside = whole[self._at.parameters.start :]
        return float(expit(0.5 * beside @ self._precision @ beside - IMPROBABLE))

    def _forget(self) -> None:
        """Drop what is older than the window, but for one belief."""
        oldest = self._events[-1].time - WINDOW
        while len(self._events) > 1 and self._events[1].time < oldest:
            del self._events[0], self._beliefs[0]
