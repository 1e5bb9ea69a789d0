"""Which fitted parameters left their plausible range: a model that lacks something biases its parameters to make up for it.

Plausible is the realistic range of an effect's parameter, and for all others a factor of 1.5 around the nominal value (less
for lengths and temperatures; three standard deviations where these were given). What data hardly determine may lie anywhere,
so that a parameter counts only if its whole 95 % interval is outside. A single wire may be of any make: what literature
calls usual of its material is plausible too, and where its transformation begins is its own matter.

Values that no data hold are no sign of what the model lacks, yet a model runs with them: where one is outside of what is
realistic, or usual of the material, that is said on its own. So is what a recording has its own of, such as its ambient
temperature, where it ended far from what was stated of it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import log, sqrt

import numpy as np

from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.estimation.free_parameters import BOUND_STDS, GIVEN_STDS, FreeParameter, declared_parameters
from sma_sim.evidence.estimation.held_out_prediction import RunFit
from sma_sim.evidence.estimation.problem import normal_parts
from sma_sim.evidence.estimation.residuals import FitData
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.estimation.uncertainty import GAUSS_95, Uncertainty
from sma_sim.model.arrays import Matrix, Vector
from sma_sim.model.config import Config
from sma_sim.model.effects.effect import Effect
from sma_sim.model.materials import Range, material_of, usual_ranges
from sma_sim.model.parameters import Parameter

RANGE_TOLERANCE = 0.1  # fraction of a realistic range by which a value may lie beyond it: literature is not sharper
WHERE_IT_TRANSFORMS = ('wire.T0', 'wire.sigma_MW0')
STIFFER, SOFTER = 'wire.E_A', 'wire.E_M'  # austenite is the stiffer phase of NiTi


@dataclass(frozen=True)
class ImplausibleParameter:
    """A fitted value outside its plausible range `low` to `high` (SI), and what is wrong with it.

    `reason`: beyond its `realistic` range, too far from the `nominal` value (and unusual of the `material`, in words, where
    that is known), or moduli in the wrong `order`.
    """

    name: str
    value: float
    nominal: float
    low: float
    high: float
    unit: str
    reason: str
    material: str = ''

    @property
    def text(self) -> str:
        """In words."""
        unit = '' if self.unit == '-' else f' {self.unit}'
        if self.reason == 'order':
            return f'{SOFTER} {self.value:.4g}{unit} above {STIFFER} {self.high:.4g}{unit}'
        if self.reason == 'realistic':
            return f'{self.name} {self.value:.4g}{unit} (realistic: {self.low:.4g} to {self.high:.4g})'
        if self.material:
            return f'{self.name} {self.value:.4g}{unit} ({self.material}: {self.low:.4g} to {self.high:.4g})'
        return f'{self.name} {self.value:.4g} instead of {self.nominal:.4g}{unit}'


@dataclass(frozen=True)
class ImprobableOffset:
    """An offset of recordings, `values` by recording (SI), more than three standard deviations `std` from what was stated.

    `name`: ``ambient``, or ``zero.`` or ``drift.`` with a channel.
    """

    name: str
    std: float
    values: Mapping[str, float]

    @property
    def text(self) -> str:
        """In words."""
        kind, _, channel = self.name.partition('.')
        what, unit = (f'{kind} of {channel}', '') if channel else ('ambient temperature', ' K')
        return f'{what} (known to {self.std:.3g}{unit}): {", ".join(f"{run} {x:+.3g}" for run, x in self.values.items())}'


def implausible_parameters(
    config: Config, free: Sequence[FreeParameter], z: Vector, covariance: Matrix, material: str = ''
) -> tuple[ImplausibleParameter, ...]:
    """The free parameters (p) that lie outside their plausible range at z (n >= p,), given their covariance (p, p) in z.

    `config` has the fitted values; `material`: of the wires, a name of MATERIALS, '' where nobody has said it.
    """
    reach = GAUSS_95 * np.sqrt(np.diag(covariance))
    return (*outside(config, free, z, reach, material), *moduli_out_of_order(config, free, covariance))


def outside(
    config: Config, free: Sequence[FreeParameter], z: Vector, reach: Vector, material: str
) -> Iterator[ImplausibleParameter]:
    """The free parameters (p) that are outside of their plausible range at z by more than `reach` (p,)."""
    declared = declared_parameters(config)
    known = material_of(config.parameters, config.structure.wires, material)
    usual = usual_ranges(known, config.parameters) if known else {}
    for parameter, at, by in zip(free, z[: len(free)].tolist(), reach.tolist(), strict=True):
        low, high, reason = plausible_range(parameter, declared[parameter.name])
        words = ''
        if known and reason == 'nominal' and parameter.name not in config.priors:
            low, high = widened(parameter, (low, high), usual)
            words = known.words if parameter.name in usual else ''
        if at - by > high or at + by < low:
            value, ends = parameter.value(at), (parameter.value(low), parameter.value(high))
            yield ImplausibleParameter(parameter.name, value, parameter.center, *ends, parameter.unit, reason, words)


def improbable_offsets(runs: Sequence[FitData], fits: Sequence[RunFit]) -> tuple[ImprobableOffset, ...]:
    """What recordings have their own of that ended too far from what was stated of it; `fits`: of the same runs."""
    found = dict[tuple[str, float], dict[str, float]]()
    for run, fit in zip(runs, fits, strict=True):
        own = {'ambient': (fit.ambient, fit.ambient_std)}
        for kind, offsets, stds in (('zero', fit.zeros, run.zero_std), ('drift', fit.drifts, run.drift_std)):
            known = dict(zip(run.channels, stds, strict=bool(stds)))
            own |= {f'{kind}.{channel}': (value, known[channel]) for channel, value in offsets.items()}
        for name, (value, std) in own.items():
            if abs(value) > GIVEN_STDS * std > 0.0:
                found.setdefault((name, std), {})[fit.name] = value
    return tuple(ImprobableOffset(name, std, values) for (name, std), values in found.items())


def is_form(parameter: Parameter) -> bool:
    """Whether a parameter decides the form of a law, such as an exponent or a saturation: a number that is no strength."""
    return parameter.neutral is None and parameter.unit == '-'


def realistic_range(parameter: Parameter) -> tuple[float, float] | None:
    """The realistic range of a parameter, with its neutral value: a strength of several may be nothing."""
    if parameter.realistic is None or parameter.neutral is None:
        return parameter.realistic
    low, high = parameter.realistic
    return min(low, parameter.neutral), max(high, parameter.neutral)


def tolerated_range(parameter: Parameter) -> tuple[float, float] | None:
    """The realistic range of a parameter, and what is nearly in it."""
    between = realistic_range(parameter)
    if between is None:
        return None
    tolerance = RANGE_TOLERANCE * (between[1] - between[0])
    return between[0] - tolerance, between[1] + tolerance


def unrealistic(effect: Effect, values: Mapping[str, float]) -> list[Parameter]:
    """The parameters of an effect whose value (by name, of those that are given) lies beyond the realistic range."""
    ranges = ((p, tolerated_range(p)) for p in effect.parameters if p.name in values)
    return [p for p, between in ranges if between is not None and not between[0] <= values[p.name] <= between[1]]


def is_plausible(effect: Effect, values: Mapping[str, float]) -> bool:
    """Whether all values of an effect lie in the realistic ranges; but for another form of its law."""
    return all(is_form(parameter) for parameter in unrealistic(effect, values))


def other_form(effect: Effect, values: Mapping[str, float]) -> str:
    """In words, with what exponent or saturation beyond its realistic range an effect acts; '' without any."""
    return ', '.join(f'with {p.name} = {values[p.name]:.3g}' for p in unrealistic(effect, values) if is_form(p))


def plausible_range(parameter: FreeParameter, declared: Parameter) -> tuple[float, float, str]:
    """Between which coordinates a parameter is plausible, and by what (`reason` of an `ImplausibleParameter`)."""
    between = tolerated_range(declared)
    if between is not None and is_form(declared):
        return parameter.low, parameter.high, 'realistic'
    if between is None:
        return -parameter.plausible, parameter.plausible, 'nominal'
    low, high = between
    return (
        parameter.coordinate(low) if low > 0.0 or not parameter.log else parameter.low,
        parameter.coordinate(high),
        'realistic',
    )


def widened(parameter: FreeParameter, between: tuple[float, float], usual: Mapping[str, Range]) -> tuple[float, float]:
    """A plausible range in coordinates with what is usual of a material; a wire may begin to transform anywhere."""
    if parameter.name in WHERE_IT_TRANSFORMS:
        return parameter.low, parameter.high
    if parameter.name not in usual:
        return between
    low, high = (parameter.coordinate(value) for value in usual[parameter.name])
    return min(low, between[0]), max(high, between[1])


def moduli_out_of_order(
    config: Config, free: Sequence[FreeParameter], covariance: Matrix
) -> tuple[ImplausibleParameter, ...]:
    """The modulus of martensite where it was fitted above that of austenite by more than both are uncertain."""
    by_name = {parameter.name: (k, parameter) for k, parameter in enumerate(free)}
    E_A, E_M = config.parameters[STIFFER], config.parameters[SOFTER]
    if SOFTER not in by_name or E_M <= E_A:
        return ()
    row = np.zeros(len(free))
    for name, sign in ((SOFTER, 1.0), (STIFFER, -1.0)):
        if name in by_name:
            k, parameter = by_name[name]
            row[k] = sign * parameter.scale
    if log(E_M / E_A) <= GAUSS_95 * sqrt(row @ covariance @ row):
        return ()
    _, softer = by_name[SOFTER]
    return (ImplausibleParameter(SOFTER, E_M, softer.center, 0.0, E_A, softer.unit, 'order'),)


def reported_covariance(free: Sequence[FreeParameter], known: Uncertainty) -> Matrix:
    """The covariance (p, p) in z behind the intervals of a fit; infinite for what the data do not see."""
    std = np.array(
        [
            interval.std / parameter.scale if interval.seen else BOUND_STDS * 1e3
            for interval, parameter in zip(known.intervals, free, strict=True)
        ]
    )
    correlation = np.reshape(known.correlation, (len(std), len(std)))
    return correlation * np.outer(std, std)


def approximate_covariance(fit: FitResult, context: SearchContext) -> Matrix:
    """The covariance (p, p) in z by one-sided differences, wider by what the fit leaves over the noise."""
    p, hessian = len(fit.problem.free), np.eye(len(fit.z))
    hessian[:p, :p] *= BOUND_STDS**-2.0
    for part in normal_parts(fit.problem, fit.z, context.pool):
        hessian[np.ix_(part.indices, part.indices)] += part.hessian
    covariance: Matrix = np.asarray(np.linalg.inv(hessian), dtype=np.float64)[:p, :p]
    return max(1.0, fit.error) ** 2 * covariance


def implausible_in(fit: FitResult, context: SearchContext) -> tuple[ImplausibleParameter, ...]:
    """The parameters of a fit without intervals that left their plausible range. Raises SimulationError."""
    covariance = approximate_covariance(fit, context)
    return implausible_parameters(fit.config, fit.problem.free, fit.z, covariance, fit.problem.material)


def implausible_of(fit: FitResult, known: Uncertainty | None) -> tuple[ImplausibleParameter, ...]:
    """What left its plausible range by more than it is uncertain; nothing where that is not known."""
    if known is None:
        return ()
    covariance = reported_covariance(fit.problem.free, known)
    return implausible_parameters(fit.config, fit.problem.free, fit.z, covariance, fit.problem.material)


def unusual_of(fit: FitResult, known: Uncertainty | None) -> tuple[ImplausibleParameter, ...]:
    """What ended outside of what is realistic, or usual of its material, by less than it is uncertain: no sign of what the
    model lacks, and no value to use. Nothing where uncertainties are not known."""
    if known is None:
        return ()
    determined = {one.name for one in implausible_of(fit, known)}
    found = outside(fit.config, fit.problem.free, fit.z, np.zeros(len(fit.problem.free)), fit.problem.material)
    return tuple(one for one in found if one.name not in determined and (one.reason == 'realistic' or one.material))
