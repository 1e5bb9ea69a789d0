"""How alike effects and parameters are in measurements, and how large effects are beside the sensors' noise.

    python benchmarks/similarity.py [--closest 4] [--json FILE]

Every effect is taken to half of its default (parameters that are neutral by default: half of the upper realistic end),
every parameter of the model 3 % up, over two random runs of 100 s of the MAS model, alone. `size` is the root mean
square of the change of the shown channels over their noise; `closest` the cosines with the changes that are most alike.
"""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np
from common import report
from numpy.typing import NDArray

from sma_sim import Config, Input, Model, default_parameters, find_effects, simulate
from sma_sim.model.effects.discovery import ActiveEffect
from sma_sim.model.effects.meaning import acts_on
from sma_sim.model.structures.discovery import package_structures

Vector = NDArray[np.float64]

NOISE = {'U_x_m': 2e-6, 'U_y_m': 1e-5, 'alpha_rad': np.radians(0.02), 'F_1_N': 0.05, 'F_2_N': 0.05, 'stress_Pa': 1e6}
DATASETS = {
    'module, pose': ('module', ('U_x_m', 'U_y_m', 'alpha_rad')),
    'module, pose and forces': ('module', ('U_x_m', 'U_y_m', 'alpha_rad', 'F_1_N', 'F_2_N')),
    'wire, stress': ('wire', ('stress_Pa',)),
}
START = {'initial.x_M_1': 0.56, 'initial.x_M_2': 0.56}
COMMON = (
    'wire.E_A',
    'wire.E_M',
    'wire.eps_T',
    'wire.sigma_T',
    'wire.c_V',
    'wire.lambda',
    'wire.sigma_MW0',
    'wire.dsigma',
    'initial.x_M_1',
)
OF_MODULE = ('beam.E', 'beam.b_y', 'beam.b_alpha', 'plate.W', 'initial.x_M_2')


def random_input(system: str, seed: int) -> Input:
    """Held commands of the module, strain ramps and pulses of heat of a wire, over 100 s."""
    random = np.random.default_rng(seed)
    times = np.concatenate([[0.0], np.sort(random.uniform(0.0, 100.0, 18)), [100.0]])
    T_E = np.full(len(times), 298.0)
    if system == 'module':
        return Input(times, np.column_stack([random.uniform(-14.0, 14.0, len(times)), T_E]), (False, False))
    strain, J = random.uniform(0.0, 0.065, len(times)), random.uniform(0.0, 0.8, len(times))
    return Input(times, np.column_stack([strain, J * (random.random(len(times)) > 0.4), T_E]), (True, False, False))


def shown(
    system: str, channels: tuple[str, ...], changes: dict[str, float], effects: tuple[ActiveEffect, ...] = ()
) -> Vector:
    """The shown channels of both runs over their noise."""
    values = default_parameters() | START | {'solver.rtol': 1e-7} | changes
    model = Model(Config(values, system, 'mas', effects))
    runs = [simulate(model, random_input(system, seed), np.arange(0.0, 100.0, 0.1)) for seed in (0, 1)]
    parts: list[Vector] = [run[channel] / NOISE[channel] for run in runs for channel in channels]
    return np.concatenate(parts)


def variants(system: str) -> dict[str, ActiveEffect]:
    """Every effect with one of its parameters off neutral, by name (and parameter, where it has several)."""
    made = {}
    for name, found in find_effects().items():
        strengths = [p for p in found.parameters if p.neutral is not None]
        if not acts_on(found, package_structures()[system]):
            continue
        for strength in strengths:
            neutral, upper = strength.neutral or 0.0, (strength.realistic or strength.bounds)[1]
            far = strength.default if strength.default != neutral else upper
            values = tuple(
                neutral + 0.5 * (far - neutral) if p is strength else p.default if p.neutral is None else p.neutral
                for p in found.parameters
            )
            made[f'{name}: {strength.name}' if len(strengths) > 1 else name] = ActiveEffect(found, values)
    return made


def indistinguishable(system: str, channels: tuple[str, ...], closest: int) -> dict[str, Any]:
    """Size of each effect and what it is most like."""
    nominal = shown(system, channels, {})
    effects = variants(system)
    change = {name: shown(system, channels, {}, (effect,)) - nominal for name, effect in effects.items()}
    for name in COMMON + (OF_MODULE if system == 'module' else ()):
        value = (default_parameters() | START)[name]
        change[name] = shown(system, channels, {name: 1.03 * value}) - nominal
    lengths = {name: float(np.linalg.norm(vector)) for name, vector in change.items()}
    table: dict[str, Any] = {}
    for name in effects:
        size = lengths[name] / np.sqrt(len(nominal))
        others = [other for other in change if other != name and lengths[name] * lengths[other] > 0.0]
        cosine = {o: float(change[name] @ change[o] / lengths[name] / lengths[o]) for o in others}
        best = sorted(cosine, key=lambda o: -abs(cosine[o]))[:closest]
        table[name] = {'size': size} | {o: round(cosine[o], 4) for o in best}
    return table


def measure(arguments: argparse.Namespace) -> dict[str, Any]:
    """All tables."""
    return {name: indistinguishable(*dataset, arguments.closest) for name, dataset in DATASETS.items()}


if __name__ == '__main__':
    report(__doc__ or '', measure, closest=4)
