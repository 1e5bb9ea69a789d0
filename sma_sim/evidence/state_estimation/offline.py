"""An observer over a recording: what the node would have said while it was made."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from sma_sim.evidence.data.recording import Recording
from sma_sim.evidence.state_estimation.observer import Observer
from sma_sim.model.arrays import Vector
from sma_sim.model.config import Config
from sma_sim.model.errors import UserError
from sma_sim.model.nearest import suggestion


def observe_recording(recording: Recording, config: Config, unused: Collection[str] = ()) -> dict[str, Vector]:
    """Estimates at the samples of a recording.

    Parameters
    ----------
    recording : Recording
        What was measured, and the input.
    config : Config
        The model, as for `Observer`.
    unused : collection of str
        Channels that the observer is not told of.

    Returns
    -------
    dict of str to array (k,)
        By column of the file contract: ``time_s``, ``J_eq_W`` or the commands of the structure, ``T_E_K``; for each wire
        ``T_1_K``, ``x_M_1``, ``stress_1_Pa``, their standard deviations ``T_1_std_K``, ``x_M_1_std``, ``stress_1_std_Pa``,
        and ``mode_1``.

    Raises
    ------
    UserError
        For a channel that the recording does not have, and for an input of another system.
    """
    structure = config.structure
    for name in unused:
        if name not in recording.channels:
            raise UserError(f'{recording.name} has no channel {name}{suggestion(name, recording.channels)}')
    if recording.source.columns != structure.input_columns:
        given, expected = ', '.join(recording.source.columns), ', '.join(structure.input_columns)
        raise UserError(f'{recording.name} has the input {given}; system {config.system} takes {expected}')
    channels = {name: values for name, values in recording.channels.items() if name not in unused}
    observer, inputs, found = Observer(config), recording.source, []
    row = 0
    for k, t in enumerate(recording.time.tolist()):
        while row < len(inputs.times) and inputs.times[row] <= t:
            *heating, T_E = inputs.values[row].tolist()
            observer.tell(float(inputs.times[row]), heating, {}, T_E)
            row += 1
        found.append(observer.update(t, None, {name: float(values[k]) for name, values in channels.items()}))
    means, stds = np.array([one.mean for one in found]), np.array([one.std for one in found])
    modes = np.array([one.modes for one in found])
    at = np.maximum(np.searchsorted(inputs.times, recording.time, side='right') - 1, 0)
    columns = {'time_s': recording.time}
    columns |= {name: inputs.values[at, k] for k, name in enumerate(inputs.columns)}
    for i, suffix in enumerate(structure.wire_suffixes):
        for k, (name, unit) in enumerate((('T', '_K'), ('x_M', ''), ('stress', '_Pa'))):
            column = k * structure.wires + i
            columns[f'{name}{suffix}{unit}'] = means[:, column]
            columns[f'{name}{suffix}_std{unit}'] = stds[:, column]
        columns[f'mode{suffix}'] = modes[:, i].astype(float)
    return columns
