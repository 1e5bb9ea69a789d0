"""What a bench adds to its sensors: zeros by recording, repeats that differ, a command whose square is power."""

import json
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from threading import Event

import numpy as np
import pytest

from sma_sim import Config, Dataset, Input, Model, Recording, UserError, read_config, read_dataset, simulate
from sma_sim.cli.main import main
from sma_sim.evidence.data.repeatability import repeatability
from sma_sim.evidence.diagnosis import diagnose
from sma_sim.evidence.estimation.held_out_prediction import evaluate_held_out
from sma_sim.evidence.estimation.prepared_fit import prepare
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.model_selection.nominal_fit import DiagnosisRequest

WORDS = (
    'system=slider',
    'wire.l0=1.0',
    'wire.r0=0.25e-3',
    'wire.E_A=4e10',
    'wire.E_M=2e10',
    'wire.eps_T=0.018',
    'wire.sigma_T=6e6',
    'wire.T0=343',
    'wire.sigma_MW0=9.8e7',
    'wire.dsigma=1.2e8',
    'wire.c_V=450',
    'wire.lambda=100',
    'slider.L=1.018',
    'slider.k=60',
    'slider.x_0=0.05',
    'slider.m=0.028',
    'slider.b=1.7',
)
MAP = 'system: slider\nJ_W: {{column: duty, scale: 70}}\nposition_m: {{column: position_m{more}}}\n{top}'
OFF = (0.0, 1e-3, -5e-4)  # [m] zeros of the recordings


def write_runs(folder, exponent=1.0):
    """Three recordings of a slider: the second repeats the first, the third is heated less; each has a zero of its own."""
    config = read_config(words=WORDS)
    for k, duty in enumerate((0.2, 0.2, 0.14)):
        power = 70.0 * np.array([0.0, duty, 0.0, 0.0]) ** exponent
        source = Input([0.0, 2.0, 14.0, 30.0], np.column_stack([power, np.full(4, 298.0)]), (False, False))
        times = np.arange(0.0, 30.0, 0.05)
        run = simulate(Model(config), source, times)
        shown = run['position_m'] + OFF[k] + 2e-5 * np.random.default_rng(k).normal(size=len(times))
        given = np.where((times >= 2.0) & (times < 14.0), duty, 0.0)
        rows = [f'{t:.2f},{d},{x:.7f}' for t, d, x in zip(times, given, shown, strict=True)]
        (folder / f'run{k}.csv').write_text('\n'.join(['time_s,duty,position_m', *rows]) + '\n')
    return [folder / f'run{k}.csv' for k in range(3)]


def with_map(folder, more='', top=''):
    """A map of these files, with words of its own."""
    (folder / 'map.yaml').write_text(MAP.format(more=more, top=top))
    return folder / 'map.yaml'


def test_zeros_are_those_of_the_recordings(tmp_path):
    files = write_runs(tmp_path)
    known = read_dataset(files, 'slider', 298.0, with_map(tmp_path))
    free = read_dataset(files, 'slider', 298.0, with_map(tmp_path, ', zero_std: 2e-3'))
    config = read_config(words=WORDS)
    zeros = [run.zeros['position'] for run in evaluate_held_out(config, free)]
    assert zeros == pytest.approx(OFF, abs=2e-5)
    assert max(run.error for run in evaluate_held_out(config, free)) < 1.2
    assert max(run.error for run in evaluate_held_out(config, known)) > 10.0
    assert [run.zeros for run in evaluate_held_out(config, known)] == [{}, {}, {}]


def test_a_narrow_prior_keeps_a_zero_small(tmp_path):
    dataset = read_dataset(write_runs(tmp_path), 'slider', 298.0, with_map(tmp_path, ', zero_std: 1e-7'))
    assert all(abs(run.zeros['position']) < 1e-5 for run in evaluate_held_out(read_config(words=WORDS), dataset))


def test_repeats_tell_the_floor(tmp_path):
    """Only the first two have the same command; with zeros known they differ by 1 mm, standard deviation 1/sqrt(2)."""
    dataset = read_dataset(write_runs(tmp_path), 'slider', 298.0, with_map(tmp_path))
    (found,) = repeatability(dataset.recordings, dataset.noise_std)
    assert found.names == ('run0', 'run1') and found.channel == 'position'
    assert found.floor == pytest.approx(1e-3 / np.sqrt(2.0), rel=0.02)
    assert any('run0, run1 repeat one command' in note for note in dataset.notes)
    same = tuple(replace(recording, zero_std={'position': 1e-3}) for recording in dataset.recordings)
    assert not repeatability(same, dataset.noise_std), 'what is left is noise'


