"""Are the p-values of a diagnosis what they say? Screening of robots that lack nothing.

    python benchmarks/pvalues.py [--cases 60] [--minutes 60] [--at-once 2] [--figure docs/figures/pvalues.png]

Each case is a robot with other parameters, MAS kinetics and noise, but no hidden effect (sma_sim/challenge): two runs of
100 s at 10 Hz, which is what a diagnosis of 50 Hz thins its samples to; every other case with forces. The nominal model
(MAS, which a diagnosis of such robots chooses) is fitted, all effects are screened, and the smallest family p-value is
kept. Over many cases it should be uniform. Finished cases are kept in --file, so that a run can be continued; table and
figure are of all in it.
"""

from __future__ import annotations

import argparse
from concurrent.futures import Executor
from dataclasses import replace
from pathlib import Path
from threading import Event
from typing import Any

import numpy as np
from cases import add_options, drawn, solved
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.stats import kstest, kstwo

from sma_sim.challenge.make import RecordingPlan, make_challenge
from sma_sim.evidence.estimation.calibrate import multistart_search
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.model_selection.candidates import candidates_for
from sma_sim.evidence.model_selection.nominal_fit import DiagnosisRequest
from sma_sim.evidence.model_selection.score_tests import screen
from sma_sim.report.palette import BLUE, GREY
from sma_sim.report.style import plain_axes, save, sized_figure

FIRST_SEED, RATE, TRAINING = 2000, 10.0, 2
LEVELS = (0.01, 0.05, 0.1, 0.25, 0.5)


def solve(number: int, pool: Executor) -> dict[str, Any]:
    """The smallest family p-value of one robot that lacks nothing, and which effect has it."""
    forces = number % 2 == 0
    made = make_challenge(FIRST_SEED + number, 0, forces=forces, plan=RecordingPlan(rate=RATE))
    training = replace(made.dataset, recordings=made.dataset.recordings[:TRAINING])
    config = replace(made.nominal, kinetics='mas')
    nominal = multistart_search(training, config, DiagnosisRequest().options, SearchContext(pool, Event()))
    best = screen(nominal.problem, nominal.z, candidates_for(config), pool)[0]
    return {
        'forces': forces, 'error': nominal.error, 'p': best.family_p,
        'effect': best.candidate.name, 'gain': best.gain,
    }  # fmt: skip


def table(rows: list[dict[str, Any]]) -> list[str]:
    """How many cases lie below each level, and whether all could be uniform."""
    seen, unseen = ([case for case in rows if case['forces'] is forces] for forces in (True, False))
    groups = {'all': rows, 'forces': seen, 'pose': unseen}
    lines = [f'{"":8}{"cases":>6}' + ''.join(f'{f"p <= {level:g}":>11}' for level in LEVELS) + f'{"uniform? p":>12}']
    for name, part in groups.items():
        if part:
            p = np.array([case['p'] for case in part])
            below = ''.join(f'{np.mean(p <= level):>11.3f}' for level in LEVELS)
            lines.append(f'{name:8}{len(p):>6}{below}{kstest(p, "uniform").pvalue:>12.3f}')
    return lines


def draw(p: NDArray[np.float64]) -> Figure:
    """Share of the cases at or below p against p, and the band that 95 % of uniform samples stay within."""
    figure = sized_figure(5.2, 4.6)
    axis = figure.subplots()
    plain_axes(axis)
    straight, reach = np.linspace(0.0, 1.0, 101), float(kstwo.ppf(0.95, len(p)))
    axis.fill_between(
        straight, np.clip(straight - reach, 0.0, 1.0), np.clip(straight + reach, 0.0, 1.0), color=GREY, alpha=0.25,
        lw=0, label='95 % of uniform samples',
    )  # fmt: skip
    axis.plot(straight, straight, color=GREY, ls=':', label='uniform')
    share = [*np.arange(len(p) + 1) / len(p), 1.0]
    axis.step([0.0, *np.sort(p), 1.0], share, where='post', color=BLUE, label=f'{len(p)} robots that lack nothing')
    axis.set(xlim=(0.0, 1.0), ylim=(0.0, 1.0), xlabel='family p-value of the best effect', ylabel='share of robots')
    axis.legend(frameon=False, loc='upper left')
    return figure


def main() -> None:
    """Run the cases that are missing, as long as there is time; print the table, draw the figure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--cases', type=int, default=60)
    add_options(parser, 'pvalues.jsonl', 60.0)
    parser.add_argument('--figure', type=Path)
    asked = parser.parse_args()
    done = solved(drawn([(number,) for number in range(asked.cases)], asked.share), solve, asked, str)
    print(*table(done), sep='\n')
    if asked.figure and done:
        save(draw(np.array([case['p'] for case in done])), asked.figure)


if __name__ == '__main__':
    main()
