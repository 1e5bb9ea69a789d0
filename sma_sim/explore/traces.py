"""A part of a residual: what the model does there, and which effects leave such a trace."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.estimation.residuals import Nuisance
from sma_sim.evidence.residual_analysis.compare import ComparedRun, Comparison
from sma_sim.evidence.residual_analysis.strata import dimensions
from sma_sim.evidence.residual_analysis.wire_states import wires_of
from sma_sim.explore.jobs import Job
from sma_sim.model.arrays import Vector
from sma_sim.model.config import Config
from sma_sim.model.errors import UserError

Curves = dict[str, dict[str, Vector]]
MIN_SAMPLES = 5  # of a part that can be told from noise
MIN_SHARE = 0.05  # of the samples: less is not named
SAME_EVERYWHERE = ('run', 'time in the run')  # dimensions that say nothing of a part of one run


def part_of_residual(
    compared: Job, config: Config, candidates: Job | None, where: tuple[str, str], times: tuple[float, float]
) -> dict[str, Any]:
    """What is known of the residual of a channel between two times [s], for JSON.

    Parameters
    ----------
    compared : Job
        A comparison of the model with the recordings.
    config : Config
        That model.
    candidates : Job, optional
        The effects that were switched on beside it, one at a time.
    where : tuple of str
        The run and the channel.
    times : tuple of float
        The part's first and last time [s].

    Returns
    -------
    dict
        ``samples``, ``over_noise`` (root mean square of residual over noise), ``bias_over_noise``, ``states`` (shares of the
        samples by mode, temperature, direction ...), ``temperatures`` [K] by wire, and ``effects``: by name, how alike their
        trace is (``cosine``, 1 for the same shape) and which part of the squared residual it ``explains``, the most first.

    Raises
    ------
    UserError
        For a run or a channel that was not compared, and for a part with too few samples.
    """
    comparison = comparison_from(compared, config)
    (name, channel), names = where, [run.name for run in comparison.runs]
    if name not in names:
        raise UserError(f'there is no run {name}: expected one of {", ".join(names)}')
    number = names.index(name)
    run = comparison.runs[number]
    if channel not in run.measured:
        raise UserError(f'run {name} has no channel {channel}: expected one of {", ".join(run.measured)}')
    low, high = sorted(times)
    inside = (run.time >= low) & (run.time <= high) & np.isfinite(run.measured[channel])
    if inside.sum() < MIN_SAMPLES:
        raise UserError(
            f'{name}, {low:g} to {high:g} s: {inside.sum()} samples of {channel}, expected {MIN_SAMPLES} or more'
        )
    scaled = run.residual(channel) / run.noise[channel]
    return {
        'run': name,
        'channel': channel,
        't0': low,
        't1': high,
        'samples': int(inside.sum()),
        'over_noise': float(np.sqrt(np.mean(scaled[inside] ** 2))),
        'bias_over_noise': float(np.mean(scaled[inside])),
        'states': states_in(comparison, number, inside),
        'temperatures': temperatures_in(comparison, number, inside),
        'effects': effects_like(candidates.curves(), where, (run.time[inside], scaled[inside])) if candidates else [],
    }


def states_in(comparison: Comparison, run: int, inside: NDArray[np.bool_]) -> list[dict[str, Any]]:
    """The states of run number `run` where `inside` (k,), by dimension, the most frequent first.

    Of each the ``dimension`` (``mode of wire 1``), the class (``label``), both in ``words``, its ``share`` of the samples,
    and that in the rest of all runs (``elsewhere``).
    """
    found: list[dict[str, Any]] = []
    for dimension in dimensions(comparison):
        if dimension.name in SAME_EVERYWHERE:
            continue
        here = dimension.classes[run][inside]
        others = [classes for k, classes in enumerate(dimension.classes) if k != run]
        rest = np.concatenate([dimension.classes[run][~inside], *others])
        shares = [(float(np.mean(here == k)), k) for k in range(len(dimension.labels))]
        for share, k in sorted(shares, reverse=True):
            if share >= MIN_SHARE:
                found.append(
                    {
                        'dimension': dimension.name,
                        'label': dimension.labels[k],
                        'share': share,
                        'elsewhere': float(np.mean(rest == k)) if len(rest) else 0.0,
                        'words': dimension.words(k, k),
                    }
                )
    return found


def temperatures_in(comparison: Comparison, run: int, inside: NDArray[np.bool_]) -> dict[str, Any]:
    """By wire, the least and the largest temperature [K]."""
    states = comparison.runs[run].states
    ranges = {wire: states[f'T{suffix}_K'][inside] for suffix, wire in wires_of(comparison.config).items()}
    return {wire: (float(values.min()), float(values.max())) for wire, values in ranges.items()}


def comparison_from(job: Job, config: Config) -> Comparison:
    """The comparison whose curves a job has written. Raises UserError."""
    runs = []
    for name, curves in job.curves().items():
        parts: dict[str, dict[str, Vector]] = {kind: {} for kind in ('measured', 'model', 'noise', 'state')}
        for what, values in curves.items():
            kind, _, which = what.partition('.')
            if kind in parts:
                parts[kind][which] = values
        noise = {channel: float(value) for channel, value in parts['noise'].items()}
        runs.append(
            ComparedRun(name, False, curves['time'], parts['measured'], parts['model'], noise, parts['state'], Nuisance())
        )
    return Comparison('', config, 0.0, tuple(runs))


def effects_like(traces: Curves, where: tuple[str, str], part: tuple[Vector, Vector]) -> list[dict[str, Any]]:
    """The effects whose trace in a channel of a run is like a part of its residual: times and residual over noise (k,)."""
    (run, channel), (times, residual) = where, part
    known, found = traces.get(run, {}), []
    for what, trace in known.items():
        effect, _, of_channel = what.removeprefix('trace.').rpartition('.')
        if not what.startswith('trace.') or of_channel != channel:
            continue
        shape = np.interp(times, known['time'], trace)
        size = float(np.linalg.norm(shape) * np.linalg.norm(residual))
        cosine = float(shape @ residual) / size if size > 0.0 else 0.0
        explains = 1.0 - float(np.sum((residual - shape) ** 2) / np.sum(residual**2))
        found.append({'effect': effect, 'cosine': cosine, 'explains': explains})
    return sorted(found, key=lambda entry: -float(entry['cosine']))
