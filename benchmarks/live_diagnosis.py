"""Does the live check name what changes on a robot, how soon, and nothing where nothing changes?

    python benchmarks/live_diagnosis.py [--days 24] [--quiet 10] [--seed 8000] [--minutes 60] [--at-once 2] [--share 1.0]

Each case is a part of a day: a robot with parameters of its own (sma_sim/challenge), whose model is known, moves for ten
minutes under a random command; 20 samples a second with noise, with and without forces. At an instant something begins: a
fan, natural convection, friction of the plate, the loss of wires of a bundle, a jump of a sensor's zero, gravity, or
nothing; on other days only the room gets warmer or colder by up to 2 K, which nobody measures. Laws of convection,
friction and gravity are those of the challenges, which the library does not share. The check looks every 10 s until it says
a change, and once more a minute later.

With --quiet there are hours too in which nothing changes but the command and the room, by up to 2 K to and fro, as a
thermometer tells it.

With --off 0.03 the check takes each parameter of the robot for another one, by 3 % (standard deviation), as after a fit.

Right is the cause that is most probable when a change is said for the first time, and a minute later. The delay counts from
the first 10 s in which the change shows above the noise in a channel. False alarms are counted by hours without a change.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from concurrent.futures import Executor
from typing import Any

import numpy as np
from cases import add_options, drawn, of, solved
from numpy.typing import NDArray

from sma_sim.challenge.draw import UNCERTAIN_PARAMETERS, draw_parameters, draw_random_command, named_truth
from sma_sim.challenge.robot import NOISE_STD, ROBOT_RTOL
from sma_sim.evidence.monitoring.causes import Cause, causes_for
from sma_sim.evidence.monitoring.live_criteria import CHECKPOINT
from sma_sim.evidence.monitoring.live_diagnosis import LiveDiagnosis, LiveFinding
from sma_sim.evidence.monitoring.live_model import ComparedSample, InputChange
from sma_sim.evidence.monitoring.past import continued, shifted
from sma_sim.model.config import Config
from sma_sim.solver.inputs import Input
from sma_sim.solver.model import Model
from sma_sim.solver.simulate import simulate

Matrix = NDArray[np.float64]
DURATION, RATE = 600.0, 20.0
HOUR, TOLD = 3600.0, 30.0  # [s] of a quiet hour; between two values of its thermometer
AGAIN = 60.0  # [s] after a change is said for the first time, the check is asked once more, and a day is over
TRUTHS = {'natural_convection': 'natural_convection', 'friction': 'joint_friction', 'gravity': 'gravity'}
RIGHT = {
    'fan': {'wire.lambda'},
    'natural_convection': {'natural_convection', 'wire.lambda', 'radiation'},
    'friction': {'joint_friction'},
    'gravity': {'gravity'},
    'lost_wires': {'lost_wires'},
    'zero': {'sensor_jump'},
    'room': {'T_E', 'ambient_drift', 'ambient_heating'},
    'nothing': set(),
    'quiet': set(),
}


def main() -> None:
    """Run what is missing, print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--days', type=int, default=12, help='of each kind')
    parser.add_argument('--quiet', type=int, default=0, help='hours without a change')
    parser.add_argument('--seed', type=int, default=8000)
    parser.add_argument('--off', type=float, default=0.0, help='relative error of the parameters that the check knows')
    add_options(parser, 'live_diagnosis.jsonl', 60.0)
    asked = parser.parse_args()
    days = dict.fromkeys(RIGHT, asked.days) | {'quiet': asked.quiet}
    cases = [(kind, asked.seed + 100 * k + day, asked.off) for k, kind in enumerate(RIGHT) for day in range(days[kind])]
    print(table(solved(drawn(cases, asked.share), solve, asked, row)))


