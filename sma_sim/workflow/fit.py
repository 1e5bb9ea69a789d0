"""A fit from the calibration to what is written of it: held-out runs, remarks, plain data, parameter file, page."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from sma_sim.evidence.data.recording import Dataset
from sma_sim.evidence.data.tables import write_whole
from sma_sim.evidence.estimation.calibrate import Calibration
from sma_sim.evidence.estimation.held_out_prediction import RunFit, evaluate_held_out
from sma_sim.evidence.estimation.homogeneity import HomogeneityTest, homogeneity_test
from sma_sim.evidence.residual_analysis.compare import compared_calibration
from sma_sim.evidence.residual_analysis.summary import Summary, summarize
from sma_sim.model.config import Config
from sma_sim.report.html.comparison_page import write_fit_page
from sma_sim.report.html.page import Provenance
from sma_sim.words.comparison import comparison_data
from sma_sim.words.fit_data import fit_result_data
from sma_sim.workflow.code_folders import parameter_file_at


@dataclass(frozen=True)
class FitReview:
    """A calibration beside its data: `start` is the model that it began with, `predicted` the runs that were held out,
    `runs` a wire run by run where there are several runs."""

    found: Calibration
    start: Config
    fitted: Dataset
    held_out: Dataset | None
    predicted: tuple[RunFit, ...]
    runs: HomogeneityTest | None

    @cached_property
    def summary(self) -> Summary:
        """All that the comparison of the fitted model with the recordings says."""
        return summarize(compared_calibration(self.found, self.fitted, self.held_out, self.predicted, 'fitted'))

    def as_data(self) -> dict[str, Any]:
        """The result for programs; SI units."""
        further = {'run_by_run': asdict(self.runs) if self.runs else None, 'comparison': comparison_data(self.summary)}
        return fit_result_data(self.found, self.predicted, self.fitted) | further

    def write_page(self, path: Path, provenance: Provenance | None = None) -> None:
        """Write the HTML report. Raises UserError."""
        data = (self.fitted, self.held_out)
        write_fit_page(path, self.found, self.start.values, self.summary, data, self.runs, provenance)


def reviewed_fit(
    found: Calibration, start: Config, fitted: Dataset, held_out: Dataset | None, executor: Executor
) -> FitReview:
    """Predict what was held out, and look at a wire run by run."""
    predicted = predict_held_out(found, held_out, executor)
    return FitReview(found, start, fitted, held_out, predicted, runs_of_wire(found, fitted, held_out, executor))


def predict_held_out(found: Calibration, held_out: Dataset | None, executor: Executor) -> tuple[RunFit, ...]:
    """The runs that were held out, unless the fit was stopped."""
    if held_out is None or found.interrupted:
        return ()
    return evaluate_held_out(found.config, held_out, found.delay, executor)


def runs_of_wire(
    found: Calibration, fitted: Dataset, held_out: Dataset | None, executor: Executor
) -> HomogeneityTest | None:
    """A wire run by run, where there are several runs on its bench and the fit was not stopped."""
    if found.config.system != 'wire' or found.interrupted or fitted.benches != {'wire'}:
        return None
    return homogeneity_test(found.config, fitted, held_out, executor)


def write_fitted(path: Path, found: Calibration, folders: Sequence[str]) -> None:
    """Write the parameter file, with a line on where it comes from; `folders` are those of the user's effects."""
    names = ', '.join(fit.name for fit in found.runs)
    origin = f'# Fitted by sma-sim fit to {names}: normalized RMSE {found.error:.4g}, delay {1e3 * found.delay:.3g} ms.\n'
    text = origin + parameter_file_at(path, found.config, folders)
    write_whole(path, lambda file: file.write(text))
