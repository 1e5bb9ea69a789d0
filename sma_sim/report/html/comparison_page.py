"""The pages of `sma-sim compare` and `sma-sim fit`."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.data.display_units import DISPLAY_UNITS, ZERO_CELSIUS
from sma_sim.evidence.data.recording import Dataset
from sma_sim.evidence.estimation.calibrate import Calibration
from sma_sim.evidence.estimation.homogeneity import HomogeneityTest, RunStress
from sma_sim.evidence.residual_analysis.compare import ComparedRun, Comparison
from sma_sim.evidence.residual_analysis.paired_comparison import ErrorChange
from sma_sim.evidence.residual_analysis.state_density import StateDensity
from sma_sim.evidence.residual_analysis.summary import Summary
from sma_sim.model.config import Config
from sma_sim.model.structures.structure import Structure
from sma_sim.report.html.characterization import characterization_section
from sma_sim.report.html.data import data_section
from sma_sim.report.html.error_location import error_location_section
from sma_sim.report.html.figures import HELD_OUT, MEASURED, SHOWN, add_curve, interval_bars, new_figure, small
from sma_sim.report.html.page import Block, Bullets, Grid, Paragraph, Plot, Provenance, Section, Table, Tabs, write_page
from sma_sim.report.html.parameters import parameters_section
from sma_sim.report.html.runs import runs_section
from sma_sim.report.palette import BLUE, GREY, ORANGE, RED
from sma_sim.words.comparison import SCORE_HEADER, channel_row, score_groups

DENSITY_COLOURS = [[0.0, '#ffffff'], [0.02, '#e6eef6'], [0.3, '#9dbfdd'], [0.65, '#3d7fb5'], [1.0, '#0b3c66']]
DENSITY_WORDS = (
    'Residual (measured - model, in units of the noise) of all runs over what the model says at the same instant; '
    'darker: more samples. The line is the mean: where it leaves 0 the model has an error that depends on this state.'
)
MAX_LOOP_RUNS = 24
MAX_LOOP_POINTS = 1000
# By system: what is drawn over what (a state's column, its factor, its label, the least range).
LOOPS = {
    'module': (('alpha', 'J_eq_W', 1.0, 'J_eq [W]', 0.0),),
    'wire': (
        ('stress', 'strain', 100.0, 'strain [%]', 0.0),
        ('stress', 'T_K', 1.0, 'temperature of the model [deg C]', 3.0),
    ),
}
HOMOGENEITY_WORDS = (
    'Each run was fitted for its own sigma_MW0 and dsigma, everything else held at the calibration above. Marks: what each '
    'run says (open: held out); lines: what the model has for all of them.'
)


def comparison_sections(summary: Summary) -> list[Section]:
    """What there is to see of one configuration beside a dataset."""
    comparison = summary.comparison
    return [
        summary_section(summary),
        characterization_section(summary.tests, comparison.config),
        error_location_section(summary),
        runs_section(summary),
        hysteresis_section(comparison),
        states_section(summary.densities),
    ]


def write_fit_page(
    path: Path,
    found: Calibration,
    before: Mapping[str, float],
    summary: Summary,
    data: tuple[Dataset, Dataset | None],
    runs: HomogeneityTest | None = None,
    provenance: Provenance | None = None,
) -> None:
    """The page of a fit; `before`: the values that it started from, `runs`: a wire run by run. Raises UserError."""
    first, *others = comparison_sections(summary)
    parameters = [parameters_section(found, before), homogeneity_section(runs, found.config)]
    sections = [first, *parameters, *others, data_section(*data)]
    write_page(path, f'Calibration: {found.config.simulated_kinetics} model', sections, provenance)


def write_compare_page(
    path: Path,
    summaries: Sequence[Summary],
    pairs: Sequence[ErrorChange],
    data: tuple[Dataset, Dataset | None],
    provenance: Provenance | None = None,
) -> None:
    """The page of one or two configurations beside a dataset. Raises UserError."""
    sections = [changes_section(summaries, pairs)] if pairs else []
    for summary in summaries:
        label = f' ({summary.comparison.label})' if len(summaries) > 1 else ''
        sections += [Section(part.title + label, part.blocks) for part in comparison_sections(summary)]
    labels = ' and '.join(summary.comparison.label for summary in summaries)
    write_page(path, f'Comparison: {labels}', [*sections, data_section(*data)], provenance)


def changes_section(summaries: Sequence[Summary], pairs: Sequence[ErrorChange]) -> Section:
    """Errors of both, and their ratios with intervals."""
    rows = [
        (
            summary.comparison.label,
            summary.comparison.config.simulated_kinetics,
            *('' if math.isnan(error) else f'{error:.3f}' for error in (summary.fitted_error, summary.held_out_error)),
        )
        for summary in summaries
    ]
    return Section(
        'Side by side',
        [
            Table(('configuration', 'model', 'normalized RMSE', 'held out'), rows),
            Plot(ratio_figure(pairs), 'RMSE of the second over that of the first, 95 %; below 1 the second is nearer.'),
            Bullets([change.text for change in pairs]),
            Paragraph('Intervals: stretches of the runs are drawn again, the same ones for both.', 'note'),
        ],
    )


def ratio_figure(pairs: Sequence[ErrorChange]) -> object:
    """Ratios by channel."""
    figure = new_figure()
    for held, name, colour in ((False, 'fitted', SHOWN), (True, 'held out', HELD_OUT)):
        part = [change for change in pairs if change.held_out == held]
        if part:
            figure.add_scatter(
                x=[change.channel for change in part],
                y=[change.ratio for change in part],
                mode='markers',
                name=name,
                marker={'color': colour, 'size': 10},
                error_y=interval_bars(
                    [change.high - change.ratio for change in part], [change.ratio - change.low for change in part], colour
                ),
            )
    figure.add_hline(y=1.0, line={'color': GREY, 'dash': 'dot'})
    figure.update_yaxes(title_text='RMSE, second over first', rangemode='tozero')
    return figure


def states_section(densities: Mapping[str, Sequence[StateDensity]]) -> Section:
    """A tab per channel, a map per state."""
    tabs: list[tuple[str, list[Block]]] = [
        (channel, [Grid([Plot(density_map(density), height=260) for density in found])])
        for channel, found in densities.items()
    ]
    return Section('Residual over state', [Paragraph(DENSITY_WORDS), Tabs(tabs)])


def density_map(density: StateDensity) -> object:
    """Density of the residual over one state, with its mean."""
    figure = new_figure()
    figure.add_heatmap(
        x=small(density.state),
        y=small(density.residual),
        z=shades(np.log1p(density.counts)),
        colorscale=DENSITY_COLOURS,
        showscale=False,
        hovertemplate='%{x:.4g}, %{y:.2f} x noise<extra></extra>',
    )
    figure.add_scatter(
        x=small(density.mean_state),
        y=small(density.mean),
        mode='lines',
        line={'color': RED, 'width': 2},
        name='mean',
        hovertemplate='mean %{y:.2f} x noise at %{x:.4g}<extra></extra>',
    )
    figure.update_layout(showlegend=False, margin={'l': 46, 'r': 8, 't': 12, 'b': 42})
    figure.update_xaxes(title_text=density.label, showgrid=False)
    figure.update_yaxes(title_text='residual / noise', showgrid=False)
    return figure


def shades(values: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Values from 0 up as the shades that a screen can show."""
    found: NDArray[np.uint8] = np.rint(255.0 * values / values.max()).astype(np.uint8)
    return found


