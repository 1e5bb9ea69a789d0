"""What belongs to a bench: effects that its map declares, parts of every fit under their priors, and findings of none."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from difflib import get_close_matches

from sma_sim.evidence.data.recording import Dataset
from sma_sim.evidence.estimation.free_parameters import BOUND_STDS, FreeParameter
from sma_sim.evidence.estimation.starting_values import started_from_curves
from sma_sim.model.config import Config
from sma_sim.model.effects.discovery import ActiveEffect, FoundEffect, effects_on, find_effects
from sma_sim.model.effects.meaning import acts_on
from sma_sim.model.errors import UserError

GRADIENT = 'temperature_gradient'  # the effect of a specimen that is not equally warm


def with_nuisance_effects(config: Config, dataset: Dataset) -> Config:
    """The configuration with the effects that the dataset's map declares, at their neutral values; active ones stay.

    Raises UserError for an effect, a scope or a parameter that there is not.
    """
    if not dataset.nuisances:
        return config
    active = {given.found.effect.name: given.found for given in config.effects}
    structure, more = config.structure.structure, list[ActiveEffect]()
    known = effects_on(find_effects(), dataset.nuisances.keys() - active, structure, config.parameters) | active
    for name, stds in dataset.nuisances.items():
        found = known.get(name)
        if found is None:
            expected = sorted(name for name, effect in known.items() if acts_on(effect.effect, structure))
            raise UserError(f'nuisances of the map: {name} is no effect on a {structure.title}{hint(name, expected)}')
        check_parameters(name, found, stds)
        if name not in active and acts_on(found.effect, structure):  # a map may serve a part of its campaign
            values = (p.default if p.neutral is None else p.neutral for p in found.effect.parameters)
            more.append(ActiveEffect(found, tuple(values)))
    return replace(config, effects=(*config.effects, *more))


def starting_model(dataset: Dataset, config: Config, is_fitted: bool = True) -> Config:
    """Where a fit begins: with the effects of the bench, and with what the curves of tests of a wire show.

    Raises UserError for effects that the map declares and that there are not.
    """
    return started_from_curves(dataset, with_nuisance_effects(config, dataset), is_fitted)[0]


def with_temperature_gradient(config: Config) -> Config:
    """The configuration of a specimen whose temperature may differ from end to end; itself where one is active already."""
    if any(given.found.effect.name == GRADIENT for given in config.effects):
        return config
    found = effects_on(find_effects(), [GRADIENT], config.structure.structure, config.parameters)[GRADIENT]
    values = tuple(p.default for p in found.effect.parameters)
    return replace(config, effects=(*config.effects, ActiveEffect(found, values)))


def check_parameters(name: str, found: FoundEffect, given: Iterable[str]) -> None:
    """Raise UserError for parameters that the effect has not."""
    names = [p.name for p in found.effect.parameters]
    for wrong in (parameter for parameter in given if parameter not in names):
        raise UserError(f'nuisances of the map, {name}: no parameter {wrong}; expected some of {", ".join(names)}')


def hint(name: str, known: Sequence[str]) -> str:
    """What may have been meant."""
    close = get_close_matches(name, known, n=1, cutoff=0.4)
    return f'; did you mean {close[0]}?' if close else f'; expected some of {", ".join(known)}'


def with_nuisance_names(free: tuple[str, ...] | None, dataset: Dataset, config: Config) -> tuple[str, ...] | None:
    """The parameters to fit, with those of the bench that the model has; None, all, and (), a model as it is, stay."""
    active = [one.found.effect.name for one in config.effects]
    declared = (f'effects.{name}.{parameter}' for name in active for parameter in dataset.nuisances.get(name, ()))
    return (*free, *declared) if free else free


def under_nuisance_priors(free: Sequence[FreeParameter], dataset: Dataset) -> tuple[FreeParameter, ...]:
    """Free parameters, those of the bench's effects under the priors of its map; what that leaves out is not fitted."""
    kept = []
    for parameter in free:
        group, _, name = parameter.name.removeprefix('effects.').rpartition('.')
        stds = dataset.nuisances.get(group) if parameter.name.startswith('effects.') else None
        if stds is None:
            kept.append(parameter)
        elif name in stds:
            kept.append(with_prior_std(parameter, stds[name]))
    return tuple(kept)


def with_prior_std(parameter: FreeParameter, std: float) -> FreeParameter:
    """A parameter under a normal prior of this standard deviation (SI) about its value, within its bounds."""
    low, high = parameter.value(parameter.low), parameter.value(parameter.high)
    scale = std / parameter.center if parameter.log else std
    plain = replace(parameter, scale=scale)
    ends = (plain.coordinate(low) if low > 0.0 or not parameter.log else -BOUND_STDS, plain.coordinate(high))
    return replace(plain, low=max(-BOUND_STDS, ends[0]), high=min(BOUND_STDS, ends[1]))
