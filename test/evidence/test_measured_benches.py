"""Recordings of other people's benches, where they are on this machine: what they tell, and what they do not."""

from pathlib import Path

import numpy as np
import pytest

from sma_sim import FitOptions, calibrate, diagnose, evaluate_held_out, read_config, read_dataset
from sma_sim.evidence.data.train_test_split import split_dataset
from sma_sim.evidence.model_selection.nominal_fit import DiagnosisRequest

ROOT = Path(__file__).resolve().parents[2]
MEASURED, EXAMPLES = ROOT.parent / 'shared' / 'measured', ROOT / 'examples' / 'real'
pytestmark = pytest.mark.skipif(not MEASURED.is_dir(), reason='no measured data here')


def recorded(name, files, system, mapping):
    return read_dataset([MEASURED / name / file for file in files], system, 298.0, mapping)


def test_a_thermometer_at_its_end_is_no_measurement():
    folder = MEASURED / 'static_load'
    dataset = recorded('static_load', ['static.csv'], 'wire_under_load', folder / 'map.yaml')
    (recording,) = dataset.recordings
    assert any('its sensor stops at 423.94' in note for note in recording.notes)
    assert np.nanmax(recording.channels['T']) < 423.9
    assert np.isnan(recording.channels['T']).sum() >= 10 and np.isfinite(recording.channels['strain']).all()


def test_one_warm_up_by_7_K_tells_of_heat_only_and_of_no_effect():
    folder, config = MEASURED / 'thermocouple_pwm', read_config(words=['system=wire'])
    dataset = recorded('thermocouple_pwm', ['step.csv'], 'wire', folder / 'map.yaml')
    found = calibrate(dataset, config, FitOptions(kinetics='hybrid'))
    assert found.uncertainty is not None
    intervals = {one.name: one for one in found.uncertainty.intervals if one.seen}
    assert intervals.keys() <= {'wire.c_V', 'wire.lambda'}
    assert all(one.high > 1.5 * one.low for one in intervals.values())
    diagnosis = diagnose(dataset, config, None, DiagnosisRequest(kinetics='hybrid', equation=False))
    assert diagnosis.verdict == 'unknown_effect' and max(diagnosis.posterior.effects.values()) < 0.9


def test_a_blocked_element_is_explained_to_its_floor():
    """Force and temperature of five runs of one experiment, two of them held out."""
    example, names = EXAMPLES / 'blocked_force', [f'run{k}.csv' for k in range(5)]
    dataset = recorded('blocked_force', names, 'wire', example / 'map.yaml')
    training, held_out = split_dataset(dataset, ['run2', 'run4'])
    found = calibrate(training, read_config(example / 'config.yaml'), FitOptions(kinetics='hybrid', starts=1))
    out = evaluate_held_out(found.config, held_out, found.delay)
    assert found.error < 1.1 and max(one.error for one in out) < 1.15


@pytest.mark.slow
@pytest.mark.parametrize('held_out', ['step01', 'ramp01', 'step02'])
def test_a_slider_lacks_the_same_whichever_run_is_held_out(held_out):
    """Gradual transformation and thermal expansion, though step01 and ramp01 never cool. Without ramp01 that of a
    polycrystal is as probable."""
    example = EXAMPLES / 'slider'
    dataset = recorded('slider', ['step01.csv', 'ramp01.csv', 'step02.csv'], 'slider', example / 'map.yaml')
    training, held = split_dataset(dataset, [held_out])
    request = DiagnosisRequest(kinetics='hybrid', equation=False)
    found = diagnose(training, read_config(example / 'config.yaml'), held, request)
    best = found.posterior.best
    tied = [best, *found.posterior.rivals(found.posterior.models, best)]
    assert any({'smooth_transformation', 'thermal_expansion'} <= model.names for model in tied)
    before, after = found.nominal.held_out, found.stages[-1].held_out
    if held_out == 'step01':  # in a room that was 1 K colder, which nobody measured
        before, *_, after = found.pooled_errors.in_own_rooms
        assert found.verdict == 'missing_effect'
    assert 'thermal_expansion' in best.names and after < 0.75 * before
