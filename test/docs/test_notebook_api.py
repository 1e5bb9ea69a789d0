"""What a scientist does in a notebook: results that show, convert and save themselves, and mistakes that say their cure."""

import copy
import importlib.util
import json
import pickle
import re
import sys
import warnings
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pytest

import sma_sim
from sma_sim import Config, Dataset, FitOptions, Model, Recording, UserError, module_input, simulate
from sma_sim.control import PredictiveController
from sma_sim.evidence.estimation.calibrate import LimitReached
from sma_sim.evidence.symbolic_regression.locations import locations_of_hook
from sma_sim.guard import Counters, Guard
from sma_sim.model.archive import MOVED, resolved
from sma_sim.model.progress import ProgressLine
from sma_sim.model.structures.discovery import KNOWN
from sma_sim.observer import Observer
from sma_sim.words.fit_remarks import remarks_on

ROOT = Path(__file__).resolve().parents[2]
COMMAND = module_input([0.0, 1.0, 5.0, 12.0], [0.0, 11.0, -6.0, 0.0])
QUICK = FitOptions(free=('beam.E', 'wire.lambda'), kinetics='hybrid', starts=1)


@pytest.fixture(scope='module')
def run():
    return simulate(Model(), COMMAND, 10.0)


@pytest.fixture(scope='module')
def dataset():
    random, runs = np.random.default_rng(0), []
    for name, factor in (('a', 1.0), ('b', -0.8)):
        command = module_input(COMMAND.times, factor * COMMAND.values[:, 0])
        shown = simulate(Config({'beam.E': 2.1e9}), command, 10.0)
        noisy = shown['alpha_rad'] + 3.5e-4 * random.standard_normal(len(shown.time))
        runs.append(Recording(name, 'module', shown.time, {'alpha': noisy}, command))
    return Dataset(runs, {'alpha': 3.5e-4})


@pytest.fixture(scope='module')
def fitted(dataset):
    return sma_sim.calibrate(dataset, Config(), QUICK)


def test_a_run_says_its_units(run):
    assert run['time_s'] is run.time and run['J_eq_W'].max() == 11.0
    assert {name: run.units[name] for name in ('U_x_m', 'alpha_rad', 'F_1_N', 'T_E_K', 'J_eq_W', 'x_M_1', 'R_2_ohm')} == {
        'U_x_m': 'm',
        'alpha_rad': 'rad',
        'F_1_N': 'N',
        'T_E_K': 'K',
        'J_eq_W': 'W',
        'x_M_1': '-',
        'R_2_ohm': 'ohm',
    }
    line = next(line for line in run.summary().splitlines() if line.startswith('alpha_rad'))
    assert line.split()[-1] == 'rad' and float(line.split()[3]) == pytest.approx(run['alpha_rad'].max(), rel=1e-5)


def test_a_run_as_tables(run):
    frame = pytest.importorskip('pandas') and run.to_dataframe()
    assert frame.index.name == 'time_s' and list(frame) == list(run.names) and frame.attrs['units'] == run.units
    pytest.importorskip('xarray')
    data = run.to_xarray()
    assert data['alpha_rad'].attrs == {'units': 'rad'} and data['alpha_rad'].dims == ('time_s',)
    for name in run.names:
        assert (frame[name].to_numpy() == run[name]).all() and (data[name].to_numpy() == run[name]).all()


def test_a_table_is_no_file():
    pandas = pytest.importorskip('pandas')
    with pytest.raises(UserError, match='expected files or folders, got a table; write it with to_csv'):
        sma_sim.read_dataset(pandas.DataFrame({'J_eq_W': [1.0]}))


def test_functions_without_a_module_are_kernels():
    """As exec makes them in a namespace without a name."""
    made = {}
    exec('def kernel(s, w, p): return -p.k * (s.T - s.T_E)', {'__builtins__': {}}, made)
    config = Config(effects=[replace(own_effect('fin'), kernel=made['kernel'])(k=2e-3)])
    assert simulate(config, COMMAND, 1.0).completed and made['kernel'].__module__ == '__main__'


def test_tables_say_what_to_install(run, monkeypatch):
    for package, make in (('pandas', run.to_dataframe), ('xarray', run.to_xarray)):
        monkeypatch.setitem(sys.modules, package, None)
        with pytest.raises(UserError, match=f'pip install {package}'):
            make()


def test_a_run_as_a_figure(run):
    whole, single = run.plot(title='a step'), run.plot('alpha_rad')
    assert len(single.axes) == 1 < len(whole.axes) and whole.get_suptitle() == 'a step'
    assert single._repr_png_().startswith(b'\x89PNG')


def test_a_fit_says_which_values_ended_at_a_limit(dataset):
    found = sma_sim.calibrate(dataset, Config(), replace(QUICK, intervals=False, limits={'beam.E': (2.5e9, 3e9)}))
    assert 'beam.E' in found.at_bound and 'at a limit beam.E' in repr(found)
    assert 'at a limit: beam.E = 2.5e+09 Pa ended at a limit of the fit (2.5e+09 to 3e+09)' in found.summary()
    assert 'FitOptions(limits=...)' in found.summary()


def test_a_noise_below_that_of_the_solver_is_said(dataset):
    with pytest.warns(
        sma_sim.PhysicsWarning, match='noise_std of alpha = 1e-09 is less than the error of the solver'
    ) as said:
        sma_sim.calibrate(replace(dataset, noise_std={'alpha': 1e-9}), Config(), replace(QUICK, free=(), intervals=False))
    assert said[0].filename == __file__


def test_a_rate_may_be_any_number():
    for rate in (np.int64(5), np.float32(5.0), np.array(5.0), 5):
        assert len(simulate(Model(), COMMAND, rate).time) == 61


def test_a_run_that_no_structure_bears_is_said():
    pull = sma_sim.wire_input([0.0, 60.0], [0.0, -0.06])
    swelling = replace(own_effect('swelling'), port='wire_strain', kernel=lambda s, w, p: -80.0 * p.k * s.x)
    shift = replace(
        own_effect('shift'), port='transformation_stress', kernel=lambda s, w, p: (-2e12 * p.k * s.x, -2e12 * p.k * s.x)
    )
    soft = replace(pusher(), coordinates=(sma_sim.Coordinate('x', 'm', 1e-3, limit=1e-4),))
    heating = sma_sim.Input([0.0, 1.0, 3.0], [[0.0, 298.0], [0.6, 298.0], [0.0, 298.0]], (False,) * 2, ('J_W', 'T_E_K'))
    for words, config, source in (
        ('the wire comes to -7.. MPa: .* buckles', Config(system='wire'), pull),
        ('wire 1 comes to -1.. MPa: .* buckles', Config(effects=[shift], kinetics='hybrid'), COMMAND),
        ('the stress of wire 1 does not fall .* check shift,', Config(effects=[shift], kinetics='mas'), COMMAND),
        ('the stress of wire 1 does not fall .* check swelling,', Config(effects=[swelling]), COMMAND),
        ('x comes to .* beyond its limit of 0.0001 m', Config(system=soft), heating),
    ):
        with pytest.warns(sma_sim.PhysicsWarning, match=words):
            run = simulate(config, source, 2.0)
        assert any(re.search(words, note) for note in run.notes)


