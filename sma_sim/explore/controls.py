"""What the page shows of parameters and effects: bounds, units, meaning, and the range that a slider covers."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any

from sma_sim.compiler.fields_read import forms_of_law
from sma_sim.explore.request_values import json_number
from sma_sim.model.config import MODELS, Config
from sma_sim.model.effects.conversion import effect_on
from sma_sim.model.effects.effect import Effect
from sma_sim.model.effects.meaning import acts_on
from sma_sim.model.parameter_file import groups_of
from sma_sim.model.parameters import Parameter

LEFT_OUT = ('node', 'check', 'observer', 'guard', 'control')  # groups that only the nodes read
OF_MAS = ('wire.omega_x', 'wire.V_L')  # have a meaning with these kinetics only
PREFIXES = {-9: 'n', -6: 'µ', -3: 'm', 3: 'k', 6: 'M', 9: 'G'}
PREFIXED = ('Pa', 'W', 'N', 'm', 'V', 's')  # units that take a prefix where they come first, with the power one
AROUND = (0.5, 2.0)  # what a slider covers, relative to the default
PORT_TITLES = {
    'actuation': 'Driver: from the command to the heating',
    'wire_heat': 'Heat of a wire',
    'wire_strain': 'Strain of a wire',
    'transformation_stress': 'Transformation of a wire',
    'wire_force': 'Force of a wire',
    'structure_force': 'Forces on the structure',
    'sensing': 'Sensors',
}


def controls_of(config: Config, known: Mapping[str, Effect]) -> dict[str, Any]:
    """All that can be changed, for JSON; `known` are the effects by name, those in folders of the user's among them."""
    structure = config.structure
    defaults = structure.default_values
    groups = [
        {
            'name': group,
            'parameters': [
                parameter_data(f'{group}.{p.name}', p, config.parameters[f'{group}.{p.name}'], defaults[f'{group}.{p.name}'])
                for p in members
                if config.simulated_kinetics == 'mas' or f'{group}.{p.name}' not in OF_MAS
            ],
        }
        for group, members in groups_of(structure).items()
        if group not in LEFT_OUT
    ]
    return {
        'title': structure.title,
        'system': config.system,
        'model': config.simulated_kinetics,
        'models': list(MODELS),
        'description': structure.description,
        'groups': groups,
        'effects': effects_data(config, known),
        'active': [active.effect.name for active in config.effects],
    }


def parameter_data(name: str, parameter: Parameter, value: float, default: float) -> dict[str, Any]:
    """One parameter; NaN is null. `power`: the power of ten of the unit shown."""
    low, high = slider_range(parameter, value, default)
    power, unit = shown_unit(parameter.unit, default if math.isfinite(default) and default else high)
    return {
        'name': name,
        'label': parameter.name,
        'meaning': parameter.description,
        'source': parameter.source,
        'unit': unit,
        'power': power,
        'si': parameter.unit,
        'value': json_number(value),
        'default': json_number(default),
        'low': low,
        'high': high,
        'least': parameter.bounds[0],
        'most': parameter.bounds[1],
        'neutral': parameter.neutral,
    }


def slider_range(parameter: Parameter, value: float, default: float) -> tuple[float, float]:
    """What a slider covers: the realistic range, or half to twice the default, with the value, within the bounds."""
    least, most = parameter.bounds
    if parameter.realistic:
        ends = [*parameter.realistic]
    elif math.isfinite(default) and default != 0.0:
        ends = [factor * default for factor in AROUND]
    else:
        ends = [least, most]
    numbers = [end for end in (*ends, value, default, parameter.neutral) if end is not None and math.isfinite(end)]
    return max(min(numbers), least), min(max(numbers), most)


def shown_unit(unit: str, size: float) -> tuple[int, str]:
    """The power of ten and the name of the unit in which a number of this size is read well."""
    first, slash, rest = unit.partition('/')
    if first not in PREFIXED or size == 0.0:
        return 0, unit
    power = 3 * math.floor(math.log10(abs(size)) / 3.0 + 1e-9)
    power = min(max(power, min(PREFIXES)), max(PREFIXES))
    return (power, f'{PREFIXES[power]}{first}{slash}{rest}') if power else (0, unit)


def effects_data(config: Config, known: Mapping[str, Effect]) -> list[dict[str, Any]]:
    """The effects that have a meaning on the structure, with their parameters, by port."""
    structure = config.structure
    values = {
        f'{active.effect.name}.{p.name}': value
        for active in config.effects
        for p, value in zip(active.effect.parameters, active.values, strict=True)
    }
    scopes = {active.effect.plain_name: active.effect for active in config.effects}
    on_structure = (effect_on(one, structure, config.parameters) for one in known.values())
    acting = (effect for effect in on_structure if acts_on(effect, structure))
    return [effect_data(scopes.get(effect.name, effect), effect, values) for effect in in_order(acting)]


def in_order(effects: Iterable[Effect]) -> list[Effect]:
    """Effects by port, then by name."""
    return sorted(effects, key=lambda effect: (list(PORT_TITLES).index(effect.port), effect.name))


def effect_data(shown: Effect, plain: Effect, values: Mapping[str, float]) -> dict[str, Any]:
    """One effect; `shown` is it in the scope in which it is active."""
    parameters = [
        parameter_data(f'effects.{shown.name}.{p.name}', p, values.get(f'{shown.name}.{p.name}', p.default), p.default)
        for p in shown.parameters
    ]
    parts = (*plain.scopes, *forms_of_law(plain))
    return {
        'name': plain.name,
        'shown': shown.name,
        'title': plain.phrase,
        'port': PORT_TITLES[plain.port],
        'equation': plain.equation,
        'source': plain.source,
        'energy': plain.energy,
        'description': plain.description,
        'signature': plain.signature,
        'confused_with': list(plain.confused_with),
        'same_as': plain.same_as,
        'scopes': [{'name': f'{plain.name}@{scope.name}', 'words': scope.words} for scope in parts],
        'parameters': parameters,
    }
