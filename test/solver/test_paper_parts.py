"""What is computed from the runs of the paper's experiments, with runs whose results are known beforehand."""

from types import SimpleNamespace

import numpy as np
import pytest

from sma_sim.model.material import sigma_A, sigma_M
from sma_sim.model.program_parameters import DEFAULTS
from sma_sim.solver import paper_experiments as paper
from sma_sim.solver.inputs import inputs_at, module_input, regular_times
from sma_sim.solver.paper_experiments import (
    COMPARED_COLUMNS,
    EXACT_RTOL,
    MODEL_KINDS,
    PaperResults,
    StressStrainLoop,
)
from sma_sim.solver.simulate import STOPPED


class Made(dict):
    """A run by its columns."""

    def __init__(self, time, steps=0, rejected=0, reason='end of the input', **columns):
        super().__init__(columns)
        self.time, self.steps, self.rejected, self.reason = time, steps, rejected, reason
        self.completed, self.end = reason == 'end of the input', time[-1]


def test_plateaus_of_a_loop_are_means_of_its_outer_branches(monkeypatch):
    """Stresses that grow with strain, more while it is pulled first, and much more when it is pulled again."""
    seen = []

    def run(model, source, samples):
        seen.append(model.config)
        time = regular_times(source, samples)
        branch = np.searchsorted(source.times, time, side='right')
        added = np.array([0.0, 5e7, 0.0, 3e8, 3e8, 3e8])[branch]
        stress = 1e9 * inputs_at(source, time)['strain'] + added - (1e7 if model.config.simulated_kinetics == 'mas' else 0.0)
        return Made(time, stress_Pa=stress)

    monkeypatch.setattr(paper, 'complete_run', run)
    loop, middle = paper.stress_strain_loop(315.0), 1e9 * 0.035
    assert loop.plateaus['hybrid'] == pytest.approx((middle + 5e7, middle), rel=1e-9)
    assert loop.plateaus['mas'] == pytest.approx((middle + 4e7, middle - 1e7), rel=1e-9)
    assert (loop.T_E, len(loop.strain)) == (315.0, 2101)
    assert [loop.strain.max(), *loop.strain[[0, -1]]] == pytest.approx([0.075, 0.0, 0.0], abs=1e-12)
    assert [config.simulated_kinetics for config in seen] == list(MODEL_KINDS)
    for config in seen:
        assert config.parameters['wire.lambda'] > 1e5 and config.parameters['initial.x_M_1'] == 0.0
    wire = paper.Model(seen[0]).compiled.wire
    assert loop.closed_form == (sigma_A(315.0, wire), sigma_M(315.0, wire)) and loop.closed_form[0] > loop.closed_form[1]


def test_plateaus_of_one_model_lie_inside_those_of_the_other():
    loops = [
        StressStrainLoop(300.0, np.zeros(1), {}, (0.0, 0.0), {'hybrid': hybrid, 'mas': mas})
        for hybrid, mas in (((30.0, 10.0), (25.0, 12.0)), ((40.0, 20.0), (37.0, 21.0)))
    ]
    assert PaperResults(1, 1, tuple(loops), None, None).plateau_offsets == (1.0, 5.0)


def test_the_fastest_run_counts_and_the_first_does_not(monkeypatch):
    now, calls = [0.0], []
    lasts = {'hybrid': [1.0, *np.linspace(9.0, 3.0, 9)], 'mas': [2.0, *np.linspace(4.0, 8.0, 9)]}

    def run(model, source, samples):
        calls.append(model)
        assert samples.tolist() == [0.0, 100.0]
        now[0] += lasts[model].pop(0)

    monkeypatch.setattr(paper, 'complete_run', run)
    monkeypatch.setattr(paper.time, 'perf_counter', lambda: now[0])
    found = paper.seconds_per_run({kind: kind for kind in MODEL_KINDS}, None)
    assert found == pytest.approx({'hybrid': 3.0, 'mas': 4.0})
    assert calls == list(MODEL_KINDS) * 10


