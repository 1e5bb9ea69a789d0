"""Draw a measured level that was held out beside the bare model and beside the model with what it lacked.

    python docs/make_measured_wire.py bare.yaml both.yaml

The parameter files are those that docs/tutorials/a-measured-wire.md writes; the picture is docs/figures/measured_wire.png.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np

from sma_sim import read_config, read_dataset
from sma_sim.evidence.data.train_test_split import split_dataset
from sma_sim.evidence.residual_analysis.compare import ComparedRun, compare
from sma_sim.report.palette import BLUE, GREY, ORANGE
from sma_sim.report.style import plain_axes, save, sized_figure

ROOT = Path(__file__).resolve().parents[1]
EXAMPLE = ROOT / 'examples' / 'real' / 'isobaric'
PICTURE = ROOT / 'docs' / 'figures' / 'measured_wire.png'
HELD_OUT = '200MPa'


def main() -> None:
    """Compare both models with the campaign and draw it."""
    dataset = read_dataset([EXAMPLE / 'nitihf'], 'wire_under_load_at_T', 298.0, EXAMPLE / 'map.yaml')
    runs = [compare(dataset, read_config(Path(file))).runs for file in sys.argv[1:3]]
    figure = sized_figure(9.0, 3.6)
    left, right = figure.subplots(1, 2, sharey=True)
    for axis, compared, words in ((left, runs[0], 'bare model'), (right, runs[1], 'with both effects')):
        for run in compared:
            draw(axis, run)
        (held,) = (run for run in compared if run.name == HELD_OUT)
        error = 100.0 * float(np.sqrt(np.nanmean(held.residual('strain') ** 2)))
        axis.set_title(f'{words}: {error:.2f} % at the held-out level', fontsize=10)
        axis.set_xlabel('temperature [deg C]')
        plain_axes(axis)
    left.set_ylabel('strain [%]')
    left.legend(frameon=False, fontsize=8)
    save(figure, PICTURE)
    training, _ = split_dataset(dataset, [HELD_OUT])
    print(PICTURE, 'fitted:', ', '.join(run.name for run in training.recordings))


def draw(axis: Any, run: ComparedRun) -> None:
    """One level: measured in grey, model in colour."""
    held = run.name == HELD_OUT
    T = run.states['T_K'] - 273.15
    axis.plot(T, 100.0 * run.measured['strain'], color=GREY, linewidth=3.0, alpha=0.6, label='measured' if held else None)
    axis.plot(
        T,
        100.0 * run.predicted['strain'],
        color=ORANGE if held else BLUE,
        linewidth=1.6 if held else 0.9,
        label='model, level held out' if held else 'model, fitted' if run.name == '400MPa' else None,
    )


if __name__ == '__main__':
    main()
