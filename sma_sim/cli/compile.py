"""`sma-sim compile`: compiles the equations now, as in the build of a container, instead of at the first start."""

from __future__ import annotations

import argparse
from typing import Any

from sma_sim.cli.common.commands import add_command
from sma_sim.cli.common.config_options import announce_first_compilation
from sma_sim.compiler.compile import cache_folder, content_key, is_interpreted
from sma_sim.evidence.control.predictive import PredictiveController
from sma_sim.evidence.state_estimation.observer import Observer
from sma_sim.model.config import Config
from sma_sim.solver.first_start import SIMULATION, TANGENTS
from sma_sim.solver.warm_up import compile_fixed_rate, compile_simulation, compile_tangents


def add_parser(verbs: Any) -> None:
    """Declare the verb."""
    parser = add_command(verbs, 'compile')
    parser.set_defaults(run=run)


def run(_: argparse.Namespace) -> int:
    """Compile for simulations, fits and the nodes, where it has not been done."""
    announce_first_compilation((*SIMULATION, *TANGENTS))
    compile_simulation()
    compile_tangents()
    compile_fixed_rate()
    Observer(Config())
    PredictiveController(Config())
    if is_interpreted():
        print('Nothing is compiled, because NUMBA_DISABLE_JIT is set.')
    else:
        print(f'The native code is in {cache_folder(content_key())}.')
    return 0
