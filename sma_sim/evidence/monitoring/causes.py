"""What may change on a robot while it runs: an effect that begins, other cooling, another room, wires that are lost."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from math import exp, log
from pathlib import Path

from sma_sim.compiler.fields_read import uses_time
from sma_sim.evidence.model_selection.candidates import (
    Candidate,
    Probe,
    candidate_of,
    candidates_for,
    instants_of,
    with_effect,
)
from sma_sim.model.config import Config
from sma_sim.model.effects.conversion import effect_on
from sma_sim.model.effects.effect import Effect
from sma_sim.model.parameters import Parameter

COOLING, ROOM = 'wire.lambda', 'T_E'
COOLING_STEP, AMBIENT_STEP = 0.15, 2.0  # of its logarithm: a fan, a draught, another posture; [K] of a room in a day

# Wires of a bundle that are broken or have slipped out: the others pull with less than the whole.
LOST_WIRES = Effect(
    name='lost_wires',
    title='lost wires of a bundle',
    port='wire_force',
    equation='F_added = -part_i F',
    source='a bundle of n equal wires pulls with n - m of them',
    parameters=(
        Parameter(
            'part', 0.1, '-', (0.0, 0.95), 'share of the wires of bundle 1 that is lost', neutral=0.0, realistic=(0.0, 0.5)
        ),
        Parameter(
            'part_2', 0.0, '-', (0.0, 0.95), 'share of the wires of bundle 2 that is lost', neutral=0.0, realistic=(0.0, 0.5)
        ),
    ),
    kernel=lambda s, w, p: -(p.part if s.wire < 0.5 else p.part_2) * s.F,
    wires=2,
)


@dataclass(frozen=True)
class Cause:
    """Something that changes at an instant.

    Attributes
    ----------
    name
        Of the effect or of the parameter, as in a configuration.
    words
        What a message calls it.
    steps
        By parameter, amounts to which it is probed: one up, one down, or either. SI units from neutral; of `wire.lambda` the
        change of its logarithm.
    candidate
        The effect; None for a parameter of the model or the ambient temperature.
    shapes
        By parameter that has no neutral value, a quarter of its realistic range, from the middle: of its logarithm where it
        is positive.
    """

    name: str
    words: str
    steps: Mapping[str, tuple[float, ...]]
    candidate: Candidate | None = None
    shapes: Mapping[str, float] = field(default_factory=dict)

    def values(self, config: Config, amounts: Mapping[str, float]) -> dict[str, float]:
        """The parameters of a configuration after the change, by full name (SI), within bounds; `amounts`: from neutral, of
        shapes from the middle."""
        if self.candidate is not None:
            shape, declared = middle_of(self.candidate)[0].shape, self.candidate.effect.parameters
            middle = {p.name: shape.get(p.name, float(p.neutral or 0.0)) for p in declared}
            values = {p.name: moved(p, middle[p.name], amounts.get(p.name, 0.0)) for p in declared}
            within = {p.name: min(max(values[p.name], p.bounds[0]), p.bounds[1]) for p in declared}
            return {f'effects.{self.name}.{name}': value for name, value in within.items()}
        if self.name == COOLING:
            return {COOLING: config.parameters[COOLING] * exp(amounts[COOLING])}
        return {}

    def in_config(self, config: Config, amounts: Mapping[str, float]) -> Config:
        """The model after the change."""
        values = self.values(config, amounts)
        if self.candidate is None:
            return config.variant(values)
        return with_effect(config, self.candidate.effect, {name.rpartition('.')[2]: v for name, v in values.items()})

    def ambient(self, amounts: Mapping[str, float]) -> float:
        """By how much the ambient temperature is another one than was said [K]."""
        return amounts.get(ROOM, 0.0)


def causes_for(config: Config, folders: Iterable[Path] = ()) -> tuple[Cause, ...]:
    """What may change of a configured robot: the effects that a diagnosis tries, cooling, ambient temperature, lost wires.

    All begin at the instant that is asked for, so that an effect which is constant is none beside the one that begins at an
    instant of its own.
    """
    candidates = list(candidates_for(config, folders))
    structure = config.structure
    lost = replace(LOST_WIRES, files=(Path(__file__),))
    if structure.coordinates:
        candidates.append(candidate_of(effect_on(lost, structure, config.parameters)))
    beginning = [one for one in candidates if instants_of(one.effect)]
    constant = {name for one in beginning for name in constant_kin(one, candidates)}
    causes = [effect_cause(one) for one in candidates if one.name not in constant]
    if COOLING in config.parameters:
        causes.append(Cause(COOLING, 'the cooling of the wires (wire.lambda)', {COOLING: (COOLING_STEP, -COOLING_STEP)}))
    causes.append(Cause(ROOM, 'the ambient temperature', {ROOM: (AMBIENT_STEP, -AMBIENT_STEP)}))
    return tuple(causes)


def constant_kin(beginning: Candidate, candidates: Sequence[Candidate]) -> list[str]:
    """The effects that differ from one which begins at an instant in that they are always there."""
    effect = beginning.effect
    return [
        one.name
        for one in candidates
        if one.name in effect.confused_with
        and one.effect.order == effect.order
        and not instants_of(one.effect)
        and not uses_time(one.effect)
    ]


def effect_cause(candidate: Candidate) -> Cause:
    """An effect that begins, probed with the middle of its shapes; what is an instant is that at which it begins."""
    steps: dict[str, tuple[float, ...]] = {}
    for probe in middle_of(candidate):
        steps[probe.parameter] = (*steps.get(probe.parameter, ()), probe.step)
    instants = instants_of(candidate.effect)
    shapes = [one for one in candidate.effect.parameters if one.neutral is None and one.name not in instants]
    quarters = {one.name: quarter_of(one, *one.realistic) for one in shapes if one.realistic is not None}
    return Cause(candidate.name, candidate.effect.phrase, steps, candidate, quarters)


def quarter_of(parameter: Parameter, low: float, high: float) -> float:
    """A quarter of the realistic range of a shape, as it is moved."""
    return (log(high / low) if is_scale(parameter) else high - low) / 4.0


def is_scale(parameter: Parameter) -> bool:
    """Whether a parameter is a positive one that has no neutral value, of which the logarithm is moved."""
    return parameter.neutral is None and parameter.realistic is not None and parameter.realistic[0] > 0.0


def moved(parameter: Parameter, value: float, amount: float) -> float:
    """A parameter at another value than the one given: by an amount, or of a scale by that of its logarithm."""
    return value * exp(amount) if is_scale(parameter) else value + amount


def middle_of(candidate: Candidate) -> tuple[Probe, ...]:
    """The probes of an effect with the middle of its shapes."""
    family = candidate.families[len(candidate.families) // 2]
    now = dict.fromkeys(instants_of(candidate.effect), 0.0)
    return tuple(Probe(one.parameter, one.neutral, one.step, {**one.shape, **now}) for one in family)


def one_way_each(steps: Mapping[str, Sequence[float]]) -> list[dict[str, float]]:
    """Choices of parameters that act together, each with one of its steps."""
    ways = [[(name, None), *((name, step) for step in of_one)] for name, of_one in steps.items()]
    chosen = [{name: step for name, step in choice if step is not None} for choice in product(*ways)]
    return [choice for choice in chosen if choice]
