"""Bags of every structure: what is written is read back, whoever recorded it, and simulated again."""

import json
from pathlib import Path

import numpy as np
import pytest

from sma_sim import Config, Input, Model, UserError, find_structures, simulate
from sma_sim.cli.main import main
from sma_sim.evidence.data.rosbag.interface import interface_of
from sma_sim.evidence.data.rosbag.reader import read_bag
from sma_sim.evidence.data.rosbag.run_writer import write_mcap
from sma_sim.evidence.data.rosbag.salvage import open_bag
from sma_sim.evidence.data.rosbag.writer import BagWriter
from sma_sim.evidence.data.tables import read_columns, write_columns
from sma_sim.model.structures.discovery import package_structures
from sma_sim.solver.inputs import inputs_at

EXAMPLE = Path(__file__).resolve().parents[2] / 'examples' / 'own_structure'
ROCKER = find_structures([EXAMPLE])['rocker']
STRUCTURES = {name: found for name, found in package_structures().items() if not found.variant_of} | {'rocker': ROCKER}


@pytest.fixture(scope='module', params=STRUCTURES)
def run(request):
    """A structure, and the columns of a short run of it in which everything that is imposed changes."""
    structure = STRUCTURES[request.param]
    heating = range(len(structure.commands))
    rows = [[*(0.02 * (k % 2) for _ in structure.drives), *(0.4 * (k + i) for i in heating), 298.0 + k] for k in range(4)]
    linear = [True] * len(structure.drives) + [False] * (len(structure.commands) + 1)
    source = Input(np.array([0.0, 0.1, 0.2, 0.3]), np.array(rows), tuple(linear), structure.input_columns)
    own = structure if request.param == 'rocker' else None
    trajectory = simulate(Model(Config(system=request.param, own_structure=own)), source, 100.0)
    return structure, inputs_at(source, trajectory.time) | trajectory.columns | trajectory.resistances


def by_another_recorder(source, target):
    """The same messages in a bag that says nothing of itself."""
    bag, numbers = BagWriter(target), {}
    for message in open_bag(source).messages():
        if message.topic not in numbers:
            numbers[message.topic] = bag.add(message.topic, message.kind)
        bag.write(numbers[message.topic], message.log_time, message.cdr)
    bag.close()


def test_what_is_written_is_read(tmp_path, run):
    structure, columns = run
    write_mcap(tmp_path / 'run.mcap', columns)
    by_another_recorder(tmp_path / 'run.mcap', tmp_path / 'plain')
    assert set(columns) == set(interface_of(structure).columns)
    for again in (
        read_bag(tmp_path / 'run.mcap'),
        read_bag(tmp_path / 'plain'),
        read_bag(tmp_path / 'plain', None, structure),
    ):
        assert list(again) == list(interface_of(structure).columns)
        for name, values in columns.items():
            assert again[name] == pytest.approx(values, rel=1e-12, abs=1e-12), name


def test_commands_take_bags_of_every_structure(tmp_path, run):
    structure, columns = run
    write_columns(tmp_path / 'run.csv', columns)
    files = [str(tmp_path / name) for name in ('run.csv', 'run.mcap', 'again.csv')]
    for source, target in zip(files, files[1:], strict=False):
        assert main(['bag', 'convert', source, target]) == 0
    assert read_columns(tmp_path / 'again.csv', tuple(columns)).keys() == columns.keys()
    words = ['--system', structure.name]
    if structure.name == 'rocker':
        words += ['--set', f'structures.paths={EXAMPLE}']
    for source in ('run.csv', 'run.mcap'):
        assert main(['simulate', '--input', str(tmp_path / source), '--out', str(tmp_path / f'{source}.csv'), *words]) == 0
    assert (tmp_path / 'run.csv.csv').read_bytes() == (tmp_path / 'run.mcap.csv').read_bytes()
    assert main(['plot', str(tmp_path / 'run.mcap'), '--out', str(tmp_path / 'run.png')]) == 0


def test_a_bag_tells_its_topics_where_nobody_knows_the_structure(tmp_path, run, monkeypatch):
    structure, columns = run
    write_mcap(tmp_path / 'run.mcap', columns, structure)
    monkeypatch.setattr('sma_sim.evidence.data.rosbag.interface.known_structures', dict)
    assert list(read_bag(tmp_path / 'run.mcap')) == list(interface_of(structure).columns)


TOLD = json.loads(interface_of(ROCKER).as_json())
WRONG = ({'wires': 'two'}, {'wires': 10**9}, {'joints': ['a']}, {'drives': {'a': 1}}, {'commands': [1]}, {'channels': None})


@pytest.mark.parametrize('told', ['', '3', '[]', '{}', *(json.dumps(TOLD | wrong) for wrong in WRONG)])
def test_what_a_bag_tells_wrongly_of_its_topics(tmp_path, told):
    bag = BagWriter(tmp_path / 'bag', {'epoch': '0', 'interface': told})
    bag.add('/J_eq', 'std_msgs/msg/Float64')
    bag.close()
    with pytest.raises(UserError, match='what is recorded there of its topics cannot be read'):
        read_bag(tmp_path / 'bag')
