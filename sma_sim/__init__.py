"""Simulation of soft robots driven by shape-memory-alloy (SMA) wires."""

from sma_sim.evidence.calibrate import Calibration, Options, calibrate
from sma_sim.evidence.diagnose import Diagnosis, diagnose
from sma_sim.evidence.held_out import held_out
from sma_sim.evidence.latent.latent import Latent, latent
from sma_sim.evidence.recording import Campaign, Recording
from sma_sim.evidence.recordings import read_campaign
from sma_sim.evidence.residuals import Nuisance, predict
from sma_sim.model.config import Config, default_parameters, read_config
from sma_sim.model.effects.effect import Effect
from sma_sim.model.effects.library import find_effects
from sma_sim.model.errors import UserError
from sma_sim.model.parameters import Parameter
from sma_sim.solver.inputs import Input, module_input, wire_input
from sma_sim.solver.simulate import Model, Trajectory, simulate

__all__ = [
    'Calibration',
    'Campaign',
    'Config',
    'Diagnosis',
    'Effect',
    'Input',
    'Latent',
    'Model',
    'Nuisance',
    'Options',
    'Parameter',
    'Recording',
    'Trajectory',
    'UserError',
    'calibrate',
    'default_parameters',
    'diagnose',
    'find_effects',
    'held_out',
    'latent',
    'module_input',
    'predict',
    'read_campaign',
    'read_config',
    'simulate',
    'wire_input',
]