def hysteresis_section(comparison: Comparison) -> Section:
    """A figure per run and loop."""
    plots = [
        Plot(loop_figure(run, loop), run.name + (' (held out)' if run.held_out else ''), 300)
        for run in comparison.runs[:MAX_LOOP_RUNS]
        for loop in LOOPS.get(comparison.config.system, loops_of(comparison.config.structure))
        if loop[0] in run.measured and np.ptp(run.states[loop[1]]) > loop[4]
    ]
    if not plots:
        return Section('Hysteresis', [])
    words = 'Measured (grey) and model (blue).'
    if len(comparison.runs) > MAX_LOOP_RUNS:
        words += f' The first {MAX_LOOP_RUNS} of {len(comparison.runs)} runs.'
    return Section('Hysteresis', [Paragraph(words), Grid(plots)])


def loops_of(structure: Structure) -> tuple[tuple[str, str, float, str, float], ...]:
    """The loops of a structure: every coordinate over the first command."""
    command = structure.commands[0]
    return tuple((c.name, f'{command}_W', 1.0, f'{command} [W]', 0.0) for c in structure.coordinates)


def loop_figure(run: ComparedRun, loop: tuple[str, str, float, str, float]) -> object:
    """One loop."""
    channel, column, scale, label, _ = loop
    unit, factor = DISPLAY_UNITS[channel]
    known = np.flatnonzero(np.isfinite(run.measured[channel]))
    at = known[:: -(-len(known) // MAX_LOOP_POINTS)]
    x = small(scale * run.states[column][at] - (ZERO_CELSIUS if column.endswith('_K') else 0.0))
    figure = new_figure()
    for name, values, colour, width in (
        ('measured', run.measured[channel], MEASURED, 2.2),
        ('model', run.predicted[channel], SHOWN, 1.3),
    ):
        hover, line = f'%{{y:.4g}} {unit} at %{{x:.4g}}', {'color': colour, 'width': width}
        add_curve(figure, (x, factor * values[at]), name, line, hover)
    figure.update_layout(margin_r=10)
    figure.update_xaxes(title_text=label)
    figure.update_yaxes(title_text=f'{channel} [{unit}]')
    return figure


def homogeneity_section(found: HomogeneityTest | None, config: Config) -> Section:
    """Sentences and the transformation stresses over temperature; empty where runs cannot be told apart."""
    if found is None:
        return Section('Run by run', [])
    blocks: list[Block] = [
        Bullets(found.sentences),
        Plot(stress_figure(found.runs, config), HOMOGENEITY_WORDS, 380),
        Paragraph('p: how likely so much spread would be if the model were right (Cochran\'s Q).', 'note'),
    ]
    return Section('Run by run', blocks)


def stress_figure(runs: Sequence[RunStress], config: Config) -> object:
    """sigma_A, sigma_MW and sigma_M over temperature."""
    p = config.parameters
    kinds: tuple[tuple[str, str, float, Callable[[RunStress], float]], ...] = (
        ('sigma_A (to martensite)', RED, 0.5, lambda run: run.sigma_MW[0] + 0.5 * run.dsigma[0]),
        ('sigma_MW', ORANGE, 0.0, lambda run: run.sigma_MW[0]),
        ('sigma_M (to austenite)', BLUE, -0.5, lambda run: run.sigma_MW[0] - 0.5 * run.dsigma[0]),
    )
    figure = new_figure()
    ends = [min(run.temperature for run in runs), max(run.temperature for run in runs)]
    for name, colour, part, value in kinds:
        line = [
            1e-6 * (p['wire.sigma_MW0'] + p['wire.sigma_T'] * (T - p['wire.T0']) + part * p['wire.dsigma']) for T in ends
        ]
        figure.add_scatter(
            x=ends,
            y=line,
            mode='lines',
            line={'color': colour, 'width': 1.5},
            legendgroup=name,
            showlegend=False,
            hoverinfo='skip',
        )
        figure.add_scatter(
            x=[run.temperature for run in runs],
            y=[1e-6 * value(run) for run in runs],
            mode='markers',
            name=name,
            legendgroup=name,
            text=[run.name + (' (held out)' if run.held_out else '') for run in runs],
            marker={'color': colour, 'size': 10, 'symbol': ['circle-open' if run.held_out else 'circle' for run in runs]},
            hovertemplate='%{text}: %{y:.4g} MPa at %{x:.1f} K<extra></extra>',
        )
    figure.update_xaxes(title_text='temperature [K]')
    figure.update_yaxes(title_text='stress [MPa]')
    return figure


def summary_section(summary: Summary) -> Section:
    """Totals, the scores as a figure and as a table, errors of every run."""
    runs = summary.comparison.runs
    held = [run.name for run in runs if run.held_out]
    words = f'Normalized RMSE {summary.fitted_error:.3g} on {count(len(runs) - len(held))}'
    if held:
        words += f', {summary.held_out_error:.3g} on {count(len(held))} held out ({", ".join(held)})'
    note = (
        'Normalized RMSE is the root mean square of measured - model, divided by the noise of the sensor: 1 is as near as '
        'a model can be. Whiteness is the p-value of Ljung and Box over 20 lags: small means that residuals follow each '
        'other (neighbours: their correlation), so something is missing in the model or in the measurement.'
    )
    rows = [channel_row(kind, score) for kind, part in score_groups(summary) for score in part]
    blocks: list[Block] = [
        Paragraph(words + '.', 'lead'),
        Plot(score_figure(summary), height=300),
        Table(SCORE_HEADER, rows),
        Paragraph(note, 'note'),
        run_table(summary),
    ]
    return Section('How well it fits', blocks)


def count(runs: int) -> str:
    """So many runs."""
    return f'{runs} run' + ('' if runs == 1 else 's')


def score_figure(summary: Summary) -> object:
    """Normalized RMSE by channel."""
    figure = new_figure()
    for (kind, part), colour in zip(score_groups(summary), (SHOWN, HELD_OUT), strict=False):
        figure.add_bar(
            x=[score.channel for score in part],
            y=[round(score.over_noise, 4) for score in part],
            name=kind,
            marker_color=colour,
            hovertemplate='%{x}: %{y:.3f} x noise',
        )
    figure.add_hline(y=1.0, line={'color': GREY, 'dash': 'dot'})
    figure.update_layout(barmode='group', bargap=0.35)
    figure.update_yaxes(title_text='normalized RMSE', rangemode='tozero')
    return figure


def run_table(summary: Summary) -> Table:
    """Normalized RMSE of every run by channel."""
    channels = summary.comparison.channels
    rows = []
    for run in summary.comparison.runs:
        found = summary.runs[run.name]
        cells = [f'{found[name].over_noise:.3f}' if name in found else '' for name in channels]
        label = run.name + (' (held out)' if run.held_out else '')
        rows.append((label, *cells, f'{summary.run_error(run.name):.3f}'))
    return Table(('run', *channels, 'all'), rows, 'Normalized RMSE of every run')
