"""Tables of other people: what a message proposes for a column that is missing, and which robot a table is for."""

import pytest
from test_bags import pair
from test_bags_of_others import bag

from sma_sim.cli.main import main
from sma_sim.evidence.data.foreign_columns import hint_for
from sma_sim.evidence.data.rosbag.interface import FLOAT64_ARRAY
from sma_sim.evidence.data.rosbag.reader import interface_of_robot, read_bag
from sma_sim.evidence.data.rosbag.run_writer import interface_of_columns

HINTS = [  # missing, header, what a map says of it, what else is to be done
    ('time_s', ['t_ms', 'J_eq_W'], '{column: t_ms, scale: 0.001}', 't_ms multiplied by 0.001'),
    ('time_s', ['Time [min]'], '{column: "Time [min]", scale: 60}', 'multiplied by 60'),
    ('time_s', ['time'], '{column: time, scale: 1}', 'rename time; the unit is part of the name'),
    ('J_eq_W', ['time_s', 'power_mW'], '{column: power_mW, scale: 0.001}', 'power_mW multiplied by 0.001'),
    ('T_E_K', ['room_C'], '{column: room_C, offset: 273.15}', 'room_C plus 273.15'),
    ('strain', ['strain_%'], '{column: strain_%, scale: 0.01}', 'strain_% multiplied by 0.01'),
    ('J_3_W', ['J_1_W', 'J_2_W'], '', ''),
]


@pytest.mark.parametrize(('name', 'header', 'in_map', 'by_hand'), HINTS)
def test_hint_knows_the_unit(name, header, in_map, by_hand):
    own = ('J_1_W', 'J_2_W', 'J_3_W', name)
    assert in_map in hint_for(name, header, own, with_map=True)
    assert by_hand in hint_for(name, header, own, with_map=False)
    assert bool(hint_for(name, header, own, True)) == bool(hint_for(name, header, own, False)) == bool(in_map)


def test_commands_give_the_hint(tmp_path, capsys):
    table = tmp_path / 't.csv'
    table.write_text('t_ms,J_eq_W,alpha_rad\n0,0,0\n10,1,0\n20,1,0\n')
    assert main(['compare', str(table)]) == 2
    assert '(t_ms is in ms: name it in a map: time_s: {column: t_ms, scale: 0.001})' in capsys.readouterr().err
    for words in (['simulate', '--input', str(table), '--out', str(tmp_path / 'o.csv')], ['play', str(table)]):
        assert main(words) == 2
        assert '(t_ms is in ms: expected time_s, which is t_ms multiplied by 0.001)' in capsys.readouterr().err


ROBOTS = [  # columns of a command or a run; topic, commands, set points of what it is for
    ('J_eq_W', 'J_eq', ('J_eq',), ()),
    ('J_W', 'J', ('J',), ()),
    ('J_1_W,J_2_W', 'J', ('J_1', 'J_2'), ()),
    ('J_1_W,J_2_W,J_3_W', 'J', ('J_1', 'J_2', 'J_3'), ()),
    ('J_eq_1_W,J_eq_2_W', 'J', ('J_eq_1', 'J_eq_2'), ()),
    ('J_eq_1_W,J_eq_2_W,J_eq_3_W,J_eq_4_W', 'J', ('J_eq_1', 'J_eq_2', 'J_eq_3', 'J_eq_4'), ()),
    ('strain,J_W,T_E_K', 'J', ('J',), ('strain',)),
    ('strain', 'J', ('J',), ('strain',)),
    ('J_W,position_m,F_N,T_K', 'J', ('J',), ()),
    ('J_1_W,J_2_W,position_m,F_1_N,F_2_N', 'J', ('J_1', 'J_2'), ()),
]


@pytest.mark.parametrize(('columns', 'topic', 'commands', 'drives'), ROBOTS)
def test_a_table_tells_what_is_commanded(columns, topic, commands, drives):
    found = interface_of_columns(['time_s', *columns.split(',')])
    assert (found.heating_topic, found.commands, tuple(found.drives)) == (topic, commands, drives)


@pytest.mark.parametrize('count', [1, 2, 5])
def test_a_bag_of_another_recorder_tells_how_many_wires_are_heated(tmp_path, count):
    """Without joints that a structure has, and without --system."""
    powers = [0.5 * (i + 1) for i in range(count)]
    path = bag(tmp_path / 'bag', [(1.0, powers), (2.0, [0.0] * count)], 3.0, '/J', FLOAT64_ARRAY, pair)
    commands = interface_of_robot(path).commands
    assert len(commands) == count
    columns = read_bag(path)
    assert [columns[f'{name}_W'].max() for name in commands] == powers
