"""A diagnosis as plain data for programs."""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from sma_sim.evidence.diagnosis.conclusion import ModelStage
from sma_sim.evidence.diagnosis.diagnose import Diagnosis
from sma_sim.evidence.estimation.plausibility import other_form
from sma_sim.evidence.estimation.recording_differences import RecordingDifference
from sma_sim.evidence.estimation.residuals import LATENESS
from sma_sim.evidence.estimation.uncertainty import AmbientDifference
from sma_sim.evidence.search.equations import formula_of, has_terms
from sma_sim.evidence.search.posterior import Posterior
from sma_sim.evidence.search.steps import CandidateFit, SelectionStep
from sma_sim.model.config import flat_parameters
from sma_sim.model.effects.scope import SEPARATOR, law_name
from sma_sim.words.fit_data import by_run_data, implausible_data
from sma_sim.words.json_values import finite
from sma_sim.words.nuisances import WireAtBeginning, nuisance_data, warm_wires
from sma_sim.words.proposed_equation import proposed_data
from sma_sim.words.set_up import fault_data


def as_data(diagnosis: Diagnosis, file: Path | None = None) -> dict[str, Any]:
    """The verdict of the file contract (design: ranking of the first step, error by step), JSON's types only.

    `file` is where the proposed effect was written.
    """
    first = diagnosis.selection_steps[0] if diagnosis.selection_steps else None
    found: dict[str, Any] = finite(
        {
            'verdict': diagnosis.verdict,
            'system': diagnosis.calibration.config.system,
            'model': diagnosis.calibration.config.simulated_kinetics,
            'effects': plain_names(diagnosis.effects),
            'variants': variants(diagnosis),
            'set_up': [fault_data(fault) for fault in diagnosis.set_up],
            'retracted': plain_names(diagnosis.retracted),
            'taken_back': plain_names(diagnosis.retracted),  # its old name
            'probabilities': probabilities(diagnosis.posterior) if diagnosis.has_compared else {},
            'models': models(diagnosis.posterior) if diagnosis.has_compared else [],
            'ranking': ranking(first, diagnosis) if first else (),
            'error': [error_of(stage) for stage in diagnosis.stages],
            'noise_std': diagnosis.noise_std,
            'parameters': {
                name: value
                for name, value in flat_parameters(diagnosis.calibration.config).items()
                if isinstance(value, float) and math.isfinite(value)
            },
            'intervals': intervals_of(diagnosis),
            'implausible': [implausible_data(parameter) for parameter in diagnosis.calibration.implausible],
            'implausible_nominal': [implausible_data(parameter) for parameter in diagnosis.implausible],
            'unusual': [implausible_data(parameter) for parameter in diagnosis.calibration.unusual],
            'nuisances': nuisance_data(diagnosis.calibration, diagnosis.findings),
            'differences': differences(diagnosis),
            'by_recording': by_run_data(diagnosis.calibration.by_run),
            'by_held_out_run': by_held_out_run(diagnosis),
            'training': diagnosis.training,
            'held_out': diagnosis.held_out,
            'interrupted': diagnosis.interrupted,
            'seconds': diagnosis.seconds,
            **({'fitted_together': asdict(diagnosis.pooled_errors)} if diagnosis.pooled_errors else {}),
            **({'proposed': proposed_data(diagnosis, file)} if diagnosis.proposal else {}),
        }
    )
    if diagnosis.together is not None:
        found['together'] = as_data(diagnosis.together)
    return found


def probabilities(posterior: Posterior) -> dict[str, Any]:
    """That nothing is missing, that something is which has no name, of every effect of the models (in a scope) that it is
    there, in whatever form, and that any other is."""
    effects: dict[str, float] = {}
    for name, p in posterior.effects.items():
        law = law_name(name)
        effects[law] = min(1.0, effects.get(law, 0.0) + p)
    ordered = dict(sorted(effects.items(), key=lambda item: -item[1]))
    return {'none': posterior.none, 'unlisted': posterior.unlisted, 'effects': ordered, 'other': posterior.other}


def models(posterior: Posterior) -> list[dict[str, Any]]:
    """The models that have weight, the heaviest first; both kinetics of one are together, and `kinetics` are the better."""
    found: dict[frozenset[str], dict[str, Any]] = {}
    for model, weight in zip(posterior.models, posterior.weights, strict=True):
        if model.names in found:
            found[model.names]['probability'] += weight
            continue
        found[model.names] = {
            'effects': [one.name for one in model.components if not (one.is_formula or one.is_difference)],
            'differences': [one.name for one in model.components if one.is_difference],
            'formula': formula_of(model).equation if has_terms(model) else None,
            'kinetics': model.fit.problem.config.simulated_kinetics,
            'probability': weight,
            'error': model.fit.error,
            'starts': {'agreeing': model.agreeing, 'all': model.starts},
        }
    return sorted(found.values(), key=lambda one: -float(one['probability']))


def plain_names(names: Sequence[str]) -> tuple[str, ...]:
    """Names of effects without their scopes."""
    return tuple(name.partition(SEPARATOR)[0] for name in names)