def test_what_a_run_shows_cannot_be_changed(run):
    for column in (run.time, run['alpha_rad'], run['J_eq_W'], run['R_1_ohm']):
        with pytest.raises(ValueError, match='read-only'):
            column[0] = 99.0


def test_equal_runs_are_equal(run):
    again = simulate(Model(), COMMAND, 10.0)
    assert run == again and run != simulate(Config({'beam.E': 2.1e9}), COMMAND, 10.0) and run != 'a run'
    assert COMMAND == module_input(COMMAND.times, COMMAND.values[:, 0]) != replace(COMMAND, times=2.0 * COMMAND.times)


def test_a_run_goes_on_where_another_ended(run):
    rest = module_input([12.0, 15.0], [5.0, 0.0])
    assert simulate(Model(), rest, 10.0, initial_state=run) == simulate(Model(), rest, 10.0, initial_state=run.state)


def test_a_saved_run_is_the_same(run, tmp_path):
    file = run.save(tmp_path / 'run.npz')
    assert sma_sim.load(file) == sma_sim.Trajectory.load(str(file)) == run
    assert b'pickle' not in file.read_bytes() and [one.name for one in tmp_path.iterdir()] == ['run.npz']
    rest = module_input([12.0, 15.0], [5.0, 0.0])
    assert simulate(Model(), rest, 10.0, initial_state=sma_sim.load(file)) == simulate(
        Model(), rest, 10.0, initial_state=run
    )


def test_saved_results_are_the_same(fitted, dataset, tmp_path):
    found = sma_sim.load(fitted.save(tmp_path / 'fit.npz'))
    assert found == fitted and found.config == fitted.config and found.summary() == fitted.summary()
    assert found.config.covariance == fitted.config.covariance is not None
    assert sma_sim.load(dataset.save(tmp_path / 'data.npz')) == dataset
    request = sma_sim.DiagnosisRequest(options=replace(QUICK, intervals=False), equation=False, variants=False)
    found = sma_sim.diagnose(dataset, Config(), request=request)
    assert sma_sim.load(found.save(tmp_path / 'diagnosis.npz')) == found == copy.deepcopy(found)
    for config in (fitted.config, Config(effects=sma_sim.effects.natural_convection(scope='wire_1'))):
        compared = sma_sim.compare(dataset, config)
        assert sma_sim.load(compared.save(tmp_path / 'compared.npz')) == compared


def test_what_is_known_of_values_is_saved_with_a_fit(fitted, tmp_path):
    known = replace(fitted.config, priors={'beam.E': 1e8})
    found = sma_sim.load(replace(fitted, config=known).save(tmp_path / 'fit.npz'))
    assert found.config == known and found.config.priors == {'beam.E': 1e8}


@pytest.mark.parametrize('method', ['spawn', 'forkserver'])
def test_configurations_go_to_other_processes(method, fitted):
    """With effects, their scopes, priors and the covariance of a fit; a model is made anew there."""
    chosen = [sma_sim.effects.gravity(g_y=-3.0), sma_sim.effects.radiation(scope='wire_2')]
    config = Config({'beam.E': 2.2e9}, effects=chosen, priors={'beam.E': 1e8})
    with ProcessPoolExecutor(1, mp_context=get_context(method)) as pool:
        assert pool.submit(copy.copy, config).result() == config
        assert pool.submit(copy.copy, fitted.config).result() == fitted.config
        assert pool.submit(getattr, Model(config), 'config').result() == config
    assert copy.deepcopy([config, Model(config)])[0] is config
    copied = sma_sim.effects.gravity, sma_sim.effects.gravity(g_y=-3.0), sma_sim.structures.slider
    assert copy.deepcopy(copied) == copied
    with pytest.raises(UserError, match='effect fin is your own.*make the configuration in the other process'):
        pickle.dumps(Config(effects=[own_effect('fin')]))
    with pytest.raises(UserError, match='structure pusher is your own'):
        pickle.dumps(Config(system=pusher()))
    for size in (2, 3):
        stack = Config({'stack.modules': size}, system='stack')
        assert pickle.loads(pickle.dumps(stack)) == stack


def test_a_wrong_value_of_an_effect_is_shown_as_it_is():
    assert repr(sma_sim.effects.gravity(g_y='3')) == "gravity(g_y='3')"


def test_columns_of_a_run_are_those_of_a_mapping(run):
    assert 'alpha_rad' in run and 'time_s' in run and 'alpha' not in run
    assert list(run) == list(run.keys()) == list(dict(run)) and np.array_equal(dict(run)['alpha_rad'], run['alpha_rad'])


def test_results_that_were_saved_before_a_class_moved_are_read():
    for module, now in MOVED.items():
        assert importlib.util.find_spec(module) is None and importlib.util.find_spec(now) is not None
    assert resolved('sma_sim.evidence.estimation.limits:LimitReached') is LimitReached


def test_results_that_were_saved_before_a_field_was_renamed_are_read(tmp_path):
    run = sma_sim.compare(one(), Config(effects=[sma_sim.effects.gravity(g_y=-3.0)]), nuisances=False)
    arrays = dict(np.load(run.save(tmp_path / 'run.npz')))
    content = json.loads(arrays.pop('content').tobytes())
    (active,) = (record['fields'] for record in content['objects'] if record.get('class', '').endswith(':ActiveEffect'))
    active['found'] = active.pop('effect')
    np.savez(tmp_path / 'old.npz', content=np.frombuffer(json.dumps(content).encode(), np.uint8), **arrays)
    assert sma_sim.load(tmp_path / 'old.npz') == run


def test_effects_and_structures_go_on_in_the_old_spelling_with_a_warning():
    active, structure = Config(effects='gravity').effects[0], Config().structure
    with pytest.warns(DeprecationWarning, match='.effect is the object itself now') as told:
        assert sma_sim.find_effects()['gravity'].effect.port == 'structure_force'
        assert active.found.effect is active.effect is sma_sim.effects.gravity
        assert replace(active, found=sma_sim.effects.radiation).effect.name == 'radiation'
        assert sma_sim.find_structures()['module'].structure is structure.structure is sma_sim.structures.module
    assert __file__ in {warning.filename for warning in told} and len(told) == 6


def test_terms_of_equations_know_a_structure_that_is_in_no_file():
    assert {one.variable for one in locations_of_hook('structure_force', pusher())} == {'x'}


def test_a_structure_that_is_named_later_changes_no_recording_of_another():
    heating = sma_sim.Input([0.0, 1.0, 4.0], [[0.0, 298.0], [0.6, 298.0], [0.0, 298.0]], (False, False), ('J_W', 'T_E_K'))
    config = Config(system=pusher())
    run = simulate(config, heating, 20.0)
    recorded = Dataset(Recording('own', 'pusher', run.time, {'x': run['x_m']}, heating), {'x': 1e-6})
    before, (x,) = sma_sim.compare(recorded, config), pusher().coordinates
    try:
        Config(system=replace(pusher(), name='twister', coordinates=(replace(x, unit='rad'),)))
        assert sma_sim.compare(recorded, config) == before
        assert 'x_m' in str(recorded) and 'x_m' in str(recorded.recordings[0])
    finally:
        for name in ('twister', 'twister_at_T'):
            KNOWN.pop(name, None)


