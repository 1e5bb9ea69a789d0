"""The paper's simulations (section IV) with both models: stress-strain loops, random steps, slow sine."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sma_sim.model.arrays import Vector
from sma_sim.model.config import Config, default_parameters
from sma_sim.model.material import sigma_A, sigma_M
from sma_sim.solver.inputs import Input, inputs_at, module_input, wire_input
from sma_sim.solver.model import Model
from sma_sim.solver.simulate import Trajectory, simulate, uninterrupted

ModelPair = dict[str, Trajectory]  # by kind of model

MODEL_KINDS = ('hybrid', 'mas')
TEMPERATURES = (292.0, 315.0, 338.0)  # [K]
LOOP_STRAIN, LOOP_RATE = (0.0, 0.075, 0.02, 0.05, 0.0), 1e-4  # [-], [1/s]
BATH = 1e6  # wire.lambda [W/(m^2 K)] that keeps the wire at T_E
PLATEAU = (0.025, 0.045)  # strains [-] between which all branches of the loop are on their plateaus
RUN_LENGTH, LARGEST, SHORTEST, LONGEST = 100.0, 15.0, 2.0, 18.0  # [s], [W], [s], [s]
SINE_PERIOD, SINE_AMPLITUDE = 1000.0, 12.0  # [s], [W]
EQUAL_ERROR = {'hybrid': 1e-4, 'mas': 3e-5}  # tolerances that give both about 1e-4 deg
EQUAL_TOLERANCE = dict.fromkeys(MODEL_KINDS, default_parameters()['solver.rtol'])
TOLERANCES = (EQUAL_ERROR, EQUAL_TOLERANCE)
EXACT_RTOL = 1e-9
SAMPLE_RATE, REPEATS = 20.0, 9  # samples per second, timed repetitions
COMPARED_COLUMNS = ('alpha_rad', 'U_x_m', 'U_y_m', 'T_1_K', 'T_2_K')


class StressStrainLoop(NamedTuple):
    """Stress [Pa] over strain [-], (k,) each, at T_E [K]; plateaus as (sigma_A, sigma_M) [Pa]."""

    T_E: float
    strain: Vector
    stress: dict[str, Vector]
    closed_form: tuple[float, float]
    plateaus: dict[str, tuple[float, float]]


class Timing(NamedTuple):
    """Seconds, steps and largest error of alpha [deg] of the runs, (runs,) each, at a tolerance; by kind of model."""

    rtol: Mapping[str, float]
    seconds: dict[str, Vector]
    steps: dict[str, Vector]
    error: dict[str, Vector]


class RandomRuns(NamedTuple):
    """The random runs: hybrid minus MAS of every channel (runs, k), a timing per entry of TOLERANCES, the first run."""

    difference: dict[str, NDArray[np.float64]]
    timings: tuple[Timing, ...]
    example: tuple[Input, ModelPair]

    def difference_of(self, channel: str) -> tuple[float, float, float]:
        """Mean, RMS and largest |difference| of the models in a channel, over all samples of all runs."""
        gap = np.abs(self.difference[channel])
        return float(gap.mean()), float(np.sqrt(np.mean(gap**2))), float(gap.max())

    @property
    def swing(self) -> float:
        """From the smallest to the largest alpha of the first run [rad]."""
        return float(np.ptp(self.example[1]['hybrid']['alpha_rad']))


class SineResponse(NamedTuple):
    """alpha [rad] over J_eq [W] in the second period, (k,) each, beginning and ending where J_eq rises through 0."""

    J_eq: Vector
    alpha: dict[str, Vector]

    def width(self, kind: str) -> float:
        """Distance [rad] of the two branches at J_eq = 0."""
        falling = len(self.J_eq) // 2  # where J_eq falls through 0
        return float(2.0 * abs(self.alpha[kind][falling]))

    @property
    def largest_difference(self) -> float:
        """Of alpha between the models [rad]."""
        return float(np.abs(self.alpha['hybrid'] - self.alpha['mas']).max())


class PaperResults(NamedTuple):
    """All that the paper's section IV simulates; `runs` and `seed` of the random runs."""

    runs: int
    seed: int
    loops: tuple[StressStrainLoop, ...]
    random: RandomRuns
    sine: SineResponse

    @property
    def plateau_offsets(self) -> tuple[float, float]:
        """By how much the MAS plateaus lie inside the hybrid ones: smallest and largest [Pa]."""
        inside = [loop.plateaus['hybrid'][0] - loop.plateaus['mas'][0] for loop in self.loops]
        inside += [loop.plateaus['mas'][1] - loop.plateaus['hybrid'][1] for loop in self.loops]
        return min(inside), max(inside)


def repeat_paper(runs: int, seed: int, on_progress: Callable[[str], None]) -> PaperResults:
    """All simulations of the paper; `on_progress` is called with what comes next."""
    on_progress('stress-strain loops')
    loops = tuple(stress_strain_loop(T_E) for T_E in TEMPERATURES)
    random = random_runs(runs, seed, on_progress)
    on_progress('slow sine')
    return PaperResults(runs, seed, loops, random, slow_sine())


def paper_module(kind: str, rtol: float) -> Model:
    """The paper's module."""
    return Model(Config(default_parameters() | {'solver.rtol': rtol}, 'module', kind))


