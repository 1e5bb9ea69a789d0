"""Whether a robot makes sense: how it rests, and what heating does to it, in words."""

from __future__ import annotations

import math

import numpy as np

from sma_sim.evidence.data.display_units import ZERO_CELSIUS
from sma_sim.model.config import Config
from sma_sim.model.layout import O_EPS, O_SIGMA
from sma_sim.solver.inputs import module_input
from sma_sim.solver.model import Model
from sma_sim.solver.simulate import new_run, new_work, simulate

HEATING_TIME = 10.0  # [s]
J_MAX_FRACTION = 0.5


def at_rest(config: Config) -> str:
    """Strain, stress and fractions of the module in static equilibrium. Raises SimulationError when there is none."""
    model = Model(config)
    work = new_work(model)
    run = new_run(model, np.array([0.0, config.parameters['environment.T_E']]), work)
    strains, stresses = 100.0 * work.first.obs[:, O_EPS], 1e-6 * work.first.obs[:, O_SIGMA]
    words = (
        f'At rest (static equilibrium found): wires strained by {two_numbers(strains)} %, '
        f'stressed by {two_numbers(stresses)} MPa, '
        f'martensite fraction {two_numbers(run.state.x_frozen)}, angle {math.degrees(run.state.y[2]):.3g} deg.'
    )
    if stresses.min() <= 0.0:
        words += '\nNote: a wire is not in tension at rest; a shorter wire.l0 pre-tensions it.'
    return words


def when_heated(config: Config) -> str:
    """Largest angle and temperature when one bundle is heated for a while."""
    power = J_MAX_FRACTION * config.parameters['node.J_max']
    command = module_input([0.0, HEATING_TIME], [power, 0.0], T_E=config.parameters['environment.T_E'])
    run = simulate(Model(config), command, 50.0)
    words = f'Bundle 1 heated with {power:g} W (half of node.J_max) for {HEATING_TIME:g} s: '
    if not run.completed:
        return f'{words}the run ended after {run.end:.3g} s: {run.reason}.'
    angles = np.degrees(run['alpha_rad'])
    return (
        f'{words}the plate turns from {angles[0]:.3g} to {angles[np.argmax(np.abs(angles - angles[0]))]:.3g} deg, '
        f'the wires reach {run["T_1_K"].max() - ZERO_CELSIUS:.0f} degC.'
    )


def two_numbers(values: np.ndarray) -> str:
    """Two numbers, or one where they agree."""
    first, second = (f'{value:.3g}' for value in values)
    return first if first == second else f'{first} and {second}'
