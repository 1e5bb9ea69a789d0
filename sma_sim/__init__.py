"""Simulation of soft robots driven by shape-memory-alloy (SMA) wires."""

from sma_sim.model.config import Config, default_parameters, read_config
from sma_sim.model.effects.effect import Effect
from sma_sim.model.effects.library import find_effects
from sma_sim.model.errors import UserError
from sma_sim.model.parameters import Parameter
from sma_sim.solver.inputs import Input, module_input, wire_input
from sma_sim.solver.simulate import Model, Trajectory, simulate

__all__ = [
    'Config',
    'Effect',
    'Input',
    'Model',
    'Parameter',
    'Trajectory',
    'UserError',
    'default_parameters',
    'find_effects',
    'module_input',
    'read_config',
    'simulate',
    'wire_input',
]
