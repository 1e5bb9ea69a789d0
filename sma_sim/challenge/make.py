"""Makes a challenge from a seed: recordings of a robot that differs from its model, and the answer."""

from __future__ import annotations

import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sma_sim.challenge.answer import Answer, HiddenEffect
from sma_sim.challenge.draw import UNCERTAIN_PARAMETERS, draw_parameters, draw_random_command, draw_truths
from sma_sim.challenge.robot import NOISE_STD, BrokenRobot, Hidden, Robot
from sma_sim.challenge.truth import Truth
from sma_sim.evidence.data.recording import Dataset, Recording
from sma_sim.model.argument_checks import check_fields, checked
from sma_sim.model.arrays import Vector
from sma_sim.model.config import Config, default_parameters
from sma_sim.model.effects.discovery import package_effects
from sma_sim.model.errors import UserError
from sma_sim.model.shown import Shown
from sma_sim.solver.inputs import Input

PARAMETER_STREAM, EFFECT_STREAM, COMMAND_STREAM, NOISE_STREAM = range(4)  # independent streams of random numbers
MAX_ATTEMPTS = 20
MIN_RUNS = 3
DEFAULT_DURATION, DEFAULT_RATE = 100.0, 50.0  # [s], [1/s]
POSE_CHANNELS = ('U_x', 'U_y', 'alpha')
Measured = tuple[Vector, Mapping[str, Vector]]  # times and channels


@dataclass(frozen=True)
class RecordingPlan:
    """What a challenge records.

    Attributes
    ----------
    runs
        Number of recordings.
    duration, rate
        Of each of them [s], and samples per second.
    """

    runs: int = MIN_RUNS
    duration: float = DEFAULT_DURATION
    rate: float = DEFAULT_RATE

    def __post_init__(self) -> None:
        check_fields(self)


DEFAULT_PLAN = RecordingPlan()


@dataclass(frozen=True, repr=False)
class Challenge(Shown):
    """Recordings of a robot with something hidden in it.

    Attributes
    ----------
    dataset : Dataset
        The recordings.
    nominal : Config
        The model that the user starts from.
    robot : Robot
        What was recorded.
    answer : Answer
        What is hidden in it.
    """

    dataset: Dataset
    nominal: Config
    robot: Robot
    answer: Answer

    def facts(self) -> Mapping[str, str]:
        """What is to be known at a glance, without the answer."""
        return {'seed': f'{self.answer.seed}', **self.dataset.facts()}


@checked
def make_challenge(
    seed: int,
    effects: int | None = None,
    outside: bool | None = None,
    kinds: str | Sequence[str] = (),
    forces: bool = False,
    plan: RecordingPlan = DEFAULT_PLAN,
) -> Challenge:
    """The challenge of a seed, always the same one: recordings of a robot that differs from its model.

    Parameters
    ----------
    seed : int
        0 or more.
    effects : int, optional
        How many effects are hidden, 0 to 2; without it the seed says.
    outside : bool, optional
        Whether those that are drawn are outside the library of effects; without it the seed says.
    kinds : str or sequence of str
        Effects that are hidden in any case, by name.
    forces : bool
        Whether the forces of the wires are recorded beside the pose.
    plan : RecordingPlan
        How many recordings, how long, at which rate.

    Returns
    -------
    Challenge
        Recordings, the model to start from, and the answer.

    Raises
    ------
    UserError
        For a plan or an effect that there is not, and for a seed of which no robot works.

    Examples
    --------
    >>> import sma_sim
    >>> case = sma_sim.make_challenge(1, effects=1, plan=sma_sim.RecordingPlan(duration=10.0, rate=10.0))
    >>> len(case.dataset.recordings), len(case.answer.effects)
    (3, 1)
    """
    check_request(seed, plan)
    chosen = draw_truths(
        np.random.default_rng([seed, EFFECT_STREAM]), effects, outside, (kinds,) if isinstance(kinds, str) else kinds
    )
    return challenge_with(chosen, seed, forces, plan)