def test_a_structure_of_the_same_name_is_not_taken_for_the_saved_one(tmp_path):
    own = pusher()
    fitted = Config(system=own)
    heating = sma_sim.Input([0.0, 1.0, 3.0], [[0.0, 298.0], [0.6, 298.0], [0.0, 298.0]], (False,) * 2, ('J_W', 'T_E_K'))
    run = simulate(fitted, heating, 5.0)
    data = Dataset(Recording('own', 'pusher', run.time, {'x': run['x_m']}, heating), {'x': 1e-6})
    compared = sma_sim.compare(data, fitted, nuisances=False)
    file = compared.save(tmp_path / 'own.npz')
    assert sma_sim.load(file, structures=[own]) == compared
    other = replace(own, parameters=(*own.parameters, sma_sim.Parameter('c', 1.0, 'N', (0.0, 2.0), 'more')))
    with pytest.raises(UserError, match='saved with structure pusher of x .m., .*; expected the same, got .* pusher.c .N.'):
        sma_sim.load(file, structures=[other])


def test_a_file_runs_no_code_and_says_what_it_lacks(tmp_path):
    fin = own_effect('fin')
    run = sma_sim.compare(one(), Config(effects=[fin(k=2e-3)]), nuisances=False)
    file = run.save(tmp_path / 'own.npz')
    with pytest.raises(UserError, match=r'effect of your own, fin: give load\(\.\.\., effects='):
        sma_sim.load(file)
    assert sma_sim.load(file, effects=[fin]) == run
    other = replace(fin, parameters=(replace(fin.parameters[0], name='g'),))
    with pytest.raises(UserError, match=r'saved with effect fin of k \[W/K\]; expected the same, got one of g \[W/K\]'):
        sma_sim.load(file, effects=[other])
    content = np.load(file)['content'].tobytes().decode()
    assert 'sma_sim.evidence.residual_analysis.compare:Comparison' in content
    for other in ('os:system', 'sma_sim.model.archive:load', 'sma_sim.model.archive:np'):
        changed = content.replace('sma_sim.evidence.residual_analysis.compare:Comparison', other)
        arrays = {name: one for name, one in np.load(file).items() if name != 'content'}
        np.savez(tmp_path / 'odd.npz', content=np.frombuffer(changed.encode(), np.uint8), **arrays)
        with pytest.raises(UserError, match='which this version of sma_sim does not have'):
            sma_sim.load(tmp_path / 'odd.npz', effects=[fin])


@pytest.mark.parametrize(
    ('edit', 'words'),
    [
        (lambda content, arrays: content.pop('objects'), 'is no result of sma_sim'),
        (lambda content, arrays: content.update(result={'object': 9999}), 'is no result of sma_sim'),
        (lambda content, arrays: arrays.pop('array_0'), 'is no result of sma_sim'),
        (lambda content, arrays: recorded_in(content).pop('channels'), 'is no result of sma_sim'),
        (
            lambda content, arrays: recorded_in(content).update(system='pusherr'),
            "system 'pusherr'.*structure of your own, once",
        ),
        (lambda content, arrays: recorded_in(content)['channels']['map'][0].__setitem__(0, 'beta'), "no channel 'beta'"),
    ],
)
def test_an_edited_file_is_refused(edit, words, tmp_path):
    saved = one().recordings[0].save(tmp_path / 'run.npz')
    arrays = dict(np.load(saved))
    content = json.loads(arrays['content'].tobytes())
    edit(content, arrays)
    np.savez(tmp_path / 'odd.npz', **arrays | {'content': np.frombuffer(json.dumps(content).encode(), np.uint8)})
    with pytest.raises(UserError, match=words):
        sma_sim.load(tmp_path / 'odd.npz')


def recorded_in(content):
    """The fields of the recording in a saved file."""
    return next(one['fields'] for one in content['objects'] if one.get('class', '').endswith(':Recording'))


@pytest.mark.parametrize('content', [b'', b'PK\x03\x04', b'{}', np.random.default_rng(0).bytes(500)])
def test_what_is_no_result_is_said(content, tmp_path):
    (tmp_path / 'x.npz').write_bytes(content)
    with pytest.raises(UserError, match='is no result of sma_sim'):
        sma_sim.load(tmp_path / 'x.npz')


def test_results_print_in_a_line_and_show_a_table(run, dataset, fitted):
    case = sma_sim.make_challenge(2, kinds=['gravity'], plan=sma_sim.RecordingPlan(duration=10.0, rate=10.0))
    compared = sma_sim.compare(dataset, fitted.config)
    assert 'gravity' not in repr(case) + case._repr_html_()  # it is to be found
    for one in (run, dataset, *dataset.recordings, fitted, compared, *compared.runs, case, COMMAND):
        assert len(repr(one)) < 1500 and '\n' not in repr(one), type(one)
        assert one._repr_html_().startswith('<table>') and len(one._repr_html_()) < 3000
        assert len(one.summary().splitlines()) > 1
    for one in (
        Model(),
        Config(effects='gravity'),
        sma_sim.structures.module,
        sma_sim.effects.gravity,
        *Config(effects='gravity').effects,
    ):
        assert len(repr(one)) < 200


def test_an_interval_says_of_what_its_standard_deviation_is(fitted):
    stiffness = fitted.intervals['beam.E']
    assert stiffness.log and stiffness.std_unit == 'of the logarithm' and stiffness.unit == 'Pa'
    width = (stiffness.high - stiffness.low) / (2.0 * 1.96)
    assert stiffness.std_of_value == pytest.approx(width, rel=0.1)
    assert re.search(r'beam\.E +2\.\d+e\+09 +.* Pa', fitted.summary())
    frame = pytest.importorskip('pandas') and fitted.to_dataframe()
    for name, one in fitted.intervals.items():
        row = [fitted.values[name], one.low, one.high, one.std_of_value, one.unit]
        assert frame.loc[name, ['value', 'low', 'high', 'std', 'unit']].tolist() == row


def test_a_freed_parameter_that_changes_nothing_is_named(dataset):
    for name, options in (
        ('wire.V_L', QUICK),
        ('wire.resistivity_A', QUICK),
        ('effects.sensor_bias.U_x', replace(QUICK, intervals=False)),
    ):
        config = Config(effects=sma_sim.effects.sensor_bias(alpha=0.0))
        found = sma_sim.calibrate(dataset, config, replace(options, free=('beam.E', name)))
        assert name in found.without_influence and 'beam.E' not in found.without_influence
        assert f'of no influence {name}' in repr(found)


def test_a_parameter_that_its_prior_holds_is_not_said_to_have_no_influence(dataset):
    """A standard deviation that was meant as a part of the value: the prior is what holds it, not the data."""
    start = Config({'beam.E': 1.9e9}, priors={'beam.E': 0.05})
    for options in (QUICK, replace(QUICK, intervals=False)):
        found = sma_sim.calibrate(dataset, start, replace(options, free=('beam.E',)))
        assert found.without_influence == () and 'held by priors beam.E (given as known to 0.05 Pa)' in repr(found)
        assert 'its prior tells more than these data: beam.E (given as known to 0.05 Pa)' in remarks_on(found)


