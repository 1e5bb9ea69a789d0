"""Ctrl-C at any moment of a diagnosis: a real process, its words and exit code, its files whole, with the steps so far."""

import json
import os
import signal
import subprocess
import sys
import threading
import time

import pytest
from simulated_data import config, dataset

from sma_sim.challenge.files import write_challenge
from sma_sim.challenge.make import RecordingPlan, make_challenge
from sma_sim.evidence.diagnosis.diagnose import diagnose
from sma_sim.evidence.estimation.calibrate import FitOptions
from sma_sim.evidence.estimation.interruption import stoppable
from sma_sim.evidence.model_selection.nominal_fit import DiagnosisRequest
from sma_sim.model.config import read_config
from sma_sim.model.effects.discovery import find_effects
from sma_sim.words.diagnosis_data import as_data
from sma_sim.words.diagnosis_text import as_text

PATIENCE = 300.0  # [s]


@pytest.fixture(scope='module')
def case(tmp_path_factory):
    """A small robot that lacks gravity."""
    folder = tmp_path_factory.mktemp('stop') / 'case'
    write_challenge(
        make_challenge(2, kinds=['gravity'], forces=True, plan=RecordingPlan(duration=15.0, rate=10.0)), folder, 'csv'
    )
    return folder


class Diagnosing:
    """`sma-sim diagnose` as a process of its own; what it says on stderr is kept."""

    def __init__(self, case, home, *words):
        self.home, self.said = home, []
        outputs = ['--report', home / 'why.html', '--json', home / 'why.json', '-o', home / 'better.yaml']
        words = ['diagnose', case, '--config', case / 'nominal.yaml', *outputs, *words]
        command = [sys.executable, '-m', 'sma_sim.cli.main', *words]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        threading.Thread(target=self.listen, daemon=True).start()

    def listen(self):
        self.said.extend(self.process.stderr)

    def wait_for(self, words):
        end = time.monotonic() + PATIENCE
        while not any(words in line for line in list(self.said)):
            assert self.process.poll() is None and time.monotonic() < end, self.said
            time.sleep(0.01)

    def stopped(self):
        """Ctrl-C: exit code and stdout."""
        self.process.send_signal(signal.SIGINT)
        words = self.process.stdout.read()
        return self.process.wait(PATIENCE), words

    def check_whole(self):
        """The verdict, once all files are found to be there, whole and of one mind."""
        assert not list(self.home.glob('*.part')) and not list(self.home.glob('.*.part'))
        page = (self.home / 'why.html').read_text()
        verdict = json.loads((self.home / 'why.json').read_text())
        config = read_config(self.home / 'better.yaml')
        assert page.rstrip().endswith('</html>')
        assert [active.effect.name for active in config.effects] == verdict['effects'] == verdict['error'][-1]['effects']
        assert all(step['train'] > 0.0 and step['held_out'] > 0.0 for step in verdict['error'])
        return verdict, page


def test_what_was_stopped_before_anything_was_compared_has_no_probabilities():
    told = []

    def stop_at_once(words):
        if not told:
            os.kill(os.getpid(), signal.SIGINT)
        told.append(words)

    request = DiagnosisRequest(options=FitOptions(free=('beam.E',), kinetics='mas', starts=1, intervals=False))
    data, given = dataset(config('mas'), [4, 5], noise=1.0, rate=5.0), config('mas').variant({'solver.rtol': 2e-6})
    found = diagnose(data, given, request=request, on_progress=stop_at_once)
    assert {stage.config.parameters['solver.rtol'] for stage in found.stages} == {2e-6}  # what was asked for
    content, said = as_data(found), '\n'.join(as_text(found))
    assert (content['verdict'], content['probabilities'], content['models']) == ('unknown_effect', {}, [])
    assert found.interrupted and said.startswith('Stopped before the search was complete. No effect has been tried.')
    assert 'robab' not in said + found.summary()


@pytest.mark.parametrize(
    ('words', 'model'),
    [
        ('fitting the hybrid', 'auto'),
        pytest.param('fitting the mas', 'auto', marks=pytest.mark.slow),
        pytest.param('what the nominal model may lack', 'mas', marks=pytest.mark.slow),
    ],
)
def test_stopped_before_anything_was_found(case, tmp_path, words, model):
    one = Diagnosing(case, tmp_path, '--model', model)
    one.wait_for(words)
    code, said = one.stopped()
    verdict, page = one.check_whole()
    assert code == 130 and 'Stopped before the search was complete.' in said and 'Most probable' not in said
    assert verdict['interrupted'] and verdict['effects'] == [] and len(verdict['error']) == 1
    assert (verdict['verdict'], verdict['probabilities'], verdict['models']) == ('unknown_effect', {}, [])
    assert 'Stopped before the search was complete' in page and not any('Traceback' in line for line in one.said)


@pytest.mark.slow
def test_stopped_after_an_effect_was_found(case, tmp_path):
    one = Diagnosing(case, tmp_path, '--model', 'mas')
    one.wait_for('what may stand in place of ')
    code, said = one.stopped()
    verdict, page = one.check_whole()
    assert code == 130 and 'more may be missing' in said
    assert verdict['interrupted'] and verdict['effects'] == ['gravity']
    assert len(verdict['error']) == len(verdict['effects']) + 1
    phrases = [find_effects()[name].phrase for name in verdict['effects']]
    assert f'Your model lacks {" and ".join(phrases)}; more may be missing' in page


@pytest.mark.slow
def test_stopped_while_files_are_written(case, tmp_path):
    """Then the search is over: everything is written, and nothing was interrupted."""
    one = Diagnosing(case, tmp_path, '--model', 'mas', '--no-equation')
    end = time.monotonic() + PATIENCE
    while not (tmp_path / 'better.yaml').exists():
        assert one.process.poll() is None and time.monotonic() < end, one.said
        time.sleep(0.005)
    code, said = one.stopped()
    verdict, _ = one.check_whole()
    assert code == 0 and not verdict['interrupted'] and said.split()[0] in ('Your', 'Nothing', 'Something')


def test_the_second_one_is_not_held_back():
    before = signal.getsignal(signal.SIGINT)
    with stoppable() as stop:
        os.kill(os.getpid(), signal.SIGINT)
        assert stop.wait(5.0)
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(5.0)
    assert signal.getsignal(signal.SIGINT) is before


def test_where_ctrl_c_is_ignored_or_cannot_be_heard():
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with stoppable() as stop:
            assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN and not stop.is_set()
    finally:
        signal.signal(signal.SIGINT, before)
    found = []

    def elsewhere():
        with stoppable() as stop:
            found.append(stop.is_set())

    thread = threading.Thread(target=elsewhere)
    thread.start()
    thread.join()
    assert found == [False] and signal.getsignal(signal.SIGINT) is before
