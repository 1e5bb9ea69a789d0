"""The steps of a session: their order, the numbers of the commands, processes that are stopped, killed, found again."""

import ast
import builtins
import json
import runpy
import shlex
import signal
import subprocess
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from corrupted import TEXT, with_cell
from explore_steps import PATIENCE
from measured_runs import truth, write_module_runs

from sma_sim import UserError
from sma_sim.cli.main import main
from sma_sim.evidence.estimation.executors import executor_or_threads
from sma_sim.evidence.residual_analysis.compare import compare
from sma_sim.evidence.residual_analysis.metrics import channel_scores
from sma_sim.explore import worker
from sma_sim.explore.export import STEP_LINES, diagnosis_lines, export, python_text
from sma_sim.explore.jobs import Job, jobs_in, new_job
from sma_sim.explore.session import Start, open_session
from sma_sim.explore.stages import Engine
from sma_sim.explore.worker import outcome
from sma_sim.model.config import flat_parameters, read_config
from sma_sim.model.effects.discovery import package_effects
from sma_sim.workflow.candidates import candidate_effects
from sma_sim.workflow.data_request import DataRequest

FIT = {'free': ['beam.E'], 'model': 'mas', 'starts': 1}


@pytest.fixture(scope='module')
def case(tmp_path_factory):
    """A robot with the paper's values that lacks gravity: three short runs."""
    return write_module_runs(tmp_path_factory.mktemp('case'), truth(model='mas', effects=['gravity']), seconds=12.0)


@pytest.fixture(scope='module')
def engine(case, tmp_path_factory):
    """A session that has been checked, compared and calibrated."""
    start = Start(words=('model=mas',), data=DataRequest((case,), hold_out=('run3',)))
    with open_session(tmp_path_factory.mktemp('session') / 's', start) as session:
        engine = Engine(session)
        for stage, options in (('check', {}), ('compare', {}), ('calibrate', FIT)):
            assert engine.wait(engine.start(stage, **options), PATIENCE).state == 'done', engine.jobs[-1].words
        yield engine


@pytest.fixture
def fresh(case, tmp_path):
    """A session in which nothing was done but look at the recordings."""
    with open_session(tmp_path / 's', Start(data=DataRequest((case,)))) as session:
        job = new_job(session.folder, 'check', 1, {}, Engine(session).data())
        finish(session.folder, job)
        yield Engine(session)


def finish(folder, job):
    """Do a job in this process."""
    state, words = outcome(folder, job)
    (job.folder / 'state.json').write_text(json.dumps({'state': state, 'words': words}))
    return job


def data_words(engine):
    return [*engine.session.data.options(), '--config', str(engine.session.file(1))]


def without_time(content):
    return {name: value for name, value in content.items() if name != 'seconds'}


def test_what_is_checked(engine):
    found = engine.latest('check').result()
    assert [(run['name'], run['held_out']) for run in found['runs']] == [('run1', False), ('run2', False), ('run3', True)]
    assert found['runs'][0]['samples'] == 241 and found['runs'][0]['channels']['alpha']['missing'] == 0
    assert set(found['noise_std']) >= {'alpha', 'F_1'} and found['system'] == 'module'
    assert engine.latest('check').curves()['run1']['measured.alpha'].shape == (241,)


def test_a_comparison_is_that_of_the_command(engine, tmp_path):
    out = tmp_path / 'compare.json'
    assert main(['compare', *data_words(engine), '--json', str(out)]) == 0
    job = engine.latest('compare')
    assert job.result() == json.loads(out.read_text())
    curves = job.curves()['run3']
    rmse = np.sqrt(np.mean((curves['measured.alpha'] - curves['model.alpha']) ** 2))
    channel = job.result()['comparisons'][0]['runs']['run3']['channels']['alpha']
    assert rmse == pytest.approx(channel['rmse'], rel=1e-12)
    assert rmse / curves['noise.alpha'] == pytest.approx(channel['over_noise'], rel=1e-12)
    assert job.files['report'].read_text().rstrip().endswith('</html>')


def test_a_calibration_tells_how_it_proceeds(engine):
    job = engine.latest('calibrate')
    iterations = [event for event in job.events() if event['kind'] == 'iteration']
    assert len(iterations) > 2 and iterations[-1]['cost'] <= iterations[0]['cost']
    assert [event['n'] for event in job.events(3)] == list(range(3, len(job.events())))
    assert set(job.files) == {'result', 'parameters', 'report', 'curves'}


