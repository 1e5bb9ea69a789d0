"""How a node of ours starts, listens and ends, whatever it does in between.

Nothing that takes long to import is imported above: Ctrl-C is heard as soon as `run_node` is called.
"""

from __future__ import annotations

import gc
import inspect
import os
import queue
import shlex
import sys
import threading
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Any, Protocol

from sma_sim.model.errors import UserError
from sma_sim.ros.stop_signals import ignore_at_exit, take_stop_signals
from sma_sim.ros.transport import prefer_udp

if TYPE_CHECKING:
    from sma_sim.model.config import Config
    from sma_sim.model.given import RawValue

NO_ROS = (
    'rclpy, the Python client of ROS 2, is not installed here ({reason}).\n'
    "Install it with: pip install 'sma_sim[kilted]' (or sma_sim[jazzy]), or source a ROS 2 workspace."
)
USAGE = """usage: {name} [--help] [--ros-args ROS-ARGUMENTS]

{purpose}

ROS arguments come after --ros-args:
  -p NAME:=VALUE       one parameter, such as -p {example}
  --params-file FILE   a ROS 2 parameter file (`sma-sim init` writes one)
  -r __ns:=/NAME       the namespace of the topics
  -r FROM:=TO          another name for a topic
Ctrl-C ends the node. Exit code: 0 when stopped, 2 for wrong arguments or parameters, 1 for a failed run."""
SLOW_START = 3.0  # [s] after which a start is said to go on
STILL_STARTING = 'loading its code; the first start on a machine compiles it, once (`sma-sim compile` does so beforehand)'
LAST_ROUNDS = 20  # of the executor after the end, in which requests that still waited are answered
WRONG_ARGUMENTS = ('RCLError', 'RCLInvalidROSArgsError', 'UnknownROSArgsError')  # what rclpy raises for them


@dataclass(frozen=True)
class Program:
    """A command that is a node: its name, what it is for, and a parameter as an example in its messages.

    `live` are the numbers that a user may set while it runs. `runner`: module and class of what it does.
    """

    name: str
    purpose: str
    example: str
    live: tuple[str, ...]
    runner: str = ''

    def make(self, node: Any, config: Config, use_sim_time: bool) -> Runner:
        """What the node does; rclpy is not imported before it is known to be there."""
        module, _, name = self.runner.partition(':')
        runner: Runner = getattr(import_module(module), name)(node, config, use_sim_time)
        return runner

    def main(self, arguments: list[str] | None = None) -> int:
        """Run the node; the exit code of `run_node`."""
        return run_node(self, self.make, arguments)


class Runner(Protocol):
    """What a node does: in the main thread, while messages and requests are served in another."""

    def begin(self, stop: threading.Event) -> None:
        """Before the first round; says in the log what runs."""

    def spin(self, stop: threading.Event) -> None:
        """Until `stop` is set."""

    def close(self) -> None:
        """At the end, also after an error."""


# Makes a runner from a node, its configuration and use_sim_time.
RunnerFactory = Callable[[Any, 'Config', bool], Runner]


def short_message(error: Exception) -> str:
    """The first part of rcl's message, without the places in its sources."""
    return str(error).split(', at ')[0].replace('\n', ' ')


def outside_ros_args(arguments: Sequence[str]) -> list[str]:
    """The arguments that rcl ignores: those before --ros-args, or after the -- that ends it."""
    ignored, of_ros = [], False
    for word in arguments:
        if word == '--ros-args':
            of_ros = True
        elif of_ros:
            of_ros = word != '--'
        else:
            ignored.append(word)
    return ignored


def answered(program: Program, arguments: Sequence[str]) -> int | None:
    """The exit code for arguments that start no node (--help, and those that are not ROS arguments); None for the others."""
    ignored = outside_ros_args(arguments)
    if not ignored:
        return None
    if {'-h', '--help'} & set(ignored):
        print(USAGE.format(**vars(program)))
        return 0
    given = shlex.join(ignored)
    form = given if ignored[0].startswith('-') else f'-p {program.example}'
    print(
        f'{program.name}: {given}: only ROS arguments are taken, after --ros-args, as in\n'
        f'  {program.name} --ros-args {form}\nSee {program.name} --help.',
        file=sys.stderr,
    )
    return 2


def run_node(program: Program, make: RunnerFactory, arguments: list[str] | None) -> int:
    """Run until Ctrl-C; exit code 0 when stopped, 2 for a user's mistake, 1 for our fault or a failed run."""
    name = program.name
    given_words = sys.argv[1:] if arguments is None else arguments
    code = answered(program, given_words)
    if code is not None:
        return code
    stop, working = threading.Event(), threading.Event()
    end_by_signals(stop, working)
    prefer_udp()
    try:
        import rclpy
    except ImportError as error:
        print(f'{name}: {NO_ROS.format(reason=error)}', file=sys.stderr)
        return 2
    from rclpy.signals import SignalHandlerOptions

    try:
        compile_first(name)
        from sma_sim.ros.parameters import read_arguments

        words, given = read_arguments(given_words, name)
        rclpy.init(args=words, signal_handler_options=SignalHandlerOptions.NO)
        return serve_node(program, make, given, stop, working)
    except UserError as error:
        print(f'{name}: {error}', file=sys.stderr)
        return 2
    except Exception as error:
        if type(error).__name__ in WRONG_ARGUMENTS:
            print(f'{name}: {short_message(error)}', file=sys.stderr)
            return 2
        traceback.print_exc()
        print(f'{name}: this is a fault of sma_sim, please report it', file=sys.stderr)
        return 1
    finally:
        if rclpy.ok():
            rclpy.shutdown(uninstall_handlers=False)  # uninstalling sets the default for a moment, in which Ctrl-C kills


