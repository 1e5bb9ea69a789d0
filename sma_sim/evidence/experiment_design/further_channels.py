"""Which further channel would have decided: the same recordings with one sensor more, at that sensor's usual noise.

Nothing is measured: each hypothesis predicts the channel along the recordings, with its derivatives by all that these leave
uncertain, and the predictions are compared as in a designed experiment (docs/explanation/experiment-design.md). A channel
that is measured already takes part as a second sensor of it, with noise of its own and the same faults.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.data.recording import CHANNEL_COLUMNS
from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.estimation.free_parameters import RESISTIVITY_NAMES, declared_parameters, free_parameter
from sma_sim.evidence.estimation.problem import LinearizedRun, Problem, linearize, measured_steps
from sma_sim.evidence.estimation.residuals import FitData
from sma_sim.evidence.experiment_design.forecast import RunPrediction
from sma_sim.evidence.experiment_design.rival_fits import ModelHypothesis
from sma_sim.evidence.experiment_design.utilities import RivalPair, discrimination_utility, evidence_ratios, information_gain
from sma_sim.evidence.search.refine import TIE
from sma_sim.model.arrays import Matrix

MAX_SAMPLES, RTOL = 500, 1e-6  # of a recording, and of its simulation
OF_WIRES = {'F': 'force', 'T': 'temperature', 'R': 'resistance'}
BY_UNIT = {'m': 'displacement', 'rad': 'angle'}


@dataclass(frozen=True)
class ChannelRatio:
    """Log evidence ratio expected for `true` against `rival` from a further channel."""

    true: str
    rival: str
    expected: float


@dataclass(frozen=True)
class FurtherChannel:
    """One sensor more.

    Attributes
    ----------
    channel, measured
        Its name; whether the recordings have it, so that this is a second sensor.
    noise_std
        Of the sensor (SI): that of the recordings, else `check.noise_*` of the configuration.
    utility
        By which channels are ranked: that of a designed experiment.
    expected
        By pair of hypotheses; none where parameters are to be known better.
    information
        On these parameters [nat]; 0 between hypotheses.
    """

    channel: str
    measured: bool
    noise_std: float
    utility: float
    expected: tuple[ChannelRatio, ...] = ()
    information: float = 0.0

    @property
    def words(self) -> str:
        """What a sentence calls it."""
        letter, _, number = self.channel.partition('_')
        if letter in OF_WIRES and (number.isdigit() or not number):
            wire = f'wire {number}' if number else 'the wire'
            words = f'{OF_WIRES[letter]} of {wire} ({self.channel})'
        else:
            words = f'{BY_UNIT.get(CHANNEL_COLUMNS[self.channel].rpartition("_")[2], "channel")} {self.channel}'
        return f'second, equal sensor of the {words}' if self.measured else words

    @property
    def least(self) -> float:
        """The smallest expected log evidence ratio of all pairs, whichever is true."""
        return min((ratio.expected for ratio in self.expected), default=0.0)

    @property
    def decides(self) -> bool:
        """Whether it separates every pair."""
        return self.least >= TIE


def further_channels(
    hypotheses: Sequence[ModelHypothesis],
    noise_std: Mapping[str, float],
    counted: Sequence[RivalPair],
    combinations: Matrix,
    pool: Executor,
) -> tuple[FurtherChannel, ...]:
    """All channels of the system by utility, the best first.

    `noise_std` (SI): of the recordings; `counted`: pairs that the utility counts; `combinations` (k, n): of parameters to be
    known better, where there is a single hypothesis. Raises SimulationError where one cannot be simulated.
    """
    config = hypotheses[0].fitted.problem.config
    channels = config.structure.channels
    measured = {name for run in hypotheses[0].fitted.problem.runs for name in run.channels}
    noise = {name: noise_std.get(name) or config.parameters[f'check.noise_{name}'] for name in channels}
    shown = [sensed(hypothesis, noise, pool) for hypothesis in hypotheses]
    found = [
        judged(FurtherChannel(name, name in measured, noise[name], 0.0), hypotheses, [of[name] for of in shown], counted)
        if len(hypotheses) > 1
        else informative(FurtherChannel(name, name in measured, noise[name], 0.0), shown[0][name], combinations)
        for name in channels
    ]
    return tuple(sorted(found, key=lambda channel: -channel.utility))


@dataclass(frozen=True)
class SensedChannel:
    """What a hypothesis predicts of one channel along the recordings, and the root (n, n) of its shared covariance."""

    prediction: RunPrediction
    root: Matrix


def judged(
    channel: FurtherChannel,
    hypotheses: Sequence[ModelHypothesis],
    shown: Sequence[SensedChannel],
    counted: Sequence[RivalPair],
) -> FurtherChannel:
    """The channel with what it is expected to tell of the hypotheses."""
    pairs = [RivalPair(a, b) for a in range(len(hypotheses)) for b in range(len(hypotheses)) if a != b]
    ratios = evidence_ratios([sensed_channel.prediction for sensed_channel in shown], pairs)
    utility = discrimination_utility([ratio for ratio in ratios if ratio.pair in counted])
    expected = tuple(
        ChannelRatio(hypotheses[ratio.pair.true].name, hypotheses[ratio.pair.rival].name, ratio.mean) for ratio in ratios
    )
    return replace(channel, utility=utility, expected=expected)


def informative(channel: FurtherChannel, shown: SensedChannel, combinations: Matrix) -> FurtherChannel:
    """The channel with what it is expected to tell of parameters."""
    gain = information_gain(combinations, shown.root, shown.prediction)
    return replace(channel, utility=gain, information=gain)


def sensed(hypothesis: ModelHypothesis, noise: Mapping[str, float], pool: Executor) -> dict[str, SensedChannel]:
    """Every channel over its noise along the recordings, by name, with its derivatives by the whitened unknowns."""
    factor, (given, z, order) = hypothesis.noise_factor, with_resistivities(hypothesis.fitted)
    runs = tuple(with_channels(run, {name: factor * std for name, std in noise.items()}) for run in given.runs)
    problem = replace(given, runs=runs)
    thinned = replace(given, runs=tuple(with_channels(run, {}) for run in given.runs))
    linear = linearize(problem, z, pool, measured_steps(thinned, z, pool), central=True)
    hessian = np.eye(len(z))
    for before, part in zip(given.runs, linear, strict=True):
        flat = part.jacobian[:, : len(before.channels)].reshape(len(part.indices), -1)
        hessian[np.ix_(part.indices, part.indices)] += flat @ flat.T
    ordered = np.linalg.cholesky(np.linalg.inv(hessian[np.ix_(order, order)]))
    root: Matrix = np.empty_like(ordered)
    root[order] = ordered
    n = hypothesis.shared
    return {name: SensedChannel(channel_prediction(name, runs, linear, root), ordered[:n, :n]) for name in noise}


def with_resistivities(fit: FitResult) -> tuple[Problem, Matrix, NDArray[np.int64]]:
    """A fit's problem and optimum, where what a resistance depends on is not known either: its priors decide.

    Beside them the unknowns in an order that has those of the fit first.
    """
    problem, at = fit.problem.at_tolerance(RTOL), len(fit.problem.free)
    known, config = {p.name for p in problem.free}, problem.config
    declared, values = declared_parameters(config), config.values
    more = tuple(
        free_parameter(name, values[name], declared[name], config.priors.get(name))
        for name in RESISTIVITY_NAMES
        if name not in known
    )
    z = np.insert(fit.z, at, np.zeros(len(more)))
    own = np.arange(at, at + len(more))
    order = np.concatenate([np.delete(np.arange(len(z)), own), own])
    return replace(problem, free=(*problem.free, *more)), z, order


def with_channels(run: FitData, noise: Mapping[str, float]) -> FitData:
    """A recording on fewer samples that count for all, and with the channels that it has not, measured as zero."""
    every = max(1, len(run.time) // MAX_SAMPLES)
    time = run.time[::every]
    missing = tuple(name for name in noise if name not in run.channels)
    weight = np.array([np.full(len(time), 1.0 / noise[name]) for name in missing]).reshape(len(missing), len(time))
    return replace(
        run,
        channels=(*run.channels, *missing),
        time=time,
        measured=np.vstack([run.measured[:, ::every], np.zeros_like(weight)]),
        weight=np.sqrt(every) * np.vstack([run.weight[:, ::every], weight]),
    )


def channel_prediction(name: str, runs: Sequence[FitData], linear: Sequence[LinearizedRun], root: Matrix) -> RunPrediction:
    """One channel along all recordings, by the whitened unknowns (`root` (n, n): of their covariance)."""
    centres, jacobians = [], []
    for run, part in zip(runs, linear, strict=True):
        row = run.channels.index(name)
        centres.append(part.residuals[row] + run.measured[row] * run.weight[row])
        jacobians.append(root[part.indices].T @ part.jacobian[:, row])
    return RunPrediction(np.concatenate(centres)[None], np.hstack(jacobians)[None], np.zeros((0, 0)), 0.0, 0.0)
