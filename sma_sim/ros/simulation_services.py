"""The standard interfaces of simulators (simulation_interfaces), over the same code as ~/pause, ~/step and ~/reset."""

from __future__ import annotations

from concurrent.futures import Future
from typing import Any

from rclpy.action.server import ActionServer, CancelResponse
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from simulation_interfaces.action import SimulateSteps
from simulation_interfaces.msg import Result, SimulationState, SimulatorFeatures
from simulation_interfaces.srv import (
    GetSimulationState,
    GetSimulatorFeatures,
    ResetSimulation,
    SetSimulationState,
    StepSimulation,
)

from sma_sim.ros.control import Control, Refused

FEATURES = (
    SimulatorFeatures.SIMULATION_RESET,
    SimulatorFeatures.SIMULATION_RESET_TIME,
    SimulatorFeatures.SIMULATION_RESET_STATE,
    SimulatorFeatures.SIMULATION_STATE_GETTING,
    SimulatorFeatures.SIMULATION_STATE_SETTING,
    SimulatorFeatures.SIMULATION_STATE_PAUSE,
    SimulatorFeatures.STEP_SIMULATION_SINGLE,
    SimulatorFeatures.STEP_SIMULATION_MULTIPLE,
    SimulatorFeatures.STEP_SIMULATION_ACTION,
)
TIME, STATE = ResetSimulation.Request.SCOPE_TIME, ResetSimulation.Request.SCOPE_STATE
WHOLE_RESET = (ResetSimulation.Request.SCOPE_DEFAULT, ResetSimulation.Request.SCOPE_ALL)
STATE_NAMES = {
    SimulationState.STATE_STOPPED: 'stopped',
    SimulationState.STATE_PLAYING: 'playing',
    SimulationState.STATE_PAUSED: 'paused',
}


def result_ok() -> Result:
    """What was asked has been done."""
    return Result(result=Result.RESULT_OK)


class ByComputerClock:
    """A node for an action server, which keeps results for a time by the computer's clock.

    By a /clock, the timer of the server would wake the executor for every message on /clock.
    """

    def __init__(self, node: Node) -> None:
        self._node, self._clock = node, Clock(clock_type=ClockType.SYSTEM_TIME)

    def get_clock(self) -> Clock:
        """The computer's clock."""
        return self._clock

    def __getattr__(self, name: str) -> Any:
        return getattr(self._node, name)


class SimulationServices:
    """Services ~/get_simulator_features, ~/reset_simulation and others, and the action ~/simulate_steps of a node."""

    def __init__(self, node: Node, control: Control) -> None:
        self._control = control
        for kind, name, callback in (
            (GetSimulatorFeatures, '~/get_simulator_features', self._get_features),
            (GetSimulationState, '~/get_simulation_state', self._get_state),
            (SetSimulationState, '~/set_simulation_state', self._set_state),
            (ResetSimulation, '~/reset_simulation', self._reset),
            (StepSimulation, '~/step_simulation', self._step),
        ):
            node.create_service(kind, name, callback, callback_group=control.callback_group)
        served: Any = ByComputerClock(node)
        self._action = ActionServer(
            served,
            SimulateSteps,
            '~/simulate_steps',
            self._simulate_steps,
            callback_group=control.callback_group,
            cancel_callback=lambda _: CancelResponse.ACCEPT,
        )

    def _get_features(self, _: Any, response: Any) -> Any:
        response.features.features = list(FEATURES)
        response.features.custom_info = 'the simulated robot is fixed: nothing can be spawned'
        return response

    def _get_state(self, _: Any, response: Any) -> Any:
        response.state.state, response.result = self._state(), result_ok()
        return response

    def _state(self) -> int:
        if self._control.stopped:
            return int(SimulationState.STATE_STOPPED)
        return int(SimulationState.STATE_PAUSED if self._control.paused else SimulationState.STATE_PLAYING)

    async def _set_state(self, request: Any, response: Any) -> Any:
        target = request.state.state
        if target == self._state():
            response.result.result = SetSimulationState.Response.ALREADY_IN_TARGET_STATE
            response.result.error_message = f'{STATE_NAMES[target]} already'
        elif target in (SimulationState.STATE_PLAYING, SimulationState.STATE_PAUSED):
            self._control.set_paused(target == SimulationState.STATE_PAUSED)
            response.result = result_ok()
        elif target == SimulationState.STATE_STOPPED:
            failure = SetSimulationState.Response.STATE_TRANSITION_ERROR
            response.result = await self._result(self._control.ask_stop(), failure)
        elif target == SimulationState.STATE_QUITTING:
            response.result = await self._result(self._control.ask_end(), Result.RESULT_OPERATION_FAILED)
        else:
            known = ', '.join(f'{number} ({name})' for number, name in STATE_NAMES.items())
            response.result = Result(
                result=Result.RESULT_FEATURE_UNSUPPORTED,
                error_message=f'state {target}: expected {known} or {SimulationState.STATE_QUITTING} (quitting)',
            )
        return response

    async def _reset(self, request: Any, response: Any) -> Any:
        scope = TIME | STATE if request.scope in WHOLE_RESET else request.scope
        if scope & ~(TIME | STATE):
            response.result = Result(
                result=Result.RESULT_FEATURE_UNSUPPORTED,
                error_message=f'scope {request.scope}: expected 0 or 255 (all), {TIME} (time), {STATE} (state) or their '
                'sum; nothing can be spawned',
            )
            return response
        answer = self._control.ask_reset(state=bool(scope & STATE), time=bool(scope & TIME))
        response.result = await self._result(answer, Result.RESULT_OPERATION_FAILED)
        return response

    async def _step(self, request: Any, response: Any) -> Any:
        try:
            answer = self._control.ask_steps(request.steps).answer
        except Refused as error:
            response.result = Result(result=Result.RESULT_OPERATION_FAILED, error_message=str(error))
            return response
        response.result = await self._result(answer, Result.RESULT_OPERATION_FAILED)
        return response

    async def _simulate_steps(self, goal: Any) -> Any:
        """Make the steps of a goal, with feedback after each sample that is published."""

        def on_progress(made: int) -> None:
            goal.publish_feedback(SimulateSteps.Feedback(completed_steps=made, remaining_steps=goal.request.steps - made))
            stepping.cancelled = goal.is_cancel_requested

        try:
            stepping = self._control.ask_steps(goal.request.steps, on_progress)
        except Refused as error:
            goal.abort()
            return SimulateSteps.Result(result=Result(result=Result.RESULT_OPERATION_FAILED, error_message=str(error)))
        result = await self._result(stepping.answer, Result.RESULT_OPERATION_FAILED)
        if result.result == Result.RESULT_OK:
            goal.succeed()
        elif goal.is_cancel_requested:
            goal.canceled()
        else:
            goal.abort()
        return SimulateSteps.Result(result=result)

    async def _result(self, answer: Future[str], failure: int) -> Result:
        """The outcome of a request, once it is carried out: `failure` is the code where it is refused."""
        await self._control.done(answer)
        error = answer.exception()
        return result_ok() if error is None else Result(result=failure, error_message=str(error))
