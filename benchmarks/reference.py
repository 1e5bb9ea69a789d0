"""The model beside trajectories of an independent implementation: largest differences.

    python benchmarks/reference.py [--folder ../shared/reference] [--json FILE]

The folder holds module_CASE_KINETICS.csv with module_CASE_input.csv, and wire_CASE_hybrid.csv with wire_CASE_input.csv.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np
from common import show

from sma_sim import Config, Input, Model, default_parameters, simulate

START = {'initial.x_M_1': 0.561235873, 'initial.x_M_2': 0.561235873}  # of the reference trajectories


def table(file: Path) -> Any:
    """Columns of a CSV file by name."""
    return np.genfromtxt(file, delimiter=',', names=True)


def module_case(folder: Path, case: str, kind: str) -> dict[str, float]:
    """Largest differences of one run of the module."""
    command, expected = table(folder / f'module_{case}_input.csv'), table(folder / f'module_{case}_{kind}.csv')
    values = np.column_stack([command['J_eq_W'], np.full(len(command), 298.0)])
    model = Model(Config(default_parameters() | START, 'module', kind))
    run = simulate(model, Input(command['time_s'], values, (False, False)), expected['time_s'])
    largest = {
        name: float(np.abs(run[name] - expected[name]).max()) for name in ('alpha_rad', 'U_x_m', 'U_y_m', 'T_1_K', 'T_2_K')
    }
    return {
        'alpha [deg]': float(np.degrees(largest['alpha_rad'])),
        'U_x [um]': 1e6 * largest['U_x_m'],
        'U_y [um]': 1e6 * largest['U_y_m'],
        'T [K]': max(largest['T_1_K'], largest['T_2_K']),
    }


def wire_case(folder: Path, case: str) -> dict[str, float]:
    """Differences of the stress of one wire."""
    command, expected = table(folder / f'wire_{case}_input.csv'), table(folder / f'wire_{case}_hybrid.csv')
    values = np.column_stack([command['strain'], command['J_W'], command['T_E_K']])
    run = simulate(Model(Config(system='wire')), Input(command['time_s'], values, (True, False, False)), expected['time_s'])
    error = 1e-6 * (run['stress_Pa'] - expected['stress_Pa'][: len(run.time)])
    return {'stress, RMS [MPa]': float(np.sqrt(np.mean(error**2))), 'stress, largest [MPa]': float(np.abs(error).max())}


def measure(folder: Path) -> dict[str, Any]:
    """All tables."""
    modules = {
        f'{case}, {kind}': module_case(folder, case, kind)
        for case in ('steps', 'random_a', 'random_b')
        for kind in ('hybrid', 'mas')
    }
    wires = {case: wire_case(folder, case) for case in ('slow', 'fast_selfheating', 'powered')}
    return {'module, largest difference': modules, 'wire, hybrid': wires}


if __name__ == '__main__':
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--folder', type=Path, default=Path('../shared/reference'))
    parser.add_argument('--json', type=Path)
    asked = parser.parse_args()
    result = measure(asked.folder)
    show(result)
    if asked.json:
        asked.json.write_text(json.dumps(result, indent=2) + '\n')