def solve(kind: str, seed: int, off: float, pool: Executor) -> dict[str, Any]:
    """One day."""
    random = np.random.default_rng(seed)
    config = Config({**draw_parameters(Config().parameters, random), 'solver.rtol': ROBOT_RTOL}, 'module', 'mas')
    duration = HOUR if kind == 'quiet' else DURATION
    source = draw_random_command(duration, config.parameters['environment.T_E'], random)
    source = beside_a_door(source, random) if kind == 'quiet' else source
    onset, forces = CHECKPOINT * float(random.integers(12, 30)) + float(random.uniform(0.0, CHECKPOINT)), seed % 2 == 0
    changed, warmer, zero, amount = change_of(kind, config, random)
    times = np.arange(0.0, duration, 1.0 / RATE)
    base, model = Model(config), Model(changed)
    predicted = shown(base, simulate(base, source, times))
    state = simulate(base, part(source, 0.0, onset), [onset]).state
    before = times < onset
    after = part(source, onset, duration, warmer)
    start = continued(model, base, shifted(state, onset), after.values[0])
    later = shown(base, simulate(model, after, times[~before] - onset, initial_state=start))
    truth = np.vstack([predicted[before], later + zero])
    std = np.array([NOISE_STD.get(channel, np.nan) for channel in base.structure.channels])
    if not forces:
        std[3:] = np.nan
    measured = truth + std * random.standard_normal(truth.shape)
    noise = np.where(np.isnan(std), 1.0, std)
    wrong = np.exp(off * np.random.default_rng([seed, 1]).standard_normal(len(UNCERTAIN_PARAMETERS)))
    known = config.variant({n: f * config.parameters[n] for n, f in zip(UNCERTAIN_PARAMETERS, wrong.tolist(), strict=True)})
    believed = Model(known)
    findings = watched(known, source, times, measured, shown(believed, simulate(believed, source, times)), noise)
    shows = first_shown(times, (truth - predicted) / noise, np.isnan(std))
    return judged(kind, findings, onset, shows, forces) | {'amount': amount}


def change_of(kind: str, config: Config, random: np.random.Generator) -> tuple[Config, float, Matrix, dict[str, float]]:
    """The model after the change, how much warmer the room is [K], what sensors show too much (channels,), and its size."""
    zero, warmer = np.zeros(len(config.structure.channels)), 0.0
    if kind == 'fan':
        factor = float(random.uniform(1.1, 1.5))
        return config.variant({'wire.lambda': factor * config.parameters['wire.lambda']}), warmer, zero, {'factor': factor}
    if kind in TRUTHS:
        truth = named_truth(TRUTHS[kind])
        values = {p.name: float(random.uniform(*p.realistic)) for p in truth.parameters if p.realistic is not None}
        return config.variant(effects=truth.active(values)), warmer, zero, values
    if kind == 'lost_wires':
        cause: Cause = next(one for one in causes_for(config) if one.name == 'lost_wires')
        values = {str(random.choice(['part', 'part_2'])): float(random.uniform(0.05, 0.3))}
        return cause.in_config(config, values), warmer, zero, values
    if kind == 'zero':
        channel = int(random.integers(0, 3))
        sizes = list(NOISE_STD.values())
        zero[channel] = float(random.choice([-1.0, 1.0]) * random.uniform(3.0, 30.0)) * sizes[channel]
        return config, warmer, zero, {'channel': float(channel), 'size': float(zero[channel])}
    if kind == 'room':
        warmer = float(random.uniform(-2.0, 2.0))
        return config, warmer, zero, {'warmer': warmer}
    return config, warmer, zero, {}


