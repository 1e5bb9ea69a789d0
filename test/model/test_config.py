"""Constructing a configuration is checking it: no wrong physics passes in silence."""

import math
import pickle
import re
import warnings
from dataclasses import replace

import numpy as np
import pytest

import sma_sim
from sma_sim import Config, Effect, Model, Parameter, UserError, find_effects, module_input, read_config, simulate
from sma_sim.cli.main import main
from sma_sim.model.config import effect_parameters
from sma_sim.model.effects.discovery import effects_on, package_effects
from sma_sim.model.errors import PhysicsWarning
from sma_sim.model.likely_unit import likely_unit, written_otherwise
from sma_sim.model.structures.discovery import known_structures

STEP = module_input([0.0, 1.0, 10.0], [0.0, 12.0, 0.0])
WRONG = {
    'unknown parameter': (lambda: Config({'beam.e': 5e9}), r'unknown parameter beam\.e \(in Config.*did you mean beam\.E\?'),
    'out of range': (lambda: Config({'wire.E_A': -1e9}), r'wire\.E_A = -1e\+09 Pa .*expected 1e\+08 to 1e\+12 Pa'),
    'a text': (lambda: Config({'wire.E_A': '12e9'}), r"wire\.E_A = '12e9' .*expected a number in Pa"),
    'not finite': (lambda: Config({'wire.E_A': math.nan}), r'wire\.E_A = nan Pa'),
    'no mapping': (lambda: Config('beam.E=5e9'), r'expected a mapping such as'),
    'kinetics': (lambda: Config(kinetics='MAS'), r"kinetics = 'MAS' .*expected one of hybrid, mas, auto; did you mean mas"),
    'kinetics of files': (lambda: Config({'model': 'mas'}), r'give Config\(kinetics=\.\.\.\)'),
    'system': (lambda: Config(system='modul'), r"system = 'modul' .*did you mean module"),
    'effect': (lambda: Config(effects=('gravty',)), r'unknown effect gravty .*did you mean gravity'),
    'effect twice': (lambda: Config(effects=['gravity', 'gravity']), r'gravity is there twice'),
    'no effect': (lambda: Config(effects=[3]), r'expected effects or their names, such as gravity; got 3'),
    'value of an effect': (lambda: Config(effects='gravity:g_y=500'), r'g_y = 500 m/s\^2 .*expected -50 to 50'),
    'parameter of an effect': (lambda: sma_sim.effects.gravity(g=1.0), r'no parameter g; did you mean .*g_y.*m/s\^2'),
    'effect of the package': (lambda: sma_sim.effects.gravty, r'has no gravty; did you mean gravity'),
    'structure of the package': (lambda: sma_sim.structures.sliders, r'has no sliders; did you mean slider'),
    'scope': (lambda: Config(effects=sma_sim.effects.natural_convection(scope='wire_3')), "scope 'wire_3'.*wire_1, wire_2"),
    'inactive effect': (lambda: Config({'effects.gravity.g_y': 2.0}), 'gravity is not active; give Config'),
    'unit': (lambda: Config({'wire.sigma_T': 8.0}), r'did you mean 8 MPa/K, 8e\+06\?.*give it with its unit: .8\.0 Pa/K.'),
    'unit on the command line': (lambda: read_config(words='wire.rho=6.45'), r'did you mean 6\.45 g/cm\^3, 6450\?'),
    'unit of an effect': (lambda: Config(effects='polycrystal:spread=20'), r'did you mean 20 MPa, 2e\+07\?'),
    'setting': (lambda: Config(settings={'node.recrd': 'x'}), r'unknown setting node\.recrd .*did you mean node\.record'),
    'type of a setting': (lambda: Config(settings={'node.record': 3}), r'node\.record = 3 .*expected a text'),
    'size': (lambda: Config({'stack.modules': 2.5}, 'stack'), r'expected a whole number'),
    'defaults of no system': (lambda: sma_sim.default_parameters('modul'), r'did you mean module'),
    'file that is not there': (lambda: read_config('robot.yaml'), r'cannot read robot\.yaml'),
    'words': (lambda: read_config(words=[3]), r"expected 'name=value'"),
    'one parameter of a fit': (lambda: sma_sim.FitOptions(free=[3]), 'expected names of parameters'),
    'kinetics of a fit': (lambda: sma_sim.FitOptions(kinetics='both'), r"kinetics = 'both'.*hybrid, mas, auto"),
    'starts of a fit': (lambda: sma_sim.FitOptions(starts=0), r'starts = 0: expected a whole number, 1 or more'),
    'column': (lambda: simulate(Model(), STEP, 10.0)['T1'], r"no column 'T1'; did you mean T_1_K"),
}


@pytest.mark.parametrize('mistake', WRONG)
def test_a_mistake_is_refused_with_its_cure(mistake):
    wrong, words = WRONG[mistake]
    with pytest.raises(UserError, match=words):
        wrong()


