"""Challenges as folders, verdicts that are marked, the command."""

import base64
import hashlib
import json
import re
import zlib
from pathlib import Path

import numpy as np
import pytest

from sma_sim import UserError, read_config
from sma_sim.challenge.answer import Answer, HiddenEffect
from sma_sim.challenge.files import open_answer, write_challenge
from sma_sim.challenge.make import RecordingPlan, make_challenge
from sma_sim.challenge.robot import NOISE_STD
from sma_sim.challenge.score import read_verdict, score_verdict, verdict_from
from sma_sim.challenge.truth import truths
from sma_sim.cli.main import main
from sma_sim.evidence.data.recording import CHANNEL_COLUMNS
from sma_sim.evidence.data.rosbag.reader import read_bag
from sma_sim.evidence.data.tables import read_columns
from sma_sim.model.config import Config

SHORT = RecordingPlan(duration=20.0, rate=10.0)
PAGE = Path(__file__).resolve().parents[2] / 'docs' / 'reference' / 'challenges.md'


@pytest.mark.parametrize('format', ['mcap', 'csv'])
def test_files_hold_what_was_made(tmp_path, format):
    challenge = make_challenge(3, kinds=['gravity', 'fan'], forces=True, plan=SHORT)
    write_challenge(challenge, tmp_path / 'case', format)
    assert sorted(file.name for file in (tmp_path / 'case').iterdir()) == [
        'answer.sealed',
        'meta.json',
        'nominal.yaml',
        *(f'run{k}.{format}' for k in (1, 2, 3)),
    ]
    names = [CHANNEL_COLUMNS[name] for name in NOISE_STD]
    for recording in challenge.dataset.recordings:
        file = tmp_path / 'case' / f'{recording.name}.{format}'
        columns = read_bag(file) if format == 'mcap' else read_columns(file, ['time_s', 'J_eq_W', 'T_E_K'], (), names)
        sampled = ~np.isnan(columns['alpha_rad'])
        assert columns['time_s'][sampled] == pytest.approx(recording.time, abs=1e-9)
        for name in NOISE_STD:
            assert (columns[CHANNEL_COLUMNS[name]][sampled] == recording.channels[name]).all()
        changes = recording.source.times[:-1]
        at = np.searchsorted(columns['time_s'], changes - 1e-9)
        assert columns['time_s'][at] == pytest.approx(changes, abs=1e-9)
        assert (columns['J_eq_W'][at] == recording.source.values[:-1, 0]).all()
    meta = json.loads((tmp_path / 'case' / 'meta.json').read_text())
    assert meta == {'noise_std': dict(NOISE_STD), 'rate_hz': 10.0, 'rest_s': 20.0}
    nominal = read_config(tmp_path / 'case' / 'nominal.yaml')
    assert nominal.parameters == pytest.approx(Config().parameters, rel=0.0, abs=0.0, nan_ok=True)
    assert open_answer(tmp_path / 'case') == challenge.answer


def test_nothing_gives_the_answer_away(tmp_path):
    write_challenge(make_challenge(3, kinds=['gravity', 'fan'], plan=SHORT), tmp_path / 'case', 'csv')
    for file in (tmp_path / 'case').iterdir():
        assert not any(word in file.read_text() for word in ('gravity', 'fan', 'truth', 'seed'))


def changed(path, change):
    outer = json.loads(path.read_text())
    path.write_text(json.dumps(change(outer)))


@pytest.mark.parametrize(
    ('damage', 'message'),
    [
        (lambda path: path.unlink(), 'is no challenge: cannot read'),
        (lambda path: path.write_text('hello'), 'is not a sealed answer'),
        (lambda path: path.write_text('[]'), 'is not a sealed answer of this version'),
        (lambda path: changed(path, lambda outer: outer | {'format': 'other'}), 'expected format'),
        (lambda path: changed(path, lambda outer: outer | {'sealed': '***'}), 'is damaged'),
        (lambda path: changed(path, lambda outer: outer | {'sealed': 'AAAA'}), 'is damaged'),
        (lambda path: changed(path, lambda outer: outer | {'sealed': 3}), 'is damaged'),
        (lambda path: changed(path, lambda outer: {k: v for k, v in outer.items() if k != 'sealed'}), 'is damaged'),
        (lambda path: changed(path, lambda outer: outer | {'sha256': 'no'}), 'was changed'),
        (lambda path: changed(path, forged), 'was changed'),
    ],
)
def test_damaged_answers_are_told(tmp_path, damage, message):
    write_challenge(make_challenge(3, 0, plan=SHORT), tmp_path / 'case', 'csv')
    damage(tmp_path / 'case' / 'answer.sealed')
    with pytest.raises(UserError, match=message):
        open_answer(tmp_path / 'case')