def complete_run(model: Model, source: Input, samples: Vector | float = SAMPLE_RATE) -> Trajectory:
    """A whole run: one that was cut short must not pass for a result."""
    done = uninterrupted(simulate(model, source, samples))
    if not done.completed:
        raise RuntimeError(f'{model.config.simulated_kinetics}: the run ended at {done.end:g} s: {done.reason}')
    return done


def stress_strain_loop(T_E: float) -> StressStrainLoop:
    """A slow stress-strain loop, isothermal, from austenite."""
    times = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(LOOP_STRAIN))) / LOOP_RATE])
    source = wire_input(times.tolist(), LOOP_STRAIN, T_E=T_E)
    parameters = default_parameters() | {'wire.lambda': BATH, 'initial.x_M_1': 0.0}
    models = {kind: Model(Config(parameters, 'wire', kind)) for kind in MODEL_KINDS}
    runs = {kind: complete_run(model, source, 1.0) for kind, model in models.items()}
    at = runs['hybrid'].time
    strain = inputs_at(source, at)['strain']
    on_plateau = (PLATEAU[0] < strain) & (strain < PLATEAU[1])
    pulled, released = on_plateau & (at < times[1]), on_plateau & (times[1] < at) & (at < times[2])
    stress = {kind: runs[kind]['stress_Pa'] for kind in MODEL_KINDS}
    plateaus = {kind: (float(values[pulled].mean()), float(values[released].mean())) for kind, values in stress.items()}
    w = models['hybrid'].compiled.wire
    return StressStrainLoop(T_E, strain, stress, (float(sigma_A(T_E, w)), float(sigma_M(T_E, w))), plateaus)


def random_steps(random: np.random.Generator) -> Input:
    """A sequence of steps with random amplitudes and durations."""
    times = [0.0]
    while times[-1] < RUN_LENGTH:
        times.append(times[-1] + random.uniform(SHORTEST, LONGEST))
    times[-1] = RUN_LENGTH
    J_eq = random.uniform(-LARGEST, LARGEST, len(times))
    J_eq[-1] = J_eq[-2]  # the end of the run, not another step
    return module_input(times, list(J_eq))


def seconds_per_run(models: Mapping[str, Model], source: Input) -> dict[str, float]:
    """Fastest time of a run [s] of each model, after one that is not counted; samples at its ends only.

    The fastest, and by turns, since whatever else the machine does only ever adds to it.
    """
    ends = np.array([0.0, RUN_LENGTH])
    durations: dict[str, list[float]] = {kind: [] for kind in models}
    for _ in range(1 + REPEATS):
        for kind, model in models.items():
            start = time.perf_counter()
            complete_run(model, source, ends)
            durations[kind].append(time.perf_counter() - start)
    return {kind: min(times[1:]) for kind, times in durations.items()}


def time_models(rtol: Mapping[str, float], source: Input, exact: ModelPair) -> dict[str, tuple[float, float, float]]:
    """Seconds, steps and largest error of alpha [deg] of a run, by kind of model."""
    models = {kind: paper_module(kind, rtol[kind]) for kind in MODEL_KINDS}
    seconds = seconds_per_run(models, source)
    measured = {}
    for kind, model in models.items():
        done = complete_run(model, source)
        error = np.degrees(np.abs(done['alpha_rad'] - exact[kind]['alpha_rad']).max())
        measured[kind] = (seconds[kind], float(done.steps + done.rejected), float(error))
    return measured


def random_runs(runs: int, seed: int, on_progress: Callable[[str], None]) -> RandomRuns:
    """The random runs with both models; `on_progress` is called after each."""
    random = np.random.default_rng(seed)
    difference: dict[str, list[Vector]] = {name: [] for name in COMPARED_COLUMNS}
    measured: list[list[dict[str, tuple[float, float, float]]]] = []
    example = None
    for number in range(runs):
        source = random_steps(random)
        exact = {kind: complete_run(paper_module(kind, EXACT_RTOL), source) for kind in MODEL_KINDS}
        for name in COMPARED_COLUMNS:
            difference[name].append(exact['hybrid'][name] - exact['mas'][name])
        measured.append([time_models(rtol, source, exact) for rtol in TOLERANCES])
        example = example or (source, exact)
        on_progress(f'random run {number + 1} of {runs}')
    assert example is not None
    timings = tuple(
        Timing(
            rtol, *({kind: np.array([row[k][kind][what] for row in measured]) for kind in MODEL_KINDS} for what in range(3))
        )
        for k, rtol in enumerate(TOLERANCES)
    )
    return RandomRuns({name: np.array(rows) for name, rows in difference.items()}, timings, example)


def slow_sine() -> SineResponse:
    """alpha over J_eq for a sine of 1 mHz; the first period, which begins at rest, is left out."""
    t = np.linspace(0.0, 2 * SINE_PERIOD, 4001)
    source = module_input(t.tolist(), (SINE_AMPLITUDE * np.sin(2 * np.pi * t / SINE_PERIOD)).tolist(), linear=True)
    second = t[t >= SINE_PERIOD]
    alpha = {
        kind: complete_run(paper_module(kind, EQUAL_TOLERANCE[kind]), source, second)['alpha_rad'] for kind in MODEL_KINDS
    }
    return SineResponse(inputs_at(source, second)['J_eq_W'], alpha)
