"""What is written of a diagnosis: the improved model, a proposed effect, and the command that goes on from there."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path

from sma_sim.evidence.data.tables import write_whole
from sma_sim.evidence.diagnosis.diagnose import Diagnosis
from sma_sim.words.proposed_equation import effect_values
from sma_sim.workflow.code_folders import parameter_file_at


def write_improved(path: Path, found: Diagnosis, folders: Sequence[str]) -> Path | None:
    """Write the parameter file of the last step, with a line on where it comes from.

    A proposed effect is written to a folder beside it, which it names beside `folders`, those of the user's effects; returns
    that effect's file.
    """
    folders, names, written = list(folders), list(found.effects), None
    source = f'sma-sim diagnose from {", ".join(found.training)}'
    if found.proposal:
        folder = path.with_name(f'{path.stem}_effects')
        note = f'proposed by {source}: a formula that fits, no known law'
        written = found.proposal.write(folder, effect_values(found), note)
        folders, names = [*folders, folder.name], list(found.stages[-1].effects)
    origin = f'# Diagnosed by {source}: {" and ".join(names) or "no effect"} added.\n'
    text = origin + parameter_file_at(path, found.calibration.config, folders)
    write_whole(path, lambda file: file.write(text))
    return written


def confounded(found: Diagnosis) -> tuple[str, ...]:
    """Explanations as `next --between` takes them, the accepted one first; empty where nothing is confounded.

    They are those of the last effect that others explain as well: what was there beside it is part of each.
    """
    if not found.calibration.config.structure.has_one_command or not found.selection_steps:
        return ()
    given = len(found.selection_steps[0].base.effects)
    for step in reversed(found.deciding_steps):
        if step.accepted is not None and step.accepted.indistinguishable:
            named = {*found.effects, *(name.partition('@')[0] for name in found.effects)}
            # what stands for an equation beside them is no effect that a command knows
            before = [name for name in step.base.effects[given:] if name.partition('@')[0] in named]
            return tuple('+'.join((*before, name)) for name in (step.accepted.name, *step.accepted.indistinguishable))
    return ()


def command_between(rivals: Sequence[str], data: Sequence[Path], options: Sequence[str], found: Diagnosis) -> str:
    """The command that designs an experiment between explanations that were found, on data and with further options."""
    options = [*options, *(['--in-motion'] if any(difference.in_motion for difference in found.differences) else [])]
    return shlex.join(['sma-sim', 'next', *map(str, data), '--between', *rivals, *options, '-o', 'next.csv'])
