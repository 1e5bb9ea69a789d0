"""Parameters that a fit moved out of their plausible range: found where data insist on them, and only there."""

from dataclasses import replace

import numpy as np
import pytest
from simulated_data import config, dataset, scaled

from sma_sim import FitOptions, calibrate, find_effects
from sma_sim.evidence.diagnosis.diagnose import diagnose
from sma_sim.evidence.estimation.free_parameters import choose_free
from sma_sim.evidence.estimation.plausibility import implausible_parameters
from sma_sim.evidence.model_selection.candidates import with_effect
from sma_sim.evidence.model_selection.nominal_fit import DiagnosisRequest
from sma_sim.words.diagnosis_data import as_data
from sma_sim.words.diagnosis_text import as_text
from sma_sim.words.fit_data import fit_result_data
from sma_sim.words.fit_remarks import remarks_on

FREE = ('wire.lambda', 'wire.E_A', 'wire.E_M')


def found_at(base, values, std, names=FREE):
    """What is implausible of fitted values (SI) that are all known to `std` in the coordinate of the fit."""
    free, _ = choose_free(base, names)
    z = np.array([parameter.coordinate(values.get(parameter.name, parameter.center)) for parameter in free])
    fitted = base.variant({p.name: p.value(float(x)) for p, x in zip(free, z, strict=True)})
    return implausible_parameters(fitted, free, z, std**2 * np.eye(len(z)))


@pytest.mark.parametrize(('factor', 'std', 'said'), [(1.7, 0.01, 1), (0.55, 0.01, 1), (1.4, 0.01, 0), (1.7, 0.5, 0)])
def test_a_value_far_from_nominal_counts_where_data_determine_it(factor, std, said):
    found = found_at(config(), {'wire.lambda': 450.0 * factor}, std)
    assert [one.name for one in found] == ['wire.lambda'] * said
    assert all(one.text == f'wire.lambda {450.0 * factor:.4g} instead of 450 W/(m^2 K)' for one in found)


@pytest.mark.parametrize(('std', 'said'), [(0.02, ['order']), (0.3, [])])
def test_martensite_stiffer_than_austenite(std, said):
    found = found_at(config(), {'wire.E_A': 10.0e9, 'wire.E_M': 11.0e9}, std)
    assert [one.reason for one in found] == said
    assert all(one.text == 'wire.E_M 1.1e+10 Pa above wire.E_A 1e+10 Pa' for one in found)
    assert not found_at(config(), {'wire.E_A': 11.0e9, 'wire.E_M': 10.0e9}, std)


def test_an_effect_is_judged_by_its_realistic_range():
    given = with_effect(config(), find_effects()['radiation'], {'emissivity': 0.3})
    (parameter,) = [p for p in find_effects()['radiation'].parameters if p.name == 'emissivity']
    name, (low, high) = 'effects.radiation.emissivity', parameter.realistic
    assert not found_at(given, {name: high}, 1e-3, (name,)) and not found_at(given, {name: low}, 1e-3, (name,))
    beyond = found_at(given, {name: high + 0.3 * (high - low)}, 1e-3, (name,))
    assert [implausible.reason for implausible in beyond] == ['realistic'] and 'realistic: ' in beyond[0].text


@pytest.mark.slow
def test_fit_and_diagnosis_say_it():
    """A robot that cools 1.8 times as fast as the model says: the fit explains it, with a value that is not plausible."""
    runs = dataset(scaled(config(), wire__lambda=1.8), (1, 2), 1.0, 25.0, rate=5.0, channels=('alpha', 'F_1'))
    options = FitOptions(free=('wire.lambda', 'beam.E'), kinetics='hybrid', starts=1)
    fitted = calibrate(runs, config(), options)
    assert [implausible.name for implausible in fitted.implausible] == ['wire.lambda']
    assert any('instead of 450' in line and 'probably missing' in line for line in remarks_on(fitted))
    assert fit_result_data(fitted, (), runs)['implausible'][0]['reason'] == 'nominal'
    found = diagnose(runs, config(), request=DiagnosisRequest('hybrid', options=options, equation=False, variants=False))
    data, said = as_data(found), ' '.join(as_text(found))
    assert data['verdict'] == 'none' and 'yet something is probably missing' in said and 'instead of 450' in said
    assert (
        [one['name'] for one in data['implausible']]
        == [one['name'] for one in data['implausible_nominal']]
        == ['wire.lambda']
    )
    assert not calibrate(runs, config(), replace(options, intervals=False)).implausible


@pytest.mark.slow
def test_an_effect_three_times_as_strong_as_is_realistic_is_found_and_said_to_be():
    """A plate three times as heavy as the model's: nothing realistic explains it."""
    truth = with_effect(config(), find_effects()['gravity'], {'g_y': -30.0})
    runs = dataset(truth, (1, 2, 3), 1.0, 25.0, rate=5.0, channels=('alpha', 'F_1'))
    options = FitOptions(free=('wire.lambda', 'beam.E'), kinetics='hybrid', starts=1)
    request = DiagnosisRequest('hybrid', options=options, equation=False, variants=False)
    found = diagnose(runs, config(), request=request)
    assert (found.verdict, found.effects) == ('missing_effect', ('gravity',))
    assert found.calibration.values['effects.gravity.g_y'] == pytest.approx(-30.0, rel=0.02)
    (said,) = [line for line in as_text(found) if line.startswith('Not realistic: g_y = -')]
    assert '(realistic: -9.81 to 9.81). The effect is taken since nothing realistic' in said
