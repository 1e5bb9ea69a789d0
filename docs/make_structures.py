"""Draw every structure at rest and heated: docs/figures/structures.png.

python docs/make_structures.py
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from sma_sim import Config, Model, find_structures
from sma_sim.model.structures.drawing import Lines, Sketch, projected
from sma_sim.model.structures.structure import Structure
from sma_sim.report.palette import GREY, MODE_COLOURS
from sma_sim.report.style import mode_legend, save, sized_figure
from sma_sim.solver.columns import sample_columns
from sma_sim.solver.fixed_rate import FixedRateRun
from sma_sim.solver.integrate import PER_WIRE, WIRE_COLUMNS

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
IN_A_ROW = 3
MARGIN = 0.12  # around a structure, relative to its length


class Pose(NamedTuple):
    """The lines of a structure, and the mode of every wire."""

    lines: Lines
    modes: Sequence[int]


def draw_structures(runs: Sequence[FixedRateRun], at_rest: Sequence[Pose]) -> Figure:
    """Each structure as it is after its run, and in grey as it was at rest."""
    rows = -(-len(runs) // IN_A_ROW)
    figure = sized_figure(10.0, 1.5 * rows + 0.7)
    axes: Any = figure.subplots(rows, IN_A_ROW, squeeze=False).flat
    shown: set[int] = set()
    for axis, run, rest in zip(axes, runs, at_rest, strict=False):
        pose = pose_of(run)
        shown |= set(pose.modes)
        for line in (*rest.lines.bodies, *rest.lines.wires):
            axis.plot(*projected(line), color=GREY, lw=0.9, alpha=0.7)
        for line in pose.lines.bodies:
            axis.plot(*projected(line), color='black', lw=2.2, solid_capstyle='round')
        for line, mode in zip(pose.lines.wires, pose.modes, strict=True):
            axis.plot(*projected(line), color=MODE_COLOURS[mode], lw=1.6)
        axis.set_title(run.model.structure.name, fontsize=11)
        axis.set_aspect('equal')
        axis.margins(MARGIN)
    for axis in figure.axes:
        axis.set_axis_off()
    mode_legend(figure, shown, 'outside lower center', 'wires by active mode; grey: at rest')
    return figure


def pose_of(run: FixedRateRun) -> Pose:
    """How a structure is at the end of the last step."""
    model, where = run.model, sample_columns(run.model.structure)
    q = dict(zip(model.structure.coordinate_names, run.sample[where.pose].tolist(), strict=True))
    wires = run.sample[where.wires]
    lengths, modes = (wires[WIRE_COLUMNS.index(name) :: PER_WIRE].tolist() for name in ('length', 'mode'))
    return Pose(Sketch(model.structure, model.config.parameters).lines(q, lengths), [int(mode) for mode in modes])


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


def model_of(structure: Structure) -> Model:
    """A structure at its default parameters."""
    return Model(Config(system=structure))


if __name__ == '__main__':
    main()
