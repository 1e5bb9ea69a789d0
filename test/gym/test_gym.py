"""Gymnasium environments: its own checker, repeatability, one robot against many, and robots that a fit knows."""

import json
import subprocess
import sys
import warnings
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import sma_sim.gym
from sma_sim import Config, UserError
from sma_sim.gym import Posterior
from sma_sim.solver.integrate import N_STEPS

ROOT = Path(__file__).resolve().parents[2]
NAMES = sorted(sma_sim.gym.ENVIRONMENTS)


def episode(env, actions, seed=3):
    """Observations and rewards under given actions."""
    seen = [env.reset(seed=seed)[0]]
    rewards = []
    for action in actions:
        observation, reward, *_ = env.step(action)
        seen.append(observation)
        rewards.append(reward)
    return np.array(seen), np.array(rewards)


@pytest.mark.parametrize('name', NAMES)
def test_gymnasiums_own_checker_has_nothing_to_say(name):
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        check_env(gymnasium.make(f'sma_sim/{name}-v0', duration=0.5).unwrapped)


@pytest.mark.parametrize('name', NAMES)
def test_many_robots_are_as_one_by_itself(name):
    """The same actions give the same observations to the last bit, whichever neighbours a robot has."""
    actions = np.random.default_rng(1).uniform(-1.0, 1.0, (30, 3, 1)).astype(np.float32)
    many = gymnasium.make_vec(f'sma_sim/{name}-v0', num_envs=3, duration=0.5)
    first, _ = many.reset(seed=7)
    together = [first, *(many.step(action)[0] for action in actions[:24])]
    one = gymnasium.make(f'sma_sim/{name}-v0', duration=0.5).unwrapped
    for i in range(3):
        assert np.array_equal(np.array(together)[:, i], episode(one, actions[:24, i], 7 + i)[0])


def test_an_episode_ends_and_the_next_begins_with_the_step_after():
    many = gymnasium.make_vec('sma_sim/Slider-v0', num_envs=2, duration=0.2)
    many.reset(seed=1)
    action = np.full((2, 1), 1.0, np.float32)
    for k in range(1, 11):
        observation, reward, terminated, truncated, _ = many.step(action)
        assert truncated.all() == (k == 10) and not terminated.any() and (reward < 0.0).all()
    moved = observation[:, 0].copy()
    observation, reward, _, truncated, _ = many.step(action)
    assert not truncated.any() and (reward == 0.0).all() and (observation[:, 0] < moved).all()
    assert (observation[:, -1] == -1.0).all()  # at rest nothing is heated


@pytest.mark.parametrize('name', NAMES)
def test_tolerances_are_those_of_what_is_observed(name):
    """Positions are right to 1e-3 of half the range, in a few steps of the solver for an action however actions jump.

    At the default of ``solver.rtol`` a module takes some thirty: its plate rings by nanometres, which nobody observes.
    """
    actions = np.random.default_rng(6).uniform(-1.0, 1.0, (100, 4, 1)).astype(np.float32)
    seen, made = [], []
    for further in ({}, {'config': Config({'solver.rtol': 1e-8}, name.lower())}):
        robots = gymnasium.make_vec(f'sma_sim/{name}-v0', num_envs=4, **further).unwrapped
        robots.reset(seed=3)
        seen.append([])
        for action in actions:
            seen[-1].append(robots.step(action)[0][:, 0])
            made.append(robots._robots._robots._batch.counts[:, N_STEPS].mean())
    assert np.abs(np.subtract(*seen)).max() < 1e-3
    assert np.mean(made[:100]) < min(5.0, np.mean(made[100:]))


@pytest.mark.parametrize('name', NAMES)
def test_the_target_can_be_reached_and_heating_moves_towards_it(name):
    env = gymnasium.make(f'sma_sim/{name}-v0').unwrapped
    (low, high), task = (-1.0, 1.0), env.task
    targets = np.concatenate([task.target(np.random.default_rng(seed)) for seed in range(20)])
    assert low < targets.min() < -0.5 and 0.5 < targets.max() < high
    middle, half = task.span
    assert half > 0.0
    full, _ = episode(env, [np.ones(1, np.float32)] * 400)
    assert full[-1, 0] == pytest.approx(1.0, abs=0.05) and full[-1, 4] == 1.0
    observation, info = env.reset(seed=4)
    assert info['position'] == pytest.approx(middle + half * observation[0]) and abs(observation[0] - info['target']) > 0.0
    assert env.reset(seed=4)[1] == info and env.reset(seed=5)[1]['target'] != info['target']


