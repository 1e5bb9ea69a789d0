"""Parameter files of every kind: the node and the offline commands say the same of each, and what they say helps."""

import pytest

rclpy = pytest.importorskip('rclpy', reason='rclpy is not installed')
from sma_sim import UserError, read_config  # noqa: E402
from sma_sim.cli.main import main  # noqa: E402
from sma_sim.model.config import flat_parameters  # noqa: E402
from sma_sim.ros.parameter_node import ParameterNode  # noqa: E402
from sma_sim.ros.parameters import configure, overrides_of, read_arguments  # noqa: E402
from sma_sim.ros.qos import take_overrides  # noqa: E402

NAME = 'sma_module_sim'
HEAD = '/**:\n  ros__parameters:\n    '
QOS = "qos_overrides: {/left/joint_states: {publisher: {reliability: %s, depth: %s}}}"


def under(*lines):
    """Parameters of every node."""
    return HEAD + '\n    '.join(lines) + '\n'


# By name: the text, and what the answer has: a value by name, or words of a message.
GOOD = {
    'defaults': (under('{}'), {'beam.E': 2e9}),
    'nested': (under('wire: {E_A: 11.0e+9}'), {'wire.E_A': 11e9}),
    'dotted': (under('wire.E_A: 11.0e+9'), {'wire.E_A': 11e9}),
    'nested and dotted': (under('wire: {E_A: 11.0e+9}', 'wire.E_M: 7.0e+9'), {'wire.E_A': 11e9, 'wire.E_M': 7e9}),
    'dotted below nested': (under('effects: {active: [gravity], gravity.g_y: 5.0}'), {'effects.gravity.g_y': 5.0}),
    'exponent without sign': (under('beam.E: 3.0e9'), {'beam.E': 3e9}),
    'exponent without point': (under('beam.E: 3e9'), {'beam.E': 3e9}),
    'capital exponent': (under('beam.E: 3E9'), {'beam.E': 3e9}),
    'point at the end': (under('beam.E: 3.e9'), {'beam.E': 3e9}),
    'point at the start': (under('beam.L: .12'), {'beam.L': 0.12}),
    'plus sign': (under('beam.E: +3.0e+9'), {'beam.E': 3e9}),
    'whole number': (under('beam.E: 3000000000'), {'beam.E': 3e9}),
    'leading zero': (under('wire.n: 010'), {'wire.n': 10.0}),
    'nan where it means something': (under('initial.x_M_1: .nan'), {}),
    'qos overrides only': (under(QOS % ('best_effort', 1)), {'beam.E': 2e9}),
    'use_sim_time only': (under('use_sim_time: true'), {'beam.E': 2e9}),
    'both of ROS': (under('use_sim_time: false', QOS % ('reliable', 5)), {'beam.E': 2e9}),
    'type description service': (under('start_type_description_service: false'), {}),
    'name of the node': ('sma_module_sim:\n  ros__parameters:\n    model: mas\n', {'model': 'mas'}),
    'name with slash': ('/sma_module_sim:\n  ros__parameters:\n    model: mas\n', {'model': 'mas'}),
    'any name': ('/*:\n  ros__parameters:\n    model: mas\n', {'model': 'mas'}),
    'any namespace': ('/**/sma_module_sim:\n  ros__parameters:\n    model: mas\n', {'model': 'mas'}),
    'nested any namespace': ('/**:\n  sma_module_sim:\n    ros__parameters:\n      model: mas\n', {'model': 'mas'}),
    'two sections': (
        under('wire: {E_A: 11.0e+9}') + 'sma_module_sim:\n  ros__parameters:\n    wire: {E_M: 7.0e+9}\n',
        {'wire.E_A': 11e9, 'wire.E_M': 7e9},
    ),
    'the later section wins': (
        under('beam.E: 1.0e+9') + 'sma_module_sim:\n  ros__parameters:\n    beam: {E: 3.0e+9}\n',
        {'beam.E': 3e9},
    ),
    'sections of others': (under('model: mas') + 'camera:\n  ros__parameters:\n    exposure: 3\n', {'model': 'mas'}),
    'plain mapping': ('wire: {E_A: 11.0e9}\nmodel: mas\n', {'wire.E_A': 11e9, 'model': 'mas'}),
    'merged, and changed': (
        under('wire: &w {n: 12.0, E_M: 7.0e9}') + f'{NAME}:\n  ros__parameters:\n    wire: {{<<: *w, E_M: 6.0e9}}\n',
        {'wire.n': 12.0, 'wire.E_M': 6e9},
    ),
    'anchor': (under('wire: {E_A: &E 11.0e9, E_M: *E}'), {'wire.E_M': 11e9}),
    'switch as word': (under('node.publish_clock: yes'), {'node.publish_clock': True}),
    'text that is a number': (under("node.joint_prefix: '12'"), {'node.joint_prefix': '12'}),
    'date as text': (under('node.record: 2026-01-01'), {'node.record': '2026-01-01'}),
    'time as text': (under('node.record: 1:30'), {'node.record': '1:30'}),
    'effect without entries': (under("effects: {active: ['']}"), {'effects.active': []}),
    'effect as one word': (under('effects: {active: gravity}'), {'effects.active': ['gravity']}),
    'unusual, but meant': (under("wire.sigma_T: '8.0 Pa/K'", "plate.W: 5 m"), {'wire.sigma_T': 8.0, 'plate.W': 5.0}),
    'slider': (under('system: slider', 'slider: {wires: 2}'), {'system': 'slider'}),
}
BAD = {
    'celsius': (under('environment.T_E: 25.0'), 'T_E = 25 K', 'expected 150 to 2000 K\n25 deg C are 298.15 K'),
    'reference in celsius': (under('wire.T0: 50'), 'wire.T0 = 50 K', '323.15 K'),
    'megapascal': (under('wire.sigma_T: 8.0'), 'did you mean 8 MPa/K, 8e+06?', "give it with its unit: '8.0 Pa/K'"),
    'gram per cubic centimetre': (under('wire: {rho: 6.45}'), 'did you mean 6.45 g/cm^3, 6450?'),
    'gigapascal': (under('wire.E_A: 60'), 'expected 1e+08 to 1e+12 Pa\n60 GPa are 6e+10 Pa'),
    'millimetres': (under('wire.l0: 95.7'), '95.7 mm are 0.0957 m'),
    'width in millimetres': (under('plate.W: 10'), 'did you mean 10 mm, 0.01?'),
    'gram': (under('plate.m_H: 10'), 'did you mean 10 g, 0.01?'),
    'percent': (under('wire.eps_T: 6.7'), '6.7 % are 0.067'),
    'degrees': (
        under('effects: {active: [sensor_misalignment], sensor_misalignment.theta: 1.2}'),
        'did you mean 1.2 deg, 0.020944?',
    ),
    'effect in celsius': (under('effects: {active: [r_phase], r_phase.T_R: 40}'), '40 deg C are 313.15 K'),
    'too hot': (under('environment.T_E: 3000.0'), 'expected 150 to 2000 K'),
    'number in quotes': (under("beam.E: '3.0e9'"), "beam.E = '3.0e9'", 'write 3e+09 without quotes'),
    'word': (under('beam.E: much'), "beam.E = 'much'", 'expected a number in Pa'),
    'unit': (under('beam.L: 120 mm'), "beam.L = '120 mm'", 'expected a number in m'),
    'switch for a number': (under('beam.E: true'), 'beam.E = True', 'expected a number'),
    'list for a number': (under('beam.E: [1.0, 2.0]'), 'beam.E = [1.0, 2.0]', 'expected a number'),
    'time for a number': (under('beam.L: 1:30'), "beam.L = '1:30'", 'expected a number in m'),
    'no value': (under('wire: {E_A: }'), 'wire.E_A = None', 'expected a number in Pa'),
    'infinite': (under('beam.E: .inf'), 'beam.E = inf', 'expected 100000 to'),
    'nan': (under('beam.E: .nan'), 'beam.E = nan', 'expected 100000 to'),
    'out of range': (under('beam.L: -1.0'), 'beam.L = -1 m', 'expected 0.001 to 10 m'),
    'unknown name': (under('wire: {E_a: 1.0e9}'), 'unknown parameter wire.E_a', 'did you mean wire.E_'),
    'unknown group': (under('wires: {E_A: 1.0e9}'), 'unknown parameter wires.E_A'),
    'nested too deep': (under('wire: {E_A: {value: 1.0e9}}'), 'unknown parameter wire.E_A.value'),
    'unknown effect': (under('effects: {active: [gravty]}'), 'unknown effect gravty', 'did you mean gravity'),
    'unknown system': (under('system: robot'), "system = 'robot'", 'expected one of'),
    'unknown model': (under('model: 3'), 'model = 3', 'expected one of hybrid, mas'),
    'wrong switch': (under('node.publish_clock: maybe'), "node.publish_clock = 'maybe'", 'expected true or false'),
    'number for a text': (under('node.record: 3'), 'node.record = 3', 'expected a text'),
    'wrong policy': (under(QOS % ('sometimes', 1)), 'reliability', "'sometimes'", 'reliable or best_effort'),
    'wrong depth': (under(QOS % ('reliable', 0)), 'depth = 0', 'expected a whole number of messages'),
    'wrong entity': (under('qos_overrides: {/J_eq: {reader: {depth: 1}}}'), 'expected qos_overrides.TOPIC.publisher.POLICY'),
    'wrong use_sim_time': (under("use_sim_time: 'yes'"), "use_sim_time = 'yes'", 'expected true or false'),
    'nothing for this node': (
        '/other:\n  ros__parameters:\n    model: mas\n',
        'has nothing for this node',
        'expected /**: or /sma_module_sim: above ros__parameters, got /other',
    ),
    'beside the names of nodes': (under('model: mas') + 'wire: {E_A: 1.0e9}\n', 'wire stands beside the names of nodes'),
    'no mapping below': ('/**:\n  ros__parameters: [1, 2]\n', 'expected a mapping below ros__parameters, got list'),
    'nothing below': ('/**:\n  ros__parameters:\n', 'expected a mapping below ros__parameters, got NoneType'),
    'empty': ('', 'expected a mapping of parameters, got NoneType'),
    'a text': ('hello\n', 'expected a mapping of parameters, got str'),
    'no YAML': ('/**: {ros__parameters: [\n', 'is not YAML'),
    'tabs': ('/**:\n\tros__parameters:\n', 'is not YAML'),
    'a key twice': (
        under('node:', '  J_max: 5.0', 'wire: {n: 10.0}', 'node:', '  command_timeout: 5.0'),
        'is not YAML: line 6, column 5: node is there twice, first in line 3: expected it once, with all that belongs to it',
    ),
    'a quoted key twice': (under('wire: {n: 10.0, "n": 5.0}'), 'line 3, column 21: n is there twice, first in line 3'),
    'a section twice': (under('model: mas') + under('beam.E: 3e9'), '/** is there twice, first in line 1'),
    'code': (under('beam.E: !!python/object/apply:os.system [ls]'), 'is not YAML'),
}


