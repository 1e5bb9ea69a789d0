"""The page of `sma-sim latent`: the missing quantity over time, and how all ports compare."""

from __future__ import annotations

from pathlib import Path

from sma_sim.evidence.data.recording import Dataset
from sma_sim.evidence.latent_input.results import InputFinding, LatentInputs
from sma_sim.report.html.data import data_section
from sma_sim.report.html.figures import SHOWN, add_band, add_curve, new_figure, small
from sma_sim.report.html.page import Block, Bullets, Paragraph, Plot, Provenance, Section, Table, Tabs, write_page
from sma_sim.report.palette import GREY
from sma_sim.words.latent_input import RANKING_HEADER, ranking_rows, verdict_sentences

TIME_COURSE_HEIGHT = 150  # height of one input over time [px]
COLUMN_NOTES = (
    'error left: over noise, of all data; in gaps: of blocks of time that were left out in turn; values: how many '
    'numbers were estimated, effectively; removed per value: squared error over noise that it removes in gaps, per '
    'such number; '
    'evidence: logarithm of the odds against nothing missing. Of the ports that leave nearly as little as any the '
    'most credible force, heat or power comes first'
)


def write_latent_page(
    path: Path, found: LatentInputs, training: Dataset, held_out: Dataset | None, provenance: Provenance | None = None
) -> None:
    """The page. Raises UserError."""
    sections = [missing_section(found), inputs_section(found), data_section(training, held_out)]
    write_page(path, f'Missing quantity: {quantity(found)}', sections, provenance)


def quantity(found: LatentInputs) -> str:
    """What is missing, in words."""
    ports = {finding.name: finding.hypothesis.ports for finding in found.findings}.get(found.verdict, ())
    unknown = 'not known, stopped early' if found.verdict == 'stopped' else found.verdict
    return ' and '.join(port.description for port in ports) or unknown


def missing_section(found: LatentInputs) -> Section:
    """The verdict, and the error that each port leaves."""
    first, *rest = verdict_sentences(found)
    blocks: list[Block] = [Paragraph(first, 'lead')]
    if rest:
        blocks.append(Bullets([line.strip() for line in rest]))
    if found.findings:
        blocks += [
            Plot(error_figure(found), 'Normalized RMSE that each port leaves; 1 is the noise.', 300),
            Table(RANKING_HEADER, ranking_rows(found)),
            Paragraph(COLUMN_NOTES, 'note'),
        ]
    return Section('What is missing', blocks)


def error_figure(found: LatentInputs) -> object:
    """Normalized RMSE by port."""
    figure = new_figure()
    names = ['nothing', *(finding.name for finding in found.findings)]
    values = [found.error, *(finding.error for finding in found.findings)]
    figure.add_bar(x=names, y=values, marker={'color': [GREY, *[SHOWN] * len(found.findings)]}, name='normalized RMSE')
    figure.add_hline(y=1.0, line={'color': GREY, 'dash': 'dot'})
    figure.update_yaxes(title_text='normalized RMSE')
    return figure


def inputs_section(found: LatentInputs) -> Section:
    """A tab per hypothesis with its inputs over time."""
    tabs = [(finding.name, [input_plot(finding)]) for finding in found.findings if finding.inputs]
    words = 'What would have to act there for the model to meet the measurement, with its 95 % band (of noise, of what else '
    words += 'the model lacks, and of the choice of kinetics). Where zero lies within the band nothing is needed.'
    return Section('The missing quantity over time', [Paragraph(words), Tabs(tabs)] if tabs else [])


def input_plot(finding: InputFinding) -> Plot:
    """The inputs of one hypothesis, a row for each run and port."""
    figure = new_figure(len(finding.inputs), gap=0.2 / len(finding.inputs))
    for row, estimate in enumerate(finding.inputs, start=1):
        band = {'name': '95 %', 'legendgroup': 'band', 'showlegend': row == 1}
        add_band(figure, estimate.time, estimate.mean, estimate.band, row, 'rgba(0, 90, 181, 0.18)', **band)
        hover, line = f'%{{y:.3g}} {estimate.port.unit} at %{{x:.1f}} s', {'color': SHOWN, 'width': 1.5}
        add_curve(figure, (small(estimate.time), estimate.mean), 'estimate', line, hover, row, showlegend=row == 1)
        figure.add_hline(y=0.0, line={'color': GREY, 'width': 1}, row=row, col=1)
        figure.update_yaxes(
            title_text=f'{estimate.port.name}<br>{estimate.run} [{estimate.port.unit}]', automargin=True, row=row, col=1
        )
    figure.update_xaxes(title_text='time [s]', row=len(finding.inputs), col=1)
    words = ' and '.join(port.description for port in finding.hypothesis.ports)
    return Plot(figure, words, TIME_COURSE_HEIGHT * len(finding.inputs) + 90)
