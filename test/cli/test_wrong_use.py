"""Everything wrong that a person or a program may do to the node: a message that helps, a node that goes on or ends."""

import math
import time

import pytest

ros_client = pytest.importorskip('ros_client', reason='rclpy is not installed', exc_type=ImportError)
import rclpy  # noqa: E402
from rcl_interfaces.msg import Parameter as ParameterMessage  # noqa: E402
from rcl_interfaces.srv import GetParameters, SetParameters  # noqa: E402
from rclpy.parameter import Parameter, parameter_value_to_python  # noqa: E402
from sensor_msgs.msg import JointState, Temperature  # noqa: E402
from std_msgs.msg import Float64  # noqa: E402
from std_srvs.srv import SetBool, Trigger  # noqa: E402

from sma_sim.model.errors import UserError  # noqa: E402
from sma_sim.model.program_parameters import DEFAULTS, SETTINGS  # noqa: E402
from sma_sim.ros.main import PROGRAM  # noqa: E402
from sma_sim.ros.parameters import configure  # noqa: E402

WRONG_NUMBERS = {
    'text': lambda p: 'much',
    'switch': lambda p: True,
    'list': lambda p: [1.0, 2.0],
    'too small': lambda p: p.bounds[0] - 1.0 - abs(p.bounds[0]),
    'too large': lambda p: 2.0 * p.bounds[1] + 1.0,
    'infinite': lambda p: math.inf,
}
WRONG_WORDS = {
    'system': ['robot', 3, True],
    'model': ['mass', 3.0],
    'effects.active': [3, [1.0], ['nothing']],
    'effects.paths': [3, ['/nowhere']],
    'node.record': [3, True],
    'node.publish_clock': ['maybe', 3],
    'node.stamps_follow_clock': ['maybe', 3],
}


@pytest.fixture(scope='module')
def context():
    made = rclpy.Context()
    rclpy.init(context=made, domain_id=103)
    yield made
    rclpy.try_shutdown(context=made)


def complaint(context, name, value):
    """What the node says of a parameter that is given at its start."""
    node = rclpy.create_node(
        'wrong',
        context=context,
        automatically_declare_parameters_from_overrides=True,
        parameter_overrides=[Parameter(name, value=value)],
    )
    try:
        with pytest.raises(UserError) as told:
            configure(node)
        return str(told.value)
    finally:
        node.destroy_node()


@pytest.mark.parametrize('kind', WRONG_NUMBERS)
@pytest.mark.parametrize('name', DEFAULTS)
def test_wrong_numbers_at_the_start(context, name, kind):
    said = complaint(context, name, WRONG_NUMBERS[kind](DEFAULTS[name]))
    assert f'{name} = ' in said and 'expected' in said and ' - ' not in said
    assert DEFAULTS[name].unit.removeprefix('-') in said


@pytest.mark.parametrize(('name', 'value'), [(name, value) for name, values in WRONG_WORDS.items() for value in values])
def test_wrong_words_at_the_start(context, name, value):
    said = complaint(context, name, value)
    assert name in said and ('expected' in said or 'unknown' in said or 'not a folder' in said)


@pytest.fixture(scope='module')
def running():
    """A node that all of the following is done to."""
    topics = ((JointState, 'joint_states'), (Float64, 'J_eq_applied'), (Temperature, 'wire_1/temperature'))
    with ros_client.Simulation('-p', 'node.command_timeout:=1.0', topics=topics) as one:
        one.until(lambda: one.seen['joint_states'], ros_client.FIRST_MESSAGE)
        yield one
        code, log = one.stop()
        assert code == 0 and 'Traceback' not in log, log


def call(one, kind, name, request):
    client = one.node.create_client(kind, f'/sma_module_sim/{name}')
    one.until(client.service_is_ready)
    future = client.call_async(request)
    one.until(future.done)
    return future.result()


def lives(one):
    """The node goes on stepping."""
    count = len(one.seen['joint_states'])
    one.until(lambda: len(one.seen['joint_states']) > count + 5)


def set_parameter(one, name, value):
    message = value if isinstance(value, ParameterMessage) else Parameter(name, value=value).to_parameter_msg()
    return call(one, SetParameters, 'set_parameters', SetParameters.Request(parameters=[message])).results[0]