@pytest.fixture(scope='module')
def context():
    made = rclpy.Context()
    rclpy.init(context=made, args=[], domain_id=103)
    yield made
    rclpy.try_shutdown(context=made)


def of_node(context, *words):
    """What the node makes of its arguments: its configuration, and what it was given of ROS."""
    left, given = read_arguments(['--ros-args', *words], NAME)
    node = ParameterNode(
        NAME,
        context=context,
        cli_args=left,
        use_global_arguments=False,
        parameter_overrides=overrides_of(given),
        automatically_declare_parameters_from_overrides=True,
        start_parameter_services=False,
    )
    try:
        config = configure(node, in_files=given)
        return config, take_overrides(node), node.get_parameter('use_sim_time').value
    finally:
        node.destroy_node()


@pytest.mark.parametrize('name', GOOD)
def test_both_read_the_same(context, tmp_path, name):
    text, expected = GOOD[name]
    file = tmp_path / 'robot.yaml'
    file.write_text(text)
    offline = flat_parameters(read_config(file))
    config, overrides, follows_clock = of_node(context, '--params-file', str(file))
    assert repr(flat_parameters(config)) == repr(offline)  # of NaN too
    assert {name: offline[name] for name in expected} == expected
    assert bool(overrides) == ('qos_overrides' in text) and follows_clock == ('use_sim_time: true' in text)


