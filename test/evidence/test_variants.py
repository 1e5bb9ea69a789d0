"""Variants of effects: which there are, and that one is found and named."""

import math
from threading import Event
from types import SimpleNamespace

import numpy as np
import pytest
from simulated_data import config, dataset

from sma_sim import Effect, Parameter, find_effects
from sma_sim.evidence.diagnosis.diagnose import diagnose
from sma_sim.evidence.estimation.calibrate import FitOptions
from sma_sim.evidence.estimation.executors import executor_or_threads
from sma_sim.evidence.estimation.prepared_fit import prepare
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.model_selection.candidates import candidates_for, with_effect
from sma_sim.evidence.model_selection.nominal_fit import DiagnosisRequest, nominal_fits
from sma_sim.evidence.model_selection.variants import scopes_of, variants_of
from sma_sim.evidence.search import confounding
from sma_sim.evidence.search.beam import search
from sma_sim.evidence.search.refine import WINDOW
from sma_sim.model.config import Config, read_config
from sma_sim.model.effects.discovery import with_scopes
from sma_sim.model.parameter_file import parameter_file
from sma_sim.words.diagnosis_data import as_data
from sma_sim.words.diagnosis_text import as_text


@pytest.mark.parametrize(
    ('name', 'scopes'),
    [
        ('beam_creep', ['stretch', 'deflection', 'rotation']),
        ('beam_nonlinearity', ['deflection', 'rotation']),  # a beam that is only stretched is linear
        ('joint_friction', []),  # acts in rotation only
        ('gravity', []),  # has a parameter for each coordinate
        ('ambient_heating', ['wire_1', 'wire_2', 'shared']),
        ('functional_fatigue', ['wire_1', 'wire_2']),
        ('power_gain_mismatch', []),  # tells the wires apart by itself
        ('sensor_gain', []),  # has a parameter for each channel
        ('sensor_lag', ['U_x', 'U_y', 'alpha', 'stress']),
    ],
)
def test_variants_are_what_an_effect_is_not_by_itself(name, scopes):
    assert [scope.name for scope in scopes_of(find_effects()[name])] == scopes


def test_sensors_that_were_not_measured_have_no_variants():
    names = {candidate.name for candidate in variants_of(candidates_for(Config()), ('alpha',))}
    assert 'sensor_lag@alpha' in names and 'sensor_lag@U_y' not in names
    assert 'natural_convection@wire_1' in names and len(names) > 30


def test_an_effect_that_is_there_in_a_scope_is_no_candidate():
    names = {candidate.name for candidate in candidates_for(read_config(effects=['beam_creep@rotation']))}
    assert 'beam_creep' not in names and 'gravity' in names


@pytest.mark.slow
def test_an_effect_in_one_wire_is_found(tmp_path):
    name = 'driver_deadband@wire_2'
    found = with_scopes(find_effects(), [name])[name]
    runs = dataset(with_effect(config(), found, {'J_d': 0.15}), [1, 2, 3], noise=1.0, rate=5.0, channels=('alpha', 'U_y'))
    options = FitOptions(free=('beam.E', 'wire.lambda'), starts=1, intervals=False)
    result = diagnose(runs, config(), request=DiagnosisRequest('hybrid', options=options, equation=False))
    data = as_data(result)
    assert data['verdict'] == 'missing_effect' and data['effects'] == ['driver_deadband']
    assert data['variants'] == {'driver_deadband': 'in wire 2 only'}
    assert data['error'][-1]['held_out'] < 1.1 and result.search_ended
    assert any('a deadband of the driver, in wire 2 only' in line for line in as_text(result))
    file = tmp_path / 'robot.yaml'
    file.write_text(parameter_file(result.calibration.config))
    assert read_config(file).effects[0].effect.name == name


def test_the_listed_effect_with_the_most_similar_signature(monkeypatch):
    responses = {'base': [1.0, 1.0], 'formula': [3.0, 2.0], 'gravity': [2.0, 1.5], 'radiation': [1.0, 2.0], 'slack': [1.0]}
    monkeypatch.setattr(confounding, 'response', lambda fit, pool: np.array(responses[fit]))
    fits = [SimpleNamespace(effect=find_effects()[name], fit=name) for name in ('radiation', 'gravity', 'slack')]
    first = SimpleNamespace(base='base', candidate_fits=fits)
    similar = confounding.most_similar('formula', first, None)
    assert similar.effect.name == 'gravity' and similar.cosine == pytest.approx(1.0)
    assert confounding.most_similar('formula', SimpleNamespace(base='base', candidate_fits=[]), None) is None


def test_friction_that_builds_up_in_another_way_is_the_listed_one_in_another_form():
    """Of friction mu F v/sqrt(v^2 + v_s^2), the same in both directions, the listed law, F (exp(mu tanh(v/v_s)) - 1), leaves
    more than noise does; as another function of the speed it leaves nothing."""
    hidden = Effect(
        'rubbing', 'wire_force', '', '', (Parameter('mu', 0.15, '-', (0.0, 1.0), ''),),
        lambda s, w, p: s.F * p.mu * s.v / math.sqrt(s.v**2 + 4e-10),
    )  # fmt: skip
    truth = hidden
    runs = dataset(with_effect(config(), truth, {'mu': 0.15}), [1, 2], noise=1.0, rate=5.0, channels=('alpha', 'U_y'))
    options = FitOptions(free=('beam.E', 'wire.lambda'), starts=1, intervals=False)
    with executor_or_threads(None) as pool:
        context = SearchContext(pool, Event())
        nominal = nominal_fits(prepare(runs, config(), 'hybrid'), options, context)
        book = search(nominal, context, equations=False, most=1)
    listed = book.find(frozenset({'guide_friction'}))
    assert book.best.names == {'guide_friction@form_v'} and book.best.leaves_nothing
    assert listed.score(1.0) < book.best.score(1.0) - WINDOW