def test_what_is_accepted_is_a_version(engine):
    version = engine.accept()
    fitted = engine.latest('calibrate').result()['parameters']['beam.E']['value']
    assert engine.session.config().parameters['beam.E'] == fitted
    assert version.words == f'calibrated from version 1 (step {engine.latest("calibrate").number})'
    overview = {one['stage']: one for one in engine.overview()}
    assert overview['diagnose']['reason'] == 'compare version 2 with the recordings first'
    engine.session.undo()
    assert engine.reason('diagnose') == ''
    json.dumps(engine.overview(), allow_nan=False)


@pytest.mark.slow
def test_what_is_exported_does_the_same(engine, monkeypatch):
    """The commands and the Python lines give the numbers of the session to the digit."""
    engine.accept()
    with pytest.raises(UserError, match='compare version 2'):
        export(engine)
    compared = engine.wait(engine.start('compare'), PATIENCE)
    try:
        exported = export(engine)
    finally:
        engine.session.go_to(1)
    assert '1. the model that the session began with' in exported.shell and '--free beam.E' in exported.shell
    subprocess.run(['sh', '-n', exported.folder / 'reproduce.sh'], check=True)
    monkeypatch.chdir(exported.folder)
    commands = [shlex.split(line) for line in exported.shell.splitlines() if line.startswith('sma-sim ')]
    assert [words[1] for words in commands] == ['fit', 'compare'] and all(main(words[1:]) == 0 for words in commands)
    runpy.run_path('reproduce.py')
    again, wanted = exported.folder / 'again', compared.result()
    for name in ('comparison.json', 'comparison_by_python.json'):
        found = json.loads((again / name).read_text())
        assert named_alike(found) == named_alike(wanted)
    fit = engine.latest('calibrate')
    assert without_time(json.loads((again / '1_calibrate.json').read_text())) == without_time(fit.result())
    assert (again / '1_calibrate.yaml').read_text() == fit.files['parameters'].read_text()
    for name in ('again/1_calibrate.yaml', 'again/1_calibrate_by_python.yaml', 'parameters.yaml'):
        assert flat_parameters(read_config(exported.folder / name)) == flat_parameters(engine.session.config(2)), name


def test_what_is_exported_imports_what_it_uses():
    """The lines of all steps at once, without running them."""
    steps = [SimpleNamespace(stage=stage, options={}) for stage in STEP_LINES]
    tree = ast.parse(python_text(['head'], DataRequest((Path('runs'),)), steps))
    scope = {}
    imports = [node for node in tree.body if isinstance(node, ast.Import | ast.ImportFrom)]
    exec(compile(ast.Module(imports, []), 'imports', 'exec'), scope)
    names = [node for node in ast.walk(tree) if isinstance(node, ast.Name)]
    made = {node.id for node in names if isinstance(node.ctx, ast.Store)}
    assert {node.id for node in names} - made - scope.keys() - vars(builtins).keys() == {'__file__'}
    public = [
        node for node in ast.walk(tree) if isinstance(node, ast.Attribute) and getattr(node.value, 'id', '') == 'sma_sim'
    ]
    assert public and all(hasattr(scope['sma_sim'], node.attr) for node in public)


def named_alike(content):
    """A comparison without the name of its configuration."""
    (comparison,) = content['comparisons']
    return content | {'comparisons': [comparison | {'configuration': ''}]}


def test_the_order(case, tmp_path):
    with open_session(tmp_path / 'a') as session, pytest.raises(UserError, match='no recordings'):
        Engine(session).start('check')
    with open_session(tmp_path / 'b', Start(data=DataRequest((case,)))) as session:
        engine = Engine(session)
        for stage in ('compare', 'calibrate', 'diagnose', 'candidates'):
            with pytest.raises(UserError, match=f'{stage}: check the recordings first'):
                engine.start(stage)
        finish(session.folder, new_job(session.folder, 'check', 1, {}, engine.data()))
        for stage in ('calibrate', 'diagnose'):
            with pytest.raises(UserError, match='compare version 1 with the recordings first'):
                engine.start(stage)
        with pytest.raises(UserError, match='nothing to accept'):
            engine.accept()
        with pytest.raises(UserError, match='no step to start'):
            engine.start('accept')
        with pytest.raises(UserError, match='no step 7'):
            engine.job(7)


@pytest.mark.parametrize(
    ('options', 'words'),
    [
        ({'speed': 1}, 'no option speed'),
        ({'model': 'x'}, 'hybrid, mas, auto'),
        ({'starts': 0}, '1 to 100'),
        ({'starts': True}, 'whole number'),
        ({'seed': 1.5}, 'whole number'),
        ({'robust': 'yes'}, 'true or false'),
        ({'free': 'beam.E'}, 'list of names'),
        ({'limits': 'delay=0:1'}, 'list of NAME=LOW:HIGH'),
        ({'limits': ['delay']}, 'such as delay=-2:5'),
    ],
)
def test_wrong_options(engine, options, words):
    with pytest.raises(UserError, match=words):
        engine.start('calibrate', **options)