def test_one_stands_for_a_list_of_one():
    assert read_config(effects='gravity', words='beam.E=2.2e9').effects == Config(effects=['gravity']).effects
    assert sma_sim.FitOptions(free='beam.E').names == ('beam.E',)


def test_a_file_may_be_named_by_a_text(tmp_path):
    (tmp_path / 'robot.yaml').write_text('beam: {E: 2.2e+9}\nkinetics: mas\n')
    config = read_config(str(tmp_path / 'robot.yaml'))
    assert config.parameters['beam.E'] == 2.2e9 and config.kinetics == 'mas'
    assert read_config(tmp_path / 'robot.yaml', words='model=hybrid').kinetics == 'hybrid'
    (tmp_path / 'robot.yaml').write_text('kinetics: mas\nmodel: hybrid\n')
    with pytest.raises(UserError, match='two names of the kinetics'):
        read_config(tmp_path / 'robot.yaml')


@pytest.mark.parametrize(
    'effects',
    [
        {'gravity': {'g_y': 2.0}},
        'gravity:g_y=2',
        sma_sim.effects.gravity(g_y=2.0),
        [sma_sim.effects.gravity(g_y=2)],
        [find_effects()['gravity'](g_y=np.float64(2.0))],
    ],
)
def test_values_of_effects_are_kept(effects):
    (one,) = Config(effects=effects).effects
    assert one.values == (2.0, 0.0) and one == read_config(effects=effects).effects[0]
    assert Config({'effects.gravity.g_y': 2.0}, effects=['gravity']).effects == (one,)


def test_effects_in_a_part_and_on_another_structure():
    everywhere, one_wire = sma_sim.effects.natural_convection(k=3.0), sma_sim.effects.natural_convection(scope='wire_1')
    config = Config(system=sma_sim.structures.slider, effects=[sma_sim.effects.joint_friction(M_c=0.1), everywhere])
    assert (
        config.effects
        == read_config(words='system=slider', effects=['joint_friction:M_c=0.1', 'natural_convection:k=3']).effects
    )
    assert Config(effects=one_wire).effects == read_config(effects='natural_convection@wire_1').effects


def test_nothing_is_changed_in_place():
    config, given = Config({'beam.E': 2.2e9}), {'beam.E': 2.2e9}
    copy = Config(given)
    with pytest.raises(TypeError):
        config.parameters['beam.E'] = 1e9
    given['beam.E'] = 1.0
    assert copy.parameters['beam.E'] == 2.2e9 and copy == config


def test_old_names_go_on_with_a_warning():
    with pytest.warns(DeprecationWarning, match='model is called kinetics now') as told:
        config = Config(model='mas')
        assert config.model == 'mas' == config.kinetics == config.simulated_kinetics
        assert replace(config, model='hybrid').kinetics == 'hybrid'
        assert sma_sim.FitOptions(model='mas').kinetics == 'mas' == sma_sim.FitOptions('beam.E', 'mas').model
    assert {warning.filename for warning in told} >= {__file__}


def test_open_kinetics_are_simulated_as_hybrid():
    assert Config().kinetics == 'auto' and Config().simulated_kinetics == 'hybrid' == Config(kinetics='hybrid').kinetics


def test_variants_of_a_fit_are_as_checked_ones():
    config = Config({'wire.E_A': 1e10}, effects='gravity')
    changed = config.variant({'beam.E': 2.1e9}, kinetics='mas')
    assert changed == Config({'wire.E_A': 1e10, 'beam.E': 2.1e9}, kinetics='mas', effects='gravity')
    assert config == Config({'wire.E_A': 1e10}, effects='gravity')


def own_effect(k=None, kernel=lambda s, w, p: -p.k * (s.T - s.T_E), **changed):
    given = {'default': 0.01, 'unit': 'W/K', 'bounds': (0.0, 1.0), 'description': 'k', 'neutral': 0.0} | (k or {})
    fields = {'name': 'fin', 'port': 'wire_heat', 'equation': 'J = -k (T - T_E)', 'source': 'a fin'} | changed
    return Effect(parameters=(Parameter('k', **given),), kernel=kernel, **fields)


@pytest.mark.parametrize(
    ('wrong', 'words'),
    [
        ({'k': {'default': 2.0}}, 'parameter k: default 2 W/K; expected 0 to 1'),
        ({'k': {'neutral': -1.0}}, 'parameter k: neutral -1 W/K; expected 0 to 1'),
        ({'k': {'unit': ''}}, "expected a unit, such as 'N/m'"),
        ({'k': {'bounds': (1.0,)}}, 'expected numbers'),
        ({'port': 'wire_heats'}, "port 'wire_heats'; expected one of actuation, wire_heat"),
        ({'name': 'gravity'}, "an effect named 'gravity' exists already"),
        (
            {'kernel': lambda s, w, p: 0.1 - p.k * (s.T - s.T_E)},
            r'its kernel returns 0\.1 at its neutral values \(k = 0\); expected 0',
        ),
    ],
)
def test_an_own_effect_with_a_fault_is_refused(wrong, words):
    with pytest.raises(UserError, match=words):
        simulate(Model(Config(effects=[own_effect(**wrong)])), STEP, 10.0)


