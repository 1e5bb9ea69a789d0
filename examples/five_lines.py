"""A step of the command, simulated from Python: run it with `python examples/five_lines.py`."""

import sma_sim

command = sma_sim.module_input(times=[0, 5, 25, 60], J_eq=[0, 12, 0, 0])  # [s], [W]; the last time is the end
model = sma_sim.Model(sma_sim.read_config(effects=['gravity', 'natural_convection:k=2']))
run = sma_sim.simulate(model, command, 100)  # 100 samples per second
print(f'largest angle: {max(run["alpha_rad"]):.4f} rad, hottest wire: {max(run["T_1_K"]):.1f} K')
