"""What was measured: one recording of a robot or of a wire, and the recordings of a dataset."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sma_sim.model.effects.ports import CHANNELS
from sma_sim.solver.inputs import Input

Vector = NDArray[np.float64]

# Columns of the file contract that hold measured channels.
CHANNEL_COLUMNS: Mapping[str, str] = {
    'U_x': 'U_x_m', 'U_y': 'U_y_m', 'alpha': 'alpha_rad', 'F_1': 'F_1_N', 'F_2': 'F_2_N', 'T_1': 'T_1_K', 'T_2': 'T_2_K',
    'stress': 'stress_Pa', 'T': 'T_K',
}  # fmt: skip
assert tuple(CHANNEL_COLUMNS) == CHANNELS

# Columns of the file contract that are read, by system: inputs first, then what is measured there.
INPUT_COLUMNS: Mapping[str, tuple[str, ...]] = {
    'module': ('time_s', 'J_eq_W', 'T_E_K'),
    'wire': ('time_s', 'strain', 'J_W', 'T_E_K'),
}
NEEDED_COLUMNS: Mapping[str, tuple[str, ...]] = {'module': ('time_s', 'J_eq_W'), 'wire': ('time_s', 'strain')}
CHANNELS_OF: Mapping[str, tuple[str, ...]] = {'module': CHANNELS[:7], 'wire': CHANNELS[7:]}
HIDDEN_COLUMNS = ('x_M_1', 'x_M_2', 'mode_1', 'mode_2', 'x_M', 'mode')  # no sensor shows them: not compared


@dataclass(frozen=True)
class Recording:
    """One run: what was measured, under which input.

    Attributes
    ----------
    name, system : str
        Name of the file or session; ``'module'`` or ``'wire'``.
    time : array (k,)
        Sample times [s], increasing.
    channels : mapping
        Arrays (k,) by channel (U_x, U_y, alpha, F_1, F_2, T_1, T_2; stress, T), SI units, NaN where a sample is missing.
        A channel that was not measured is absent.
    source : Input
        The input of the run; it covers `time`.
    exact_commands : bool
        Whether the input changed exactly at the rows of `source`. Otherwise it was only sampled, and each change happened
        somewhere between its row and the row before, except those of `known_changes` [s].
    notes : tuple of str
        What was repaired on the way from the file.
    """

    name: str
    system: str
    time: Vector
    channels: Mapping[str, Vector]
    source: Input
    exact_commands: bool = True
    notes: tuple[str, ...] = ()
    known_changes: tuple[float, ...] = ()


@dataclass(frozen=True)
class Dataset:
    """Recordings of one robot or wire.

    Attributes
    ----------
    recordings : tuple of Recording
        The runs.
    noise_std : mapping
        Standard deviation of the noise by channel, SI units.
    notes : tuple of str
        Where the noise comes from and what was left out; those of a recording are in the recording.
    """

    recordings: tuple[Recording, ...]
    noise_std: Mapping[str, float] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    @property
    def system(self) -> str:
        """`module` or `wire`."""
        return self.recordings[0].system
