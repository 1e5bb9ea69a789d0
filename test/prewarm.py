"""Compiles what the tests run, once for all workers: solver, tangents and effects side by side."""

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


def effects():
    """The library."""
    from sma_sim import find_effects
    from sma_sim.compiler.effect_kernels import native_effect

    for found in find_effects().values():
        native_effect(found)


PARTS = {'solver': solver, 'tangents': tangents, 'effects': effects}


def prewarm():
    """All parts in processes of their own; what cannot be compiled is for the tests to say."""
    for process in [subprocess.Popen([sys.executable, __file__, part]) for part in PARTS]:
        process.wait()


if __name__ == '__main__':
    PARTS[sys.argv[1]]() if len(sys.argv) > 1 else prewarm()
