"""The files of a session beside its versions: ``history.json`` and ``session.yaml`` (docs/reference/session.md)."""

from __future__ import annotations

import json
from pathlib import Path

import yaml

from sma_sim.evidence.data.tables import write_whole
from sma_sim.explore.history import History, history_from
from sma_sim.model.errors import UserError
from sma_sim.workflow.data_request import DataRequest, data_request_from

HISTORY, SETTINGS, VERSIONS = 'history.json', 'session.yaml', 'versions'
RECORDINGS = 'recordings'  # folder of what was chosen on the page, and what it has recorded
HEAD = '# A session of sma-sim explore. Delete the folder to forget it; versions/*.yaml are parameter files for --config.\n'


def read_history(folder: Path) -> History:
    """The history in a folder. Raises UserError."""
    path = folder / HISTORY
    try:
        return history_from(json.loads(path.read_text(encoding='utf-8')))
    except OSError as error:
        raise UserError(f'cannot read {path}: {error.strerror}') from error
    except (ValueError, RecursionError) as error:
        raise UserError(
            f'{path} is broken: {error}; the versions are still there as {folder / VERSIONS}/*.yaml: begin a new session '
            f'with --config and one of them'
        ) from error


def read_settings(folder: Path) -> DataRequest | None:
    """The recordings of a session. Raises UserError."""
    path = folder / SETTINGS
    try:
        content = yaml.safe_load(path.read_text(encoding='utf-8'))
    except OSError as error:
        raise UserError(f'cannot read {path}: {error.strerror}') from error
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise UserError(f'{path} is not YAML: {error}') from error
    if not isinstance(content, dict) or set(content) != {'recordings'}:
        raise UserError(f'{path}: expected a mapping with the entry recordings, got {content!r}')
    return data_request_from(content['recordings'], f'{path}, recordings')


def write_settings(folder: Path, data: DataRequest | None) -> None:
    """Write which recordings a session is about. Raises UserError."""
    text = HEAD + yaml.safe_dump({'recordings': data.as_data() if data else None}, sort_keys=False)
    write_whole(folder / SETTINGS, lambda file: file.write(text))