def test_progress_is_shown_where_it_is_seen(capsys, monkeypatch):
    monkeypatch.setattr('sma_sim.model.progress.QUIET_TIME', -1.0)
    ProgressLine('fitting')(0.5)
    assert capsys.readouterr().err == ''
    monkeypatch.setattr('sma_sim.model.progress.is_seen', lambda: True)
    simulate(Model(), COMMAND, 10.0)
    assert re.search(r'simulating: \[#{20}\] 100 %', capsys.readouterr().err)
    simulate(Model(), COMMAND, 10.0, progress=lambda part: None)
    assert capsys.readouterr().err == ''


def own_effect(name, bounds=(0.0, 1.0), **other):
    k = sma_sim.Parameter('k', 1e-3, 'W/K', bounds, 'conductance', neutral=0.0, realistic=(1e-4, 1e-2))
    return sma_sim.Effect(
        name=name,
        port='wire_heat',
        equation='J = -k (T - T_E)',
        source='a fin that conducts',
        parameters=(replace(k, **other),),
        kernel=lambda s, w, p: -p.k * (s.T - s.T_E),
    )


def pusher():
    return sma_sim.Structure(
        name='pusher',
        title='pusher',
        coordinates=(sma_sim.Coordinate('x', 'm', 1e-3),),
        wires=1,
        lengths=lambda q, p: p.L - q.x,
        forces=lambda q, v, p: -p.k * q.x - p.b * v.x,
        inertia=lambda p: p.m,
        parameters=(
            sma_sim.Parameter('L', 0.1, 'm', (1e-3, 1.0), 'length of the wire'),
            sma_sim.Parameter('k', 500.0, 'N/m', (1.0, 1e5), 'stiffness of the spring'),
            sma_sim.Parameter('b', 1.0, 'N s/m', (0.0, 1e3), 'damping'),
            sma_sim.Parameter('m', 0.01, 'kg', (1e-6, 10.0), 'mass'),
        ),
        defaults={'wire.n': 1.0, 'wire.l0': 0.094},
    )


def test_a_script_from_the_page_of_the_api(tmp_path):
    """Simulate with an effect, plot, DataFrame, fit two parameters, diagnose, save, load, own effect, own structure."""
    truth = Config({'beam.E': 2.2e9, 'wire.lambda': 500.0}, effects=[sma_sim.effects.gravity(g_y=-9.81)])
    run = sma_sim.simulate(truth, COMMAND, 10.0)
    run.plot().savefig(tmp_path / 'run.png')
    assert run.save(tmp_path / 'run.npz') and sma_sim.load(tmp_path / 'run.npz') == run
    measured = Dataset(
        Recording('run', 'module', run.time, {'alpha': run['alpha_rad'], 'U_y': run['U_y_m']}, COMMAND),
        {'alpha': 3.5e-4, 'U_y': 1e-5},
    )
    options = FitOptions(free=['beam.E', 'wire.lambda'], kinetics='hybrid', starts=1, intervals=False)
    found = sma_sim.calibrate(measured, Config(effects='gravity'), options)
    assert found.values == pytest.approx({'beam.E': 2.2e9, 'wire.lambda': 500.0}, rel=1e-3)
    file = sma_sim.write_config(found.config, tmp_path / 'robot.yaml')
    assert sma_sim.read_config(file).parameters == found.config.parameters
    request = sma_sim.DiagnosisRequest(kinetics='hybrid', options=options, equation=False, variants=False)
    assert 'gravity' in sma_sim.diagnose(measured, Config(), request=request).effects

    cooled = sma_sim.simulate(Config(effects=[own_effect('fin')(k=2e-3)]), COMMAND, 10.0)
    assert cooled['T_1_K'].max() < sma_sim.simulate(Model(), COMMAND, 10.0)['T_1_K'].max()
    with pytest.raises(UserError, match='fin is in no file'):
        sma_sim.write_config(Config(effects=[own_effect('fin')]), tmp_path / 'own.yaml')
    heating = sma_sim.Input([0.0, 1.0, 10.0], [[0.0, 298.0], [0.6, 298.0], [0.0, 298.0]], (False, False), ('J_W', 'T_E_K'))
    config = Config({'pusher.k': 400.0}, system=pusher())
    moved = sma_sim.simulate(config, heating, 20.0)
    assert moved.completed and np.ptp(moved['x_m']) > 1e-4 and moved.units['x_m'] == 'm'
    recorded = Dataset(Recording('own', 'pusher', moved.time, {'x': moved['x_m']}, heating), {'x': 1e-6})
    found = sma_sim.calibrate(recorded, Config(system=config.own_structure), replace(options, free='pusher.k'))
    assert found.values['pusher.k'] == pytest.approx(400.0, rel=1e-2)


def jumping_observer(time):
    observer = Observer(Config())
    observer.update(0.0, 1.0)
    return observer.update(time)


