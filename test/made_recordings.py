"""A recording made up for the tests of the readers: smooth, with steps of the command, noise and the contract's columns."""

import numpy as np

RATE = 50.0
NOISE = {'U_x_m': 2e-6, 'U_y_m': 1e-5, 'alpha_rad': 3.5e-4, 'F_1_N': 0.05, 'F_2_N': 0.05, 'T_1_K': 0.1, 'T_2_K': 0.1}


def module_columns(rows=600, seed=0, noise=True):
    """Columns of a module, (rows,) each: what it measures follows a stepping command with a time constant of 0.8 s."""
    random = np.random.default_rng(seed)
    time = np.arange(rows) / RATE
    command = 8.0 * np.sign(np.sin(0.9 * time + 0.4)) * (time > 1.0)
    slow, state = np.empty(rows), 0.0
    for k in range(rows):
        slow[k] = state
        state += (command[k] / 8.0 - state) / (0.8 * RATE)
    columns = {
        'time_s': time,
        'J_eq_W': command,
        'T_E_K': np.full(rows, 298.0),
        'U_x_m': -5e-5 - 6e-5 * slow**2,
        'U_y_m': 2.4e-3 * slow,
        'alpha_rad': 0.08 * slow,
        'F_1_N': 15.0 + 9.0 * slow,
        'F_2_N': 15.0 - 8.0 * slow,
        'T_1_K': 305.0 + 30.0 * np.maximum(slow, 0.0),
        'T_2_K': 305.0 + 30.0 * np.maximum(-slow, 0.0),
    }
    if noise:
        for name, std in NOISE.items():
            columns[name] = columns[name] + std * random.normal(size=rows)
    return columns


def cells_of(columns):
    """Header and rows of text; what is not a number becomes an empty cell."""
    table = np.column_stack(list(columns.values()))
    return list(columns), [['' if np.isnan(value) else f'{value:.10g}' for value in row] for row in table]


def text_of(header, rows, separator=',', end='\n'):
    """The text of a CSV file."""
    return ''.join(separator.join(row) + end for row in [header, *rows])


def write_recording(path, columns):
    """Write columns as CSV."""
    path.write_text(text_of(*cells_of(columns)))
    return path
