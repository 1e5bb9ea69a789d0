"""Kinetics that were given are kept by everything that fits; where they were not, the more probable ones are taken."""

from dataclasses import replace

import pytest
from simulated_data import config, dataset, scaled

from sma_sim import Config, find_effects, read_config
from sma_sim.evidence.diagnosis.diagnose import diagnose
from sma_sim.evidence.estimation.calibrate import FitOptions, calibrate
from sma_sim.evidence.estimation.prepared_fit import kinetics_to_try
from sma_sim.evidence.model_selection.candidates import with_effect
from sma_sim.evidence.model_selection.nominal_fit import DiagnosisRequest
from sma_sim.model.errors import UserError
from sma_sim.model.parameter_file import parameter_file

BOTH = ('hybrid', 'mas')


@pytest.mark.parametrize(
    ('asked', 'words', 'tried'),
    [
        (None, (), BOTH),
        (None, ('model=hybrid',), ('hybrid',)),
        (None, ('model=mas',), ('mas',)),
        (None, ('model=auto',), BOTH),
        ('hybrid', ('model=mas',), ('hybrid',)),
        ('auto', ('model=mas',), BOTH),
    ],
)
def test_what_is_given_is_kept(asked, words, tried, tmp_path):
    given = read_config(words=words)
    assert kinetics_to_try(asked, given) == tried
    file = tmp_path / 'robot.yaml'
    file.write_text(parameter_file(given))
    assert kinetics_to_try(asked, read_config(file)) == tried
    assert read_config(file).simulated_kinetics == given.simulated_kinetics == ('mas' if 'model=mas' in words else 'hybrid')


def test_kinetics_of_a_configuration_made_in_python():
    assert kinetics_to_try(None, Config(kinetics='mas')) == ('mas',) and kinetics_to_try(None, Config()) == BOTH
    with pytest.raises(UserError, match='expected one of hybrid, mas, auto'):
        read_config(words=['model=both'])


@pytest.mark.parametrize('by', ['request', pytest.param('configuration', marks=pytest.mark.slow)])
def test_a_diagnosis_keeps_given_kinetics_though_others_fit_better(by):
    truth = scaled(config("mas"), wire__lambda=1.1, wire__c_V=0.93, beam__E=1.06, wire__V_L=0.4)
    runs = dataset(with_effect(truth, find_effects()['gravity'], {'g_y': -9.81}), [1, 2], 1.0, 25.0, rate=10.0)
    options = FitOptions(starts=1, intervals=False)
    request = DiagnosisRequest('hybrid' if by == 'request' else None, options=options, equation=False, variants=False)
    nominal = config() if by == 'request' else replace(config(), kinetics='hybrid')
    found = diagnose(runs, nominal, request=request)
    assert {stage.kinetics for stage in found.stages} == {'hybrid'} and 'gravity' in found.effects


@pytest.mark.parametrize('true', BOTH)
def test_open_kinetics_are_those_of_the_robot(true):
    truth = scaled(config(true), wire__lambda=1.1, wire__E_A=0.9, beam__E=0.95)
    found = calibrate(dataset(truth, [1, 2], 1.0, rate=10.0), config(), FitOptions(starts=1, intervals=False))
    assert found.config.simulated_kinetics == true and found.kinetics[true] > 0.99
    assert found.config.kinetics == true