def beside_a_door(source: Input, random: np.random.Generator) -> Input:
    """The same command in a room that gets warmer and colder by up to 2 K within minutes to an hour."""
    end = float(source.times[-1])
    times = np.union1d(source.times, np.arange(0.0, end, TOLD))
    J, T_E = np.asarray(source.values)[np.searchsorted(source.times, times, side='right') - 1].T
    waves = [np.sin(2.0 * np.pi * (times // TOLD * TOLD / random.uniform(200.0, end) + random.uniform())) for _ in range(2)]
    return Input(times, np.column_stack([J, T_E + waves[0] + waves[1]]), source.linear, source.names)


def part(source: Input, begin: float, end: float, warmer: float = 0.0) -> Input:
    """The input from `begin` to `end`, its time beginning anew."""
    times = np.asarray(source.times, float)
    inside = np.flatnonzero((times > begin) & (times < end))
    first = int(np.searchsorted(times, begin, side='right')) - 1
    rows = np.asarray(source.values, float)[[first, *inside, inside[-1] if len(inside) else first]] + (0.0, warmer)
    return Input(np.array([0.0, *(times[inside] - begin), end - begin]), rows, source.linear, source.names)


def shown(model: Model, run: Any) -> Matrix:
    """What sensors show, (k, channels)."""
    columns = model.structure.channel_columns
    return np.column_stack([run.columns.get(name, np.full(len(run.time), np.nan)) for name in columns])


def watched(
    config: Config, source: Input, times: Matrix, measured: Matrix, predicted: Matrix, noise: Matrix
) -> list[LiveFinding]:
    """What the check finds, every CHECKPOINT seconds until it says a change, and AGAIN later."""
    live = LiveDiagnosis(config, causes_for(config), noise)
    live.start(0, (0.0, float(source.values[0, 1])))
    found, before, due = list[LiveFinding](), -1.0, 3.0 * CHECKPOINT
    for k, t in enumerate(times.tolist()):
        changes = [
            InputChange(round(1e9 * at), column, float(value))
            for at, values in zip(source.times.tolist(), source.values, strict=True)
            if before < at <= t
            for column, value in enumerate(values)
        ]
        live.add(ComparedSample(round(1e9 * t), changes, measured[k]), predicted[k], True)
        before = t
        if t >= due:
            one, is_said = live.evaluate(), any(other.has_changed for other in found)
            found += [] if one is None else [one]
            if is_said:
                break
            due += AGAIN if found and found[-1].has_changed else CHECKPOINT
    return found


def first_shown(times: Matrix, difference: Matrix, unseen: NDArray[np.bool_]) -> float:
    """When a change has shown above the noise for the first time [s]: RMS above 1 in a channel over CHECKPOINT."""
    squares = np.where(unseen, 0.0, difference) ** 2
    count = round(CHECKPOINT * RATE)
    sums = np.cumsum(np.vstack([np.zeros((1, squares.shape[1])), squares]), axis=0)
    means = (sums[count:] - sums[:-count]) / count
    above = np.flatnonzero((means > 1.0).any(axis=1))
    return float(times[above[0] + count - 1]) if len(above) else float('nan')


def judged(kind: str, findings: Sequence[LiveFinding], onset: float, shows: float, forces: bool) -> dict[str, Any]:
    """What is kept of a day."""
    said = [one for one in findings if one.has_changed]
    first, last = (said[0], said[-1]) if said else (None, None)
    return {
        'kind': kind,
        'forces': forces,
        'onset': onset,
        'shows': None if np.isnan(shows) else shows,
        'first': None if first is None else [first.stamp / 1e9, first.findings[0].name, first.findings[0].probability],
        'last': None if last is None else [last.stamp / 1e9, last.findings[0].name, last.findings[0].probability],
        'before': sum(one.stamp / 1e9 < onset for one in said),
        'truth': {one.name: one.probability for one in last.findings if one.name in RIGHT[kind]} if last else {},
    }


def row(case: dict[str, Any]) -> str:
    """How one day went."""
    return f'{case["kind"]} {case["case"][1]}: shows {case["shows"]}, first {case["first"]}, last {case["last"]}'


def table(cases: Sequence[dict[str, Any]]) -> str:
    """By kind of change: named right at first and at the end, the delay, and false alarms."""
    lines = [
        '| change | shows | said | right at first | right a minute later | median delay [s] | false before |',
        '|---|' + '---|' * 6,
    ]
    for kind, right in RIGHT.items():
        days = [case for case in cases if case.get('kind') == kind]
        visible = [case for case in days if case['shows'] is not None]
        said = [case for case in visible if case['first']]
        delays = [max(0.0, case['first'][0] - case['shows']) for case in said]
        lines.append(
            f'| {kind} | {len(visible)} of {len(days)} | {len(said)} | '
            f'{of(sum(case["first"][1] in right for case in said), len(said))} | '
            f'{of(sum(case["last"][1] in right for case in said), len(said))} | '
            f'{np.median(delays) if delays else float("nan"):.0f} | {sum(case["before"] for case in days)} |'
        )
    durations = {'nothing': DURATION, 'quiet': HOUR}
    known = [case for case in cases if 'failed' not in case]
    alarms = sum(case['first'] is not None for case in known if case['kind'] in durations)
    hours = sum(durations.get(case['kind'], case['onset']) for case in known) / 3600.0
    said = [case for case in known if case['first'] and case['shows'] is not None]
    right = (sum(case[when][1] in RIGHT[case['kind']] for case in said) for when in ('first', 'last'))
    first, later = (of(count, len(said)) for count in right)
    delay = np.median([max(0.0, case['first'][0] - case['shows']) for case in said]) if said else np.nan
    lines.append(
        f'\nnamed right when first said: {first}, a minute later: {later}; said {delay:.0f} s after it shows (median); '
        f'{alarms + sum(case["before"] for case in said)} false alarms in {hours:.1f} h without a change'
    )
    return '\n'.join(lines)


if __name__ == '__main__':
    main()