def test_an_own_effect_as_an_object():
    """No file, and no native code of an older version of the same name."""
    hot = [simulate(Model(Config(effects=[fins(factor)(k=0.02)])), STEP, 10.0)['T_1_K'].max() for factor in (1.0, 2.0, 1.0)]
    assert hot[0] == hot[2] > hot[1] + 1.0
    assert hot[0] < simulate(Model(Config(effects=[fins(1.0)(k=0.0)])), STEP, 10.0)['T_1_K'].max() - 1.0


def fins(factor):
    """A fin whose kernel has a constant of its own."""
    return own_effect(kernel=lambda s, w, p: -p.k * factor * (s.T - s.T_E))


def test_a_wire_that_would_melt_is_said(tmp_path, capsys):
    with pytest.warns(PhysicsWarning, match=r'wire 1 comes to \d+ K; NiTi melts at 1583 K'):
        run = simulate(Model(), module_input([0.0, 1.0, 20.0], [0.0, 5000.0, 0.0]), 10.0)
    assert run['T_1_K'].max() > 10_000.0 and re.search(
        r'J_eq comes to 5000 W, beyond node.J_max = 30 W', ' '.join(run.notes)
    )
    (tmp_path / 'hot.csv').write_text('time_s,J_eq_W\n0,5000\n5,0\n')
    assert main(['simulate', '--input', str(tmp_path / 'hot.csv'), '--out', str(tmp_path / 'out.csv')]) == 0
    told = capsys.readouterr().err
    assert told.count('NiTi melts') == 1 and 'beyond node.J_max' in told
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        assert simulate(Model(), STEP, 10.0).notes == ()


def test_an_input_is_not_overwritten(tmp_path, capsys):
    source = tmp_path / 'c.csv'
    source.write_text('time_s,J_eq_W\n0,0\n5,0\n')
    for words in (['--out', source], ['--out', tmp_path / 'run.csv', '--jumps', source]):
        assert main(['simulate', '--input', str(source), *map(str, words)]) == 2
        assert 'it is read as' in capsys.readouterr().err
    assert (
        main(['simulate', '--input', str(source), '--out', str(tmp_path / 'a.csv'), '--jumps', str(tmp_path / 'a.csv')]) == 2
    )
    assert 'give two files' in capsys.readouterr().err
    assert source.read_text() == 'time_s,J_eq_W\n0,0\n5,0\n' and list(tmp_path.iterdir()) == [source]


def test_no_default_and_nothing_realistic_is_asked_for_its_unit():
    for structure in known_structures().values():
        values = structure.default_values
        asked = [name for name, one in structure.all_parameters.items() if likely_unit(one, values[name])[0]]
        effects = effects_on(package_effects(), list(package_effects()), structure, values)
        for name, one in effect_parameters(effects).items():
            given = (one.default, one.neutral, *(one.realistic or ()))
            asked += [f'{name} = {value}' for value in given if value is not None and likely_unit(one, value)[0]]
        assert asked == []


@pytest.mark.parametrize(
    ('unit', 'wanted'),
    [
        ('Pa/K', {'MPa/K': 1e6}),
        ('kg/m^3', {'g/cm^3': 1e3}),
        ('J/(kg K)', {'J/(g K)': 1e3}),
        ('W/(m^2 K)', {'W/(cm^2 K)': 1e4}),
        ('ohm m', {'uohm cm': 1e-8}),
        ('1/rad^2', {'1/deg^2': (180.0 / math.pi) ** 2}),
        ('W/(m^2 K^(1+m))', {}),
        ('-', {}),
    ],
)
def test_units_beside_si_have_their_factors(unit, wanted):
    found = {name: factor for _, name, factor in written_otherwise(unit)}
    assert {name: found[name] for name in wanted} == pytest.approx(wanted) and bool(found) == bool(wanted)


def test_a_value_that_is_meant_is_kept_by_all_that_is_made_of_it(tmp_path):
    config = Config({'wire.sigma_T': '8 Pa/K'}, 'wire', effects='thermal_expansion:T_ref=25 K', priors={'wire.E_A': 1e9})
    assert config.values['wire.sigma_T'] == 8.0 and config.values['effects.thermal_expansion.T_ref'] == 25.0
    assert read_config(sma_sim.write_config(config, tmp_path / 'robot.yaml')) == config
    assert pickle.loads(pickle.dumps(config)) == config
    assert config.on_bench('wire_under_load').parameters['wire.sigma_T'] == 8.0
    assert replace(config, effects=()).parameters['wire.sigma_T'] == 8.0
    assert read_config(recorded={'wire.sigma_T': 8.0}).parameters['wire.sigma_T'] == 8.0
    assert Config({'wire.lambda': 1.0}).parameters['wire.lambda'] == 1.0  # unusual, and no other unit is more likely
