"""A challenge as a folder: recordings, their noise, the YAML to start from, and the sealed answer.

The seal is no security: it keeps the answer from being read by accident, and shows whether it was changed.
"""

from __future__ import annotations

import base64
import binascii
import hashlib
import json
import os
import shutil
import tempfile
import zlib
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import yaml

from sma_sim.challenge.answer import Answer, answer_from
from sma_sim.challenge.make import Challenge
from sma_sim.challenge.robot import REST_DURATION
from sma_sim.evidence.data.recording import CHANNEL_COLUMNS, Recording
from sma_sim.evidence.data.rosbag.run_writer import write_mcap
from sma_sim.evidence.data.sources import META_FILE
from sma_sim.evidence.data.tables import write_columns
from sma_sim.model.argument_checks import checked
from sma_sim.model.arrays import Vector
from sma_sim.model.config import Config
from sma_sim.model.errors import UserError
from sma_sim.model.nearest import suggestion
from sma_sim.solver.inputs import inputs_at

ANSWER_FILE, NOMINAL_FILE = 'answer.sealed', 'nominal.yaml'
ANSWER_FORMAT = 'sma_sim challenge answer 1'
NOMINAL_GROUPS = ('wire', 'beam', 'plate', 'environment')
WRITERS: Mapping[str, Callable[[Path, Mapping[str, Vector]], None]] = {'mcap': write_mcap, 'csv': write_columns}


@checked
def write_challenge(challenge: Challenge, folder: str | Path, format: str = 'mcap') -> None:
    """Write recordings, the model to start from and the sealed answer to a new folder, whole or not at all.

    Parameters
    ----------
    challenge : Challenge
        From `make_challenge`.
    folder : str or Path
        The folder, which must not exist.
    format : str
        Of the recordings: ``'mcap'`` or ``'csv'``.

    Returns
    -------
    None

    Raises
    ------
    UserError
        For a folder that exists or cannot be written, and for another format.

    Examples
    --------
    >>> import sma_sim, tempfile
    >>> from pathlib import Path
    >>> case = sma_sim.make_challenge(1, plan=sma_sim.RecordingPlan(duration=10.0, rate=10.0))
    >>> folder = Path(tempfile.mkdtemp()) / 'case'
    >>> sma_sim.write_challenge(case, folder, 'csv')
    >>> sorted(file.name for file in folder.iterdir())
    ['answer.sealed', 'meta.json', 'nominal.yaml', 'run1.csv', 'run2.csv', 'run3.csv']
    """
    folder = Path(folder)
    if format not in WRITERS:
        raise UserError(f'format = {format!r}: expected one of {", ".join(WRITERS)}{suggestion(format, WRITERS)}')
    check_new(folder)
    try:
        temporary = Path(tempfile.mkdtemp(prefix=f'.{folder.name}.', dir=folder.parent))
    except OSError as error:
        raise UserError(f'cannot write {folder}: {error.strerror}') from error
    try:
        for recording in challenge.dataset.recordings:
            WRITERS[format](temporary / f'{recording.name}.{format}', recording_columns(recording))
        (temporary / META_FILE).write_text(json.dumps(meta_of(challenge), indent=2) + '\n', encoding='utf-8')
        (temporary / NOMINAL_FILE).write_text(nominal_yaml(challenge.nominal), encoding='utf-8')
        (temporary / ANSWER_FILE).write_text(sealed_answer(challenge.answer), encoding='utf-8')
        temporary.chmod(0o777 & ~current_umask())
        temporary.rename(folder)
    except OSError as error:
        raise UserError(f'cannot write {folder}: {error.strerror}') from error
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def meta_of(challenge: Challenge) -> dict[str, object]:
    """What is known of the measurement: noise [SI], samples per second, rest before each run [s]."""
    steps = np.diff(challenge.dataset.recordings[0].time)
    rate = round(1.0 / float(np.median(steps)), 6)
    return {'noise_std': dict(challenge.dataset.noise_std), 'rate_hz': rate, 'rest_s': REST_DURATION}


def check_new(folder: Path) -> None:
    """Raise UserError, before any long work, where a folder exists or its parent does not."""
    if folder.exists():
        raise UserError(f'{folder} exists already and is not overwritten: give another folder')
    if not folder.parent.is_dir():
        raise UserError(f'cannot write {folder}: there is no folder {folder.parent}')


def current_umask() -> int:
    """The file mode bits that new files do not get (a temporary folder is private otherwise)."""
    mask = os.umask(0)
    os.umask(mask)
    return mask


def recording_columns(recording: Recording) -> dict[str, Vector]:
    """The columns of the file contract, (k,) each, with a row without samples at each change of the command."""
    changes = recording.source.times[recording.source.times < recording.time[-1]]
    time = np.union1d(recording.time, changes)
    columns = inputs_at(recording.source, time)
    at = np.searchsorted(time, recording.time)
    for channel, values in recording.channels.items():
        columns[CHANNEL_COLUMNS[channel]] = np.full(len(time), np.nan)
        columns[CHANNEL_COLUMNS[channel]][at] = values
    return columns


def nominal_yaml(nominal: Config) -> str:
    """The model that the user is given, as a ROS 2 parameter file."""
    parameters: dict[str, object] = {'system': nominal.system, 'model': nominal.kinetics}
    for group in NOMINAL_GROUPS:
        names = [name for name in nominal.parameters if name.startswith(f'{group}.')]
        parameters[group] = {name.removeprefix(f'{group}.'): nominal.parameters[name] for name in names}
    head = '# Where a challenge starts: the values of the data sheets. The robot that was measured differs. SI units.\n'
    return head + yaml.safe_dump({'/**': {'ros__parameters': parameters}}, sort_keys=False)


def sealed_answer(answer: Answer) -> str:
    """The answer in a form that nobody reads by accident, with its hash."""
    text = json.dumps(answer.as_data()).encode()
    packed = base64.b64encode(zlib.compress(text, 9)).decode()
    note = 'no secret, only out of sight: sma-sim challenge reveal FOLDER'
    return (
        json.dumps({'format': ANSWER_FORMAT, 'note': note, 'sha256': hashlib.sha256(text).hexdigest(), 'sealed': packed})
        + '\n'
    )


def open_answer(folder: Path) -> Answer:
    """The answer of a challenge's folder. Raises UserError when there is none, or it was changed."""
    path = folder / ANSWER_FILE
    try:
        outer = json.loads(path.read_text(encoding='utf-8'))
    except OSError as error:
        raise UserError(f'{folder} is no challenge: cannot read {path}: {error.strerror}') from error
    except ValueError as error:
        raise UserError(f'{path} is not a sealed answer: {error}') from error
    if not isinstance(outer, dict) or outer.get('format') != ANSWER_FORMAT:
        raise UserError(f'{path} is not a sealed answer of this version: expected format {ANSWER_FORMAT!r}')
    try:
        text = zlib.decompress(base64.b64decode(outer['sealed'], validate=True))
    except (KeyError, TypeError, zlib.error, binascii.Error) as error:
        raise UserError(f'{path} is damaged: {error}; make the challenge again from its seed') from error
    if hashlib.sha256(text).hexdigest() != outer.get('sha256'):
        raise UserError(f'{path} was changed: its hash does not fit; make the challenge again from its seed')
    return answer_from(json.loads(text))
