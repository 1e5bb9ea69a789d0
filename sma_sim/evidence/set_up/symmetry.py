"""Faults that nobody can tell apart: those that turn the recordings of a robot into those of the same robot in a mirror.

A planar module with the other sign of J_eq bends the other way: its U_y and alpha have the other sign, its wires exchange
their parts. If J_eq has the opposite sign in a file, the recordings are therefore those of a robot with U_y and alpha of the
opposite sign and wires that are exchanged. Which exchanges a structure allows is asked of its model.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.data.recording import CHANNEL_COLUMNS
from sma_sim.evidence.estimation.levenberg_marquardt import start_point
from sma_sim.evidence.estimation.problem import Problem
from sma_sim.evidence.estimation.residuals import FitData, simulated
from sma_sim.evidence.set_up.faults import Fault, unit_of
from sma_sim.solver.simulate import SimulationError

Channels = Mapping[str, NDArray[np.float64]]
Columns = Mapping[str, tuple[float, str]]
"""By channel and command: the sign with which which column holds it."""
SAME = 1e-3  # of what a channel spans, within which two runs are the same: far above the solver's error


def as_columns(faults: Sequence[Fault]) -> Columns:
    """Where the right values are, of signs and exchanged columns."""
    found: dict[str, tuple[float, str]] = {}
    for fault in faults:
        if fault.kind == 'sign':
            for name in fault.quantities:
                sign, source = found.get(name, (1.0, name))
                found[name] = (-sign, source)
        else:
            first, second = fault.quantities
            found[first], found[second] = found.get(second, (1.0, second)), found.get(first, (1.0, first))
    return {name: column for name, column in found.items() if column != (1.0, name)}


def as_faults(columns: Columns, recordings: tuple[str, ...]) -> tuple[Fault, ...]:
    """The faults that put the right values there: exchanges first, then signs."""
    where = {name: name for name in columns}
    found = []
    for name, (_, source) in columns.items():
        if where[name] != source:
            other = next(key for key, at in where.items() if at == source)
            where[name], where[other] = source, where[name]
            found.append(Fault('swap', tuple(sorted((name, other))), recordings=recordings))
    signs = (Fault('sign', (name,), recordings=recordings) for name, (sign, _) in columns.items() if sign < 0.0)
    return (*found, *signs)


def in_mirror(symmetry: Columns, columns: Columns) -> Columns:
    """Where the right values of the mirrored robot are."""
    found = {}
    for name in dict.fromkeys((*symmetry, *columns)):
        sign, source = symmetry.get(name, (1.0, name))
        other, column = columns.get(source, (1.0, source))
        found[name] = (sign * other, column)
    return {name: column for name, column in found.items() if column != (1.0, name)}


def symmetries(problem: Problem) -> list[Columns]:
    """The exchanges of commands that only exchange the channels of the nominal model, or their signs."""
    structure, z = problem.config.structure.structure, start_point(problem)
    run = max(problem.runs, key=lambda one: float(np.abs(one.source.values[:, 0]).max()))
    own = z[problem.indices()[problem.runs.index(run)]]
    config, nuisance = problem.fitted(z), problem.nuisance(run, own)

    def shown(source: FitData) -> Channels:
        _, trajectory, index = simulated(config, source, nuisance, source.channels)
        return {name: trajectory[CHANNEL_COLUMNS[name]][index] for name in source.channels}

    faults = [Fault('swap', pair) for pair in combinations(structure.commands, 2)]
    if structure.antagonistic:
        each = [(name,) for name in structure.commands]
        faults += [Fault('sign', names) for names in dict.fromkeys((structure.commands, *each))]
    found = list[Columns]()
    try:
        straight = shown(run)
        for fault in faults:
            mirrored = shown(fault.in_run(run))
            channels = dict(exchanged(straight, mirrored))
            if len(channels) == len(straight):
                found.append({**as_columns([fault]), **{a: b for a, b in channels.items() if b != (1.0, a)}})
    except SimulationError:
        return []
    return found


def exchanged(straight: Channels, mirrored: Channels) -> Iterator[tuple[str, tuple[float, str]]]:
    """By channel of one run, which channel of the other one is the same, and with which sign."""
    for name, values in straight.items():
        within = SAME * float(np.abs(values).max())
        alike = (
            (sign, other)
            for other, there in mirrored.items()
            if unit_of(other) == unit_of(name)
            for sign in (1.0, -1.0)
            if np.abs(values - sign * there).max() <= within
        )
        if (first := next(alike, None)) is not None:
            yield name, first


def told_apart(found: Sequence[Fault], known: Sequence[Columns]) -> tuple[Fault, ...]:
    """The faults with what leaves the same recordings, unless that takes far more; of these the fewest are taken."""
    exchanges = [fault for fault in found if fault.kind in ('sign', 'swap') and fault.corrected]
    others = [fault for fault in found if fault not in exchanges]
    chosen: list[Fault] = []
    for recordings in dict.fromkeys(fault.recordings for fault in exchanges):
        own = as_columns([fault for fault in exchanges if fault.recordings == recordings])
        touched = [own, *(in_mirror(one, own) for one in known if one.keys() & own.keys())]
        options = [as_faults(columns, recordings) for columns in touched]
        options = sorted((option for option in dict.fromkeys(options) if option), key=len)
        if options:
            first, *rest = options[0]
            near = tuple(other for other in options[1:] if causes(other) <= causes(options[0]) + 1)
            chosen += [replace(first, alternatives=near), *rest]
    return (*chosen, *others)


def causes(faults: Sequence[Fault]) -> int:
    """How many things went wrong: an axis that counts the other way turns several signs."""
    return sum(fault.kind == 'swap' for fault in faults) + any(fault.kind == 'sign' for fault in faults)
