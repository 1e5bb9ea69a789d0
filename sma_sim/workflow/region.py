"""What the model does in a part of a run: modes, temperatures, directions, as shares of its samples."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.residual_analysis.compare import Comparison
from sma_sim.evidence.residual_analysis.strata import dimensions
from sma_sim.evidence.residual_analysis.wire_states import wires_of

MIN_SHARE = 0.05  # of the samples: less is not named
SAME_EVERYWHERE = ('run', 'time in the run')  # dimensions that say nothing of a part of one run


@dataclass(frozen=True)
class StateShare:
    """A state in which the model is for a `share` of the samples: of which `dimension` (``mode of wire 1``), which class
    (``label``), and both in `words`; `elsewhere`: its share in the rest of all runs."""

    dimension: str
    label: str
    share: float
    elsewhere: float
    words: str


def states_in(comparison: Comparison, run: int, inside: NDArray[np.bool_]) -> tuple[StateShare, ...]:
    """The states of run number `run` where `inside` (k,), by dimension, the most frequent first."""
    found = []
    for dimension in dimensions(comparison):
        if dimension.name in SAME_EVERYWHERE:
            continue
        here = dimension.classes[run][inside]
        others = [classes for k, classes in enumerate(dimension.classes) if k != run]
        rest = np.concatenate([dimension.classes[run][~inside], *others])
        shares = [(float(np.mean(here == k)), k) for k in range(len(dimension.labels))]
        for share, k in sorted(shares, reverse=True):
            if share >= MIN_SHARE:
                elsewhere = float(np.mean(rest == k)) if len(rest) else 0.0
                found.append(StateShare(dimension.name, dimension.labels[k], share, elsewhere, dimension.words(k, k)))
    return tuple(found)


def temperatures_in(comparison: Comparison, run: int, inside: NDArray[np.bool_]) -> dict[str, Any]:
    """By wire, the least and the largest temperature [K]."""
    states = comparison.runs[run].states
    ranges = {wire: states[f'T{suffix}_K'][inside] for suffix, wire in wires_of(comparison.config).items()}
    return {wire: (float(values.min()), float(values.max())) for wire, values in ranges.items()}
