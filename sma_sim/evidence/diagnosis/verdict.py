"""A diagnosis as plain data for programs."""

from __future__ import annotations

import math
from dataclasses import asdict
from pathlib import Path
from typing import Any

from sma_sim.evidence.data.json_values import finite
from sma_sim.evidence.diagnosis.diagnose import Diagnosis, ModelStage
from sma_sim.evidence.diagnosis.proposed_equation import proposed_data
from sma_sim.evidence.model_selection.forward_selection import CandidateFit, SelectionStep
from sma_sim.model.config import flat_parameters


def as_data(diagnosis: Diagnosis, file: Path | None = None) -> dict[str, Any]:
    """The verdict of the file contract (design: ranking of the first step, error by step), JSON's types only.

    `file` is where the proposed effect was written.
    """
    first = diagnosis.rounds[0] if diagnosis.rounds else None
    found: dict[str, Any] = finite({
        'verdict': diagnosis.verdict,
        'model': diagnosis.calibration.config.model,
        'effects': diagnosis.effects,
        'taken_back': diagnosis.taken_back,
        'ranking': ranking(first, diagnosis) if first else (),
        'error': [error_of(step) for step in diagnosis.steps],
        'noise_std': diagnosis.noise_std,
        'parameters': {
            name: value for name, value in flat_parameters(diagnosis.calibration.config).items()
            if isinstance(value, float) and math.isfinite(value)
        },
        'intervals': intervals_of(diagnosis),
        'training': diagnosis.training,
        'held_out': diagnosis.held_out,
        'interrupted': diagnosis.interrupted,
        'seconds': diagnosis.seconds,
        **({'fitted_together': asdict(diagnosis.together)} if diagnosis.together else {}),
        **({'proposed': proposed_data(diagnosis, file)} if diagnosis.proposal else {}),
    })  # fmt: skip
    return found


def ranking(first: SelectionStep, diagnosis: Diagnosis) -> list[dict[str, Any]]:
    """Candidates of the first step: what the model has in the end, what was accepted, then by cross-validated error.

    What explains as well as the accepted one is said as it was seen last, beside the other effects.
    """
    accepted = first.accepted.name if first.accepted else ''
    indistinguishable = {one.name: one.indistinguishable for one in first.tried}
    indistinguishable |= {
        one.name: one.indistinguishable for again in diagnosis.revisions if again.effect == accepted for one in again.tried
    }
    kept = diagnosis.effects[:1]
    ordered = sorted(first.tried, key=lambda one: (one.name not in kept, one.name != accepted, one.ratio))
    return [rank_of(one, diagnosis.held_out_ratio, indistinguishable[one.name]) for one in ordered]


def rank_of(one: CandidateFit, ratios: dict[str, float], indistinguishable: tuple[str, ...]) -> dict[str, Any]:
    """One candidate."""
    units = {parameter.name: parameter.unit for parameter in one.found.effect.parameters}
    std = {name.rpartition('.')[2]: s for name, s in one.std.items() if name.startswith(f'effects.{one.name}.')}
    return {
        'effect': one.name,
        'delta_bic': one.delta_bic,
        'held_out_error_ratio': ratios.get(one.name, one.ratio),
        'cross_validated_error_ratio': None if one.hopeless else one.ratio,
        'family_p': one.family_p,
        'parameters': {
            name: {'value': value, 'std': std.get(name), 'unit': units[name]}
            for name, value in one.fitted.values_of(one.name).items()
        },
        'plausible': one.plausible,
        'confounded_with': indistinguishable,
        'same_as': one.found.effect.same_as,
    }  # fmt: skip


def error_of(step: ModelStage) -> dict[str, Any]:
    """One step of the error's fall."""
    return {
        'effects': step.effects,
        'model': step.model,
        'train': step.train,
        'held_out': step.held_out,
        'channels': step.held_out_channels or step.channels,
    }


def intervals_of(diagnosis: Diagnosis) -> dict[str, dict[str, Any]]:
    """95 % intervals of the last fit."""
    sure = diagnosis.calibration.uncertainty
    if sure is None:
        return {}
    return {
        one.name: {'value': one.value, 'low': one.low, 'high': one.high, 'unit': one.unit, 'seen': one.seen}
        for one in sure.intervals
    }
