"""How well fitted values are known together: what a fit leaves, in the parameter file, and in the observer that reads it."""

import dataclasses

import numpy as np
import pytest
import yaml
from simulated_data import config as simulated_config
from simulated_data import dataset

from sma_sim import Config, FitOptions, calibrate, read_config, write_config
from sma_sim.evidence.estimation.free_parameters import choose_free
from sma_sim.evidence.estimation.uncertainty import posterior_covariance
from sma_sim.evidence.state_estimation.uncertain import prior_correlation, uncertain_parameters
from sma_sim.model.config import flat_parameters
from sma_sim.model.covariance import ParameterCovariance
from sma_sim.model.errors import UserError
from sma_sim.observer import Observer

NAMES = ('wire.sigma_T', 'wire.lambda', 'effects.gravity.g_y')
MATRIX = np.array([[4e-4, 3.6e-4, 0.0], [3.6e-4, 4e-4, 0.0], [0.0, 0.0, 0.04]])


def known(matrix=MATRIX, names=NAMES):
    return Config(effects='gravity').with_covariance(ParameterCovariance(names, np.array(matrix)))


def test_a_file_keeps_it(tmp_path):
    file = write_config(known(), tmp_path / 'robot.yaml')
    again = read_config(file)
    assert again.covariance == known().covariance and again == known()
    assert again.variant({'wire.E_A': 5e10}).covariance == again.covariance
    section = yaml.safe_load(file.read_text())['/**']['ros__parameters']['covariance']
    assert section['names'] == list(NAMES)  # what ROS 2 takes: lists of names, and of numbers
    assert all(isinstance(one, float) for one in section['matrix']) and len(section['matrix']) == 9
    recorded = read_config(recorded=flat_parameters(again))
    assert recorded.covariance == again.covariance
    assert (
        'covariance'
        not in (tmp_path / 'plain.yaml').with_name(write_config(Config(), tmp_path / 'plain.yaml').name).read_text()
    )


def test_an_effect_that_is_switched_off_is_left_out(tmp_path):
    file = tmp_path / 'robot.yaml'
    file.write_text(yaml.safe_dump({'covariance': {'names': list(NAMES), 'matrix': MATRIX.ravel().tolist()}}))
    found = read_config(file).covariance
    assert found.names == NAMES[:2] and np.array_equal(found.matrix, MATRIX[:2, :2])


@pytest.mark.parametrize(
    ('names', 'matrix', 'said'),
    [
        (['wire.sigma_t'], [1.0], 'no fit of this model changes wire.sigma_t; did you mean'),
        (['node.J_max'], [1.0], 'no fit of this model changes node.J_max'),
        (['wire.E_A', 'wire.E_A'], [1.0] * 4, 'a name is there twice'),
        (['wire.E_A', 'wire.E_M'], [1.0] * 3, '3 numbers for 2 names; expected 4'),
        (['wire.E_A'], [float('nan')], 'expected 1'),
        (['wire.E_A'], ['wide'], 'expected a list of numbers'),
        (['wire.E_A'], [-1.0], 'without negative eigenvalues'),
        (['wire.E_A', 'wire.E_M'], [1.0, 2.0, 2.0, 1.0], 'without negative eigenvalues'),
        (['wire.E_A', 'wire.E_M'], [1.0, 0.5, 0.4, 1.0], 'symmetric'),
        (['wire.E_A', 'wire.E_M'], [1.0, 0.0, 0.0, 0.0], 'above 0'),
    ],
)
def test_what_is_no_covariance_is_said(names, matrix, said, tmp_path):
    file = tmp_path / 'robot.yaml'
    file.write_text(yaml.safe_dump({'covariance': {'names': names, 'matrix': matrix}}))
    with pytest.raises(UserError, match=said):
        read_config(file)


def test_one_without_the_other_is_said():
    with pytest.raises(UserError, match='expected both covariance.names and covariance.matrix'):
        read_config(words={'covariance.names': ['wire.E_A']})


def test_what_a_fit_leaves_is_in_its_configuration_and_used_by_an_observer(tmp_path):
    """The observer starts with the standard deviations and correlations of a fit; a further fit does not keep them."""
    options, data = FitOptions(free=('wire.sigma_T', 'wire.lambda', 'wire.c_V')), dataset(simulated_config(), [1], noise=1.0)
    found = calibrate(data, simulated_config(), options)
    left = found.config.covariance
    assert left.names == tuple(one.name for one in found.free)
    std = np.sqrt(np.diag(left.matrix))
    stated = {one.name: one.std for one in found.uncertainty.intervals}
    assert all(0.5 * stated[name] < one <= 1.01 * stated[name] for name, one in zip(left.names, std, strict=True))
    again = read_config(write_config(found.config, tmp_path / 'fitted.yaml'))
    observer = Observer(again)
    for name, one in zip(left.names, std, strict=True):
        value, spread = observer.parameters[name]
        assert spread / value == pytest.approx(one, rel=1e-6)
    free = uncertain_parameters(again)
    at = [[one.name for one in free].index(name) for name in left.names]
    assert prior_correlation(again, free)[at[0], at[1]] == pytest.approx(left.matrix[0, 1] / std[0] / std[1])
    assert calibrate(data, again, dataclasses.replace(options, intervals=False)).config.covariance is None


def test_a_posterior_has_the_information_of_data_and_priors():
    """Of two parameters of which data tell the difference only, the sum keeps its prior."""
    free = choose_free(Config(), ('wire.sigma_T', 'wire.lambda'))[0]
    root = np.array([[1.0, -1.0], [1.0, 1.0]]) / np.sqrt(2.0)
    told = np.array([1e4, 0.0])  # information of difference and sum, in z
    covariance = root.T @ np.diag(1.0 / (told + 1.0 / 25.0)) @ root
    std = np.sqrt(np.diag(covariance))
    known = Spread(std * [one.scale for one in free], covariance / np.outer(std, std))
    found = posterior_covariance(free, known).matrix / np.outer(*([one.scale for one in free],) * 2)
    assert np.allclose(np.diag(root @ found @ root.T), 1.0 / (told + 1.0), rtol=1e-6)


class Spread:
    """What `posterior_covariance` reads of an uncertainty."""

    def __init__(self, stds, correlation):
        self.intervals = [type('Of', (), {'std': float(std)}) for std in stds]
        self.correlation = tuple(map(tuple, correlation.tolist()))