def test_limits_are_those_of_the_command(engine):
    """The estimate ends where it must, which is said, and the command that does the same moves the limit too."""
    job = engine.wait(engine.start('calibrate', **FIT, limits=['beam.E=2.2e9:3e9']), PATIENCE)
    found = job.result()
    assert found['parameters']['beam.E']['value'] == pytest.approx(2.2e9)
    assert [(limit['name'], limit['low'], limit['high']) for limit in found['limits']] == [
        ('beam.E', pytest.approx(2.2e9), pytest.approx(3e9))
    ]
    assert job.command_options()[-2:] == ['--limit', 'beam.E=2.2e9:3e9']
    assert "limits={'beam.E': (2200000000.0, 3000000000.0)}" in diagnosis_lines({'limits': ['beam.E=2.2e9:3e9']})[0]


def test_a_mistake_is_said_by_the_job(engine):
    job = engine.wait(engine.start('calibrate', free=['beam.X']), PATIENCE)
    assert job.state == 'failed' and 'beam.X' in job.words and 'Traceback' not in (job.folder / 'log.txt').read_text()
    with pytest.raises(UserError, match='has no result'):
        job.result()
    with pytest.raises(UserError, match='has no model'):
        engine.accept(job.number)


def test_other_recordings_are_checked_first(case, tmp_path):
    (tmp_path / 'run.csv').write_text(TEXT)
    with open_session(tmp_path / 's', Start(data=DataRequest((tmp_path / 'run.csv',)))) as session:
        engine = Engine(session)
        finish(session.folder, new_job(session.folder, 'check', 1, {}, engine.data()))
        assert engine.reason('compare') == ''
        (tmp_path / 'run.csv').write_text(with_cell(5, 'alpha_rad', ''))
        assert engine.reason('compare') == 'check the recordings first'
        finish(session.folder, new_job(session.folder, 'check', 1, {}, engine.data()))
        assert engine.latest('check').result()['runs'][0]['channels']['alpha']['missing'] == 1


def started(engine, words):
    """A diagnosis that has come so far, found as by somebody who opens the page then."""
    job = engine.start('diagnose', model='mas', equation=False, variants=False)
    end = time.monotonic() + PATIENCE
    while words not in json.dumps(job.events()):
        assert job.state == 'running' and time.monotonic() < end, (job.words, job.events())
        time.sleep(0.05)
    (again,) = (one for one in jobs_in(engine.session.folder) if one.state == 'running')
    assert again == job
    return again


@pytest.mark.parametrize('moment', ['fitting the mas', pytest.param('may lack', marks=pytest.mark.slow)])
def test_a_diagnosis_that_is_stopped_keeps_what_it_has(engine, moment):
    job = started(engine, moment)
    with pytest.raises(UserError, match='diagnose is running'):
        engine.start('compare')
    engine.close()
    engine.wait(job, PATIENCE)
    assert job.state == 'stopped' and job.result()['interrupted'] and len(job.result()['error']) == 1
    assert set(job.files) == {'result', 'parameters', 'report', 'curves', 'summary'}
    assert [event['role'] for event in job.events() if event['kind'] == 'model'] == ['nominal']
    assert engine.acceptable() == job


def test_a_process_that_is_killed_is_reported(engine):
    job = started(engine, 'fitting the mas')
    process = engine._processes[job.number]
    process.send_signal(signal.SIGKILL)
    process.wait(PATIENCE)
    assert job.state == 'killed' and 'start this step again' in job.words
    assert engine.running() is None and engine.reason('diagnose') == ''


