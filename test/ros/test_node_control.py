"""Pausing, stepping and resetting the node, and what its parameters and /diagnostics say of it."""

import math
import signal
import threading
import time
from types import SimpleNamespace

import pytest

ros_client = pytest.importorskip('ros_client', reason='rclpy is not installed', exc_type=ImportError)
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus  # noqa: E402
from rcl_interfaces.srv import GetParameters, SetParameters, SetParametersAtomically  # noqa: E402
from rclpy.parameter import Parameter  # noqa: E402
from sensor_msgs.msg import JointState, Temperature  # noqa: E402
from std_msgs.msg import Float64  # noqa: E402
from std_srvs.srv import SetBool, Trigger  # noqa: E402

from sma_sim.evidence.data.rosbag.reader import read_bag  # noqa: E402
from sma_sim.ros.control import Control, Refused  # noqa: E402


def stamp(message):
    return message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec


def last_stamp(one, messages):
    """The last stamp of a simulation that is paused, once no message is on its way any more."""
    count = -1
    while count < len(messages):
        count, end = len(messages), time.monotonic() + 0.5
        one.until(lambda end=end: time.monotonic() > end)
    return stamp(messages[-1])


def call(one, kind, name, **fields):
    return one.ask(kind, f'/sma_module_sim/{name}', kind.Request(**fields))


def test_pause_step_and_reset():
    topics = ((JointState, 'joint_states'), (Temperature, 'wire_1/temperature'), (Float64, 'J_eq_applied'))
    with ros_client.Simulation('-p', 'node.publish_rate:=1000.0', topics=topics) as one:
        seen, heat = one.seen['joint_states'], one.seen['wire_1/temperature']
        one.until(lambda: seen, ros_client.FIRST_MESSAGE)
        assert not call(one, Trigger, 'step').success
        command = one.publisher(Float64, 'J_eq')
        command.publish(Float64(data=12.0))
        one.until(lambda: heat[-1].temperature > 40.0)
        assert call(one, SetBool, 'pause', data=True).message == 'paused'
        assert call(one, SetBool, 'pause', data=True).message == 'paused (as before)'
        assert call(one, Trigger, 'step').success
        before = last_stamp(one, seen)
        for _ in range(3):
            assert call(one, Trigger, 'step').success
        assert last_stamp(one, seen) == pytest.approx(before + 0.003, abs=1e-6)
        assert call(one, Trigger, 'reset').success
        one.until(lambda: heat[-1].temperature == pytest.approx(298.0 - 273.15))
        assert call(one, SetBool, 'pause', data=False).message == 'running'
        count = len(seen)
        one.until(lambda: len(seen) > count + 50)
        assert heat[-1].temperature == pytest.approx(298.0 - 273.15)
        assert one.stop()[0] == 0


def test_as_fast_as_possible_and_diagnostics():
    topics = ((JointState, 'joint_states'), (DiagnosticArray, '/diagnostics'))
    with ros_client.Simulation('-p', 'node.real_time_factor:=0.0', topics=topics) as one:
        one.until(lambda: one.seen['/diagnostics'], ros_client.FIRST_MESSAGE)
        status = one.seen['/diagnostics'][-1].status[0]
        values = {value.key: value.value for value in status.values}
        assert status.name == '/sma_module_sim' and status.message == 'running'
        assert values['overruns'] == '0' and values['rejected commands'] == '0'
        assert float(values['real-time factor']) > 0.0 and math.isfinite(float(values['simulated time [s]']))
        assert one.stop()[0] == 0


def T_E_parameter(one):
    """The parameter environment.T_E [K]."""
    return call(one, GetParameters, 'get_parameters', names=['environment.T_E']).values[0].double_value


def test_a_refused_set_of_parameters_changes_nothing():
    topics = ((JointState, 'joint_states'), (Float64, 'T_E_applied'))
    with ros_client.Simulation(topics=topics) as one:
        one.until(lambda: one.seen['joint_states'] and one.seen['T_E_applied'], ros_client.FIRST_MESSAGE)
        values = [Parameter('environment.T_E', value=350.0).to_parameter_msg()]
        refused = (
            Parameter('use_sim_time', value=True),
            Parameter('use_sim_time', value='yes'),
            Parameter('wire.r0', value=1.0),
        )
        for other in refused:
            request = {'parameters': [*values, other.to_parameter_msg()]}
            assert not call(one, SetParametersAtomically, 'set_parameters_atomically', **request).result.successful
        count = len(one.seen['joint_states'])
        one.until(lambda: len(one.seen['joint_states']) > count + 20)
        assert [message.data for message in one.seen['T_E_applied']] == [298.0] and T_E_parameter(one) == 298.0
        answers = call(one, SetParameters, 'set_parameters', **request).results  # each by itself
        assert [answer.successful for answer in answers] == [True, False]
        one.until(lambda: one.seen['T_E_applied'][-1].data == 350.0)
        assert one.stop()[0] == 0


