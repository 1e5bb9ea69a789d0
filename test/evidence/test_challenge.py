"""Challenges: what a seed hides, and that truths are true."""

import sys
from pathlib import Path

import numpy as np
import pytest
from bare_module import BareModule

from sma_sim import UserError, default_parameters, find_effects, simulate
from sma_sim.challenge.draw import (
    MAX_LENGTH_DEVIATION,
    MAX_PARAMETER_ERROR,
    MIN_PARAMETER_ERROR,
    UNCERTAIN_PARAMETERS,
    draw_random_command,
)
from sma_sim.challenge.make import RecordingPlan, challenge_with, make_challenge
from sma_sim.challenge.robot import NOISE_STD, REST_DURATION, BrokenRobot, Hidden, Robot
from sma_sim.challenge.truth import truths
from sma_sim.evidence.data.recording import CHANNEL_COLUMNS
from sma_sim.evidence.model_selection.candidates import candidates_for
from sma_sim.model.config import Config
from sma_sim.model.effects.discovery import ActiveEffect
from sma_sim.solver.inputs import Input, module_input
from sma_sim.solver.model import Model

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / 'benchmarks'))
from other_form_truths import FORMS  # noqa: E402

LIBRARY = (
    'gravity',
    'beam_creep',
    'beam_nonlinearity',
    'joint_friction',
    'natural_convection',
    'radiation',
    'ambient_heating',
    'thermal_crosstalk',
    'thermal_expansion',
    'pretension_mismatch',
    'attachment_compliance',
    'slack',
    'guide_friction',
    'clausius_clapeyron_mismatch',
    'polycrystal',
    'r_phase',
    'functional_fatigue',
    'latent_heat_scale',
    'resistance_feedback',
    'driver_lag',
    'driver_deadband',
    'power_gain_mismatch',
    'sensor_bias',
    'sensor_gain',
    'sensor_lag',
    'sensor_misalignment',
    'smooth_transformation',
    'ambient_drift',
    'clamp_slip',
    'clock_skew',
    'driver_saturation',
    'heat_capacity_difference',
    'sensor_crosstalk',
    'sensor_drift',
    'sensor_jump',
)
SHORT = RecordingPlan(duration=20.0, rate=10.0)
COMMAND = module_input([0.0, 4.0, 9.0], [12.0, -11.0, -11.0])
RATE = 50.0


def measure(hidden=(), command=COMMAND):
    """Channels of the paper's module with hidden effects, given as (name, values)."""
    robot = Robot(default_parameters(), tuple(Hidden(truths()[name], values) for name, values in hidden))
    return robot.measure(command, RATE)


def difference(channels, others, names=('U_x', 'U_y', 'alpha')):
    """Largest difference over the noise."""
    return max(float(np.abs(channels[name] - others[name]).max() / NOISE_STD[name]) for name in names)


# What is drawn


def test_every_effect_of_the_library_has_a_truth_and_there_are_others():
    found = [truth.library for truth in truths().values() if truth.library]
    assert sorted(found) == sorted(LIBRARY)
    assert {candidate.name for candidate in candidates_for(Config())} <= set(found)
    assert sum(not truth.library for truth in truths().values()) >= 12
    assert len({truth.port for truth in truths().values() if not truth.library}) >= 5


# Each compiles its own effect: a third in the quick suite, the rest in the nightly one.
@pytest.mark.parametrize('name', [pytest.param(n, marks=[pytest.mark.slow] * (k % 3 > 0)) for k, n in enumerate(truths())])
def test_every_truth_runs_and_changes_something(name):
    challenge = make_challenge(3, kinds=[name], plan=RecordingPlan(rate=10.0))
    (effect,) = challenge.answer.effects
    assert effect.name == name and effect.variables and challenge.robot.hidden[0].truth.name == name
    assert max(effect.influence.values()) > 0.02  # the tolerance of the runs is 100 times finer
    for parameter in truths()[name].parameters:
        (low, high), value = parameter.realistic, effect.parameters[parameter.name][0]
        assert low <= (abs(value) if parameter.name in truths()[name].signed else value) <= high
    for recording in challenge.dataset.recordings:
        assert all(np.isfinite(values).all() for values in recording.channels.values())


def test_a_seed_decides_everything():
    one, again, other = (make_challenge(seed, forces=True, plan=SHORT) for seed in (7, 7, 8))
    assert one.answer == again.answer and one.answer != other.answer
    for first, second in zip(one.dataset.recordings, again.dataset.recordings, strict=True):
        assert all((first.channels[name] == second.channels[name]).all() for name in NOISE_STD)
        assert (first.source.values == second.source.values).all()
    levels = [recording.source.values[0, 0] for recording in one.dataset.recordings]
    assert len(set(levels)) == 3


