"""How often 95 % intervals hold the truth, and the error on a run that was not fitted; parameters 5 to 15 % off.

    python benchmarks/intervals.py [--seeds 60] [--first 0] [--runs 3] [--hybrid 0] [--missing 0] [--rate 50] [--begin 0]
                                   [--json FILE]

Every seed: other parameters, commands and noise (2 um, 10 um, 0.02 deg, 0.05 N); runs of 100 s and one that is held out.
Data are made by the MAS model and fitted by it, or both by the hybrid model (--hybrid 1). With --missing 1 every robot has
an effect of which the fitted model knows nothing, by turns one of MISSING. With --begin 33.3 recordings begin there [s],
warm and in motion, of which the fit knows that alone (`in_motion`). The predicted curve: how much of the held-out
measurement lies within 1.96 times what the fit leaves in its channel. Seeds that are in intervals.jsonl already are not run
again.
"""

from __future__ import annotations

import argparse
import json
import time
from collections import defaultdict
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from cases import of
from common import random_command, report

from sma_sim import (
    Config,
    Dataset,
    FitOptions,
    Input,
    Model,
    Recording,
    calibrate,
    default_parameters,
    evaluate_held_out,
    predict,
    simulate,
)
from sma_sim.evidence.data.recording import CHANNEL_COLUMNS
from sma_sim.evidence.estimation.free_parameters import default_names
from sma_sim.evidence.estimation.held_out_prediction import nuisances_of
from sma_sim.evidence.estimation.uncertainty import GAUSS_95
from sma_sim.solver.inputs import inputs_at

NOISE = {'U_x': 2e-6, 'U_y': 1e-5, 'alpha': float(np.radians(0.02)), 'F_1': 0.05, 'F_2': 0.05}
DURATION = 100.0
MISSING = ('gravity', 'natural_convection', 'guide_friction', 'driver_lag')
FILE = Path('intervals.jsonl')


def off(random: np.random.Generator) -> float:
    """A factor that is 5 to 15 % off, either way."""
    return float(1.0 + random.choice([-1.0, 1.0]) * random.uniform(0.05, 0.15))


def true_config(seed: int, model: str) -> Config:
    """The paper's values with everything off that a fit may change; of l0, the pre-strain."""
    random, values = np.random.default_rng([seed, 1]), default_parameters()
    for name in default_names(Config(kinetics=model)):
        if name == 'wire.l0':
            strain = (values['beam.L'] / values['wire.l0'] - 1.0) * off(random)
            values['wire.l0'] = values['beam.L'] / (1.0 + strain)
        else:
            values[name] *= off(random)
    return Config(values, 'module', model)


def recorded(truth: Config, seed: int, run: int, rate: float) -> Recording:
    """One noisy recording."""
    random, source = np.random.default_rng([seed, 2, run]), random_command(1000 * seed + run)
    times = np.arange(int(rate * DURATION)) / rate
    exact = replace(truth, parameters={**truth.parameters, 'solver.rtol': 1e-7})
    seen = simulate(Model(exact), source, times)
    channels = {name: seen[CHANNEL_COLUMNS[name]] + noise * random.normal(size=len(times)) for name, noise in NOISE.items()}
    return Recording(f'run{run}', 'module', times, channels, source)


def cut(recording: Recording, begin: float) -> Recording:
    """A recording from a time [s] on, as one that does not begin at rest."""
    later, source = recording.time >= begin, recording.source
    rows, there = source.times > begin, inputs_at(source, np.array([begin]))
    values = np.vstack([[there[name][0] for name in source.columns], source.values[rows]])
    command = Input(np.append(0.0, source.times[rows] - begin), values, source.linear, source.names)
    channels = {name: values[later] for name, values in recording.channels.items()}
    return Recording(recording.name, 'module', recording.time[later] - begin, channels, command, in_motion=True)