def test_the_parameter_shows_the_ambient_temperature_in_force():
    topics = ((JointState, 'joint_states'), (Float64, 'T_E_applied'))
    with ros_client.Simulation(topics=topics) as one:
        ambient = one.publisher(Temperature, 'ambient_temperature')
        one.until(lambda: one.seen['T_E_applied'], ros_client.FIRST_MESSAGE)
        ambient.publish(Temperature(temperature=40.0))
        one.until(lambda: one.seen['T_E_applied'][-1].data == pytest.approx(313.15))
        assert T_E_parameter(one) == one.seen['T_E_applied'][-1].data
        assert one.stop()[0] == 0


def set_parameters(one, **values):
    """Set parameters node.* and return whether all were set, and the first reason."""
    parameters = [Parameter(f'node.{name}', value=value).to_parameter_msg() for name, value in values.items()]
    results = call(one, SetParameters, 'set_parameters', parameters=parameters).results
    return all(result.successful for result in results), next((r.reason for r in results if r.reason), '')


def test_limits_and_pace_can_be_set_while_the_node_runs():
    topics = ((JointState, 'joint_states'), (Float64, 'J_eq_applied'), (DiagnosticArray, '/diagnostics'))
    with ros_client.Simulation('-p', 'node.publish_rate:=10.0', topics=topics) as one:  # else messages set the fastest pace
        applied = one.seen['J_eq_applied']
        command = one.publisher(Float64, 'J_eq')
        one.until(lambda: one.seen['joint_states'], ros_client.FIRST_MESSAGE)
        command.publish(Float64(data=20.0))
        one.until(lambda: applied and applied[-1].data == 20.0)
        assert set_parameters(one, J_max=8.0)[0]
        one.until(lambda: applied[-1].data == 8.0)  # the one in force is clipped at once
        command.publish(Float64(data=-20.0))
        one.until(lambda: applied[-1].data == -8.0)
        assert set_parameters(one, command_timeout=0.1)[0]
        one.until(lambda: applied[-1].data == 0.0)
        assert set_parameters(one, real_time_factor=0.0)[0]
        one.until(lambda: one.seen['/diagnostics'] and float(diagnosed(one)[1]['real-time factor']) > 1.5)
        assert set_parameters(one, real_time_factor=0.01)[0]
        one.until(lambda: float(diagnosed(one)[1]['real-time factor']) < 0.1)
        assert stamp(one.seen['joint_states'][-1]) >= stamp(one.seen['joint_states'][0])
        for wrong in (
            {'J_max': -1.0},
            {'command_timeout': math.nan},
            {'real_time_factor': 1e9},
            {'publish_rate': 50.0},
            {'steps_per_call': 1.5},
        ):
            assert not set_parameters(one, **wrong)[0]
        assert call(one, GetParameters, 'get_parameters', names=['node.J_max']).values[0].double_value == 8.0
        assert one.stop()[0] == 0


def test_a_node_that_follows_a_clock_refuses_another_pace():
    with ros_client.Simulation('-p', 'use_sim_time:=true') as one:
        client = one.node.create_client(SetParameters, '/sma_module_sim/set_parameters')
        one.until(client.service_is_ready, ros_client.FIRST_MESSAGE)
        done, reason = set_parameters(one, real_time_factor=2.0)
        assert not done and '/clock sets the pace' in reason
        assert one.stop()[0] == 0


def test_reset_brings_back_the_ambient_temperature_of_the_start():
    topics = ((JointState, 'wire_states'), (Temperature, 'wire_1/temperature'), (Float64, 'T_E_applied'))
    with ros_client.Simulation('-p', 'environment.T_E:=300.0', topics=topics) as one:
        heat, applied, wires = (one.seen[topic] for topic in ('wire_1/temperature', 'T_E_applied', 'wire_states'))
        ambient = one.publisher(Temperature, 'ambient_temperature')
        one.until(lambda: wires, ros_client.FIRST_MESSAGE)
        first = list(wires[0].effort)
        ambient.publish(Temperature(temperature=60.0))
        one.until(lambda: heat and heat[-1].temperature > 50.0)
        assert 'ambient temperature' in call(one, Trigger, 'reset').message
        one.until(lambda: applied[-1].data == 300.0 and heat[-1].temperature == pytest.approx(300.0 - 273.15))
        count = len(wires)
        one.until(lambda: len(wires) > count + 20)
        assert list(wires[-1].effort) == pytest.approx(first, rel=1e-6) and T_E_parameter(one) == 300.0
        assert one.stop()[0] == 0


