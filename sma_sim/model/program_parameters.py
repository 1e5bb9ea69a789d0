"""What a parameter file says beside the model: numbers, texts and switches of the node, the live check, observer, guard and
controllers; and every number that such a file may have.

They are below all that reads them: `node.J_max` bounds commands in the solver, in bags and in controllers, `guard.T_max`
plans, `check.noise_*` are the sensors of the observer and of designed experiments.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from sma_sim.model.parameters import KELVIN, MODEL_GROUPS, Parameter, declared_in

NODE_PARAMETERS = declared_in(
    'docs/reference/node.md',
    Parameter('integration_rate', 1000.0, 'Hz', (1.0, 100000.0), 'steps of the simulation per second'),
    Parameter('publish_rate', 100.0, 'Hz', (0.1, 10000.0), 'messages per second and topic'),
    Parameter('real_time_factor', 1.0, '-', (0.0, 1000.0), 'simulated over wall time; 0: as fast as possible'),
    Parameter('command_timeout', 10.0, 's', (0.0, 1e6), 'without a command for this long, heating is off; 0: never'),
    Parameter('J_max', 30.0, 'W', (0.0, 1e6), 'commands beyond it are clipped'),
    Parameter('steps_per_call', 1.0, '-', (1.0, 1e9), 'steps that one call of ~/step makes'),
    Parameter('record_duration', 0.0, 's', (0.0, 1e6), "simulated time in one of the bag's files; 0: no limit"),
    Parameter('record_size', 0.0, 'MB', (0.0, 1e6), "size of one of the bag's files; 0: no limit"),
    Parameter('realtime_priority', 0.0, '-', (0.0, 99.0), 'SCHED_FIFO priority of the thread that steps; 0: none'),
)

CHECK_PARAMETERS = declared_in(
    'docs/reference/node.md',
    Parameter('threshold', 3.0, '-', (0.01, 1e9), 'running normalized RMSE above which the model misses a channel'),
    Parameter('window', 5.0, 's', (0.01, 1e4), 'the running RMSE is over it; the model has left when it misses for as long'),
    Parameter('burn_in', 20.0, 's', (0.0, 1e6), 'after a start of the model, without a verdict'),
    Parameter('latency', 0.1, 's', (0.0, 10.0), 'wait after a measured sample for commands that are on their way'),
    Parameter('longest_gap', 10.0, 's', (0.001, 1e4), 'gap in the measurement after which the model restarts'),
    Parameter('diagnosis_period', 10.0, 's', (0.0, 1e6), 'between two looks for the cause of a deviation; 0: none'),
    Parameter('noise_U_x', 2e-6, 'm', (1e-15, 1.0), 'standard deviation of the noise of U_x'),
    Parameter('noise_U_y', 1e-5, 'm', (1e-15, 1.0), 'standard deviation of the noise of U_y'),
    Parameter('noise_alpha', 3.5e-4, 'rad', (1e-15, 1.0), 'standard deviation of the noise of alpha'),
    Parameter('noise_F_1', 0.05, 'N', (1e-12, 1e6), 'standard deviation of the noise of F_1'),
    Parameter('noise_F_2', 0.05, 'N', (1e-12, 1e6), 'standard deviation of the noise of F_2'),
    Parameter('noise_T_1', 1.0, 'K', (1e-9, 1e3), 'standard deviation of the noise of T_1'),
    Parameter('noise_T_2', 1.0, 'K', (1e-9, 1e3), 'standard deviation of the noise of T_2'),
)

OBSERVER_PARAMETERS = declared_in(
    'docs/how-to/estimate-the-wire-temperature.md',
    Parameter('parameter_std', 0.1, '-', (1e-6, 1.0), 'relative standard deviation of parameters that have none in priors'),
    Parameter('length_std', 0.002, '-', (1e-6, 1.0), 'the same of lengths'),
    Parameter('parameter_time', 300.0, 's', (0.1, 1e9), 'how long what was learned of parameters is kept'),
    Parameter(
        'gain_std', 0.2, '-', (0.0, 1.0), 'by which part all power may differ from the commands, as drivers do for good'
    ),
    Parameter(
        'gain_change_std', 0.1, '-', (0.0, 1.0), 'the same of one command, where it is another than at other commands'
    ),
    Parameter('power_std', 0.03, '-', (1e-6, 1.0), 'by which part the heating of a wire may differ from the command'),
    Parameter('power_time', 60.0, 's', (0.1, 1e9), 'how long such a difference lasts'),
    Parameter('T_E_std', 1.0, 'K', (1e-6, 100.0), 'by how much the ambient temperature may differ'),
    Parameter('T_E_time', 300.0, 's', (0.1, 1e9), 'how long such a difference lasts'),
    Parameter(
        'discrepancy',
        0.02,
        '-',
        (1e-6, 1.0),
        'by which part of its usual change a channel may differ from the model, beside noise',
    ),
    Parameter('discrepancy_time', 10.0, 's', (0.01, 1e9), 'how long such a difference lasts'),
    Parameter('T_walk', 0.5, 'K/s^0.5', (0.0, 1e3), 'random walk of the temperatures'),
    Parameter('x_M_walk', 0.003, '1/s^0.5', (0.0, 1.0), 'random walk of the fractions'),
    Parameter('initial_T_std', 1.0, 'K', (1e-3, 1e3), 'of the temperatures at the start'),
    Parameter('initial_x_M_std', 0.01, '-', (1e-4, 1.0), 'of the fractions at the start'),
    Parameter('latency', 0.02, 's', (0.0, 1.0), 'wait of the node after a sample for messages that belong to it'),
)
GUARD_PARAMETERS = declared_in(
    'docs/how-to/guard-the-wires.md',
    Parameter('T_max', 400.0, 'K', KELVIN, 'no wire may get hotter'),
    Parameter('stress_max', 5e8, 'Pa', (1e3, 1e12), 'no wire may be under more stress'),
    Parameter('strain_max', 0.1, '-', (1e-6, 1.0), 'no wire that is longer is heated'),
    Parameter('cycles_max', 1e9, '-', (0.0, 1e12), 'transformation cycles after which a wire is no longer heated'),
    Parameter('horizon', 0.05, 's', (0.005, 10.0), 'how long a command may stay in force before the next one is judged'),
    Parameter('margin', 2.0, '-', (0.0, 10.0), 'standard deviations of the estimate that limits keep clear of'),
    Parameter('T_std_max', 20.0, 'K', (0.1, 1e3), 'standard deviation of a temperature that is too uncertain to heat'),
    Parameter('silence', 0.15, 's', (0.005, 10.0), 'without a message for so long, robot and observer are silent'),
)
CONTROL_PAGE = 'docs/how-to/control-the-robot.md'
CONTROL_PARAMETERS = (
    Parameter('rate', 50.0, 'Hz', (1.0, 1000.0), 'commands per second', source=CONTROL_PAGE),
    Parameter('horizon', 1.0, 's', (0.01, 1e3), 'how far a plan looks ahead', source=CONTROL_PAGE),
    Parameter(
        'smoothness',
        0.003,
        '-',
        (1e-6, 10.0),
        'error, as a part of the usual change, that a change of the command by what keeps a wire at guard.T_max is worth',
        source=CONTROL_PAGE,
    ),
    Parameter('target', 0.0, 'rad or m', (-1e3, 1e3), 'held from the start on, with control.hold', source=CONTROL_PAGE),
    # At most what a controller's model makes up for (MAX_PAUSE of evidence.control.feedforward).
    Parameter('silence', 0.5, 's', (0.01, 60.0), 'without joint_states for so long, heating is off', source=CONTROL_PAGE),
    Parameter('kp', 1000.0, 'W/rad or W/m', (0.0, 1e9), 'proportional gain beside the feedforward', source=CONTROL_PAGE),
    Parameter('ki', 800.0, 'W/(rad s) or W/(m s)', (0.0, 1e9), 'integral gain beside it', source=CONTROL_PAGE),
)


@dataclass(frozen=True)
class Setting:
    """A parameter of the nodes that is no number: a text or a switch, by the type of its default."""

    name: str
    default: str | bool
    description: str


def joint_name_setting(name: str) -> Setting:
    """What a coordinate is called in the robot's joint_states."""
    return Setting(f'name_{name}', name, f"name of {name} in the robot's joint_states")


