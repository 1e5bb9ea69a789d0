"""Learn a controller of the module in a minute: `python examples/learn_to_track.py` (needs `pip install 'sma_sim[gym]'`).

A policy with few numbers is improved by the cross-entropy method: many policies are tried side by side, the best of them
say where to look next. `--posterior FILE` takes what `sma-sim fit --json FILE` wrote, so that every episode is of another
robot that your recordings allow.
"""

import argparse

import gymnasium
import numpy as np

import sma_sim.gym
from sma_sim.gym import Posterior

TRIED, BEST, EPISODES = 32, 6, 2  # policies in a generation, of which the best are kept; episodes of each
TEST = 0  # seed of the episodes that no policy was improved with: robot i has the seed + i


def actions(policies, observations, memory):
    """Of policies (n, 6): feedback, feedforward of the target, damping, and an integral that leaks; (n, 1)."""
    position, rate, target, ahead = observations[:, 0], observations[:, 1], observations[:, 2], observations[:, 3]
    memory += 0.02 * (target - position) - 0.002 * memory
    features = np.column_stack([target - position, rate, target, ahead - target, memory, np.ones(len(position))])
    return np.tanh((policies * features).sum(axis=1, keepdims=True)).astype(np.float32)


def mean_errors(robots, policies, seed):
    """Mean distance to the target of every policy, over its episodes, in parts of half the range."""
    repeated = np.repeat(policies, EPISODES, axis=0)
    observations, _ = robots.reset(seed=seed)
    memory, errors = np.zeros(len(repeated)), np.zeros(len(repeated))
    steps = robots.unwrapped.task.steps
    for _ in range(steps):
        observations, *_ = robots.step(actions(repeated, observations, memory))
        errors += np.abs(observations[:, 0] - observations[:, 2])
    return (errors / steps).reshape(-1, EPISODES).mean(axis=1)


parser = argparse.ArgumentParser()
parser.add_argument('--environment', default='Module', choices=sorted(sma_sim.gym.ENVIRONMENTS))
parser.add_argument('--generations', type=int, default=20)
parser.add_argument('--posterior')
arguments = parser.parse_args()
posterior = Posterior.read(arguments.posterior) if arguments.posterior else None
name = f'sma_sim/{arguments.environment}-v0'
robots = gymnasium.make_vec(name, num_envs=TRIED * EPISODES, posterior=posterior, duration=12.0)
random, centre, spread = np.random.default_rng(0), np.zeros(6), np.array([2.0, 0.3, 1.0, 1.0, 2.0, 0.3])

print(f'mean error of no control: {mean_errors(robots, np.zeros((TRIED, 6)), TEST).mean():.4f}')
for generation in range(arguments.generations):
    policies = centre + spread * random.standard_normal((TRIED, 6))
    best = policies[np.argsort(mean_errors(robots, policies, (generation + 1) * TRIED * EPISODES))[:BEST]]
    centre, spread = best.mean(axis=0), best.std(axis=0) + 0.02
print('policy:', np.round(centre, 3).tolist())
print(f'mean error of the learned policy: {mean_errors(robots, np.tile(centre, (TRIED, 1)), TEST).mean():.4f}')