def test_parameters_are_off_as_promised():
    answers = [make_challenge(seed, 0, plan=SHORT).answer for seed in range(4)]
    for answer in answers:
        off = {name: abs(true / nominal - 1.0) for name, (nominal, true) in answer.parameters.items()}
        assert off.pop('wire.l0') <= MAX_LENGTH_DEVIATION
        assert len(off) == 12 and all(MIN_PARAMETER_ERROR <= value <= MAX_PARAMETER_ERROR for value in off.values())
        assert answer.verdict == 'none'
    assert len({answer.parameters[UNCERTAIN_PARAMETERS[0]] for answer in answers}) == 4


def test_noise_is_as_told_and_nothing_else_is_added():
    challenge = make_challenge(5, 1, forces=True, plan=RecordingPlan(duration=60.0))
    for recording in challenge.dataset.recordings:
        time, true = challenge.robot.measure(recording.source, 50.0)
        assert (time == recording.time).all() and len(time) == 3000
        for name, std in NOISE_STD.items():
            noise = recording.channels[name] - true[name]
            assert np.std(noise) == pytest.approx(std, rel=0.06)
            assert abs(np.mean(noise)) < 4.0 * std / np.sqrt(len(noise))
            assert abs(np.corrcoef(noise[1:], noise[:-1])[0, 1]) < 0.08


def test_number_and_kind_of_effects_can_be_asked_for():
    for seed in range(6):
        two = make_challenge(seed, 2, outside=True, plan=RecordingPlan(runs=3, duration=1.0)).answer
        assert len(two.effects) == 2 and not any(effect.library for effect in two.effects)
        assert two.verdict == 'unknown_effect' and two.library_names == ()
        inside = make_challenge(seed, 1, outside=False, plan=RecordingPlan(duration=1.0)).answer
        assert inside.effects[0].library and inside.verdict == 'missing_effect'
    pair = make_challenge(1, kinds=['gravity', 'truth_fan'], plan=RecordingPlan(duration=1.0)).answer
    assert [effect.name for effect in pair.effects] == ['truth_gravity', 'truth_fan'] and pair.verdict == 'unknown_effect'
    assert set(make_challenge(1, 0, plan=RecordingPlan(duration=1.0)).dataset.noise_std) == {'U_x', 'U_y', 'alpha'}
    drawn = {len(make_challenge(seed, plan=RecordingPlan(duration=1.0)).answer.effects) for seed in range(10)}
    assert drawn == {0, 1, 2}


@pytest.mark.parametrize(
    ('words', 'message'),
    [
        ({'kinds': ['gravty']}, 'unknown effect; did you mean gravity'),
        ({'kinds': ['gravity', 'truth_gravity']}, 'expected different effects'),
        ({'kinds': ['gravity'], 'effects': 0}, 'effects = 0 with 1 named'),
        ({'kinds': ['gravity', 'fan', 'slack']}, 'effects = 3 with 3 named'),
        ({'effects': 3}, 'expected 0, 1 or 2'),
        ({'plan': RecordingPlan(runs=2)}, '2 runs: expected at least 3'),
        ({'plan': RecordingPlan(duration=0.5)}, 'expected at least 1 s'),
        ({'plan': RecordingPlan(rate=float('nan'))}, 'expected at least 1 s'),
        ({'seed': -1}, 'seed -1: expected a whole number'),
    ],
)
def test_wrong_wishes_are_told(words, message):
    with pytest.raises(UserError, match=message):
        make_challenge(**({'seed': 1, 'plan': RecordingPlan(duration=1.0)} | words))


def test_robots_that_break_are_drawn_again(monkeypatch):
    hot = Robot(default_parameters() | {'wire.lambda': 20.0})
    with pytest.raises(BrokenRobot, match='gets hotter than'):
        hot.measure(COMMAND, RATE)
    measured, calls = Robot.measure, []

    def sometimes(self, source, rate):
        calls.append(self)
        if len(calls) == 1:
            raise BrokenRobot('it broke')
        return measured(self, source, rate)

    monkeypatch.setattr(Robot, 'measure', sometimes)
    second = make_challenge(1, 0, plan=SHORT)
    assert second.robot.parameters == calls[-1].parameters != calls[0].parameters

    def never(self, source, rate):
        raise BrokenRobot('it broke')

    monkeypatch.setattr(Robot, 'measure', never)
    with pytest.raises(UserError, match='no robot that works'):
        make_challenge(1, 0, plan=SHORT)


# That truths are true


