"""Where the node's next bag goes: the folder that `node.record` names, or one with a name from the time."""

from __future__ import annotations

import os
import re
from datetime import datetime
from pathlib import Path

from sma_sim.model.errors import UserError

AUTOMATIC_NAME = 'sma_sim_%Y_%m_%d-%H_%M_%S'  # as ros2 bag record names its bags
TIME_FIELD = re.compile('%[A-Za-z%]')  # of strftime


def bag_path(record: str, now: datetime, after_reset: bool = False) -> Path:
    """The folder of a bag that begins now, which does not exist yet.

    A name that ends in ``/`` is a folder of bags with automatic names; fields of strftime (``%H``) are filled in. Where the
    time has made the name, and after a reset, a name that is taken gets a number. Raises UserError for any other that is.
    """
    name = record + AUTOMATIC_NAME if record.endswith('/') else record
    timed = TIME_FIELD.search(name) is not None
    first = path = Path(TIME_FIELD.sub(lambda field: now.strftime(field.group()), name)).expanduser().absolute()
    if os.path.lexists(path) and not timed and not after_reset:
        raise UserError(
            f'node.record = {record}: {path} exists already and is not overwritten. Give another name, or one that the '
            f"time completes: '{record}/' (a new bag in that folder at each start) or '{record}_%Y%m%d_%H%M%S'"
        )
    again = 0
    while os.path.lexists(path):
        again += 1
        path = first.with_name(f'{first.name}_{again}')
    return path


def record_of_side(record: str, side: str) -> str:
    """`node.record` of one of two modules that start together: of a folder of bags, a folder of its own."""
    if not record:
        return ''
    return f'{record}{side}/' if record.endswith('/') else f'{record}_{side}'
