"""`ros2 param dump` and `ros2 param load` on a running node, by the services and the client that these commands call."""

import pytest
import yaml

from sma_sim import read_config
from sma_sim.model.program_parameters import DEFAULTS

ros_client = pytest.importorskip('ros_client', reason='rclpy is not installed', exc_type=ImportError)
from rcl_interfaces.srv import GetParameters, ListParameters  # noqa: E402
from rclpy.parameter import parameter_dict_from_yaml_file, parameter_value_to_python  # noqa: E402
from rclpy.parameter_client import AsyncParameterClient  # noqa: E402

from sma_sim.ros.parameter_node import same_value  # noqa: E402

NODE = '/left/sma_module_sim'


def ask(one, kind, service, **request):
    """What a service of the node answers."""
    return one.ask(kind, f'{NODE}/{service}', kind.Request(**request))


def dump(one, file):
    """Write all parameters as `ros2 param dump` does; their names."""
    names = sorted(ask(one, ListParameters, 'list_parameters').result.names)
    values = map(parameter_value_to_python, ask(one, GetParameters, 'get_parameters', names=names).values)
    tree = {}
    for name, value in zip(names, values, strict=True):
        *groups, last = name.split('.')
        branch = tree
        for group in groups:
            branch = branch.setdefault(group, {})
        branch[last] = list(value) if hasattr(value, 'tolist') else value
    file.write_text(yaml.dump({NODE: {'ros__parameters': tree}}, default_flow_style=False))
    return names


def load(one, file):
    """Load a file as `ros2 param load` does; the answers by name."""
    client = AsyncParameterClient(one.node, NODE)
    one.until(client.services_are_ready)
    future = client.load_parameter_file(str(file), use_wildcard=True)
    one.until(future.done)
    nodes = list(yaml.safe_load(file.read_text()))  # Jazzy wants those that the file has
    names = [value.name for value in parameter_dict_from_yaml_file(str(file), True, nodes).values()]
    return dict(zip(names, future.result().results, strict=True))


def test_a_dump_loads_whole_and_what_cannot_be_set_is_said(tmp_path):
    words = ('-p', 'wire.omega_x:=120.0', '-p', "node.joint_prefix:='12'", '-r', '__ns:=/left')
    with ros_client.Simulation(*words, namespace='/left') as one:
        names = dump(one, tmp_path / 'same.yaml')
        answers = load(one, tmp_path / 'same.yaml')
        assert set(answers) == set(names) and set(DEFAULTS) <= set(names)
        assert not {name: answer.reason for name, answer in answers.items() if not answer.successful}
        changed = {
            'wire': {'r0': 1e-4, 'omega_x': 120},
            'environment': {'T_E': 305},
            'solver': {'rtol': 1e-5, 'rtoll': 1.0},
            'model': 'mas',
            'effects': {'active': ['gravity']},
            'node': {'record': 'run1'},
        }
        (tmp_path / 'other.yaml').write_text(yaml.dump({'/**': {'ros__parameters': changed}}))
        answers = load(one, tmp_path / 'other.yaml')
        refused = {name: answer.reason for name, answer in answers.items() if not answer.successful}
        assert set(refused) == {'wire.r0', 'solver.rtoll', 'model', 'effects.active', 'node.record'}
        assert 'read-only while the node runs: it is 7.5e-05, not 0.0001. Give it when the node starts' in refused['wire.r0']
        assert 'unknown parameter solver.rtoll; did you mean solver.rtol' in refused['solver.rtoll']
        T_E = ask(one, GetParameters, 'get_parameters', names=['environment.T_E']).values[0]
        assert T_E.double_value == 305.0
        assert one.stop()[0] == 0
    assert read_config(tmp_path / 'same.yaml').parameters['wire.omega_x'] == 120.0  # offline, too


def test_the_node_leaves_priors_aside():
    words = ('-p', 'priors.wire.E_A:=5.0e+8', '-p', 'wire.E_A:=6.0e+10', '-r', '__ns:=/left')
    with ros_client.Simulation(*words, namespace='/left') as one:
        names = ask(one, ListParameters, 'list_parameters').result.names
        assert 'wire.E_A' in names and not [name for name in names if name.startswith('priors')]
        assert one.stop()[0] == 0


@pytest.mark.parametrize(
    ('given', 'present', 'same'),
    [
        (float('nan'), float('nan'), True),
        (1.0, 1.0, True),
        (1.0, 2.0, False),
        ([], [''], True),
        (['a'], [''], False),
        (['a'], ['a'], True),
        ('', 'a', False),
        ('a', 'a', True),
        (True, True, True),
        (1, True, False),
        ('1', 1.0, False),
    ],
)
def test_values_that_are_the_same(given, present, same):
    assert same_value(given, present) is same
