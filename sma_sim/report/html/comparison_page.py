"""The pages of `sma-sim compare` and `sma-sim fit`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from sma_sim.evidence.data.recording import Dataset
from sma_sim.evidence.estimation.calibrate import Calibration
from sma_sim.evidence.estimation.homogeneity import HomogeneityTest
from sma_sim.evidence.residual_analysis.paired_comparison import ErrorChange
from sma_sim.evidence.residual_analysis.summary import Summary
from sma_sim.report.html.changes import changes_section
from sma_sim.report.html.characterization import characterization_section
from sma_sim.report.html.data import data_section
from sma_sim.report.html.error_location import error_location_section
from sma_sim.report.html.homogeneity import homogeneity_section
from sma_sim.report.html.hysteresis import hysteresis_section
from sma_sim.report.html.page import Provenance, Section, write_page
from sma_sim.report.html.parameters import parameters_section
from sma_sim.report.html.runs import runs_section
from sma_sim.report.html.states import states_section
from sma_sim.report.html.summary import summary_section


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
