"""What the jobs of a session do: the work of the commands, on a version and the recordings of the session."""

from __future__ import annotations

import shlex
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sma_sim.evidence.data.recording import Dataset, Recording, in_order
from sma_sim.evidence.data.tables import write_whole
from sma_sim.evidence.diagnosis.diagnose import diagnose
from sma_sim.evidence.diagnosis.review import reviewed
from sma_sim.evidence.estimation.calibrate import FitOptions, calibrate, limits_from
from sma_sim.evidence.estimation.executors import executor_or_threads
from sma_sim.evidence.estimation.interruption import stoppable
from sma_sim.evidence.estimation.prepared_fit import started_from_curves
from sma_sim.evidence.estimation.search_context import OnModel, silent_model
from sma_sim.evidence.model_selection.nominal_fit import NOMINAL_STARTS, DiagnosisRequest
from sma_sim.evidence.residual_analysis.compare import Comparison, compare
from sma_sim.evidence.residual_analysis.summary import summarize
from sma_sim.explore.events import EventLog
from sma_sim.explore.jobs import COMMANDS, CURVES, PARAMETERS, REPORT, RESULT, SUMMARY, Job, write_curves
from sma_sim.explore.session_files import VERSIONS, read_settings
from sma_sim.model.config import Config, read_config
from sma_sim.model.errors import UserError
from sma_sim.model.given import effect_folders_of
from sma_sim.report.html.comparison_page import write_compare_page
from sma_sim.report.html.diagnosis_page import write_diagnosis_page
from sma_sim.report.html.page import Provenance
from sma_sim.solver.first_start import announce_compilation
from sma_sim.solver.inputs import inputs_at
from sma_sim.words.comparison import comparison_result
from sma_sim.words.diagnosis_data import as_data
from sma_sim.words.diagnosis_text import as_text
from sma_sim.words.json_values import write_json
from sma_sim.words.repair_notes import grouped_notes
from sma_sim.workflow.candidates import candidate_effects
from sma_sim.workflow.code_folders import folders_from
from sma_sim.workflow.data_request import DataRequest
from sma_sim.workflow.diagnosis import command_between, confounded, write_improved
from sma_sim.workflow.fit import reviewed_fit, write_fitted


@dataclass(frozen=True)
class WorkOrder:
    """A job with its session's folder, and where it tells how it proceeds."""

    session: Path
    job: Job
    log: EventLog

    @property
    def file(self) -> Path:
        """The parameter file of the version that the job is about."""
        return self.session / VERSIONS / f'{self.job.version:04}.yaml'

    @property
    def request(self) -> DataRequest:
        """The recordings. Raises UserError for a session without any."""
        request = read_settings(self.session)
        if request is None:
            raise UserError(f'{self.session} has no recordings')
        return request

    def config(self) -> Config:
        """The version's configuration."""
        return read_config(self.file)

    def read(self, is_fitted: bool = True) -> tuple[Config, Dataset, Dataset | None]:
        """The configuration, with starts from curves where there are any, the recordings to fit, and those held out."""
        config, request = self.config(), self.request
        self.log.progress('reading the recordings')
        fitted, held_out = request.split(request.read(config))
        announce_compilation(self.log.progress)
        return started_from_curves(fitted, config, is_fitted)[0], fitted, held_out

    def effect_folders(self) -> list[Path]:
        """The folders of the user's effects."""
        return effect_folders_of(self.file, ())

    def provenance(self) -> Provenance:
        """What makes the report of this job: the command that does the same, on the version's parameter file."""
        verb = COMMANDS[self.job.stage]
        words = ['sma-sim', verb, *self.request.options(), '--config', str(self.file), *self.job.command_options()]
        text = self.file.read_text(encoding='utf-8')
        return Provenance(shlex.join(words), {str(self.file): text}, time.monotonic() - self.job.age)

    def output(self, name: str) -> Path:
        """Where a result goes."""
        return self.job.folder / name

    def option(self, name: str, default: Any) -> Any:
        """An option of the job."""
        return self.job.options.get(name, default)


