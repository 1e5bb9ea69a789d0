"""A fit ends where its runs can be made, at the tolerance at which they can."""

from threading import Event

import numpy as np

from sma_sim import Dataset, FitOptions, Input, Model, Recording, read_config, simulate
from sma_sim.evidence.estimation.calibrate import FINAL_RTOL, SEARCH_RTOL, final_calibration, problem_for
from sma_sim.evidence.estimation.executors import executor_or_threads
from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.estimation.problem import residuals_at, start_point
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.words.fit_remarks import remarks_on

# Of a slider, implausible: a run ends at a relative tolerance of 1e-5 and stalls at 3e-6 and 1e-6.
VALUES = {
    'wire.E_A': 21427875097.95725,
    'wire.E_M': 31871272020.386864,
    'wire.eps_T': 0.07084646834387899,
    'wire.sigma_T': 7501687.105842027,
    'wire.c_V': 2664.3612023833225,
    'wire.lambda': 74.58443062752217,
    'wire.sigma_MW0': 76404867.85933165,
    'wire.dsigma': 4666156.192205643,
    'wire.V_L': 2.1078974788256747e-22,
    'slider.k': 263.23395928891745,
    'slider.x_0': 0.05892767298940169,
    'slider.b': 1.0129624942297804,
}


def test_a_fit_ends_at_the_tolerance_of_its_search_where_runs_stall_below():
    config = read_config(words=['system=slider', 'model=mas', f'solver.rtol={SEARCH_RTOL}']).variant(VALUES)
    command = np.column_stack([[0.0, 8.0, 0.0, 0.0], np.full(4, 298.0)])
    source = Input(np.array([0.0, 1.0, 6.0, 15.0]), command, (False, False), config.structure.structure.input_columns)
    times = np.linspace(0.0, 15.0, 50)
    run = simulate(Model(config), source, times)
    recording = Recording('run1', 'slider', times, {'T': run['T_K']}, source, exact_commands=True)
    dataset, options = Dataset((recording,), {'T': 0.5}), FitOptions(free=('wire.lambda',), starts=1)
    problem = problem_for(dataset, config, options, 1, step_limited=False)
    z = start_point(problem)
    with executor_or_threads(None) as pool:
        (last,) = residuals_at(problem.at_tolerance(FINAL_RTOL), z, pool)
        assert last is None
        context = SearchContext(pool, Event(), lambda line: None)
        found = final_calibration(dataset, FitResult(problem, z, 0.0), options, context)
    assert found.error < 0.1 and found.rtol == SEARCH_RTOL and found.intervals['wire.lambda'].std > 0.0
    assert any('1e-06' in remark and '1e-05' in remark for remark in remarks_on(found))