def test_runs_of_random_steps_compare_models_and_each_with_itself(monkeypatch):
    """Angles of the hybrid model are larger by one degree, those at a finite tolerance by a tenth of one."""
    rtols, said = [], []

    def run(model, source, samples=20.0):
        rtol, hybrid = model.config.parameters['solver.rtol'], model.config.simulated_kinetics == 'hybrid'
        rtols.append(rtol)
        off = np.radians(float(hybrid) + (0.1 if rtol > EXACT_RTOL else 0.0))
        columns = {name: np.full(5, off) for name in COMPARED_COLUMNS}
        return Made(np.arange(5.0), steps=70 if hybrid else 90, rejected=7, **columns)

    monkeypatch.setattr(paper, 'complete_run', run)
    monkeypatch.setattr(paper, 'seconds_per_run', lambda models, source: {'hybrid': 0.5, 'mas': 0.25})
    found = paper.random_runs(3, 5, said.append)
    assert set(found.difference) == set(COMPARED_COLUMNS) and found.difference['T_1_K'].shape == (3, 5)
    assert found.difference_of('alpha_rad') == pytest.approx([np.radians(1.0)] * 3)
    equal = dict.fromkeys(MODEL_KINDS, DEFAULTS['solver.rtol'].default)
    assert [timing.rtol for timing in found.timings] == [{'hybrid': 1e-4, 'mas': 3e-5}, equal] and rtols.count(
        EXACT_RTOL
    ) == 6
    for timing in found.timings:
        assert timing.seconds['hybrid'].tolist() == [0.5] * 3 and timing.seconds['mas'].tolist() == [0.25] * 3
        assert timing.steps['hybrid'].tolist() == [77.0] * 3 and timing.steps['mas'].tolist() == [97.0] * 3
        assert timing.error['hybrid'] == pytest.approx([0.1] * 3)
    assert said == [f'random run {k} of 3' for k in (1, 2, 3)]
    first = paper.random_steps(np.random.default_rng(5))
    assert (found.example[0].times == first.times).all() and (found.example[0].values == first.values).all()


def test_the_sine_is_shown_from_rest_in_its_second_period(monkeypatch):
    def run(model, source, samples):
        return Made(
            samples, alpha_rad=2.0 * inputs_at(source, samples)['J_eq_W'] + (model.config.simulated_kinetics == 'mas')
        )

    monkeypatch.setattr(paper, 'complete_run', run)
    sine = paper.slow_sine()
    expected = 12.0 * np.sin(2.0 * np.pi * np.linspace(1.0, 2.0, 2001))
    assert sine.J_eq == pytest.approx(expected, abs=1e-8)
    assert sine.alpha['hybrid'] == pytest.approx(2.0 * expected, abs=1e-9) and sine.largest_difference == pytest.approx(1.0)


def test_a_run_that_was_cut_short_is_no_result(monkeypatch):
    model, source = SimpleNamespace(config=SimpleNamespace(simulated_kinetics='mas')), module_input([0.0, 1.0], [0.0, 0.0])
    for reason, error in ((STOPPED, KeyboardInterrupt), ('step limit reached', RuntimeError)):
        made = Made(np.zeros(1), reason=reason)
        monkeypatch.setattr(paper, 'simulate', lambda *_, made=made: made)
        with pytest.raises(error):
            paper.complete_run(model, source)
    whole = Made(np.zeros(1))
    monkeypatch.setattr(paper, 'simulate', lambda *_: whole)
    assert paper.complete_run(model, source) is whole


def test_all_experiments_are_repeated(monkeypatch):
    said = []
    monkeypatch.setattr(paper, 'stress_strain_loop', lambda T_E: T_E)
    monkeypatch.setattr(paper, 'random_runs', lambda *given: given[:2])
    monkeypatch.setattr(paper, 'slow_sine', lambda: 'sine')
    found = paper.repeat_paper(4, 9, said.append)
    at = (292.0, 315.0, 338.0)  # [K], of the paper's figure
    assert found == PaperResults(4, 9, at, (4, 9), 'sine') and len(said) == 2
