"""What a diagnosis says to people: every verdict in a sentence, without the codes that programs read."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

from sma_sim import Config
from sma_sim.evidence.diagnosis.conclusion import HeldOutVerdict, PooledErrors
from sma_sim.evidence.diagnosis.diagnose import Diagnosis
from sma_sim.evidence.estimation.plausibility import ImplausibleParameter
from sma_sim.evidence.estimation.uncertainty import AmbientDifference, Interval
from sma_sim.model.effects.discovery import find_effects
from sma_sim.words.diagnosis_text import as_text, firmness_lines, headline, remarks, short_title
from sma_sim.words.proposed_equation import error_words
from sma_sim.workflow.diagnosis import confounded

EFFECTS = find_effects()
VALUES = {'gravity.g_y': (-9.8, -9.9, -9.7), 'gravity.g_x': (0.4, -1.0, 2.0), 'radiation.emissivity': (0.3, 0.2, 0.4)}


KNOWN = {f'effects.{name}': numbers for name, numbers in VALUES.items()}


def interval(name, value, low, high):
    fields = dict.fromkeys(Interval.__dataclass_fields__, None)
    known = {'name': name, 'value': value, 'low': low, 'high': high, 'std': 0.25 * (high - low), 'unit': '', 'seen': True}
    return Interval(**fields | known)


CALIBRATION = SimpleNamespace(
    config=SimpleNamespace(effects=(), system='module'),
    runs=(),
    values={name: numbers[0] for name, numbers in KNOWN.items()},
    implausible=(),
    unusual=(),
    improbable_offsets=(),
    by_run=(),
    error=1.0,
    limits=(),
    other_starts=(),
    uncertainty=SimpleNamespace(intervals=[interval(name, *numbers) for name, numbers in KNOWN.items()], delay=None),
)


POSTERIOR = SimpleNamespace(models=(), weights=(), none=0.0, unlisted=0.0, effects={}, other=0.0)


def candidate(name, *rivals):
    return SimpleNamespace(name=name, effect=EFFECTS[name], indistinguishable=rivals, plausible=True)


def stage(effects, held_out, kind='added'):
    errors = {'train': held_out, 'held_out': held_out, 'channel_errors': {}, 'held_out_channel_errors': {'alpha': held_out}}
    return SimpleNamespace(
        kind=kind, effects=tuple(effects), kinetics='mas', calibration=CALIBRATION, differences=(), **errors
    )


def diagnosis(verdict, *candidates, errors=(10.0, 1.0), stopped=False, **changes):
    """What the texts read of a diagnosis in which these candidates were accepted one after the other."""
    names = [one.name for one in candidates]
    rivals = [candidate(name) for one in candidates for name in one.indistinguishable]
    steps = [SimpleNamespace(accepted=one, candidate_fits=(one, *rivals)) for one in candidates]
    steps.append(SimpleNamespace(accepted=None, candidate_fits=()))
    given = {
        'verdict': verdict,
        'effects': tuple(names),
        'selection_steps': tuple(steps),
        'posterior': POSTERIOR,
        'stages': tuple(stage(names[:k], error, 'added' if k else 'nominal') for k, error in enumerate(errors)),
        'held_out_ratio': {},
        'confounding': {},
        'training': ('run1', 'run2'),
        'held_out': ('run3',),
        'noise_std': {},
        'interrupted': stopped,
        'search_ended': not stopped,
        'seconds': 1.0,
    }
    return Diagnosis(**given | changes)


def test_one_missing_effect_is_said_with_its_value_share_and_rivals():
    said = headline(diagnosis('missing_effect', candidate('gravity')))
    assert said == (
        'Your model lacks gravity: g_y = -9.8 m/s^2 (-9.9 to -9.7); it explains 99 % of the squared error in the held-out '
        'runs.'
    )
    said = headline(diagnosis('missing_effect', candidate('gravity', 'sensor_bias', 'beam_creep')))
    assert said.endswith(
        'these data do not distinguish it from a constant offset of the sensors (sensor_bias) or creep of the beam '
        '(beam_creep).'
    )


def test_several_missing_effects_are_said_together():
    found = diagnosis('missing_effect', candidate('gravity'), candidate('radiation', 'natural_convection'), errors=(5, 3, 1))
    assert headline(found) == (
        'Your model lacks gravity and heat lost by radiation; together they explain 96 % of the squared error in the '
        'held-out runs.'
    )
    rivals = 'these data do not distinguish it from heat lost by natural convection (natural_convection)'
    lines = list(remarks(found))
    assert f'For heat lost by radiation, {rivals}.' in lines
    values = [line.split(' = ')[0] for line in lines if ' = ' in line]
    assert values == ['gravity.g_y', 'gravity.g_x', 'radiation.emissivity']
    assert short_title(found) == 'gravity and heat lost by radiation'


def test_what_explains_as_well_and_was_less_probable_before_is_said_so():
    known = SimpleNamespace(**vars(POSTERIOR) | {'effects': {'gravity': 0.6, 'sensor_bias': 0.4}})
    found = diagnosis('missing_effect', candidate('gravity', 'sensor_bias', 'beam_creep'), posterior=known)
    assert 'they speak no less for beam_creep, less probable only by its prior' in headline(found)
    both = SimpleNamespace(**vars(POSTERIOR) | {'effects': {'gravity': 0.6, 'sensor_bias': 0.4, 'beam_creep': 0.1}})
    assert 'by its prior' not in headline(replace(found, posterior=both))


def test_nothing_missing():
    found = diagnosis('none', errors=(1.0,))
    assert headline(found) == 'These data show no sign of a missing effect.' and list(remarks(found)) == []
    assert short_title(found) == 'nothing is missing'


def test_nothing_missing_but_implausible_parameters():
    bent = ImplausibleParameter('wire.lambda', 751.0, 450.0, 302.0, 671.0, 'W/(m^2 K)', 'nominal')
    last = stage((), 1.0, 'nominal')
    last.calibration = SimpleNamespace(**vars(CALIBRATION) | {'implausible': (bent,)})
    found = diagnosis('none', stages=(last,), implausible=(bent,))
    assert headline(found) == 'No known effect explains more, and yet something is probably missing.'
    assert short_title(found) == 'nothing found, but implausible parameters'
    assert any('wire.lambda 751 instead of 450 W/(m^2 K)' in line and 'probably missing' in line for line in remarks(found))


def test_what_the_nominal_fit_bent_is_evidence_for_what_was_found():
    bent = ImplausibleParameter('wire.E_M', 2e10, 7.8e9, 0.0, 1e10, 'Pa', 'order')
    said = list(remarks(diagnosis('missing_effect', candidate('gravity'), implausible=(bent,))))
    assert any('wire.E_M 2e+10 Pa above wire.E_A 1e+10 Pa' in line and 'without further effects' in line for line in said)


def test_an_effect_that_the_model_had_is_not_said_to_be_missing():
    found = diagnosis('missing_effect', effects=('gravity',), stages=(stage(['gravity'], 1.0, 'nominal'),))
    assert headline(found) == 'These data show no sign of a missing effect.'


def test_an_unknown_effect_with_and_without_an_equation(monkeypatch):
    found = diagnosis('unknown_effect', candidate('gravity'), errors=(10.0, 5.0))
    assert headline(found) == (
        'Something is missing that no known effect explains. Only a part is explained: gravity explains 75 % of the squared '
        'error in the held-out runs.'
    )
    assert headline(diagnosis('unknown_effect', errors=(5.0,))) == 'Something is missing that no known effect explains.'
    assert any(line.startswith('With known effects, the normalized RMSE of alpha is 5.0') for line in remarks(found))
    k = SimpleNamespace(name='k', neutral=0.0, unit='N m', description='')
    formula = SimpleNamespace(equation='F_alpha = k alpha^3', parameters=(k,))
    proposal = SimpleNamespace(formula=formula, effect='alpha_cubed', std={'effects.alpha_cubed.k': 0.1})
    monkeypatch.setitem(CALIBRATION.values, 'effects.alpha_cubed.k', 2.0)
    stages = (stage((), 10.0, 'nominal'), stage((), 10.0, 'retracted'), stage((), 1.0, 'formula'))
    said = headline(replace(found, proposal=proposal, effects=(), stages=stages))
    assert 'An equation describes it: F_alpha = k alpha^3; it explains 99 % of the squared error' in said
    vague = SimpleNamespace(**vars(proposal) | {'std': {'effects.alpha_cubed.k': 1.1}})
    leaves_more = (*stages[:2], stage((), 1.5, 'formula'))
    for changes in ({'proposal': vague, 'stages': stages}, {'proposal': proposal, 'stages': leaves_more}):
        said = headline(replace(found, effects=(), **changes))
        assert 'describes' not in said and 'comes nearest, and is not what is missing: F_alpha = k alpha^3' in said


def test_an_effect_that_is_taken_with_unrealistic_values_is_said_to_be():
    name, low, high = 'effects.radiation.emissivity', 0.0, 1.1
    beyond = ImplausibleParameter(name, 3.0, 0.0, low, high, '-', 'realistic')
    other = ImplausibleParameter('wire.c_V', 140.0, 380.0, 250.0, 570.0, 'J/(kg K)', 'nominal')
    taken = candidate('radiation')
    taken.plausible = False
    for implausible in ((beyond,), (beyond, other)):
        changed = SimpleNamespace(
            **vars(CALIBRATION) | {'implausible': implausible, 'values': CALIBRATION.values | {name: 3.0}}
        )
        found = diagnosis('missing_effect', taken, errors=(5.0, 1.0))
        found.stages[-1].calibration = changed
        said = list(remarks(found))
        (line,) = [line for line in said if line.startswith('Not realistic: emissivity = 3 (realistic: ')]
        assert line.endswith('make sure that your robot can have it.')
        assert any(line.startswith('Outside the plausible range: wire.c_V') for line in said) == (other in implausible)
        assert not any('effects.radiation' in line for line in said)
    taken.plausible = True
    assert any(line.startswith('Outside the plausible range: effects.radiation') for line in remarks(found))


TRIED = SimpleNamespace(accepted=None, candidate_fits=(candidate('gravity'),))


@pytest.mark.parametrize(
    ('candidates', 'steps', 'expected'),
    [
        ((), {}, 'Stopped before the search was complete. No effect has been tried.'),
        (
            (),
            {'selection_steps': (TRIED,)},
            'Stopped before the search was complete. Nothing was found to be missing so far.',
        ),
        (
            (candidate('gravity'),),
            {},
            'Stopped before the search was complete. Your model lacks gravity; more may be missing.',
        ),
    ],
)
def test_a_search_that_was_stopped_says_what_it_found(candidates, steps, expected):
    assert headline(diagnosis('unknown_effect', *candidates, stopped=True, **steps)) == expected


def test_effects_that_held_out_runs_contradict_are_named():
    found = diagnosis('missing_effect', candidate('gravity'), candidate('radiation'), errors=(5.0, 2.0, 1.0))
    stages = (*found.stages[:2], stage(['gravity'], 1.0, 'retracted'))
    removed = replace(found, verdict='unknown_effect', effects=('gravity',), retracted=('radiation',), stages=stages)
    said = ' '.join(remarks(removed))
    assert 'Retracted: heat lost by radiation.' in said and '2.00 with, 1.00 without' in said


def test_a_law_in_another_form_is_the_same_verdict():
    listed = diagnosis('missing_effect', candidate('guide_friction'))
    for effects, words in ((('guide_friction@form_v',), 'is the same'), (('guide_friction@wire_1',), 'depends on')):
        without = HeldOutVerdict('missing_effect', effects, 1.0)
        said = ' '.join(firmness_lines(replace(listed, by_held_out_run={'run1': without})))
        assert words in said


def test_runs_that_one_model_explains_together():
    found = diagnosis('none', errors=(3.0,), pooled_errors=PooledErrors(1.01, 1.04))
    assert any('normalized RMSE 1.04 held out, 1.01 others' in line for line in remarks(found))
    assert 'ambient' not in ' '.join(remarks(found))
    above = {'run1': AmbientDifference(0.0, 0.0, 0.0), 'run2': AmbientDifference(-1.28, -1.5, -1.06)}
    warmer = replace(found, pooled_errors=PooledErrors(1.01, 1.04, {'run1': 0.02, 'run2': -1.26}, above))
    assert 'temperatures differ, from that of run1 by run2 -1.28 (-1.5 to -1.1) [K]' in ' '.join(remarks(warmer))
    predicted = replace(warmer, pooled_errors=replace(warmer.pooled_errors, in_own_rooms=(1.46, 1.2, 1.07)))
    assert 'held-out runs have 1.46 without effects, 1.07 with' in ' '.join(remarks(predicted))


def test_effects_that_explain_all_runs_together_and_predict_worse_are_left_open():
    found = diagnosis('unknown_effect', candidate('gravity'), errors=(3.0, 5.0), pooled_errors=PooledErrors(1.01, 1.04))
    assert headline(found).startswith('These data do not tell whether your model lacks gravity')
    said = ' '.join(remarks(found))
    assert 'normalized RMSE 1.04 held out, 1.01 others' in said and 'known effects' not in said
    contradicted = replace(found, pooled_errors=PooledErrors(1.5, 1.6))
    assert headline(contradicted).startswith('Something is missing that no known effect explains')


@pytest.mark.parametrize(
    ('changes', 'expected'),
    [
        ({'training': ('run1',)}, 'Only one run was fitted'),
        ({'held_out': ()}, 'No run was held out'),
        ({'interrupted': True}, 'Stopped during the last fit'),
    ],
)
def test_what_weakens_a_verdict_is_said(changes, expected):
    assert any(line.startswith(expected) for line in remarks(diagnosis('none', errors=(1.0,), **changes)))


def test_people_are_not_shown_codes():
    found = [
        diagnosis('none', errors=(1.0,)),
        diagnosis('missing_effect', candidate('gravity')),
        diagnosis('unknown_effect', candidate('gravity')),
        diagnosis('unknown_effect', stopped=True),
    ]
    for one in found:
        text = '\n'.join(as_text(one))
        assert '_effect' not in text and text.splitlines()[0].endswith('.')


def test_every_effect_of_the_library_completes_the_sentence():
    """`Your model lacks ...`: no name of the code, no full stop, not as long as a description."""
    titles = {name: effect.title for name, effect in EFFECTS.items()}
    assert {n: t for n, t in titles.items() if not t or '_' in t or t.endswith('.') or len(t) >= 60} == {}
    assert replace(EFFECTS['driver_lag'], title='').phrase == 'driver lag'


def test_an_effect_beside_a_model_that_follows_nothing_may_make_up_for_its_values():
    still = SimpleNamespace(
        **vars(CALIBRATION)
        | {
            'error': 90.0,
            'unfollowed': ('alpha',),
            'channel_errors': {'alpha': 90.0},
            'errors_of_constants': {'alpha': 91.0},
        }
    )
    found = diagnosis('missing_effect', candidate('gravity'), errors=(90.0, 1.0))
    assert not any('hardly follows' in line for line in remarks(found))
    found.stages[0].calibration = still
    (line,) = [line for line in remarks(found) if line.startswith('Without effects: The model hardly follows')]
    assert 'alpha 90 times the noise (a constant: 91)' in line and line.endswith('What was found may only make up for them.')


def test_a_share_that_an_effect_does_not_explain_is_not_said():
    worse = diagnosis('missing_effect', candidate('gravity'), errors=(2.0, 3.0))
    bare, last = worse.stages
    last.train = 1.0
    assert 'it explains 75 % of the squared error in the fitted runs, nothing in the held-out runs' in headline(worse)


@pytest.mark.parametrize(('last', 'verb'), [(1.0, 'falls from 2.00 to 1.00'), (3.0, 'rises from 2.00 to 3.00')])
def test_an_error_that_rises_is_said_to_rise(last, verb):
    assert f'of the held-out runs {verb} times the noise' in error_words(stage((), 2.0), stage(('f',), last))


def test_a_printed_command_names_effects_only():
    """Beside effects a model may have what stands for an equation, which no command knows."""
    accepted = SimpleNamespace(name='radiation', indistinguishable=('natural_convection',))
    step = SimpleNamespace(
        accepted=accepted, base=SimpleNamespace(effects=('creep', 'any_actuation', 'joint_friction@form_dq'))
    )
    nominal = SimpleNamespace(base=SimpleNamespace(effects=('creep',)))
    found = SimpleNamespace(
        calibration=SimpleNamespace(config=Config()),
        selection_steps=(nominal,),
        deciding_steps=(step,),
        effects=('joint_friction', 'radiation'),
    )
    beside = 'joint_friction@form_dq'
    assert confounded(found) == (f'{beside}+radiation', f'{beside}+natural_convection')
