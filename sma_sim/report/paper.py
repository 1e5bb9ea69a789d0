"""The paper's results again: its figures and numbers beside ours, as one folder with a Markdown page."""

from __future__ import annotations

import platform
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from sma_sim.model.config import Config, default_parameters
from sma_sim.model.material import sigma_A, sigma_M
from sma_sim.report.run_figure import draw_run
from sma_sim.report.style import BLUE, RED, new_figure, plain, save
from sma_sim.solver.inputs import Input, module_input, wire_input
from sma_sim.solver.simulate import Model, Trajectory, simulate

Vector = NDArray[np.float64]

TEMPERATURES = (292.0, 315.0, 338.0)
LOOP_STRAIN, LOOP_RATE = (0.0, 0.075, 0.02, 0.05, 0.0), 1e-4  # [-], [1/s]
DURATION, LARGEST, SHORTEST, LONGEST = 100.0, 15.0, 2.0, 18.0  # [s], [W], [s], [s]
SINE_PERIOD, SINE_AMPLITUDE = 1000.0, 12.0  # [s], [W]
SPEED_RTOL = {'hybrid': 1e-4, 'mas': 3e-5}  # about 1e-4 deg from the converged solution
EXACT_RTOL = 1e-9
REPEATS = 5
PAPER_HYBRID, PAPER_MAS = 1.75, 8.66  # [s] per run
TEMPLATE = Path(__file__).with_name('templates') / 'paper.md'
NAMES = {'hybrid': 'hybrid', 'mas': 'MAS'}
Say = Callable[[str], None]


class Campaign(NamedTuple):
    """The random runs, one entry per run: times [s], errors, largest differences of the models."""

    seconds: dict[str, Vector]
    own_error: dict[str, Vector]  # of alpha against the converged solution [deg]
    difference: dict[str, Vector]  # hybrid against MAS
    example: tuple[Input, Trajectory, Trajectory]


def module(kind: str, rtol: float) -> Model:
    """The paper's module."""
    return Model(Config(default_parameters() | {'solver.rtol': rtol}, 'module', kind))


def loop(kind: str, T_E: float) -> Trajectory:
    """A stress-strain loop, slow, in a bath that keeps the wire at T_E."""
    times = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(LOOP_STRAIN))) / LOOP_RATE])
    parameters = default_parameters() | {'wire.lambda': 1e6, 'initial.x_M_1': 0.0}
    return simulate(Model(Config(parameters, 'wire', kind)), wire_input(list(times), LOOP_STRAIN, T_E=T_E), 1.0)


def draw_loops() -> tuple[Figure, list[str]]:
    """Loops at the three temperatures, and a table row for each."""
    figure = new_figure(9.0, 3.4)
    rows = []
    for axis, T_E in zip(figure.subplots(1, 3, sharey=True), TEMPERATURES, strict=True):
        plain(axis)
        runs = {kind: loop(kind, T_E) for kind in ('hybrid', 'mas')}
        for (kind, run), style in zip(runs.items(), (BLUE, RED), strict=True):
            strain = np.interp(run.time, *loop_path())
            line = '-' if kind == 'hybrid' else '--'
            axis.plot(100 * strain, 1e-6 * run['stress_Pa'], color=style, ls=line, label=NAMES[kind])
        axis.set_title(f'T_E = {T_E:g} K', fontsize=10)
        axis.set_xlabel('strain [%]')
        difference = np.sqrt(np.mean((runs['hybrid']['stress_Pa'] - runs['mas']['stress_Pa']) ** 2))
        w = Model(Config(system='wire')).compiled.wire
        rows.append(
            f'| {T_E:g} | {1e-6 * sigma_A(T_E, w):.2f} | {1e-6 * sigma_M(T_E, w):.2f} | {1e-6 * difference:.3f} |'
        )
    figure.axes[0].set_ylabel('stress [MPa]')
    figure.axes[0].legend(frameon=False, fontsize=8)
    return figure, rows


def loop_path() -> tuple[Vector, Vector]:
    """Times and strains of the loop."""
    strain = np.array(LOOP_STRAIN)
    return np.concatenate([[0.0], np.cumsum(np.abs(np.diff(strain))) / LOOP_RATE]), strain


def random_steps(random: np.random.Generator) -> Input:
    """A sequence of steps with random amplitudes and durations."""
    times = [0.0]
    while times[-1] < DURATION:
        times.append(times[-1] + random.uniform(SHORTEST, LONGEST))
    times[-1] = DURATION
    J_eq = random.uniform(-LARGEST, LARGEST, len(times))
    J_eq[-1] = J_eq[-2]  # the end of the run, not another step
    return module_input(times, list(J_eq))


def fastest(model: Model, source: Input) -> float:
    """Median time of a run without samples between its ends [s]."""
    durations = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        simulate(model, source, np.array([0.0, DURATION]))
        durations.append(time.perf_counter() - start)
    return float(np.median(durations))