@pytest.mark.parametrize('name', BAD)
def test_both_refuse_with_the_same_words(context, tmp_path, capsys, name):
    text, *expected = BAD[name]
    file = tmp_path / 'robot.yaml'
    file.write_text(text)
    with pytest.raises(UserError) as offline:
        read_config(file)
    with pytest.raises(UserError) as online:
        of_node(context, '--params-file', str(file))
    assert str(online.value) == str(offline.value)
    assert all(words in str(offline.value) for words in [*expected, str(file)])
    assert main(['simulate', '--input', 'none.csv', '--out', str(tmp_path / 'out.csv'), '--config', str(file)]) == 2
    assert str(offline.value) in capsys.readouterr().err


def files(folder, *texts):
    """Arguments with a file for each text."""
    words = []
    for number, text in enumerate(texts, 1):
        (folder / f'{number}.yaml').write_text(text)
        words += ['--params-file', str(folder / f'{number}.yaml')]
    return words


def test_of_several_files_the_one_that_is_wrong_is_named(context, tmp_path):
    words = files(tmp_path, under('beam.E: 3.0e9'), under('beam.L: -1.0'), under('model: mas'))
    with pytest.raises(UserError, match=r'beam\.L = -1 m \(in .*2\.yaml\)'):
        of_node(context, *words)
    words = files(tmp_path, under("effects: {paths: ['mine']}"), under('model: mas'))
    with pytest.raises(UserError, match=f'{tmp_path}/mine'):
        of_node(context, *words)