def test_a_floor_counts_as_noise_of_independent_samples(tmp_path):
    files = write_runs(tmp_path)
    plain = read_dataset(files, 'slider', 298.0, with_map(tmp_path))
    dataset = read_dataset(files, 'slider', 298.0, with_map(tmp_path, ', floor: 3e-4', 'independent_after: 0.5\n'))
    assert dataset.noise_std['position'] == pytest.approx(np.hypot(plain.noise_std['position'], 3e-4))
    assert dataset.floor == {'position': 3e-4}
    one = dataset.recordings[0]
    assert np.diff(one.time) == pytest.approx(0.5) and len(one.channels['position']) == len(one.time) == 60
    assert one.source.times.tolist() == plain.recordings[0].source.times.tolist(), 'the command keeps its rows'


def test_power_goes_with_the_square_of_a_voltage(tmp_path):
    path = with_map(tmp_path)
    path.write_text('system: slider\nJ_W: {column: duty, scale: 70, exponent: 2}\n')
    dataset = read_dataset(write_runs(tmp_path, exponent=2.0), 'slider', 298.0, path)
    assert dataset.recordings[2].source.values[:, 0].max() == pytest.approx(70.0 * 0.14**2)
    wrong = read_dataset(write_runs(tmp_path, exponent=2.0), 'slider', 298.0, with_map(tmp_path))
    config = read_config(words=WORDS)
    assert evaluate_held_out(config, dataset)[0].error < 1.2 < evaluate_held_out(config, wrong)[0].error


@pytest.mark.parametrize(
    'more, top, message',
    [
        (', floor: 1e-4', '', 'a floor needs independent_after'),
        (', zero_std: -1', '', 'zero_std: expected a positive number'),
        ('', 'independent_after: soon\n', 'independent_after: expected a number'),
        ('', 'time_s: {column: time_s, floor: 1}\n', 'zero_std, drift_std and floor belong to measured columns'),
    ],
)
def test_what_a_map_cannot_say(more, top, message, tmp_path):
    with pytest.raises(UserError, match=message):
        read_dataset(write_runs(tmp_path), 'slider', 298.0, with_map(tmp_path, more, top))


def test_the_zeros_are_reported(tmp_path, capsys):
    files, path = write_runs(tmp_path), with_map(tmp_path, ', zero_std: 2e-3')
    words = [word for name in WORDS[1:] for word in ('--set', name)]
    assert not main(
        [
            'fit',
            *map(str, files),
            '--map',  # which says the system
            str(path),
            *words,
            '--model',
            'hybrid',
            '--free',
            'wire.lambda',
            '--starts',
            '1',
            '--json',
            str(tmp_path / 'found.json'),
        ]
    )
    shown, found = capsys.readouterr().out, json.loads((tmp_path / 'found.json').read_text())
    assert 'zero of position, estimated for each recording' in shown
    assert [run['zeros']['position'] for run in found['error']['runs'].values()] == pytest.approx(OFF, abs=5e-5)


@pytest.mark.slow
def test_effects_of_the_nominal_model_are_no_findings(tmp_path):
    """A scale of power, which the bench needs, is part of the model from the start."""
    files, path = write_runs(tmp_path), with_map(tmp_path, ', zero_std: 2e-3')
    words = [word for name in WORDS[1:] for word in ('--set', name)]
    out = tmp_path / 'found.json'
    assert not main(
        [
            'diagnose',
            *map(str, files),
            '--system',
            'slider',
            '--map',
            str(path),
            *words,
            '--model',
            'hybrid',
            '--effect',
            'latent_heat_scale:k=1.1',
            '--no-equation',
            '--no-variants',
            '--json',
            str(out),
        ]
    )
    found = json.loads(out.read_text())
    assert found['verdict'] == 'none' and found['effects'] == []


@dataclass(frozen=True)
class Verdict:
    """What stands for a diagnosis."""

    verdict: str
    names: tuple[str, ...] = ()
    set_up: tuple = ()
    together: object = None


@pytest.mark.parametrize('verdict', ['unknown_effect', 'missing_effect', 'none'])
def test_held_out_runs_are_searched_too_where_the_others_do_not_tell(verdict, monkeypatch):
    def search(start, held_out, request, context, faults):
        assert held_out is None and not request.equation and faults == ()
        return Verdict('missing_effect', tuple(recording.name for recording in start.dataset.recordings))

    monkeypatch.setattr(diagnose, 'search_effects', search)
    source = Input([0.0, 1.0], [[0.0, 298.0], [0.0, 298.0]], (False, False))
    one, other = (Dataset((Recording(name, 'slider', np.arange(2.0), {}, source),)) for name in 'ab')
    with ThreadPoolExecutor(1) as pool:
        context, start = SearchContext(pool, Event()), prepare(one, Config(system='slider'))
        found = diagnose.searched_together(Verdict(verdict), start, other, DiagnosisRequest(), context, ())
    assert found.verdict == verdict
    assert (found.together is not None) == (verdict == 'unknown_effect')
    assert found.together is None or found.together.names == ('a', 'b')
