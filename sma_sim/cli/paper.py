"""`sma-sim paper`: the paper's results again."""

from __future__ import annotations

import argparse
import shutil
import sys
import tempfile
from pathlib import Path
from typing import Any

from sma_sim.cli.options import announce_compilation
from sma_sim.model.errors import UserError
from sma_sim.report.paper import write_paper


def add_parser(verbs: Any) -> None:
    """Declare the verb."""
    parser: argparse.ArgumentParser = verbs.add_parser('paper', help="make the paper's figures and numbers again")
    parser.add_argument('--out', type=Path, default=Path('paper'), metavar='FOLDER', help='new folder (default: paper)')
    parser.add_argument('--runs', type=int, default=30, help='random runs (default 30, as in the paper)')
    parser.add_argument('--seed', type=int, default=1, help='of the random commands (default 1)')
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Write the folder under a temporary name, then rename it."""
    out = arguments.out
    if arguments.runs < 1:
        raise UserError(f'--runs {arguments.runs}: expected at least 1')
    if out.exists():
        raise UserError(f'{out} exists already: choose another folder with --out, or remove it')
    if not out.absolute().parent.is_dir():
        raise UserError(f'cannot write {out}: there is no folder {out.absolute().parent}')
    announce_compilation()
    try:
        temporary = Path(tempfile.mkdtemp(prefix=f'.{out.name}.', dir=out.absolute().parent))
    except OSError as error:
        raise UserError(f'cannot write {out}: {error.strerror}') from error
    try:
        write_paper(temporary, arguments.runs, arguments.seed, lambda words: print(words, file=sys.stderr, flush=True))
        temporary.chmod(0o755)
        temporary.rename(out)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
    print(out / 'paper.md')
    return 0
