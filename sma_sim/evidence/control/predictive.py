"""Model predictive control: an observer says where the robot is, and a plan how it goes on from there."""

from __future__ import annotations

from collections.abc import Mapping

from sma_sim.evidence.control.plan import Planner, Target
from sma_sim.evidence.state_estimation.observer import Observer
from sma_sim.model.argument_checks import expect
from sma_sim.model.config import Config

ITERATIONS = 1  # of a plan, which begins from the one before (Diehl et al., SIAM J. Control Optim. 43 (2005) 1714)


class PredictiveController:
    """Follows a target by the model of a YAML file, from the state that an `Observer` estimates.

    What the model does not say of the robot, the observer learns: parameters, heating, ambient temperature, and how far the
    coordinate is from the model, which the plan takes as lasting (an output disturbance: Pannocchia and Rawlings, AIChE J.
    49 (2003) 426).

    The first one on a machine compiles the derivatives of the model, which takes some 20 s.

    Parameters
    ----------
    config : Config
        The model, the parameters ``control.*`` and ``observer.*``, and the limits ``guard.T_max``, ``guard.stress_max``,
        kept clear of by ``guard.margin`` standard deviations, and ``node.J_max``.

    Attributes
    ----------
    coordinate : str
        What follows the target.
    observer : Observer
        Which knows the robot.

    Raises
    ------
    UserError
        For a structure that more than one heating command moves.
    SimulationError
        If the model has no start at rest.

    Examples
    --------
    >>> import numpy as np, sma_sim
    >>> from sma_sim.control import PredictiveController
    >>> controller = PredictiveController(sma_sim.Config())
    >>> J_eq = controller.step(0.0, {'alpha': 0.0}, lambda times: 0.05 + 0.0 * times)
    >>> controller.observe(0.0, J_eq)  # it is in force
    >>> 0.0 < J_eq <= 30.0
    True
    """

    def __init__(self, config: Config) -> None:
        expect('config', config, Config)
        self._planner, self.observer = Planner(config, ITERATIONS), Observer(config)
        self.coordinate = self._planner.coordinate

    def observe(
        self,
        time: float,
        J_eq: float | None = None,
        measurements: Mapping[str, float] | None = None,
        T_E: float | None = None,
    ) -> None:
        """Take what is known of a time, as `Observer.tell` does; every command that was in force has to be told."""
        self.observer.tell(time, J_eq, measurements, T_E)

    def step(self, time: float, measurements: Mapping[str, float], target: Target) -> float:
        """The command [W] from `time` [s] on.

        Parameters
        ----------
        time : float
            Now [s].
        measurements : mapping of str to float
            What sensors show now by channel, as for `Observer.update`.
        target : callable
            From times (k,) [s] to wanted values of the coordinate (k,) [rad or m].

        Raises
        ------
        UserError
            For a channel that the structure does not have, and values that are not finite.
        SimulationError
            Where the model cannot go on from here under any command.
        """
        expect('target', target, Target)
        self.observe(time, None, measurements)
        return self._planner.plan(self.observer.state, target)
