"""Runs that sample some sensor channels show exactly what they show among all columns."""

import numpy as np
import pytest

from sma_sim import Config, Model, default_parameters, find_effects, module_input, simulate, wire_input
from sma_sim.model.effects.discovery import ActiveEffect
from sma_sim.model.effects.ports import CHANNELS
from sma_sim.model.errors import UserError
from sma_sim.model.structures.discovery import package_structures

STRUCTURES = [package_structures()[name].structure for name in ('module', 'wire')]
COLUMN = {
    channel: column
    for structure in STRUCTURES
    for channel, column in zip(structure.channels, structure.channel_columns, strict=True)
}
COMMAND = module_input([0.0, 1.0, 4.0, 6.0, 8.0], [0.0, 14.0, 0.0, -12.0, 0.0])
STRETCH = wire_input([0.0, 4.0, 8.0], [0.0, 0.05, 0.01], [0.0, 0.2, 0.0])
TIMES = np.linspace(0.0, 8.0, 41)
SELECTIONS = {
    'module': (
        ('alpha',),
        ('U_y', 'U_x'),
        ('F_1',),
        ('F_2',),
        ('F_2', 'F_1', 'alpha'),
        ('T_2',),
        ('T_1', 'F_1'),
        CHANNELS[:7],
        ('R_2',),
        ('R_1', 'alpha'),
    ),
    'wire': (('stress',), ('T',), ('T', 'stress'), ('R',), ('R', 'stress')),
}
EFFECTS = find_effects()
DEFAULTS = {name: tuple(p.default for p in found.effect.parameters) for name, found in EFFECTS.items()}


def model_with(system, kinetics, names):
    active = tuple(ActiveEffect(EFFECTS[name], DEFAULTS[name]) for name in names)
    return Model(Config(default_parameters(), system, kinetics, active))


def assert_same_channels(system, kinetics, names):
    model = model_with(system, kinetics, names)
    source = COMMAND if system == 'module' else STRETCH
    whole = simulate(model, source, TIMES, max_steps=20_000)
    assert len(whole.time) > 1
    for channels in SELECTIONS[system]:
        some = simulate(model, source, TIMES, max_steps=20_000, channels=channels)
        assert list(some.columns) == [COLUMN[name] for name in channels]
        assert (some.reason, some.steps, some.jumps) == (whole.reason, whole.steps, whole.jumps)
        for name in some.columns:
            assert np.array_equal(some[name], whole[name], equal_nan=True), (names, channels, name)


@pytest.mark.parametrize('kinetics', ['hybrid', 'mas'])
@pytest.mark.parametrize('system', ['module', 'wire'])
@pytest.mark.parametrize('name', ['', *EFFECTS])
def test_channels_are_those_of_whole_samples(name, system, kinetics):
    assert_same_channels(system, kinetics, (name,) if name else ())


@pytest.mark.parametrize('kinetics', ['hybrid', 'mas'])
def test_channels_with_effects_on_several_ports(kinetics):
    assert_same_channels('module', kinetics, ('gravity', 'natural_convection', 'thermal_expansion', 'sensor_lag'))
    assert_same_channels('module', kinetics, ('driver_lag', 'guide_friction'))


def test_a_channel_of_the_other_system_is_refused():
    with pytest.raises(UserError, match='no channel .stress.; expected some of U_x'):
        simulate(model_with('module', 'hybrid', ()), COMMAND, TIMES, channels=('alpha', 'stress'))
