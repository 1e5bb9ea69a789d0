"""All measured numbers of the documentation, from one version: runs the benchmarks, writes docs/reference/validation.md.

    python benchmarks/validation.py [--parts NAME ...] [--scale 1] [--minutes 60] [--shared ../shared]
    python benchmarks/validation.py --list          # the parts, and how long they take on two free cores
    python benchmarks/validation.py --minutes 0     # only write the page from the results that there are

By default, parts of many cases run a share of them, drawn by a hash of each, so that the whole takes about an hour;
`--scale 2` runs twice as many, and `--scale 20` all. Finished parts are kept in the folder and not run again; a part that
was stopped, or is asked for at a larger scale, is continued. Results of other sources (another state of sma_sim/ or
benchmarks/) are moved to a folder `old` and measured again. A part that is not measured keeps its line and its
file, which say of which commit they are. Parts that need data which are not in the repository are left out where these are
not at hand.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import sys
import time
from collections.abc import Mapping
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

from validation_parts import PARTS, Part

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / 'docs' / 'reference' / 'validation.md'
DETAILS = PAGE.with_suffix('')  # a file for each part
HEAD = """# Validation

What was measured, in one line each; the linked files have the tables and the command that made them. Errors are normalized
RMSE unless a unit stands there: RMS error divided by the standard deviation of the sensors' noise, so that 1 is the best
possible. Intervals of shares are 95 % (Wilson). Times depend on the machine and on what else runs on it; ratios from one
run do so much less.

The page and the files are written by

<!-- not run: takes an hour; it can be stopped and continued -->
```bash
python benchmarks/validation.py
```

