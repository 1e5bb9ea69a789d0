"""Robots that are stepped side by side: each as by itself, whatever its neighbours do."""

import numpy as np
import pytest

from sma_sim import Config, Model
from sma_sim.solver.fixed_rate import FixedRateRun
from sma_sim.solver.side_by_side import SideBySide


@pytest.mark.parametrize('effects', [(), ('driver_lag', 'sensor_lag')])
@pytest.mark.parametrize('kinetics', ['hybrid', 'mas'])
@pytest.mark.parametrize('system', ['module', 'slider', 'coil'])
def test_steps_are_those_of_a_run_by_itself(system, kinetics, effects):
    """To the last bit, with parameters of its own, and where a robot rests while others move."""
    models = [Model(Config({'wire.sigma_MW0': s}, system, kinetics, effects)) for s in (1.2e8, 1.25e8, 1.3e8)]
    first, random = np.array([0.0, 298.0]), np.random.default_rng(2)
    robots, alone = SideBySide(models[0], 50.0, 3), [FixedRateRun(model, 50.0, first) for model in models]
    for i, model in enumerate(models):
        robots.put(i, model, first)
        assert np.array_equal(robots.samples[i], alone[i].sample)
    for k in range(120):
        which = np.array([0, 1, 2] if k % 3 else [0, 2])
        inputs = np.column_stack([random.uniform(0.0, 8.0, 3), np.full(3, 298.0)])
        assert not robots.step(inputs, which).any()
        for i in which:
            alone[i].step(inputs[i])
            assert np.array_equal(robots.samples[i], alone[i].sample)
    assert np.ptp(robots.samples, axis=0).max() > 0.0


def test_a_robot_begins_anew_while_others_go_on():
    model, first, hot = Model(Config(system='slider')), np.array([0.0, 298.0]), np.array([1.0, 298.0])
    robots, both = SideBySide(model, 50.0, 2), np.array([0, 1])
    for i in both:
        robots.put(i, model, first)
    for _ in range(50):
        robots.step(np.array([hot, hot]), both)
    kept = robots.samples[1].copy()
    robots.put(0, model, first)
    assert np.array_equal(robots.samples[0], FixedRateRun(model, 50.0, first).sample)
    assert np.array_equal(robots.samples[1], kept) and not np.array_equal(kept, robots.samples[0])


@pytest.mark.parametrize('system', ['module', 'slider'])
def test_steps_do_not_depend_on_the_number_of_threads(system, monkeypatch):
    count, first, random = 40, np.array([0.0, 298.0]), np.random.default_rng(3)
    models = [
        Model(Config({'wire.sigma_MW0': s}, system, 'hybrid', ('driver_lag', 'sensor_lag')))
        for s in np.linspace(1.2e8, 1.3e8, count)
    ]
    made = []
    for threads in (1, 4):
        monkeypatch.setattr('os.cpu_count', lambda threads=threads: threads)
        made.append(SideBySide(models[0], 50.0, count))
        for i, model in enumerate(models):
            made[-1].put(i, model, first)
    for _ in range(40):
        which = np.flatnonzero(random.random(count) < 0.8)
        inputs = np.column_stack([random.uniform(0.0, 8.0, count), np.full(count, 298.0)])
        failed = [one.step(inputs, which) for one in made]
        assert not np.any(failed) and np.array_equal(made[0].samples, made[1].samples)
    assert np.ptp(made[0].samples, axis=0).max() > 0.0