def differences(diagnosis: Diagnosis) -> list[dict[str, Any]]:
    """What differs between the recordings, and by how much in each: SI units, or whether power is lost."""
    return [
        {'what': one.words, 'by_recording': dict(amounts(one, diagnosis))}
        | ({'above_first': {name: asdict(there) for name, there in above_first(diagnosis).items()}} if one.ambient else {})
        | (
            {'wires': {name: [asdict(wire) for wire in wires] for name, wires in wires_at_beginning(diagnosis).items()}}
            if one.in_motion
            else {}
        )
        for one in diagnosis.differences
    ]


def amounts(difference: RecordingDifference, diagnosis: Diagnosis) -> Iterator[tuple[str, float | bool]]:
    """By recording, how much of a difference it has."""
    for run in (*diagnosis.calibration.runs, *diagnosis.predicted):
        if difference.zeros:
            ((channel, _),) = difference.zeros
            yield run.name, (run.drifts if difference.drifting else run.zeros).get(channel, 0.0)
        elif difference.late_commands:
            yield run.name, LATENESS * statistics.pstdev(run.switches or (0.0,))
        elif difference.rounded_commands:
            yield run.name, statistics.pstdev(run.powers or (0.0,))
        elif difference.parameter:
            yield run.name, dict(run.factors).get(difference.parameter, 1.0) - 1.0
        elif difference.in_motion:
            yield run.name, max(run.beginning.warmth, default=0.0)
        else:
            yield run.name, run.ambient if difference.ambient else run.name in difference.recordings


def wires_at_beginning(diagnosis: Diagnosis) -> dict[str, tuple[WireAtBeginning, ...]]:
    """By recording, how warm its wires were when it began, those held out among them."""
    return warm_wires(diagnosis.calibration, diagnosis.predicted)


def above_first(diagnosis: Diagnosis) -> dict[str, AmbientDifference]:
    """By recording, its ambient temperature above that of the first one [K]; without an interval where there are none.

    All of them together can hardly be told from parameters.
    """
    known = diagnosis.calibration.uncertainty
    found = dict(known.ambient) if known else {}
    first = diagnosis.calibration.runs[0].ambient
    for run in (*diagnosis.calibration.runs, *diagnosis.predicted):
        found.setdefault(run.name, AmbientDifference(run.ambient - first, math.nan, math.nan))
    return found


def by_held_out_run(diagnosis: Diagnosis) -> dict[str, dict[str, Any]]:
    """By run that could have been held out, the verdict and the effects."""
    return {
        name: asdict(found) | {'effects': plain_names(found.effects)} for name, found in diagnosis.by_held_out_run.items()
    }


def variants(diagnosis: Diagnosis) -> dict[str, str]:
    """By effect of the last model that acts in a part of its places, or in another form: which, in words."""
    words = {}
    for active in diagnosis.calibration.config.effects:
        effect = active.effect
        form = other_form(active.effect, active.by_short_name)
        words[effect.plain_name] = ', '.join(filter(None, (effect.scope.words, form)))
    return {name: form for name, form in words.items() if form}


def ranking(first: SelectionStep, diagnosis: Diagnosis) -> list[dict[str, Any]]:
    """Candidates of the first step: what was taken, then by their odds."""
    return [rank_of(candidate, diagnosis.held_out_ratio) for candidate in first.candidate_fits]


def rank_of(candidate: CandidateFit, ratios: Mapping[str, float]) -> dict[str, Any]:
    """The entry of a candidate."""
    units = {parameter.name: parameter.unit for parameter in candidate.effect.parameters}
    std = {name.rpartition('.')[2]: s for name, s in candidate.std.items() if name.startswith(f'effects.{candidate.name}.')}
    return {
        'effect': candidate.effect.plain_name,
        'scope': candidate.effect.scope.words,
        'log_odds': candidate.log_odds,
        'delta_bic': candidate.delta_bic,
        'held_out_error_ratio': ratios.get(candidate.name, candidate.error_ratio),
        'parameters': {
            name: {'value': value, 'std': std.get(name), 'unit': units[name]}
            for name, value in candidate.fit.seen_values_of(candidate.name).items()
        },
        'plausible': candidate.plausible,
        'confounded_with': tuple(dict.fromkeys(plain_names(candidate.indistinguishable))),
        'same_as': candidate.effect.same_as,
    }


def error_of(stage: ModelStage) -> dict[str, Any]:
    """The errors of one stage."""
    return {
        'effects': plain_names(stage.effects),
        'differences': stage.differences,
        'model': stage.kinetics,
        'train': stage.train,
        'held_out': stage.held_out,
        'channels': stage.held_out_channel_errors or stage.channel_errors,
    }


def intervals_of(diagnosis: Diagnosis) -> dict[str, dict[str, Any]]:
    """95 % intervals of the last fit."""
    uncertainty = diagnosis.calibration.uncertainty
    if uncertainty is None:
        return {}
    fields = ('value', 'low', 'high', 'unit', 'seen')
    return {one.name: {name: getattr(one, name) for name in fields} for one in uncertainty.intervals}
