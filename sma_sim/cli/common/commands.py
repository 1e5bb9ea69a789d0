"""How a command joins `sma-sim`."""

from __future__ import annotations

import argparse
from typing import Any


def add_command(verbs: Any, name: str, purpose: str) -> argparse.ArgumentParser:
    """The parser of a command; `purpose` is its line in `sma-sim --help`, and the first sentence of its own help."""
    parser: argparse.ArgumentParser = verbs.add_parser(
        name, help=purpose, description=f'{purpose[0].upper()}{purpose[1:]}.'.replace('%', '%%')
    )
    return parser