WIRE = sma_sim.wire_input([0.0, 1.0], [0.0, 0.01])
TIME, ALPHA = np.linspace(0.0, 12.0, 13), np.zeros(13)
SHAPES = {
    'a text for a model': (lambda: simulate('module', COMMAND, 10.0), 'model: expected Model or Config'),
    'no input': (lambda: simulate(Model(), None, 10.0), 'source: expected Input, from sma_sim.module_input'),
    'name of nothing': (lambda: sma_sim.simulat, 'sma_sim has no simulat; did you mean simulate'),
    'value without a name': (
        lambda: sma_sim.effects.gravity(-9.81),
        'effect gravity: expected values by name (g_y, g_x), got -9.81',
    ),
    'command without an end': (
        lambda: simulate(Model(), module_input([0.0], [5.0]), 10.0),
        'expected at least two rows, the last one gives the end of the run, got [0.]',
    ),
    'input of a wire': (lambda: simulate(Model(), WIRE, 10.0), "system 'module' takes J_eq_W, T_E_K"),
    'input of a module': (lambda: simulate(Config(system='wire'), COMMAND, 1.0), 'make it with sma_sim.wire_input'),
    'rate': (lambda: simulate(Model(), COMMAND, 0.0), 'expected a rate of more than 0 per second'),
    'a switch for a rate': (lambda: simulate(Model(), COMMAND, True), 'expected a rate [1/s] or times (k,) [s], got True'),
    'text for a number': (lambda: Config(effects=[sma_sim.effects.gravity(g_y='3')]), "effects.gravity.g_y = '3'"),
    'a jump of the clock': (lambda: jumping_observer(1e6), 'make another Observer after a pause or a jump'),
    'times in words': (lambda: simulate(Model(), COMMAND, ['a']), 'sample_times: expected numbers'),
    'times outside': (
        lambda: simulate(Model(), COMMAND, [0.0, 99.0]),
        'from 0 to 99 s: expected times of the input, 0 to',
    ),
    'channel': (lambda: simulate(Model(), COMMAND, 10.0, channels='alhpa'), 'did you mean alpha'),
    'step': (lambda: simulate(Model(), COMMAND, 10.0, max_step=-1.0), 'max_step = -1.0: expected more than 0 s'),
    'state': (lambda: simulate(Model(), COMMAND, 10.0, initial_state=3), 'initial_state: expected Run or Trajectory'),
    'command too long': (lambda: module_input([0.0, 1.0], [0.0, 1.0, 2.0]), 'expected one value, or 2 as there are times'),
    'command in words': (lambda: module_input([0.0, 1.0], [0.0, 'x']), 'J_eq: expected numbers'),
    'time that goes back': (lambda: module_input([1.0, 0.0], [0.0, 0.0]), 'times must increase'),
    'negative kelvin': (lambda: simulate(Model(), module_input([0.0, 1.0], [0.0, 0.0], -5.0), 10.0), 'expected kelvin'),
    'degrees Celsius': (
        lambda: simulate(Model(), module_input([0.0, 1.0], [0.0, 0.0], 25.0), 10.0),
        'input: T_E_K = 25: expected kelvin between 150 and 2000\n25 deg C are 298.15 K',
    ),
    'degrees': (
        lambda: sma_sim.calibrate(one(channels={'alpha': np.linspace(0.0, 20.0, 13)}), Config()),
        'recording r, channel alpha: expected radians up to pi, got 20, which looks like degrees; multiply by 0.01745',
    ),
    'wires in degrees Celsius': (
        lambda: recorded(channels={'T_1': np.append(np.full(12, 25.0), np.nan)}),
        'recording r, channel T_1: expected kelvin, at least 150, got 25, which looks like degrees Celsius; add 273.15',
    ),
    'milliwatts': (
        lambda: sma_sim.compare(one(source=module_input([0.0, 4.0, 8.0, 12.0], [0.0, 9e3, -9e3, 0.0])), Config()),
        'source, J_eq_W: expected watts, at most 2000, got 9000, which looks like milliwatts; multiply by 0.001',
    ),
    'degrees, held out': (
        lambda: sma_sim.evaluate_held_out(Config(), one(channels={'alpha': np.linspace(0.0, 20.0, 13)})),
        'which looks like degrees; multiply by 0.01745',
    ),
    'millimetres of a recording': (
        lambda: sma_sim.predict(Config(), recorded(channels={'U_y': np.linspace(0.0, 3.0, 13)})),
        'recording r, channel U_y: expected metres, less than 0.5, got 3, which looks like millimetres; multiply by 0.001',
    ),
    'degrees, compared as held out': (
        lambda: sma_sim.compare(one(), Config(), one('q', channels={'alpha': np.linspace(0.0, 20.0, 13)})),
        'recording q, channel alpha: expected radians',
    ),
    'held out of another system': (
        lambda: sma_sim.diagnose(one(), Config(), Dataset(pulled(), {'stress': 1e6})),
        'pull is a recording of a wire',
    ),
    'prediction of another system': (lambda: sma_sim.predict(Config(), pulled()), 'pull is a recording of a wire'),
    'per cent': (
        lambda: sma_sim.predict(Config(system='wire'), pulled(6.0)),
        'source, strain: expected a fraction such as 0.05, got 6, which looks like percent; multiply by 0.01',
    ),
    'megapascal': (
        lambda: sma_sim.evaluate_held_out(Config(system='wire'), Dataset(pulled(stress=300.0), {'stress': 1e6})),
        'channel stress: expected pascal, 10000 at least in a loaded wire, got 300, which looks like megapascal',
    ),
    'compared with itself': (lambda: sma_sim.compare(one(), Config(), one()), "'r' is there twice"),
    'latent inputs of another system': (
        lambda: sma_sim.estimate_latent_inputs(one(), Config(), Dataset(pulled(), {'stress': 1e6})),
        'pull is a recording of a wire',
    ),
    'a delay in milliseconds': (
        lambda: sma_sim.evaluate_held_out(Config(), one(), 30.0),
        'delay = 30: expected seconds, less than the 12 s of r',
    ),
    'a delay in milliseconds, predicted': (
        lambda: sma_sim.predict(Config(), recorded(), sma_sim.Nuisance(delay=30.0)),
        'delay = 30: expected seconds',
    ),
    'switches of exact commands': (
        lambda: sma_sim.predict(Config(), recorded(), sma_sim.Nuisance(switches=(0.5, 0.5))),
        'switches = (0.5, 0.5): expected 0 part(s) of a sampling interval',
    ),
    'error of a fit': (
        lambda: sma_sim.evaluate_held_out(Config(), one(), fitted_error=-1.0),
        'fitted_error = -1.0: expected',
    ),
    'infinite samples': (lambda: recorded(channels={'alpha': ALPHA + np.inf}), 'and NaN where a sample is missing'),
    'times of changes': (lambda: recorded(known_changes=(np.nan,)), 'known_changes: expected times [s], got (nan,)'),
    'error of no column': (
        lambda: recorded(imposed_std={'T_K': 1.0}),
        'imposed_std: expected standard deviations (SI) by column',
    ),
    'floor of no channel': (
        lambda: Dataset(recorded(), floor={'alhpa': 1.0}),
        "floor: no channel 'alhpa'; did you mean alpha",
    ),
    'negative resolution': (lambda: Dataset(recorded(), resolution={'alpha': -1.0}), 'resolution of alpha = -1.0: expected'),
    'bench without a deviation': (
        lambda: Dataset(recorded(), nuisances={'power_scale': {'k': -0.1}}),
        'nuisances, power_scale.k = -0.1: expected a standard deviation, more than 0',
    ),
    'effect of no bench': (
        lambda: sma_sim.calibrate(replace(one(), nuisances={'sensor_lagg': {'tau': 1.0}}), Config()),
        'did you mean sensor_lag',
    ),
    'rate of a challenge': (
        lambda: sma_sim.make_challenge(1, plan=sma_sim.RecordingPlan(rate=-1.0)),
        'expected at least 1 s and 1/s',
    ),
    'forecast of nothing': (lambda: Observer(Config()).forecast(1.0, [1.0]), 'the observer has no measurement yet'),
    'forecast of the past': (lambda: observed().forecast(1.0, [1.0]), 'that increase from 5 s on, that of the last message'),
    'command of an observer': (lambda: Observer(Config()).update(0.0, ['a']), "J_eq: expected numbers [W], got ['a']"),
    'command of a guard': (lambda: Guard(Config()).limit('a', None, 0.0), "J_eq: expected numbers [W], got 'a'"),
    'target of another length': (
        lambda: PredictiveController(Config()).step(0.0, {'alpha': 0.0}, lambda times: times[1:]),
        'target: expected a finite value of the coordinate for each of 11 times, got an array of shape (10,)',
    ),
    'column of a channel': (lambda: Recording('r', 'module', TIME, {'alpha_rad': ALPHA}, COMMAND), 'did you mean alpha'),
    'samples': (lambda: Recording('r', 'module', TIME, {'alpha': ALPHA[1:]}, COMMAND), 'expected 13 samples'),
    'system': (lambda: Recording('r', 'modul', TIME, {'alpha': ALPHA}, COMMAND), 'did you mean module'),
    'order of time': (lambda: Recording('r', 'module', TIME[::-1], {'alpha': ALPHA}, COMMAND), 'must increase'),
    'noise of no channel': (lambda: Dataset((), {'alhpa': 1.0}), "noise_std: no channel 'alhpa'"),
    'negative noise': (lambda: Dataset((), {'alpha': -1.0}), 'expected a standard deviation in SI units'),
    'no recording': (lambda: Dataset((COMMAND,), {}), 'recordings: expected Recording'),
    'no data': (lambda: sma_sim.calibrate(COMMAND, Config()), 'expected Dataset, from sma_sim.read_dataset'),
    'a model': (lambda: sma_sim.compare(Dataset(()), Model()), 'expected Config, from sma_sim.Config'),
    'a mapping': (lambda: sma_sim.calibrate(Dataset(()), Config(), {'free': 'beam.E'}), 'expected FitOptions'),
    'parameter of a fit': (lambda: sma_sim.calibrate(one(), Config(), FitOptions('beam.e')), 'did you mean beam.E'),
    'kinetics of a diagnosis': (lambda: sma_sim.DiagnosisRequest(kinetics='both'), 'expected one of hybrid, mas, auto'),
    'folder of effects': (lambda: sma_sim.find_effects('/nowhere'), 'is not a folder'),
    'rival': (lambda: sma_sim.next_experiment(one(), Config(), sma_sim.DesignRequest('gravity')), 'at least two different'),
    'file': (lambda: sma_sim.read_dataset('run.csv'), 'cannot read run.csv'),
    'result': (lambda: sma_sim.load('run.npz'), 'cannot read run.npz'),
    'name of a result': (lambda: simulate(Model(), COMMAND, 10.0).save('run.pkl'), 'expected a name that ends in .npz'),
    'hidden effect': (lambda: sma_sim.make_challenge(1, kinds=['gravty']), 'did you mean gravity'),
    'axis': (lambda: sma_sim.Coordinate('x', 'm', 1.0, axis='w'), 'expected an axis x, y or z'),
    'wires': (lambda: sma_sim.Structure('x', 'x', (), 0), 'expected 1 to 29 wires, got 0'),
    'a mapping for a file': (lambda: sma_sim.read_config({'beam.E': 2e9}), 'path: expected a text or a path; got'),
    'a model for a configuration': (lambda: sma_sim.write_config(Model(), 'r.yaml'), 'config: expected Config, from'),
    'number of a channel': (lambda: simulate(Model(), COMMAND, 10.0, channels=3), 'channels: expected a text or a list of'),
    'step in words': (lambda: simulate(Model(), COMMAND, 10.0, max_step='a'), "max_step: expected a number; got 'a'"),
    'rate in words': (lambda: simulate(Model(), COMMAND, '10'), "expected a rate [1/s] or times (k,) [s], got '10'"),
    'column of no name': (lambda: sma_sim.Input([0.0], [[1.0]], (False,)), 'a name for each of 1 columns in names=(...)'),
    'one word for all columns': (lambda: sma_sim.Input([0.0], [[1.0]], False), 'linear: expected a list of True or False'),
    'strain for stress': (lambda: simulate(under_load(), WIRE, 1.0), 'takes stress_Pa, J_W, T_E_K'),
    'command that cools': (lambda: simulate(slider(), COMMAND, 1.0), "system 'slider' takes J_W, T_E_K"),
    'number for a file': (lambda: simulate(Model(), COMMAND, 10.0).save(3), 'path: expected a text or a path; got 3'),
    'file that is none': (lambda: sma_sim.load(3), 'path: expected a text or a path; got 3'),
    'recordings that are none': (lambda: sma_sim.read_dataset(3), 'paths: expected a text or a path or a list of'),
    'name of a recording': (lambda: Recording(3, 'module', TIME, {'alpha': ALPHA}, COMMAND), 'name: expected a text; got 3'),
    'channels without names': (lambda: Recording('r', 'module', TIME, [ALPHA], COMMAND), 'channels: expected a mapping'),
    'milliseconds': (lambda: recorded(1e3 * TIME), 'expected a source that covers most samples, in seconds as they are'),
    'input of a wire in a recording': (lambda: recorded(TIME / 12, source=WIRE), "system 'module' takes J_eq_W, T_E_K"),
    'zero of no channel': (lambda: recorded(zero_std={'alhpa': 1.0}), "got 1.0 for 'alhpa'; did you mean alpha"),
    'ambient below 0': (lambda: recorded(ambient_std=-3.0), 'ambient_std = -3: expected kelvin, 0 or more'),
    'side of five wires': (lambda: recorded(unpowered_side=5), 'unpowered_side = 5: expected -1, 0 or 1'),
    'nothing recorded': (lambda: Dataset(None), 'recordings: expected Recording or a list of Recording'),
    'noise of all': (lambda: Dataset(recorded(), 1e-3), 'noise_std: expected a mapping from a text to a number'),
    'endless noise': (lambda: Dataset(recorded(), {'alpha': np.inf}), 'expected a standard deviation in SI units'),
    'the same name twice': (lambda: Dataset((recorded(), recorded())), "'r' is there twice; give each recording a name"),
    'number for a parameter': (lambda: FitOptions(free=3), "free: expected names of parameters such as 'beam.E'"),
    'seed': (lambda: FitOptions(seed=-1), 'seed = -1: expected a whole number, 0 or more'),
    'one limit': (
        lambda: FitOptions(limits={'beam.E': 1e9}),
        'limits: expected a mapping from a text to (a number, a number)',
    ),
    'workers': (lambda: sma_sim.calibrate(one(), Config(), executor=4), 'executor: expected an executor such as'),
    'model of a wire': (lambda: sma_sim.compare(one(), Config(system='wire')), 'r is a recording of a module'),
    'model of a wire, held out': (
        lambda: sma_sim.evaluate_held_out(Config(system='wire'), one()),
        'a recording of a module',
    ),
    'endless delay': (lambda: sma_sim.evaluate_held_out(Config(), one(), np.nan), 'delay = nan: expected seconds'),
    'start of one wire': (
        lambda: sma_sim.predict(Config(), recorded(), sma_sim.Nuisance(start=(0.1,))),
        '2 number(s) from 0',
    ),
    'held-out recording': (lambda: sma_sim.diagnose(one(), Config(), recorded()), 'held_out: expected Dataset'),
    'fitted and held out': (lambda: sma_sim.diagnose(one(), Config(), one()), 'r is among the recordings to fit too'),
    'options for a request': (lambda: sma_sim.diagnose(one(), Config(), request=QUICK), 'expected DiagnosisRequest'),
    'mapping for options': (lambda: sma_sim.DiagnosisRequest(options={}), 'options: expected FitOptions; got {}'),
    'folder in numbers': (lambda: sma_sim.find_effects(3), 'folders: expected a text or a path or a list of'),
    'seed in words': (lambda: sma_sim.make_challenge('a'), "seed: expected a whole number; got 'a'"),
    'length in words': (lambda: sma_sim.DesignRequest(length='100'), "length: expected a number; got '100'"),
    'spaces in a name': (lambda: own_effect('my fin'), "effect 'my fin': expected a name of letters, digits and _"),
    'bounds the wrong way': (
        lambda: own_effect('fin', bounds=(1.0, 0.0)),
        'bounds 1 to 0 W/K; expected the lower end first',
    ),
    'no function': (lambda: replace(own_effect('fin'), kernel=3), "effect 'fin', kernel: expected a function; got 3"),
    'parameter twice': (lambda: replace(own_effect('fin'), parameters=own_effect('fin').parameters * 2), 'k is there twice'),
    'one coordinate': (lambda: replace(pusher(), coordinates=pusher().coordinates[0]), 'expected a list of Coordinate'),
    'millimetres': (lambda: Config(system=replace(pusher(), coordinates=(MM,))), "unit 'mm'; expected an SI unit"),
    'default beyond bounds': (
        lambda: Config(system=replace(pusher(), defaults={'wire.n': -1.0})),
        'wire.n = -1: expected 1',
    ),
    'warmth of three wires': (
        lambda: told(beginning=sma_sim.Beginning((1.0, 2.0, 3.0))),
        'nuisance, warmth = (1.0, 2.0, 3.0): expected 2 difference(s) from the ambient [K], one by wire',
    ),
    'warmth that is none': (lambda: told(beginning=sma_sim.Beginning((np.nan, 0.0))), 'warmth = (nan, 0.0): expected 2'),
    'one warmth': (lambda: told(beginning=sma_sim.Beginning(3.0)), 'warmth: expected a list of number; got 3.0'),
    'pose of one coordinate': (lambda: told(beginning=sma_sim.Beginning(pose=(0.1,))), 'pose = (0.1,): expected 3'),
    'states of no effect': (
        lambda: told(beginning=sma_sim.Beginning(states=(('foo', (1.0,)),))),
        "states: no active effect 'foo' that has any",
    ),
    'factor of no parameter': (lambda: told(factors=(('beam.e', 2.0),)), "no parameter 'beam.e'; did you mean beam.E?"),
    'negative factor': (lambda: told(factors=(('beam.E', -2.0),)), 'factors: -2.0 for beam.E; expected a number above 0'),
    'ambient of a room': (lambda: told(ambient=298.0), 'nuisance, ambient = 298: expected a difference of temperatures'),
    'powers of more commands': (lambda: told(powers=(0.1,) * 6), 'expected 2 difference(s) [W], one by power'),
    'ambient std of a room': (lambda: recorded(ambient_std=298.0), 'ambient_std = 298: expected a difference of'),
    'inertia of no parameter': (lambda: pushed(inertia=lambda p: p.mass), 'its inertia fails: AttributeError'),
    'no inertia': (lambda: pushed(inertia=lambda p: None), 'its inertia gives (None,); expected a number for each of x'),
    'scale of no parameter': (
        lambda: pushed(coordinates=(sma_sim.Coordinate('x', 'm', lambda p: p.foo),)),
        'coordinate x: its scale fails: AttributeError',
    ),
    'gravity of two arguments': (lambda: pushed(gravity=lambda q, p: 0.0), 'its gravity fails: TypeError'),
    'law of no coordinate': (
        lambda: pushed(coordinates=(sma_sim.Coordinate('x', 'm', 1e-3, law='zz'),)),
        "coordinate x: law 'zz'; expected one of x",
    ),
    'negative limit': (lambda: sma_sim.Coordinate('x', 'm', 1e-3, limit=-1.0), 'limit = -1 m; expected more than 0'),
    'structure parameter twice': (
        lambda: pushed(parameters=pusher().parameters * 2),
        'parameter pusher.L is there twice',
    ),
    'energy of a number': (lambda: pushed(energy=3), "structure 'pusher', energy: expected a function; got 3"),
    'no title': (lambda: pushed(title=None), 'title: expected a text; got None'),
    'one name for several': (lambda: pushed(fitted='pusher.k'), 'fitted: expected a list of text'),
    'stage of no chain': (lambda: replace(own_effect('fin'), stage='foo'), "stage 'foo' on wire_heat; expected none"),
    'no wires': (lambda: replace(own_effect('fin'), wires=0), 'wires = 0; expected how many it needs, 1 or more'),
    'one system': (lambda: replace(own_effect('fin'), systems='module'), "systems: expected a list of text; got 'module'"),
    'quantity of nothing': (lambda: own_effect('fin', quantity='foo'), "quantity 'foo'; expected one of force, rate"),
    'old and new name': (lambda: old_and_new(Config), "Config: model = 'mas', but kinetics = 'hybrid': leave model out"),
    'old and new name of a fit': (lambda: old_and_new(FitOptions), "FitOptions: model = 'mas', but kinetics = 'hybrid'"),
    'structure in words': (lambda: Config(own_structure='module'), "own_structure: expected Structure; got 'module'"),
    'held out of nothing': (
        lambda: sma_sim.diagnose(one(), Config(), Dataset(())),
        'held_out: there is no recording; leave it out',
    ),
    'two kinetics': (
        lambda: sma_sim.DiagnosisRequest(kinetics='mas', options=FitOptions(kinetics='hybrid')),
        "kinetics = 'mas', but options have kinetics = 'hybrid'",
    ),
    'estimate of another robot': (lambda: guarded(), 'estimate: it is of 1 wire(s); expected one of 2'),
    'counters in numbers': (lambda: Counters.read(3, 2), 'path: expected a text or a path; got 3'),
    'a number beyond floats': (lambda: Config({'beam.E': 10**400}), 'expected a number'),
    'no bench': (lambda: Config().on_bench('foo'), "no bench 'foo' of module; expected one of module, module_at_T"),
    'no covariance': (lambda: Config().with_covariance(3), 'covariance: expected ParameterCovariance'),
    'words in numbers': (lambda: sma_sim.read_config(words=3), "words: expected 'name=value'"),
    'steps that are none': (lambda: simulate(Model(), COMMAND, 4.0, max_steps=np.nan), 'max_steps = nan: expected a number'),
    'an endless rate': (lambda: simulate(Model(), COMMAND, 1e12), '12 s would have 1.2e+13 samples'),
    'times that stand': (lambda: simulate(Model(), COMMAND, [0.0, 1.0, 1.0]), 'increase, got 1 s and then 1 s'),
    'times with a gap': (lambda: simulate(Model(), COMMAND, [0.0, np.nan]), 'increase, got nan at number 2'),
    'times in rows': (lambda: simulate(Model(), COMMAND, [[0.0, 1.0]]), 'increase, got an array of shape (1, 2)'),
    'time with a gap': (lambda: recorded(np.where(TIME == 2.0, np.nan, TIME)), 'must increase, got nan at number 3'),
    'several columns': (lambda: simulate(Model(), COMMAND, 1.0)[['alpha_rad']], 'expected the name of a column'),
    'seed of a design': (lambda: sma_sim.DesignRequest(seed=-1), 'seed = -1: expected a whole number, 0 or more'),
    'no budget': (lambda: sma_sim.DesignRequest(budget=0), 'budget = 0: expected a whole number, 1 or more'),
    'a hold in hours': (lambda: sma_sim.DesignRequest(hold=1e-4), 'expected seconds, and at most 2000 levels'),
    'stress of a design': (lambda: sma_sim.DesignRequest(stress=300.0), 'stress = 300 Pa: expected the largest'),
    'temperature of a design': (lambda: sma_sim.DesignRequest(temperature=80.0), '80 deg C are 353.15 K'),
    'executor that is shut down': (lambda: sma_sim.calibrate(one(), Config(), QUICK, shut_down()), 'executor: cannot'),
    'name that no file has': (lambda: a_run().save('a\0.npz'), "cannot write 'a\\x00.npz'"),
    'name that is too long': (lambda: a_run().save('a' * 300 + '.npz'), 'File name too long'),
    'keyword of a configuration': (lambda: Config(kinetic='mas'), "Config: no argument 'kinetic'; did you mean kinetics"),
    'keyword of a function': (lambda: sma_sim.calibrate(one(), Config(), option=QUICK), 'did you mean options?'),
    'keyword of a request': (lambda: sma_sim.DiagnosisRequest(free='beam.E'), "DiagnosisRequest: no argument 'free'"),
    'keyword of a model': (lambda: Model(kinetics='mas'), "Model: no argument 'kinetics'; it takes config"),
    'limits in gigapascal': (lambda: limited({'beam.E': (1.0, 4.0)}), 'limit of beam.E, 1 to 4 Pa: expected some of'),
    'limits of no delay': (lambda: limited({'delay': (20.0, 50.0)}), '20 to 50 s: no recording is longer than 12 s'),
    'negative zero': (lambda: recorded(zero_std={'alpha': -1.0}), 'deviations (SI), 0 or more; got -1.0 for alpha'),
    'recording without a name': (lambda: replace(recorded(), name=''), "recording: expected a name, such as 'run1', got ''"),
    'resolution of another system': (lambda: replace(one(), resolution={'stress': 1.0}), "no channel 'stress'"),
    'floor above the noise': (lambda: replace(one(), floor={'alpha': 1.0}), 'expected a part of its noise_std, 0.001 or'),
    'cooling of one wire': (lambda: simulate(slider(), COMMAND, 1.0), 'a command of -6 W'),
    'millinewton': (
        lambda: sma_sim.predict(Config(), recorded(channels={'F_1': np.linspace(0.0, 13e3, 13)})),
        'channel F_1: expected newtons, at most 10000, got 13000',
    ),
}
MM = sma_sim.Coordinate('x', 'mm', 1.0)


