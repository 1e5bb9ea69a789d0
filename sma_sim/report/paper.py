"""The paper's results again: its figures and numbers beside ours, as one folder with a Markdown page."""

from __future__ import annotations

import os
import platform
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from sma_sim.model.arrays import Vector
from sma_sim.report.palette import BLUE, GREY, RED
from sma_sim.report.run_figure import draw_run, panel_legend
from sma_sim.report.style import plain_axes, save, sized_figure
from sma_sim.solver.inputs import inputs_at
from sma_sim.solver.paper_experiments import (
    BATH,
    COMPARED_COLUMNS,
    EXACT_RTOL,
    LARGEST,
    LONGEST,
    LOOP_RATE,
    LOOP_STRAIN,
    MODEL_KINDS,
    REPEATS,
    RUN_LENGTH,
    SAMPLE_RATE,
    SHORTEST,
    SINE_AMPLITUDE,
    SINE_PERIOD,
    PaperResults,
    RandomRuns,
    SineResponse,
    StressStrainLoop,
    Timing,
)

PAPER_SECONDS = {'hybrid': 1.75, 'mas': 8.66}  # per run, section IV.B
TEMPLATE = Path(__file__).with_name('templates') / 'paper.md'
PAGE, FIGURES = 'paper.md', ('loops.png', 'random.png', 'hysteresis.png')
MODEL_LINES: dict[str, dict[str, Any]] = {
    'hybrid': {'color': BLUE, 'ls': '-', 'label': 'hybrid'},
    'mas': {'color': RED, 'ls': (0, (4, 2)), 'label': 'MAS'},
}
CHANNEL_LABELS = {
    'alpha_rad': ('alpha [deg]', 180.0 / np.pi),
    'U_x_m': ('U_x [um]', 1e6),
    'U_y_m': ('U_y [um]', 1e6),
    'T_1_K': ('T of wire 1 [K]', 1.0),
    'T_2_K': ('T of wire 2 [K]', 1.0),
}


def write_paper(folder: Path, results: PaperResults) -> Path:
    """Figures and page into `folder`, which exists; the page's path."""
    figures = (draw_loops(results.loops), draw_example(results.random), draw_sine(results.sine))
    for name, figure in zip(FIGURES, figures, strict=True):
        save(figure, folder / name)
    page = folder / PAGE
    page.write_text(paper_text(results), encoding='utf-8')
    return page


def draw_loops(loops: Sequence[StressStrainLoop]) -> Figure:
    """Both models over each other at each temperature, with the closed-form plateaus."""
    figure = sized_figure(9.0, 3.6)
    for axis, loop in zip(figure.subplots(1, len(loops), sharey=True), loops, strict=True):
        plain_axes(axis)
        for stress, name, place in zip(loop.closed_form, ('sigma_A', 'sigma_M'), ('bottom', 'top'), strict=True):
            axis.axhline(1e-6 * stress, color=GREY, lw=0.8, ls=':')
            offset = 2.0 if place == 'bottom' else -2.0
            axis.text(4.2, 1e-6 * stress + offset, f'{name} = {1e-6 * stress:.2f} MPa', va=place, ha='center', fontsize=8)
        for kind in MODEL_KINDS:
            axis.plot(100 * loop.strain, 1e-6 * loop.stress[kind], lw=1.4, **MODEL_LINES[kind])
        axis.set_title(f'T_E = {loop.T_E:g} K', fontsize=10)
        axis.set_xlabel('strain [%]')
    figure.axes[0].set_ylabel('stress [MPa]')
    figure.axes[0].set_ylim(0.0, 180.0)
    figure.axes[0].legend(frameon=False, fontsize=9, loc='upper left')
    return figure


def draw_example(random: RandomRuns) -> Figure:
    """One random run: both models over each other, modes of the hybrid one, the command."""
    source, pair = random.example
    hybrid, mas = pair['hybrid'], pair['mas']
    columns = {'time_s': hybrid.time, 'J_eq_W': inputs_at(source, hybrid.time)['J_eq_W']}
    columns |= {name: hybrid[name] for name in ('alpha_rad', 'T_1_K', 'T_2_K', 'mode_1', 'mode_2')}
    figure = draw_run(columns)
    angle = figure.axes[0]
    angle.lines[0].set_label('hybrid')
    angle.plot(mas.time, np.degrees(mas['alpha_rad']), lw=1.3, **MODEL_LINES['mas'])
    panel_legend(angle)
    return figure


