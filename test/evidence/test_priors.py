"""How well a value is known before a fit: said in the parameter file, or usual for its kind."""

import math

import numpy as np
import pytest
import yaml
from simulated_data import config, dataset, scaled

from sma_sim import Config, FitOptions, calibrate, read_config
from sma_sim.evidence.estimation.free_parameters import choose_free, free_parameter
from sma_sim.evidence.estimation.plausibility import implausible_parameters
from sma_sim.evidence.estimation.prepared_fit import started_from_curves
from sma_sim.model.config import flat_parameters
from sma_sim.model.effects.discovery import find_effects
from sma_sim.model.errors import UserError
from sma_sim.model.parameter_file import parameter_file

FILE = """
/**:
  ros__parameters:
    wire: {E_A: 60.0e+9, lambda: 200.0}
    effects: {active: [gravity], gravity: {g_y: -9.81}}
    priors:
      wire: {E_A: 6.0e+9}
      effects: {gravity: {g_y: 0.01}}
"""


def free_of(given, *names):
    return dict(zip(names, choose_free(given, names)[0], strict=True))


def test_a_file_says_how_well_values_are_known(tmp_path):
    file = tmp_path / 'robot.yaml'
    file.write_text(FILE)
    given = read_config(file)
    free = free_of(given, 'wire.E_A', 'wire.E_M', 'effects.gravity.g_y')
    assert free['wire.E_A'].scale == pytest.approx(0.1) and free['effects.gravity.g_y'].scale == 0.01
    assert free['wire.E_A'].value(1.0) == pytest.approx(60e9 * math.exp(0.1))
    again = tmp_path / 'again.yaml'
    again.write_text(parameter_file(given))
    assert read_config(again).priors == given.priors == {'wire.E_A': 6e9, 'effects.gravity.g_y': 0.01}
    assert repr(flat_parameters(read_config(again))) == repr(flat_parameters(given))  # nan is not itself
    assert given.variant({'wire.E_A': 5e10}).priors == given.priors
    leaves = [yaml.safe_load(again.read_text())['/**']['ros__parameters']['priors']]
    while leaves:  # what ROS 2 takes: nested names of scalars
        leaf = leaves.pop()
        assert isinstance(leaf, dict | float)
        leaves += leaf.values() if isinstance(leaf, dict) else ()


def test_words_and_python_say_it_too():
    assert read_config(words=['priors.beam.E=1e8']).priors == Config(priors={'beam.E': 1e8}).priors == {'beam.E': 1e8}
    assert not Config().priors and 'priors:' not in parameter_file(Config())
    wire = Config(system='wire', priors={'wire.E_A': 1e9})
    assert wire.on_bench('wire_under_load').priors == {'wire.E_A': 1e9}


@pytest.mark.parametrize(
    ('word', 'said'),
    [
        ('priors.wire.E_B=1e9', 'no fit of this model changes wire.E_B; did you mean'),
        ('priors.node.J_max=1', 'no fit of this model changes node.J_max'),
        ('priors.wire.E_A=0', 'more than 0'),
        ('priors.wire.E_A=wide', 'expected a standard deviation in Pa'),
        ('priors.effects.gravity.g_y=1', 'no fit of this model changes'),
    ],
)
def test_what_is_no_prior_is_said(word, said):
    with pytest.raises(UserError, match=said):
        read_config(words=[word])


def test_widths_by_kind():
    """Geometry tight, moduli in the middle, convection and damping wide; all but geometry may move by a factor of twelve,
    damping by more."""
    names = ('wire.l0', 'wire.E_A', 'beam.E', 'wire.c_V', 'wire.sigma_MW0', 'wire.lambda', 'beam.b_y')
    free = free_of(config(), *names)
    assert [free[name].scale for name in names] == [0.02, 0.3, 0.3, 0.3, 0.5, 0.7, 1.0]
    for name in names[1:]:
        assert free[name].value(free[name].high) / free[name].center == pytest.approx(
            math.exp(5.0 if name == 'beam.b_y' else 2.5)
        ), name
        assert free[name].value(free[name].plausible) / free[name].center == pytest.approx(1.5), name


def test_a_fit_reaches_all_realistic_values_of_every_effect():
    """A fatigue that develops over hundreds of cycles was out of reach: another effect had to imitate the rest of it."""
    for found in find_effects().values():
        for declared in found.parameters:
            start = declared.default if declared.neutral is None else declared.neutral
            free = free_parameter(declared.name, start, declared)
            for end in declared.realistic or ():
                if end > 0.0 or not free.log:
                    assert free.low - 1e-9 <= free.coordinate(end) <= free.high + 1e-9, (found.name, declared.name)


def test_three_standard_deviations_of_what_is_known_are_plausible():
    (free,) = choose_free(Config(priors={'wire.E_A': 0.05 * 12.3e9}), ['wire.E_A'])[0]
    at = [implausible_parameters(Config(), [free], np.array([z]), np.array([[1e-6]])) for z in (2.9, 3.1, -3.1)]
    assert [bool(found) for found in at] == [False, True, True]


def test_a_narrow_prior_holds_what_few_data_see():
    """A weak run says little of E_A: the value stays within what the laboratory knows of it."""
    runs = dataset(scaled(config(), wire__E_A=1.02), [1], noise=1.0, seconds=10.0, rate=2.0)
    options = FitOptions(free=('wire.E_A', 'wire.E_M', 'wire.eps_T'), kinetics='hybrid', starts=1, intervals=False)
    known = Config(priors={'wire.E_A': 0.02 * 12.3e9})
    loose, tight = (calibrate(runs, given, options).values['wire.E_A'] / 12.3e9 for given in (Config(), known))
    assert abs(tight - 1.0) < 0.06 and abs(tight - 1.0) < abs(loose - 1.0)


def test_a_value_with_a_prior_does_not_give_way_to_curves(monkeypatch):
    monkeypatch.setattr('sma_sim.evidence.estimation.prepared_fit.curve_features', lambda _: [1])
    monkeypatch.setattr(
        'sma_sim.evidence.estimation.prepared_fit.starting_values', lambda _: {'wire.E_A': 5e10, 'wire.E_M': 3e10}
    )
    started, _ = started_from_curves(None, Config(system='wire', priors={'wire.E_A': 1e9}))
    assert started.parameters['wire.E_A'] == Config().parameters['wire.E_A'] and started.parameters['wire.E_M'] == 3e10
