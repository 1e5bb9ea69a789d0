"""Parameters that a fit moved out of their plausible range: found where data insist on them, and only there."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from simulated_data import config, dataset, scaled

from sma_sim import Config, FitOptions, calibrate, find_effects
from sma_sim.evidence.diagnosis.diagnose import diagnose
from sma_sim.evidence.estimation.free_parameters import choose_free
from sma_sim.evidence.estimation.plausibility import implausible_of, implausible_parameters, improbable_offsets, unusual_of
from sma_sim.evidence.model_selection.candidates import with_effect
from sma_sim.evidence.model_selection.nominal_fit import DiagnosisRequest
from sma_sim.words.diagnosis_data import as_data
from sma_sim.words.diagnosis_text import as_text
from sma_sim.words.fit_data import fit_result_data
from sma_sim.words.fit_remarks import beyond_sentences, remarks_on

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


def single_wire_fit(values, std, kept=None):
    """A fit of a single wire that ended at these values (SI), all known to `std` in the coordinate of the fit."""
    base = Config(system='wire_at_T')
    free, _ = choose_free(base, [*values])
    z = np.array([one.coordinate(values[one.name]) for one in free])
    fitted = base.variant({one.name: one.value(float(x)) for one, x in zip(free, z, strict=True)})
    intervals = [SimpleNamespace(std=std * one.scale, seen=kept != one.name) for one in free]
    known = SimpleNamespace(intervals=intervals, correlation=np.eye(len(free)))
    return SimpleNamespace(config=fitted, z=z, problem=SimpleNamespace(free=free, material='superelastic')), known


@pytest.mark.parametrize('kept', ['wire.eps_T', None])
def test_unusual_values_that_data_hardly_determine_are_said_and_no_sign_of_what_is_missing(kept):
    """Of an interval that holds usual values too, and of one that the data do not see; usual ones are not named."""
    fit, known = single_wire_fit({'wire.E_A': 5e10, 'wire.eps_T': 0.3, 'wire.sigma_T': 2.6e7}, 4.0, kept)
    assert not implausible_of(fit, known)
    assert [one.name for one in unusual_of(fit, known)] == ['wire.eps_T', 'wire.sigma_T']
    assert 'wire.eps_T 0.3 (superelastic NiTi: 0.02 to ' in unusual_of(fit, known)[0].text
    assert not unusual_of(fit, None)


def test_an_unusual_value_that_data_determine_is_implausible_alone():
    fit, known = single_wire_fit({'wire.E_A': 5e10, 'wire.eps_T': 0.3}, 1e-3)
    assert [one.name for one in implausible_of(fit, known)] == ['wire.eps_T'] and not unusual_of(fit, known)


def test_offsets_of_recordings_far_from_what_was_stated_are_said():
    """A room that is five standard deviations from what was said of it; others within three are not named."""
    run = SimpleNamespace(channels=('stress', 'T'), zero_std=(1e6, 0.0), drift_std=(0.0, 0.0))
    near = SimpleNamespace(name='near', ambient=-8.0, ambient_std=3.0, zeros={'stress': 2e6}, drifts={})
    far = SimpleNamespace(name='far', ambient=15.0, ambient_std=3.0, zeros={'stress': -3.5e6}, drifts={})
    rest = SimpleNamespace(name='rest', ambient=0.0, ambient_std=0.0, zeros={}, drifts={})
    plain = SimpleNamespace(channels=('stress', 'T'), zero_std=(), drift_std=())
    found = improbable_offsets((run, run, plain), (near, far, rest))
    assert [one.text for one in found] == [
        'ambient temperature (known to 3 K): far +15',
        'zero of stress (known to 1e+06): far -3.5e+06',
    ]
    (unusual, offsets) = beyond_sentences(SimpleNamespace(unusual=found[:1], improbable_offsets=found))
    assert 'Do not use these values' in unusual and 'known to 3 K): far +15; zero of stress' in offsets
    assert not beyond_sentences(SimpleNamespace(unusual=(), improbable_offsets=()))


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