def result_of_another_value(one, name, asked):
    """The refusal of a value of the same type that the parameter does not have."""
    value = parameter_value_to_python(asked)
    if isinstance(value, float):
        other = 0.5 if math.isnan(value) else value + 1.0
    else:
        other = {bool: not value, str: f'{value}_x'}.get(type(value), ['x'])
    result = set_parameter(one, name, other)
    assert 'read-only while the node runs' in result.reason and 'Give it when the node starts' in result.reason
    return result


@pytest.mark.parametrize('name', [*DEFAULTS, *SETTINGS, 'system', 'model', 'effects.active', 'effects.gravity.g_y'])
def test_parameters_are_read_only_while_it_runs(running, name):
    asked = call(running, GetParameters, 'get_parameters', GetParameters.Request(names=[name])).values[0]
    result = set_parameter(running, name, ParameterMessage(name=name, value=asked))
    assert result.successful, result.reason  # what it is may be set, so that `ros2 param load` takes a dump
    if name not in PROGRAM.live:
        assert not result_of_another_value(running, name, asked).successful


@pytest.mark.parametrize('value', [math.nan, math.inf, -math.inf, -1.0, 0.0, 5000.0, 'hot', True, [300.0]])
def test_wrong_ambient_temperature_by_parameter(running, value):
    result = set_parameter(running, 'environment.T_E', value)
    assert not result.successful and result.reason
    lives(running)


def test_unknown_parameter(running):
    assert not set_parameter(running, 'wire.E_X', 1.0).successful
    assert not set_parameter(running, 'use_sim_time', True).successful


@pytest.mark.parametrize('value', [math.nan, math.inf, -math.inf, 1e308, -1e308, 5e-324])
@pytest.mark.parametrize('kind', ['J_eq', 'ambient_temperature'])
def test_wrong_messages(running, kind, value):
    message = Float64(data=value) if kind == 'J_eq' else Temperature(temperature=value)
    publisher = running.publisher(type(message), kind)
    publisher.publish(message)
    lives(running)
    assert all(math.isfinite(m.data) and abs(m.data) <= 30.0 for m in running.seen['J_eq_applied'])
    assert all(math.isfinite(x) for x in running.seen['joint_states'][-1].position)


@pytest.mark.parametrize('payload', [b'', b'\0', b'\0\1\0\0', b'\0\1\0\0\1\2', b'\xff' * 5, b'\0\1\0\0' + b'x' * 10_000])
@pytest.mark.parametrize('kind', [Float64, Temperature])
def test_broken_bytes_on_a_topic(running, kind, payload):
    publisher = running.publisher(kind, 'J_eq' if kind is Float64 else 'ambient_temperature')
    try:
        publisher.publish(payload)
    except Exception:
        return  # refused by the sender's own middleware
    lives(running)
    assert call(running, SetBool, 'pause', SetBool.Request(data=False)).success


def test_services_in_wrong_states(running):
    def pause(on):
        return call(running, SetBool, 'pause', SetBool.Request(data=on))

    assert pause(False).message == 'running (as before)'
    assert 'pause first' in call(running, Trigger, 'step', Trigger.Request()).message
    assert pause(True).success and pause(True).message == 'paused (as before)'
    assert call(running, Trigger, 'reset', Trigger.Request()).success
    assert call(running, Trigger, 'step', Trigger.Request()).success
    assert pause(False).success
    lives(running)


def test_a_flood_of_commands_and_its_end(running):
    """10,000 commands a second: the steps go on, and the heating goes off when the commands end."""
    publisher = running.publisher(Float64, 'J_eq')
    begin, count = time.monotonic(), len(running.seen['joint_states'])
    for k in range(10_000):
        publisher.publish(Float64(data=float(k % 7)))
        if k % 10 == 0:
            time.sleep(max(0.0, begin + k / 10_000 - time.monotonic()))
    running.until(lambda: len(running.seen['joint_states']) > count + 20)
    running.until(lambda: running.seen['J_eq_applied'][-1].data == 0.0)
    lives(running)