def diagnosed(one):
    """The latest status of the node, and its values by name."""
    status = one.seen['/diagnostics'][-1].status[0]
    return status, {value.key: value.value for value in status.values}


def test_diagnostics_tell_of_the_command_and_its_publishers():
    words = ('-p', 'node.command_timeout:=0.5', '-r', 'J_eq:=/heater/power')
    with ros_client.Simulation(*words, topics=((DiagnosticArray, '/diagnostics'),)) as one:
        command = one.publisher(Float64, '/heater/power')
        one.until(lambda: one.seen['/diagnostics'], ros_client.FIRST_MESSAGE)
        status, values = diagnosed(one)
        assert status.hardware_id == 'simulated SMA module' and values['command'] == 'none since the start'
        assert abs(float(values['stamps behind the clock [s]'])) < 60.0
        command.publish(Float64(data=5.0))
        one.until(lambda: 'command timed out' in diagnosed(one)[0].message)
        status, values = diagnosed(one)
        assert status.level == DiagnosticStatus.WARN and values['command timeouts'] == '1'
        second = one.publisher(Float64, '/heater/power')
        one.until(lambda: 'the command has several publishers, on J_eq: the last' in diagnosed(one)[0].message)
        one.node.destroy_publisher(second)
        stamped = one.publisher(JointState, 'J_eq_stamped')
        one.until(lambda: 'several publishers, on J_eq and J_eq_stamped: the last' in diagnosed(one)[0].message)
        one.node.destroy_publisher(stamped)
        command.publish(Float64(data=0.0))
        one.until(lambda: 'several' not in diagnosed(one)[0].message and diagnosed(one)[1]['command'] == 'timed out')
        assert 'timed out' not in diagnosed(one)[0].message  # it was zero
        assert one.stop()[0] == 0


@pytest.mark.slow
def test_an_overrun_is_in_the_diagnosis_for_ten_seconds():
    """The node is stopped for a second; the total stays."""
    with ros_client.Simulation(topics=((DiagnosticArray, '/diagnostics'),)) as one:
        one.until(lambda: one.seen['/diagnostics'], ros_client.FIRST_MESSAGE)
        before = int(diagnosed(one)[1]['overruns'])
        one.process.send_signal(signal.SIGSTOP)
        time.sleep(1.0)
        one.process.send_signal(signal.SIGCONT)
        one.until(lambda: 'overruns in the last 10 s' in diagnosed(one)[0].message)
        one.until(lambda: 'overruns' not in diagnosed(one)[0].message)
        assert int(diagnosed(one)[1]['overruns']) > before
        assert one.stop()[0] == 0


def test_what_is_in_force_is_known_after_a_reset_without_any_step(tmp_path):
    """Whoever listens to J_eq_applied, /diagnostics or the bag does not have to wait for the next step."""
    topics = ((DiagnosticArray, '/diagnostics'), (Float64, 'J_eq_applied'))
    with ros_client.Simulation('-p', f'node.record:={tmp_path}/', topics=topics) as one:
        applied = one.seen['J_eq_applied']
        command = one.publisher(Float64, 'J_eq')
        command.publish(Float64(data=12.0))
        one.until(lambda: applied and applied[-1].data == 12.0, ros_client.FIRST_MESSAGE)
        assert call(one, SetBool, 'pause', data=True).success and call(one, Trigger, 'reset').success
        one.until(
            lambda: applied[-1].data == 0.0 and one.seen['/diagnostics'] and diagnosed(one)[1]['J_eq applied [W]'] == '0'
        )
        assert call(one, Trigger, 'reset').success
        command.publish(Float64(data=5.0))
        one.until(lambda: call(one, Trigger, 'step').success and applied[-1].data == 5.0)
        assert one.stop()[0] == 0
    moved, unmoved, stepped = (read_bag(path) for path in sorted(tmp_path.iterdir(), key=lambda path: path.stat().st_mtime))
    assert moved['J_eq_W'][-1] == 12.0 and unmoved['J_eq_W'].tolist() == [0.0]
    assert stepped['J_eq_W'][0] in (0.0, 5.0) and stepped['J_eq_W'][-1] == 5.0