def test_the_later_argument_wins(context, tmp_path):
    words = files(tmp_path, under('beam.E: 3.0e9', 'beam.L: 0.11'), under('beam.E: 4.0e9'))
    config, _, _ = of_node(context, *words)
    assert (config.parameters['beam.E'], config.parameters['beam.L']) == (4e9, 0.11)
    config, _, _ = of_node(context, *words, '-p', 'beam.E:=5e9', '-p', f'{NAME}:beam.L:=0.12')
    assert (config.parameters['beam.E'], config.parameters['beam.L']) == (5e9, 0.12)


@pytest.mark.parametrize(
    ('words', 'J_max'),
    [
        (['-p', 'node.J_max:=7.0'], 7.0),
        (['-p', f'{NAME}:node.J_max:=7.0'], 7.0),
        (['-p', 'other_node:node.J_max:=30.0'], 5.0),
        (['-r', '__ns:=/left', '-p', f'{NAME}:node.J_max:=30.0'], 5.0),
        (['-r', '__node:=arm', '-p', f'{NAME}:node.J_max:=30.0'], 5.0),
        (['-r', '__node:=arm', '-p', 'arm:node.J_max:=7.0'], 7.0),
    ],
)
def test_what_is_given_to_another_node_leaves_the_file(context, tmp_path, words, J_max):
    """rcl takes the word before a parameter for the full name of a node in no namespace."""
    config, _, _ = of_node(context, *files(tmp_path, under('node: {J_max: 5.0}')), *words)
    assert config.parameters['node.J_max'] == J_max


def test_a_file_for_other_nodes_may_stand_beside_one_for_ours(context, tmp_path):
    other = 'camera:\n  ros__parameters:\n    exposure: 3\n'
    config, _, _ = of_node(context, *files(tmp_path, other, under('model: mas')))
    assert config.model == 'mas'
    with pytest.raises(UserError, match=r'1\.yaml has nothing for this node'):
        of_node(context, *files(tmp_path, other, other), '-p', 'model:=mas')


def test_the_section_of_the_nodes_namespace_is_read(context, tmp_path):
    sections = {'/left': 'mas', '/right': 'hybrid'}
    text = ''.join(f'{space}:\n  {NAME}:\n    ros__parameters: {{model: {kind}}}\n' for space, kind in sections.items())
    for space, kind in sections.items():
        assert of_node(context, *files(tmp_path, text), '-r', f'__ns:={space}')[0].model == kind
    with pytest.raises(UserError, match='parameters in several namespaces, /left, /right: expected a file for each'):
        read_config(tmp_path / '1.yaml')
    (tmp_path / '1.yaml').write_text(f'/left/{NAME}: {{ros__parameters: {{model: mas}}}}\n')
    assert read_config(tmp_path / '1.yaml').model == 'mas'
    assert of_node(context, '--params-file', str(tmp_path / '1.yaml'), '-r', f'{NAME}:__ns:=/left')[0].model == 'mas'
    text = text.replace(NAME, 'arm')
    assert of_node(context, *files(tmp_path, text), '-r', '__ns:=/left', '-r', '__node:=arm')[0].model == 'mas'


def test_ambient_temperature_of_a_table_is_not_in_celsius(tmp_path, capsys):
    table = tmp_path / 'command.csv'
    table.write_text('time_s,J_eq_W,T_E_K\n0,5,25\n1,5,25\n')
    assert main(['simulate', '--input', str(table), '--out', str(tmp_path / 'out.csv')]) == 2
    assert 'T_E_K: expected kelvin between 150 and 2000, got 25\n25 deg C are 298.15 K' in capsys.readouterr().err
