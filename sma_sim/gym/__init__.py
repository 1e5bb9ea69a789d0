"""Gymnasium environments: a structure driven by SMA wires tracks a target. Importing this registers them.

``gymnasium.make('sma_sim/Module-v0')``, and Lever, Slider and Coil; ``gymnasium.make_vec('sma_sim/Module-v0', num_envs=64)``
steps many robots at once.
"""

from __future__ import annotations

from sma_sim.gym.posterior import Posterior as Posterior
from sma_sim.model.optional import require

require('gymnasium', 'sma_sim.gym')

from gymnasium.envs.registration import register  # noqa: E402

from sma_sim.gym.environment import TrackingEnv as TrackingEnv  # noqa: E402
from sma_sim.gym.task import Task as Task  # noqa: E402
from sma_sim.gym.vector import TrackingVectorEnv as TrackingVectorEnv  # noqa: E402

ENVIRONMENTS = {'Module': 'module', 'Lever': 'lever', 'Slider': 'slider', 'Coil': 'coil'}

for _name, _system in ENVIRONMENTS.items():
    register(
        f'sma_sim/{_name}-v0',
        entry_point='sma_sim.gym.environment:TrackingEnv',
        vector_entry_point='sma_sim.gym.vector:TrackingVectorEnv',
        kwargs={'system': _system},
    )
