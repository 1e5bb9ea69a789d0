"""The model beside a dataset: residuals of every run with the model's states at the same instants.

Parameters stay as they are; only what is unknown about the recordings (delay, starts, sampled switching instants) is
estimated. A residual is measured - model throughout.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace

import numpy as np

from sma_sim.evidence.data.recording import CHANNEL_COLUMNS, Dataset, Recording, in_order
from sma_sim.evidence.data.train_test_split import pooled
from sma_sim.evidence.estimation.calibrate import Calibration, FitOptions, calibrate
from sma_sim.evidence.estimation.held_out_prediction import RunFit, evaluate_held_out, nuisances_of
from sma_sim.evidence.estimation.prepared_fit import check_data, on_leading_bench
from sma_sim.evidence.estimation.residuals import FitData, Nuisance, fit_data, model_columns
from sma_sim.evidence.estimation.search_context import silent_iteration
from sma_sim.evidence.residual_analysis.wire_states import with_derived_states
from sma_sim.model.archive import Saved
from sma_sim.model.argument_checks import checked
from sma_sim.model.arrays import Vector
from sma_sim.model.comparable import Comparable
from sma_sim.model.config import Config
from sma_sim.model.nearest import UnknownNameError, suggestion
from sma_sim.model.shown import Shown, listed


@dataclass(frozen=True, eq=False, repr=False)
class ComparedRun(Shown, Comparable):
    """One run beside the model, at its sample times `time` (k,) [s], SI units.

    `measured` and `predicted` (by the model): (k,) by channel, NaN where a sample is missing. `noise`: standard deviation
    by channel. `states`: the model's columns (file contract) and quantities derived from them
    (docs/explanation/residual-analysis.md), (k,). `system`: the bench of a wire, where it is not that of the model.
    """

    name: str
    held_out: bool
    time: Vector
    measured: Mapping[str, Vector]
    predicted: Mapping[str, Vector]
    noise: Mapping[str, float]
    states: Mapping[str, Vector]
    nuisance: Nuisance
    system: str = ''

    def residual(self, channel: str) -> Vector:
        """Measured - model (k,), NaN where a sample is missing. Raises UserError for a channel that there is not."""
        if channel not in self.measured:
            known = list(self.measured)
            raise UnknownNameError(
                f'no channel {channel!r}{suggestion(channel, known)}; the channels are {", ".join(known)}'
            )
        return self.measured[channel] - self.predicted[channel]

    def rmse(self, channel: str) -> float:
        """Root mean square of the residual of a channel (SI)."""
        return float(np.sqrt(np.nanmean(self.residual(channel) ** 2)))

    def facts(self) -> Mapping[str, str]:
        """What is to be known at a glance."""
        errors = (
            f'{CHANNEL_COLUMNS[name]} {self.rmse(name):.3g} ({self.rmse(name) / self.noise[name]:.3g} times the noise)'
            for name in self.measured
        )
        return {'run': f'{self.name}{", held out" if self.held_out else ""}', 'RMSE': listed(errors)}


@dataclass(frozen=True, repr=False)
class Comparison(Shown, Saved):
    """All runs of a dataset beside one configuration.

    Attributes
    ----------
    label
        What reports call the model.
    config, delay
        The model, and the delay of the recordings behind it [s].
    runs : tuple of ComparedRun
        The fitted runs, then those held out: measured and simulated channels, `residual`, `rmse`, states of the model.
    """

    label: str
    config: Config
    delay: float
    runs: tuple[ComparedRun, ...]

    @property
    def channels(self) -> tuple[str, ...]:
        """Channels that any run has, in the order of the file contract."""
        return tuple(in_order({name for run in self.runs for name in run.measured}, self.config.structure.name))

    @property
    def errors(self) -> Mapping[str, float]:
        """By channel, the root mean square of the residuals of all runs over the noise: 1 is perfect."""
        found = {}
        for name in self.channels:
            parts = [run.residual(name) / run.noise[name] for run in self.runs if name in run.measured]
            found[name] = float(np.sqrt(np.nanmean(np.concatenate(parts) ** 2)))
        return found

    def facts(self) -> Mapping[str, str]:
        """What is to be known at a glance; errors are root mean squares over the noise, 1 is perfect."""
        found = {'model': self.label} if self.label else {}
        errors = (f'{name} {error:.3g}' for name, error in self.errors.items())
        found |= {'recordings': listed(run.name for run in self.runs), 'normalized RMSE': listed(errors)}
        return found | {'delay': f'{1e3 * self.delay:.3g} ms'}

    def part(self, held_out: bool) -> tuple[ComparedRun, ...]:
        """The runs that were held out, or the others."""
        return tuple(run for run in self.runs if run.held_out == held_out)


@checked
def compare(
    dataset: Dataset,
    config: Config,
    held_out: Dataset | None = None,
    label: str = '',
    nuisances: bool = True,
    executor: Executor | None = None,
) -> Comparison:
    """Put a configuration as it is beside a dataset, and beside runs that are held out.

    Parameters
    ----------
    dataset : Dataset
        Recordings with their noise.
    config : Config
        The model; none of its parameters is changed.
    held_out : Dataset, optional
        Further recordings, whose delay is that of the others.
    label : str
        What reports call the model.
    nuisances : bool
        Whether the delay is estimated from the dataset, and the start from each run; else there is no delay, and runs start
        as the configuration says.
    executor : Executor, optional
        Where the simulations run; without it, threads on all cores.

    Returns
    -------
    Comparison
        Every run with measured and simulated channels, residuals and the states of the model.

    Raises
    ------
    UserError
        For recordings that cannot be compared.

    Examples
    --------
    >>> import sma_sim
    >>> command = sma_sim.module_input([0.0, 2.0, 15.0], [0.0, 10.0, 0.0])
    >>> run = sma_sim.simulate(sma_sim.Model(), command, 4.0)
    >>> recording = sma_sim.Recording('run1', 'module', run.time, {'alpha': run['alpha_rad']}, command)
    >>> dataset = sma_sim.Dataset((recording,), {'alpha': 3.5e-4})
    >>> sma_sim.compare(dataset, sma_sim.Config({'beam.E': 1.9e9})).errors['alpha'] > 3.0
    True
    """
    check_data(pooled(dataset, held_out), config)
    options = FitOptions(free=(), kinetics=config.simulated_kinetics, starts=1, intervals=False)
    config = on_leading_bench(config, dataset)
    if nuisances:
        found = calibrate(dataset, config, options, executor, silent_iteration)
        predicted = evaluate_held_out(config, held_out, found.delay, executor) if held_out is not None else ()
        return comparison_of_runs(config, found.delay, (dataset, found.runs), (held_out, predicted), label)
    return comparison_of_runs(config, 0.0, (dataset, ()), (held_out, ()), label)


def compared_calibration(
    found: Calibration, dataset: Dataset, held_out: Dataset | None, predicted: Sequence[RunFit], label: str
) -> Comparison:
    """A fitted model beside the dataset that it was fitted to, and beside runs that are held out."""
    return comparison_of_runs(
        found.config, found.delay, (dataset, found.runs), (held_out if predicted else None, predicted), label
    )


def comparison_of_runs(
    config: Config,
    delay: float,
    fitted: tuple[Dataset, Sequence[RunFit]],
    held_out: tuple[Dataset | None, Sequence[RunFit]],
    label: str,
) -> Comparison:
    """Runs with their nuisances (those of the configuration where there are none) under one configuration."""
    runs = []
    for (dataset, fits), is_held_out in ((fitted, False), (held_out, True)):
        if dataset is None:
            continue
        known = nuisances_of(delay, fits)
        compared_runs = [compared_run(dataset, k, config, known) for k in range(len(dataset.recordings))]
        runs += [replace(run, held_out=is_held_out) for run in compared_runs]
    return Comparison(label, config, delay, tuple(runs))


def compared_run(dataset: Dataset, k: int, config: Config, known: Mapping[str, Nuisance]) -> ComparedRun:
    """The `k`-th recording of a dataset. Raises SimulationError when the model cannot be run."""
    recording = dataset.recordings[k]
    run = fit_data(recording, dataset.noise_std, floor=config.parameters['solver.rtol'])
    return run_beside_model(config, (recording, run), known.get(recording.name, Nuisance()), dataset.noise_std)


def run_beside_model(
    config: Config,
    prepared: tuple[Recording, FitData],
    nuisance: Nuisance,
    noise_std: Mapping[str, float],
    with_states: bool = True,
) -> ComparedRun:
    """A recording, and the same made ready, beside a model; without `with_states` its states are left out.

    Raises SimulationError when the model cannot be run.
    """
    recording, run = prepared
    columns = model_columns(config, run, nuisance)
    return ComparedRun(
        name=recording.name,
        held_out=False,
        time=np.asarray(run.time),
        measured={name: np.asarray(recording.channels[name], float) for name in run.channels},
        predicted={name: columns[run.columns[name]] for name in run.channels},
        noise={
            name: float(np.sqrt(np.mean(weight[weight > 0.0] ** -2.0))) if weight.any() else noise_std[name]
            for name, weight in zip(run.channels, run.weight, strict=True)
        },
        states=with_derived_states(config, run.on_bench(config), run.time, columns) if with_states else {},
        nuisance=nuisance,
        system=recording.system,
    )
