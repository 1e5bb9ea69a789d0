"""Simulation of soft robots driven by shape-memory-alloy (SMA) wires.

A name is imported when it is first asked for, so that a command loads what it needs and no more.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sma_sim import effects as effects
    from sma_sim import guard as guard
    from sma_sim import observer as observer
    from sma_sim import structures as structures
    from sma_sim.challenge.files import write_challenge as write_challenge
    from sma_sim.challenge.make import Challenge as Challenge
    from sma_sim.challenge.make import RecordingPlan as RecordingPlan
    from sma_sim.challenge.make import make_challenge as make_challenge
    from sma_sim.evidence.data.recording import Dataset as Dataset
    from sma_sim.evidence.data.recording import Recording as Recording
    from sma_sim.evidence.data.recordings import read_dataset as read_dataset
    from sma_sim.evidence.data.rosbag.commands import CommandLimits as CommandLimits
    from sma_sim.evidence.diagnosis.diagnose import Diagnosis as Diagnosis
    from sma_sim.evidence.diagnosis.diagnose import diagnose as diagnose
    from sma_sim.evidence.estimation.calibrate import Calibration as Calibration
    from sma_sim.evidence.estimation.calibrate import FitOptions as FitOptions
    from sma_sim.evidence.estimation.calibrate import calibrate as calibrate
    from sma_sim.evidence.estimation.held_out_prediction import evaluate_held_out as evaluate_held_out
    from sma_sim.evidence.estimation.residuals import Nuisance as Nuisance
    from sma_sim.evidence.estimation.residuals import predict as predict
    from sma_sim.evidence.estimation.uncertainty import Interval as Interval
    from sma_sim.evidence.experiment_design.design import next_experiment as next_experiment
    from sma_sim.evidence.experiment_design.plan import DesignRequest as DesignRequest
    from sma_sim.evidence.experiment_design.plan import Plan as Plan
    from sma_sim.evidence.latent_input.latent_search import LatentRequest as LatentRequest
    from sma_sim.evidence.latent_input.latent_search import estimate_latent_inputs as estimate_latent_inputs
    from sma_sim.evidence.latent_input.results import LatentInputs as LatentInputs
    from sma_sim.evidence.model_selection.nominal_fit import DiagnosisRequest as DiagnosisRequest
    from sma_sim.evidence.residual_analysis.compare import Comparison as Comparison
    from sma_sim.evidence.residual_analysis.compare import compare as compare
    from sma_sim.model.archive import load as load
    from sma_sim.model.config import Config as Config
    from sma_sim.model.config import default_parameters as default_parameters
    from sma_sim.model.config import read_config as read_config
    from sma_sim.model.effects.discovery import EffectError as EffectError
    from sma_sim.model.effects.discovery import find_effects as find_effects
    from sma_sim.model.effects.effect import EachBundle as EachBundle
    from sma_sim.model.effects.effect import Effect as Effect
    from sma_sim.model.effects.effect import EffectChoice as EffectChoice
    from sma_sim.model.errors import PhysicsWarning as PhysicsWarning
    from sma_sim.model.errors import UserError as UserError
    from sma_sim.model.parameters import Parameter as Parameter
    from sma_sim.model.structures.discovery import StructureError as StructureError
    from sma_sim.model.structures.discovery import find_structures as find_structures
    from sma_sim.model.structures.links import Drawing as Drawing
    from sma_sim.model.structures.structure import Coordinate as Coordinate
    from sma_sim.model.structures.structure import Drive as Drive
    from sma_sim.model.structures.structure import NamedEffect as NamedEffect
    from sma_sim.model.structures.structure import Structure as Structure
    from sma_sim.solver.beginning import Beginning as Beginning
    from sma_sim.solver.inputs import Input as Input
    from sma_sim.solver.inputs import module_input as module_input
    from sma_sim.solver.inputs import wire_input as wire_input
    from sma_sim.solver.model import Model as Model
    from sma_sim.solver.simulate import SimulationError as SimulationError
    from sma_sim.solver.simulate import simulate as simulate
    from sma_sim.solver.trajectory import Trajectory as Trajectory
    from sma_sim.workflow.code_folders import write_config as write_config

__version__ = '0.1.0'
_EXPORTS = {
    'challenge.files': ('write_challenge',),
    'challenge.make': ('Challenge', 'RecordingPlan', 'make_challenge'),
    'evidence.data.rosbag.commands': ('CommandLimits',),
    'evidence.data.recording': ('Dataset', 'Recording'),
    'evidence.data.recordings': ('read_dataset',),
    'evidence.diagnosis.diagnose': ('Diagnosis', 'diagnose'),
    'evidence.estimation.calibrate': ('Calibration', 'FitOptions', 'calibrate'),
    'evidence.estimation.held_out_prediction': ('evaluate_held_out',),
    'evidence.estimation.residuals': ('Nuisance', 'predict'),
    'evidence.estimation.uncertainty': ('Interval',),
    'evidence.experiment_design.design': ('next_experiment',),
    'evidence.experiment_design.plan': ('DesignRequest', 'Plan'),
    'evidence.latent_input.latent_search': ('LatentRequest', 'estimate_latent_inputs'),
    'evidence.latent_input.results': ('LatentInputs',),
    'evidence.model_selection.nominal_fit': ('DiagnosisRequest',),
    'evidence.residual_analysis.compare': ('Comparison', 'compare'),
    'model.archive': ('load',),
    'model.config': ('Config', 'default_parameters', 'read_config'),
    'model.effects.effect': ('EachBundle', 'Effect', 'EffectChoice'),
    'model.effects.discovery': ('EffectError', 'find_effects'),
    'model.errors': ('PhysicsWarning', 'UserError'),
    'model.parameters': ('Parameter',),
    'model.structures.discovery': ('StructureError', 'find_structures'),
    'model.structures.links': ('Drawing',),
    'model.structures.structure': ('Coordinate', 'Drive', 'NamedEffect', 'Structure'),
    'solver.beginning': ('Beginning',),
    'solver.inputs': ('Input', 'module_input', 'wire_input'),
    'solver.model': ('Model',),
    'solver.simulate': ('SimulationError', 'simulate'),
    'solver.trajectory': ('Trajectory',),
    'workflow.code_folders': ('write_config',),
}
_MODULES = ('control', 'effects', 'guard', 'observer', 'structures')
__all__ = sorted(name for names in _EXPORTS.values() for name in names)


def __getattr__(name: str) -> Any:
    """The public name `name`, from the module that defines it."""
    if name in _MODULES:
        return import_module(f'{__name__}.{name}')
    for home, names in _EXPORTS.items():
        if name in names:
            value = globals()[name] = getattr(import_module(f'{__name__}.{home}'), name)
            return value
    if name.startswith('_'):
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    nearest = import_module(f'{__name__}.model.nearest')
    raise nearest.UnknownNameError(f'sma_sim has no {name}{nearest.suggestion(name, (*__all__, *_MODULES))}')


def __dir__() -> list[str]:
    """The public names."""
    return sorted({*__all__, *_MODULES, *globals()})
