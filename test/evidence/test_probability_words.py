"""How probable the models of a diagnosis are, in words: on the terminal's lines, in the report, on the page of `explore`."""

import json
import math

import pytest
from explore_server import serving, until
from explore_steps import gravity_case, opened

from sma_sim.explore.jobs import new_job
from sma_sim.model.effects.discovery import effects_on, package_effects
from sma_sim.model.effects.meaning import acts_on
from sma_sim.model.structures.discovery import package_structures
from sma_sim.report.html.diagnosis_page import probability_blocks
from sma_sim.report.html.page import Section, write_page
from sma_sim.words.probabilities import (
    effect_words,
    finding_rows,
    model_rows,
    probability_lines,
    probability_words,
)
from sma_sim.workflow.data_request import DataRequest

CLEAR = {
    'probabilities': {'none': 1e-12, 'unlisted': 0.002, 'effects': {'sensor_bias@U_y': 2.5e-5, 'gravity': 0.9999}},
    'models': [
        {'effects': ['gravity'], 'formula': None, 'probability': 0.9999, 'error': 1.008},
        {'effects': ['sensor_bias@U_y'], 'formula': None, 'probability': 2.5e-5, 'error': 1.21},
    ],
}
TIED = {
    'probabilities': {'none': 0.0, 'unlisted': 0.4, 'effects': {'driver_lag': 0.6}},
    'models': [
        {'effects': ['driver_lag'], 'formula': None, 'probability': 0.6, 'error': 1.0},
        {'effects': [], 'formula': 'a*dT', 'probability': 0.4, 'error': 1.0},
    ],
}


@pytest.mark.parametrize(
    ('p', 'words'),
    [
        (1.0, 'more than 99.9 %'),
        (0.99901, 'more than 99.9 %'),
        (0.9951, '99.5 %'),
        (0.87, '87 %'),
        (0.5, '50 %'),
        (0.034, '3 %'),
        (0.0099, '1 in 100'),
        (0.0042, '1 in 240'),
        (2.5e-5, '1 in 40,000'),
        (3.07e-8, '1 in 33,000,000'),
        (1e-12, 'less than 1 in 1,000,000,000'),
        (0.0, 'less than 1 in 1,000,000,000'),
    ],
)
def test_probabilities_as_people_say_them(p, words):
    assert probability_words(p) == words


def test_words_never_say_more_than_the_number():
    """From 0 to 1 the words are in order, and their numbers are those that they stand for."""
    last = 0.0
    for k in range(-200, 1):
        p = math.exp(k / 10.0)
        words = probability_words(p)
        if words.startswith('1 in'):
            shown = 1.0 / float(words.removeprefix('1 in ').replace(',', ''))
            assert shown == pytest.approx(p, rel=0.06)
        elif words.endswith('%') and 'more' not in words:
            shown = float(words.removesuffix(' %')) / 100.0
            assert shown == pytest.approx(p, abs=0.0051) and 0.0 < shown < 1.0
        else:
            continue
        assert shown >= last
        last = shown


def test_effects_are_called_by_their_phrases():
    assert effect_words('gravity') == 'gravity'
    assert effect_words('sensor_bias@U_y') == 'a constant offset of the sensors, in U_y only'
    assert effect_words('natural_convection@wire_2') == 'heat lost by natural convection, in wire 2 only'
    assert effect_words('ambient_heating@shared') == 'warming of the air around the wires, shared by the wires'
    assert effect_words('my_own_effect') == 'my own effect' == effect_words('my_own_effect', 'wire')
    assert effect_words('gravity', 'my_own_robot') == 'gravity'


def test_no_bundles_are_spoken_of_where_there_is_a_single_wire():
    singles = [one for one in package_structures().values() if one.wires == 1]
    assert len(singles) > 5
    for structure in singles:
        for name, effect in effects_on(package_effects(), (), structure).items():
            if acts_on(effect, structure):
                assert 'bundles' not in effect.phrase == effect_words(name, structure.name)
    said = {'models': [{'effects': ['pretension_mismatch'], 'formula': None, 'probability': 1.0, 'error': 1.0}]}
    assert 'a length of the wire that is not as given' in probability_lines({'system': 'wire', **said})[0]
    assert 'unequal pre-tension of the bundles' in probability_lines({'system': 'module', **said})[0]