def recorded(time=TIME, source=COMMAND, channels=None, **more):
    return Recording('r', 'module', time, channels or {'alpha': ALPHA}, source, **more)


def pushed(**changes):
    return Config(system=replace(pusher(), **changes))


def old_and_new(kind):
    with pytest.warns(DeprecationWarning, match='model is called kinetics now'):
        kind(model='mas', kinetics='hybrid')


def a_run():
    return simulate(Model(), COMMAND, 1.0)


def shut_down():
    pool = ThreadPoolExecutor(1)
    pool.shutdown()
    return pool


def limited(limits):
    return sma_sim.calibrate(one(), Config(), replace(QUICK, limits=limits))


def guarded():
    return Guard(Config()).limit(5.0, Observer(Config(system='slider')).update(0.0, 1.0), 0.0)


def told(**nuisance):
    return sma_sim.predict(Config(), recorded(), sma_sim.Nuisance(**nuisance))


def pulled(strain=0.06, stress=3e8):
    """A recording of a wire on a tensile machine."""
    source = sma_sim.wire_input([0.0, 12.0], [0.0, strain])
    return Recording('pull', 'wire', TIME, {'stress': np.linspace(0.0, stress, 13)}, source)


def observed():
    observer = Observer(Config())
    observer.update(5.0, 1.0)
    return observer


