"""Section: the transformation stresses of a wire run by run, against the one line and the one width of the model."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from sma_sim.evidence.estimation.homogeneity import HomogeneityTest, RunStress
from sma_sim.model.config import Config
from sma_sim.report.html.figures import new_figure
from sma_sim.report.html.page import Block, Bullets, Paragraph, Plot, Section
from sma_sim.report.palette import BLUE, ORANGE, RED

HOMOGENEITY_WORDS = (
    'Each run was fitted for its own sigma_MW0 and dsigma, everything else held at the calibration above. Marks: what each '
    'run says (open: held out); lines: what the model has for all of them.'
)


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
