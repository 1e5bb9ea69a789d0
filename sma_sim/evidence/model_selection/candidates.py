"""The effects that a diagnosis tries, and the finite steps away from nothing by which it probes them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, product
from pathlib import Path

from sma_sim.model.config import Config
from sma_sim.model.effects.conversion import effect_on
from sma_sim.model.effects.discovery import ActiveEffect, find_effects
from sma_sim.model.effects.effect import Effect
from sma_sim.model.effects.meaning import is_tried
from sma_sim.model.parameters import Parameter
from sma_sim.model.renamed import renamed

FRACTIONS = (1 / 6, 1 / 2, 5 / 6)  # of a realistic range without a neutral value, where it is probed: centres of its thirds
PROBE_FRACTION = 0.3  # of a realistic range that begins at neutral: a step that shows, and is still in the linear part


@dataclass(frozen=True, eq=False)
class Probe:
    """An effect a finite step away from nothing: `parameter` at `neutral + step`, the shape parameters at `shape`.

    Each is only equal to itself: what was simulated with it is found by it.
    """

    parameter: str
    neutral: float
    step: float
    shape: Mapping[str, float]


@renamed(found='effect')
@dataclass(frozen=True)
class Candidate:
    """An effect to try. `families` hold the probes that share a shape: all strengths, up and down; all is in the middle in
    the middle one."""

    effect: Effect
    families: tuple[tuple[Probe, ...], ...]

    @property
    def name(self) -> str:
        """Name of the effect."""
        return self.effect.name

    @property
    def probes(self) -> Iterator[Probe]:
        """Those of all families."""
        return chain.from_iterable(self.families)

    def largest(self, probe: Probe) -> float:
        """How many steps of a probe its parameter is realistic; at least one."""
        (parameter,) = (one for one in self.effect.parameters if one.name == probe.parameter)
        low, high = parameter.realistic or parameter.bounds
        return max(1.0, ((high if probe.step > 0.0 else low) - probe.neutral) / probe.step)


def candidates_for(config: Config, folders: Iterable[Path] = ()) -> tuple[Candidate, ...]:
    """The effects that may be missing from a configuration, by name; those in `folders` take part.

    Effects that are active already, in whatever scope, that have no meaning in the system or are not looked for there,
    or that have no neutral value, are none.
    """
    active = {effect.effect.plain_name for effect in config.effects}
    missing = (found for name, found in sorted(find_effects(folders).items()) if name not in active)
    structure = config.structure
    acting = (effect_on(found, structure, config.parameters) for found in missing if is_tried(found, structure))
    candidates = (candidate_of(found, structure.is_quasi_static) for found in acting)
    return tuple(candidate for candidate in candidates if candidate.families)


def candidate_of(effect: Effect, every_shape: bool = False) -> Candidate:
    """All probes of one effect; `every_shape`: with all combinations of its shapes, where runs cost little."""
    shapes = [p for p in effect.parameters if p.neutral is None]
    if not every_shape:
        return candidate_at(effect, shape_grid(shapes))
    names = [p.name for p in shapes]
    return candidate_at(effect, [dict(zip(names, values, strict=True)) for values in product(*map(shape_values, shapes))])


def candidate_at(
    effect: Effect, shapes: Iterable[Mapping[str, float]], probed: Iterable[Parameter] | None = None
) -> Candidate:
    """The probes of one effect, a family for each set of values of its shapes; of the parameters `probed` (default: all).

    With the shapes in the middle there is a family for each size of the strengths: what a fitted delay absorbs of a lag is
    linear in it, and what it leaves is not.
    """
    strengths = [p for p in (effect.parameters if probed is None else probed) if p.neutral is not None]
    every, families = list(shapes), list[tuple[Probe, ...]]()
    for k, shape in enumerate(every):
        fractions = FRACTIONS if k == len(every) // 2 else FRACTIONS[1:2]
        sizes = dict.fromkeys(tuple((p, step) for p in strengths for step in steps_of(p, part)) for part in fractions)
        families += [tuple(Probe(p.name, float(p.neutral or 0.0), step, shape) for p, step in size) for size in sizes]
    return Candidate(effect, tuple(family for family in families if family))


def instants_of(effect: Effect) -> list[str]:
    """The parameters of an effect that are instants of a recording."""
    return [p.name for p in effect.parameters if p.quantity == 'instant']


def at_instants(candidate: Candidate, instants: Sequence[float]) -> Candidate:
    """A candidate that is probed at these instants [s], its other shapes in the middle; itself where it has no instant."""
    names = instants_of(candidate.effect)
    if not names:
        return candidate
    grid = shape_grid([p for p in candidate.effect.parameters if p.neutral is None])
    centre = grid[len(grid) // 2]
    return candidate_at(candidate.effect, [centre | dict.fromkeys(names, instant) for instant in instants])


def shape_grid(shapes: Sequence[Parameter]) -> list[dict[str, float]]:
    """The centre of the shapes' grid, in the middle, and each shape alone at its other values.

    All combinations of four shapes would be nine times as many, and a fit finds the way between them.
    """
    values = {parameter.name: shape_values(parameter) for parameter in shapes}
    centre = {name: of_one[len(of_one) // 2] for name, of_one in values.items()}
    others = [centre | {name: value} for name, of_one in values.items() for value in of_one if value != centre[name]]
    half = len(others) // 2
    return [*others[:half], centre, *others[half:]]


def shape_values(parameter: Parameter) -> list[float]:
    """Values of a parameter that is undefined while the effect is off: a grid over its realistic range."""
    if parameter.realistic is None:
        return [parameter.default]
    return [interpolated(*parameter.realistic, fraction) for fraction in FRACTIONS]


def steps_of(parameter: Parameter, fraction: float) -> list[float]:
    """Finite steps from the neutral value, up and down as far as the realistic range goes; to a `fraction` of a range that
    does not begin there."""
    neutral = float(parameter.neutral or 0.0)
    low, high = parameter.realistic or parameter.bounds
    if parameter.realistic is None:
        step = parameter.default - neutral
        return [step] if step else []
    if low > neutral:
        return [interpolated(low - neutral, high - neutral, fraction)]
    if high < neutral:
        return [-interpolated(neutral - high, neutral - low, fraction)]
    return [PROBE_FRACTION * (end - neutral) for end in (high, low) if end != neutral]


def interpolated(low: float, high: float, fraction: float) -> float:
    """A point of a range, on a logarithmic scale where that has one."""
    if low > 0.0:
        return low * math.pow(high / low, fraction)
    return low + fraction * (high - low)


def with_effect(config: Config, effect: Effect, values: Mapping[str, float]) -> Config:
    """The configuration with one more active effect: at `values`, its other parameters neutral, or at their defaults.

    Of one that is active, with one in another form, what it has already stays as it is.
    """
    law = law_of(effect, config.effects)
    known = {**(law.by_short_name if law else {}), **values}
    at = tuple(known.get(p.name, p.default if p.neutral is None else p.neutral) for p in effect.parameters)
    others = tuple(one for one in config.effects if one is not law)
    return config.variant(effects=(*others, ActiveEffect(effect, at)))


def law_of(effect: Effect, active: Iterable[ActiveEffect]) -> ActiveEffect | None:
    """Of active effects the one of which an effect is another form."""
    if not effect.scope.field:
        return None
    return next((one for one in active if one.effect.plain_name == effect.plain_name), None)