def compare_models(runs: int, seed: int, say: Say) -> Campaign:
    """The random runs with both models; all numbers."""
    random = np.random.default_rng(seed)
    seconds: dict[str, list[float]] = {'hybrid': [], 'mas': []}
    errors: dict[str, list[float]] = {'hybrid': [], 'mas': []}
    difference: dict[str, list[float]] = {'alpha': [], 'alpha rms': [], 'U_y': [], 'T': []}
    example = None
    for number in range(runs):
        source = random_steps(random)
        pair = {}
        for kind, rtol in SPEED_RTOL.items():
            pair[kind] = simulate(module(kind, EXACT_RTOL), source, 20.0)
            quick = simulate(module(kind, rtol), source, 20.0)
            errors[kind].append(float(np.degrees(np.abs(quick['alpha_rad'] - pair[kind]['alpha_rad']).max())))
            seconds[kind].append(fastest(module(kind, rtol), source))
        gap = np.degrees(pair['hybrid']['alpha_rad'] - pair['mas']['alpha_rad'])
        difference['alpha'].append(float(np.abs(gap).max()))
        difference['alpha rms'].append(float(np.sqrt(np.mean(gap**2))))
        difference['U_y'].append(float(np.abs(pair['hybrid']['U_y_m'] - pair['mas']['U_y_m']).max()))
        difference['T'].append(float(np.abs(pair['hybrid']['T_1_K'] - pair['mas']['T_1_K']).max()))
        example = example or (source, pair['hybrid'], pair['mas'])
        say(f'random run {number + 1} of {runs}')
    assert example is not None
    arrays = [{name: np.array(values) for name, values in group.items()} for group in (seconds, errors, difference)]
    return Campaign(arrays[0], arrays[1], arrays[2], example)


def draw_example(campaign: Campaign) -> Figure:
    """One random run: both models over each other, modes of the hybrid one, the command."""
    source, hybrid, mas = campaign.example
    held = np.searchsorted(source.times, hybrid.time, side='right') - 1
    columns = {'time_s': hybrid.time, 'J_eq_W': source.values[held, 0]}
    columns |= {name: hybrid[name] for name in ('alpha_rad', 'T_1_K', 'T_2_K', 'mode_1', 'mode_2')}
    figure = draw_run(columns)
    figure.axes[0].plot(mas.time, np.degrees(mas['alpha_rad']), color=RED, ls='--', lw=1.3, label='MAS')
    figure.axes[0].lines[0].set_label('hybrid')
    figure.axes[0].legend(loc='lower right', bbox_to_anchor=(1.0, 0.94), frameon=False, fontsize=8, ncols=2)
    return figure


def draw_hysteresis() -> tuple[Figure, float]:
    """alpha over J_eq for the slow sine (its second period), and the loop's width at J_eq = 0 [deg]."""
    t = np.linspace(0.0, 2 * SINE_PERIOD, 4001)
    source = module_input(list(t), list(SINE_AMPLITUDE * np.sin(2 * np.pi * t / SINE_PERIOD)), linear=True)
    run = simulate(module('hybrid', 1e-5), source, 2.0)
    second = run.time >= SINE_PERIOD
    J_eq, alpha = np.interp(run.time, t, source.values[:, 0])[second], np.degrees(run['alpha_rad'][second])
    figure = new_figure(5.5, 4.2)
    axis = figure.subplots()
    plain(axis)
    axis.plot(J_eq, alpha, color=BLUE)
    axis.set_xlabel('J_eq [W]')
    axis.set_ylabel('alpha [deg]')
    crossings = np.flatnonzero(np.abs(J_eq) < 0.02 * SINE_AMPLITUDE)
    return figure, float(alpha[crossings].max() - alpha[crossings].min())


def write_paper(folder: Path, runs: int, seed: int, say: Say) -> Path:
    """Figures and page into `folder`, which exists; the page's path."""
    say('stress-strain loops')
    loops, loop_rows = draw_loops()
    save(loops, folder / 'loops.png')
    campaign = compare_models(runs, seed, say)
    save(draw_example(campaign), folder / 'random.png')
    say('slow sine')
    hysteresis, width = draw_hysteresis()
    save(hysteresis, folder / 'hysteresis.png')
    page = folder / 'paper.md'
    page.write_text(page_text(loop_rows, campaign, runs, seed, width))
    return page


def page_text(loop_rows: list[str], campaign: Campaign, runs: int, seed: int, width: float) -> str:
    """The Markdown page."""
    hybrid, mas = (1e3 * campaign.seconds[kind] for kind in ('hybrid', 'mas'))
    gap = campaign.difference
    return TEMPLATE.read_text().format(
        runs=runs, seed=seed, machine=f'{platform.machine()}, Python {platform.python_version()}',
        path=' -> '.join(f'{100 * strain:g} %' for strain in LOOP_STRAIN), rate=LOOP_RATE, loops='\n'.join(loop_rows),
        duration=DURATION, largest=LARGEST, shortest=SHORTEST, longest=LONGEST,
        paper_hybrid=PAPER_HYBRID, paper_mas=PAPER_MAS, paper_saved=100 * (1 - PAPER_HYBRID / PAPER_MAS),
        hybrid_mean=hybrid.mean(), mas_mean=mas.mean(), saved=100 * (1 - hybrid.mean() / mas.mean()),
        hybrid_span=span(hybrid), mas_span=span(mas), hybrid_rtol=SPEED_RTOL['hybrid'], mas_rtol=SPEED_RTOL['mas'],
        exact=EXACT_RTOL, hybrid_error=campaign.own_error['hybrid'].max(), mas_error=campaign.own_error['mas'].max(),
        alpha=gap['alpha'].max(), alpha_rms=np.sqrt(np.mean(gap['alpha rms'] ** 2)), U_y=1e6 * gap['U_y'].max(),
        T=gap['T'].max(), sine=SINE_AMPLITUDE, period=SINE_PERIOD, width=width,
    )  # fmt: skip


def span(values: Vector) -> str:
    """Smallest to largest."""
    return f'{values.min():.2f} to {values.max():.2f}'