def forged(outer):
    text = zlib.decompress(base64.b64decode(outer['sealed'])).replace(b'"seed": 3', b'"seed": 4')
    assert hashlib.sha256(text).hexdigest() != outer['sha256']
    return outer | {'sealed': base64.b64encode(zlib.compress(text)).decode()}


# Marks


def answer(*names):
    """An answer that hides these; a name outside the library begins with truth_."""
    effects = tuple(
        HiddenEffect(name, '' if name.startswith('truth_') else name, 'wire_heat', ('T',), {}, {}) for name in names
    )
    return Answer(1, effects, {}, {})


def said(kind, *effects, nominal=5.0, final=1.05, ranking=('gravity', 'radiation', 'slack'), confounded=()):
    """What a diagnosis wrote."""
    steps = [{'effects': [], 'held_out': nominal}, *({'effects': list(effects), 'held_out': final} for _ in effects[:1])]
    first = [{'effect': name, 'confounded_with': list(confounded) if name == 'gravity' else []} for name in ranking]
    return verdict_from({'verdict': kind, 'effects': list(effects), 'ranking': first, 'error': steps})


@pytest.mark.parametrize(
    ('hidden', 'verdict', 'outcome', 'word'),
    [
        ((), said('none'), 'right', 'nothing is missing'),
        ((), said('missing_effect', 'gravity'), 'wrong', 'false alarm'),
        ((), said('unknown_effect'), 'wrong', 'false alarm'),
        (('gravity',), said('missing_effect', 'gravity'), 'right', 'gravity is missing'),
        (('gravity',), said('none'), 'wrong', 'something is missing'),
        (('gravity',), said('none', nominal=1.2), 'right', 'cannot be seen'),
        (('gravity',), said('missing_effect', 'radiation'), 'wrong', 'radiation is not what'),
        (('gravity',), said('missing_effect', 'gravity', 'slack'), 'partial', 'slack is not'),
        (('gravity',), said('unknown_effect', 'gravity'), 'partial', 'all that is missing'),
        (('gravity',), said('unknown_effect'), 'wrong', 'not named'),
        (('gravity',), said('missing_effect', 'slack', confounded=['slack']), 'right', 'inseparable'),
        (('slack',), said('missing_effect', 'gravity', confounded=['slack']), 'right', 'inseparable'),
        (('gravity', 'slack'), said('missing_effect', 'slack', 'gravity'), 'right', 'gravity and slack'),
        (('gravity', 'slack'), said('missing_effect', 'gravity', final=2.0), 'partial', 'slack is missing, not named'),
        (('gravity', 'slack'), said('missing_effect', 'gravity'), 'right', 'the rest cannot be seen (1.05'),
        (('gravity', 'slack'), said('missing_effect', 'radiation', final=2.0), 'wrong', 'is not what'),
        (('truth_fan',), said('unknown_effect'), 'right', 'no effect of the library'),
        (('truth_fan',), said('unknown_effect', 'radiation'), 'right', 'no effect of the library'),
        (('truth_fan',), said('missing_effect', 'radiation'), 'wrong', 'is not what'),
        (('truth_fan',), said('none'), 'wrong', 'something is missing'),
        (('truth_fan',), said('none', nominal=1.1), 'right', 'cannot be seen'),
        (('gravity', 'truth_fan'), said('unknown_effect', 'gravity'), 'right', 'gravity is missing'),
        (('gravity', 'truth_fan'), said('unknown_effect'), 'partial', 'not named'),
        (('gravity', 'truth_fan'), said('missing_effect', 'gravity', final=2.0), 'partial', 'truth_fan is missing as well'),
        (('gravity', 'truth_fan'), said('missing_effect', 'gravity'), 'right', 'gravity is missing'),
    ],
)
def test_score(hidden, verdict, outcome, word):
    score = score_verdict(answer(*hidden), verdict)
    assert score.outcome == outcome and word in score.why


