"""Runs that sample some sensor channels show exactly what they show among all columns."""

import numpy as np
import pytest

from sma_sim import Config, Model, default_parameters, find_effects, module_input, simulate, wire_input
from sma_sim.model.effects.discovery import ActiveEffect
from sma_sim.model.effects.ports import CHANNELS
from sma_sim.model.errors import UserError
from sma_sim.model.structures.discovery import package_structures
from sma_sim.solver.inputs import Input
from sma_sim.solver.simulate import channels_of_all, new_run, new_work

STRUCTURES = [package_structures()[name] for name in ('module', 'wire')]
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
DEFAULTS = {name: tuple(p.default for p in found.parameters) for name, found in EFFECTS.items()}


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


SHOWING = ('sensor_bias', 'sensor_crosstalk', 'sensor_drift', 'sensor_gain', 'sensor_jump', 'sensor_misalignment')
LINES = Input(COMMAND.times, COMMAND.values, (True, True), COMMAND.names)
ROWS = module_input(np.arange(0.0, 8.0, 0.05), 8.0 * np.sin(np.arange(0.0, 8.0, 0.05)))


@pytest.mark.parametrize('kinetics', ['hybrid', 'mas'])
@pytest.mark.parametrize('source', [COMMAND, LINES, ROWS], ids=['held', 'lines', 'rows'])
@pytest.mark.parametrize('acting', [(), ('gravity', 'driver_lag'), ('smooth_transformation',)], ids=len)
def test_models_that_differ_in_what_sensors_show_share_a_run(acting, source, kinetics):
    names = [name for name, found in EFFECTS.items() if found.only_shows]
    assert sorted(names) == sorted(SHOWING)
    models = [model_with('module', kinetics, acting), *(model_with('module', kinetics, (*acting, one)) for one in names)]
    arguments = (source, TIMES, models[0].structure.channels[:5], 100_000)
    together = channels_of_all(models, *arguments, *begin_of(models[0], source))
    alone = [channels_of_all([model], *arguments, *begin_of(model, source))[0] for model in models]
    for one, other in zip(together, alone, strict=True):
        assert np.array_equal(one, other)
    assert not any(np.array_equal(alone[0], other) for other in alone[1:])


def begin_of(model, source):
    """Where a run begins, and its scratch memory."""
    work = new_work(model)
    return new_run(model, source.values[0], work), work


@pytest.mark.parametrize('kinetics', ['hybrid', 'mas'])
def test_what_sensors_only_show_changes_no_run(kinetics):
    model, shown = model_with('module', kinetics, ()), model_with('module', kinetics, ('sensor_drift', 'sensor_jump'))
    one, other = simulate(model, ROWS, TIMES[:-1]), simulate(shown, ROWS, TIMES[:-1])
    assert not shown.uses_time and model_with('module', kinetics, ('clamp_slip',)).uses_time
    assert one.steps == other.steps and np.array_equal(one['T_1_K'], other['T_1_K'])


def test_a_channel_of_the_other_system_is_refused():
    with pytest.raises(UserError, match='no channel .stress.; expected some of U_x'):
        simulate(model_with('module', 'hybrid', ()), COMMAND, TIMES, channels=('alpha', 'stress'))