def under_load():
    return Config(system='wire').on_bench('wire_under_load')


def slider():
    return Config(system='slider')


def one(name='r', **more):
    return Dataset(replace(recorded(**more), name=name), {'alpha': 1e-3, 'U_y': 1e-5})


@pytest.mark.filterwarnings('ignore::sma_sim.PhysicsWarning')
@pytest.mark.parametrize('mistake', SHAPES)
def test_a_wrong_argument_is_refused_with_its_cure(mistake):
    wrong, words = SHAPES[mistake]
    with pytest.raises(UserError, match=re.escape(words)):
        wrong()


def test_what_can_hardly_be_in_si_units_is_said_where_it_is_made():
    """Not refused: a diagnosis finds units. Nor does one outlier stop an observer; its first value tells units."""
    many = np.linspace(0.0, 12.0, 101)
    spiked = np.where(many == 6.0, 90.0, 0.01)
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        recorded(many, channels={'alpha': spiked})
        observer = Observer(Config())
        observer.update(0.0, 1.0, {'alpha': 0.01})
        observer.update(0.1, None, {'alpha': 12.0})
    for words, wrong in {
        'channel alpha: expected radians up to pi, got 20': lambda: recorded(channels={'alpha': np.linspace(0.0, 20.0, 13)}),
        'recording r: a sample every 1000 s: is time_s in seconds?': lambda: recorded(
            1e3 * TIME, sma_sim.module_input([0.0, 3e4], [0.0, 0.0])
        ),
        'strain: expected a fraction such as 0.05, got 6': lambda: simulate(
            Config(system='wire'), sma_sim.wire_input([0.0, 60.0], [0.0, 6.0]), 1.0
        ),
        'measurements, alpha: expected radians up to pi, got 12': lambda: Observer(Config()).update(
            0.0, 1.0, {'alpha': 12.0}
        ),
    }.items():
        with pytest.warns(sma_sim.PhysicsWarning, match=re.escape(words)):
            wrong()


