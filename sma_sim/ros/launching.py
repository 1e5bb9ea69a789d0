"""What the launch files share: their arguments, and the actions that start a module with them."""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ament_index_python.packages import PackageNotFoundError, get_package_prefix, get_package_share_directory
from launch.action import Action
from launch.actions import DeclareLaunchArgument, LogInfo, SetEnvironmentVariable, Shutdown
from launch.launch_context import LaunchContext
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from sma_sim.model.structures.discovery import package_structures
from sma_sim.ros.bag_names import record_of_side
from sma_sim.ros.command import GUARDED_TIMEOUT
from sma_sim.ros.transport import OVER_UDP, TRANSPORTS

PACKAGE = 'sma_sim'
EXAMPLES = {'controller': 'alpha_controller', 'trajectory_follower': 'alpha_trajectory_controller'}  # file: node
LAWS = 'predictive', 'feedforward'  # of the controller with a model, which the package has
ANGLE = 'alpha'  # the joint that they move
BOOLEANS = {'true': True, '1': True, 'false': False, '0': False}
ARGUMENTS: Mapping[str, tuple[str, str]] = {  # name: default, what it is
    'params_file': ('', 'ROS 2 parameter file; empty: the paper\'s module'),
    'namespace': ('', 'namespace of the topics, frames and nodes'),
    'model': ('', 'hybrid or mas; empty: as in params_file'),
    'system': ('', 'what is simulated; empty: as in params_file'),
    'effects': ('', 'active effects, separated by commas; empty: as in params_file, none: no effects'),
    'joint_prefix': ('', 'stands before the names of the joints; empty: as in params_file'),
    'record': ('', 'bag that the node writes; NAME/: a new one in this folder; empty: none'),
    'use_sim_time': ('false', 'follow /clock'),
    'log_level': ('info', 'debug, info, warn, error or fatal'),
    'rviz': ('false', 'start RViz with a picture of the module'),
    'controller': (
        '',
        'controller or trajectory_follower of the examples, predictive or feedforward (with a model), '
        'or the Python file of a controller node',
    ),
    'alpha_target': ('0.0', 'target angle of the controller [rad]'),
    'demo': ('false', 'the target is a sine; without another controller, the example controller follows it'),
    'guard': ('false', 'an observer and a guard between controller and module, with the limits guard.* of params_file'),
}


@dataclass(frozen=True)
class ModuleArguments:
    """The arguments of a launch, checked before anything runs: launch leaves behind what it has started."""

    params_file: str
    namespace: str
    overrides: tuple[tuple[str, str], ...]
    record: str
    log_level: str
    use_sim_time: bool
    rviz: bool
    controller: str
    alpha_target: float
    demo: bool
    joint_prefix: str
    guard: bool


def share(*parts: str) -> str:
    """The path of an installed file."""
    return str(Path(get_package_share_directory(PACKAGE), *parts))


def declared(**others: tuple[str, str]) -> list[Action]:
    """The arguments of every launch file; those of `others` with another default and description."""
    everything = {**ARGUMENTS, **others}
    return [
        DeclareLaunchArgument(name, default_value=default, description=words)
        for name, (default, words) in everything.items()
    ]


def refuse_unknown(file: str) -> None:
    """Raise RuntimeError for arguments on the command line of `ros2 launch ... FILE` that the file does not have."""
    if Path(file).name not in [Path(word).name for word in sys.argv]:
        return  # included by another file, which has arguments of its own
    unknown = [word.split(':=')[0] for word in sys.argv if ':=' in word and word.split(':=')[0] not in ARGUMENTS]
    if unknown:
        raise RuntimeError(f'{unknown[0]}:= is no argument of {Path(file).name}; expected one of {", ".join(ARGUMENTS)}')


def module_arguments(context: LaunchContext) -> ModuleArguments:
    """The values of the arguments. Raises RuntimeError, which launch shows, for wrong ones."""
    text = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    file = text['params_file'] or share('config', 'module.yaml')
    if not Path(file).is_file():  # launch itself would only warn, and the node run with its defaults
        raise RuntimeError(f'params_file: there is no file {file}')
    overrides = {name: quoted(text[name]) for name in ('model', 'system') if text[name]}
    if text['joint_prefix']:
        overrides['node.joint_prefix'] = quoted(text['joint_prefix'])
    if text['effects']:
        names = [] if text['effects'] == 'none' else [name.strip() for name in text['effects'].split(',')]
        overrides['effects.active'] = f'[{", ".join(map(quoted, names)) or quoted("")}]'
    use_sim_time, rviz, demo, guard = (boolean(name, text[name]) for name in ('use_sim_time', 'rviz', 'demo', 'guard'))
    controller = text['controller'] or ('controller' if demo else '')
    if controller in EXAMPLES or controller == share('examples', 'controller.py'):
        refuse_without_angle(text['system'])
    if controller in EXAMPLES:
        controller = share('examples', f'{controller}.py')
    if controller and controller not in LAWS and not Path(controller).is_file():
        raise RuntimeError(f'controller: there is no file {controller}; there are {", ".join((*EXAMPLES, *LAWS))}')
    return ModuleArguments(
        file,
        text['namespace'].strip('/'),
        tuple(overrides.items()),
        text['record'],
        text['log_level'],
        use_sim_time,
        rviz,
        controller,
        angle('alpha_target', text['alpha_target']),
        demo,
        text['joint_prefix'],
        guard,
    )