def challenge_with(
    chosen: Sequence[Truth], seed: int, forces: bool = False, plan: RecordingPlan = DEFAULT_PLAN
) -> Challenge:
    """The challenge of a seed that hides these effects, which need not be those of the package. Raises UserError."""
    check_request(seed, plan)
    nominal = nominal_for(chosen)
    for attempt in range(MAX_ATTEMPTS):
        streams = {
            stream: np.random.default_rng([seed, attempt, stream])
            for stream in (PARAMETER_STREAM, COMMAND_STREAM, NOISE_STREAM)
        }
        hidden = tuple(Hidden(truth, truth.draw(stream_of(truth, seed, attempt))) for truth in chosen)
        robot = Robot(draw_parameters(nominal.parameters, streams[PARAMETER_STREAM]), hidden)
        T_E = nominal.parameters['environment.T_E']
        commands = [draw_random_command(plan.duration, T_E, streams[COMMAND_STREAM]) for _ in range(plan.runs)]
        try:
            measured = [robot.measure(command, plan.rate) for command in commands]
            effects_found = tuple(hidden_effect(entry, robot, commands, measured, plan.rate, forces) for entry in hidden)
        except BrokenRobot:
            continue
        noise_std = {name: std for name, std in NOISE_STD.items() if forces or name in POSE_CHANNELS}
        recordings = tuple(
            noisy_recording(f'run{k + 1}', command, time, channels, noise_std, streams[NOISE_STREAM])
            for k, (command, (time, channels)) in enumerate(zip(commands, measured, strict=True))
        )
        offsets = {name: (nominal.parameters[name], robot.parameters[name]) for name in (*UNCERTAIN_PARAMETERS, 'wire.l0')}
        answer = Answer(seed, effects_found, offsets, noise_std)
        return Challenge(Dataset(recordings, noise_std), nominal, robot, answer)
    names = ', '.join(truth.name for truth in chosen) or 'none'
    raise UserError(
        f'seed {seed}: no robot that works was found in {MAX_ATTEMPTS} draws (effects {names}); choose another seed'
    )


def stream_of(truth: Truth, seed: int, attempt: int) -> np.random.Generator:
    """Random numbers of its own for each truth: one seed does not make all of them weak or strong."""
    return np.random.default_rng([seed, attempt, EFFECT_STREAM, zlib.crc32(truth.name.encode())])


def nominal_for(chosen: Sequence[Truth]) -> Config:
    """The model that the user starts from: the paper's, at the ambient temperature at which the hidden effects can show."""
    parameters = default_parameters()
    for truth in chosen:
        if truth.T_E is not None:
            parameters['environment.T_E'] = truth.T_E
    return Config(parameters)


def check_request(seed: int, plan: RecordingPlan) -> None:
    """Raise UserError for a challenge that cannot be made."""
    runs, duration, rate = plan.runs, plan.duration, plan.rate
    if seed < 0:
        raise UserError(f'seed {seed}: expected a whole number, 0 or more')
    if runs < MIN_RUNS:
        raise UserError(f'{runs} runs: expected at least {MIN_RUNS}, of which one can be held out')
    if not (duration >= 1.0 and rate >= 1.0 and duration * rate <= 1e7):
        raise UserError(
            f'duration {duration:g} s at {rate:g} samples/s: expected at least 1 s and 1/s, and at most 1e7 samples'
        )


def noisy_recording(
    name: str,
    command: Input,
    time: Vector,
    channels: Mapping[str, Vector],
    noise_std: Mapping[str, float],
    random: np.random.Generator,
) -> Recording:
    """A recording of the channels that have a noise, with it."""
    noisy = {channel: channels[channel] + std * random.standard_normal(len(time)) for channel, std in noise_std.items()}
    return Recording(name, 'module', time, noisy, command)


def hidden_effect(
    hidden: Hidden, robot: Robot, commands: Sequence[Input], measured: Sequence[Measured], rate: float, forces: bool
) -> HiddenEffect:
    """A hidden effect as the answer has it, with its influence.

    That is the root mean square of what it changes in each channel, over the noise, before anything is refitted; `all`
    is the root mean square of those that are recorded.
    """
    without_it = robot.without(hidden)
    changes = [
        {name: channels[name] - values for name, values in without_it.measure(command, rate)[1].items()}
        for command, (_, channels) in zip(commands, measured, strict=True)
    ]
    influence = {
        name: float(np.sqrt(np.mean(np.concatenate([change[name] for change in changes]) ** 2)) / std)
        for name, std in NOISE_STD.items()
    }
    influence['all'] = float(np.sqrt(np.mean([influence[name] ** 2 for name in (NOISE_STD if forces else POSE_CHANNELS)])))
    values = {p.name: (hidden.values[p.name], p.unit) for p in hidden.truth.parameters}
    return HiddenEffect(
        hidden.truth.name,
        hidden.truth.library,
        hidden.truth.port,
        hidden.truth.variables,
        values,
        influence,
        listed_parameters(hidden, robot.parameters),
    )


def listed_parameters(hidden: Hidden, parameters: Mapping[str, float]) -> dict[str, tuple[float, str]]:
    """The parameters of the package's effect that come nearest to a hidden one, with their units."""
    if hidden.truth.listed is None:
        return {}
    units = {p.name: p.unit for p in package_effects()[hidden.truth.library].parameters}
    return {name: (value, units[name]) for name, value in hidden.truth.listed(hidden.values, parameters).items()}
