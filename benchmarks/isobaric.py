"""Isobaric tests, measured and simulated: what a diagnosis names, and how it predicts the level that was held out.

    python benchmarks/isobaric.py found.jsonl nitihf nitico            # every level of a shipped campaign held out in turn
    python benchmarks/isobaric.py found.jsonl both oriented smooth neither --count 5   # simulated alloys

Simulated alloys have the phase diagram, the smooth hardening and the stress-dependent transformation strain of Lagoudas et
al., Int. J. Plast. 32-33 (2012) 155, written apart from the equations of the package, five or seven levels, a specimen
temperature that is wrong by some 0.5 K (an offset, a difference between heating and cooling, a drift), and gauges whose zero
differs. `oriented`: the strain depends on stress; `smooth`: the transformation is gradual. What was done is a line of the
file, so that a run that was cut off goes on where it was. Reported: what was named, RMSE in % strain of fitted and held-out
levels, bare and final.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sma_sim import Dataset, read_config, read_dataset
from sma_sim.evidence.data.train_test_split import split_dataset
from sma_sim.evidence.diagnosis.diagnose import diagnose
from sma_sim.evidence.model_selection.nominal_fit import DiagnosisRequest

EXAMPLE = Path(__file__).resolve().parents[1] / 'examples' / 'real' / 'isobaric'
SHIPPED = ('nitihf', 'nitico')
ORIENTED, SMOOTH = 'stress_dependent_transformation_strain', 'smooth_transformation'
TRUTHS = {'both': {ORIENTED, SMOOTH}, 'oriented': {ORIENTED}, 'smooth': {SMOOTH}, 'neither': set[str]()}
Vector = NDArray[np.float64]


def hardening(x: Vector, first: float, last: float) -> Vector:
    """Lagoudas' smooth hardening, 0 to 1 as x does; exponents of 1 are a straight line."""
    found: Vector = 0.5 * (1.0 + x**first - (1.0 - x) ** last)
    return found


def drawn_alloy(truth: str, random: np.random.Generator) -> dict[str, Any]:
    """Transformation temperatures [K], slopes [Pa/K], moduli [Pa] and strains of one alloy."""
    smooth, oriented = SMOOTH in TRUTHS[truth], ORIENTED in TRUTHS[truth]
    M_s, width = random.uniform(270.0, 370.0), random.uniform(8.0, 25.0) if smooth else random.uniform(1.0, 3.0)
    A_s = M_s - width + random.uniform(18.0, 45.0)
    slope = random.uniform(6e6, 12e6)
    E_A = random.uniform(5e10, 8e10)
    return {
        'M_s': M_s,
        'M_f': M_s - width,
        'A_s': A_s,
        'A_f': A_s + width * random.uniform(0.7, 1.3),
        'C_M': slope,
        'C_A': slope * random.uniform(0.85, 1.15),
        'E_A': E_A,
        'E_M': E_A * random.uniform(0.35, 0.6),
        'H_sat': random.uniform(0.02, 0.055),
        'missing': random.uniform(0.5, 0.95) if oriented else 0.0,
        'k': random.uniform(5e7, 1.8e8),
        'sigma_crit': random.uniform(0.0, 3e7),
        'n': random.uniform(0.15, 0.45, 4) if smooth else np.ones(4),
        'top': random.choice([2.5e8, 3e8, 4e8]),
    }


def fraction(alloy: dict[str, Any], stress: float, T: Vector, heats: NDArray[np.bool_]) -> Vector:
    """x_M (k,) on the outer loop at temperatures (k,) [K]."""
    x = np.linspace(0.0, 1.0, 20_001)
    n = alloy['n']
    back = alloy['A_s'] + stress / alloy['C_A'] + (alloy['A_f'] - alloy['A_s']) * (1.0 - hardening(x, n[2], n[3]))
    forth = alloy['M_s'] + stress / alloy['C_M'] - (alloy['M_s'] - alloy['M_f']) * hardening(x, n[0], n[1])
    found: Vector = np.where(heats, np.interp(T, back[::-1], x[::-1]), np.interp(T, forth[::-1], x[::-1]))
    return found