def test_an_effect_that_is_left_out_is_said():
    for system, name, why in (('wire', 'gravity', 'wire'), ('coil', 'slack', 'straight wires, those of coil are twisted')):
        config = Config(system=system, effects=name)
        model = Model(config)
        with pytest.warns(sma_sim.PhysicsWarning, match=f'effect {name} is left out: .*{why}') as said:
            run = simulate(model, still(model), 1.0)
            column = model.structure.channel_columns[0]
            recording = Recording('run', system, run.time, {model.structure.channels[0]: run[column]}, still(model))
            sma_sim.predict(config, recording)
        assert len(said) == 2 and {one.filename for one in said} == {__file__}
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        simulate(Config(effects='gravity'), COMMAND, 1.0)
        simulate(model, still(model), 1.0, channels=model.structure.channels)  # as fits do, which have said it


def still(model):
    values = [0.0] * (len(model.structure.input_columns) - 1) + [298.0]
    linear = (False,) * len(values)
    return sma_sim.Input([0.0, 2.0], [values, values], linear, model.structure.input_columns)


def test_the_version_is_that_of_the_package():
    tomllib = pytest.importorskip('tomllib', reason='Python 3.11 reads TOML')
    project = tomllib.loads((ROOT / 'pyproject.toml').read_text())
    assert sma_sim.__version__ == project['project']['version']
    assert f'<version>{sma_sim.__version__}</version>' in (ROOT / 'package.xml').read_text()
    assert (ROOT / 'sma_sim' / 'py.typed').exists() and 'py.typed' in project['tool']['setuptools']['package-data'][
        'sma_sim'
    ]
