"""`sma-sim tour`: the whole story on small data that come with the package."""

from __future__ import annotations

import argparse
import json
import shutil
import time
from pathlib import Path
from typing import Any

from sma_sim.cli import challenge, compare, diagnose, fit
from sma_sim.cli.common.commands import add_command
from sma_sim.model.errors import UserError
from sma_sim.report.error_reduction_figure import draw_error_reduction
from sma_sim.report.style import save

TOUR_DATA = Path(__file__).parent / 'tour_data'
ERROR_FIGURE = 'error_fall.png'
STEPS = (
    (
        compare,
        'compare data --hold-out run3 --report 1_before.html',
        "Compare three recordings of a robot with the model, which has the paper's values.",
    ),
    (
        fit,
        'fit data --hold-out run3 --model mas --starts 1 --report 2_fit.html -o fitted.yaml',
        'Fit the parameters; run 3 is held out. An error remains that no parameter explains.',
    ),
    (
        diagnose,
        'diagnose data --hold-out run3 --report 3_diagnosis.html --json verdict.json -o better.yaml',
        'Find the missing physical effect: every effect of the library is tested, and the one that explains most is added.',
    ),
    (
        compare,
        'compare data --hold-out run3 --config fitted.yaml --config better.yaml --report 4_after.html',
        'Compare the fitted and the improved model.',
    ),
    (challenge, 'challenge reveal data verdict.json', 'The robot is simulated, and its answer is sealed. Open it.'),
)


def add_parser(verbs: Any) -> None:
    """Declare the verb."""
    parser = add_command(verbs, 'tour')
    parser.add_argument('--out', type=Path, default=Path('tour'), metavar='FOLDER', help='folder to write (default: tour)')
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Run the commands of the tour, each shown as it could be typed."""
    out: Path = arguments.out
    started = time.monotonic()
    if out.exists():
        raise UserError(f'{out} exists already and is not changed: give another folder with --out')
    try:
        out.mkdir(parents=True)
        shutil.copytree(TOUR_DATA, out / 'data')
    except OSError as error:
        raise UserError(f'cannot write {out}: {error.strerror}') from error
    for number, (verb, words, purpose) in enumerate(STEPS, start=1):
        print(f'\n--- {number}. {purpose}\n$ sma-sim {words}\n', flush=True)
        code = run_command(verb, words, out)
        if code != 0:
            return code
    save(draw_error_reduction(json.loads((out / 'verdict.json').read_text(encoding='utf-8'))['error']), out / ERROR_FIGURE)
    pages = ', '.join(sorted(path.name for path in out.glob('*.html')))
    print(
        f'\nFinished after {time.monotonic() - started:.0f} s. Look at {ERROR_FIGURE} and {pages} in {out}; '
        'run the improved model:'
    )
    print(f'$ sma_module_sim --ros-args --params-file {out / "better.yaml"}')
    return 0


def run_command(verb: Any, words: str, out: Path) -> int:
    """Run one command as if it were typed in the folder `out`."""
    parser = argparse.ArgumentParser(prog='sma-sim')
    verb.add_parser(parser.add_subparsers())
    names = {path.name for path in out.iterdir()}
    files = ('.html', '.json', '.yaml')
    arguments = [str(out / word) if word in names or word.endswith(files) else word for word in words.split()]
    chosen = parser.parse_args(arguments)
    chosen.command, chosen.started = f'sma-sim {words}', time.monotonic()
    return int(chosen.run(chosen))