def test_rewards_say_how_near_the_target_is():
    """-|error| and up to 0.01 for heating; a proportional controller is better than none."""
    env = gymnasium.make('sma_sim/Module-v0', duration=10.0).unwrapped
    totals = {}
    for gain in (0.0, 4.0):
        observation, _ = env.reset(seed=2)
        rewards = []
        for _ in range(env.task.steps):
            action = np.clip([gain * (observation[2] - observation[0])], -1.0, 1.0).astype(np.float32)
            observation, reward, terminated, truncated, _ = env.step(action)
            assert reward == pytest.approx(-abs(observation[0] - observation[2]) - 0.01 * abs(action[0]), abs=1e-6)
            rewards.append(reward)
        assert truncated and not terminated
        totals[gain] = np.mean(rewards)
    assert totals[4.0] > 0.5 * totals[0.0]


def posterior_file(path):
    """As a fit writes it: two parameters that are correlated, one that data do not determine."""
    found = {
        'wire.lambda': {'value': 400.0, 'std': 0.05, 'log': True, 'seen': True},
        'wire.sigma_MW0': {'value': 1.2e8, 'std': 1e6, 'log': False, 'seen': True},
        'wire.c_V': {'value': 380.0, 'std': 3.0, 'log': True, 'seen': False},
    }
    path.write_text(json.dumps({'parameters': found, 'correlation': [[1.0, 0.8, 0.1], [0.8, 1.0, 0.2], [0.1, 0.2, 1.0]]}))
    return path


def test_episodes_are_of_robots_that_the_fit_allows(tmp_path):
    posterior = Posterior.read(posterior_file(tmp_path / 'fit.json'))
    random = np.random.default_rng(0)
    drawn = [posterior.draw(random) for _ in range(2000)]
    cooling = np.log([one['wire.lambda'] / 400.0 for one in drawn])
    stress = np.array([one['wire.sigma_MW0'] for one in drawn])
    assert cooling.std() == pytest.approx(0.05, rel=0.15) and stress.std() == pytest.approx(1e6, rel=0.15)
    assert np.corrcoef(cooling, stress)[0, 1] == pytest.approx(0.8, abs=0.05)
    assert {one['wire.c_V'] for one in drawn} == {380.0} and np.abs(cooling).max() <= 0.05 * 1.96
    env = gymnasium.make('sma_sim/Module-v0', posterior=posterior, duration=1.0)
    actions = [np.ones(1, np.float32)] * 50
    first, again, other = (episode(env, actions, seed)[0][-1, 0] for seed in (1, 1, 2))
    assert first == again != other


@pytest.mark.parametrize(
    ('given', 'message'),
    [
        ({'system': 'wire'}, 'no motion that heating controls'),
        ({'system': 'lever', 'tracked': 'angel'}, "'angel' is no channel of lever; did you mean angle"),
        ({'observed': ('T_3',)}, "'T_3' is no channel of module"),
        ({'duration': 0.0}, 'duration = 0: expected more than 0'),
        ({'hold': (3.0, 2.0)}, 'expected the shortest and the longest'),
    ],
)
def test_what_is_no_task_is_said(given, message):
    with pytest.raises(UserError, match=message):
        sma_sim.gym.TrackingEnv(**given)


def test_a_file_without_intervals_is_no_posterior(tmp_path):
    (tmp_path / 'other.json').write_text('{"parameters": {"wire.E_A": {"value": 1.0}}}')
    with pytest.raises(UserError, match='no intervals of a fit'):
        Posterior.read(tmp_path / 'other.json')
    with pytest.raises(UserError, match='cannot read'):
        Posterior.read(tmp_path / 'none.json')


def test_further_channels_are_observed():
    env = sma_sim.gym.TrackingEnv('lever', observed=['T_1', 'F_2'], hold=[2.0, 5.0])
    observation, _ = env.reset(seed=0)
    assert observation.shape == (7,) and observation[5] == pytest.approx(0.0, abs=1e-6)
    for _ in range(100):
        observation, *_ = env.step(np.ones(1, np.float32))
    assert observation[5] > 1.0 and env.observation_space.contains(observation)


@pytest.mark.slow
def test_the_example_learns():
    words = [sys.executable, str(ROOT / 'examples' / 'learn_to_track.py'), '--generations', '12']
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    before, after = (float(line.split()[-1]) for line in done.stdout.splitlines() if 'mean error' in line)
    assert after < 0.5 * before