def test_a_process_that_is_asked_to_stop_at_its_end_says_so(fresh, monkeypatch):
    def over(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(worker, 'outcome', over)
    job = new_job(fresh.session.folder, 'check', 1, {}, fresh.data())
    usual = signal.getsignal(signal.SIGINT)
    try:
        assert worker.main([str(fresh.session.folder), str(job.number)]) == 0
    finally:
        signal.signal(signal.SIGINT, usual)
    assert job.state == 'stopped' and fresh.running() is None


def test_files_of_jobs_that_are_broken(fresh):
    job = fresh.latest('check')
    (job.folder / 'events.jsonl').write_text('{"n": 0, "kind": "progress", "words": "a"}\n{"n": 1, "ki')
    assert len(job.events()) == 1
    (job.folder / 'result.json').write_text('{')
    with pytest.raises(UserError, match='cannot be read'):
        job.result()
    (job.folder / 'curves.npz').write_bytes(b'PK')
    with pytest.raises(UserError, match='cannot be read'):
        job.curves()
    for name, text in (('0002', '{'), ('0003', '{"stage": 3}'), ('x', '')):
        (job.folder.parent / name).mkdir()
        (job.folder.parent / name / 'request.json').write_text(text)
    assert fresh.jobs == (job,)
    assert new_job(fresh.session.folder, 'check', 1, {}, '').number == 4
    assert isinstance(fresh.job(4), Job)


@pytest.fixture(scope='module')
def candidates(engine):
    """A few effects, each switched on by itself."""
    engine.session.go_to(1)
    job = engine.wait(engine.start('candidates', effects=['gravity', 'sensor_gain', 'power_gain_mismatch']), PATIENCE)
    assert job.state == 'done', job.words
    return job


def test_what_every_candidate_would_do(engine, candidates):
    """What is missing explains most; its errors are those of a comparison, but for delay and starts of fewer samples."""
    result = candidates.result()
    first = result['effects'][0]
    assert first['name'] == 'gravity' and first['error'] < 1.1 < 5.0 < result['error']
    assert first['probability'] > 0.99 > 0.01 > result['probability']
    assert first['expected_error'] < result['expected_error'] < result['error']
    told = [event for event in candidates.events() if event['kind'] == 'candidate']
    assert {event['name'] for event in told} == {effect['name'] for effect in result['effects']}
    assert [(event['done'], event['total']) for event in told] == [(1, 3), (2, 3), (3, 3)]
    assert [effect['expected_error'] for effect in result['effects']] == sorted(one['expected_error'] for one in told)
    g_y = first['parameters']['g_y']
    assert g_y['low'] <= -9.81 <= g_y['high'] and g_y['determined'] and g_y['high'] - g_y['low'] < 2.0
    config = engine.session.preview({f'effects.gravity.{name}': v for name, v in first['values'].items()}, ['gravity'])
    request = engine.session.data
    fitted, held_out = request.split(request.read(config))
    scores = channel_scores(compare(fitted, config, held_out).part(False), list(first['errors']))
    assert {name: score.over_noise for name, score in scores.items()} == pytest.approx(first['errors'], rel=3e-2)


def test_candidates_that_are_stopped_keep_those_so_far(engine, candidates):
    """They can be looked at, and beside a part of a residual too."""
    job = engine.start('candidates')
    end = time.monotonic() + PATIENCE
    while not any(event['kind'] == 'candidate' for event in job.events()):
        assert time.monotonic() < end and job.state == 'running', job.words
        time.sleep(0.02)
    job.stop()
    assert engine.wait(job, PATIENCE).state == 'stopped', job.words
    told = [event for event in job.events() if event['kind'] == 'candidate']
    assert 0 < len(told) < told[0]['total'] and len(job.result()['effects']) == len(told)
    assert engine.part_of_residual(('run1', 'alpha'), (0.0, 12.0))['effects']
    engine.wait(engine.start('candidates', effects=['gravity', 'sensor_gain', 'power_gain_mismatch']), PATIENCE)


def test_candidates_stay_within_what_is_realistic(engine, candidates, case):
    """Beside data that ask for far more, every value is within the realistic range, and can be switched on as it is."""
    known = {found.name: found for found in package_effects().values()}
    request = engine.session.data
    config = engine.session.config(1)
    fitted, _ = request.split(request.read(config))
    pulled = replace(  # as if something pulled sixty times as hard as gravity
        fitted,
        recordings=tuple(
            replace(one, channels={**one.channels, 'U_y': one.channels['U_y'] - 60 * 2.5e-4}) for one in fitted.recordings
        ),
    )
    with executor_or_threads(None) as executor:
        found = candidate_effects(pulled, config, [], executor, (lambda _: None, lambda _: None), ['gravity', 'radiation'])
    assert {effect.name for effect in found.effects} >= {'gravity'}
    for effect in found.effects:
        for p in known[effect.name].parameters:
            if p.name in effect.parameters:
                one, least = effect.parameters[p.name], min(p.realistic[0], p.neutral)
                assert least <= one.low <= one.value <= one.high <= p.realistic[1], (effect.name, p.name, one)
        values = {f'effects.{effect.name}.{name}': value for name, value in effect.values.items()}
        assert engine.session.preview(values, [effect.name]).effects[0].effect.name == effect.name
    gravity = next(effect for effect in found.effects if effect.name == 'gravity')
    assert gravity.parameters['g_y'].at_end and gravity.values['g_y'] == -9.81
    assert gravity.error < found.error


def test_a_part_of_a_residual(engine, candidates):
    whole = engine.part_of_residual(('run1', 'alpha'), (0.0, 12.0))
    channel = engine.latest('compare').result()['comparisons'][0]['runs']['run1']['channels']['alpha']
    assert whole['samples'] == 241 and whole['over_noise'] == pytest.approx(channel['over_noise'], rel=1e-12)
    part = engine.part_of_residual(('run1', 'U_y'), (6.0, 2.0))
    assert (part['t0'], part['t1'], part['samples']) == (2.0, 6.0, 81)
    names = {share['dimension'] for share in part['states']}
    assert {'mode of wire 1', 'heating or cooling of wire 2', 'direction of motion'} <= names and 'run' not in names
    for name in names:
        assert sum(share['share'] for share in part['states'] if share['dimension'] == name) <= 1.0 + 1e-9
    assert 273.0 < part['temperatures']['wire 1'][0] <= part['temperatures']['wire 1'][1] < 500.0
    best = part['effects'][0]
    cosines = {entry['effect']: entry['cosine'] for entry in part['effects']}
    assert cosines['gravity'] > 0.8 and best['cosine'] == max(cosines.values())
    for where, times, words in (
        (('run9', 'alpha'), (0.0, 9.0), 'no run run9'),
        (('run1', 'T_9'), (0.0, 9.0), 'no channel T_9'),
        (('run1', 'alpha'), (3.0, 3.1), 'expected 5 or more'),
        (('run1', 'alpha'), (99.0, 199.0), '0 samples'),
    ):
        with pytest.raises(UserError, match=words):
            engine.part_of_residual(where, times)


HEADER, *LINES = TEXT.splitlines()
BROKEN = {
    'empty': '',
    'no rows': HEADER + '\n',
    'no names': '\n'.join(LINES),
    'no command': TEXT.replace('J_eq_W', 'power'),
    'semicolons': TEXT.replace(',', ';'),
    'tabs': TEXT.replace(',', '\t'),
    'no time': TEXT.replace('time_s', 'clock'),
    'nothing measured': '\n'.join(','.join(line.split(',')[:3]) for line in [HEADER, *LINES]),
    'binary': b'\x89PNG\r\n\x1a\n' + bytes(range(256)) * 9,
    'UTF-16': TEXT.encode('utf-16'),
    'cut': TEXT[: len(TEXT) // 2],
    'zeros': b'\0' * 4000,
    'a column twice': TEXT.replace('F_1_N', 'alpha_rad'),
    'degrees': with_cell(9, 'alpha_rad', '400'),
    'words': with_cell(3, 'alpha_rad', 'high'),
    'infinite': with_cell(3, 'alpha_rad', 'inf'),
    'comma decimals': with_cell(3, 'alpha_rad', '0,1'),
    'celsius': with_cell(3, 'T_E_K', '25'),
    'backwards': '\n'.join([HEADER, *LINES[::-1], '']),
    'same time': '\n'.join([HEADER, *[LINES[0]] * 40, '']),
    'quotes': '"' + TEXT,
    'one row': '\n'.join([HEADER, LINES[0], '']),
    'a page': '<html><body>404</body></html>',
    'a missing command': with_cell(3, 'J_eq_W', ''),
    'huge': with_cell(3, 'J_eq_W', '1e300'),
}


@pytest.mark.parametrize('kind', BROKEN)
def test_broken_recordings_are_read_or_refused(kind, tmp_path):
    """Each is repaired, and that is noted, or refused in words that name the file."""
    content = BROKEN[kind]
    path = tmp_path / 'run.csv'
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with open_session(tmp_path / 's', Start(data=DataRequest((path,)))) as session:
        engine = Engine(session)
        job = finish(session.folder, new_job(session.folder, 'check', 1, {}, engine.data()))
        if job.state == 'done':
            result = job.result()
            assert any(run['notes'] for run in result['runs']), f'{kind}: read without a word'
        else:
            assert job.state == 'failed' and 'run.csv' in job.words and 'fault' not in job.words, job.words
            assert 'run.csv' in engine.reason('compare')


def test_recordings_that_are_gone(tmp_path):
    (tmp_path / 'run.csv').write_text(TEXT)
    with open_session(tmp_path / 's', Start(data=DataRequest((tmp_path / 'run.csv',)))) as session:
        (tmp_path / 'run.csv').unlink()
        job = finish(session.folder, new_job(session.folder, 'check', 1, {}, Engine(session).data()))
        assert job.state == 'failed' and 'cannot read' in job.words
