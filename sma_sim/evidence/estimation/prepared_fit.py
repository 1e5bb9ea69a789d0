"""What a fit begins with: the model on the bench of the recordings, with its effects and what curves of tests show."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from sma_sim.evidence.data.recording import Dataset, Recording
from sma_sim.evidence.data.recordings import same_options
from sma_sim.evidence.estimation.curve_features import CurveFeatures, curve_features, starting_values
from sma_sim.evidence.estimation.free_parameters import free_in_dataset
from sma_sim.evidence.estimation.heat_balance import shown_by_warming
from sma_sim.model.config import AUTO, MODELS, Config
from sma_sim.model.effects.discovery import ActiveEffect, effects_on, find_effects
from sma_sim.model.effects.effect import Effect
from sma_sim.model.effects.meaning import acts_on, channel_slots
from sma_sim.model.errors import PhysicsWarning, UserError
from sma_sim.model.nearest import suggestion
from sma_sim.model.structures.discovery import known_structures
from sma_sim.solver.end_of_run import warn_of_idle_effects


@dataclass(frozen=True)
class PreparedFit:
    """Recordings, and the model that fits to them begin with.

    `config`: on their leading bench, with the effects that their map declares (parts of every fit under their priors, and
    findings of none), with what `curves` show in place of defaults, and with the first of the `kinetics` to try.
    """

    dataset: Dataset
    config: Config
    curves: CurveFeatures
    kinetics: tuple[str, ...]

    def with_kinetics(self, kinetics: str) -> PreparedFit:
        """The same with one of the kinetics."""
        return replace(self, config=self.config.variant(kinetics=kinetics))

    def on(self, dataset: Dataset) -> PreparedFit:
        """The same model for other recordings of the bench."""
        return replace(self, dataset=dataset, curves=curve_features(dataset))


def prepare(dataset: Dataset, config: Config, kinetics: str | None = None, free: Sequence[str] | None = None) -> PreparedFit:
    """What a fit of the parameters `free` (None: those that such data determine) begins with.

    Where there are none the model is compared as it is; where they are named it starts from isobaric tests alone, of which
    no default knows anything. Raises UserError for effects that the map declares and that there are not.
    """
    config, curves = on_leading_bench(config, dataset), curve_features(dataset)
    if free != ():
        config = with_nuisance_effects(config, dataset)
        config = started_from(curves, config, free is None)
    if free is None:
        config = started_from_warming(dataset, config)
    tried = kinetics_to_try(kinetics, config)
    return PreparedFit(dataset, config.with_covariance(None).variant(kinetics=tried[0]), curves, tried)


def check_systems(dataset: Dataset, config: Config) -> None:
    """Raise UserError where there is no recording, or one of another system than the model's."""
    if not dataset.recordings:
        raise UserError('there is no recording')
    for recording in dataset.recordings:
        if recording.system != config.structure.name and not same_options(recording.system, config.system):
            raise UserError(
                f'{recording.name} is a recording of a {recording.system}, the configuration says system = '
                f'{config.system}: change it, or leave the recording out'
            )


def check_data(dataset: Dataset, config: Config) -> None:
    """As `check_systems`, and for numbers that cannot be in SI units: what all that takes recordings begins with. Warns of
    effects that are left out."""
    check_systems(dataset, config)
    warn_of_idle_effects(config, stacklevel=5)
    for recording in dataset.recordings:
        if words := recording.unit_mismatch():
            raise UserError(words)


def with_nuisance_effects(config: Config, dataset: Dataset) -> Config:
    """The configuration with the effects that the dataset's map declares, at their neutral values; active ones stay.

    Warns of those that act on nothing which these recordings measure. Raises UserError for an effect, a scope or a parameter
    that there is not.
    """
    if not dataset.nuisances:
        return config
    active = {given.effect.name: given.effect for given in config.effects}
    structure, more = config.structure, list[ActiveEffect]()
    known = effects_on(find_effects(), dataset.nuisances.keys() - active, structure, config.parameters) | active
    for name, stds in dataset.nuisances.items():
        found = known.get(name)
        if found is None:
            expected = sorted(name for name, effect in known.items() if acts_on(effect, structure))
            hint = suggestion(name, expected) or f'; expected some of {", ".join(expected)}'
            raise UserError(f'nuisances of the map: {name} is no effect on a {structure.title}{hint}')
        check_parameters(name, found, stds)
        if not any(acts_on_measured(found, recording) for recording in dataset.recordings):
            words = f'nuisances of the map: {name} acts on nothing that these recordings measure'
            warnings.warn(f'{words}; what is imposed is taken as it is', PhysicsWarning, stacklevel=4)
        if name not in active and acts_on(found, structure):  # a map may serve a part of its campaign
            values = (p.default if p.neutral is None else p.neutral for p in found.parameters)
            more.append(ActiveEffect(found, tuple(values)))
    return replace(config, effects=(*config.effects, *more))