def test_the_score_has_rank_and_errors():
    score = score_verdict(answer('radiation', 'joint_friction'), said('missing_effect', 'radiation', nominal=4.0, final=1.4))
    assert score.ranks == {'radiation': 2, 'joint_friction': None}
    assert (score.nominal_error, score.final_error, score.expected_verdict) == (4.0, 1.4, 'missing_effect')
    empty = score_verdict(answer('gravity'), verdict_from({'verdict': 'none', 'effects': []}))
    assert empty.outcome == 'wrong' and empty.nominal_error is None


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        ('hello', 'is not JSON'),
        ('[1]', '"verdict" is \'list\''),
        ('{}', '"verdict" is None, expected one of none, missing_effect, unknown_effect'),
        ('{"verdict": "maybe"}', "'maybe'"),
        ('{"verdict": "none"}', 'expected "effects"'),
        ('{"verdict": "none", "effects": "gravity"}', 'expected a list of names'),
        ('{"verdict": "none", "effects": [], "ranking": [1]}', 'expected "effects"'),
        ('{"verdict": "none", "effects": [], "ranking": [{"effect": "gravity", "confounded_with": 3}]}', 'list of names'),
        ('{"verdict": "none", "effects": [], "error": [{"effects": [], "held_out": null}]}', 'held_out'),
    ],
)
def test_wrong_verdict_files_are_told(tmp_path, text, message):
    (tmp_path / 'verdict.json').write_text(text)
    with pytest.raises(UserError, match=message):
        read_verdict(tmp_path / 'verdict.json')
    with pytest.raises(UserError, match='cannot read'):
        read_verdict(tmp_path / 'nowhere.json')


# The command


def test_command_makes_and_reveals(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = '--seed 3 --out case --kind gravity --format csv --forces --duration 40 --rate 25'
    assert main(['challenge', 'new', *words.split()]) == 0
    assert '3 recordings of 40 s to case, with the channels U_x, U_y, alpha, F_1, F_2' in capsys.readouterr().out
    assert len((tmp_path / 'case' / 'run1.csv').read_text().splitlines()) >= 1 + 40 * 25
    assert main(['challenge', 'reveal', 'case']) == 0
    told = capsys.readouterr().out
    assert re.search(r'as gravity of the library: g_x = -?[\d.]+ m/s\^2, g_y = -?[\d.]+ m/s\^2', told)
    assert 'gravity (structure_force)' in told and 'wire.E_A' in told and 'over the noise' in told
    verdict = {
        'verdict': 'missing_effect',
        'effects': ['gravity'],
        'ranking': [{'effect': 'gravity'}],
        'error': [{'effects': [], 'held_out': 6.0}, {'effects': ['gravity'], 'held_out': 1.1}],
    }
    (tmp_path / 'verdict.json').write_text(json.dumps(verdict))
    assert main(['challenge', 'reveal', 'case', 'verdict.json']) == 0
    told = capsys.readouterr().out
    assert 'missing_effect is right: gravity is missing' in told and 'gravity: rank 1' in told and 'last model: 1.1' in told
    assert main(['challenge', 'reveal', 'case', 'verdict.json', '--json']) == 0
    data = json.loads(capsys.readouterr().out)
    assert data['score']['outcome'] == 'right' and data['truth']['effects'][0]['library'] == 'gravity'
    (tmp_path / 'verdict.json').write_text(json.dumps(verdict | {'verdict': 'none', 'effects': []}))
    assert main(['challenge', 'reveal', 'case', 'verdict.json']) == 0  # a wrong verdict is no mistake of the command
    assert 'expected missing_effect' in capsys.readouterr().out


@pytest.mark.parametrize(
    ('words', 'message'),
    [
        (['new', '--seed', '1', '--out', 'there'], 'there exists already and is not overwritten'),
        (['new', '--seed', '1', '--out', 'nowhere/case'], 'there is no folder nowhere'),
        (['new', '--seed', '1', '--out', 'case', '--kind', 'gravty'], 'did you mean gravity'),
        (['new', '--seed', '1', '--out', 'case', '--runs', '1'], 'expected at least 3'),
        (['new', '--seed', '1', '--out', 'case', '--duration', '0.5'], 'at least 1 s'),
        (['new', '--seed', '1', '--out', 'case', '--rate', 'nan'], 'samples/s'),
        (['reveal', 'there'], 'there is no challenge'),
        (['reveal', 'nowhere'], 'nowhere is no challenge'),
    ],
)
def test_wrong_use_of_the_command(tmp_path, capsys, monkeypatch, words, message):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'there').mkdir()
    (tmp_path / 'there' / 'mine.txt').write_text('kept')
    assert main(['challenge', *words]) == 2
    assert message in capsys.readouterr().err
    assert [file.name for file in tmp_path.iterdir()] == ['there'] and (tmp_path / 'there' / 'mine.txt').exists()


def test_what_is_outside_the_library_is_in_the_documentation():
    outside = [name.removeprefix('truth_') for name, truth in truths().items() if not truth.library]
    assert [name for name in outside if f'| `{name}` | {truths()[f"truth_{name}"].port} |' not in PAGE.read_text()] == []
