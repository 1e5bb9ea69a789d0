"""The parameters that a bag of `sma_module_sim` holds, and the configuration that they make with the options."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sma_sim.cli.common.config_options import noted
from sma_sim.evidence.data.rosbag.bag_files import is_bag
from sma_sim.model.config import Config, read_config
from sma_sim.model.errors import UserError
from sma_sim.model.given import effect_folders_of

if TYPE_CHECKING:
    from sma_sim.evidence.data.rosbag.salvage import Bag


def recorded_parameters(bag: Bag) -> dict[str, Any] | None:
    """The recording node's parameters by full name; None for a bag of another recorder. Raises UserError."""
    text = bag.about.get('parameters')
    if text is None:
        return None
    try:
        parameters = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise UserError(f'{bag.path}: the parameters recorded in it are not JSON: {error}') from error
    if not isinstance(parameters, dict):
        raise UserError(f'{bag.path}: expected recorded parameters by name, got {type(parameters).__name__}')
    return parameters


def config_for_replay(arguments: argparse.Namespace, path: Path, *words: str) -> Config:
    """The configuration of the options; without ``--config`` it starts from the parameters in the bag `path`, if any.

    Folders of effects that only the bag names are not opened. Raises UserError.
    """
    recorded = None
    if arguments.config is None and is_bag(path):
        from sma_sim.evidence.data.rosbag.salvage import open_bag  # only here: tables need no library of bags

        recorded = recorded_parameters(open_bag(path))
    if recorded is None:
        return noted(read_config(arguments.config, [*arguments.words, *words], arguments.effects))
    print(f'note: parameters as recorded in {path} (--config FILE gives others)', file=sys.stderr)
    config = read_config(None, [*arguments.words, *words], arguments.effects, recorded, str(path))
    note_folders(arguments, path, recorded)
    return config


def note_folders(arguments: argparse.Namespace, path: Path, recorded: Mapping[str, Any]) -> None:
    """Say which folders a bag names that were not opened."""
    if recorded.get('effects.paths') and not effect_folders_of(None, arguments.words):
        print(
            f'note: {path} names folders of effects, {recorded["effects.paths"]}: not opened, nothing in use needs them',
            file=sys.stderr,
        )
