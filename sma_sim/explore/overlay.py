"""The recordings of a session beside any model, within milliseconds: while a slider moves, and to the digits of `compare`.

What is unknown about the recordings (delay, starts, switching instants) is estimated for a model by `settle`, in seconds, or
was by a comparison: then all numbers are those of ``sma-sim compare``. Else it is that of the model looked at before, and
they are a preview.
"""

from __future__ import annotations

import math
from collections import OrderedDict
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from threading import Lock
from typing import Any

import numpy as np

from sma_sim.evidence.data.display_units import DISPLAY_UNITS
from sma_sim.evidence.data.recording import CHANNEL_COLUMNS, Dataset, Recording, in_order
from sma_sim.evidence.estimation.executors import executor_or_threads
from sma_sim.evidence.estimation.prepared_fit import started_from_curves
from sma_sim.evidence.estimation.residuals import FitData, Nuisance, fit_data
from sma_sim.evidence.residual_analysis.compare import ComparedRun, compare, run_beside_model
from sma_sim.evidence.residual_analysis.metrics import error_over_noise, pooled_over_channels
from sma_sim.explore.decimation import decimated
from sma_sim.explore.packing import Numbers
from sma_sim.explore.request_values import json_number
from sma_sim.explore.stages import Engine
from sma_sim.model.arrays import Vector
from sma_sim.model.config import Config, flat_parameters
from sma_sim.model.errors import UserError
from sma_sim.report.run_panels import curve_of

Nuisances = dict[str, Nuisance]
KEPT = 4  # models whose runs are kept for the next closer look
SETTLED_KEPT = 50  # models whose delay and starts are kept


@dataclass(frozen=True)
class PreparedRuns:
    """All recordings, those to fit and those held out; all of them made ready for many models."""

    dataset: Dataset
    fitted: Dataset
    held_out: Dataset | None
    runs: tuple[tuple[Recording, FitData], ...]


@dataclass(frozen=True)
class Shown:
    """All runs beside a model of a system, those held out last; `exact`: delay and starts were estimated for this model."""

    system: str
    runs: tuple[ComparedRun, ...]
    exact: bool

    def part(self, held_out: bool) -> tuple[ComparedRun, ...]:
        """The runs that were held out, or the others."""
        return tuple(run for run in self.runs if run.held_out == held_out)


@dataclass(frozen=True)
class View:
    """What is drawn: the window [s], None for all; the width in pixels; of ``measured``, ``model`` and ``residual`` (over
    noise) those that are asked for."""

    window: tuple[float, float] | None
    pixels: int
    curves: tuple[str, ...]


class Overlay:
    """The recordings of an engine's session beside models. All methods may be called from any thread."""

    def __init__(self, engine: Engine) -> None:
        self._engine, self._lock, self._settling = engine, Lock(), Lock()
        self._prepared: tuple[str, PreparedRuns] | None = None
        self._shown: OrderedDict[tuple[str, bool], Shown] = OrderedDict()
        self._settled: OrderedDict[str, Nuisances] = OrderedDict()
        self._near: tuple[str, Nuisances] | None = None  # of the model that was last shown with its own, and of which data
        self._threads = ThreadPoolExecutor(thread_name_prefix='overlay')

    def beside(self, config: Config) -> Shown:
        """All runs beside a model. Raises UserError where it cannot be run, and where nothing was compared yet."""
        with self._lock:
            key = self._key(config)
            known, exact = self._nuisances(config, key)
            if (key, exact) not in self._shown or not exact:
                self._shown[key, exact] = Shown(config.structure.name, self._runs(config, known), exact)
                while len(self._shown) > KEPT:
                    self._shown.popitem(last=False)
            self._shown.move_to_end((key, exact))
            return self._shown[key, exact]

    def settle(self, config: Config) -> None:
        """Estimate delay and starts for a model, as ``compare`` does. Raises UserError."""
        key = self._key(config)
        with self._settling:
            if key in self._settled:
                return
            with self._lock:
                prepared = self._ready(config)
            started = started_from_curves(prepared.fitted, config, is_fitted=False)[0]
            with executor_or_threads(None) as executor:
                found = compare(prepared.fitted, started, prepared.held_out, executor=executor)
            self._settled[key] = {run.name: run.nuisance for run in found.runs}
            while len(self._settled) > SETTLED_KEPT:
                self._settled.popitem(last=False)

    def _key(self, config: Config) -> str:
        """What tells whether recordings and model are the same."""
        return repr((self._engine.data(), sorted(flat_parameters(config).items(), key=lambda item: item[0])))

    def _nuisances(self, config: Config, key: str) -> tuple[Nuisances, bool]:
        """What is unknown of each run, and whether it was estimated for this model. Raises UserError."""
        engine, data = self._engine, self._engine.data()
        if key in self._settled:
            self._near = data, self._settled[key]
            return self._settled[key], True
        job = engine.latest('compare')
        if job is not None and 'curves' in job.files and self._key(engine.session.config(job.version)) == key:
            self._near = data, job.nuisances(config)
            return self._near[1], True
        if self._near is None or self._near[0] != data:
            job = engine.last_comparison()
            if job is None:
                raise UserError('compare the model with the recordings first')
            self._near = data, job.nuisances(config)
        return self._near[1], False

    def _runs(self, config: Config, known: Nuisances) -> tuple[ComparedRun, ...]:
        """All runs beside a model with what is unknown of them."""
        prepared = self._ready(config)
        started = started_from_curves(prepared.fitted, config, is_fitted=False)[0]
        held_out = [one.name for one in prepared.held_out.recordings] if prepared.held_out else []

        def one(pair: tuple[Recording, FitData]) -> ComparedRun:
            nuisance = known.get(pair[0].name, Nuisance())
            return run_beside_model(started, pair, nuisance, prepared.dataset.noise_std, with_states=False)

        found = [replace(run, held_out=run.name in held_out) for run in self._threads.map(one, prepared.runs)]
        return tuple(sorted(found, key=lambda run: run.held_out))

    def _ready(self, config: Config) -> PreparedRuns:
        """The recordings as `compare` reads them with a model, read once as long as they stay the same."""
        request = self._engine.session.data
        if request is None:
            raise UserError('this session has no recordings')
        rtol = config.parameters['solver.rtol']
        key = repr((self._engine.data(), config.system, config.parameters['environment.T_E'], rtol))
        if self._prepared is None or self._prepared[0] != key:
            dataset = request.read(config)
            fitted, held_out = request.split(dataset)
            runs = tuple((one, fit_data(one, dataset.noise_std, floor=rtol)) for one in dataset.recordings)
            self._prepared = key, PreparedRuns(dataset, fitted, held_out, runs)
        return self._prepared[1]


