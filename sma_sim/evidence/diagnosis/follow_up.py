"""What a diagnosis leaves confounded, as the explanations between which the next experiment should decide."""

from __future__ import annotations

from sma_sim.evidence.diagnosis.diagnose import Diagnosis


def confounded(found: Diagnosis) -> tuple[str, ...]:
    """Explanations as `next --between` takes them, the accepted one first; empty where nothing is confounded.

    They are those of the last effect that others explain as well: what was there beside it is part of each.
    """
    if not found.calibration.config.structure.structure.has_one_command or not found.selection_steps:
        return ()
    given = len(found.selection_steps[0].base.effects)
    for step in reversed(found.deciding_steps):
        if step.accepted is not None and step.accepted.indistinguishable:
            before = step.base.effects[given:]
            return tuple('+'.join((*before, name)) for name in (step.accepted.name, *step.accepted.indistinguishable))
    return ()
