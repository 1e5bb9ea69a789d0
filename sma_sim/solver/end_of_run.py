"""Why a run ended, in words, what was moved at its start, and what in it no robot would survive."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from contextlib import suppress
from itertools import product

import numpy as np

from sma_sim.model.arrays import Vector
from sma_sim.model.automaton import INNER
from sma_sim.model.config import Config
from sma_sim.model.effects.meaning import idle_effects
from sma_sim.model.effects.ports import call_effect
from sma_sim.model.errors import PhysicsWarning
from sma_sim.model.expected_units import mismatch_of
from sma_sim.model.layout import O_S_A, O_S_M, O_SIGMA, Evaluation, InputPoint, System, SystemState
from sma_sim.model.material import heat_capacity
from sma_sim.model.system import flow
from sma_sim.solver.effect_table import acting_order, own_scratch
from sma_sim.solver.inputs import Input
from sma_sim.solver.integrate import COMPLETED, NOT_FINITE, RATE_NOT_FINITE, REASONS, STALLED, STEP_UNDERFLOW, Run
from sma_sim.solver.model import Model, new_findings

NARROW = 1e5  # [Pa]: a hysteresis that has nearly closed
MELTING_POINT = 1583.0  # [K] of NiTi: 1310 deg C (Massalski, Binary Alloy Phase Diagrams, 1990)
LATER = (0.0, *(sign * 10.0**k for k in (-6, -4, -2, 0) for sign in (1.0, -1.0)))  # [s]: about the lengths of steps
BUCKLED = 5e7  # [Pa] of compression, which no thin wire bears; a few MPa are errors of a model and its start
NONE = np.zeros(0)
TRANSFORMING_PORTS = ('wire_strain', 'transformation_stress')
FRACTIONS = (0.0, 0.25, 0.5, 0.75, 1.0)  # of martensite, at which it is looked whether stress falls
NO_CAPACITY = 0.1  # of a wire's own, where a run that cannot go on is said to lack it


def stop_reason(status: int, model: Model, run: Run) -> str:
    """Why a run ended, in words; where parameters leave a wire no heat capacity, that (MAS9, L3b)."""
    p = model.compiled
    if status != COMPLETED and (lost := lost_stability(model, run)):
        return lost
    if status in (NOT_FINITE, RATE_NOT_FINITE) and (names := effects_without_number(model, run)):
        return (
            f'{REASONS[status].partition(":")[0]}: {" and ".join(names)} returns none; check its kernel and its parameters'
        )
    if status in (STALLED, STEP_UNDERFLOW, RATE_NOT_FINITE) and p.mas and (odd := odd_hysteresis(model, run)):
        return f'stalled: {odd}' if status == STALLED else odd
    for i in range(p.wires):
        y, T = run.state.y, run.state.y[p.first_T + i]
        x = y[p.first_x + i] if p.mas else run.state.x_frozen[i]
        left = heat_capacity(T, x, p.wire) / (p.wire.volume * p.wire.rho * p.wire.c_V)
        if status == STEP_UNDERFLOW and left < NO_CAPACITY:
            return (
                f'the heat capacity of wire {i + 1} has come down to nothing at {T:.1f} K and x_M = {x:.2f}: rho c_V + T '
                f'(1/E_M - 1/E_A) sigma_T^2 (1 - x_M); check wire.sigma_T, wire.c_V and why wire.E_M is above wire.E_A'
            )
    return REASONS[status]


def lost_stability(model: Model, run: Run) -> str:
    """Which coordinate has left the range in which a pose is stable; empty where none has."""
    structure = model.structure
    for coordinate, value in zip(structure.coordinates, run.state.y, strict=False):
        if not abs(value) < coordinate.limit:
            return (
                f'the {structure.title} has lost its stability: {coordinate.name} has come to {value:.3g} '
                f'{coordinate.unit}, no pose is stable under these forces; check the effects on structure_force (one that '
                f'softens it) and {", ".join(structure.fitted)}'
            )
    return ''


def effects_without_number(model: Model, run: Run) -> list[str]:
    """The effects whose values or rates are no finite numbers where a run has ended, or else moments later or before."""
    active = [one.effect for one in model.config.effects]
    effects = [active[k] for k in acting_order(active, model.structure)]
    for later in LATER:
        p, y, _ = evaluated(model, run, later)
        e, found = p.effects, []
        for k, effect in enumerate(effects):
            instances = range(p.wires if e.row[k] < 0 else 1)
            for kernel, instance in product((e.value[k], e.rate[k]), instances if effect.port != 'sensing' else ()):
                e.out.fill(0.0)
                if kernel:
                    call_effect(kernel, k, instance, y, e)
                if not np.isfinite(e.out).all():
                    found.append(f'effect {effect.name}')
        if found:
            return list(dict.fromkeys(found))
    return []


def evaluated(model: Model, run: Run, later: float = 0.0) -> tuple[System, Vector, Evaluation]:
    """The system, its states and what the flow makes of them without heating, as plain Python, where a run has ended, or so
    much `later` [s]."""
    p, state = own_scratch(model.compiled), run.state._replace(y=run.state.y.copy())
    inputs = np.zeros(len(model.structure.input_columns))
    inputs[-1] = model.config.parameters['environment.T_E']
    point, found = InputPoint(inputs, np.zeros_like(inputs)), Evaluation(np.zeros_like(state.y), new_findings(p))
    found.obs.fill(np.nan)
    # the stresses of a wire are known by the time at which its rates overflow
    with suppress(OverflowError, ZeroDivisionError), np.errstate(all='ignore'):
        if later:
            flow(0.0, state, point, p, found.dy, found.obs)
            state.y[:] += later * np.nan_to_num(found.dy)
        flow(0.0, state, point, p, found.dy, found.obs)
    return p, state.y, found


def odd_hysteresis(model: Model, run: Run) -> str:
    """What is wrong with the transformation stresses of a wire, where the MAS rates cannot be followed; empty if nothing."""
    p, _, found = evaluated(model, run)
    dsigma, eps_T = (model.config.parameters[f'wire.{name}'] for name in ('dsigma', 'eps_T'))
    for i in range(p.wires):
        s_A, s_M = found.obs[i, O_S_A], found.obs[i, O_S_M]
        if s_A - s_M <= NARROW:
            return (
                f'the hysteresis of wire {i + 1} is only {s_A - s_M:.3g} Pa high (wire.dsigma = {dsigma:g} Pa), where the '
                f'MAS rates switch too fast to be followed: check wire.dsigma, or choose the hybrid model'
            )
        for name, stress in (('sigma_A', s_A), ('sigma_M', s_M)):
            if eps_T + p.wire.d * stress <= 0.0:
                return (
                    f'{name} of wire {i + 1} has come to {stress:.3g} Pa, where its phases have no barrier between them: '
                    f'eps_T + (1/E_M - 1/E_A) {name} is not positive there; check the effects that shift it, and wire.eps_T'
                )
    return ''


def melting_note(temperatures: Vector) -> str:
    """Which wire came to a temperature at which its alloy melts, '' for none; `temperatures` (k, wires) [K]."""
    known = temperatures[np.isfinite(temperatures).all(axis=1)]
    if not len(known) or known.max() <= MELTING_POINT:
        return ''
    wire = int(np.argmax(known.max(axis=0)))
    return (
        f'wire {wire + 1} comes to {known[:, wire].max():.0f} K; NiTi melts at {MELTING_POINT:.0f} K, which the model does '
        'not know: check the command and its unit, wire.n, wire.r0 and wire.lambda'
    )


def compression_note(model: Model, columns: Mapping[str, Vector]) -> str:
    """How far a straight wire was pushed together, '' where none was."""
    stresses, section = {'the wire': columns.get('stress_Pa', NONE)}, model.wire.n * model.wire.section
    if model.structure.strain is None:
        words = ('wire' + suffix.replace('_', ' ') if suffix else 'the wire' for suffix in model.structure.wire_suffixes)
        forces = (columns.get(f'F{suffix}_N', NONE) for suffix in model.structure.wire_suffixes)
        stresses |= {name: force / section for name, force in zip(words, forces, strict=True) if len(force)}
    least = {name: float(stress[np.isfinite(stress)].min(initial=0.0)) for name, stress in stresses.items()}
    name = min(least, key=lambda one: least[one])
    if least[name] > -BUCKLED:
        return ''
    return f'{name} comes to {1e-6 * least[name]:.0f} MPa: a wire that is pushed buckles, which the model does not know'


def rising_stress_note(model: Model, run: Run) -> str:
    """Which effects make the stress of a wire rise with its martensite, '' for none: what transforms is then not determined,
    and a wire leaps from one phase to the other or stays where it is (docs/how-to/write-an-effect.md)."""
    names = [one.effect.name for one in model.config.effects if one.effect.port in TRANSFORMING_PORTS]
    if not names:
        return ''
    p, compliance = model.compiled, 1.0 / model.wire.E_A + np.array(FRACTIONS)[:, None, None] * model.wire.d
    edges, stresses = [], []
    for x in FRACTIONS:
        y, inner = run.state.y.copy(), np.full(p.wires, INNER)
        if p.mas:
            y[p.first_x : p.first_x + p.wires] = x
        found = evaluated(model, run._replace(state=SystemState(y, inner, np.full(p.wires, x))))[2].obs
        edges.append(found[:, [O_S_A, O_S_M]])
        stresses.append(found[:, [O_SIGMA]])
    tense = np.array(edges) - np.minimum(edges[0], 0.0)  # at a temperature at which wires transform in tension
    strains = compliance * (tense - np.array(stresses))  # from the strain of now to that at which a wire transforms, by x
    rising = np.flatnonzero((np.diff(strains, axis=0) < 0.0).any(axis=(0, 2)))
    if not len(rising):
        return ''
    return (
        f'the stress of wire {rising[0] + 1} does not fall while it becomes martensite, so that how it transforms is not '
        f'determined: check {" and ".join(names)}, whose sign may be the wrong one'
    )


def limit_notes(model: Model, columns: Mapping[str, Vector]) -> list[str]:
    """Which coordinates have gone beyond the limits that their structure declares."""
    found = []
    for coordinate in model.structure.coordinates:
        most = float(np.abs(columns.get(coordinate.column, NONE)).max(initial=0.0))
        if most > coordinate.limit:
            unit = coordinate.unit
            found.append(f'{coordinate.name} comes to {most:.3g} {unit}, beyond its limit of {coordinate.limit:.3g} {unit}')
    return found


def warn_of_idle_effects(config: Config, stacklevel: int = 4) -> None:
    """Warn of active effects that have no meaning in the system, and are therefore left out, at the line of the caller."""
    for words in idle_effects((active.effect for active in config.effects), config.structure):
        warnings.warn(words, PhysicsWarning, stacklevel=stacklevel)


def notes_on_commands(model: Model, source: Input) -> tuple[str, ...]:
    """Which commands are beyond what the node lets through, and what of the input can hardly be in SI units."""
    structure, J_max = model.structure, model.config.parameters['node.J_max']
    columns = np.asarray(source.values, float).T
    values = columns[len(structure.drives) : -1].T
    mismatches = ((name, mismatch_of(name, given)) for name, given in zip(structure.input_columns, columns, strict=True))
    notes = tuple(f'{name}: {mismatch.words}' for name, mismatch in mismatches if mismatch is not None)
    for note in notes:
        warnings.warn(note, PhysicsWarning, stacklevel=4)  # at the line that calls `simulate`
    return notes + tuple(
        f'{name} comes to {abs(column).max():g} W, beyond node.J_max = {J_max:g} W, at which the node cuts it off'
        for name, column in zip(structure.commands, values.T, strict=False)
        if abs(column).max() > J_max
    )


def notes_on_start(model: Model, run: Run) -> tuple[str, ...]:
    """Which requested phase fractions no mode admits, and where they were moved."""
    notes = []
    for i in range(model.wires):
        name = f'initial.x_M_{i + 1}'
        requested, x = model.config.parameters.get(name, np.nan), run.state.x_frozen[i]
        if not np.isnan(requested) and abs(requested - x) > 1e-9:
            notes.append(f'{name} = {requested:g} is not admitted at rest; the run starts at {x:.6g}')
    return tuple(notes)