def check(order: WorkOrder) -> bool:
    """Read the recordings."""
    request = order.request
    order.log.progress('reading the recordings')
    dataset = request.read(order.config())
    held_out = request.split(dataset)[1]
    write_json(order.output(RESULT), dataset_data(dataset, held_out))
    curves = {
        f'{one.name}|{name}': values
        for one in dataset.recordings
        for name, values in {'time': one.time, **{f'measured.{c}': v for c, v in one.channels.items()}}.items()
    }
    write_curves(order.output(CURVES), curves)
    return False


def dataset_data(dataset: Dataset, held_out: Dataset | None) -> dict[str, Any]:
    """What was read, SI units: ``runs``, ``noise_std`` by channel and ``notes`` in words."""
    names = {recording.name for recording in held_out.recordings} if held_out else set()
    return {
        'system': dataset.system,
        'runs': [run_data(recording, recording.name in names) for recording in dataset.recordings],
        'noise_std': {name: dataset.noise_std[name] for name in in_order(dataset.noise_std, dataset.system)},
        'notes': grouped_notes([dataset]),
    }


def run_data(recording: Recording, held_out: bool) -> dict[str, Any]:
    """One run: its time, its channels with the samples that are missing, its input."""
    steps = np.diff(recording.time)
    inputs = inputs_at(recording.source, recording.time)
    return {
        'name': recording.name,
        'held_out': held_out,
        'samples': len(recording.time),
        'begin': float(recording.time[0]),
        'end': float(recording.time[-1]),
        'sample_time': float(np.median(steps)) if len(steps) else None,
        'longest_gap': float(steps.max()) if len(steps) else None,
        'channels': {name: range_data(values) for name, values in recording.channels.items()},
        'inputs': {name: range_data(values) for name, values in inputs.items()},
        'notes': list(recording.notes),
    }


def range_data(values: Any) -> dict[str, Any]:
    """Samples that are there and missing, the least and the largest value."""
    known = values[np.isfinite(values)]
    return {
        'samples': len(known),
        'missing': len(values) - len(known),
        'least': float(known.min()) if len(known) else None,
        'largest': float(known.max()) if len(known) else None,
    }


def compare_version(order: WorkOrder) -> bool:
    """As ``sma-sim compare``."""
    config, fitted, held_out = order.read(is_fitted=False)
    order.log.progress('comparing the model with the recordings')
    with executor_or_threads(None) as executor:
        comparison = compare(fitted, config, held_out, str(order.file), True, executor)
    summary = summarize(comparison)
    write_json(order.output(RESULT), comparison_result([summary], (), fitted.noise_std))
    write_curves(order.output(CURVES), curves_of(comparison))
    write_compare_page(order.output(REPORT), [summary], (), (fitted, held_out), order.provenance())
    return False


def calibrate_version(order: WorkOrder) -> bool:
    """As ``sma-sim fit``."""
    config, fitted, held_out = order.read()
    order.log.progress('calibrating the model')
    with executor_or_threads(None) as executor:
        found = calibrate(fitted, config, fit_options(order.job.options), executor, order.log.iteration)
        out = order.output(PARAMETERS)
        write_fitted(out, found, folders_from(out, order.effect_folders()))
        review = reviewed_fit(found, config, fitted, held_out, executor)
    write_json(order.output(RESULT), review.as_data())
    write_curves(order.output(CURVES), curves_of(review.summary.comparison))
    review.write_page(order.output(REPORT), order.provenance())
    return found.interrupted


def fit_options(options: Mapping[str, Any]) -> FitOptions:
    """The options of a calibration: ``free`` (names), ``model``, ``starts``, ``robust``, ``seed``, ``limits``."""
    free = options.get('free')
    return FitOptions(
        tuple(free) if free is not None else None,
        options.get('model'),
        int(options.get('starts', 2)),
        bool(options.get('robust', False)),
        int(options.get('seed', 0)),
        limits=limits_from(options.get('limits') or ()),
    )


