"""Draw the module at a few instants of a run: `python examples/draw_module.py [module.png]`."""

import sys
from pathlib import Path

import sma_sim
from sma_sim.report.module_figure import draw_module
from sma_sim.report.style import save
from sma_sim.solver.inputs import inputs_at

command = sma_sim.module_input(times=[0, 2, 14, 26, 34], J_eq=[0, 14, -14, 0, 0])
model = sma_sim.Model()
run = sma_sim.simulate(model, command, 50)
columns = inputs_at(command, run.time) | run.columns
picture = Path(sys.argv[1] if len(sys.argv) > 1 else 'module.png')
save(draw_module(columns, [1.0, 4.0, 13.0, 17.0, 25.0], model.constants), picture)
print(picture)