def refuse_without_angle(system: str) -> None:
    """Raise RuntimeError for a system that the controllers of the examples cannot move."""
    found = package_structures().get(system)
    if found is not None and all(coordinate.name != ANGLE for coordinate in found.coordinates):
        raise RuntimeError(
            f'system:={system} has no joint {ANGLE}, which the controllers of the examples move; expected controller:=FILE '
            f'with a controller of your own, or module.launch.py'
        )


def angle(name: str, text: str) -> float:
    """The number that an argument gives. Raises RuntimeError."""
    try:
        return float(text)
    except ValueError as error:
        raise RuntimeError(f'{name}:={text}: expected an angle in rad, such as 0.05') from error


def boolean(name: str, text: str) -> bool:
    """The truth that an argument says. Raises RuntimeError."""
    if text.lower() not in BOOLEANS:
        raise RuntimeError(f'{name}:={text}: expected true or false')
    return BOOLEANS[text.lower()]


def quoted(text: str) -> str:
    """A text as YAML reads it back."""
    return "'" + text.replace("'", "''") + "'"


def module_actions(given: ModuleArguments) -> list[Action]:
    """A module and, where they were asked for, a guard, its controller and the target that moves; all over UDP, unless the
    environment says otherwise: a controller of the user's own too."""
    actions: list[Action] = [SetEnvironmentVariable(TRANSPORTS, os.environ.get(TRANSPORTS, OVER_UDP)), module_node(given)]
    if given.guard:
        actions += [package_node(executable, given, joint_names(given)) for executable in ('sma_observer', 'sma_guard')]
    if given.controller in LAWS:
        actions.append(model_controller(given))
    elif given.controller:
        parameters: dict[str, Any] = {'alpha_target': given.alpha_target}
        if given.joint_prefix:
            parameters['joint'] = f'{given.joint_prefix}alpha'
        name = EXAMPLES.get(Path(given.controller).stem, 'alpha_controller')
        actions.append(python_node(given.controller, name, given, parameters, guarded=given.guard))
    if given.demo:
        actions.append(python_node(share('examples', 'sine_target.py'), 'sine_target', given, {}))
    return actions


def two_modules(given: ModuleArguments) -> list[Action]:
    """The same twice, in the namespaces left and right; a bag and a picture of each."""
    sides = [
        replace(given, namespace=f'{given.namespace}/{side}'.lstrip('/'), record=record_of_side(given.record, side))
        for side in ('left', 'right')
    ]
    return [action for side in sides for action in (*module_actions(side), *rviz_actions(side))]


def module_node(given: ModuleArguments) -> Node:
    """The simulated module; its parameter file comes before the other arguments, which win.

    Nothing can be published for a guard that is killed, so that a module with one turns the heating off by itself.
    """
    more = [f'node.record:={quoted(given.record)}'] if given.record else []
    more += [f'node.command_timeout:={GUARDED_TIMEOUT}'] if given.guard else []
    return package_node('sma_module_sim', given, more)


def model_controller(given: ModuleArguments) -> Node:
    """The controller with a model, by the law that was asked for."""
    words = [f'control.law:={given.controller}', f'control.target:={given.alpha_target}', 'control.hold:=true']
    words += ['control.behind_guard:=true'] if given.guard else []
    return package_node('sma_controller', given, [*words, *joint_names(given)])


def joint_names(given: ModuleArguments) -> list[str]:
    """What a node beside the module calls its joints, which have its prefix."""
    system = dict(given.overrides).get('system', quoted('module')).strip("'")
    found = package_structures().get(system)
    joints = found.coordinate_names if found is not None and given.joint_prefix else ()
    return [f'check.name_{joint}:={quoted(given.joint_prefix + joint)}' for joint in joints]


def package_node(executable: str, given: ModuleArguments, more: Sequence[str]) -> Node:
    """A node of the package with the parameters of the launch and `more`; when it ends, so does everything."""
    parameters = [f'{name}:={value}' for name, value in given.overrides] + list(more)
    parameters += ['use_sim_time:=true'] if given.use_sim_time else []
    words = [word for parameter in parameters for word in ('-p', parameter)]
    return Node(
        package=PACKAGE,
        executable=executable,
        namespace=given.namespace,
        ros_arguments=['--params-file', given.params_file, *words, '--log-level', given.log_level],
        output='screen',
        on_exit=Shutdown(reason=f'{executable} has ended'),
    )


def python_node(file: str, name: str, given: ModuleArguments, parameters: Mapping[str, Any], guarded: bool = False) -> Node:
    """A node that is one Python file, run by the Python that runs the launch; when it ends, so does everything.

    The command of one that is `guarded` goes to the guard.
    """
    values: dict[Any, Any] = {**parameters, 'use_sim_time': given.use_sim_time}
    return Node(
        executable=sys.executable,
        arguments=[file],
        name=name,
        exec_name=name,
        namespace=given.namespace,
        parameters=[values],
        remappings=[('J_eq', 'J_eq_requested')] if guarded else [],
        ros_arguments=['--log-level', given.log_level],
        output='screen',
        on_exit=Shutdown(reason=f'{name} has ended'),
    )


def rviz_actions(given: ModuleArguments) -> list[Action]:
    """RViz with our configuration; a message where it is not installed."""
    if not given.rviz:
        return []
    try:
        get_package_prefix('rviz2')
    except PackageNotFoundError:
        return [LogInfo(msg='rviz:=true: RViz is not installed here (package rviz2); everything else runs without it')]
    file = share('rviz', 'sma_module.rviz')
    frame = f'{given.namespace.strip("/")}/base'.lstrip('/')
    arguments = ['-f', frame, *(['-d', file] if Path(file).is_file() else [])]
    return [Node(package='rviz2', executable='rviz2', namespace=given.namespace, arguments=arguments, output='log')]
