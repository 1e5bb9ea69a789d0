"""Equations, unknown inputs and the next experiment on structures other than the module: a slider, a lever, a user's own."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from test_structures import MOVING, ROCKER, command_of, model_of

from sma_sim import Config, Dataset, Model, Recording, UserError, read_config, simulate
from sma_sim.cli.main import main
from sma_sim.evidence.diagnosis.diagnose import diagnose
from sma_sim.evidence.estimation.calibrate import FitOptions
from sma_sim.evidence.estimation.injection_points import ports_of
from sma_sim.evidence.estimation.residuals import Nuisance, fit_data, weighted_residuals
from sma_sim.evidence.experiment_design.design import next_experiment
from sma_sim.evidence.experiment_design.plan import DesignRequest
from sma_sim.evidence.latent_input.latent_search import LatentRequest, estimate_latent_inputs
from sma_sim.evidence.latent_input.sensitivities import initialized, input_effect, knot_grid, with_rows_at_knots
from sma_sim.evidence.model_selection.candidates import candidate_of, with_effect
from sma_sim.evidence.model_selection.nominal_fit import DiagnosisRequest
from sma_sim.evidence.model_selection.variants import variants_of
from sma_sim.evidence.symbolic_regression.formula import Formula
from sma_sim.evidence.symbolic_regression.locations import locations_for
from sma_sim.evidence.symbolic_regression.term_fits import TermFit
from sma_sim.evidence.symbolic_regression.universal_term import universal_term
from sma_sim.evidence.symbolic_regression.visited_states import ModelRuns
from sma_sim.model.effects.conversion import effect_on
from sma_sim.model.effects.discovery import find_effects
from sma_sim.model.effects.meaning import acts_on
from sma_sim.solver.inputs import Input

NOISE = {'position': 1e-5, 'angle': 1e-3, 'F': 0.02, 'F_1': 0.02, 'F_2': 0.02, 'T': 0.5}
RIPPLE = """
import math
from sma_sim import Effect, Parameter
EFFECT = Effect(
    name='ripple', port='structure_force', equation='F = F_0 sin(k x)', source='a test', systems=('slider',),
    parameters=(Parameter('F_0', 0.02, 'N', (-9.0, 9.0), '', '', 0.0), Parameter('k', 2000.0, '1/m', (0.0, 1e6), '')),
    kernel=lambda s, b, p: p.F_0 * math.sin(p.k * s.position),
)
"""


def config_of(name):
    return model_of(name).config


def recorded(model, seed, channels, duration=20.0, levels=None):
    """What the sensors of a robot like a model show, under steps of its own command."""
    random, structure = np.random.default_rng(seed), model.structure
    times = np.append(np.linspace(0.0, 0.8 * duration, 5), duration)
    low = -1.0 if structure.antagonistic else 0.0
    J = (random.uniform(low, 1.0, 6) * 1.2 if levels is None else np.asarray(levels)) * (np.arange(6) < 5)
    source = Input(times, np.column_stack([J, np.full(6, 298.0)]), (False, False), structure.input_columns)
    run = simulate(model, source, 10.0)
    assert run.completed
    columns = dict(zip(structure.channels, structure.channel_columns, strict=True))
    noisy = {name: run[columns[name]] + NOISE[name] * random.standard_normal(len(run.time)) for name in channels}
    return Recording(f'run{seed}', structure.name, run.time, noisy, source)


def dataset_of(model, seeds, channels, **options):
    return Dataset(
        tuple(recorded(model, seed, channels, **options) for seed in seeds), {name: NOISE[name] for name in channels}
    )


@pytest.mark.parametrize('name', ['slider', 'lever', 'spatial', 'stack', 'rocker'])
def test_ports_and_terms_of_every_structure(name):
    """A force on each coordinate, four quantities in each wire, each sensor; every term makes a file that loads."""
    config = config_of(name)
    structure = config.structure
    ports = ports_of(config, structure.channels)
    count = {hook: sum(port.hook == hook for port in ports) for hook in ('structure_force', 'wire_heat', 'sensing')}
    assert count == {
        'structure_force': len(structure.coordinates),
        'wire_heat': structure.wires,
        'sensing': len(structure.channels) - structure.wires,  # all but the resistances
    }
    assert len({port.name for port in ports}) == len(ports) and all(port.probe > 0.0 for port in ports)
    for location in locations_for(config, structure.channels):
        for term in location.terms[:: 1 if len(ports) < 16 else 9]:
            fit = TermFit(location, term, (0.5,) * len(term.shapes), 1e-3, 0.0, ((0.1, 0.9),) * len(term.shapes))
            effect = Formula((fit,), structure).load()
            assert effect.port == location.hook and effect.parameters[0].neutral == 0.0


# Formulas for the nightly tests: each compiles its own effect.
NIGHTLY = (
    ('slider', 'force_position', 'position_wave', (3000.0, 0.5), 0.1),
    ('slider', 'sense_position', 'play', (1e-4,), 1.0),
    ('lever', 'power_2', 'J_above', (0.3,), -0.2),
    ('spatial', 'heat_3', 'dT_switched', (9.0,), -1e-3),
)


@pytest.mark.parametrize(
    ('name', 'location', 'term', 'shapes', 'coefficient'),
    [
        ('slider', 'force_position', 'slide_leaking', (3e-4, 4.0), -0.1),
        ('lever', 'heat', 'slow_other', (5.0,), 2e-3),
        ('rocker', 'moment_angle', 'angle_square', (), 0.02),
        *(pytest.param(*one, marks=pytest.mark.slow) for one in NIGHTLY),
    ],
)
def test_a_formula_in_a_file_is_the_term_that_was_fitted(name, location, term, shapes, coefficient):
    config, times = config_of(name), np.linspace(0.0, 15.0, 61)
    structure = config.structure
    place = next(place for place in locations_for(config, structure.channels) if place.name == location)
    fit = TermFit(
        place, next(t for t in place.terms if t.name == term), shapes, coefficient, 0.0, ((1e-9, 1e9),) * len(shapes)
    )
    chooser, formula = universal_term(place.hook, bool(fit.term.rate), config.structure), Formula((fit,), structure)

    def shown(config):
        run = simulate(Model(config), command_of(name, 15.0), times)
        assert run.completed
        return np.array([run[c.column] / c.size(structure.default_constants) for c in structure.coordinates])

    nominal = shown(config)
    compiled = shown(with_effect(config, chooser.effect, chooser.values(place, fit.term, coefficient, shapes)))
    written = shown(with_effect(config, formula.load(), {p.name: p.default for p in formula.parameters}))
    change = np.abs(compiled - nominal).max()
    assert change > 1e-3 and written == pytest.approx(compiled, abs=2e-3 * change + 1e-5)


@pytest.mark.parametrize(('name', 'port'), [('lever', 'moment_angle'), ('slider', 'heat_1')])
def test_responses_to_an_input_add_up(name, port):
    """The response to an input is about the sum of those to its knots: what the linear model rests on."""
    model = model_of(name, 'mas', solver__rtol=1e-8)
    structure, config = model.structure, model.config
    run = fit_data(dataset_of(model, [3], structure.channels[:1]).recordings[0], NOISE)
    grid = knot_grid(run, 10)
    source = with_rows_at_knots(run.source, grid.knots)
    where = next(one for one in ports_of(config, structure.channels) if one.name == port)
    fixed, nuisance = initialized(replace(run, source=source), Nuisance(start=(0.4,) * structure.wires))

    def response(values):
        effect = input_effect(where, grid, 0.1 * where.probe * values, structure)
        return weighted_residuals(replace(config, effects=(effect,)), fixed, nuisance) - weighted_residuals(
            config, fixed, nuisance
        )

    knots = np.eye(len(grid.knots))
    both, apart = response(knots[3] + 0.5 * knots[4]), response(knots[3]) + 0.5 * response(knots[4])
    assert np.abs(both).max() > 1e-4 and np.linalg.norm(both - apart) < 0.1 * np.linalg.norm(both)


def test_states_that_terms_read():
    """Of three wires the others' temperature is their mean; coordinates and rates have the structure's names."""
    from sma_sim.evidence.estimation.calibrate import problem_for
    from sma_sim.evidence.estimation.problem import start_point

    model = model_of('spatial', 'mas')
    source = command_of('spatial', 8.0)
    run = simulate(model, source, 10.0)
    data = Dataset((Recording('run', 'spatial', run.time, {'alpha': run['alpha_rad']}, source),), {'alpha': 1e-3})
    problem = problem_for(data, model.config, FitOptions(free=('wire.lambda',)), 1)
    heat = next(one for one in locations_for(model.config, ('alpha',)) if one.name == 'heat_3')
    (states,) = ModelRuns(problem, start_point(problem)).visited(heat)
    fields = states.fields
    assert {'U_z', 'dgamma', 'sigma', 'J'} <= set(fields) and set(fields['others']) == {2.0}
    assert len(states.samples) == len(fields['T_other'])


def test_what_is_not_asked_of_a_structure_is_refused(tmp_path, capsys):
    (tmp_path / 'iso.csv').write_text(
        'time_s,stress_Pa,T_K,strain\n'
        + ''.join(f'{t},1e8,{300 + t % 200},{0.01 + 1e-5 * (t % 7)}\n' for t in range(0, 400, 4))
    )
    words = ['--config', str(Path(__file__).parents[2] / 'examples/real/isobaric/config.yaml'), '--noise', 'strain=1e-5']
    for verb, message in (('latent', 'which says nothing in a test'), ('next', 'is moved by stress, T, J')):
        assert main([verb, str(tmp_path / 'iso.csv'), *words]) == 2
        assert message in capsys.readouterr().err
    model = model_of('spatial', 'mas')
    source = command_of('spatial', 8.0)
    run = simulate(model, source, 10.0)
    data = Dataset((Recording('run', 'spatial', run.time, {'alpha': run['alpha_rad']}, source),), {'alpha': 1e-3})
    with pytest.raises(UserError, match='system spatial is moved by J_1, J_2, J_3'):
        next_experiment(data, model.config, DesignRequest())


@pytest.mark.slow
def test_an_experiment_for_a_slider_heats_only(tmp_path, capsys):
    """One command from 0 to the largest of the recordings, in its column."""
    model = model_of('slider', 'mas')
    run = recorded(model, 1, ('position', 'T'), levels=[0.0, 1.1, 0.4, 0.9, 0.0, 0.0])
    columns = {'time_s': run.time, 'J_W': run.source.values[np.searchsorted(run.source.times, run.time, 'right') - 1, 0]}
    columns |= {'position_m': run.channels['position'], 'T_K': run.channels['T']}
    rows = '\n'.join(','.join(f'{v:.9g}' for v in row) for row in np.column_stack(list(columns.values())))
    (tmp_path / 'run.csv').write_text(','.join(columns) + '\n' + rows + '\n')
    out = tmp_path / 'next.csv'
    words = ['--system', 'slider', '--model', 'mas', '--noise', 'position=1e-5', '--noise', 'T=0.5', '--tries', '6']
    words += [
        '--length',
        '12',
        '--hold',
        '1',
        '--parameters',
        'slider.k',
        '-o',
        str(out),
        '--json',
        str(tmp_path / 'n.json'),
    ]
    assert main(['next', str(tmp_path / 'run.csv'), *words]) == 0
    header, *levels = out.read_text().split()
    J = [float(row.split(',')[1]) for row in levels]
    assert header == 'time_s,J_W' and min(J) >= 0.0 and 0.0 < max(J) <= 1.1
    assert 'J_W' in json.loads((tmp_path / 'n.json').read_text())['sequence']
    capsys.readouterr()
    assert main(['simulate', '--system', 'slider', '--input', str(out), '--out', str(tmp_path / 'new.csv')]) == 0


def shaken_slider(tmp_path):
    """A slider that a force shakes."""
    (tmp_path / 'shake.py').write_text(
        'import math\nfrom sma_sim import Effect, Parameter\n'
        "EFFECT = Effect(name='shake', port='structure_force', equation='', source='', systems=('slider',),\n"
        "    parameters=(Parameter('F', 0.05, 'N', (-9.0, 9.0), '', '', 0.0),),\n"
        '    kernel=lambda s, b, p: p.F * math.sin(0.9 * s.t))\n'
    )
    return Model(read_config(words=['system=slider', 'model=mas', f'effects.paths={tmp_path}'], effects=['shake']))


@pytest.mark.slow
def test_a_force_on_a_slider_is_found_over_time(tmp_path):
    data = dataset_of(shaken_slider(tmp_path), [1, 2], ('position', 'F', 'T'))
    request = LatentRequest('mas', options=FitOptions(free=('slider.k', 'wire.lambda'), starts=1, intervals=False))
    found = estimate_latent_inputs(data, config_of('slider'), request=request)
    assert found.verdict == 'force_position' and found.error > 1.3 and found.findings[0].error < 1.15
    for estimate in found.findings[0].inputs:
        assert np.corrcoef(estimate.mean, 0.05 * np.sin(0.9 * estimate.time))[0, 1] > 0.95


@pytest.mark.slow
def test_an_equation_for_a_slider_is_found(tmp_path, monkeypatch):
    """A force that is periodic in the position is no listed effect: where it acts, and of what it is a function, are found.

    The force of the wire has to be known well: a scale of the position that waves shifts the slider likewise.
    """
    monkeypatch.setitem(NOISE, 'F', 0.002)
    (tmp_path / 'ripple.py').write_text(RIPPLE)
    truth = Model(read_config(words=['system=slider', 'model=mas', f'effects.paths={tmp_path}'], effects=['ripple']))
    data = dataset_of(truth, [1, 2, 3], ('position', 'F', 'T'))
    training, held_out = replace(data, recordings=data.recordings[:2]), replace(data, recordings=data.recordings[2:])
    options = FitOptions(free=('slider.k', 'slider.x_0', 'wire.lambda'), starts=1, intervals=False)
    found = diagnose(training, config_of('slider'), held_out, DiagnosisRequest('mas', (), 0, options))
    assert found.verdict == 'unknown_effect' and found.proposal is not None
    formula = found.proposal.formula
    assert formula.location.name == 'force_position' and 'position' in formula.variables


@pytest.mark.parametrize(
    ('name', 'some'),
    [
        ('slider', ()),
        ('lever', ('natural_convection@wire_1', 'thermometer_lag@T_2')),
        ('spatial', ('radiation@wire_3',)),
        ('stack', ('driver_lag@wire_6',)),
        ('module', ('beam_creep@rotation', 'ambient_heating@shared')),
    ],
)
def test_variants_of_effects_on_every_structure(name, some):
    """Effects in one wire, coordinate or channel of several; a slider with one wire has none of which there are several."""
    structure = MOVING[name]
    effects = [candidate_of(effect_on(one, structure)) for one in find_effects().values() if acts_on(one, structure)]
    names = {variant.name for variant in variants_of(effects, structure.channels)}
    assert set(some) <= names and bool(names) == bool(some)
    assert all(int(one.rpartition('@wire_')[2]) <= structure.wires for one in names if '@wire_' in one)


@pytest.mark.slow
def test_an_effect_in_one_wire_of_a_lever_is_found():
    truth = Model(read_config(words=['system=lever', 'model=mas'], effects=['natural_convection@wire_1']))
    options = FitOptions(free=('lever.k', 'wire.lambda', 'wire.dsigma'), starts=1, intervals=False)
    request = DiagnosisRequest('mas', (), 0, options, equation=False)
    found = diagnose(dataset_of(truth, [1, 2, 3], ('angle', 'F_1', 'F_2')), config_of('lever'), request=request)
    assert found.verdict == 'missing_effect' and found.effects == ('natural_convection@wire_1',)


def test_a_users_structure_is_known_by_the_terms():
    """The effect file of a formula names the user's structure, and compiles with it."""
    config = Config(ROCKER.default_values, 'rocker', own_structure=ROCKER)
    assert universal_term('structure_force', False, config.structure).effect.systems == ('rocker',)


