"""Parameters from YAML files and from ``name=value`` words, checked against their declarations."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from shlex import quote
from types import MappingProxyType
from typing import Any, TypeAlias

from sma_sim.model.archive import pickled
from sma_sim.model.argument_checks import expect
from sma_sim.model.comparable import Comparable
from sma_sim.model.covariance import MATRIX, NAMES, ParameterCovariance, covariance_given
from sma_sim.model.effects.conversion import effect_on
from sma_sim.model.effects.discovery import ActiveEffect, declared_effect, effects_on, find_effects, package_effects
from sma_sim.model.effects.effect import Effect, EffectChoice
from sma_sim.model.effects.scope import SEPARATOR
from sma_sim.model.given import (
    COMMAND_LINE,
    KINETICS_NAMES,
    LISTS,
    SWITCH_WORDS,
    RawValue,
    effect_words,
    given_over,
    given_values,
    named_folders,
    names_in,
)
from sma_sim.model.likely_unit import likely_unit, met_in_practice, unit_hint
from sma_sim.model.nearest import suggestion as suggestion
from sma_sim.model.parameter_yaml import ConfigError as ConfigError
from sma_sim.model.parameters import Parameter, is_number
from sma_sim.model.program_parameters import SETTINGS, Setting, joint_name_setting
from sma_sim.model.renamed import renamed, warn_of
from sma_sim.model.structures.discovery import (
    declared_structure,
    find_structures,
    known_structures,
    package_structures,
    structure_of_size,
)
from sma_sim.model.structures.structure import Structure

MODELS = ('hybrid', 'mas')
AUTO = 'auto'  # of kinetics: fits take the more probable one, simulations are hybrid
DEFAULT_SYSTEM = 'module'
ARGUMENTS = {'system': 'system', 'model': 'kinetics', 'kinetics': 'kinetics', 'effects.active': 'effects'}  # of Config
PRIORS = 'priors.'  # before the name of a parameter: the standard deviation of what is known of it
NEVER_FITTED = ('environment', 'initial', 'solver', 'node', 'check', 'observer', 'guard', 'control')  # groups of parameters
ROUNDING = 1e-12  # relative: by so much the values of a fit may lie beyond the bounds that it keeps to
NOTHING: Mapping[str, Any] = MappingProxyType({})
GivenEffect: TypeAlias = str | Effect | EffectChoice | ActiveEffect
GivenEffects: TypeAlias = GivenEffect | Iterable[GivenEffect] | Mapping[str, Mapping[str, float] | None]


def default_parameters(system: str = 'module') -> dict[str, float]:
    """The default values of all parameters: the paper's, beside them those of another structure.

    Parameters
    ----------
    system : str
        A system of the package.

    Returns
    -------
    dict
        Values in SI units by full name, such as ``wire.E_A``.

    Raises
    ------
    UserError
        For a system that there is not.

    Examples
    --------
    >>> import sma_sim
    >>> sma_sim.default_parameters()['wire.r0']
    7.5e-05
    """
    return structure_named(system).default_values


def settings_of(structure: Structure) -> dict[str, Setting]:
    """The nodes' texts and switches by full name: also the names of a structure's joints, for the live check."""
    names = {name: f'check.name_{name}' for name in structure.coordinate_names}
    return dict(SETTINGS) | {full: joint_name_setting(name) for name, full in names.items()}


@renamed(model='kinetics')
@dataclass(frozen=True, init=False, repr=False, eq=False)
class Config(Comparable):
    """Checked parameters of a model: what is wrong raises where it is constructed, and nothing changes afterwards.

    Parameters
    ----------
    parameters : mapping of str to float
        Values in SI units by full name, such as ``{'beam.E': 2.2e9}``, also of active effects (``effects.NAME.PARAMETER``).
        Those that are left out have the defaults of the system. One that looks as if it were in another unit is a text with
        its unit where it is meant: ``'8 Pa/K'``.
    system : str or Structure
        What the wires pull on: a name such as ``'module'``, or a structure itself, also one of your own.
    kinetics : str
        How a wire transforms: ``'hybrid'`` or ``'mas'``, which everything keeps; ``'auto'``: fits take the more probable of
        both, simulations are hybrid.
    effects : sequence
        What acts beside the model, one or several of ``sma_sim.effects.gravity(g_y=-9.81)``, ``'gravity:g_y=-9.81'`` as on
        the command line, an `Effect`; or a mapping ``{'gravity': {'g_y': -9.81}}``.
    settings : mapping
        Settings of the node that are not numbers; those that are left out have their defaults.
    own_structure : Structure, optional
        The structure where it is not one of the package and has files.
    priors : mapping of str to float
        How well values are known before a fit: standard deviations in SI units by full name, such as ``{'wire.E_A': 5e8}``.

    Attributes
    ----------
    parameters, settings, priors : mapping
        All values, read-only.
    system, kinetics : str
        Name of the structure; kinetics.
    effects : tuple of ActiveEffect
        Active effects with their parameter values.
    own_structure : Structure or None
        The structure where it is not one of the package.
    covariance : ParameterCovariance or None
        Covariance of fitted values, which `with_covariance` sets and `Observer` starts with; further fits do not.

    Raises
    ------
    UserError
        For an unknown name, a value that is no number or out of range, an effect or a structure that there is not.

    Examples
    --------
    >>> import sma_sim
    >>> sma_sim.Config({'beam.E': 2.2e9}, kinetics='mas', effects=[sma_sim.effects.gravity(g_y=-9.81)])
    Config(system='module', kinetics='mas', effects=['gravity'], {'beam.E': 2.2e+09})
    """

    parameters: Mapping[str, float]
    system: str
    kinetics: str
    effects: tuple[ActiveEffect, ...]
    settings: Mapping[str, str | bool]
    own_structure: Structure | None
    priors: Mapping[str, float]
    covariance: ParameterCovariance | None = field(init=False)

    def __init__(
        self,
        parameters: Mapping[str, float | str] = NOTHING,
        system: str | Structure = 'module',
        kinetics: str = AUTO,
        effects: GivenEffects = (),
        settings: Mapping[str, str | bool] = NOTHING,
        own_structure: Structure | None = None,
        priors: Mapping[str, float] = NOTHING,
    ) -> None:
        structure = structure_named(system, own_structure)
        of_effects, values = split_parameters(as_mapping('parameters', parameters))
        size = structure.size_name
        if size in values:
            structure = structure_of_size(structure, {size: checked_number(size, values[size], structure.declared)})
        declared, texts = structure.all_parameters, settings_of(structure)
        numbers = {
            name: checked_number(name, one, declared)
            for name, one in values.items()
            if name in declared or not is_noise_elsewhere(name)
        }
        words = {name: RawValue(word, in_config('settings')) for name, word in as_mapping('settings', settings).items()}
        for name in words.keys() - texts.keys():
            raise ConfigError(f'unknown setting {name} ({in_config("settings")}){suggestion(name, texts)}')
        chosen = {name: checked_setting(name, one, texts[name]) for name, one in words.items()}
        numbers = structure.default_values | numbers
        is_own = own_structure is not None or structure.family not in package_structures()
        active = chosen_effects(effects, of_effects, structure, numbers)
        stds = {name: RawValue(value, in_config('priors')) for name, value in as_mapping('priors', priors).items()}
        self.__dict__.update(
            parameters=MappingProxyType(numbers),
            system=system if isinstance(system, str) and own_structure is None else structure.family,
            kinetics=checked_choice('kinetics', RawValue(kinetics, in_config('kinetics')), (*MODELS, AUTO)),
            effects=active,
            settings=MappingProxyType({name: setting.default for name, setting in texts.items()} | chosen),
            own_structure=structure if is_own else None,
            priors=MappingProxyType(checked_priors(stds, structure, active)),
            covariance=None,
        )

    def __reduce__(self) -> tuple[Any, ...]:
        return pickled(self)

    def saved(self) -> dict[str, Any]:
        """What `from_saved` makes the same one of."""
        given: dict[str, Any] = {'parameters': self.parameters, 'kinetics': self.kinetics, 'settings': self.settings}
        given |= {'priors': self.priors, 'covariance': self.covariance}
        return given | {'system': self.system if self.own_structure is None else self.own_structure, 'effects': self.effects}

    @classmethod
    def from_saved(cls, saved: Mapping[str, Any]) -> Config:
        """The configuration of which `saved` is all."""
        values, system = MappingProxyType(saved['parameters']), saved['system']
        made = cls(values, system, saved['kinetics'], settings=saved['settings']).variant(effects=saved['effects'])
        return (replace(made, priors=saved['priors']) if saved['priors'] else made).with_covariance(saved['covariance'])

    def __copy__(self) -> Config:
        return self  # nothing of it changes

    def __deepcopy__(self, memo: Any) -> Config:
        return self

    def with_covariance(self, covariance: ParameterCovariance | Mapping[str, RawValue] | None) -> Config:
        """The same with another covariance of its values (also by the names of a file), or none.

        Raises UserError for what is no covariance of parameters that a fit can change.
        """
        expect('covariance', covariance, ParameterCovariance | Mapping[str, RawValue] | None)
        made, active = self.variant(), [one.effect.name for one in self.effects]
        declared = fitted_parameters(self.structure, self.effects)
        made.__dict__['covariance'] = covariance_given(covariance, declared, active)
        return made

    def variant(
        self,
        parameters: Mapping[str, float] = NOTHING,
        *,
        kinetics: str | None = None,
        effects: tuple[ActiveEffect, ...] | None = None,
    ) -> Config:
        """The same with some parameters (those of effects too), the kinetics or the effects changed, unchecked: for fits,
        which make thousands.

        They keep within the bounds of what was checked.
        """
        made = object.__new__(Config)
        made.__dict__.update(self.__dict__)
        if kinetics is not None:
            made.__dict__['kinetics'] = kinetics
        if effects is not None:
            made.__dict__['effects'] = effects
        if parameters:
            own = {name: value for name, value in parameters.items() if name in self.parameters}
            made.__dict__['parameters'] = MappingProxyType({**self.parameters, **own})
            if len(own) < len(parameters):
                made.__dict__['effects'] = tuple(one.with_values(parameters) for one in made.effects)
        return made

    def scaled(self, factors: Mapping[str, float]) -> Config:
        """The same with some parameters multiplied, unchecked as by `variant`; what is none is left out."""
        own = {name: factor * self.parameters[name] for name, factor in factors.items() if name in self.parameters}
        return self.variant(own) if own else self

    @property
    def values(self) -> dict[str, float]:
        """The values of all parameters by full name, those of effects too."""
        return dict(self.parameters) | values_of(self.effects)

    @property
    def simulated_kinetics(self) -> str:
        """``'hybrid'`` or ``'mas'``: those of a simulation, and of a fit at hand."""
        return MODELS[0] if self.kinetics == AUTO else self.kinetics

    @property
    def model(self) -> str:
        """Old name of `simulated_kinetics`."""
        warn_of(Config, 'model', 'kinetics')
        return self.simulated_kinetics

    @property
    def structure(self) -> Structure:
        """What the wires pull on, of the size that the parameters say."""
        return structure_of_size(self.own_structure or package_structures()[self.system], self.parameters)

    def on_bench(self, name: str) -> Config:
        """The same wire and effects on another bench: a structure that differs in its options only, such as one whose wires
        have an imposed temperature.

        What only this bench has, such as the lag of a load-controlled machine, keeps its value; what only the other one has
        gets its default, and wires start as they do there.
        """
        own = self.structure
        if name == own.name:
            return self
        members = [one for one in known_structures().values() if one.original == own.original]
        sized = (structure_of_size(one, self.parameters) for one in members)
        benches = {one.name: one for one in sized}
        if name not in benches:
            expected = ', '.join(benches)
            raise ConfigError(f'no bench {name!r} of {own.original}{suggestion(name, benches)}; expected one of {expected}')
        other = benches[name]
        defaults = other.default_values
        values = {n: v for n, v in self.parameters.items() if n not in other.defaults and n not in own.defaults}
        effects = tuple(
            active
            if active.effect.scope.name
            else replace(active, effect=effect_on(active.effect.plain or active.effect, other, values))
            for active in self.effects
        )
        kept = {n: v for n, v in values.items() if n in defaults}
        settings = {n: v for n, v in self.settings.items() if n in settings_of(other)}
        priors = {n: std for n, std in self.priors.items() if n in kept or n.startswith('effects.')}
        known = self.covariance and self.covariance.of(
            [n for n in self.covariance.names if n in kept or n.startswith('effects.')]
        )
        own_structure = None if self.own_structure is None else other
        declared, given = fitted_parameters(other, effects), kept | values_of(effects)
        moved = {n: v for n, v in given.items() if n in declared}
        inside = {n: min(max(v, declared[n].bounds[0]), declared[n].bounds[1]) for n, v in moved.items()}
        kept |= {n: v for n, v in inside.items() if n in kept}
        effects = tuple(active.with_values(inside) for active in effects)
        made = Config(MappingProxyType(kept), other.family, self.kinetics, effects, settings, own_structure, priors)
        return made.variant(moved).with_covariance(known)  # unchecked: derivatives are taken across bounds

    def __repr__(self) -> str:
        defaults = self.structure.default_values
        changed = ', '.join(
            f'{name!r}: {value:g}' for name, value in self.parameters.items() if not same_number(value, defaults[name])
        )
        effects = ', '.join(repr(active.effect.name) for active in self.effects)
        return f'Config(system={self.system!r}, kinetics={self.kinetics!r}, effects=[{effects}], {{{changed}}})'


def values_of(effects: Iterable[ActiveEffect]) -> dict[str, float]:
    """The values of all parameters of effects, by full name."""
    return {name: value for active in effects for name, value in active.by_name.items()}


def fitted_parameters(structure: Structure, effects: Iterable[ActiveEffect]) -> dict[str, Parameter]:
    """What a fit can change, by full name."""
    declared = {name: one for name, one in structure.all_parameters.items() if name.split('.')[0] not in NEVER_FITTED}
    return declared | effect_parameters({active.effect.name: active.effect for active in effects})


def checked_priors(given: Mapping[str, RawValue], structure: Structure, effects: Iterable[ActiveEffect]) -> dict[str, float]:
    """Standard deviations of what a fit can change, by full name. Raises ConfigError."""
    declared = fitted_parameters(structure, effects)
    for name, one in given.items():
        if name not in declared:
            hint = suggestion(name, declared)
            raise ConfigError(f'{PRIORS}{name} ({one.where}): no fit of this model changes {name}{hint}')
        if isinstance(one.value, bool) or not isinstance(one.value, int | float) or not 0.0 < one.value < math.inf:
            unit = f' in {declared[name].unit}'.removesuffix(' in -')
            raise ConfigError(
                f'{PRIORS}{name} = {one.value!r} ({one.where}): expected a standard deviation{unit}, more than 0'
                f'{yaml_hint(one.value)}'
            )
    return {name: float(one.value) for name, one in given.items()}


def same_number(one: float, other: float) -> bool:
    """Whether two numbers are the same, or both are NaN."""
    return one == other or math.isnan(one) and math.isnan(other)


def is_noise_elsewhere(name: object) -> bool:
    """Whether a parameter is the noise of a channel that only other structures have: it says nothing of a model."""
    return any(name in one.noise for one in package_structures().values())


def is_noise_of_variant(name: str, structure: Structure) -> bool:
    """Whether a parameter is the noise of a channel that only a structure with other options has, as files for it say."""
    return any(name in one.noise for one in known_structures().values() if one.is_like(structure))


def in_config(argument: str) -> str:
    """Where a value was given."""
    return f'in Config({argument}=...)'


def as_mapping(argument: str, given: object) -> Mapping[str, Any]:
    """A mapping by name that was given to Config. Raises ConfigError."""
    if not isinstance(given, Mapping):
        raise ConfigError(f"{argument} = {given!r} ({in_config(argument)}): expected a mapping such as {{'wire.E_A': 12e9}}")
    return given


def split_parameters(given: Mapping[str, Any]) -> tuple[dict[str, RawValue], dict[str, RawValue]]:
    """The parameters of effects, and all others. Raises ConfigError for what is no parameter but an argument of Config.

    Read-only ones are those that another configuration has: whether their units are meant is not asked again.
    """
    of_effects, values, known = dict[str, RawValue](), dict[str, RawValue](), isinstance(given, MappingProxyType)
    for name, value in given.items():
        if name in ARGUMENTS:
            raise ConfigError(f'{name} is no parameter ({in_config("parameters")}): give Config({ARGUMENTS[name]}=...)')
        part = of_effects if isinstance(name, str) and name.startswith('effects.') else values
        part[name] = RawValue(value, in_config('parameters'), recorded=known)
    return of_effects, values


def structure_named(system: str | Structure, own: Structure | None = None) -> Structure:
    """The structure of this name, or the structure itself. Raises UserError for none, or for two that differ."""
    expect('own_structure', own, Structure | None)
    if own is not None:
        if system not in (DEFAULT_SYSTEM, own.name, own.family):
            raise ConfigError(f'system = {system!r} ({in_config("system")}): own_structure is {own.name!r}')
        return own
    if isinstance(system, Structure):
        return declared_structure(system)
    return package_structures()[checked_system(RawValue(system, in_config('system')), package_structures())]


def as_sequence(given: Any) -> Sequence[Any]:
    """Effects as they may be given: one or several; a mapping has values of parameters by name of the effect."""
    if isinstance(given, Mapping):
        return list(given.items())
    if isinstance(given, str | Effect | EffectChoice | ActiveEffect) or not isinstance(given, Iterable):
        return [given]
    return list(given)


def chosen_effects(
    effects: GivenEffects, given: dict[str, RawValue], structure: Structure, numbers: Mapping[str, float]
) -> tuple[ActiveEffect, ...]:
    """The active effects on a structure with these parameters; `given`: values of their parameters by full name.

    Raises UserError.
    """
    found: Mapping[str, Effect] = package_effects()
    ready, names = dict[str, ActiveEffect](), list[str]()
    for one in as_sequence(effects):
        if isinstance(one, ActiveEffect):
            ready[one.effect.name] = checked_active(one)
            names.append(one.effect.name)
        else:
            named, found = put_effect(one, given, found, in_config('effects'))
            names.append(named)
    names_in('effects', RawValue(names, in_config('effects')))
    for name in given:
        if (owner := name.split('.')[1]) not in names:
            raise ConfigError(f'{name} ({given[name].where}): {owner} is not active; give Config(effects=[{owner!r}])')
    if len(ready) == len(names) and not given:
        return tuple(ready.values())
    wanted = [name for name in names if name not in ready]
    asked = RawValue(wanted, in_config('effects'))
    plain = {name.partition(SEPARATOR)[0] for name in wanted}
    for name in plain - found.keys():
        raise unknown_effect(name, found, asked)
    on = effects_on({name: one for name, one in found.items() if name in plain}, wanted, structure, numbers)
    declared = effect_parameters(on) | effect_parameters({name: one.effect for name, one in ready.items()})
    known = {name: checked_number(name, one, declared) for name, one in given.items()}
    every = {name: active_effect(name, on, known, asked) for name in wanted} | {
        name: one.with_values(known) for name, one in ready.items()
    }
    return tuple(every[name] for name in names)


def put_effect(
    one: Any, given: dict[str, RawValue], found: Mapping[str, Effect], where: str
) -> tuple[str, Mapping[str, Effect]]:
    """The name of an effect as it may be given, and the effects that are known with it; its values go to `given`.

    Raises UserError for what is no effect, or one of your own with the name of another.
    """
    values: Mapping[str, Any] | None
    if isinstance(one, str):
        name, values = effect_words(one)
    elif isinstance(one, tuple):
        name, values = one
    elif isinstance(one, EffectChoice | Effect):
        choice = one if isinstance(one, EffectChoice) else EffectChoice(one, {})
        declared = declared_effect(choice.effect, found)
        name, values, found = choice.name, choice.values, {**found, declared.name: declared}
    else:
        raise ConfigError(f'effects: expected effects or their names, such as gravity; got {one!r} ({where})')
    if values is not None and not isinstance(values, Mapping):
        raise ConfigError(f"effects: expected values of {name} by name, such as {{'g_y': -9.81}}; got {values!r} ({where})")
    given |= {f'effects.{name}.{parameter}': RawValue(value, where) for parameter, value in (values or {}).items()}
    return str(name), found


def unknown_effect(name: str, found: Mapping[str, Effect], asked: RawValue) -> ConfigError:
    """The error of an effect that there is not; `asked`: where it was switched on."""
    return ConfigError(
        f'unknown effect {name} (effects.active, {asked.where}){suggestion(name, found)}; known are '
        f'{", ".join(sorted(found))}; your own need their folder in effects.paths'
    )


def checked_active(one: ActiveEffect) -> ActiveEffect:
    """An effect that is ready to act. Raises ConfigError where it has not one value for each of its parameters."""
    effect = one.effect
    if len(one.values) != len(effect.parameters):
        names = ', '.join(parameter.name for parameter in effect.parameters)
        raise ConfigError(f'effect {effect.name}: got {len(one.values)} values; expected one for each of {names}')
    for parameter, value in zip(effect.parameters, one.values, strict=True):
        given = RawValue(value, in_config('effects'), recorded=True)
        checked_value(f'effects.{effect.name}.{parameter.name}', given, parameter)
    return one


def flat_parameters(config: Config) -> dict[str, Any]:
    """All that a configuration says, by full name: `read_config` makes the same one of it."""
    values: dict[str, Any] = {
        'system': config.system,
        'model': config.simulated_kinetics,
        **config.values,
        **config.settings,
    }
    values['effects.active'] = [active.effect.name for active in config.effects]
    values['effects.paths'] = absolute_folders(file for active in config.effects for file in active.effect.files)
    values['structures.paths'] = folders_of(config.structure)
    values |= {f'{PRIORS}{name}': std for name, std in config.priors.items()}
    known = config.covariance
    return values if known is None else values | {NAMES: list(known.names), MATRIX: known.matrix.ravel().tolist()}


def folders_of(found: Structure) -> list[str]:
    """Folders of the files of a structure, as absolute paths; none for one of the package."""
    return absolute_folders(found.files)


def absolute_folders(files: Iterable[Path]) -> list[str]:
    """The folders of some files, each once."""
    return sorted({os.path.abspath(file.parent) for file in files})


def read_config(
    path: str | os.PathLike[str] | None = None,
    words: str | Iterable[str] | Mapping[str, Any] = (),
    effects: GivenEffects = (),
    recorded: Mapping[str, Any] = NOTHING,
    source: str = 'a recording',
) -> Config:
    """Read a configuration: a YAML file, then ``name=value`` words over it; defaults for everything else.

    Parameters
    ----------
    path : str or Path, optional
        A ROS 2 parameter file, as the node reads it.
    words : str or iterable of str, or mapping
        Parameters as ``'name=value'``, SI units, or values by full name.
    effects : sequence
        Further active effects, as `Config` takes them: ``'name'`` or ``'name:parameter=value,...'``, where ``name@scope``
        acts in one wire, coordinate or channel only; ``sma_sim.effects.gravity(g_y=-9.81)``; one or several.
    recorded : mapping
        Values by full name that were recorded with data, which all others replace. Folders of effects that are only
        named there are not opened, because importing their files runs them.
    source : str
        Where `recorded` comes from, for messages.

    Returns
    -------
    Config
        Checked parameters; `Model` takes it.

    Raises
    ------
    UserError
        For an unknown name, a value out of range, or a file that cannot be read.

    Examples
    --------
    >>> import sma_sim
    >>> config = sma_sim.read_config(words='beam.E=2.2e9', effects='gravity')
    >>> config.parameters['beam.E'], config.kinetics
    (2200000000.0, 'auto')
    """
    expect('path', path, str | os.PathLike[str] | None)
    given = {name: RawValue(value, f'recorded in {source}', recorded=True) for name, value in recorded.items()}
    given = given_over(given, given_values(None if path is None else Path(path), words))
    found: Mapping[str, Effect] = {}
    names = names_in('effects.active', given.get('effects.active', RawValue([], COMMAND_LINE)))
    for one in as_sequence(effects):
        name, found = put_effect(one, given, found, COMMAND_LINE)
        names += [name] if name not in names else []
        given['effects.active'] = RawValue(names, COMMAND_LINE)
    return checked(given, found)


def checked(given: Mapping[str, RawValue], objects: Mapping[str, Effect] = NOTHING) -> Config:
    """Names, types and ranges checked; defaults filled in. Raises UserError.

    `objects`: effects by name that are given as such.
    """
    structure = checked_structure(given)
    stds = {name.removeprefix(PRIORS): one for name, one in given.items() if name.startswith(PRIORS)}
    together = {name: one for name, one in given.items() if name in (NAMES, MATRIX)}
    given = {name: one for name, one in given.items() if not name.startswith(PRIORS) and name not in together}
    defaults, ranges, texts = structure.default_values, structure.all_parameters, settings_of(structure)
    known = dict(defaults)
    folders = given.get('effects.paths', RawValue([], ''))
    found = find_effects([] if folders.recorded else named_folders('effects.paths', folders)) | dict(objects)
    if folders.recorded:
        check_effects_found(given, found, folders)
    found = effects_on(found, names_of_effects(given), structure, numbers_within(given, defaults, ranges))
    declared = ranges | effect_parameters(found)
    kinetics, settings = AUTO, dict[str, str | bool]()
    for name, entry in given.items():
        if name in KINETICS_NAMES:
            kinetics = checked_kinetics(name, entry, given)
        elif name in texts:
            settings[name] = checked_setting(name, entry, texts[name])
        elif name not in (*LISTS, 'system', *structure.options) and (
            name in declared or not is_noise_of_variant(name, structure)
        ):
            known[name] = checked_number(name, entry, declared)
    asked = given.get('effects.active', RawValue([], ''))
    effects = tuple(active_effect(name, found, known, asked) for name in names_in('effects.active', asked))
    values = MappingProxyType({name: known[name] for name in defaults})
    priors = checked_priors(stds, structure, effects)
    made = Config(values, structure.family, kinetics, effects, settings, structure if structure.files else None, priors)
    return made.with_covariance(together)


def checked_kinetics(name: str, one: RawValue, given: Mapping[str, RawValue]) -> str:
    """The kinetics, which have two names in files. Raises ConfigError."""
    kinetics = checked_choice(name, one, (*MODELS, AUTO))
    for other in KINETICS_NAMES:
        if other in given and given[other].value != kinetics:
            raise ConfigError(
                f'{other} = {given[other].value!r} ({given[other].where}), but {name} = {kinetics!r} ({one.where}): '
                'expected one of these two names of the kinetics'
            )
    return kinetics


def numbers_within(
    given: Mapping[str, RawValue], defaults: Mapping[str, float], ranges: Mapping[str, Parameter]
) -> dict[str, float]:
    """The values of all parameters of the model: what is given and within its bounds, else the defaults."""
    numbers = dict(defaults)
    for name, entry in given.items():
        low, high = ranges[name].bounds if name in defaults else (0.0, 0.0)
        if name in defaults and isinstance(entry.value, int | float) and low <= entry.value <= high:
            numbers[name] = float(entry.value)
    return numbers


def checked_structure(given: Mapping[str, RawValue]) -> Structure:
    """The structure of the system that is given. Raises UserError."""
    folders = given.get('structures.paths', RawValue([], ''))
    found = find_structures([] if folders.recorded else named_folders('structures.paths', folders))
    one = given.get('system', RawValue('module', 'default'))
    if one.value not in found and folders.recorded and names_in('structures.paths', folders):
        raise ConfigError(only_named_in_data(f'the structure {one.value}', 'structures.paths', folders))
    if one.value not in found and names_in('structures.paths', folders):
        where = ', '.join(map(str, named_folders('structures.paths', folders)))
        one = replace(one, where=f'{one.where}; no STRUCTURE in {where} has this name')
    base = chosen_variant(found[checked_system(one, found)], given, found)
    size = base.size_name
    if size not in given:
        return base
    return structure_of_size(base, {size: checked_number(size, given[size], base.declared)})


def chosen_variant(structure: Structure, given: Mapping[str, RawValue], found: Mapping[str, Structure]) -> Structure:
    """The variant of a structure that the given options name; itself without any. Raises ConfigError."""
    own = structure.options
    family = [member for member in found.values() if member.original == structure.original]
    for name in own:
        if name in given:
            checked_choice(name, given[name], sorted({member.options[name] for member in family}))
    wanted = {name: str(given[name].value) if name in given else word for name, word in own.items()}
    return next((member for member in family if dict(member.options) == wanted), structure)


def checked_system(one: RawValue, found: Mapping[str, Structure]) -> str:
    """The name of a structure. Raises ConfigError, which names all but variants."""
    if isinstance(one.value, str) and one.value in found:
        return one.value
    return checked_choice('system', one, tuple(name for name, each in found.items() if not each.variant_of))


def checked_choice(name: str, one: RawValue, choices: Sequence[str]) -> str:
    """One of a few words."""
    if one.value not in choices:
        raise ConfigError(
            f'{name} = {one.value!r} ({one.where}): expected one of {", ".join(choices)}{suggestion(one.value, choices)}'
        )
    return str(one.value)


def checked_setting(name: str, one: RawValue, setting: Setting) -> str | bool:
    """A text or a switch."""
    wanted = type(setting.default)
    value = SWITCH_WORDS.get(str(one.value).lower(), one.value) if wanted is bool else one.value
    if not isinstance(value, wanted):
        kind = 'true or false' if wanted is bool else 'a text'
        raise ConfigError(f'{name} = {one.value!r} ({one.where}): expected {kind}')
    return value


def check_effects_found(given: Mapping[str, RawValue], found: Mapping[str, Effect], folders: RawValue) -> None:
    """Raise ConfigError where an active effect can only come from folders that are named in data alone."""
    names = names_in('effects.active', given.get('effects.active', RawValue([], '')))
    unknown = [name for name in names if name not in found]
    if unknown and names_in('effects.paths', folders):
        raise ConfigError(only_named_in_data(f'the effect {unknown[0]}', 'effects.paths', folders))


def only_named_in_data(what: str, parameter: str, folders: RawValue) -> str:
    """Why files are not imported, and how a user has them imported."""
    paths = names_in(parameter, folders)
    return (
        f'{what} is needed, but only data name its folder ({folders.where}): {", ".join(paths)}. '
        'Python files in a folder that data name are not run unless you name it too: if you trust them, add '
        f'--set {parameter}={quote(",".join(paths))}'
    )


def names_of_effects(given: Mapping[str, RawValue]) -> list[str]:
    """The effects that are switched on, or whose parameters are given."""
    active = names_in('effects.active', given.get('effects.active', RawValue([], '')))
    return [*active, *(name.split('.')[1] for name in given if name.startswith('effects.'))]


def effect_parameters(found: Mapping[str, Effect]) -> dict[str, Parameter]:
    """Parameters of all effects by full name."""
    return {f'effects.{name}.{p.name}': p for name, each in found.items() for p in each.parameters}


def active_effect(name: str, found: Mapping[str, Effect], known: Mapping[str, float], asked: RawValue) -> ActiveEffect:
    """An effect with its parameters, their defaults where nothing was given. Raises ConfigError."""
    if name not in found:
        raise unknown_effect(name, found, asked)
    return ActiveEffect(found[name], tuple(p.default for p in found[name].parameters)).with_values(known)


def checked_number(name: str, one: RawValue, declared: Mapping[str, Parameter]) -> float:
    """One number within its bounds. Raises ConfigError."""
    if name not in declared:
        hint = suggestion(name, [*declared, 'system', *KINETICS_NAMES, *LISTS, *SETTINGS])
        raise ConfigError(f'unknown parameter {name} ({one.where}){hint}')
    return checked_value(name, one, declared[name])


def checked_value(name: str, one: RawValue, parameter: Parameter) -> float:
    """A value of a parameter, within its bounds and in its unit. Raises ConfigError."""
    value, (low, high), unit = one.value, parameter.bounds, f' {parameter.unit}'.removesuffix(' -')
    if is_insisted := isinstance(value, str) and value.endswith(f' {parameter.unit}'):
        value = as_number(value.removesuffix(parameter.unit))
    if not is_number(value):
        raise ConfigError(f'{name} = {one.value!r} ({one.where}): expected a number{unit and " in"}{unit}{yaml_hint(value)}')
    number = float(value)
    if math.isnan(number) and math.isnan(parameter.default):
        return number
    given = f'{name} = {number:g}{unit} ({one.where})'
    if not low - ROUNDING * abs(low) <= number <= high + ROUNDING * abs(high):
        raise ConfigError(f'{given}: expected {low:g} to {high:g}{unit}{unit_hint(parameter, number)}')
    other, meant = likely_unit(parameter, number)
    if other and not (is_insisted or one.recorded):
        low, high = met_in_practice(parameter)
        raise ConfigError(
            f'{given}: did you mean {number:g} {other}, {meant:g}? Usual are {low:g} to {high:g}{unit}; if you do mean '
            f"{number:g}{unit}, give it with its unit: '{with_unit(number, parameter)}'"
        )
    return number


def with_unit(value: float, parameter: Parameter) -> str:
    """A value as it is given where another unit is more likely."""
    return f'{value!r} {parameter.unit}'


def as_number(value: Any) -> Any:
    """What a text says as a number; else itself."""
    try:
        return float(value)
    except (TypeError, ValueError):
        return value


def yaml_hint(value: Any) -> str:
    """What is wrong with a number that is a text."""
    return f'; write {number:g} without quotes' if isinstance(value, str) and value != (number := as_number(value)) else ''