def draw_sine(sine: SineResponse) -> Figure:
    """alpha over J_eq, with the sense in which the loop is run through."""
    figure = sized_figure(5.5, 4.2)
    axis = figure.subplots()
    plain_axes(axis)
    for kind in MODEL_KINDS:
        axis.plot(sine.J_eq, np.degrees(sine.alpha[kind]), lw=1.4, **MODEL_LINES[kind])
    alpha = np.degrees(sine.alpha['hybrid'])
    for part in (0.08, 0.42, 0.58, 0.92):
        k = int(part * len(alpha))
        tail, head = ((sine.J_eq[at], alpha[at]) for at in (k, k + 15))
        axis.annotate('', head, tail, arrowprops={'arrowstyle': '-|>', 'color': BLUE, 'mutation_scale': 16})
    axis.set_xlabel('J_eq [W]')
    axis.set_ylabel('alpha [deg]')
    axis.legend(frameon=False, fontsize=9)
    return figure


def paper_text(results: PaperResults) -> str:
    """The Markdown page."""
    random, sine = results.random, results.sine
    equal_error, equal_tolerance = random.timings
    inside_low, inside_high = results.plateau_offsets
    alpha = np.degrees(random.difference_of('alpha_rad')[2])
    return TEMPLATE.read_text(encoding='utf-8').format(
        runs=results.runs,
        seed=results.seed,
        machine=machine(),
        path=' -> '.join(f'{100 * strain:g} %' for strain in LOOP_STRAIN),
        rate=LOOP_RATE,
        bath=BATH,
        loops='\n'.join(loop_row(loop) for loop in results.loops),
        inside_low=1e-6 * inside_low,
        inside_high=1e-6 * inside_high,
        duration=RUN_LENGTH,
        largest=LARGEST,
        shortest=SHORTEST,
        longest=LONGEST,
        sample_rate=SAMPLE_RATE,
        differences='\n'.join(difference_row(random, name) for name in COMPARED_COLUMNS),
        alpha=alpha,
        alpha_part=100.0 * alpha / np.degrees(random.swing),
        exact=EXACT_RTOL,
        repeats=REPEATS,
        times='\n'.join([paper_row(), *timing_rows(equal_error), *timing_rows(equal_tolerance)]),
        paper_saved=saved(PAPER_SECONDS['hybrid'], PAPER_SECONDS['mas']),
        saved=mean_saved(equal_error),
        saved_default=mean_saved(equal_tolerance),
        sine=SINE_AMPLITUDE,
        period=SINE_PERIOD,
        width=np.degrees(sine.width('hybrid')),
        mas_width=np.degrees(sine.width('mas')),
        sine_gap=np.degrees(sine.largest_difference),
    )


def machine() -> str:
    """What the times depend on."""
    return f'{os.cpu_count()} cores {platform.machine()}, Python {platform.python_version()}'


def loop_row(loop: StressStrainLoop) -> str:
    """Closed-form and simulated plateaus of a temperature [MPa]."""
    numbers = [*loop.closed_form, *loop.plateaus['hybrid'], *loop.plateaus['mas']]
    return f'| {loop.T_E:g} | ' + ' | '.join(f'{1e-6 * number:.2f}' for number in numbers) + ' |'


def difference_row(random: RandomRuns, channel: str) -> str:
    """Mean, RMS and largest difference of the models in a channel."""
    label, factor = CHANNEL_LABELS[channel]
    return f'| {label} | ' + ' | '.join(f'{factor * number:.2g}' for number in random.difference_of(channel)) + ' |'


def paper_row() -> str:
    """The paper's times."""
    hybrid, mas = (PAPER_SECONDS[kind] for kind in MODEL_KINDS)
    return f'| paper (MATLAB, ode15s), mean | {hybrid} s | {mas} s | {saved(hybrid, mas):.0f} % |'


def timing_rows(timing: Timing) -> list[str]:
    """Tolerance, error and times of both models."""
    hybrid, mas = (1e3 * timing.seconds[kind] for kind in MODEL_KINDS)
    errors = ' | '.join(f'{timing.error[kind].max():.1e} deg' for kind in MODEL_KINDS)
    steps = ' | '.join(f'{timing.steps[kind].mean():.0f}' for kind in MODEL_KINDS)
    tolerances = ' | '.join(f'{timing.rtol[kind]:g}' for kind in MODEL_KINDS)
    return [
        f'| sma_sim, relative tolerance | {tolerances} | |',
        f'| ... its largest error of alpha | {errors} | |',
        f'| ... mean number of steps | {steps} | |',
        f'| ... mean time of a run | {hybrid.mean():.2f} ms | {mas.mean():.2f} ms | {mean_saved(timing):.0f} % |',
        f'| ... fastest to slowest run | {span(hybrid)} ms | {span(mas)} ms | |',
    ]


def saved(hybrid: float, mas: float) -> float:
    """Part of the MAS model's time that the hybrid one saves [%]."""
    return 100.0 * (1.0 - hybrid / mas)


def mean_saved(timing: Timing) -> float:
    """The same for the mean times over all runs."""
    return saved(*(float(timing.seconds[kind].mean()) for kind in MODEL_KINDS))


def span(values: Vector) -> str:
    """Smallest to largest."""
    return f'{values.min():.2f} to {values.max():.2f}'
