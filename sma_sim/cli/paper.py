"""`sma-sim paper`: the paper's results again."""

from __future__ import annotations

import argparse
import shutil
import sys
import tempfile
from pathlib import Path
from typing import Any

from sma_sim.cli.common.commands import add_command
from sma_sim.cli.common.config_options import announce_first_compilation
from sma_sim.model.errors import UserError
from sma_sim.report.paper import FIGURES, PAGE, write_paper
from sma_sim.solver.paper_experiments import repeat_paper

MAX_RANDOM_RUNS = 100_000


def add_parser(verbs: Any) -> None:
    """Declare the verb."""
    parser = add_command(verbs, 'paper')
    parser.add_argument('--out', type=Path, default=Path('paper'), metavar='FOLDER', help='folder to write (default: paper)')
    parser.add_argument('--overwrite', action='store_true', help='replace FOLDER if an earlier run of this command wrote it')
    parser.add_argument('--runs', type=int, default=30, help='number of random runs (default 30, as in the paper)')
    parser.add_argument('--seed', type=int, default=1, help='seed of the random commands (default 1)')
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Write the folder under a temporary name, then rename it."""
    if not 1 <= arguments.runs <= MAX_RANDOM_RUNS:
        raise UserError(f'--runs {arguments.runs}: expected at least 1 and at most {MAX_RANDOM_RUNS}')
    if arguments.seed < 0:
        raise UserError(f'--seed {arguments.seed}: expected 0 or more')
    out = arguments.out.resolve()
    check_output_folder(out, arguments.overwrite)
    announce_first_compilation()
    try:
        temporary = Path(tempfile.mkdtemp(prefix=f'.{out.name}.', dir=out.parent))
    except OSError as error:
        raise UserError(f'cannot write {out}: {error.strerror}') from error
    try:
        write_paper(temporary, repeat_paper(arguments.runs, arguments.seed, announce))
        temporary.chmod(0o755)
        check_output_folder(out, arguments.overwrite)  # once more: the runs took a while
        replace_folder(temporary, out)
    except OSError as error:
        raise UserError(f'cannot write {out}: {error.strerror}') from error
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
    print(arguments.out / PAGE)
    return 0


def announce(words: str) -> None:
    """Print what is being done."""
    print(words, file=sys.stderr, flush=True)


def check_output_folder(out: Path, overwrite: bool) -> None:
    """Raise UserError where the folder cannot be written, or where it would replace what is not ours."""
    if not out.parent.is_dir():
        raise UserError(f'cannot write {out}: there is no folder {out.parent}')
    if not out.exists():
        return
    if not out.is_dir():
        raise UserError(f'cannot write {out}: it is a file, expected a folder')
    try:
        others = {file.name for file in out.iterdir()} - {PAGE, *FIGURES}
        empty = not any(out.iterdir())
    except OSError as error:
        raise UserError(f'cannot read {out}: {error.strerror}') from error
    if others:
        raise UserError(f'{out} holds other files ({min(others)}) and is not changed: choose another folder with --out')
    if not empty and not overwrite:
        raise UserError(f'{out} exists already: give --overwrite to replace it, or another folder with --out')


def replace_folder(temporary: Path, out: Path) -> None:
    """Rename the new folder to `out`; what was there goes only once the new one is complete."""
    if out.exists():
        old = Path(tempfile.mkdtemp(prefix=f'.{out.name}.', dir=out.parent))
        out.rename(old / out.name)
        temporary.rename(out)
        shutil.rmtree(old, ignore_errors=True)
    else:
        temporary.rename(out)
