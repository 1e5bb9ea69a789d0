"""What a seed decides: the true parameters, the hidden effects, the commands."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from sma_sim.challenge.truth import Truth, truths
from sma_sim.model.config import suggestion
from sma_sim.model.errors import UserError
from sma_sim.solver.inputs import Input

# Off by 5 to 15 % each, either way. Lengths are known; what is not is how far the wires were stretched.
UNCERTAIN_PARAMETERS = (
    'wire.E_A',
    'wire.E_M',
    'wire.eps_T',
    'wire.sigma_T',
    'wire.c_V',
    'wire.lambda',
    'wire.sigma_MW0',
    'wire.dsigma',
    'beam.E',
    'beam.b_x',
    'beam.b_y',
    'beam.b_alpha',
)
MIN_PARAMETER_ERROR, MAX_PARAMETER_ERROR = 0.05, 0.15
MAX_LENGTH_DEVIATION = 0.003  # of wire.l0, at the most
MAX_POWER = 15.0  # [W]
COMMAND_CHANGES = (4, 14)  # of the command, in 100 s
TIME_DIGITS = 6  # digits to which the instants of the command are rounded
OUTSIDE_SHARE = 0.25  # of the effects, where the seed decides


def draw_parameters(nominal: Mapping[str, float], random: np.random.Generator) -> dict[str, float]:
    """The true robot's parameters, by full name."""
    values = dict(nominal)
    for name in UNCERTAIN_PARAMETERS:
        values[name] *= 1.0 + float(random.choice((-1.0, 1.0)) * random.uniform(MIN_PARAMETER_ERROR, MAX_PARAMETER_ERROR))
    values['wire.l0'] *= 1.0 + float(random.uniform(-MAX_LENGTH_DEVIATION, MAX_LENGTH_DEVIATION))
    return values


def draw_random_command(duration: float, T_E: float, random: np.random.Generator) -> Input:
    """A command that changes at random times in 0 to `duration` [s] to random levels [W]; the last row is the end."""
    fewest, most = COMMAND_CHANGES
    count = max(1, round(random.integers(fewest, most + 1) * duration / 100.0))
    changes = np.unique(np.round(random.uniform(0.0, duration, count), TIME_DIGITS))
    inside = changes[(changes > 0.0) & (changes < duration)]
    times = np.concatenate([[0.0], inside, [duration]])
    levels = random.uniform(-MAX_POWER, MAX_POWER, len(times))
    levels[-1] = levels[-2]
    return Input(times, np.column_stack([levels, np.full(len(times), T_E)]), (False, False))


def draw_truths(
    random: np.random.Generator, effects: int | None, outside: bool | None, kinds: Sequence[str]
) -> tuple[Truth, ...]:
    """The hidden effects: those of `kinds`, and others until there are `effects` (0 to 2; None: drawn too).

    `outside` says whether the drawn ones are outside the library; None leaves that to chance as well. Raises UserError.
    """
    chosen = [named_truth(kind) for kind in kinds]
    if len({truth.name for truth in chosen}) < len(chosen):
        raise UserError(f'kinds {", ".join(kinds)}: expected different effects, one of them is there twice')
    drawn = int(random.integers(0, 3))
    count = effects if effects is not None else len(chosen) or drawn
    if not 0 <= count <= 2 or len(chosen) > count:
        named = f' with {len(chosen)} named' if chosen else ''
        raise UserError(f'effects = {count}{named}: expected 0, 1 or 2 hidden effects, at least as many as are named')
    while len(chosen) < count:
        beyond = bool(random.random() < OUTSIDE_SHARE) if outside is None else outside
        pool = [truth for truth in truths().values() if (not truth.library) == beyond and truth not in chosen]
        chosen.append(pool[random.integers(len(pool))])
    return tuple(chosen)


def named_truth(kind: str) -> Truth:
    """A truth by its name, by that without `truth_`, or by the library's name. Raises UserError."""
    by_kind = {truth.library or name.removeprefix('truth_'): truth for name, truth in truths().items()}
    found = truths().get(kind) or by_kind.get(kind) or truths().get(f'truth_{kind}')
    if found is None:
        known = ', '.join(sorted(by_kind))
        raise UserError(f'kind {kind}: unknown effect{suggestion(kind, by_kind)}; known are {known}')
    return found