class Steps:
    """A simulation that makes ten steps at once."""

    def __init__(self):
        self.made = self.resets = 0

    def make_steps(self, most):
        self.made += min(most, 10)
        return min(most, 10)

    def reset(self, state, time):
        self.resets += state and time
        return 'reset'


@pytest.fixture
def steps():
    return Steps()


@pytest.fixture
def control(steps):
    return Control(SimpleNamespace(create_service=lambda *_, **__: None, executor=None), steps)


def test_a_request_wakes_a_simulation_that_waits(control, steps):
    """The simulating thread would wait for a minute, this for half of one only."""

    def simulate():
        control.wait(60.0)
        control.carry_out()

    threading.Thread(target=simulate, daemon=True).start()
    assert control.ask_reset().result(30.0) == 'reset' and steps.resets == 1


def test_many_steps_are_made_in_rounds_between_which_the_simulation_listens(control, steps):
    with pytest.raises(Refused, match='pause first'):
        control.ask_steps(25)
    control.paused = True
    told = []
    first, second = control.ask_steps(25, told.append), control.ask_steps(1)
    assert control.carry_out() and not first.answer.done() and told == [10]
    assert (
        control.carry_out() and control.carry_out() and first.answer.result(0.0) == '25 steps made' and told == [10, 20, 25]
    )
    assert control.carry_out() and second.answer.result(0.0) == 'one step made' and steps.made == 26
    assert not control.carry_out()


def test_steps_end_with_a_reset_when_they_are_cancelled_and_with_the_node(control, steps):
    control.paused = True
    ended, reset = control.ask_steps(25), control.ask_reset()
    assert control.carry_out() and reset.done()
    with pytest.raises(Refused, match='ended by a reset: 0 of 25 steps made'):
        ended.answer.result(0.0)
    cancelled = control.ask_steps(25)
    assert control.carry_out()
    cancelled.cancelled = True
    assert control.carry_out() and not control.carry_out()
    with pytest.raises(Refused, match='cancelled: 10 of 25 steps made'):
        cancelled.answer.result(0.0)
    waiting = control.ask_steps(25)
    control.close()
    for answer in (waiting.answer, control.ask_steps(1).answer, control.ask_reset()):
        with pytest.raises(Refused, match='the node is ending'):
            answer.result(0.0)
    assert steps.made == 10


def test_a_failure_while_a_request_is_carried_out_is_answered_and_ends_the_node(control, steps):
    def fail():
        raise ValueError('no start')

    answer = control.ask(fail)
    with pytest.raises(ValueError, match='no start'):
        control.carry_out()
    with pytest.raises(Refused, match='no start'):
        answer.result(0.0)


def test_services_answer_while_there_is_no_clock(tmp_path):
    """Nothing runs yet, so that a reset has little to do, a step and a recording are refused, and the end leaves no bag."""
    with ros_client.Simulation('-p', 'use_sim_time:=true', '-p', f'node.record:={tmp_path / "bag"}') as one:
        client = one.node.create_client(Trigger, '/sma_module_sim/reset')
        one.until(client.service_is_ready, ros_client.FIRST_MESSAGE)
        assert call(one, SetBool, 'pause', data=True).success
        answer = call(one, Trigger, 'step')
        assert not answer.success and 'waiting for /clock' in answer.message
        answer = call(one, Trigger, 'reset')
        assert answer.success and 'waiting for /clock' in answer.message
        answer = call(one, Trigger, 'record_start')
        assert not answer.success and 'waiting for /clock' in answer.message
        assert one.stop()[0] == 0 and list(tmp_path.iterdir()) == []


def test_commands_and_other_services_are_heard_while_many_steps_are_made():
    """A thousand million steps are to be made when a command arrives, and a reset ends them."""
    topics = ((JointState, 'joint_states'), (Float64, 'J_eq_applied'))
    with ros_client.Simulation('-p', 'node.steps_per_call:=1.0e9', topics=topics) as one:
        seen, applied = one.seen['joint_states'], one.seen['J_eq_applied']
        command = one.publisher(Float64, 'J_eq')
        one.until(lambda: seen, ros_client.FIRST_MESSAGE)
        assert call(one, SetBool, 'pause', data=True).success
        client = one.node.create_client(Trigger, '/sma_module_sim/step')
        one.until(client.service_is_ready)
        steps = client.call_async(Trigger.Request())
        command.publish(Float64(data=7.0))
        one.until(lambda: applied and applied[-1].data == 7.0)
        assert not steps.done() and call(one, Trigger, 'reset').success
        one.until(steps.done)
        assert not steps.result().success and 'ended by a reset' in steps.result().message
        assert one.stop()[0] == 0
