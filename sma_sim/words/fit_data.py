"""A fit as plain data for programs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from sma_sim.evidence.data.recording import Dataset
from sma_sim.evidence.estimation.calibrate import Calibration
from sma_sim.evidence.estimation.held_out_prediction import RunFit
from sma_sim.evidence.estimation.plausibility import ImplausibleParameter
from sma_sim.evidence.estimation.run_estimates import ParameterByRun, disagreement
from sma_sim.words.fit_remarks import agreement_sentence


def fit_result_data(found: Calibration, predicted: Sequence[RunFit], dataset: Dataset) -> dict[str, Any]:
    """The result for programs; SI units."""
    uncertainty = found.uncertainty
    intervals = {interval.name: interval for interval in uncertainty.intervals} if uncertainty else {}
    return {
        'model': found.config.simulated_kinetics,
        'parameters': {
            parameter.name: {
                'value': found.values[parameter.name],
                'unit': parameter.unit,
                **interval_data(intervals.get(parameter.name)),
            }
            for parameter in found.free
        },
        'delay': found.delay,
        'delay_std': uncertainty.delay_std if uncertainty else None,
        'delay_interval': interval_data(uncertainty.delay if uncertainty else None),
        'error': {
            'train': found.error,
            'held_out': float((sum(fit.error**2 for fit in predicted) / len(predicted)) ** 0.5) if predicted else None,
            'channels': found.channel_errors,
            'runs': {fit.name: run_data(fit, held_out=False) for fit in found.runs}
            | {fit.name: run_data(fit, held_out=True) for fit in predicted},
        },
        'kinetics': found.kinetics,
        'unseen': uncertainty.unseen if uncertainty else None,
        'directions': [{'std': direction.std, 'weights': direction.weights} for direction in uncertainty.directions]
        if uncertainty
        else None,
        'correlation': uncertainty.correlation if uncertainty else None,
        'at_bound': found.at_bound,
        'limits': [asdict(limit) | {'text': limit.text} for limit in found.limits],
        'implausible': [implausible_data(parameter) for parameter in found.implausible],
        'unusual': [implausible_data(parameter) for parameter in found.unusual],
        'improbable_offsets': [asdict(offset) | {'text': offset.text} for offset in found.improbable_offsets],
        'by_recording': by_run_data(found.by_run),
        'held': {parameter.name: parameter.reason for parameter in found.fixed},
        'other_starts': [dict(vars(start)) for start in found.other_starts],
        'noise_std': dataset.noise_std,
        'converged': found.converged,
        'interrupted': found.interrupted,
        'seconds': found.seconds,
    }


def interval_data(interval: Any) -> dict[str, Any]:
    """An interval as plain data."""
    return {} if interval is None else {name: getattr(interval, name) for name in ('low', 'high', 'std', 'log', 'seen')}


def run_data(fit: RunFit, held_out: bool) -> dict[str, Any]:
    """The errors of one run as plain data."""
    return {
        'error': fit.error,
        'channels': fit.channel_errors,
        'held_out': held_out,
        'x_M': fit.x_M,
        'start': fit.start,
        'zero': fit.zero,
        'zeros': fit.zeros,
        'drifts': fit.drifts,
        'ambient': fit.ambient,
        'factors': dict(fit.factors),
        'warmth': fit.beginning.warmth,
    }


def by_run_data(found: Sequence[ParameterByRun]) -> dict[str, Any]:
    """All of it for programs (SI)."""
    worst = disagreement(found)
    return {
        'agree': worst is None,
        'text': agreement_sentence(found),
        'parameter': worst.name if worst else None,
        'recording': worst.outlier.run if worst else None,
        'parameters': {parameter.name: parameter_data(parameter) for parameter in found},
    }


def parameter_data(parameter: ParameterByRun) -> Mapping[str, Any]:
    """One parameter."""
    return {
        'value': parameter.value,
        'unit': parameter.unit,
        'Q': parameter.Q,
        'dof': parameter.dof,
        'p': parameter.p if parameter.dof else None,
        'recordings': {
            run.run: {name: value for name, value in asdict(run).items() if name != 'run'} for run in parameter.runs
        },
    }


def implausible_data(parameter: ImplausibleParameter) -> dict[str, Any]:
    """One of them for programs (SI)."""
    return asdict(parameter) | {'text': parameter.text}