def compared(load=None, heat=None, hidden=(), command=COMMAND):
    """Largest difference over the noise between a run of the package and one of scipy on other equations."""
    samples, channels = measure(hidden, command)
    other = BareModule(default_parameters(), load, heat)
    times, J_eq = np.r_[-REST_DURATION, command.times], np.r_[0.0, command.values[:, 0]]
    states = other.run(times, J_eq, 298.0, samples)
    return difference(channels, {name: states[:, k] for k, name in enumerate(('U_x', 'U_y', 'alpha'))})


@pytest.mark.slow
def test_the_bare_robot_is_that_of_an_independent_integration():
    assert compared() < 0.02


@pytest.mark.slow
def test_effects_of_truths_are_those_of_an_independent_integration():
    k_x, L, c = np.pi * 0.0025**2 * 2e9 / 0.1, 0.1, 0.6

    def added_energy(q):
        shortening = (1.2 * q[1] ** 2 / L - 0.2 * q[1] * q[2] + 2.0 * L / 15.0 * q[2] ** 2) / 2.0
        return 0.5 * k_x * ((q[0] + c * shortening) ** 2 - q[0] ** 2)

    def coupling(q):
        return -np.array([added_energy(q + 1e-30j * e).imag / 1e-30 for e in np.eye(3)])

    def by_resistance(T, x, J):
        resistivity = 0.82e-6 + (0.95e-6 - 0.82e-6) * x + 3e-10 * (T - 298.0)
        return J * (resistivity / (0.5 * (0.82e-6 + 0.95e-6)) - 1.0)

    hidden = [('truth_beam_nonlinearity', {'c': c}), ('truth_resistance_feedback', {'rho_M': 0.95e-6, 'b': 3e-10})]
    assert compared(coupling, by_resistance, hidden) < 0.02
    _, both = measure(hidden)
    assert all(difference(both, measure([truth])[1]) > 1.0 for truth in hidden)


SAME = [  # a truth and its values; the library's effect and the values that mean the same
    (
        'truth_gravity',
        {'share': 0.8, 'lean': 0.9},
        {'g_x': -0.8 * 9.80665 * np.cos(0.9), 'g_y': 0.8 * 9.80665 * np.sin(0.9)},
    ),
    ('truth_beam_creep', {'c': 0.25, 'tau_c': 10.0}, {'phi': 0.25 / 1.25, 'tau': 10.0 / 1.25}),
    ('truth_ambient_heating', {'G': 2.0, 'C': 20.0}, {'R': 0.5, 'tau': 10.0}),
    ('truth_driver_lag', {'t_r': 0.5}, {'tau': 0.5 / np.log(9.0)}),
    ('truth_sensor_lag', {'cut_off': 1.0}, {'tau': 1.0 / (2.0 * np.pi)}),
    ('truth_beam_nonlinearity', {'c': 0.4}, {'b': 0.0, 'c': 0.4}),
    ('truth_driver_deadband', {'P_q': 0.8}, {'J_d': 0.08}),
    ('truth_radiation', {'reflectivity': 0.3}, {'emissivity': 0.7}),
    ('truth_functional_fatigue', {'e_inf': 4e-3, 's_inf': 5e6, 'N': 2.0}, {'eps_r': 4e-3, 'sigma_r': 5e6, 'z_r': 2.0}),
    (
        'truth_sensor_bias',
        {'zero_U_x': 2e-5, 'zero_U_y': 1e-4, 'zero_alpha': 2e-3},
        {'U_x': 2e-5, 'U_y': 1e-4, 'alpha': 2e-3},
    ),
    ('truth_sensor_gain', {'pixel': 0.05, 'radius': -0.04}, {'U_x': 1 / 1.05, 'U_y': 1 / 1.05, 'alpha': 1 / 0.96}),
    ('truth_sensor_misalignment', {'turn': 0.03}, {'theta': 0.03}),
    ('truth_supply_limit', {'P_max': 12.0}, {'r': 10.0 / 12.0, 'p': 2.0}),
    ('truth_ambient_drift', {'rise': 40.0}, {'c': 0.4}),
    ('truth_heat_capacity_difference', {'f': 0.4}, {'r': 0.4, 'T_ref': 298.0}),
    ('truth_sensor_drift', {'warm': 0.01, 'tau': 10.0}, {'U_x': 0.0, 'U_y': 0.0, 'alpha': 1e-3, 'k': 0.1}),
    (
        'truth_sensor_jump',
        {'off_U_x': 2e-5, 'off_U_y': 1e-4, 'off_alpha': 2e-3, 't_bump': 5.01},
        {'U_x': 2e-5, 'U_y': 1e-4, 'alpha': 2e-3, 't_slip': 5.01, 'w': 2e-3},
    ),
]
PRESENT = [case for case in SAME if truths()[case[0]].library in find_effects()]


