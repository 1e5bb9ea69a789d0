"""Simulated benches with realistic nuisances: what a fit or a diagnosis of their recordings says, beside the truth.

    python benchmarks/benches.py [--only slider ...] [--truths none thermal_expansion ...] [--count 34] [--first 0]
    python benchmarks/benches.py --diagnose --only slider --truths none

Each bench is drawn by its number: parameters about those of examples/real, a scale of power, a delay, a zero and a room
temperature for each recording, a resolution and noise; by kind a load cell that drifts, an infrared sensor that lags, grips
with a toe, a measured resistance. A map declares what a person would declare. A truth is none, or effects joined by +, such
as thermal_expansion+polycrystal. The nominal model is fitted, and the table has the parts of its 95 % intervals that hold
the truth, and of the samples of the recording that was held out that lie within 1.96 times what the fit leaves in their
channel; with --diagnose it has the verdicts, and how often effects were named that are not in the truth. Finished cases are
kept in --file, so that a run can be continued.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import Executor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from cases import add_options, drawn, of, solved
from numpy.typing import NDArray

from sma_sim import (
    Config,
    Dataset,
    FitOptions,
    Input,
    Model,
    calibrate,
    evaluate_held_out,
    predict,
    read_config,
    read_dataset,
    simulate,
)
from sma_sim.evidence.data.repeatability import repeatability
from sma_sim.evidence.data.train_test_split import split_dataset
from sma_sim.evidence.diagnosis.diagnose import diagnose
from sma_sim.evidence.estimation.held_out_prediction import nuisances_of
from sma_sim.evidence.estimation.uncertainty import GAUSS_95
from sma_sim.evidence.model_selection.nominal_fit import DiagnosisRequest

EXAMPLES = Path(__file__).resolve().parents[1] / 'examples' / 'real'
SPREAD = 0.15  # of the true parameters about the nominal ones, in the logarithm
FREE = {
    'slider': ('wire.eps_T', 'wire.sigma_T', 'wire.c_V', 'wire.lambda', 'wire.dsigma', 'slider.k', 'slider.b'),
    'blocked': ('wire.sigma_T', 'wire.c_V', 'wire.lambda', 'wire.dsigma', 'wire.sigma_MW0'),
    'tensile': (
        'wire.E_A',
        'wire.E_M',
        'wire.eps_T',
        'wire.sigma_T',
        'wire.dsigma',
        'wire.sigma_MW0',
        'wire.resistivity_A',
        'wire.resistivity_M',
    ),
}
CONFIGS = {'slider': EXAMPLES / 'slider' / 'config.yaml', 'blocked': EXAMPLES / 'blocked_force' / 'config.yaml'}
TENSILE = (
    'system=wire',
    'bench.temperature=prescribed',
    'initial.x_M_1=0',
    'wire.n=1',
    'wire.E_A=4e10',
    'wire.E_M=2.5e10',
    'wire.eps_T=0.045',
    'wire.sigma_T=6e6',
    'wire.dsigma=1e8',
    'wire.sigma_MW0=2.5e8',
    'wire.T0=320',
)
TEMPERATURES = (325.0, 345.0, 335.0, 355.0)  # [K] of tensile tests
EFFECTS = {'thermal_expansion': 'thermal_expansion:a=1.1e-5,T_ref=298', 'polycrystal': 'polycrystal:spread=6e7'}
MAPS = {
    'slider': (
        'system: slider\nJ_W: {{column: power}}\nposition_m: {{column: position, zero_std: 1.0e-4{position}}}\n'
        'nuisances: {{power_scale: {{k: 0.15}}}}\n'
    ),
    'blocked': (
        'system: wire\nJ_W: {{column: power}}\nstrain: {{value: 0.03}}\n'
        'T_K: {{column: T, zero_std: 1.0{T}}}\nstress_Pa: {{column: stress, zero_std: 1.0e+5, drift_std: 1.0e+5{stress}}}\n'
        'nuisances: {{power_scale: {{k: 0.15}}, thermometer_lag: {{tau: 0.5}}}}\n'
    ),
    'tensile': (
        'system: wire\nT_K: {{column: T}}\nR_ohm: {{column: R{R}}}\n'
        'stress_Pa: {{column: stress, zero_std: 3.0e+6, drift_std: 3.0e+6{stress}}}\n'
        'nuisances: {{grip_toe: {{toe: 1.0e-3, sigma_t: 5.0e+6}}}}\n'
    ),
}
CHANNELS = ('position', 'T', 'stress', 'R')
INDEPENDENT_AFTER = 1.0  # [s]
Vector = NDArray[np.float64]
Row = dict[str, Any]


def bench(kind: str, effects: list[str]) -> Config:
    """The nominal bench of a kind, with effects."""
    words = TENSILE if kind == 'tensile' else ()
    return read_config(CONFIGS.get(kind), words, effects=[EFFECTS.get(effect, effect) for effect in effects])


def truth(kind: str, effects: list[str], random: np.random.Generator) -> Config:
    """One bench of a kind."""
    toe = [f'grip_toe:toe={abs(random.normal()) * 1e-3},sigma_t={random.uniform(2e6, 1e7)}'] if kind == 'tensile' else []
    config = bench(kind, [*effects, *toe])
    factors = {name: float(np.exp(SPREAD * random.normal())) for name in FREE[kind]}
    return replace(config, parameters={n: v * factors.get(n, 1.0) for n, v in config.parameters.items()})


def commands(kind: str, random: np.random.Generator) -> list[tuple[list[float], list[float]]]:
    """Times [s] and powers [W] of four recordings; the last one repeats the first."""
    found = []
    for k in range(3):
        if kind == 'slider':
            top, on = random.uniform(11.0, 15.0), random.uniform(12.0, 20.0)
            rise = [top * part / 8.0 for part in range(8)] if k == 1 else []
            times = [5.0 + 1.5 * part for part in range(len(rise))] + [5.0 + 1.5 * len(rise)]
            found.append(([0.0, *times, times[-1] + on], [0.0, *rise, top, 0.0]))
        else:
            levels = random.uniform(0.1, 0.7, 5)
            found.append(([0.0, *(10.0 + 25.0 * np.arange(6))], [0.0, *levels, 0.0]))
    return [*found, found[0]]


def write_pulls(config: Config, folder: Path, random: np.random.Generator) -> list[Path]:
    """Isothermal tensile tests as a machine shows them: an inner loop inside a full one, at three temperatures."""
    files, t = [], np.arange(0.0, 300.0, 0.5)
    for k, T in enumerate(TEMPERATURES):
        strain = np.interp(t, [0.0, 100.0, 140.0, 180.0, 300.0], [0.0, random.uniform(0.03, 0.05), 0.02, 0.035, 0.0])
        values = np.column_stack([strain, np.full(len(t), T), np.zeros(len(t)), np.full(len(t), 298.0)])
        source = Input(t, values, (True, True, False, False), config.structure.input_columns)
        run, drift = simulate(Model(config), source, t), 3e6 * random.normal() * (t / t[-1] - 0.5)
        stress = run['stress_Pa'] + 3e6 * random.normal() + drift + 2e5 * random.normal(size=len(t))
        resistance = run['R_ohm'] + 3e-3 * random.normal(size=len(t))
        rows = zip(t, strain, values[:, 1], stress, resistance, strict=True)
        text = ['time_s,strain,T,stress,R', *(','.join(f'{value:.8g}' for value in row) for row in rows)]
        files.append(folder / f'run{k}.csv')
        files[-1].write_text('\n'.join(text) + '\n')
    return files


def write_runs(kind: str, config: Config, folder: Path, random: np.random.Generator) -> list[Path]:
    """The recordings of a bench as it shows them."""
    if kind == 'tensile':
        return write_pulls(config, folder, random)
    scale, delay, files = float(np.exp(0.1 * random.normal())), random.uniform(0.0, 0.1), []
    for k, (times, powers) in enumerate(commands(kind, random)):
        end, room = times[-1] + 25.0, 298.0 + 0.5 * random.normal()
        t, power = np.append(times, end), scale * np.append(powers, powers[-1])
        columns = (
            [power, np.full(len(t), room)] if kind == 'slider' else [np.full(len(t), 0.03), power, np.full(len(t), room)]
        )
        linear = (False, False) if kind == 'slider' else (True, False, False)
        samples = np.arange(0.0, end, 0.05)
        late = np.append(t[0], t[1:] + delay)
        run = simulate(Model(config), Input(late, np.column_stack(columns), linear), samples)
        rows = np.searchsorted(t, samples, side='right') - 1
        shown = measured(kind, run, random, len(samples))
        text = ['time_s,power,' + ','.join(shown)]
        text += [
            ','.join(f'{value:.8g}' for value in row)
            for row in zip(samples, power[rows] / scale, *shown.values(), strict=True)
        ]
        files.append(folder / f'run{k}.csv')
        files[-1].write_text('\n'.join(text) + '\n')
    return files


def measured(kind: str, run: Any, random: np.random.Generator, count: int) -> dict[str, Vector]:
    """What the sensors of a bench show."""
    if kind == 'slider':
        position = run['position_m'] + 1e-4 * random.normal() + 1e-5 * random.normal(size=count)
        return {'position': 2.2e-5 * np.round(position / 2.2e-5)}
    heat, T = 1.0 - np.exp(-0.05 / 0.4), run['T_K'].copy()
    for k in range(1, count):  # an infrared sensor follows late
        T[k] = T[k - 1] + heat * (T[k] - T[k - 1])
    drift = 1e5 * random.normal() * np.linspace(-0.5, 0.5, count)
    return {
        'T': T + random.normal() + 0.1 * random.normal(size=count),
        'stress': run['stress_Pa'] + 5e4 * random.normal() + drift + 7e3 * random.normal(size=count),
    }


def dataset_of(kind: str, files: list[Path], system: str) -> Dataset:
    """The recordings of a bench with the floor that its repeats show."""
    path = files[0].with_name('map.yaml')
    path.write_text(MAPS[kind].format(**dict.fromkeys(CHANNELS, '')))
    plain = read_dataset(files, system, 298.0, path)
    floors = {found.channel: f', floor: {found.floor:.3e}' for found in repeatability(plain.recordings, plain.noise_std)}
    lasting = f'independent_after: {INDEPENDENT_AFTER}\n'
    path.write_text(MAPS[kind].format(**dict.fromkeys(CHANNELS, '') | floors) + lasting)
    return read_dataset(files, system, 298.0, path)


def bench_of(kind: str, effects: list[str], number: int) -> tuple[Config, Config, Dataset, Dataset]:
    """One bench: the nominal one, what it is, and its recordings, of which the third is held out."""
    random = np.random.default_rng((number, *map(ord, kind)))
    nominal, real = bench(kind, []), truth(kind, effects, random)
    with tempfile.TemporaryDirectory() as folder:
        files = write_runs(kind, real, Path(folder), random)
        dataset = dataset_of(kind, files, nominal.structure.name)
    training, held_out = split_dataset(dataset, ['run2'])
    assert held_out is not None
    return nominal, real, training, held_out


def fitted(kind: str, effects: list[str], number: int, pool: Executor | None = None) -> Row:
    """One bench drawn and fitted: which intervals hold the truth, and how much of the held-out recording is predicted."""
    nominal, real, training, held_out = bench_of(kind, effects, number)
    start = time.process_time()
    found = calibrate(training, nominal, FitOptions(kinetics='hybrid'), executor=pool)
    seconds = time.process_time() - start
    assert found.uncertainty is not None
    true = dict(real.parameters)
    apart = found.config.parameters['wire.T0'] - true['wire.T0']  # curves may start a fit from another reference
    true['wire.sigma_MW0'] += true['wire.sigma_T'] * apart
    held = evaluate_held_out(found.config, held_out, found.delay)
    (recording,) = held_out.recordings
    shown = predict(found.config, recording, nuisances_of(found.delay, held)[recording.name])
    (fit,) = held
    elapsed = (recording.time - recording.time[0]) / np.ptp(recording.time) - 0.5
    within = [
        np.abs(values - shown[name] - fit.zeros.get(name, 0.0) - fit.drifts.get(name, 0.0) * elapsed)[np.isfinite(values)]
        <= GAUSS_95 * training.noise_std[name] * max(1.0, found.channel_errors[name])
        for name, values in recording.channels.items()
    ]
    return {
        'fitted': found.error,
        'held_out': fit.error,
        'inside': {
            one.name: bool(one.low <= true[one.name] <= one.high)
            for one in found.uncertainty.intervals
            if one.seen and one.name in true
        },
        'curve': float(np.mean(np.concatenate(within))),
        'cpu_seconds': seconds,
    }


def diagnosed(kind: str, effects: list[str], number: int, pool: Executor | None = None) -> Row:
    """One bench drawn and diagnosed."""
    start = time.process_time()
    nominal, _, training, held_out = bench_of(kind, effects, number)
    found = diagnose(training, nominal, held_out, DiagnosisRequest(kinetics='hybrid', equation=False), executor=pool)
    last, first = found.stages[-1], found.nominal
    return {
        'verdict': found.verdict,
        'effects': list(found.effects),
        'nominal': [first.train, first.held_out],
        'last': [last.train, last.held_out],
        'cpu_seconds': time.process_time() - start,
    }


def solve(job: str, kind: str, truth: str, number: int, pool: Executor) -> Row:
    """Fit or diagnose one bench."""
    return (fitted if job == 'fit' else diagnosed)(kind, effects_of(truth), number, pool)


def effects_of(truth: str) -> list[str]:
    """The effects of a truth."""
    return [] if truth == 'none' else truth.split('+')


def line_of(row: Row) -> str:
    """What one bench came to, as a row of a table."""
    job, kind, truth, number = row['case']
    if job == 'fit':
        hits = row['inside'].values()
        said = f'{sum(hits)} of {len(hits)} | {row["curve"]:.3f} | {row["fitted"]:.3g} | {row["held_out"]:.3g}'
    else:
        said = f'{row["verdict"]} | {", ".join(row["effects"])} | {row["last"][0]:.3g} | {row["last"][1]:.3g}'
    return f'| {kind} | {truth} | {number} | {said} |'


def table(results: list[Row]) -> Iterator[str]:
    """Coverage, or verdicts, by kind and truth."""
    known = [row for row in results if 'failed' not in row]
    groups = sorted({tuple(row['case'][:3]) for row in known})
    fits = [group for group in groups if group[0] == 'fit']
    if fits:
        right = [row for row in known if row['case'][0] == 'fit' and row['case'][2] == 'none']
        inside = [hit for row in right for hit in row['inside'].values()]
        yield f'95 % intervals that hold where nothing is missing: {of(sum(inside), len(inside))}'
        other = [row['curve'] for row in known if row['case'][0] == 'fit' and row['case'][2] != 'none']
        if other:
            yield ''
            yield f'held-out samples within their 95 % where something is missing: {np.mean(other):.1%}'
        yield ''
        yield '| bench | missing | benches | intervals that hold | curve within, mean | least | error, fitted | held out |'
        yield '|---|---|---|---|---|---|---|---|'
    for group in fits:
        rows = [row for row in known if tuple(row['case'][:3]) == group]
        inside = [hit for row in rows for hit in row['inside'].values()]
        curve = [row['curve'] for row in rows]
        yield (
            f'| {group[1]} | {group[2]} | {len(rows)} | {of(sum(inside), len(inside))} | {np.mean(curve):.1%} '
            f'| {min(curve):.1%} | {np.median([row["fitted"] for row in rows]):.3g} '
            f'| {np.median([row["held_out"] for row in rows]):.3g} |'
        )
    diagnoses = [group for group in groups if group[0] != 'fit']
    if diagnoses:
        yield ''
        yield '| bench | missing | benches | verdicts | with an effect that is not there | right |'
        yield '|---|---|---|---|---|---|'
    for group in diagnoses:
        rows = [row for row in known if tuple(row['case'][:3]) == group]
        true = set(effects_of(group[2]))
        invented = sum(bool(set(row['effects']) - true) for row in rows)
        found = sum(set(row['effects']) == true for row in rows)
        verdicts = ', '.join(f'{name} {count}' for name, count in Counter(row['verdict'] for row in rows).items())
        yield f'| {group[1]} | {group[2]} | {len(rows)} | {verdicts} | {invented} | {found} |'


def main() -> None:
    """Run the cases that are not done, print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--only', nargs='*', choices=tuple(FREE), default=tuple(FREE), metavar='KIND')
    parser.add_argument('--truths', nargs='*', default=('none', *EFFECTS), metavar='EFFECTS')
    parser.add_argument('--count', type=int, default=34)
    parser.add_argument('--first', type=int, default=0)
    parser.add_argument('--diagnose', action='store_true', help='diagnose, in place of a fit of the nominal model')
    add_options(parser, 'benches.jsonl', 60.0)
    asked = parser.parse_args()
    job, numbers = 'diagnosis' if asked.diagnose else 'fit', range(asked.first, asked.first + asked.count)
    cases = [(job, kind, truth, number) for number in numbers for truth in asked.truths for kind in asked.only]
    print(*table(solved(drawn(cases, asked.share), solve, asked, line_of)), sep='\n')


if __name__ == '__main__':
    main()
