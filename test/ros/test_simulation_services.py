"""The standard interfaces of simulators (simulation_interfaces), over real DDS."""

import time

import pytest

ros_client = pytest.importorskip('ros_client', reason='rclpy is not installed', exc_type=ImportError)
pytest.importorskip('simulation_interfaces.srv', reason='simulation_interfaces is not installed: .ci/build_interfaces')
from action_msgs.msg import GoalStatus  # noqa: E402
from rclpy.action import ActionClient  # noqa: E402
from sensor_msgs.msg import JointState, Temperature  # noqa: E402
from simulation_interfaces.action import SimulateSteps  # noqa: E402
from simulation_interfaces.msg import Result, SimulationState, SimulatorFeatures  # noqa: E402
from simulation_interfaces.srv import (  # noqa: E402
    GetSimulationState,
    GetSimulatorFeatures,
    ResetSimulation,
    SetSimulationState,
    StepSimulation,
)
from std_msgs.msg import Float64  # noqa: E402
from std_srvs.srv import SetBool, Trigger  # noqa: E402
from test_node_control import call, last_stamp, stamp  # noqa: E402

OK, FAILED, UNSUPPORTED = Result.RESULT_OK, Result.RESULT_OPERATION_FAILED, Result.RESULT_FEATURE_UNSUPPORTED
STOPPED, PLAYING, PAUSED = 0, 1, 2


@pytest.fixture(scope='module')
def running():
    topics = ((JointState, 'joint_states'), (Temperature, 'wire_1/temperature'), (Float64, 'J_eq_applied'))
    words = ('-p', 'node.publish_clock:=true', '-p', 'node.publish_rate:=1000.0')
    with ros_client.Simulation(*words, topics=topics) as one:
        one.until(lambda: one.seen['joint_states'], ros_client.FIRST_MESSAGE)
        yield one


def state(one):
    """The state that the node tells."""
    answer = call(one, GetSimulationState, 'get_simulation_state')
    assert answer.result.result == OK
    return answer.state.state


def set_state(one, target):
    """The code that setting a state gives."""
    return call(one, SetSimulationState, 'set_simulation_state', state=SimulationState(state=target)).result.result


def reset(one, scope=ResetSimulation.Request.SCOPE_DEFAULT):
    return call(one, ResetSimulation, 'reset_simulation', scope=scope).result.result


def steps(one, count):
    return call(one, StepSimulation, 'step_simulation', steps=count).result


def test_features_are_those_that_are_served(running):
    features = set(call(running, GetSimulatorFeatures, 'get_simulator_features').features.features)
    names = [name for name in dir(SimulatorFeatures) if name.startswith(('SIMULATION_', 'STEP_'))]
    assert features == {getattr(SimulatorFeatures, name) for name in names if not name.endswith('SPAWNED')}


def test_states_and_the_services_of_the_node_agree(running):
    assert call(running, SetBool, 'pause', data=False).success and state(running) == PLAYING
    assert set_state(running, PLAYING) == SetSimulationState.Response.ALREADY_IN_TARGET_STATE
    assert set_state(running, PAUSED) == OK and state(running) == PAUSED
    assert call(running, SetBool, 'pause', data=True).message == 'paused (as before)'
    assert set_state(running, STOPPED) == OK and state(running) == STOPPED
    assert stamp(running.seen['joint_states'][-1]) > 0.0 or last_stamp(running, running.seen['joint_states']) == 0.0
    assert set_state(running, PAUSED) == OK and set_state(running, STOPPED) == OK
    assert call(running, Trigger, 'step').success and state(running) == PAUSED
    for wrong in (SimulationState.STATE_NO_WORLD, SimulationState.STATE_LOADING_WORLD, 200):
        assert set_state(running, wrong) == UNSUPPORTED
    assert state(running) == PAUSED


def test_steps_are_made_while_the_simulation_is_paused_only(running):
    seen = running.seen['joint_states']
    assert set_state(running, PAUSED) in (OK, 101) and reset(running) == OK
    assert last_stamp(running, seen) == 0.0
    assert steps(running, 1).result == OK and steps(running, 0).result == OK and steps(running, 250).result == OK
    assert last_stamp(running, seen) == pytest.approx(0.251)
    assert set_state(running, PLAYING) == OK
    refused = steps(running, 1)
    assert refused.result == FAILED and 'pause first' in refused.error_message


