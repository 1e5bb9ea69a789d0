"""The paper's calibration of a wire (section IV.A): all but sigma_T from the loop at one temperature, sigma_T from others.

Each further loop then gives its own sigma_MW and dsigma, so that one sees whether a single sigma_T and a single
dsigma fit them all.
"""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, replace

import numpy as np

from sma_sim.evidence.data.recording import Dataset, Recording
from sma_sim.evidence.estimation.calibrate import Calibration, FitOptions, calibrate
from sma_sim.evidence.estimation.held_out_prediction import evaluate_held_out
from sma_sim.evidence.estimation.search_context import silent_iteration
from sma_sim.model.config import Config
from sma_sim.model.errors import UserError

REFERENCE_NAMES = ('wire.E_A', 'wire.E_M', 'wire.eps_T', 'wire.sigma_MW0', 'wire.dsigma', 'wire.c_V', 'wire.lambda')
FURTHER_NAMES = ('wire.sigma_MW0', 'wire.dsigma')
TEMPERATURE_TOLERANCE = 1.0  # [K]


@dataclass(frozen=True)
class Loop:
    """One isotherm: its temperature [K], sigma_MW and dsigma there [Pa] with the standard deviations of their logarithms
    (NaN where not known), and the RMSE of its stress [Pa] under the model that was calibrated."""

    name: str
    T_E: float
    sigma_MW: float
    sigma_MW_std: float
    dsigma: float
    dsigma_std: float
    rmse: float


@dataclass(frozen=True)
class PaperCalibration:
    """`config` with all parameters; `first`: the fit of the loop at one temperature; the loops, by temperature.

    `sigma_T` [Pa/K] is the weighted line through the other loops' sigma_MW and the first's. `slopes` [Pa/K] are those
    between neighbouring loops: they would all be sigma_T if one sigma_T fitted; `dsigma_spread` is the largest dsigma
    over the smallest.
    """

    config: Config
    first: Calibration
    loops: tuple[Loop, ...]
    sigma_T: float
    slopes: tuple[float, ...]
    dsigma_spread: float


def temperature(recording: Recording) -> float:
    """Mean ambient temperature of a recording [K]."""
    return float(np.mean(recording.source.values[:, -1]))


def calibrate_as_the_paper(
    dataset: Dataset, config: Config, at: float = 315.0, executor: Executor | None = None
) -> PaperCalibration:
    """Calibrate a wire from its isotherms: the loop nearest to `at` [K] first, then sigma_T from the others.

    Raises UserError where no loop is at that temperature (within 1 K), or no other one is there.
    """
    loops = sorted(dataset.recordings, key=temperature)
    first = [loop for loop in loops if abs(temperature(loop) - at) <= TEMPERATURE_TOLERANCE]
    others = [loop for loop in loops if loop not in first]
    if not first or not others:
        found = ', '.join(f'{temperature(loop):g}' for loop in loops)
        raise UserError(f'expected isotherms at {at:g} K and at another temperature, got {found or "none"} [K]')
    here = fitted_at(Dataset(tuple(first), dataset.noise_std), config, REFERENCE_NAMES, executor)
    fits = {
        loop.name: fitted_at(Dataset((loop,), dataset.noise_std), here.config, FURTHER_NAMES, executor) for loop in others
    }
    fits |= {loop.name: here for loop in first}
    T = np.array([temperature(loop) for loop in loops])
    stress = np.array([fits[loop.name].values['wire.sigma_MW0'] for loop in loops])
    spread = stress * np.array([log_std(fits[loop.name], 'wire.sigma_MW0') for loop in loops])
    line = np.polyfit(T - at, stress, 1, w=1.0 / np.nan_to_num(np.maximum(spread, 1.0), nan=1.0))
    values = {**here.config.parameters, 'wire.sigma_T': max(float(line[0]), 0.0), 'wire.T0': at}
    final = replace(here.config, parameters=moved_to(values, config.parameters['wire.T0']))
    rmse = stress_errors(final, dataset, executor)
    return summary(final, here, loops, fits, rmse, float(line[0]))


def fitted_at(dataset: Dataset, config: Config, names: tuple[str, ...], executor: Executor | None) -> Calibration:
    """A hybrid fit with T0 at the temperature of the loop, so that sigma_MW0 is sigma_MW there."""
    here = {**config.parameters, 'wire.T0': temperature(dataset.recordings[0])}
    return calibrate(
        dataset, replace(config, parameters=here), FitOptions(free=names, kinetics='hybrid'), executor, silent_iteration
    )


def moved_to(values: Mapping[str, float], T0: float) -> dict[str, float]:
    """The same sigma_MW(T) with another reference temperature."""
    shift = values['wire.sigma_T'] * (T0 - values['wire.T0'])
    return {**values, 'wire.sigma_MW0': values['wire.sigma_MW0'] + shift, 'wire.T0': T0}


def stress_errors(config: Config, dataset: Dataset, executor: Executor | None) -> dict[str, float]:
    """RMSE of the stress by recording [Pa]."""
    noise = dataset.noise_std['stress']
    return {fit.name: noise * fit.channel_errors['stress'] for fit in evaluate_held_out(config, dataset, executor=executor)}


def log_std(found: Calibration, name: str) -> float:
    """Standard deviation of the logarithm of a fitted parameter, NaN where it is not known."""
    known = found.uncertainty.intervals if found.uncertainty else ()
    return next((interval.std for interval in known if interval.name == name), float('nan'))


def summary(
    config: Config,
    first: Calibration,
    recordings: list[Recording],
    fits: Mapping[str, Calibration],
    rmse: Mapping[str, float],
    sigma_T: float,
) -> PaperCalibration:
    """The loops with the fit of each of them alone."""
    loops = tuple(loop_of(recording, fits[recording.name], rmse[recording.name]) for recording in recordings)
    pairs = [(a, b) for a, b in zip(loops, loops[1:], strict=False) if b.T_E - a.T_E > TEMPERATURE_TOLERANCE]
    slopes = tuple((b.sigma_MW - a.sigma_MW) / (b.T_E - a.T_E) for a, b in pairs)
    heights = [loop.dsigma for loop in loops]
    return PaperCalibration(config, first, loops, sigma_T, slopes, max(heights) / min(heights))


def loop_of(recording: Recording, fit: Calibration, rmse: float) -> Loop:
    """What the fit of one loop says of it."""
    return Loop(
        recording.name,
        temperature(recording),
        fit.values['wire.sigma_MW0'],
        log_std(fit, 'wire.sigma_MW0'),
        fit.values['wire.dsigma'],
        log_std(fit, 'wire.dsigma'),
        rmse,
    )