@pytest.mark.parametrize(('name', 'values', 'same'), PRESENT, ids=[case[0] for case in PRESENT])
def test_truth_and_library_mean_the_same_physics(name, values, same):
    """Where the law is one and the same, two ways of writing it agree, and the answer has the library's parameters."""
    if truths()[name].listed is not None:
        listed = truths()[name].listed(values, default_parameters())
        assert listed.keys() & same.keys() and {**same, **listed} == pytest.approx({**listed, **same})
    time, channels = measure([(name, values)])
    found = find_effects()[truths()[name].library]
    active = ActiveEffect(found, tuple(same.get(p.name, p.default) for p in found.parameters))
    model = Model(Config(default_parameters() | {'solver.rtol': 1e-7}, 'module', 'mas', (active,)))
    whole = Input(np.r_[-REST_DURATION, COMMAND.times], np.vstack([[[0.0, 298.0]], COMMAND.values]), COMMAND.linear)
    run = simulate(model, whole, time)
    assert difference(channels, {n: run[CHANNEL_COLUMNS[n]] for n in ('U_x', 'U_y', 'alpha')}) < 0.1
    assert difference(channels, measure()[1]) > 0.5


def test_sensors_show_what_they_say():
    _, true = measure()
    _, biased = measure([('truth_sensor_bias', {'zero_U_x': 3e-5, 'zero_U_y': -1e-4, 'zero_alpha': 0.01})])
    assert biased['U_y'] == pytest.approx(true['U_y'] - 1e-4) and biased['alpha'] == pytest.approx(true['alpha'] + 0.01)
    _, turned = measure([('truth_sensor_misalignment', {'turn': 0.05})])
    assert np.hypot(turned['U_x'], turned['U_y']) == pytest.approx(np.hypot(true['U_x'], true['U_y']))
    _, loose = measure([('truth_backlash', {'play': 0.01})])
    assert np.abs(loose['alpha'] - true['alpha']).max() == pytest.approx(0.005)
    turning = np.sign(np.diff(true['alpha']))
    following = np.abs(np.diff(loose['alpha'])) > 1e-5
    assert np.sign(loose['alpha'][1:] - true['alpha'][1:])[following] == pytest.approx(-turning[following])
    assert all(biased[name] == pytest.approx(true[name]) for name in ('F_1', 'F_2'))


def test_influence_is_what_is_changed_over_the_noise():
    effect = make_challenge(2, kinds=['sensor_bias'], plan=SHORT).answer.effects[0]
    for name in ('U_x', 'U_y', 'alpha'):
        assert effect.influence[name] == pytest.approx(abs(effect.parameters[f'zero_{name}'][0]) / NOISE_STD[name])
    pose = [effect.influence[name] for name in ('U_x', 'U_y', 'alpha')]
    assert effect.influence['all'] == pytest.approx(np.sqrt(np.mean(np.square(pose)))) and effect.influence['F_1'] == 0.0


def test_time_counts_from_the_beginning_of_the_run():
    t_on = 6.0
    _, still = measure()
    time, blown = measure([('truth_fan', {'h': 200.0, 't_on': t_on})])
    before = time < t_on - 2.0
    assert np.abs(blown['alpha'] - still['alpha'])[before].max() < 0.05 * NOISE_STD['alpha']
    assert np.abs(blown['alpha'] - still['alpha'])[~before].max() > 5.0 * NOISE_STD['alpha']


@pytest.mark.parametrize('seed', range(20))
def test_commands_are_commands(seed):
    command = draw_random_command(100.0, 298.0, np.random.default_rng(seed))
    assert command.times[0] == 0.0 and command.times[-1] == 100.0 and np.abs(command.values[:, 0]).max() <= 15.0
    assert 6 <= len(command.times) <= 16


@pytest.mark.parametrize('name', ['hinge_creep', 'shared_air', 'wire_2_deadband'])
def test_a_form_that_is_not_among_the_truths_can_be_hidden(name):
    found = challenge_with((FORMS[name].truth,), 51, True, SHORT)
    (hidden,) = found.answer.effects
    assert hidden.name == f'form_{name}' and hidden.name not in truths()
    assert hidden.influence['all'] > 1.0


def test_forms_are_those_of_listed_effects():
    assert {form.effect for form in FORMS.values()} - {''} <= set(LIBRARY)


def test_a_challenge_with_a_named_truth_is_that_of_its_kind():
    one = challenge_with((truths()['truth_gravity'],), 5, True, SHORT)
    other = make_challenge(5, kinds=['gravity'], forces=True, plan=SHORT)
    assert np.array_equal(one.dataset.recordings[0].channels['alpha'], other.dataset.recordings[0].channels['alpha'])
