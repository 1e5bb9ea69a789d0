"""What an observer does not know of a robot: parameters, power, surroundings, and what the model leaves out."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from sma_sim.evidence.estimation.free_parameters import (
    NARROW_PRIOR_STDS,
    FreeParameter,
    choose_free,
    declared_parameters,
    free_parameter,
)
from sma_sim.model.arrays import Matrix, Vector
from sma_sim.model.config import Config
from sma_sim.solver.effect_table import channel_scales
from sma_sim.solver.model import Model
from sma_sim.solver.propagation import DELTA

HEAT_BALANCE = 'wire.c_V', 'wire.lambda'  # how much heat a wire takes, and gives away again


def uncertain_parameters(config: Config, gain_std: float = 0.0) -> tuple[FreeParameter, ...]:
    """The parameters that a filter estimates beside the states, in coordinates with the prior N(0, 1).

    They are those that a fit changes, with their standard deviations in `Config.covariance`, which a fit has left, else in
    `Config.priors`. Where these say nothing, observer.parameter_std and length_std hold; of parameters of effects the prior
    covers the realistic range.

    All power that reaches the wires is known to a factor of relative standard deviation `gain_std`. But for the latent heat,
    a robot whose wires get g times the power does what one does whose c_V and lambda are 1/g times as large: both are those
    for a watt of the command, with that uncertainty in common. Where a fit has left them they are so already.
    """
    declared, values = declared_parameters(config), config.values
    lengths, others = (config.parameters[f'observer.{name}'] for name in ('length_std', 'parameter_std'))
    known = config.covariance
    fitted = {} if known is None else dict(zip(known.names, np.sqrt(np.diag(known.matrix)).tolist(), strict=True))
    found = []
    for one in choose_free(config)[0]:
        value, std = values[one.name], config.priors.get(one.name)
        if one.name in fitted:
            std = fitted[one.name] * (value if one.log else 1.0)
        elif std is None and one.log and not one.name.startswith('effects.'):
            std = value * (lengths if one.name in NARROW_PRIOR_STDS else others)
        if one.name in HEAT_BALANCE and one.name not in fitted and std is not None:
            std = math.hypot(std, gain_std * value)
        found.append(free_parameter(one.name, value, declared[one.name], std))
    return tuple(found)


def prior_correlation(config: Config, free: Sequence[FreeParameter], gain_std: float = 0.0) -> Matrix:
    """Correlations of the coordinates of parameters (P, P).

    Those that a fit has left, and by the gain that c_V and lambda have in common (`uncertain_parameters`); none of others.
    """
    names, known, found = [one.name for one in free], config.covariance, np.eye(len(free))
    fitted = () if known is None else known.names
    common = np.array([gain_std / one.scale if one.name in HEAT_BALANCE and one.name not in fitted else 0.0 for one in free])
    found += np.outer(common, common) - np.diag(common**2)
    if known is not None:
        both = [name for name in known.names if name in names]
        at, matrix = [names.index(name) for name in both], known.of(both).matrix
        std = np.sqrt(np.diag(matrix))
        found[np.ix_(at, at)] = matrix / np.outer(std, std)
    return found


def configured(config: Config, free: tuple[FreeParameter, ...], z: Vector) -> Config:
    """The configuration with its parameters at coordinates z (P,)."""
    return config.variant({one.name: one.value(x) for one, x in zip(free, z, strict=True)})


def models_about(config: Config, free: tuple[FreeParameter, ...], z: Vector) -> tuple[Model, list[Model]]:
    """The model at coordinates z (P,), and the same with each coordinate moved by DELTA."""
    moved = z + DELTA * np.eye(len(free))
    return Model(configured(config, free, z)), [Model(configured(config, free, one)) for one in moved]


def heating_std(config: Config) -> float:
    """By which part the power that reaches a wire differs from one command [-], beside what holds for all commands."""
    return math.hypot(config.parameters['observer.power_std'], config.parameters['observer.gain_change_std'])


def least_cooling(config: Config) -> float:
    """What has to be commanded at the least to keep a bundle 1 K above its surroundings, n lambda A_s/(1 + g) [W/K].

    lambda is that for a watt of the command, as an observer knows it (`uncertain_parameters`), and g is by which part the
    power differs at this command. Priors are of ln lambda, and ln(1 + g) = g to first order, so that the logarithm of
    the whole is normal, with a standard deviation s: at the least exp(-m s) of its median, with m = ``guard.margin``.
    """
    gain_std, margin = config.parameters['observer.gain_std'], config.parameters['guard.margin']
    free = uncertain_parameters(config, gain_std)
    model, moved = models_about(config, free, np.zeros(len(free)))
    cooling = np.array([one.wire.n * one.wire.lambda_ * one.wire.surface for one in (model, *moved)])
    slopes = np.log(cooling[1:] / cooling[0]) / DELTA
    std = np.sqrt(slopes @ prior_correlation(config, free, gain_std) @ slopes + heating_std(config) ** 2)
    return float(cooling[0] * np.exp(-margin * std))


def channel_discrepancies(config: Config) -> Vector:
    """Standard deviations of what model and sensor of each channel differ by (channels,) [SI]."""
    return config.parameters['observer.discrepancy'] * np.array(channel_scales(config.structure))