SETTINGS: Mapping[str, Setting] = {
    f'{group}.{setting.name}': setting
    for group, setting in (
        ('node', Setting('record', '', 'bag to write (mcap); NAME/: a new one in this folder; none: nothing is recorded')),
        ('node', Setting('ros2_control', False, "robot_description has ros2_control's topic-based hardware")),
        ('node', Setting('joint_prefix', '', 'stands before the names of the joints in joint_states and in the URDF')),
        ('node', Setting('stamped_topics', False, 'publish variants with a header too, such as wire_forces_stamped')),
        ('node', Setting('publish_resistances', False, 'publish the electrical resistance of every wire')),
        ('node', Setting('publish_clock', False, 'be the source of /clock; stamps then begin at 0')),
        ('node', Setting('stamps_follow_clock', True, 'after a pause or an overrun, stamps are those of the clock again')),
        *(('check', joint_name_setting(name)) for name in ('U_x', 'U_y', 'alpha')),
        ('control', Setting('law', 'predictive', 'predictive or feedforward')),
        ('control', Setting('coordinate', '', 'what follows the target; empty: the last coordinate')),
        (
            'control',
            Setting('hold', False, 'control.target is held from the start; else nothing is heated before a target comes'),
        ),
        ('control', Setting('behind_guard', False, 'commands go to sma_guard, as J_eq_requested')),
        ('guard', Setting('counters', '', 'file in which counts of interventions and cycles survive a restart')),
    )
}

GROUPS: Mapping[str, tuple[Parameter, ...]] = {
    **MODEL_GROUPS,
    'node': NODE_PARAMETERS,
    'check': CHECK_PARAMETERS,
    'observer': OBSERVER_PARAMETERS,
    'guard': GUARD_PARAMETERS,
    'control': CONTROL_PARAMETERS,
}
DEFAULTS: Mapping[str, Parameter] = {
    f'{group}.{parameter.name}': parameter for group, members in GROUPS.items() for parameter in members
}