def test_scopes_of_a_reset(running):
    """Time alone goes back to zero with the wire warm; the state alone goes back to cold with the time going on."""
    seen, heat = running.seen['joint_states'], running.seen['wire_1/temperature']
    command = running.publisher(Float64, 'J_eq')
    assert set_state(running, PLAYING) in (OK, 101)
    command.publish(Float64(data=12.0))
    running.until(lambda: heat[-1].temperature > 60.0)
    assert set_state(running, PAUSED) == OK
    before = last_stamp(running, seen)
    assert before > 0.05 and reset(running, ResetSimulation.Request.SCOPE_TIME) == OK
    assert last_stamp(running, seen) == 0.0 and heat[-1].temperature > 60.0
    assert steps(running, 100).result == OK
    running.until(lambda: stamp(seen[-1]) == pytest.approx(0.1))
    assert running.seen['J_eq_applied'][-1].data == 12.0
    assert reset(running, ResetSimulation.Request.SCOPE_STATE) == OK
    assert last_stamp(running, seen) == pytest.approx(0.1) and heat[-1].temperature == pytest.approx(24.85)
    scopes = ResetSimulation.Request.SCOPE_STATE | ResetSimulation.Request.SCOPE_TIME
    assert reset(running, scopes) == OK and last_stamp(running, seen) == 0.0
    assert reset(running, ResetSimulation.Request.SCOPE_ALL) == OK
    for wrong in (ResetSimulation.Request.SCOPE_SPAWNED, 8, 5):
        assert reset(running, wrong) == UNSUPPORTED


def goal(one, count, on_feedback=None):
    """A goal of the action that was accepted."""
    client = ActionClient(one.node, SimulateSteps, '/sma_module_sim/simulate_steps')
    one.until(client.server_is_ready)
    sent = client.send_goal_async(SimulateSteps.Goal(steps=count), feedback_callback=on_feedback)
    one.until(sent.done)
    assert sent.result().accepted
    return sent.result()


def outcome(one, accepted):
    """The status and the result of a goal."""
    future = accepted.get_result_async()
    one.until(future.done)
    return future.result().status, future.result().result.result


def test_the_action_makes_steps_tells_of_them_and_can_be_cancelled(running):
    seen = running.seen['joint_states']
    assert set_state(running, STOPPED) in (OK, 101) and reset(running) == OK
    told = []
    status, result = outcome(running, goal(running, 60, lambda message: told.append(message.feedback)))
    assert status == GoalStatus.STATUS_SUCCEEDED and result.result == OK and last_stamp(running, seen) == pytest.approx(0.06)
    made = [feedback.completed_steps for feedback in told]
    assert made == sorted(made) and made and all(f.completed_steps + f.remaining_steps == 60 for f in told)
    long = goal(running, 10**12, lambda message: told.append(message.feedback))
    running.until(lambda: told[-1].completed_steps > 100 and told[-1].remaining_steps > 10**6)
    cancelled = long.cancel_goal_async()
    running.until(cancelled.done)
    status, result = outcome(running, long)
    assert status == GoalStatus.STATUS_CANCELED and result.result == FAILED and 'cancelled' in result.error_message
    assert steps(running, 1).result == OK  # nothing is left of the steps before
    assert set_state(running, PLAYING) == OK
    status, result = outcome(running, goal(running, 1))
    assert status == GoalStatus.STATUS_ABORTED and result.result == FAILED and 'pause first' in result.error_message


def test_quitting_ends_the_node_after_the_answer():
    with ros_client.Simulation() as one:
        client = one.node.create_client(SetSimulationState, '/sma_module_sim/set_simulation_state')
        one.until(client.service_is_ready, ros_client.FIRST_MESSAGE)
        future = client.call_async(SetSimulationState.Request(state=SimulationState(state=SimulationState.STATE_QUITTING)))
        assert one.process.wait(ros_client.REACTION) == 0
        end = time.monotonic() + ros_client.REACTION
        while not future.done():
            assert time.monotonic() < end, 'no answer'
            one.executor.spin_once(timeout_sec=0.1)
        assert future.result().result.result == OK
