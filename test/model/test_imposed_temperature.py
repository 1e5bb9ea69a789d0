"""Wires whose temperatures are measured or set, as in a furnace or a bath, on every structure."""

import json

import numpy as np
import pytest
from test_structures import EXAMPLE, MOVING, command_of, model_of

from sma_sim import Config, Input, Model, read_config, simulate
from sma_sim.cli.main import main
from sma_sim.evidence.data.recordings import read_dataset, read_recording
from sma_sim.evidence.data.rosbag.run_writer import interface_of_columns
from sma_sim.evidence.estimation.calibrate import FitOptions, calibrate
from sma_sim.evidence.estimation.free_parameters import default_names, why_unidentifiable
from sma_sim.evidence.estimation.injection_points import ports_of
from sma_sim.model.effects.discovery import find_effects
from sma_sim.model.effects.meaning import acts_on
from sma_sim.model.structures.discovery import package_structures

PRESCRIBED = 'bench.temperature=prescribed'
ROBOT = str(EXAMPLE / 'robot.yaml')


def test_every_structure_has_a_variant():
    for name in sorted(MOVING):
        path = ROBOT if name == 'rocker' else None
        config = read_config(path, words=[f'system={name}', PRESCRIBED])
        structure, plain = config.structure, MOVING[name]
        assert config.system == f'{name}_at_T' and structure.original == name
        temperatures = [f'T{suffix}_K' for suffix in plain.wire_suffixes]
        assert list(structure.input_columns) == [*temperatures, *plain.input_columns]
        assert list(structure.needed_columns) == temperatures and structure.declared == plain.declared
        assert not set(temperatures) & set(structure.channel_columns) and structure.channels[0] == plain.channels[0]
        assert not structure.is_quasi_static and structure.default_values.items() >= dict(plain.defaults).items()
        assert read_config(path, words=[f'system={name}_at_T', 'bench.temperature=balance']).system == name
    two = read_config(words=['system=slider', PRESCRIBED, 'slider.wires=2'])
    assert two.structure.input_columns[:2] == ('T_1_K', 'T_2_K') and two.structure.wires == 2
    assert two.on_bench('slider_2').structure.name == 'slider_2' and two.on_bench('slider_2_at_T') is two


@pytest.mark.parametrize('kinetics', ['hybrid', 'mas'])
@pytest.mark.parametrize('name', ['slider', 'lever', 'coil', 'rocker'])
def test_at_the_temperatures_of_a_heated_run_it_moves_as_that_one(name, kinetics):
    """What the heat balance gave, imposed: the same pose, forces and fractions."""
    heated = model_of(name, kinetics, solver__rtol=1e-8)
    times = np.linspace(0.0, 10.0, 16001)  # linear between them: errors fall with the square of their distance
    run = simulate(heated, command_of(name, 10.0), times)
    config = read_config(
        ROBOT if name == 'rocker' else None,
        words={**heated.config.parameters, 'system': name, 'bench.temperature': 'prescribed', 'kinetics': kinetics},
    )
    model = Model(config)
    suffixes, columns = model.structure.wire_suffixes, model.structure.input_columns
    values = np.zeros((len(times), len(columns)))
    values[:, : len(suffixes)], values[:, -1] = np.column_stack([run[f'T{s}_K'] for s in suffixes]), 298.0
    imposed = simulate(model, Input(times, values, tuple(k < len(suffixes) for k in range(len(columns))), columns), times)
    assert imposed.completed
    for coordinate in model.structure.coordinates:
        assert np.ptp(run[coordinate.column]) > 0.3 * coordinate.size(model.constants)
        assert imposed[coordinate.column] == pytest.approx(run[coordinate.column], abs=1e-3 * np.ptp(run[coordinate.column]))
    for s in suffixes:
        assert imposed[f'x_M{s}'] == pytest.approx(run[f'x_M{s}'], abs=2e-3)
        assert imposed[f'F{s}_N'] == pytest.approx(run[f'F{s}_N'], abs=2e-3 * np.ptp(run[f'F{s}_N']))
        assert imposed[f'T{s}_K'] == pytest.approx(run[f'T{s}_K'], abs=1e-6)


