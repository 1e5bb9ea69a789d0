"""Recordings of a robot in its loop beside recordings with steps: `sma-sim compare` of bags, and whole diagnoses.

python benchmarks/loops.py [--seed 39000] [--turns 3] [--diagnoses 1] [--json FILE]

A robot with hidden gravity and natural convection follows three references under a PI controller at 50 Hz; the same robot
gets 10 random steps. `compare` is a process of its own that reads two bags of 100 s, with everything compiled before: the
least processor time of all turns. A diagnosis is made of three recordings with pose and forces.
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from common import report

from sma_sim import Input, module_input
from sma_sim.challenge.files import write_challenge
from sma_sim.challenge.make import Challenge, make_challenge, noisy_recording
from sma_sim.evidence.data.recording import Dataset
from sma_sim.evidence.diagnosis.diagnose import diagnose
from sma_sim.evidence.estimation.executors import one_thread_for_linear_algebra
from sma_sim.solver.fixed_rate import FixedRateRun

HIDDEN = ('gravity', 'natural_convection')
DURATION, CONTROL_RATE, STEP_RATE = 100.0, 50, 500  # [s], [1/s], [1/s]
K_P, K_I, J_MAX = 200.0, 100.0, 15.0  # [W/rad], [W/(rad s)], [W]
AMPLITUDE = np.radians(6.0)
REFERENCES: dict[str, Callable[[float], float]] = {
    'steps': lambda t: (0.7, -0.5, 1.0, -1.0, 0.2)[int(t // 20.0) % 5],
    'sine': lambda t: float(np.sin(2.0 * np.pi * t / 20.0)),
    'ramps': lambda t: 4.0 * abs(t / 50.0 % 1.0 - 0.5) - 1.0,
}


def commanded(made: Challenge, reference: Callable[[float], float], random: np.random.Generator) -> Input:
    """The power that a PI controller of the angle sets from a noisy sensor; it does not wind up at its limits."""
    T_E, noise = made.nominal.parameters['environment.T_E'], made.dataset.noise_std['alpha']
    run, count, integral = FixedRateRun(made.robot.model, STEP_RATE, np.array([0.0, T_E])), int(DURATION * CONTROL_RATE), 0.0
    J_eq = np.zeros(count + 1)
    for k in range(count):
        shown = run.shown('alpha') + noise * random.standard_normal()
        error = AMPLITUDE * reference(k / CONTROL_RATE) - shown
        wanted = K_P * error + integral
        J_eq[k] = min(max(wanted, -J_MAX), J_MAX)
        if J_eq[k] == wanted:
            integral += K_I * error / CONTROL_RATE
        run.step(np.array([J_eq[k], T_E]), STEP_RATE // CONTROL_RATE)
    J_eq[-1] = J_eq[-2]
    return module_input((np.arange(count + 1) / CONTROL_RATE).tolist(), J_eq.tolist(), T_E)


def in_its_loop(made: Challenge, seed: int) -> Challenge:
    """The same robot under the controller."""
    random, recordings = np.random.default_rng(seed), []
    for name, reference in REFERENCES.items():
        command = commanded(made, reference, random)
        time_, channels = made.robot.measure(command, float(CONTROL_RATE))
        recordings.append(noisy_recording(name, command, time_, channels, made.dataset.noise_std, random))
    return replace(made, dataset=Dataset(tuple(recordings), made.dataset.noise_std))


def compared(made: Challenge, turns: int) -> dict[str, float]:
    """Seconds of `sma-sim compare` of the first two recordings, as bags."""
    two = replace(made, dataset=replace(made.dataset, recordings=made.dataset.recordings[:2]))
    processor, wall = [], []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / 'bags'
        write_challenge(two, folder)
        words = [sys.executable, '-m', 'sma_sim.cli.main', 'compare', str(folder), '--config', str(folder / 'nominal.yaml')]
        for _ in range(turns + 1):  # the first compiles
            before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
            subprocess.run(words, check=True, stdout=subprocess.DEVNULL)
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
            wall.append(time.perf_counter() - begin)
            processor.append(after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime)
    return {'processor_s': min(processor[1:]), 'wall_s': min(wall[1:])}


def diagnosed(made: Challenge) -> dict[str, Any]:
    """Seconds of a diagnosis, and what it finds."""
    begin, since = time.process_time(), time.perf_counter()
    found = diagnose(made.dataset, made.nominal)
    seconds = {'processor_s': time.process_time() - begin, 'wall_s': time.perf_counter() - since}
    return {**seconds, 'found': ' + '.join(found.effects), 'verdict': found.verdict}


def measure(arguments: argparse.Namespace) -> dict[str, Any]:
    """All numbers."""
    steps = make_challenge(arguments.seed, 2, None, HIDDEN, True)
    loop = in_its_loop(steps, arguments.seed)
    rows = {name: compared(made, arguments.turns) for name, made in (('closed loop', loop), ('10 steps', steps))}
    result: dict[str, Any] = {'sma-sim compare of two bags': rows}
    if not arguments.diagnoses:
        return result
    with one_thread_for_linear_algebra():
        diagnose(steps.dataset, steps.nominal)  # compiles
        found = {name: diagnosed(made) for name, made in (('closed loop', loop), ('10 steps', steps))}
    ratio = found['closed loop']['processor_s'] / found['10 steps']['processor_s']
    return result | {'diagnosis of three recordings': found, 'closed loop over steps': {'processor time': ratio}}


if __name__ == '__main__':
    report(__doc__ or '', measure, seed=39000, turns=3, diagnoses=1)
