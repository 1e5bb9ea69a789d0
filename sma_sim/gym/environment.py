"""One robot as a Gymnasium environment."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from sma_sim.gym.posterior import Posterior
from sma_sim.gym.robots import Robots
from sma_sim.gym.task import LARGEST, Task
from sma_sim.model.config import Config

FIRST = np.zeros(1, dtype=np.int64)  # the only robot
FAILED = -10.0  # reward of an action after which the model has no solution


def task_of(system: str, config: Config | None, posterior: Posterior | None, task: Any) -> Task:
    """The task of an environment as it may be given. Raises UserError."""
    return Task(Config(system=system) if config is None else config, posterior, **task)


def spaces_of(task: Task) -> tuple[gymnasium.Space[Any], gymnasium.Space[Any]]:
    """Observations and actions of one robot."""
    return (
        gymnasium.spaces.Box(-LARGEST, LARGEST, (task.size,), np.float32),
        gymnasium.spaces.Box(-1.0, 1.0, (task.commands,), np.float32),
    )


class TrackingEnv(gymnasium.Env[NDArray[np.float32], NDArray[np.float32]]):
    """A coordinate of a structure follows a target by heating its wires.

    Parameters
    ----------
    system : str
        A structure, at the defaults.
    config : Config, optional
        A robot of your own in its place.
    posterior : Posterior, optional
        What a fit knows of it: every episode is of another robot.
    task : keyword arguments
        Further fields of `Task`: ``rate``, ``duration``, ``observed`` and others.

    An action is a number from -1 to 1 for each heating command: of antagonistic pairs full power into bundle 2 or 1, else
    from none to full. An observation has the position and its rate, the target now and in half a second, all over half of
    the range that full heating reaches, the last action, and further channels. The reward of an action is minus the distance
    to the target, less up to 0.01 for heating; an episode ends after its time, or with -10 where the model has no solution.
    """

    metadata: dict[str, Any] = {'render_modes': []}

    def __init__(
        self, system: str = 'module', config: Config | None = None, posterior: Posterior | None = None, **task: Any
    ) -> None:
        self.task = task_of(system, config, posterior, task)
        self.observation_space, self.action_space = spaces_of(self.task)
        self._robots = Robots(self.task, 1)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Begin an episode."""
        super().reset(seed=seed)
        self._robots.restart(0, self.np_random)
        return self._robots.observation[0], self._info()

    def step(self, action: NDArray[np.float32]) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Heat for one period."""
        failed = bool(self._robots.step(np.asarray(action, dtype=float).reshape(1, -1), FIRST)[0])
        reward = FAILED if failed else float(self._robots.reward[0])
        return self._robots.observation[0], reward, failed, bool(self._robots.ended[0]), self._info()

    def _info(self) -> dict[str, Any]:
        """Position and target in the coordinate's unit."""
        middle, half = self.task.span
        positions = (float(self._robots.position[0]), float(self._robots.target[0]))
        return {name: middle + half * value for name, value in zip(('position', 'target'), positions, strict=True)}