def end_by_signals(stop: threading.Event, working: threading.Event) -> None:
    """Let Ctrl-C and the other stop signals set `stop`, however often they come; before `working` they end the process."""
    arrived: queue.SimpleQueue[int] = queue.SimpleQueue()

    def note(number: int) -> None:
        # not stop.set(): a signal that interrupts another one, or a wait, would wait for ever for the lock of the event
        arrived.put(number)
        if not working.is_set():  # compiling: do not wait for its end (an exception would get lost in LLVM)
            os._exit(0)

    def tell() -> None:
        arrived.get()
        stop.set()

    threading.Thread(target=tell, daemon=True).start()
    ignore_at_exit(take_stop_signals(note))


def compile_first(name: str) -> None:
    """Compile the equations before there is a node: one that compiles would be in the graph and answer nothing."""
    from sma_sim.solver.first_start import FIXED_RATE, announce_compilation
    from sma_sim.solver.warm_up import compile_fixed_rate

    announce_compilation(lambda line: print(f'{name}: {line}', file=sys.stderr, flush=True), FIXED_RATE)
    compile_fixed_rate()


class Server:
    """Serves a node's messages and requests in a thread of its own."""

    def __init__(self, node: Any) -> None:
        from rclpy.executors import SingleThreadedExecutor

        self._node, self._executor = node, SingleThreadedExecutor()
        self._executor.add_node(node)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Answer what still waits, and end."""
        self._ended.set()
        self._thread.join()
        self._executor.remove_node(self._node)

    def _serve(self) -> None:
        while not self._ended.is_set():
            self._serve_once(0.1)
        for _ in range(LAST_ROUNDS):
            self._serve_once(0.0)

    def _serve_once(self, longest: float) -> None:
        try:
            self._executor.spin_once(timeout_sec=longest)
        except Exception as error:  # a message that cannot be read must not end the listening
            self._node.get_logger().error(f'a message or request was lost: {short_message(error)}')


def serve_node(
    program: Program, make: RunnerFactory, in_files: Mapping[str, RawValue], stop: threading.Event, working: threading.Event
) -> int:
    """Make the node, with what parameter files say, and let it work until `stop` is set; `working` says that it is made."""
    from sma_sim.ros.parameter_node import ParameterNode
    from sma_sim.ros.parameters import configure, overrides_of
    from sma_sim.ros.qos import take_overrides, warn_of_unused
    from sma_sim.solver.simulate import SimulationError

    node = ParameterNode(
        program.name,
        automatically_declare_parameters_from_overrides=True,
        parameter_overrides=overrides_of(in_files),
    )
    config = configure(node, program.live, in_files)
    overrides = take_overrides(node)
    slow = threading.Timer(SLOW_START, lambda: node.get_logger().info(STILL_STARTING))
    slow.daemon = True
    slow.start()
    try:
        runner = make(node, config, bool(node.get_parameter('use_sim_time').value))
    finally:
        slow.cancel()
    warn_of_unused(node, overrides)
    prepare_logging()
    working.set()
    server = Server(node)
    try:
        use_realtime_priority(round(config.parameters['node.realtime_priority']))
        freeze_objects()
        sys.setswitchinterval(SWITCH_INTERVAL)
        runner.begin(stop)
        runner.spin(stop)
    except SimulationError as error:
        node.get_logger().error(str(error))
        return 1
    finally:
        runner.close()
        stop.set()
        server.close()
        node.destroy_node()
    return 0


def model_description(config: Config) -> str:
    """Which model runs, in a few words."""
    effects = ', '.join(active.effect.name for active in config.effects) or 'none'
    return f'{config.simulated_kinetics} model, effects {effects}'


# Steps in time: no long garbage collection, no long wait for the interpreter, a real-time priority where asked for.
SWITCH_INTERVAL = 5e-4  # [s] after which the thread that steps gets the interpreter; Python's own 5 ms are five steps


def freeze_objects() -> None:
    """Keep what the start has made out of all later garbage collections, each of which would take a tenth of a second."""
    gc.collect()
    gc.freeze()


def prepare_logging() -> None:
    """Let `inspect`, by which rclpy finds the caller of a message, look through all modules now: its first time is long."""
    inspect.getmodule(inspect.currentframe())


def use_realtime_priority(priority: int) -> None:
    """Give the calling thread a priority of SCHED_FIFO, 1 to 99; 0 leaves it as it is.

    Raises UserError where the system has no such priorities or doesn't allow this one.
    """
    if priority == 0:
        return
    if not hasattr(os, 'sched_setscheduler'):
        raise UserError(f'node.realtime_priority = {priority}: this system has no SCHED_FIFO; set it to 0')
    try:
        # not for the threads that this one starts, such as the recorder's
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(priority))
    except PermissionError as error:
        raise UserError(
            f'node.realtime_priority = {priority}: the system does not allow it. Allow it with a line such as\n'
            f'  <user>  -  rtprio  {priority}\n'
            'in /etc/security/limits.conf and log in again, or set it to 0'
        ) from error
