"""Tangents of runs against differences of runs, extrapolated by Richardson, and against the runs themselves."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from sma_sim import (
    Config,
    Model,
    Recording,
    default_parameters,
    find_effects,
    module_input,
    read_config,
    simulate,
    wire_input,
)
from sma_sim.evidence.estimation import run_tangents
from sma_sim.evidence.estimation.free_parameters import choose_free, declared_parameters, free_parameter
from sma_sim.evidence.estimation.problem import Problem, linearize, linearize_by_differences
from sma_sim.evidence.estimation.residuals import fit_data
from sma_sim.evidence.estimation.run_tangents import sensitivities_of
from sma_sim.model.effects.discovery import ActiveEffect
from sma_sim.model.structures.discovery import known_structures
from sma_sim.solver.inputs import Input
from sma_sim.solver.sensitivities import Neighbour, simulate_with_tangents
from sma_sim.solver.simulate import new_run, new_work

RTOL, DELTA = 1e-8, 1e-6
COMMAND = module_input([0.0, 1.0, 5.0, 9.0, 12.0], [0.0, 12.0, -9.0, 0.0, 0.0])
STRETCH = wire_input([0.0, 4.0, 8.0, 12.0], [0.02, 0.055, 0.03, 0.045], [0.0, 0.25, 0.0, 0.1])
TIMES = np.linspace(0.0, 12.0, 241)
CHANNELS = {'module': ('U_y', 'alpha', 'F_1', 'F_2', 'T_1', 'T_2', 'R_1'), 'wire': ('stress', 'T', 'R')}
NAMES = {
    'module': ('wire.E_A', 'wire.sigma_MW0', 'wire.lambda', 'wire.l0', 'beam.E'),
    'wire': ('wire.E_M', 'wire.sigma_T', 'wire.c_V', 'wire.eps_T'),
}
EFFECTS = find_effects()


def largest_values(effect):
    return tuple(p.realistic[1] if p.realistic else p.default for p in effect.parameters)


def configuration(system, kinetics, names=(), rtol=RTOL):
    active = tuple(ActiveEffect(EFFECTS[name], largest_values(EFFECTS[name])) for name in names)
    given = (
        {'solver.rtol': rtol, 'initial.x_M_1': 0.5, 'initial.x_M_2': 0.6} if system == 'module' else {'solver.rtol': rtol}
    )
    return Config(default_parameters() | given, system, kinetics, active)


class Family:
    """The runs of a configuration whose parameters are moved by z, in standard deviations of their priors."""

    def __init__(self, config, names, source):
        declared, values = declared_parameters(config), config.values
        self.config, self.source, self.free = config, source, [free_parameter(n, values[n], declared[n]) for n in names]

    def initial_run(self, z):
        values = {free.name: free.value(x) for free, x in zip(self.free, z, strict=True)}
        model = Model(self.config.variant(values))
        return model, new_run(model, np.asarray(self.source.values[0], float), new_work(model))

    def samples(self, z):
        model, run = self.initial_run(z)
        shown = simulate(model, self.source, TIMES, initial_state=run, channels=CHANNELS[self.config.system])
        return np.array(list(shown.columns.values()))

    def tangents(self):
        units = np.eye(len(self.free))
        model, run = self.initial_run(np.zeros(len(units)))
        beside = [Neighbour(*self.initial_run(DELTA * unit)) for unit in units]
        return simulate_with_tangents(model, self.source, TIMES, run, CHANNELS[self.config.system], beside)

    def extrapolated(self, j, step):
        unit = np.eye(len(self.free))[j]
        wide, close = ((self.samples(h * unit) - self.samples(-h * unit)) / (2.0 * h) for h in (step, 0.5 * step))
        return (4.0 * close - wide) / 3.0


def worst_error(family, step):
    """The largest RMS error of a tangent over time, relative to the largest RMS of any tangent of that channel."""
    found = family.tangents()
    expected = np.array([family.extrapolated(j, step) for j in range(len(family.free))])
    size = np.sqrt((expected**2).mean(axis=2)).max(axis=0)
    return float((np.sqrt(((found.tangents - expected) ** 2).mean(axis=2)) / size).max())


def family(system, kinetics, effects=()):
    """With the first parameter of each effect among what is moved."""
    own = tuple(f'effects.{name}.{EFFECTS[name].parameters[0].name}' for name in effects)
    source = COMMAND if system == 'module' else STRETCH
    return Family(configuration(system, kinetics, effects), NAMES[system] + own, source)


@pytest.mark.parametrize(('system', 'kinetics'), [('module', 'hybrid'), ('module', 'mas'), ('wire', 'hybrid')])
def test_tangents_are_the_limit_of_differences(system, kinetics):
    assert worst_error(family(system, kinetics), 2e-3) < 1e-5


def test_tangents_with_extra_states_and_a_sensing_chain():
    assert worst_error(family('module', 'hybrid', ('beam_creep', 'sensor_lag', 'guide_friction')), 2e-3) < 1e-5


# Smaller steps where effects bend more; the differences then have errors of this size themselves.
@pytest.mark.slow
@pytest.mark.parametrize(
    ('system', 'kinetics', 'effects', 'step'),
    [
        ('wire', 'mas', (), 2e-3),
        ('module', 'hybrid', ('gravity', 'natural_convection'), 2e-3),
        ('module', 'hybrid', ('driver_lag', 'thermal_expansion'), 1e-3),
        ('module', 'hybrid', ('polycrystal',), 1e-3),
        ('module', 'hybrid', ('functional_fatigue',), 2e-3),
        ('module', 'hybrid', ('r_phase', 'ambient_heating'), 2e-3),
        ('module', 'mas', ('beam_creep', 'sensor_lag'), 2e-3),
        ('module', 'hybrid', ('stress_dependent_transformation_strain', 'slack'), 2e-3),
    ],
)
def test_tangents_with_effects_on_every_port(system, kinetics, effects, step):
    assert worst_error(family(system, kinetics, effects), step) < 5e-5


def test_a_run_with_tangents_shows_what_the_run_shows():
    one = Family(configuration('module', 'mas', rtol=1e-5), NAMES['module'], COMMAND)
    found = one.tangents()
    assert np.array_equal(np.array(list(found.trajectory.columns.values())), one.samples(np.zeros(len(one.free))))


def recorded(sampled):
    """A recording, of which the command is only sampled, or known exactly."""
    run = simulate(Model(configuration('module', 'hybrid', rtol=1e-5)), COMMAND, TIMES)
    channels = {name: run[f'{name}_{unit}'] for name, unit in (('alpha', 'rad'), ('F_1', 'N'), ('T_2', 'K'))}
    return Recording('run1', 'module', TIMES, channels, COMMAND, exact_commands=not sampled)


def problem_of(kinetics):
    config = configuration('module', kinetics)
    declared, values = declared_parameters(config), config.values
    free = tuple(free_parameter(name, values[name], declared[name]) for name in ('wire.E_A', 'wire.lambda'))
    run = fit_data(recorded(sampled=True), {'alpha': 1e-3, 'F_1': 0.1, 'T_2': 0.5})
    return Problem(config, (run,), free).at_tolerance(1e-7)


def on_benches(kinetics):
    """Runs of a wire whose temperature follows from heat and of one whose temperature is imposed, with drifting gauges."""
    times, strain = np.linspace(0.0, 12.0, 61), 0.01 + 0.04 * np.sin(np.linspace(0.0, 3.0, 61)) ** 2
    free_T, imposed_T = known_structures()['wire'], known_structures()['wire_at_T']
    inputs = {
        'wire': (strain, 0.1 * (strain > 0.03), 298.0 + 0.0 * strain),
        'wire_at_T': (strain, 320.0 + 0.5 * times, 0.0 * strain, 298.0 + 0.0 * strain),
    }
    runs = []
    for structure in (free_T, imposed_T):
        held = tuple(k >= len(structure.drives) for k in range(len(structure.input_columns)))
        source = Input(times, np.column_stack(inputs[structure.name]), tuple(not h for h in held), structure.input_columns)
        config = Config(default_parameters(structure.name) | {'solver.rtol': 1e-5}, structure.name, kinetics)
        run = simulate(Model(config), source, times)
        shown = {'stress': run['stress_Pa'] + 1e6, 'R': run['R_ohm']}
        runs.append(
            Recording(
                f'on {structure.name}',
                structure.name,
                times,
                shown,
                source,
                exact_commands=True,
                zero_std={'stress': 1e6},
                drift_std={'stress': 2e6},
            )
        )
    return runs


@pytest.mark.parametrize('kinetics', ['hybrid', 'mas'])
def test_every_run_is_linearised_on_its_bench(kinetics):
    config = configuration('wire', kinetics)
    declared, values = declared_parameters(config), config.values
    free = tuple(free_parameter(name, values[name], declared[name]) for name in ('wire.E_A', 'wire.sigma_T'))
    runs = tuple(fit_data(run, {'stress': 1e6, 'R': 1e-3}) for run in on_benches(kinetics))
    problem = Problem(config, runs, free).at_tolerance(1e-7)
    z = np.full(len(problem.unknowns), 0.1)
    assert problem.has_tangents
    with ThreadPoolExecutor(2) as pool:
        found = linearize(problem, z, pool)
        expected = linearize_by_differences(problem, z, pool, np.full(len(z), 1e-3), central=True)
    for own, other in zip(found, expected, strict=True):
        assert np.array_equal(own.residuals, other.residuals)
        error = np.sqrt(((own.jacobian - other.jacobian) ** 2).mean(axis=(1, 2)))
        assert (error < 3e-3 * np.sqrt((other.jacobian**2).mean(axis=(1, 2))) + 0.02).all()


@pytest.mark.parametrize('kinetics', ['hybrid', 'mas'])
def test_unknowns_of_a_recording_have_tangents(kinetics):
    problem = problem_of(kinetics)
    z = np.full(len(problem.unknowns), 0.1)
    kinds = [unknown.name for unknown in problem.unknowns]
    assert kinds[:3] == ['wire.E_A', 'wire.lambda', 'delay']
    assert set(kinds[3:]) == {'start', 'switch'}
    with ThreadPoolExecutor(1) as pool:
        (found,) = linearize(problem, z, pool)
        (expected,) = linearize_by_differences(problem, z, pool, np.full(len(z), 1e-3), central=True)
    assert np.array_equal(found.residuals, expected.residuals)
    error = np.sqrt(((found.jacobian - expected.jacobian) ** 2).mean(axis=(1, 2)))
    solver_error = 0.02  # of differences over so small steps
    assert (error < 3e-3 * np.sqrt((expected.jacobian**2).mean(axis=(1, 2))) + solver_error).all()


@pytest.mark.parametrize('effects', [('smooth_transformation',), ('stress_dependent_transformation_strain', 'polycrystal')])
def test_isobaric_tests_have_tangents_where_the_transformation_is_gradual(effects):
    """Sharp ones have none: a sample shows the jump or does not."""
    words = ['system=wire', 'bench.control=stress', 'bench.temperature=prescribed', 'wire.dsigma=1.2e8', 'wire.T0=420']
    bare = read_config(words=words)
    widths = {
        'smooth_transformation': 'smooth_transformation:width_A=1e8,width_M=8e7',
        'polycrystal': 'polycrystal:spread=6e7',
    }
    config = read_config(words=words, effects=[widths.get(name, name) for name in effects])
    times = np.linspace(0.0, 3000.0, 151)
    T = 340.0 + 150.0 * (1.0 - np.abs(times / 1500.0 - 1.0))
    values = np.column_stack([np.full(len(T), 1e8), T, np.zeros(len(T)), np.full(len(T), 298.0)])
    structure = config.structure
    source = Input(times, values, (True, True, False, False), structure.input_columns)
    strain = simulate(Model(config), source, times)['strain']
    run = fit_data(
        Recording('100MPa', structure.name, times, {'strain': strain}, source, exact_commands=True), {'strain': 1e-4}
    )
    free, _ = choose_free(config)
    problem = Problem(config, (run,), free, delay=0.0).at_tolerance(1e-7)
    assert problem.has_tangents and not replace(problem, config=bare).has_tangents
    z = np.full(len(problem.unknowns), 0.05)
    with ThreadPoolExecutor(2) as pool:
        (found,) = linearize(problem, z, pool)
        (expected,) = linearize_by_differences(problem, z, pool, np.full(len(z), 1e-3), central=True)
    size = np.sqrt((expected.jacobian**2).mean(axis=(1, 2)))
    error = np.sqrt(((found.jacobian - expected.jacobian) ** 2).mean(axis=(1, 2)))
    assert (size > 0.1).all() and (error < 0.01 * size).all()


def test_tangents_take_the_steps_of_the_run():
    """Also where x_M is an implicit function and rates are those of a memory: rounding is no derivative in time."""
    words = ['system=wire', 'bench.control=stress', 'bench.temperature=prescribed', 'wire.dsigma=1.2e8', 'wire.T0=420']
    effects = ['smooth_transformation:width_A=1e8,width_M=8e7', 'transformation_plasticity']
    model, moved = (
        Model(read_config(words=[*words, f'wire.sigma_T={slope}'], effects=effects)) for slope in (8e6, 8.00001e6)
    )
    times = np.linspace(0.0, 3000.0, 151)
    T = 340.0 + 150.0 * (1.0 - np.abs(times / 1500.0 - 1.0))
    values = np.column_stack([np.full(len(T), 1e8), T, np.zeros(len(T)), np.full(len(T), 298.0)])
    source = Input(times, values, (True, True, False, False), model.structure.input_columns)
    begin = new_run(model, values[0], new_work(model))
    found = simulate_with_tangents(model, source, times, begin, ('strain',), [Neighbour(moved)])
    assert found.trajectory.completed and found.trajectory.steps < 1.1 * simulate(model, source, times).steps


@pytest.mark.parametrize('size', [float('nan'), 1e200])
def test_tangents_beyond_all_numbers_give_way_to_differences(monkeypatch, size):
    """A tangent of 1e200 is a number, but its square, which the normal equations need, is none."""
    problem = problem_of('hybrid')
    z = np.full(len(problem.unknowns), 0.1)

    def endless(task):
        found = sensitivities_of(task)
        return replace(found, tangents=np.full_like(found.tangents, size))

    monkeypatch.setattr(run_tangents, 'sensitivities_of', endless)
    with ThreadPoolExecutor(2) as pool:
        (found,) = linearize(problem, z, pool)
        (expected,) = linearize_by_differences(problem, z, pool)
    assert np.array_equal(found.jacobian, expected.jacobian) and np.abs(found.jacobian).max() > 1.0