def write_level(folder: Path, alloy: dict[str, Any], stress: float, random: np.random.Generator) -> None:
    """One isobaric test as a laboratory writes it."""
    shift = stress / min(alloy['C_M'], alloy['C_A'])
    low = min(alloy['M_f'], alloy['A_s']) - 25.0 + 0.6 * shift
    high = max(alloy['A_f'], alloy['M_s']) + shift + random.uniform(25.0, 45.0)
    rows = int(random.integers(300, 700))
    up = np.linspace(low, high, rows)
    T, heats = np.concatenate([up, up[-2::-1]]), np.arange(2 * rows - 1) < rows
    x = fraction(alloy, stress, T, heats)
    H = alloy['H_sat'] * (1.0 - alloy['missing'] * np.exp(-max(stress - alloy['sigma_crit'], 0.0) / alloy['k']))
    strain = stress * (1.0 / alloy['E_A'] + x * (1.0 / alloy['E_M'] - 1.0 / alloy['E_A'])) + H * x
    drift = np.interp(np.linspace(0.0, 1.0, len(T)), np.linspace(0.0, 1.0, 9), 0.5 * random.normal(size=9))
    T = T + 0.4 * random.normal() + np.where(heats, 1.0, -1.0) * 0.3 * random.normal() + drift
    strain = strain + 3e-4 * random.normal() + 1e-5 * random.normal(size=len(T))
    lines = [f'{t - 273.15:.3f},{e:.7f},{1e-6 * stress:.3f}' for t, e in zip(T, strain, strict=True)]
    name = f'{1e-6 * stress:.0f}MPa.csv'
    (folder / name).write_text('\n'.join(['temperature_C,strain,stress_MPa', *lines, '']))


def simulated(truth: str, number: int) -> Dataset:
    """The campaign of one simulated alloy, drawn by its number."""
    random = np.random.default_rng((number, *map(ord, truth)))
    alloy, levels = drawn_alloy(truth, random), 5 if number % 2 == 0 else 7
    stresses = [random.uniform(5e6, 1.5e7), *(np.linspace(0.15, 1.0, levels - 1) * alloy['top'])]
    with tempfile.TemporaryDirectory() as folder:
        for stress in stresses:
            write_level(Path(folder), alloy, float(stress), random)
        return dataset_in(Path(folder))


def dataset_in(folder: Path) -> Dataset:
    """The tests of a folder."""
    return read_dataset([folder], 'wire_under_load_at_T', 298.0, EXAMPLE / 'map.yaml')


def diagnosed(dataset: Dataset, held_out: str) -> dict[str, Any]:
    """One diagnosis with a level held out."""
    training, judging = split_dataset(dataset, [held_out])
    start, percent = time.process_time(), 100.0 * dataset.noise_std['strain']
    config = read_config(EXAMPLE / 'config.yaml')
    found = diagnose(training, config, judging, DiagnosisRequest(kinetics='hybrid', equation=False))
    bare, last = found.nominal, found.stages[-1]
    return {
        'held_out': held_out,
        'verdict': found.verdict,
        'effects': sorted(found.effects),
        'retracted': sorted(found.retracted),
        'fitted': [percent * bare.train, percent * last.train],
        'predicted': [percent * bare.held_out, percent * last.held_out],
        'cpu_seconds': time.process_time() - start,
    }


def cases(given: argparse.Namespace) -> list[tuple[dict[str, Any], Dataset, str]]:
    """What is asked for: a key, the campaign, the level to hold out; of a simulated alloy the one in the middle."""
    found = []
    for kind in given.kinds:
        if kind in SHIPPED:
            dataset = dataset_in(EXAMPLE / kind)
            found += [({'kind': kind, 'number': k}, dataset, one.name) for k, one in enumerate(dataset.recordings)]
        else:
            for number in range(given.first, given.first + given.count):
                dataset = simulated(kind, number)
                names = sorted((one.name for one in dataset.recordings), key=lambda name: float(name[:-3]))
                found.append(({'kind': kind, 'number': number}, dataset, names[len(names) // 2]))
    return found


def main() -> None:
    """Diagnose what is not in the file yet, and count."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('file', type=Path)
    parser.add_argument('kinds', nargs='+', choices=(*SHIPPED, *TRUTHS))
    parser.add_argument('--count', type=int, default=5)
    parser.add_argument('--first', type=int, default=0)
    given = parser.parse_args()
    lines = given.file.read_text().splitlines() if given.file.exists() else []
    known = {(row['kind'], row['number']): row for row in map(json.loads, lines)}
    for key, dataset, held_out in cases(given):
        if tuple(key.values()) not in known:
            row = known[key['kind'], key['number']] = key | diagnosed(dataset, held_out)
            with given.file.open('a') as file:
                file.write(json.dumps(row) + '\n')
            print(json.dumps(row), flush=True)
    for kind in given.kinds:
        print(summary(kind, [row for (name, _), row in known.items() if name == kind]))


def summary(kind: str, rows: list[dict[str, Any]]) -> str:
    """What a kind of campaign came to, in words."""
    expected = TRUTHS.get(kind, TRUTHS['both'])
    right = sum(set(row['effects']) == expected for row in rows)
    invented = sum(bool(set(row['effects']) - expected) for row in rows)
    held = np.array([row['predicted'] for row in rows])
    ratio = held[:, 0] / held[:, 1]
    return (
        f'{kind}: {len(rows)} diagnoses, {right} right, {invented} with an effect that is not there; held out '
        f'{np.median(held[:, 1]):.3f} % (median; bare {np.median(held[:, 0]):.3f} %), bare/final {ratio.min():.2f} to '
        f'{ratio.max():.2f}, fitted at most {max(row["fitted"][1] for row in rows):.3f} %'
    )


if __name__ == '__main__':
    main()
