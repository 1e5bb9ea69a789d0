"""Many robots as one Gymnasium environment, without a process or a Python environment for each."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from sma_sim.gym.environment import FAILED, spaces_of, task_of
from sma_sim.gym.posterior import Posterior
from sma_sim.gym.robots import Robots
from sma_sim.model.config import Config

Batch = tuple[NDArray[np.float32], NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]


class TrackingVectorEnv(VectorEnv[NDArray[np.float32], NDArray[np.float32], NDArray[Any]]):
    """`TrackingEnv` for many robots: ``num_envs`` of them, the other parameters are the same.

    An episode that has ended begins anew with the next step, whose action is not used and whose reward is 0
    (``AutoresetMode.NEXT_STEP``).
    """

    metadata: dict[str, Any] = {'render_modes': [], 'autoreset_mode': AutoresetMode.NEXT_STEP}

    def __init__(
        self,
        num_envs: int = 1,
        system: str = 'module',
        config: Config | None = None,
        posterior: Posterior | None = None,
        **task: Any,
    ) -> None:
        self.num_envs, self.task = num_envs, task_of(system, config, posterior, task)
        self.single_observation_space, self.single_action_space = spaces_of(self.task)
        self.observation_space: gymnasium.Space[Any] = batch_space(self.single_observation_space, num_envs)
        self.action_space: gymnasium.Space[Any] = batch_space(self.single_action_space, num_envs)
        self._robots, self._over = Robots(self.task, num_envs), np.zeros(num_envs, dtype=bool)
        self._randoms: list[np.random.Generator] = []

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Begin an episode of every robot; that of robot i is the one of a `TrackingEnv` with the seed `seed` + i."""
        if seed is not None or not self._randoms:
            first = int(np.random.SeedSequence().generate_state(1)[0]) if seed is None else seed
            self._randoms = [np.random.default_rng(first + i) for i in range(self.num_envs)]
        for i, random in enumerate(self._randoms):
            self._robots.restart(i, random)
        self._over[:] = False
        return self._robots.observation, {}

    def step(self, actions: NDArray[np.float32]) -> Batch:
        """Heat all robots for one period."""
        again = self._over.copy()
        failed = self._robots.step(np.asarray(actions, dtype=float), np.flatnonzero(~again))
        for i in np.flatnonzero(again).tolist():
            self._robots.restart(i, self._randoms[i])
        reward = np.where(again, 0.0, np.where(failed, FAILED, self._robots.reward))
        truncated = self._robots.ended & ~again
        self._over = truncated | failed
        return self._robots.observation, reward, failed, truncated, {}