def test_sentences_name_the_best_the_second_and_ties():
    assert probability_lines(CLEAR) == [
        'Most probable: gravity, more than 99.9 %. Second: a constant offset of the sensors, in U_y only, 1 in 40,000.'
    ]
    assert probability_lines(TIED) == [
        'Most probable: a lag of the driver, 60 %. Second: the equation a*dT, 40 %.',
        'These data do not decide between a lag of the driver and the equation a*dT.',
    ]
    assert [row.words for row in finding_rows(CLEAR)] == [
        'gravity',
        'a constant offset of the sensors, in U_y only',
        'nothing missing',
        'something that is not listed',
    ]
    assert [row.probability for row in finding_rows(CLEAR)][2:] == ['less than 1 in 1,000,000,000', '1 in 500']
    pair = {'effects': ['gravity', 'driver_lag'], 'formula': None, 'differences': ['the zero of alpha'], 'probability': 1.0}
    (row,) = model_rows({'models': [{**pair, 'error': 1.0}]})
    assert row.words == 'gravity + a lag of the driver + recordings that differ in the zero of alpha'
    wire = {'models': [{**pair, 'error': 7.3}], 'probabilities': {'none': 0.0, 'unlisted': 1.0, 'effects': {}}}
    assert probability_lines(wire)[1].startswith('Beside these, something that is not listed is left: more than 99.9 %. The')
    nothing = {'models': [{'effects': [], 'formula': None, 'probability': 0.97, 'error': 1.0}]}
    assert probability_lines(nothing) == ['Most probable: nothing missing, 97 %.'] and finding_rows(nothing) == []
    words = probability_lines({**CLEAR, 'retracted': ['gravity']})[0]
    assert words.startswith('By the fitted recordings alone, which do not tell those held out: gravity, more than')
    unlisted = {**nothing, 'probabilities': wire['probabilities']}
    assert probability_lines(unlisted)[0] == 'Most probable: no effect of the list, 97 %.'
    assert probability_lines({**nothing, 'verdict': 'unknown_effect'}) == ['Most probable: no effect of the list, 97 %.']


def test_a_diagnosis_without_probabilities_says_nothing_of_them():
    for found in ({}, {'models': [], 'probabilities': None}):
        assert probability_lines(found) == [] == model_rows(found) and finding_rows(found) == []
        assert probability_blocks(found) == []


def test_the_report_has_them(tmp_path):
    write_page(tmp_path / 'why.html', 'Diagnosis', [Section('What is missing', probability_blocks(CLEAR))])
    text = (tmp_path / 'why.html').read_text()
    for words in ('gravity, more than 99.9 %', '1 in 40,000', '1.008', 'something that is not listed'):
        assert words in text, words


def diagnosed(server, **more):
    """A diagnosis that has ended with gravity, and with `more` in its result."""
    engine = server.application.data.engine
    for stage in ('check', 'compare', 'diagnose'):
        job = new_job(engine.session.folder, stage, 1, {}, engine.data())
        (job.folder / 'state.json').write_text(json.dumps({'state': 'done', 'words': 'done', 'seconds': 83.0}))
        (job.folder / 'result.json').write_text('{"runs": [], "noise_std": {}, "notes": [], "comparisons": []}')
    interval = {'value': -9.7, 'low': -9.9, 'high': -9.5, 'unit': 'm/s^2', 'seen': True}
    found = {
        'verdict': 'missing_effect',
        'model': 'mas',
        'effects': ['gravity'],
        'ranking': [],
        'error': [{'effects': ['gravity'], 'train': 1.0, 'held_out': 1.01}],
        'intervals': {'effects.gravity.g_y': interval, 'wire.lambda': {**interval, 'value': 451.0, 'unit': 'W/(m^2 K)'}},
    }
    (job.folder / 'result.json').write_text(json.dumps(found | more))
    (job.folder / 'summary.txt').write_text('Your model lacks gravity.\nmore\n')


@pytest.mark.parametrize('more', [CLEAR, {}])
def test_the_page_has_the_verdict_with_probabilities_values_and_time(browser, tmp_path, tmp_path_factory, more):
    data = DataRequest((gravity_case(tmp_path_factory),))
    with serving(tmp_path / 'session', words=('model=mas',), data=data) as server:
        diagnosed(server, **more)
        opened(browser, server)
        browser.execute_script('smaExplore.stages.choose("diagnose")')
        until(browser, 'return document.querySelector("#detail .verdict") !== null')
        text = browser.find_element('id', 'detail').text
        assert 'Your model lacks gravity.' in text and 'done in 1 min 23 s' in text
        assert '−9.9 to −9.5 m/s^2' in text.replace('\n', ' ') and 'effects.gravity.g_y −9.7' in text
        assert 'wire.lambda' not in text  # behind what was found
        browser.execute_script('for (const one of document.querySelectorAll("#detail details")) one.open = true')
        assert 'wire.lambda' in browser.find_element('id', 'detail').text
        shown = browser.execute_script('return document.getElementById("probabilities")?.textContent ?? ""')
        assert ('gravity, more than 99.9 %' in shown and '1 in 500' in shown) if more else shown == ''