@pytest.mark.slow
def test_what_a_coil_lacks_is_found_by_its_stroke_and_force():
    """A coil lifts a weight; its cooling grows with its temperature, which the nominal model, some per cent off, lacks."""
    path, noise = Path(__file__).parents[2] / 'examples' / 'coil' / 'weight.yaml', {'stroke': 5e-5, 'F': 2e-3}
    nominal, runs, times = read_config(path), [], np.arange(0.0, 45.0, 0.05)
    off = {'wire.lambda': 0.93, 'wire.sigma_T': 1.05, 'wire.c_V': 1.06, 'wire.dsigma': 0.95}
    true = Model(
        read_config(path, effects=('natural_convection',)).variant(
            {name: factor * nominal.parameters[name] for name, factor in off.items()}
        )
    )
    for k in range(3):
        random = np.random.default_rng(k)
        changes = np.sort(random.uniform(0.5, 36.0, 6))
        power = np.concatenate([[0.0], random.uniform(1.0, 3.2, 5) * [1.0, 0.0, 1.0, 0.4, 1.0], [0.0, 0.0]])
        values = np.column_stack([power, np.full(8, 298.0)])
        source = Input(np.concatenate([[0.0], changes, [45.0]]), values, (False, False), true.structure.input_columns)
        run = simulate(true, source, times)
        shown = {'stroke': run['stroke_m'], 'F': run['F_N']}
        noisy = {name: values + noise[name] * random.normal(size=len(times)) for name, values in shown.items()}
        runs.append(Recording(f'run{k}', 'coil', times, noisy, source, exact_commands=True))
    found = diagnose(Dataset(tuple(runs), noise), nominal, request=DiagnosisRequest('hybrid', equation=False))
    assert found.verdict == 'missing_effect' and found.effects == ('natural_convection',)
    assert found.stages[-1].held_out < 1.05
