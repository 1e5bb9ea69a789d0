"""What is imposed and was measured, as an input: fewer straight stretches, where rows between say no more than noise.

The solver must stop at every kink of its input. A gauge's noise makes one at each row, and steps by the thousand that no
measured stress can tell from a straight line.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.data.noise import estimate_noise
from sma_sim.evidence.data.recording import Recording
from sma_sim.model.structures.discovery import known_structures
from sma_sim.solver.inputs import Input

Vector = NDArray[np.float64]
MAX_STIFFNESS = 6e10  # [Pa] as stiff as a wire is along a strain: what a change of strain does to the stress, at the most
JITTER_WIDTH = 4.0  # of the jitter, in its standard deviations
WIDEST = {'stress': 1e5, 'T': 0.1}  # [Pa], [K]: what neither moves a strain by 1e-5 nor a transformation by much
ROUNDING = 1e-12  # of the largest value: lines of exact numbers have no corners
STRESS_WIDTH = 2.0  # of the stress, in standard deviations of its noise


def simplified_input(recording: Recording, noise_std: Mapping[str, float]) -> Input:
    """The recording's input without rows at which what is imposed is within its jitter of a straight line.

    Of a strain also within the stress's noise. Rows at which heating or the ambient temperature changes stay. `noise_std`
    [SI] by channel; an input of which nothing is imposed stays as it is.
    """
    source = recording.source
    drives = known_structures()[recording.system].drives
    times, values = np.asarray(source.times, float), np.asarray(source.values, float)
    others = values[:, len(drives) :]
    keep = np.zeros(len(times), dtype=bool)
    for k, drive in enumerate(drives):
        jitter = estimate_noise(times, values[:, k])
        if jitter is None:
            return source
        widest = WIDEST.get(drive.name, STRESS_WIDTH * noise_std.get('stress', np.inf) / MAX_STIFFNESS)
        rounding = ROUNDING * float(np.abs(values[:, k]).max())
        keep |= corners(times, values[:, k], max(rounding, min(JITTER_WIDTH * jitter.std, widest)))
    if not drives:
        return source
    keep[1:] |= (np.diff(others, axis=0) != 0.0).any(axis=1)
    return Input(times[keep], values[keep], source.linear, source.names)


def corners(times: Vector, values: Vector, width: float) -> NDArray[np.bool_]:
    """Which of the points (k,) a polyline needs that passes all others within `width` (Douglas and Peucker 1973)."""
    keep = np.zeros(len(times), dtype=bool)
    keep[[0, -1]] = True
    stretches = [(0, len(times) - 1)]
    while stretches:
        first, last = stretches.pop()
        slope = (values[last] - values[first]) / (times[last] - times[first])
        inside = slice(first + 1, last)
        apart = np.abs(values[inside] - values[first] - slope * (times[inside] - times[first]))
        if not len(apart) or apart.max() <= width:
            continue
        corner = first + 1 + int(apart.argmax())
        keep[corner] = True
        stretches += [(first, corner), (corner, last)]
    return keep
