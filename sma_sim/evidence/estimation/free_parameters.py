"""Which parameters a fit may change, in which coordinates, how far, and which of them never together."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace

from sma_sim.evidence.data.recording import Dataset, is_resistance
from sma_sim.model.config import Config, fitted_parameters
from sma_sim.model.errors import UserError
from sma_sim.model.materials import material_of, usual_ranges
from sma_sim.model.nearest import suggestion
from sma_sim.model.parameters import Parameter

BOUND_STDS = 5.0  # bounds of a fit, in standard deviations of the prior
MAX_PRIOR_STDS = 0.8  # by which a length or a temperature may differ from nominal, in standard deviations of its prior
GIVEN_STDS = 3.0  # the same of a value whose standard deviation was given
REACH = 2.5  # of the logarithm of a material parameter, by which a fit may move it: a factor of 12
DAMPING_REACH = 5.0  # the same of damping, a factor of 150: of many mechanisms nobody knows the order of magnitude
PLAUSIBLE = math.log(1.5)  # by which a logarithm may differ from the nominal value: robots of one design differ by less
USUAL_STDS = 2.0  # of a prior as wide as what is usual: of normal values all but a twentieth lie within
INSTANT_STD = 300.0  # [s] of the prior of an instant: it is anywhere in a recording
PRIOR_STD = 0.5  # of the prior of a material parameter: weak beside the data, strong enough where data are blind
# Relative standard deviations of priors where nothing is said of how well a value is known.
NARROW_PRIOR_STDS = {'wire.l0': 0.02, 'beam.L': 0.02, 'plate.W': 0.1, 'wire.T0': 0.02, 'wire.r0': 0.1, 'beam.h': 0.1}
# Where literature is as wide: moduli of NiTi 28 to 41 and 75 to 83 GPa (Dynalloy, Technical characteristics of Flexinol), of
# plastics too; specific heat 322 (Jackson, Wagner and Wasilewski, NASA-SP 5110, 1972) to 837 J/(kg K) (Dynalloy); convection
# from thin wires (Morgan, Adv. Heat Transfer 11 (1975) 199); damping of a mechanism is known to an order of magnitude.
WIDTHS = {'modulus': 0.3, 'specific heat': 0.3, 'convection': 0.7, 'damping': 1.0}
MATERIAL_NAMES = (
    'wire.E_A',
    'wire.E_M',
    'wire.eps_T',
    'wire.sigma_T',
    'wire.c_V',
    'wire.lambda',
    'wire.sigma_MW0',
    'wire.dsigma',
)
KINETICS_NAMES = ('wire.V_L', 'wire.omega_x')
HEAT_NAMES = ('wire.c_V', 'wire.lambda', 'wire.rho')
RESISTIVITY_NAMES = ('wire.resistivity_A', 'wire.resistivity_M', 'wire.resistivity_T_A', 'wire.resistivity_T_M')
STRESS_SCALE_NAMES = ('wire.E_A', 'wire.E_M', 'wire.sigma_T', 'wire.sigma_MW0', 'wire.dsigma', 'wire.c_V', 'wire.lambda')


@dataclass(frozen=True)
class FreeParameter:
    """A parameter of the fit in its coordinate z: value = center exp(scale z) if `log`, else center + scale z.

    The prior of z is normal, mean 0, standard deviation 1; `low` and `high` bound z. `plausible`: how far from 0 a value is.
    """

    name: str
    center: float
    scale: float
    low: float
    high: float
    log: bool
    unit: str
    plausible: float = MAX_PRIOR_STDS

    def value(self, z: float) -> float:
        """The value at coordinate z (SI)."""
        return self.center * math.exp(self.scale * z) if self.log else self.center + self.scale * z

    def coordinate(self, value: float) -> float:
        """The coordinate z of a value."""
        return (math.log(value / self.center) if self.log else value - self.center) / self.scale


@dataclass(frozen=True)
class FixedParameter:
    """A parameter that was asked for and is not fitted, and why."""

    name: str
    reason: str


@dataclass(frozen=True)
class Equivalence:
    """Parameters that the equations let appear together only; `fixed` keeps its value where all of `free` are fitted."""

    fixed: str
    free: tuple[str, ...]
    reason: str


def equivalences(config: Config, measured: Collection[str] = ()) -> tuple[Equivalence, ...]:
    """Exact equivalences of the equations (docs/explanation/calibration.md derives them); `measured`: the channels."""
    thickness = RESISTIVITY_NAMES[:2] if any(map(is_resistance, measured)) else ()  # a resistance shows resistivity/r0^2
    stress = STRESS_SCALE_NAMES + (('wire.V_L',) if config.simulated_kinetics == 'mas' else ())
    is_straight = config.structure.strain is None  # the strain of a coil is in proportion to r0
    together = Equivalence(
        'wire.n', ('wire.r0', 'wire.lambda', *thickness), 'n r0^2 and n r0 lambda are all that n, r0 and lambda enter by'
    )
    thicker = Equivalence('wire.r0', stress + thickness, 'thicker wires at lower stresses, c_V and lambda behave the same')
    return (
        Equivalence('wire.rho', ('wire.c_V',), 'rho and c_V enter as their product only (MAS9)'),
        Equivalence('wire.T0', ('wire.sigma_MW0',), 'a shift of T0 is a shift of sigma_MW0 (MAS8a)'),
        *((together,) if is_straight else ()),
        Equivalence('wire.n', stress, 'more wires at lower stresses, c_V and lambda behave the same'),
        *((thicker,) if is_straight else ()),
    )


def why_unidentifiable(name: str, config: Config, measured: Collection[str] | None = None) -> str:
    """Why a parameter has no effect on any channel of this system and model, or an empty string.

    `measured`: the channels that there are; None: any.
    """
    if name in RESISTIVITY_NAMES and measured is not None and not any(map(is_resistance, measured)):
        return 'no resistance is measured'
    for effect in (active.effect for active in config.effects):
        own = name.removeprefix(f'effects.{effect.name}.')
        if own != name and measured is not None and not effect.is_seen(own, measured):
            return f'no {own} is measured'
    if name in KINETICS_NAMES and config.simulated_kinetics == 'hybrid':
        return 'the hybrid model has no kinetics'
    if not config.structure.coordinates and (name.startswith(('beam.', 'plate.')) or name == 'wire.n'):
        return 'one wire on a test bench has no structure'
    if name in HEAT_NAMES and config.structure.imposed_temperature >= 0:
        return 'the temperature of the wire is imposed, whatever heat it takes'
    return ''


def default_names(config: Config, measured: Collection[str] = ()) -> tuple[str, ...]:
    """What a fit changes when nothing else is asked for: what data of such a system can see, and no lengths.

    Resistivities where `measured` has a resistance.
    """
    kinetics = ('wire.V_L',) if config.simulated_kinetics == 'mas' else ()
    structure = config.structure
    material = tuple(name for name in MATERIAL_NAMES if structure.imposed_temperature < 0 or name not in HEAT_NAMES)
    resistivities = RESISTIVITY_NAMES if any(map(is_resistance, measured)) else ()
    return material + kinetics + structure.fitted + resistivities


def declared_parameters(config: Config) -> dict[str, Parameter]:
    """The declarations of all parameters that a fit could change, by full name."""
    return fitted_parameters(config.structure, config.effects)


def free_parameter(name: str, value: float, declared: Parameter, std: float | None = None) -> FreeParameter:
    """One parameter with its prior around `value`: relative where it is positive, else over its realistic range; wide for an
    instant.

    `std` (SI): as well as the value is known; None: as well as such a value usually is, all realistic ones within bounds.
    """
    low, high = declared.bounds
    if declared.quantity == 'instant':
        scale = std or INSTANT_STD
        return FreeParameter(name, value, scale, (low - value) / scale, (high - value) / scale, False, declared.unit)
    log = value > 0.0 and low >= 0.0 and declared.neutral is None
    if log:
        scale = default_width(name, declared) if std is None else std / value
        ends = declared.realistic if declared.realistic and std is None else ()
        realistic = max((abs(math.log(end / value)) for end in ends if end > 0.0), default=0.0)
        scale = max(scale, realistic / BOUND_STDS)
        usual = DAMPING_REACH if is_damping(name) else REACH
        reach = BOUND_STDS if std is not None or name in NARROW_PRIOR_STDS else max(usual, realistic) / scale
        plausible = GIVEN_STDS if std is not None else MAX_PRIOR_STDS if name in NARROW_PRIOR_STDS else PLAUSIBLE / scale
        bottom = max(-reach, math.log(low / value) / scale) if low > 0.0 else -reach
        top = min(reach, math.log(high / value) / scale)
        return FreeParameter(name, value, scale, bottom, top, True, declared.unit, plausible)
    ends = declared.realistic or (value, value + (abs(value) or 1.0))
    farthest = max(abs(end - value) for end in ends)
    scale = max((ends[1] - ends[0]) / 2.0, farthest / BOUND_STDS) if std is None else std
    bottom, top = max(-BOUND_STDS, (low - value) / scale), min(BOUND_STDS, (high - value) / scale)
    return FreeParameter(
        name, value, scale, bottom, top, False, declared.unit, MAX_PRIOR_STDS if std is None else GIVEN_STDS
    )


def is_damping(name: str) -> bool:
    """Whether a parameter is a coefficient of damping."""
    own = name.rpartition('.')[2]
    return own.startswith('b_') or own == 'b'


def default_width(name: str, declared: Parameter) -> float:
    """The relative standard deviation of the prior of a value of which nothing more is known."""
    kinds = {
        'modulus': declared.unit == 'Pa' and name.rpartition('.')[2].startswith('E'),
        'specific heat': name == 'wire.c_V',
        'convection': name == 'wire.lambda',
        'damping': is_damping(name),
    }
    kind = next((kind for kind, holds in kinds.items() if holds), '')
    return NARROW_PRIOR_STDS.get(name, WIDTHS.get(kind, PRIOR_STD))


def choose_free(
    config: Config, names: Iterable[str] | None = None, measured: Collection[str] | None = None
) -> tuple[tuple[FreeParameter, ...], tuple[FixedParameter, ...]]:
    """The parameters to fit (None: the default ones and all of the active effects' that such data can see), and those
    requested that stay fixed.

    `measured`: names of the channels that there are; None: nobody has said.
    Raises UserError for a name that no fit can change.
    """
    declared, values = declared_parameters(config), config.values
    if names is None:
        effects = [name for name in declared if name.startswith('effects.')]
        seen = [name for name in effects if not why_unidentifiable(name, config, measured)]
        names = [*default_names(config, measured or ()), *seen]
    requested = list(dict.fromkeys(names))
    for name in requested:
        if name not in declared:
            hint = suggestion(name, declared)
            raise UserError(
                f'free {name}: no such parameter can be fitted{hint}; expected wire.*, beam.*, plate.* '
                'or effects.NAME.* of an active effect'
            )
    fixed = [FixedParameter(name, why) for name in requested if (why := why_unidentifiable(name, config, measured))]
    left = remaining(requested, fixed)
    for equivalence in equivalences(config, measured or ()):
        if equivalence.fixed in left and set(equivalence.free) <= set(left):
            fixed.append(FixedParameter(equivalence.fixed, equivalence.reason))
            left = remaining(requested, fixed)
    free = tuple(free_parameter(name, values[name], declared[name], config.priors.get(name)) for name in left)
    return free, tuple(fixed)


def free_in_dataset(
    config: Config, dataset: Dataset, names: tuple[str, ...] | None, material: str = ''
) -> tuple[FreeParameter, ...]:
    """The parameters to fit to a dataset, as `choose_free` chooses them: with those of the bench under the priors of its
    map, and within what is usual of the material (`with_usual_limits`). Raises UserError."""
    chosen, _ = choose_free(config, with_nuisance_names(names, dataset, config), dataset.channels)
    chosen = under_nuisance_priors(chosen, dataset)
    return with_usual_limits(chosen, config, material)


def remaining(names: Sequence[str], fixed: Sequence[FixedParameter]) -> list[str]:
    """The names that are not fixed."""
    fixed_names = {parameter.name for parameter in fixed}
    return [name for name in names if name not in fixed_names]


def with_nuisance_names(free: tuple[str, ...] | None, dataset: Dataset, config: Config) -> tuple[str, ...] | None:
    """The parameters to fit, with those of the bench that the model has; None, all, and (), a model as it is, stay."""
    active = [one.effect.name for one in config.effects]
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


def with_usual_limits(free: Sequence[FreeParameter], config: Config, material: str = '') -> tuple[FreeParameter, ...]:
    """Free parameters whose limits and priors hold what is usual of such a wire, where a value is but the default of another
    robot, which says no more of this one: the farther end of what is usual is as improbable as two standard deviations."""
    known = material_of(config.parameters, config.structure.wires, material)
    usual = usual_ranges(known, config.parameters) if known else {}
    defaults = config.structure.default_values
    found = []
    for one in free:
        if one.name in usual and config.parameters[one.name] == defaults[one.name] and one.name not in config.priors:
            low, high = map(one.coordinate, usual[one.name])
            wider = max(1.0, -low / USUAL_STDS, high / USUAL_STDS)
            limits = min(one.low, low) / wider, max(one.high, high) / wider
            one = replace(one, scale=one.scale * wider, low=limits[0], high=limits[1], plausible=one.plausible / wider)
        found.append(one)
    return tuple(found)
