"""A designed experiment: the request for it, the sequence, and what it is expected to tell."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from sma_sim.evidence.estimation.prepared_fit import check_kinetics
from sma_sim.evidence.estimation.residuals import FitData
from sma_sim.evidence.experiment_design.forecast import OperatingLimits, RunPrediction
from sma_sim.evidence.experiment_design.further_channels import FurtherChannel
from sma_sim.evidence.experiment_design.rival_fits import ModelHypothesis
from sma_sim.evidence.experiment_design.sequences import CommandGrid
from sma_sim.evidence.search.refine import TIE
from sma_sim.model.archive import Saved
from sma_sim.model.argument_checks import as_folders, check_fields
from sma_sim.model.arrays import Vector
from sma_sim.model.comparable import Comparable
from sma_sim.model.errors import UserError
from sma_sim.model.expected_units import MIN_STRESS
from sma_sim.model.likely_unit import kelvin_hint
from sma_sim.model.parameters import KELVIN
from sma_sim.model.renamed import renamed
from sma_sim.model.shown import Shown, listed

MAX_CELLS = 2000  # levels of a command: a search tries them one by one


@renamed(model='kinetics')
@dataclass(frozen=True)
class DesignRequest:
    """What to design.

    Attributes
    ----------
    between
        Names of rival explanations: effects, several joined by `+`, or `nothing`.
    parameters
        Names of parameters that are to be known better, instead. With neither: the explanations that rival the best.
    length, hold
        Of the experiment, and the least time of a level [s].
    power, temperature, stress
        Limits: of the command [W], of the wires [K, Pa]. None: from the recordings.
    kinetics
        Kinetics: hybrid, mas, auto, or None for what the configuration says.
    budget
        Sequences that are evaluated.
    seed
        Of the search and of the draws from posteriors.
    folders
        Of the user's effects.
    """

    between: str | Sequence[str] = ()
    parameters: str | Sequence[str] = ()
    length: float = 100.0
    hold: float = 0.5
    power: float | None = None
    temperature: float | None = None
    stress: float | None = None
    kinetics: str | None = None
    budget: int = 120
    seed: int = 0
    folders: tuple[Path, ...] = ()

    def __post_init__(self) -> None:
        check_fields(self)
        check_kinetics(self.kinetics)
        for name, least in {'seed': 0, 'budget': 1}.items():
            if (given := getattr(self, name)) < least:
                raise UserError(f'{name} = {given}: expected a whole number, {least} or more')
        if self.hold > 0.0 and not self.length <= MAX_CELLS * self.hold:
            raise UserError(
                f'length {self.length:g} s with hold {self.hold:g} s: expected seconds, and at most {MAX_CELLS} levels'
            )
        limits = {'power': (0.0, 'W'), 'temperature': (KELVIN[0], 'K'), 'stress': (MIN_STRESS, 'Pa')}
        for name, (low, unit) in limits.items():
            value = getattr(self, name)
            if value is not None and not value > low:
                hint = kelvin_hint(value) if unit == 'K' else ''
                raise UserError(
                    f'{name} = {value:g} {unit}: expected the largest of the experiment, above {low:g} {unit}{hint}'
                )
        object.__setattr__(self, 'folders', tuple(as_folders('folders', self.folders)))
        for name in ('between', 'parameters'):
            given = getattr(self, name)
            object.__setattr__(self, name, (given,) if isinstance(given, str) else tuple(given))


@dataclass(frozen=True)
class ExpectedRatio:
    """Log evidence ratio expected for `true` against `rival`: under the design, under default sequences (mean of them)."""

    true: str
    rival: str
    designed: float
    default: float


@dataclass(frozen=True)
class ParameterPrecision:
    """Standard deviation of a parameter (of its logarithm if `log`): now, after a default sequence, after the design."""

    name: str
    unit: str
    log: bool
    now: float
    default: float
    designed: float

    @property
    def shown_unit(self) -> str:
        """Of the standard deviations."""
        return 'of the logarithm' if self.log else self.unit


@dataclass(frozen=True)
class InformationGain:
    """Information [nat] on the combinations of parameters considered: by the design, by default sequences (mean)."""

    designed: float
    default: float


@dataclass(frozen=True, eq=False, repr=False)
class Plan(Shown, Saved, Comparable):
    """The design.

    Attributes
    ----------
    hypotheses
        What is discriminated; a single one where parameters are to be known better.
    grid, levels
        The command: levels (cells,) [W] on the grid.
    limits, limits_from
        What no hypothesis exceeds, and where each limit comes from, in words.
    expected
        Log evidence ratios between hypotheses; none where parameters are to be known better.
    precision
        Of every free parameter; none between hypotheses.
    gain
        Information on the parameters.
    predictions
        By hypothesis, under the design.
    run, every
        The experiment's samples and weights, each sample for `every` of the measurement.
    evaluated
        Number of sequences.
    interrupted, seconds
        Whether Ctrl-C ended the search, and how long it took.
    further_channels
        What one sensor more would tell along the recordings, the best first; none after Ctrl-C.
    in_motion
        Whether the recordings more probably do not begin at rest, though nothing said so.
    """

    hypotheses: tuple[ModelHypothesis, ...]
    grid: CommandGrid
    levels: Vector
    limits: OperatingLimits
    limits_from: Mapping[str, str]
    expected: tuple[ExpectedRatio, ...]
    precision: tuple[ParameterPrecision, ...]
    gain: InformationGain
    predictions: tuple[RunPrediction, ...]
    run: FitData
    every: int
    evaluated: int
    interrupted: bool
    seconds: float
    further_channels: tuple[FurtherChannel, ...] = ()
    in_motion: bool = False

    def facts(self) -> Mapping[str, str]:
        """What is to be known at a glance."""
        reached = self.reached
        limits = f'{reached["power"]:.3g} W, {reached["temperature"]:.4g} K, {1e-6 * reached["stress"]:.3g} MPa at most'
        found = {'command': f'{self.grid.length:g} s, {limits}', 'between': listed(each.name for each in self.hypotheses)}
        ratios = (
            f'{ratio.true} against {ratio.rival} {ratio.designed:.3g} ({ratio.default:.3g})' for ratio in self.expected
        )
        stds = (f'{one.name} {one.now:.2g} to {one.designed:.2g} {one.shown_unit}' for one in self.precision)
        gain = {'expected log evidence (by default)': ratios} if self.expected else {'standard deviations': stds}
        return found | {name: listed(words) for name, words in gain.items()}

    @property
    def discriminates(self) -> bool:
        """Whether hypotheses are compared (else parameters are to be known better)."""
        return bool(self.expected)

    @property
    def reached(self) -> dict[str, float]:
        """Largest power [W], temperature [K] and stress [Pa] of a wire under any hypothesis and draw of its posterior."""
        return {
            'power': float(abs(self.levels).max()),
            'temperature': max(prediction.temperature for prediction in self.predictions),
            'stress': max(prediction.stress for prediction in self.predictions),
        }

    @property
    def indistinguishable(self) -> tuple[tuple[str, str], ...]:
        """Pairs of hypotheses that the best sequence does not tell apart, whichever is true."""
        expected = {(ratio.true, ratio.rival): ratio.designed for ratio in self.expected}
        return tuple((a, b) for (a, b), ratio in expected.items() if a < b and max(ratio, expected[b, a]) < TIE)
