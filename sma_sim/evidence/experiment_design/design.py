"""The next experiment: from recordings and hypotheses to a command sequence and what it is expected to bring."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Event

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.data.recording import Campaign
from sma_sim.evidence.estimation.executors import PickledConfig, some_executor
from sma_sim.evidence.estimation.residuals import FitData, command_column
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.experiment_design.forecast import Foretold, Limits, Shown, empty_run, one_run, points_of
from sma_sim.evidence.experiment_design.refitted_utilities import RefitResult, refits_for, settle
from sma_sim.evidence.experiment_design.rival_fits import (
    DRAWS,
    LEADING,
    Hypothesis,
    bare_fit,
    hypotheses,
    leading_rivals,
    models_of,
    named_rivals,
    with_common_kinetics,
)
from sma_sim.evidence.experiment_design.sequence_search import Bench, SearchResult, Worth, judged, seek
from sma_sim.evidence.experiment_design.sequences import Grid
from sma_sim.evidence.experiment_design.utilities import gain, known, ratios, weak_directions, worth_of_ratios
from sma_sim.model.config import Config, suggestion
from sma_sim.model.errors import UserError

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]
CENTRES = 3  # at which derivatives are taken, where parameters are to be known
LINEAR = 0.4  # of the sequences, where rivals are refitted afterwards: the linear forecast is rough there
WEAK, FEWEST = 0.1, 3  # a combination is weakly known beyond this part of its prior; at least so many are looked at
ROOM = 0.1  # by which a default limit exceeds what the recordings reached, of the rise above rest
# Expected log evidence ratio below which an experiment decides nothing: what is called strong evidence begins at 3 (Kass and
# Raftery, J. Am. Stat. Assoc. 90, 1995). Where equations make a pair alike, the best of many sequences promises up to 2.7
TELLING = 3.0


@dataclass(frozen=True)
class DesignRequest:
    """What to design. `between` names rivals; `parameters` those to be known better; neither: the leading rivals.

    Lengths in s, `power` [W], `temperature` [K], `stress` [Pa]; None: from the recordings. `budget` sequences are tried.
    """

    between: tuple[str, ...] = ()
    parameters: tuple[str, ...] = ()
    length: float = 100.0
    hold: float = 0.5
    power: float | None = None
    temperature: float | None = None
    stress: float | None = None
    model: str = 'auto'
    budget: int = 120
    seed: int = 0
    folders: tuple[Path, ...] = ()


@dataclass(frozen=True)
class Expected:
    """Log evidence ratio expected for `true` against `rival`: under the design, under default sequences (mean of them)."""

    true: str
    rival: str
    designed: float
    default: float


@dataclass(frozen=True)
class Knowledge:
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
class Plan:
    """The design. `levels` [W] on `grid`; `expected` between hypotheses, `knowledge` of parameters (if no rivals).

    `predicted`: by hypothesis, under the design; `run` the experiment's samples and weights, each for `every` of the
    measurement. `gains`: information [nat] on the combinations looked at, designed and default.
    `limits_from`: where each limit comes from, in words.
    """

    hypotheses: tuple[Hypothesis, ...]
    grid: Grid
    levels: Vector
    limits: Limits
    limits_from: dict[str, str]
    expected: tuple[Expected, ...]
    knowledge: tuple[Knowledge, ...]
    gains: tuple[float, float]
    predicted: tuple[Foretold, ...]
    run: FitData
    every: int
    tried: int
    interrupted: bool
    seconds: float

    @property
    def rivals(self) -> bool:
        """Whether hypotheses are to be told apart (else parameters)."""
        return bool(self.expected)

    @property
    def reached(self) -> dict[str, float]:
        """Largest power [W], temperature [K] and stress [Pa] of a wire under any hypothesis and draw of its posterior."""
        return {
            'power': float(abs(self.levels).max()),
            'temperature': max(prediction.temperature for prediction in self.predicted),
            'stress': max(prediction.stress for prediction in self.predicted),
        }

    @property
    def inseparable(self) -> tuple[tuple[str, str], ...]:
        """Pairs of hypotheses that the best sequence does not tell apart, whichever is true."""
        found = {(one.true, one.rival): one.designed for one in self.expected}
        return tuple((a, b) for (a, b), x in found.items() if a < b and max(x, found[b, a]) < TELLING)


def next_experiment(
    training: Campaign, config: Config, wanted: DesignRequest, executor: Executor | None = None,
    on_progress: Callable[[str], None] = lambda words: None,
) -> Plan:  # fmt: skip
    """Design the next experiment. Ctrl-C during the search gives the best so far, before it KeyboardInterrupt.

    Raises UserError for what cannot be designed: a wire, unknown names, limits that not even a weak command keeps.
    """
    begun = time.perf_counter()
    check_wanted(training, config, wanted)
    with some_executor(executor) as pool:
        place = SearchContext(pool, Event(), on_progress, wanted.folders, wanted.seed)
        found = fitted_hypotheses(training, config, wanted, place)
        grid, sources = grid_for(training, wanted)
        run, every = empty_run(training, grid, found[0].factor)
        limits, more = limits_for(found, wanted, pool)
        single = len(found) == 1
        points = tuple(points_of(one, run, CENTRES if single else 1, 0 if single else DRAWS, wanted.seed) for one in found)
        weights = weights_for(found[0], wanted) if single else np.zeros((0, 0))
        bench = Bench(points, run, grid, limits, worth_for(found, weights), pool)
        sought = seek(bench, wanted.budget if single else round(LINEAR * wanted.budget), wanted.seed, on_progress)
        if sought is None:
            raise UserError(
                f'the limits of {limits.temperature:.0f} K and {limits.stress / 1e6:.0f} MPa leave no command: a default '
                'sequence exceeds them however weak; raise --max-temperature or --max-stress'
            )
        settled = None if single else settle_rivals(training, found, bench, sought, wanted, place)
        plan = assembled(found, bench, sought, settled, weights, sources | more)
        return replace(plan, every=every, seconds=time.perf_counter() - begun)


def check_wanted(training: Campaign, config: Config, wanted: DesignRequest) -> None:
    """Raise UserError for what cannot be designed."""
    if config.system != 'module':
        raise UserError('next designs commands J_eq of a module; for a wire (system wire) it has no sequence of strain')
    if len(set(wanted.between)) != len(wanted.between) or len(wanted.between) == 1:
        raise UserError(f'--between {" ".join(wanted.between)}: expected at least two different explanations')
    if wanted.between and wanted.parameters:
        raise UserError('--between and --parameters ask for different experiments: give one of them')
    if not (wanted.hold > 0.0 and wanted.length >= 4.0 * wanted.hold):
        raise UserError(f'--length {wanted.length:g} s with --hold {wanted.hold:g} s: expected at least four holds')
    for name, value in (('power', wanted.power), ('temperature', wanted.temperature), ('stress', wanted.stress)):
        if value is not None and not value > 0.0:
            raise UserError(f'--max-{name}: expected more than 0')


def fitted_hypotheses(
    training: Campaign, config: Config, wanted: DesignRequest, place: SearchContext
) -> tuple[Hypothesis, ...]:
    """What is to be told apart; a single one where parameters are to be known, or where nothing rivals the best."""
    bare = bare_fit(training, config, models_of(wanted.model), place)
    if wanted.parameters:
        rivals = [('the model', bare)]
    elif wanted.between:
        rivals = named_rivals(bare, wanted.between, place)
    else:
        rivals = leading_rivals(bare, place)
    if wanted.model == 'auto':
        rivals = with_common_kinetics(rivals, place)
    return hypotheses(training, rivals, place)


def grid_for(training: Campaign, wanted: DesignRequest) -> tuple[Grid, dict[str, str]]:
    """The grid of levels; the largest command of the recordings is the limit where none was given."""
    reached = max(float(np.abs(one.source.values[:, command_column(one.source)]).max()) for one in training.recordings)
    power = reached if wanted.power is None else wanted.power
    origin = 'given' if wanted.power is not None else 'the largest command in the recordings'
    if not power > 0.0:
        raise UserError('the recordings have no command other than zero: give --max-power')
    return Grid(round(wanted.length / wanted.hold), wanted.hold, power), {'power': origin}


def limits_for(found: Sequence[Hypothesis], wanted: DesignRequest, pool: Executor) -> tuple[Limits, dict[str, str]]:
    """Temperature and stress: as given, or a little above what the recordings reached under any hypothesis."""
    reached = [shown[0][1:] for one in found for shown in under_recordings(one, pool)]
    T_E = found[0].fitted.problem.config.parameters['environment.T_E']
    hottest, tightest = np.max(reached, axis=0)
    temperature = wanted.temperature or float(T_E + (1.0 + ROOM) * (hottest - T_E))
    stress = wanted.stress or float((1.0 + ROOM) * tightest)
    above = 'a tenth above what the recordings reached in the model'
    return Limits(temperature, stress), {
        'temperature': 'given' if wanted.temperature else above, 'stress': 'given' if wanted.stress else above,
    }  # fmt: skip


def under_recordings(one: Hypothesis, pool: Executor) -> list[list[Shown]]:
    """What the fitted hypothesis shows under the recorded commands."""
    problem, z = one.fitted.problem, one.fitted.z
    config = PickledConfig(problem.fitted(z))
    futures = [
        pool.submit(one_run, ((config, problem.nuisance(z[place])),), run)
        for run, place in zip(problem.runs, problem.indices(), strict=True)
    ]
    return [shown for shown in (future.result() for future in futures) if shown is not None]


def weights_for(one: Hypothesis, wanted: DesignRequest) -> Matrix:
    """The combinations to be known better: parameters by name, or the weakly known directions. Raises UserError."""
    names = [p.name for p in one.fitted.problem.free]
    if not wanted.parameters:
        p = len(names)
        chosen = weak_directions((one.root @ one.root.T)[:p, :p], WEAK, FEWEST)
        return np.hstack([chosen, np.zeros((len(chosen), one.shared - p))])
    for name in wanted.parameters:
        if name not in names:
            raise UserError(f'--parameters {name}: not fitted here{suggestion(name, names)}; fitted are {", ".join(names)}')
    return np.eye(one.shared)[[names.index(name) for name in wanted.parameters]]


def counted_pairs(found: Sequence[Hypothesis]) -> list[tuple[int, int]]:
    """Ordered pairs (true, rival) that count: what the recordings have refuted is a rival, not taken for true."""
    best = max(one.evidence for one in found)
    alive = [k for k, one in enumerate(found) if one.evidence > best - LEADING]
    return [(a, b) for a in alive for b in range(len(found)) if a != b]


def worth_for(found: Sequence[Hypothesis], weights: Matrix) -> Worth:
    """The objective of the search."""
    if len(found) == 1:
        return lambda predicted: gain(weights, found[0].root, predicted[0])
    counted = counted_pairs(found)
    return lambda predicted: worth_of_ratios(ratios(predicted, counted))


def settle_rivals(
    training: Campaign,
    found: Sequence[Hypothesis],
    bench: Bench,
    sought: SearchResult,
    wanted: DesignRequest,
    place: SearchContext,
) -> RefitResult | None:
    """The search continued with rivals that are refitted; None where Ctrl-C came first."""
    (best,) = judged(bench, [sought.parents[0].levels], keep=True)
    if best is None or sought.interrupted:
        return None
    refits = refits_for(training, found, best, counted_pairs(found), place)
    return settle(refits, bench, sought, wanted.budget, wanted.seed, place.on_progress)


def assembled(
    found: tuple[Hypothesis, ...], bench: Bench, sought: SearchResult, settled: RefitResult | None, weights: Matrix,
    origins: dict[str, str],
) -> Plan:  # fmt: skip
    """All that is reported of the best sequence."""
    levels = sought.parents[0].levels if settled is None else settled.best.levels
    best = judged(bench, [levels], keep=True)[0]
    assert best is not None and best.predicted is not None
    single = len(found) == 1
    defaults = [one.predicted for one in sought.defaults if one.predicted is not None]
    return Plan(
        found, bench.grid, levels, bench.limits, origins,
        () if single else expectations(found, best.predicted, defaults, settled),
        knowledge_of(found[0], best.predicted[0], [one[0] for one in defaults]) if single else (),
        (best.worth, float(np.mean([one.worth for one in sought.defaults]))) if single else (0.0, 0.0),
        best.predicted, bench.run, 1, sought.count + (settled.count if settled else 0),
        sought.interrupted or (settled is not None and settled.interrupted), 0.0,
    )  # fmt: skip


def expectations(
    found: Sequence[Hypothesis],
    best: Sequence[Foretold],
    defaults: Sequence[Sequence[Foretold]],
    settled: RefitResult | None,
) -> tuple[Expected, ...]:
    """Every ordered pair: designed against the mean of the default sequences; of refitted rivals where there are any."""
    pairs = [(a, b) for a in range(len(found)) for b in range(len(found)) if a != b]
    designed, usual = ratios(best, pairs), [ratios(one, pairs) for one in defaults]
    means = {(one.true, one.rival): (one.mean, float(np.mean([row[k].mean for row in usual])))
             for k, one in enumerate(designed)}  # fmt: skip
    if settled is not None and settled.defaults:
        means |= {(one.true, one.rival): (one.mean, float(np.mean([row[k].mean for row in settled.defaults])))
                  for k, one in enumerate(settled.expected)}  # fmt: skip
    return tuple(Expected(found[a].name, found[b].name, *means[a, b]) for a, b in pairs)


def knowledge_of(one: Hypothesis, best: Foretold, defaults: Sequence[Foretold]) -> tuple[Knowledge, ...]:
    """Every free parameter: how well it is known now and then."""
    free = one.fitted.problem.free
    each = np.eye(one.shared)[: len(free)]
    now, then = known(each, one.root).std, known(each, one.root, best).std
    usual = np.mean([known(each, one.root, trial).std for trial in defaults], axis=0)
    return tuple(
        Knowledge(p.name, p.unit, p.log, *(float(p.scale * std[k]) for std in (now, usual, then)))
        for k, p in enumerate(free)
    )
