"""Compiles what the tests run, once for all workers, side by side: what several need at a time, each would compile."""

import subprocess
import sys


def solver():
    """Both systems under both kinetics, at adaptive and at fixed steps."""
    from sma_sim import Config, Model, module_input, simulate, wire_input
    from sma_sim.solver.fixed_rate import simulate_fixed_rate

    commands = {'module': module_input([0.0, 0.1], [1.0, 0.0]), 'wire': wire_input([0.0, 0.1], [0.0, 0.01])}
    for system, source in commands.items():
        for kind in ('hybrid', 'mas'):
            simulate(Model(Config(system=system, kinetics=kind)), source, 10.0)
    simulate_fixed_rate(Model(Config()), commands['module'], 100.0, 10.0)


def tangents():
    """What gives fits their derivatives."""
    from sma_sim.solver.warm_up import compile_tangents

    compile_tangents()


def control():
    """What predictive controllers run, and environments, which step robots side by side."""
    import numpy as np

    from sma_sim import Config, Model
    from sma_sim.solver.fixed_rate import FixedRateRun
    from sma_sim.solver.prediction import Prediction
    from sma_sim.solver.side_by_side import SideBySide

    model, inputs = Model(Config()), np.array([1.0, 298.0])
    run = FixedRateRun(model, 50.0, inputs)
    prediction = Prediction(model, (0.0, 0.1), (0.1,), 1e-4)
    prediction.with_derivatives(run.time, run.run, inputs[:1], np.ones(2), 298.0)
    robots = SideBySide(model, 50.0, 1)
    robots.put(0, model, inputs)
    robots.step(inputs[None], np.array([0]))


def observers():
    """What estimates the state of a robot."""
    from sma_sim import Config
    from sma_sim.observer import Observer

    Observer(Config())


def library():
    """Effects and structures."""
    from sma_sim import find_effects, find_structures
    from sma_sim.compiler.effect_kernels import native_effect
    from sma_sim.compiler.structure_kernels import native_structure

    for effect in find_effects().values():
        native_effect(effect)
    for structure in find_structures().values():
        native_structure(structure)


PARTS = {'stepping': (solver, control), 'derivatives': (tangents, observers), 'library': (library,)}


def prewarm():
    """All parts in processes of their own; what cannot be compiled is for the tests to say."""
    for process in [subprocess.Popen([sys.executable, __file__, part]) for part in PARTS]:
        process.wait()


if __name__ == '__main__':
    if len(sys.argv) > 1:
        for compile_part in PARTS[sys.argv[1]]:
            compile_part()
    else:
        prewarm()