from the parts in `benchmarks/validation_parts.py`. A new number is a new part there: a script, its subject (the section
here), its result in a line, its table. A part that is left out keeps its line and its file, which name the commit and the
day of the numbers. Parts of many cases run a share of them by default; `--scale` runs more.
"""
LINES = '| what | result | commit, day |\n| --- | --- | --- |'
FILES = """```{toctree}
:hidden:
:glob:

validation/*
```
"""


def version() -> dict[str, str]:
    """The commit, and what identifies the sources that the numbers depend on."""

    def git(*words: str) -> str:
        return subprocess.run(['git', *words], cwd=ROOT, capture_output=True, text=True, check=True).stdout.strip()

    sources = f'{git("rev-parse", "HEAD:sma_sim")} {git("rev-parse", "HEAD:benchmarks")}'
    changed = git('status', '--porcelain', '--untracked-files=no', 'sma_sim', 'benchmarks')
    return {'commit': git('rev-parse', '--short', 'HEAD') + (' with changes' if changed else ''), 'sources': sources}


class Results:
    """The folder of finished parts: a result and a stamp (commit, date, completeness) of each."""

    def __init__(self, folder: Path) -> None:
        """Results below `folder`, which is made."""
        self.folder = folder.resolve()
        self.folder.mkdir(parents=True, exist_ok=True)

    def stamp(self, part: Part) -> dict[str, Any] | None:
        """What is known about the result of a part, if there is one."""
        file = self.folder / f'{part.name}.stamp.json'
        return json.loads(file.read_text()) if file.exists() else None

    def set_stamp(self, part: Part, now: dict[str, str], scale: float, complete: bool, seconds: float) -> None:
        """Note that a part was measured."""
        before = self.stamp(part) or {}
        day = f'{datetime.now(timezone.utc):%Y-%m-%d}'
        stamp = {**now, 'complete': complete, 'date': day, 'scale': scale, 'share': part.share_at(scale)}
        stamp['seconds'] = seconds + (before.get('seconds', 0.0) if before.get('sources') == now['sources'] else 0.0)
        (self.folder / f'{part.name}.stamp.json').write_text(json.dumps(stamp, indent=2) + '\n')

    def set_aside(self, part: Part) -> None:
        """Move a result of other sources out of the way."""
        old = self.folder / 'old'
        old.mkdir(exist_ok=True)
        for file in self.folder.glob(f'{part.name}.*'):
            file.replace(old / file.name)

    def load(self, part: Part) -> Any:
        """The result of a part: an object, or a list of cases."""
        text = (self.folder / part.result_file).read_text()
        return [json.loads(line) for line in text.splitlines()] if part.result_file.endswith('.jsonl') else json.loads(text)


def run_part(part: Part, results: Results, asked: argparse.Namespace, minutes: float, now: dict[str, str]) -> None:
    """Run the script of a part for at most `minutes`, and note how that went."""
    file = results.folder / part.result_file
    words = part.words(asked.scale, shared=asked.shared, file=file, minutes=minutes, root=ROOT)
    print(f'--- {part.name}: python benchmarks/{" ".join(words)}', flush=True)
    t_start = time.monotonic()
    done = subprocess.run(
        [sys.executable, str(ROOT / 'benchmarks' / words[0]), *words[1:]],
        cwd=results.folder,
        env=os.environ | {'PYTHONPATH': str(ROOT)},
        check=False,
    )
    seconds = time.monotonic() - t_start
    if done.returncode == 0 and (results.folder / part.result_file).exists():
        results.set_stamp(part, now, asked.scale, not part.resumable or seconds < 60.0 * minutes, seconds)
    else:
        print(f'{part.name} failed with exit code {done.returncode}', file=sys.stderr)


def measure(asked: argparse.Namespace, results: Results) -> None:
    """Run the parts that are asked for and not finished, as long as there is time."""
    now, end = version(), time.monotonic() + 60.0 * asked.minutes
    for part in PARTS:
        left = (end - time.monotonic()) / 60.0
        if left <= 0.0 or (asked.parts and part.name not in asked.parts):
            continue
        if part.needs and not (asked.shared / part.needs).exists():
            print(f'{part.name} left out: {asked.shared / part.needs} is not here', file=sys.stderr)
            continue
        stamp = results.stamp(part)
        if stamp and stamp['sources'] != now['sources']:
            results.set_aside(part)
            stamp = None
        if not (stamp and stamp['complete'] and stamp['share'] >= part.share_at(asked.scale)):
            run_part(part, results, asked, left, now)


def page(results: Results, present: str) -> str:
    """The page, from the results that there are, and for other parts from the lines of the present one."""
    text, missing = (
        [HEAD, f'The machine: {os.cpu_count()} cores {platform.machine()}, Python {platform.python_version()}.\n'],
        [],
    )
    for subject in dict.fromkeys(part.subject for part in PARTS):
        lines = [LINES]
        for part in (part for part in PARTS if part.subject == subject):
            link, stamp = f'| [{part.title}](validation/{part.name}.md) |', results.stamp(part)
            kept = [line for line in present.splitlines() if line.startswith(link)]
            if stamp:
                lines.append(f'{link} {part.in_a_line(results.load(part))} | {stamp["commit"]}, {stamp["date"]} |')
            elif kept:
                lines += kept
            else:
                missing.append(part.name)
        text.append(f'## {subject}\n\n' + '\n'.join(lines) + '\n')
    if missing:
        text.append(f'## Not measured\n\nThese parts have not been measured: {", ".join(missing)}.\n')
    return '\n'.join([*text, FILES])


def details(part: Part, stamp: Mapping[str, Any], result: Any) -> str:
    """The file of a part that was measured."""
    marks = [f'commit {stamp["commit"]}', stamp['date'], f'{stamp["seconds"] / 60.0:.0f} min']
    marks += [f'{100.0 * stamp["share"]:.0f} % of its cases'] * (part.resumable and stamp['share'] < 1.0)
    marks += ['not complete'] * (not stamp['complete'])
    shown = f'`python benchmarks/{part.shown(stamp["scale"])}` ({", ".join(marks)})'
    return f'# {part.title}\n\n{part.text}\n\n{shown}\n\n{part.table(result)}\n'


def write(results: Results) -> None:
    """The page, and the files of the parts that were measured."""
    PAGE.write_text(page(results, PAGE.read_text()))
    for part in PARTS:
        stamp = results.stamp(part)
        if stamp:
            (DETAILS / f'{part.name}.md').write_text(details(part, stamp, results.load(part)))


def main() -> None:
    """Measure what is missing, write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--parts', nargs='+', choices=[part.name for part in PARTS], metavar='NAME', help='all by default')
    parser.add_argument('--scale', type=float, default=1.0, help='of the shares of cases that are run; 20: all cases')
    parser.add_argument('--minutes', type=float, default=600.0, help='nothing starts later; 0: only write the page')
    parser.add_argument('--shared', type=Path, default=ROOT.parent / 'shared', help='folder with reference/ and measured/')
    parser.add_argument('--folder', type=Path, default=ROOT / 'benchmarks' / 'results', help='of finished parts')
    parser.add_argument('--list', action='store_true', help='name the parts and how long they take')
    asked = parser.parse_args()
    if asked.list:
        for part in PARTS:
            share = part.share_at(asked.scale)
            print(
                f'{part.name:14} {part.minutes * share:5.0f} min  {part.title}' + f' ({100.0 * share:.0f} %)' * (share < 1.0)
            )
        print(f'{"together":14} {sum(part.minutes * part.share_at(asked.scale) for part in PARTS):5.0f} min')
        return
    results = Results(asked.folder)
    measure(asked, results)
    write(results)
    print(f'{PAGE} written')


if __name__ == '__main__':
    main()
