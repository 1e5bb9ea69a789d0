"""Entry point of the node: `ros2 run sma_sim sma_module_sim`, or `sma_module_sim` in a virtual environment."""

from __future__ import annotations

import os
import signal
import sys
import threading
import traceback
from collections.abc import Mapping

from sma_sim.model.config import Config
from sma_sim.model.errors import UserError

NAME = 'sma_module_sim'
NO_ROS = (
    f'{NAME}: rclpy, the Python client of ROS 2, is not installed here ({{reason}}).\n'
    "Install it with: pip install 'sma_sim[kilted]' (or sma_sim[jazzy]), or source a ROS 2 workspace."
)


WRONG_ARGUMENTS = ('RCLError', 'RCLInvalidROSArgsError', 'UnknownROSArgsError')  # what rclpy raises for them


def one_line(error: Exception) -> str:
    """The first part of rcl's message, without the places in its sources."""
    return str(error).split(', at ')[0].replace('\n', ' ')


def main(arguments: list[str] | None = None) -> int:
    """Run until Ctrl-C; exit code 0 when stopped, 2 for a user's mistake, 1 for our fault or a failed run."""
    try:
        import rclpy
    except ImportError as error:
        print(NO_ROS.format(reason=error), file=sys.stderr)
        return 2
    from rclpy.signals import SignalHandlerOptions

    stop, stepping = threading.Event(), threading.Event()

    def end(*_: object) -> None:
        stop.set()
        if not stepping.is_set():  # compiling: do not wait for its end (an exception would get lost in LLVM)
            os._exit(0)

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, end)
    try:
        rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
        return run(stop, stepping)
    except UserError as error:
        print(f'{NAME}: {error}', file=sys.stderr)
        return 2
    except Exception as error:
        if type(error).__name__ in WRONG_ARGUMENTS:
            print(f'{NAME}: {one_line(error)}', file=sys.stderr)
            return 2
        traceback.print_exc()
        print(f'{NAME}: this is a fault of sma_sim, please report it', file=sys.stderr)
        return 1
    finally:
        rclpy.try_shutdown()


def run(stop: threading.Event, stepping: threading.Event) -> int:
    """Make the node and step it until `stop` is set; `stepping` says that it is made."""
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.node import Node

    from sma_sim.ros.node import ModuleSimulation
    from sma_sim.ros.parameters import configure
    from sma_sim.solver.compile import is_compiled
    from sma_sim.solver.simulate import SimulationError

    node = Node(NAME, automatically_declare_parameters_from_overrides=True)
    config, settings = configure(node)
    if not is_compiled():
        node.get_logger().info('compiling the equations: once, about half a minute ...')
    use_sim_time = bool(node.get_parameter('use_sim_time').value)
    simulation = ModuleSimulation(node, config, settings, use_sim_time)
    stepping.set()
    executor = SingleThreadedExecutor()
    executor.add_node(node)

    def serve() -> None:
        while not stop.is_set():
            try:
                executor.spin_once(timeout_sec=0.1)
            except Exception as error:  # a message that cannot be read must not end the listening
                node.get_logger().error(f'a message or request was lost: {one_line(error)}')

    server = threading.Thread(target=serve, daemon=True)
    server.start()
    try:
        simulation.begin(stop)
        node.get_logger().info(words_on(config, settings))
        simulation.spin(stop)
    except SimulationError as error:
        node.get_logger().error(str(error))
        return 1
    finally:
        simulation.close()
        stop.set()
        server.join()
        executor.remove_node(node)
        node.destroy_node()
    return 0


def words_on(config: Config, settings: Mapping[str, float]) -> str:
    """What runs, in a line."""
    effects = ', '.join(one.found.effect.name for one in config.effects) or 'none'
    return (
        f'running: {config.model} model, effects {effects}, {settings["integration_rate"]:g} steps/s, '
        f'{settings["publish_rate"]:g} messages/s per topic; waiting for J_eq [W]; stop with Ctrl-C'
    )


if __name__ == '__main__':
    sys.exit(main())