def test_one_bath_for_all_wires(tmp_path):
    """T_K stands for T_1_K and T_2_K; heating has no effect, and both wires cool and warm together."""
    bath = tmp_path / 'bath.csv'
    bath.write_text('time_s,T_K\n0,298\n20,360\n40,298\n')
    words = ['--system', 'lever', '--set', PRESCRIBED]
    assert main(['simulate', *words, '--input', str(bath), '--out', str(tmp_path / 'run.csv')]) == 0
    header = (tmp_path / 'run.csv').read_text().split('\n')[0].split(',')
    assert header[:3] == ['time_s', 'T_1_K', 'T_2_K'] and 'T_K' not in header
    (recording,) = read_recording(tmp_path / 'run.csv', 'lever_at_T', 298.0)
    middle = recording.source.values[len(recording.source.times) // 2]
    assert middle[0] == middle[1] == pytest.approx(360.0) and 'T_1' not in recording.channels
    rows = (tmp_path / 'run.csv').read_text().split('\n')
    measured = [f'{row.split(",")[0]},{row.split(",")[1]},{row.split(",")[header.index("angle_rad")]}' for row in rows[1:-1]]
    (tmp_path / 'lab.csv').write_text('\n'.join(['time_s,T_K,angle_rad', *measured, '']))
    (again,) = read_recording(tmp_path / 'lab.csv', 'lever_at_T', 298.0)
    assert np.array_equal(again.source.values, recording.source.values)


def test_what_a_set_temperature_leaves_without_meaning(tmp_path, capsys):
    structure = package_structures()['slider_at_T']
    for name, found in find_effects().items():
        heats = found.port in ('actuation', 'wire_heat') or name == 'thermometer_lag'
        assert acts_on(found, structure) == (acts_on(found, MOVING['slider']) and not heats), name
    config = Config(system='slider_at_T')
    assert not {'wire.c_V', 'wire.lambda'} & set(default_names(config)) and 'slider.k' in default_names(config)
    assert 'imposed' in why_unidentifiable('wire.c_V', config)
    assert not any(port.name.startswith(('heat', 'power')) for port in ports_of(config, structure.channels))
    bath = tmp_path / 'bath.csv'
    bath.write_text('time_s,T_K\n0,298\n5,300\n')
    words = ['simulate', '--system', 'slider_at_T', '--input', str(bath), '--out', str(tmp_path / 'o.csv')]
    assert main([*words, '--effect', 'radiation']) == 0
    assert 'radiation is left out: the temperature of the wires of slider_at_T is imposed' in capsys.readouterr().err
    assert main([*words[:2], 'slider', *words[3:]]) == 2
    assert 'has no column J_W' in (said := capsys.readouterr().err) and 'slider_at_T' not in said


def test_a_file_does_not_tell_that_temperatures_are_imposed():
    """A column of temperatures is that of sensors, unless one says otherwise."""
    columns = ['time_s', 'J_W', 'T_E_K', 'position_m', 'F_N', 'T_K', 'x_M', 'mode']
    assert interface_of_columns(columns).system == 'slider'


def test_listed_once_with_what_chooses_the_variant(capsys):
    assert main(['systems', '--json']) == 0
    names = [one['name'] for one in json.loads(capsys.readouterr().out)]
    assert 'slider' in names and 'slider_at_T' not in names and 'wire_at_T' in names
    assert main(['systems', 'slider_at_T']) == 0
    assert 'T_K' in capsys.readouterr().out


BOTH = """\
system: slider
tests:
  - files: heated.csv
  - files: bath.csv
    bench: {temperature: prescribed}
"""


def write_slider_run(path, text, truth, options, left_out):
    """A run of a slider of which the columns that begin so are left out, its position with noise."""
    (path.parent / 'in').mkdir(exist_ok=True)
    given = path.parent / 'in' / path.name
    given.write_text(text)
    sets = [word for one in (*(f'{name}={value}' for name, value in truth.items()), *options) for word in ('--set', one)]
    assert main(['simulate', '--system', 'slider', *sets, '--rate', '5', '--input', str(given), '--out', str(path)]) == 0
    header, *rows = [row.split(',') for row in path.read_text().split()]
    random, at = np.random.default_rng(3), header.index('position_m')
    for row in rows:
        row[at] = repr(float(row[at]) + 1e-5 * random.standard_normal())
    kept = [k for k, column in enumerate(header) if not column.startswith(left_out)]
    path.write_text('\n'.join(','.join(row[k] for k in kept) for row in [header, *rows]) + '\n')


def test_a_bath_and_a_heated_run_in_one_fit(tmp_path):
    """Both are of one slider: transformation stress, which the bath shows, and cooling, which only the heated run does."""
    truth = {'wire.sigma_MW0': 1.25e8, 'wire.lambda': 400.0}
    hidden = ('x_M', 'mode', 'F_')
    write_slider_run(tmp_path / 'heated.csv', 'time_s,J_W\n0,0\n1,0.8\n8,0\n20,0\n', truth, [], (*hidden, 'T_K'))
    write_slider_run(tmp_path / 'bath.csv', 'time_s,T_K\n0,298\n40,350\n80,298\n', truth, [PRESCRIBED], hidden)
    (tmp_path / 'map.yaml').write_text(BOTH)
    files = [tmp_path / 'heated.csv', tmp_path / 'bath.csv']
    dataset = read_dataset(files, 'slider', 298.0, tmp_path / 'map.yaml', noise_std={'position': 1e-5})
    assert {recording.system for recording in dataset.recordings} == {'slider', 'slider_at_T'}
    found = calibrate(dataset, Config(system='slider'), FitOptions(free=tuple(truth), kinetics='hybrid', starts=1))
    for name, value in truth.items():
        assert found.config.parameters[name] == pytest.approx(value, rel=0.01)


def test_a_mas_wire_under_load_takes_long_steps_through_its_transformation():
    """An inexact Jacobian would keep them short: stress follows strain stiffly, and rates are exponentials of it."""
    words = ['system=wire', 'bench.control=stress', PRESCRIBED, 'kinetics=mas', 'wire.T0=385', 'wire.sigma_MW0=2e8']
    effects, T = ['temperature_gradient:dT=2'], np.array([580.0, 310.0, 580.0])
    runs = []
    for rtol in (1e-5, 1e-7):
        model = Model(read_config(words=[*words, f'solver.rtol={rtol}'], effects=effects))
        columns = np.column_stack([np.full(3, 2e8), T, np.zeros(3), np.full(3, 298.0)])
        source = Input(np.array([0.0, 540.0, 1080.0]), columns, (True, True, False, False), model.structure.input_columns)
        runs.append(simulate(model, source, 1.0))
    coarse, fine = runs
    assert np.ptp(fine['strain']) > 0.05 and coarse['strain'] == pytest.approx(fine['strain'], abs=1e-6)
    assert coarse.steps < 600  # twice as many with slopes over 1e-7 of the strain's scale
