"""Effects of a user's own files with memory on the strain and stress ports: x_M and its rate in modes 4 and 5."""

import numpy as np
import pytest
from systems import active, evaluate, make_model, random_state

from sma_sim import find_effects, simulate, wire_input
from sma_sim.model.layout import O_DX, O_S_A, O_S_M, O_SIGMA, O_X

TRAINING = """
from sma_sim import Effect, Parameter

EFFECT = Effect(
    name='training',
    port='transformation_stress',
    equation='s_A = b f + c g x, s_M = b f/2 + c g x; df/dt = |dx/dt| - f/tau, dg/dt = |dx/dt| (1 - g)',
    source='a test',
    parameters=(
        Parameter('b', 3e6, 'Pa', (-1e9, 1e9), 'shift that recovers', '', 0.0, (0.0, 1e7)),
        Parameter('c', 5e6, 'Pa', (-1e9, 1e9), 'slope that stays', '', 0.0, (0.0, 1e7)),
        Parameter('tau', 0.5, 's', (1e-3, 1e3), 'recovery time', '', None, (0.1, 10.0)),
    ),
    states=('f', 'g'),
    scale=(1.0, 1.0),
    rate=lambda s, w, p, m: (abs(s.dx) - m.f / p.tau, abs(s.dx) * (1.0 - m.g)),
    kernel=lambda s, w, p, m: (p.b * m.f + p.c * m.g * s.x, 0.5 * p.b * m.f + p.c * m.g * s.x),
    energy='latent heat at the shifted stress',
)
"""
CREEP = """
from sma_sim import Effect, Parameter

EFFECT = Effect(
    name='creep',
    port='wire_strain',
    equation='e = a z; dz/dt = |dx/dt| + sigma_0/tau',
    source='a test',
    parameters=(Parameter('a', 3e-3, '-', (0.0, 1.0), 'strain', '', 0.0, (0.0, 1e-2)),),
    states=('z',),
    scale=(1.0,),
    rate=lambda s, w, p, m: abs(s.dx) + (s.T - 300.0) / 50.0,
    kernel=lambda s, w, p, m: p.a * m.z,
    energy='does not enter',
)
"""


@pytest.fixture(scope='module')
def effects(tmp_path_factory):
    folder = tmp_path_factory.mktemp('effects')
    (folder / 'training.py').write_text(TRAINING)
    (folder / 'creep.py').write_text(CREEP)
    found = find_effects([folder])
    return [active('training', found), active('creep', found)]


def at_rate_of(mode, state):
    """Whether the fraction moves the way that the mode allows, for all wires."""
    return bool(((state.obs[:, O_DX] > 0.0) == (mode == 4)).all())


@pytest.mark.parametrize('mode', [4, 5])
@pytest.mark.parametrize('system', ['wire', 'module'])
@pytest.mark.parametrize('which', [(0,), (1,), (0, 1)])
def test_rate_of_the_fraction_with_memory(effects, which, system, mode):
    """dx_M/dt is the derivative of x_M along the flow, with memory that grows with |dx_M/dt| and drifts by itself."""
    model = make_model(system, effects=[effects[k] for k in which])
    random, seen = np.random.default_rng(mode), 0
    while seen < 10:
        s = random_state(model, random, mode)
        if not at_rate_of(mode, s):
            continue
        seen += 1
        h = 1e-4 / max(1.0, np.abs(s.dy / model.scales).max(), np.abs(s.du).max() * 100)
        low, high = (
            evaluate(model, s.y + sign * h * s.dy, s.u + sign * h * s.du, s.du, s.mode, s.x_frozen) for sign in (-1, 1)
        )
        slope = (high.obs[:, O_X] - low.obs[:, O_X]) / (2 * h)
        assert s.obs[:, O_DX] == pytest.approx(slope, rel=1e-5, abs=1e-5 * np.abs(slope).max())
        level = s.obs[:, O_S_A if mode == 4 else O_S_M]
        assert s.obs[:, O_SIGMA] == pytest.approx(level, abs=1.0)


def test_memory_follows_the_fraction_over_a_run(effects):
    """From samples alone: x_M solves sigma(eps - e, x) = sigma_A + s_A with f and g integrated from |dx_M|."""
    model = make_model('wire', effects=[effects[0]], solver__rtol=1e-8)
    times = np.linspace(0.0, 3.0, 30001)
    run = simulate(model, wire_input([0, 1, 2, 3], [0.03, 0.06, 0.04, 0.055], J=0.2), times)
    assert run.completed and run.chattering == 0
    x, w = run['x_M'], model.compiled.wire
    f, g = np.zeros(len(x)), np.zeros(len(x))
    keep = np.exp(-np.diff(times) / 0.5)
    for k, step in enumerate(np.abs(np.diff(x))):
        f[k + 1] = f[k] * keep[k] + step
        g[k + 1] = g[k] + step * (1.0 - g[k])
    sigma_MW = w.sigma_MW0 + w.sigma_T * (run['T_K'] - w.T0)
    for mode, level in ((4, 0.5 * w.dsigma + 3e6 * f), (5, -0.5 * w.dsigma + 1.5e6 * f)):
        on = run['mode'] == mode
        assert on.sum() > 1000
        assert run['stress_Pa'][on] == pytest.approx((sigma_MW + level + 5e6 * g * x)[on], abs=2e3)