def overlay_data(shown: Shown, view: View, numbers: Numbers) -> dict[str, Any]:
    """Runs beside a model for the page."""
    names = in_order({name for run in shown.runs for name in run.measured}, shown.system)
    runs = [
        {
            'name': run.name,
            'held_out': run.held_out,
            'begin': float(run.time[0]),
            'end': float(run.time[-1]),
            'error': json_number(pooled(run_errors := errors_of((run,), names))),
            'errors': run_errors,
            'channels': {name: curves_of_channel(run, name, view, numbers) for name in names if name in run.measured},
        }
        for run in shown.runs
    ]
    parts = {name: errors_of(shown.part(held_out), names) for name, held_out in (('train', False), ('held_out', True))}
    return {
        'runs': runs,
        'channels': [channel_data(name, shown) for name in names],
        'parts': parts,
        'error': {name: json_number(pooled(errors)) for name, errors in parts.items()},
        'exact': shown.exact,
    }


def errors_of(runs: tuple[ComparedRun, ...], channels: list[str]) -> dict[str, float]:
    """Normalized RMSE by channel, of those that are known."""
    found = {name: error_over_noise(runs, name) for name in channels}
    return {name: error for name, error in found.items() if math.isfinite(error)}


def pooled(errors: dict[str, float]) -> float:
    """The normalized RMSE of all channels, NaN without any."""
    return pooled_over_channels(list(errors.values()))


def channel_data(name: str, shown: Shown) -> dict[str, Any]:
    """A channel: how it is drawn, and its noise."""
    noise = next((run.noise[name] for run in shown.runs if name in run.noise), None)
    return {'name': name, 'noise': noise, **display_of(name)}


def display_of(channel: str) -> dict[str, Any]:
    """How a channel is drawn: label with unit, colour, factor and offset from SI units; the unit of its deviations."""
    label, (_, _, colour, factor, offset) = curve_of(CHANNEL_COLUMNS[channel]) or (channel, ('', '', '', 1.0, 0.0))
    axis, (unit, scale) = label if label.startswith(channel) else f'{channel}: {label}', DISPLAY_UNITS[channel]
    deviation = {'unit': unit, 'factor': scale}
    return {'label': axis, 'colour': colour, 'factor': factor, 'offset': offset, 'deviation': deviation}


def curves_of_channel(run: ComparedRun, name: str, view: View, numbers: Numbers) -> dict[str, list[list[int]]]:
    """Curves as places among the numbers: [x, y] each."""
    part = slice(None)
    if view.window is not None:
        first, last = np.searchsorted(run.time, view.window)
        part = slice(max(int(first) - 1, 0), int(last) + 1)
    time, curves = run.time[part], dict[str, Vector]()
    if 'residual' in view.curves:
        curves['residual'] = run.residual(name)[part] / run.noise[name]
    if 'measured' in view.curves:
        curves['measured'] = run.measured[name][part]
    if 'model' in view.curves:
        curves['model'] = run.predicted[name][part]
    found = {}
    for what, values in curves.items():
        at = decimated(time, values, view.pixels)
        found[what] = [numbers.put(time[at]), numbers.put(values[at])]
    return found