def diagnose_version(order: WorkOrder) -> bool:
    """As ``sma-sim diagnose``."""
    _, fitted, held_out = order.read()  # a diagnosis starts from curves itself, once faults of the set-up are corrected
    request = diagnosis_request(order.job.options, tuple(order.effect_folders()), order.log.model)
    with stoppable():  # also while files are written: the steps so far are to be in all of them
        with executor_or_threads(None) as executor:
            found = diagnose(fitted, order.config(), held_out, request, executor, order.log.progress)
        text = '\n'.join(as_text(found)) + '\n'
        write_whole(order.output(SUMMARY), lambda file: file.write(text))
        out = order.output(PARAMETERS)
        written = write_improved(out, found, folders_from(out, order.effect_folders()))
        rivals = confounded(found)
        given = [*order.request.options(), '--config', str(order.file)]
        command = command_between(rivals, [], given, found) if rivals else ''
        offered = {'next': {'between': list(rivals), 'command': command}} if rivals else {}
        write_json(order.output(RESULT), as_data(found, written) | offered)
        review = reviewed(found, fitted, held_out, order.config())
        write_curves(order.output(CURVES), curves_of(review.remaining.comparison))
        write_diagnosis_page(order.output(REPORT), review, command, order.provenance())
    return found.interrupted


def diagnosis_request(
    options: Mapping[str, Any], folders: tuple[Path, ...], on_model: OnModel = silent_model
) -> DiagnosisRequest:
    """The options of a diagnosis: ``model``, ``seed``, ``equation``, ``variants``, ``limits``."""
    fits = FitOptions(starts=NOMINAL_STARTS, limits=limits_from(options.get('limits') or ()))
    return DiagnosisRequest(
        options.get('model'),
        folders,
        int(options.get('seed', 0)),
        fits,
        bool(options.get('equation', True)),
        bool(options.get('variants', True)),
        on_model,
    )


def switch_candidates_on(order: WorkOrder) -> bool:
    """Every listed effect by itself, and its trace in the residuals."""
    config, fitted, _ = order.read(is_fitted=False)
    callbacks = (order.log.progress, lambda effect: order.log.write('candidate', **effect))
    with stoppable() as stop, executor_or_threads(None) as executor:
        names = order.option('effects', None)
        found = candidate_effects(fitted, config, order.effect_folders(), executor, callbacks, names, stop)
    write_json(order.output(RESULT), found.as_data())
    curves: dict[str, Any] = {f'{run}|time': times for run, times in found.times.items()}
    for effect in found.effects:
        for run, traces in effect.traces.items():
            names = [f'{run}|trace.{effect.name}.{channel}' for channel in found.channels[run]]
            curves |= dict(zip(names, traces, strict=True))
    write_curves(order.output(CURVES), curves)
    return stop.is_set()


def curves_of(comparison: Comparison) -> dict[str, Any]:
    """Every run's time, measurement, model, noise states (k,) and nuisances, named ``run|what``."""
    curves: dict[str, Any] = {}
    for run in comparison.runs:
        curves[f'{run.name}|time'] = run.time
        for channel in run.measured:
            curves[f'{run.name}|measured.{channel}'] = run.measured[channel]
            curves[f'{run.name}|model.{channel}'] = run.predicted[channel]
            curves[f'{run.name}|noise.{channel}'] = np.array(run.noise[channel])
        curves |= {f'{run.name}|state.{name}': values for name, values in run.states.items()}
        curves[f'{run.name}|nuisance.delay'] = np.array(run.nuisance.delay)
        curves[f'{run.name}|nuisance.start'] = np.array(run.nuisance.start, float)
        curves |= {
            f'{run.name}|beginning.{kind}': np.array(values, float) for kind, values in run.nuisance.beginning.parts.items()
        }
        curves[f'{run.name}|nuisance.switches'] = np.array(run.nuisance.switches, float)
    return curves


WORK: dict[str, Callable[[WorkOrder], bool]] = {
    'check': check,
    'compare': compare_version,
    'calibrate': calibrate_version,
    'diagnose': diagnose_version,
    'candidates': switch_candidates_on,
}
