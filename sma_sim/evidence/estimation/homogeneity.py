"""Are the transformation stresses of a wire the same in all runs? Each run is fitted for them alone, the rest held.

The model has one straight line sigma_MW(T) = sigma_MW0 + sigma_T (T - T0) and one width dsigma of the hysteresis for
all temperatures. Fitted run by run, sigma_MW0 comes out the same everywhere if the line is right, and so does dsigma
if the width is; Cochran's Q (a chi-square of the values, weighted by their intervals) says whether they differ by more
than they are uncertain.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace

import numpy as np

from sma_sim.evidence.data.recording import Dataset, Recording
from sma_sim.evidence.estimation.calibrate import FitOptions, calibrate
from sma_sim.evidence.estimation.chi_square import chi_square_tail
from sma_sim.evidence.estimation.search_context import silent_iteration
from sma_sim.evidence.estimation.uncertainty import GAUSS_95, Interval
from sma_sim.model.config import Config

STRESS_NAMES = ('wire.sigma_MW0', 'wire.dsigma')
HETEROGENEOUS = 0.01  # p-value below which runs do not agree
HEATING_COLUMN = 1  # column of a wire's input
MIN_TEMPERATURE_STEP = 2.0  # [K]: runs nearer to each other determine no slope


@dataclass(frozen=True)
class RunStress:
    """One run on its own: mean ambient temperature [K], sigma_MW there and dsigma, each with its 95 % interval [Pa]."""

    name: str
    held_out: bool
    temperature: float
    sigma_MW: tuple[float, float, float]
    dsigma: tuple[float, float, float]


@dataclass(frozen=True)
class HomogeneityTest:
    """Runs of a wire one by one, in the order of temperature, and what they say together, in words.

    `p_line` and `p_width`: how likely so much spread is when one straight sigma_MW(T), one dsigma is right.
    """

    runs: tuple[RunStress, ...]
    p_line: float
    p_width: float
    sentences: tuple[str, ...]


def homogeneity_test(
    config: Config, fitted: Dataset, held_out: Dataset | None = None, executor: Executor | None = None
) -> HomogeneityTest | None:
    """Fit the transformation stresses of every run, the rest as in `config`; None where fewer than two runs determine them.

    Runs that are heated (nobody knows the temperature of the wire) or do not see both stresses are left out.
    """
    runs = [(recording, False) for recording in fitted.recordings]
    runs += [(recording, True) for recording in (held_out.recordings if held_out else ())]
    isotherms = [
        (recording, out) for recording, out in runs if not np.any(np.asarray(recording.source.values)[:, HEATING_COLUMN])
    ]
    found = [run_stress(config, fitted, recording, out, executor) for recording, out in isotherms]
    stresses = sorted((run for run in found if run is not None), key=lambda run: run.temperature)
    if len(stresses) < 2:
        return None
    slope, T0 = config.parameters['wire.sigma_T'], config.parameters['wire.T0']
    level = [tuple(x - slope * (run.temperature - T0) for x in run.sigma_MW) for run in stresses]
    p_line, p_width = cochran_p(level), cochran_p([run.dsigma for run in stresses])
    return HomogeneityTest(tuple(stresses), p_line, p_width, tuple(sentences(stresses, p_line, p_width)))


def run_stress(
    config: Config, dataset: Dataset, recording: Recording, held_out: bool, executor: Executor | None
) -> RunStress | None:
    """One run on its own, None where it does not determine both."""
    options = FitOptions(free=STRESS_NAMES, kinetics=config.simulated_kinetics, starts=1)
    found = calibrate(replace(dataset, recordings=(recording,)), config, options, executor, silent_iteration)
    known = {interval.name: interval for interval in found.uncertainty.intervals} if found.uncertainty else {}
    if set(known) != set(STRESS_NAMES) or not all(interval.seen for interval in known.values()):
        return None
    temperature = float(np.mean(np.asarray(recording.source.values)[:, -1]))
    shift = config.parameters['wire.sigma_T'] * (temperature - config.parameters['wire.T0'])
    level, width = (numbers(known[name]) for name in STRESS_NAMES)
    return RunStress(recording.name, held_out, temperature, (level[0] + shift, level[1] + shift, level[2] + shift), width)


def numbers(interval: Interval) -> tuple[float, float, float]:
    """Value and 95 % interval."""
    return interval.value, interval.low, interval.high


def cochran_p(values: Sequence[Sequence[float]]) -> float:
    """The p-value of Cochran's Q over (value, low, high)."""
    value = np.array([center for center, _, _ in values])
    weight = np.array([(2.0 * GAUSS_95 / max(high - low, 1e-300)) ** 2 for _, low, high in values])
    mean = float(weight @ value / weight.sum())
    return chi_square_tail(float(weight @ (value - mean) ** 2), len(value) - 1)


def sentences(runs: Sequence[RunStress], p_line: float, p_width: float) -> list[str]:
    """What the runs say together."""
    widths = ', '.join(f'{1e-6 * run.dsigma[0]:.3g} MPa at {run.temperature:.0f} K ({run.name})' for run in runs)
    verdict = 'one dsigma does not fit all runs' if p_width < HETEROGENEOUS else 'one dsigma fits all runs'
    found = [f'The fitted width of the hysteresis is {widths}: {verdict} (p = {p_width:.2g}).']
    slopes = [
        f'{1e-6 * (b.sigma_MW[0] - a.sigma_MW[0]) / (b.temperature - a.temperature):.3g} MPa/K from {a.temperature:.0f} to '
        f'{b.temperature:.0f} K'
        for a, b in zip(runs[:-1], runs[1:], strict=True)
        if b.temperature - a.temperature > MIN_TEMPERATURE_STEP
    ]
    verdict = (
        f'one straight sigma_MW(T), that is one sigma_T, {"does not fit" if p_line < HETEROGENEOUS else "fits"} all runs'
    )
    if slopes:
        found.append(f'The middle of the hysteresis rises by {", ".join(slopes)}: {verdict} (p = {p_line:.2g}).')
    else:
        found.append(f'The middle of the hysteresis: {verdict} (p = {p_line:.2g}).')
    return found