def one_seed(seed: int, runs: int, model: str, missing: bool, rate: float, begin: float) -> dict[str, Any]:
    """Fit one dataset and compare its intervals with the truth."""
    truth = true_config(seed, model)
    if missing:
        truth = Config(truth.parameters, 'module', model, effects=MISSING[seed % len(MISSING)])
    recordings = tuple(recorded(truth, seed, run, rate) for run in range(runs + 1))
    if begin > 0.0:
        recordings = tuple(cut(recording, begin) for recording in recordings)
    t_start = time.process_time()
    found = calibrate(Dataset(recordings[:-1], NOISE), Config(), FitOptions(kinetics=model))
    seconds = time.process_time() - t_start
    out = evaluate_held_out(found.config, Dataset(recordings[-1:], NOISE), found.delay)
    assert found.uncertainty is not None
    shown = predict(found.config, recordings[-1], nuisances_of(found.delay, out)[recordings[-1].name])
    within = [
        np.abs(shown[name] - values) <= GAUSS_95 * NOISE[name] * max(1.0, found.channel_errors[name])
        for name, values in recordings[-1].channels.items()
    ]
    parameters = {
        one.name: {
            'inside': bool(one.low <= truth.parameters[one.name] <= one.high),
            'seen': one.seen,
            'std': one.std,
            'error': one.value / truth.parameters[one.name] - 1.0,
        }
        for one in found.uncertainty.intervals
    }
    return {
        'seed': seed,
        'runs': runs,
        'model': model,
        'missing': missing,
        'rate': rate,
        'begin': begin,
        'parameters': parameters,
        'held_out': out[0].error,
        'fitted': found.error,
        'curve': float(np.mean(within)),
        'cpu_seconds': seconds,
        'wall_seconds': found.seconds,
    }


def kept(file: Path) -> list[dict[str, Any]]:
    """The seeds that were run before."""
    return [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []


def table(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Coverage by parameter and pooled (of what was seen), held-out error and time."""
    inside: dict[str, list[bool]] = defaultdict(list)
    unseen: dict[str, int] = defaultdict(int)
    for row in rows:
        for name, estimate in row['parameters'].items():
            unseen[name] += not estimate['seen']
            if estimate['seen']:
                inside[name].append(estimate['inside'])
    each = {name: {'coverage': of(sum(hits), len(hits)), 'unseen': unseen[name]} for name, hits in inside.items()}
    errors = [row['held_out'] for row in rows]
    return {
        'seeds': len(rows),
        'pooled coverage': of(sum(map(sum, inside.values())), sum(map(len, inside.values()))),
        'predicted curve': float(np.mean([row['curve'] for row in rows])),
        'parameters': each,
        'held out': {'median': float(np.median(errors)), 'worst': float(np.max(errors))},
        'cpu seconds of a fit': {'median': float(np.median([row['cpu_seconds'] for row in rows]))},
    }


def measure(arguments: argparse.Namespace) -> dict[str, Any]:
    """Run the seeds that are missing, and sum up."""
    model = 'hybrid' if arguments.hybrid else 'mas'
    case = (arguments.runs, model, bool(arguments.missing), float(arguments.rate), float(arguments.begin))
    wanted = {(seed, *case) for seed in range(arguments.first, arguments.first + arguments.seeds)}
    for one in sorted(wanted - {key(row) for row in kept(FILE)}):
        row = one_seed(*one)
        with FILE.open('a') as file:
            file.write(json.dumps(row) + '\n')
        print(f'seed {row["seed"]}: held out {row["held_out"]:.3f}, {row["wall_seconds"]:.1f} s', flush=True)
    return table([row for row in kept(FILE) if key(row) in wanted])


def key(row: dict[str, Any]) -> tuple[Any, ...]:
    """What tells one fit from the others."""
    return tuple(row[name] for name in ('seed', 'runs', 'model', 'missing', 'rate', 'begin'))


if __name__ == '__main__':
    report(__doc__ or '', measure, seeds=60, first=0, runs=3, hybrid=0, missing=0, rate=50, begin=0.0)
