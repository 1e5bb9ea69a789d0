"""Draw every structure at rest and heated: docs/figures/structures.png.

python docs/make_structures.py
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sma_sim import Config, Model, find_structures
from sma_sim.model.structures.discovery import FoundStructure
from sma_sim.report.structure_figure import draw_structures, pose_of
from sma_sim.report.style import save
from sma_sim.solver.fixed_rate import FixedRateRun

ROOT = Path(__file__).resolve().parents[1]
PICTURE = ROOT / 'docs' / 'figures' / 'structures.png'
SHOWN = {  # what is imposed beside heating, and the heating [W]
    'module': ([], [20.0]),
    'stack': ([], [20.0, 20.0, -20.0]),
    'spatial': ([], [25.0, 0.0, 0.0]),
    'lever': ([], [2.0]),
    'slider': ([], [2.0]),
    'coil': ([], [5.0]),
    'wire': ([0.05], [0.0]),
    'rocker': ([], [2.0]),
}
DURATION, RATE = 6.0, 1000.0


def main() -> None:
    """Run every structure and draw it."""
    known = find_structures([ROOT / 'examples' / 'own_structure'])
    runs = [
        FixedRateRun(model_of(known[name]), RATE, np.array([*(0.0 for _ in drives), *(0.0 for _ in J), 298.0]))
        for name, (drives, J) in SHOWN.items()
    ]
    at_rest = [pose_of(run) for run in runs]
    for run, (drives, J) in zip(runs, SHOWN.values(), strict=True):
        run.step(np.array([*drives, *J, 298.0]), round(DURATION * RATE), round(DURATION * RATE))
    save(draw_structures(runs, at_rest), PICTURE)
    print(PICTURE)


def model_of(found: FoundStructure) -> Model:
    """A structure at its default parameters."""
    return Model(Config(system=found.structure.name, own_structure=found if found.files else None))


if __name__ == '__main__':
    main()