def acts_on_measured(effect: Effect, recording: Recording) -> bool:
    """Whether an effect has a meaning on the bench of a recording, one of sensors on a channel that was measured."""
    structure = recording.structure
    slots = dict(zip(structure.channels, channel_slots(effect, structure), strict=True))
    is_of_channels = any(slot >= 0 for slot in slots.values())
    return acts_on(effect, structure) and (not is_of_channels or any(slots[name] >= 0 for name in recording.channels))


def check_parameters(name: str, effect: Effect, given: Iterable[str]) -> None:
    """Raise UserError for parameters that the effect has not."""
    names = [p.name for p in effect.parameters]
    for wrong in (parameter for parameter in given if parameter not in names):
        raise UserError(f'nuisances of the map, {name}: no parameter {wrong}; expected some of {", ".join(names)}')


def kinetics_to_try(asked: str | None, config: Config) -> tuple[str, ...]:
    """What `asked` says, as in `FitOptions.kinetics`: both for ``'auto'``."""
    model = config.kinetics if asked is None else asked
    return MODELS if model == AUTO else (model,)


def check_kinetics(asked: str | None) -> None:
    """Raise UserError for kinetics that there are not."""
    known = (*MODELS, AUTO)
    if asked not in (None, *known):
        hint = suggestion(asked, known)
        raise UserError(f'kinetics = {asked!r}: expected one of {", ".join(known)}{hint}')


def agreed_kinetics(asked: str | None, of_options: str | None) -> str | None:
    """The kinetics of a request, or those of its options where it says none. Raises UserError where both differ."""
    check_kinetics(asked)
    if None not in (asked, of_options) and asked != of_options:
        raise UserError(f'kinetics = {asked!r}, but options have kinetics = {of_options!r}: leave one of both out')
    return of_options if asked is None else asked


def on_leading_bench(config: Config, dataset: Dataset) -> Config:
    """The configuration on that bench of the recordings whose model says most: with a heat balance before one without."""
    benches = dict.fromkeys(recording.system for recording in dataset.recordings)
    if set(benches) == {config.structure.name}:
        return config
    return config.on_bench(min(benches, key=lambda name: known_structures()[name].imposed_temperature >= 0))


def started_from_curves(dataset: Dataset, config: Config, is_fitted: bool = True) -> tuple[Config, CurveFeatures]:
    """A configuration started from the curves of a dataset, as `started_from` does, and their features."""
    curves = curve_features(dataset)
    return started_from(curves, config, is_fitted), curves


def started_from(curves: CurveFeatures, config: Config, is_fitted: bool = True) -> Config:
    """A configuration with the starting values of tests in place of those that have their defaults, and no prior.

    Without such tests it is as it was. One that is not `is_fitted` as a whole, but compared or fitted in named parameters,
    starts from isobaric tests alone.
    """
    if not (curves if is_fitted else curves.isobaric):
        return config
    return config.variant(of_defaults(starting_values(curves), config))


def started_from_warming(dataset: Dataset, config: Config) -> Config:
    """A configuration with the heat capacity and the heat transfer that the warming of single wires shows, where a fit that
    starts from a default could not come there: such a wire is not alone, as one that is woven into a fabric. Warns of it."""
    free = {one.name: one for one in free_in_dataset(config, dataset, None)}
    shown = of_defaults(shown_by_warming(dataset, config), config)
    beyond = {
        name: value
        for name, value in shown.items()
        if name in free and not free[name].low <= free[name].coordinate(value) <= free[name].high
    }
    for name, value in beyond.items():
        words = (
            f'{name}: the warming of the wire shows {value:.3g} {free[name].unit}, from which the fit starts; its default, '
            f'{config.parameters[name]:g}, is out of reach: check power, wire.n, wire.r0, wire.l0, and what else is heated'
        )
        warnings.warn(words, PhysicsWarning, stacklevel=4)
    return config.variant(beyond)


def of_defaults(shown: Mapping[str, float], config: Config) -> dict[str, float]:
    """Those of the values that are shown whose parameters have their defaults, and no prior."""
    defaults: Mapping[str, float] = config.structure.default_values
    return {
        name: value
        for name, value in shown.items()
        if config.parameters[name] == defaults[name] and name not in config.priors
    }
