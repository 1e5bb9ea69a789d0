"""Where the time of a diagnosis goes: processor and wall seconds by stage, for robots from easy to hard.

    python benchmarks/diagnosis_time.py [--seed 481] [--json FILE]

A stage lasts from the line of progress that begins it to the next one. The code is compiled before. For an idle machine.
"""

from __future__ import annotations

import argparse
import time
from collections import defaultdict
from typing import Any

from common import report
from other_form_truths import FORMS

from sma_sim.challenge.make import Challenge, RecordingPlan, challenge_with, make_challenge
from sma_sim.evidence.diagnosis.diagnose import diagnose
from sma_sim.evidence.estimation.executors import one_thread_for_linear_algebra

STAGES = {  # by what the line of progress contains, the first that is there
    'fitting the hybrid': 'nominal fits',
    'fitting the mas': 'nominal fits',
    'may lack': 'proposals',
    'terms': 'terms of equations',
    'in place of': 'exchanges',
    'held-out runs': 'held-out runs',
    'all runs': 'held-out runs',
    'the last fit': 'last fit, intervals',
    'fitting': 'fits of proposals',
}
LISTED, TWO, ONE_WIRE, EQUATION = 'gravity', ('guide_friction', 'gravity'), 'wire_1_friction', 'curved_slopes'
MANY = RecordingPlan(runs=30)


def robots(seed: int) -> dict[str, Challenge]:
    """Recordings with forces, by what is hidden: nothing, what is listed, its variant, and what asks for an equation."""
    return {
        'nothing': make_challenge(seed, 0, None, (), True),
        LISTED: make_challenge(seed, 1, None, (LISTED,), True),
        f'{LISTED}, {MANY.runs} runs': make_challenge(seed, 1, None, (LISTED,), True, MANY),
        ' + '.join(TWO): make_challenge(seed, 2, None, TWO, True),
        ONE_WIRE: challenge_with((FORMS[ONE_WIRE].truth,), seed, True),
        EQUATION: challenge_with((FORMS[EQUATION].truth,), seed, True),
    }


class Stopwatch:
    """Sums up wall and processor seconds by stage, as lines of progress arrive."""

    def __init__(self) -> None:
        """Starts now."""
        self.wall, self.processor = defaultdict[str, float](float), defaultdict[str, float](float)
        self._stage, self._since = next(iter(STAGES.values())), (time.perf_counter(), time.process_time())

    def __call__(self, line: str) -> None:
        """The stage that a line of progress begins; one that begins none belongs to the stage it is in."""
        now = time.perf_counter(), time.process_time()
        self.wall[self._stage] += now[0] - self._since[0]
        self.processor[self._stage] += now[1] - self._since[1]
        stages = [stage for words, stage in STAGES.items() if words in line]
        self._stage, self._since = (stages or [self._stage])[0], now


def measure(arguments: argparse.Namespace) -> dict[str, Any]:
    """Both times by stage, of every robot."""
    made, verdicts = robots(arguments.seed), dict[str, str]()
    wall, processor = defaultdict[str, dict[str, Any]](dict), defaultdict[str, dict[str, Any]](dict)
    with one_thread_for_linear_algebra():
        first = next(iter(made.values()))
        diagnose(first.dataset, first.nominal)  # compiles
        for name, challenge in made.items():
            watch = Stopwatch()
            verdicts[name] = diagnose(challenge.dataset, challenge.nominal, on_progress=watch).verdict
            watch('')
            for table, spent in ((wall, watch.wall), (processor, watch.processor)):
                table['all'][name] = sum(spent.values())
                for stage, seconds in spent.items():
                    table[stage][name] = seconds
    return {'verdicts': verdicts, 'wall [s]': dict(wall), 'processor [s]': dict(processor)}


if __name__ == '__main__':
    report(__doc__ or '', measure, seed=481)
