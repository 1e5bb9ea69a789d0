"""Time of one evaluation of the flow beside a straight transcription of the paper's equations, and cost of samples.

python benchmarks/flow.py [--turns 60] [--json FILE]

The transcription knows nothing but two wires on a beam: no effects, no ports, no record of what it finds on the way. Both
are called from compiled code; times are the least of many turns, taken alternately, of the processor and not of the clock.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numba
import numpy as np
from common import DURATION, module, random_command, report

from sma_sim import Model, simulate
from sma_sim.compiler.compile import OWN, Compiler, content_key
from sma_sim.model.automaton import INNER, MARTENSITE, TO_AUSTENITE, TO_MARTENSITE
from sma_sim.model.layout import Evaluation, InputPoint, System, SystemState
from sma_sim.model.parameters import K_B, BeamConstants, WireConstants
from sma_sim.model.system import EVERYTHING, update_flow
from sma_sim.solver.effect_table import own_scratch
from sma_sim.solver.simulate import new_run, new_work

CALLS = 2000
HEATING, T_E = 10.0, 298.0  # [W], [K]
MODES = {
    'hybrid, resting': (MARTENSITE, INNER),
    'hybrid, transforming': (TO_MARTENSITE, TO_AUSTENITE),
    'mas': (INNER, INNER),
}
POSE = ('U_x', 'U_y', 'alpha')
SAMPLES: Mapping[str, tuple[int, tuple[str, ...] | None]] = {
    '3': (3, None),
    '501': (501, None),
    '5001': (5001, None),
    '5001 of alpha': (5001, ('alpha',)),
    '5001 of F_1': (5001, ('F_1',)),
    '5001 of pose and forces': (5001, (*POSE, 'F_1', 'F_2')),
}


def transcription(y: Any, modes: Any, frozen: Any, mas: bool, w: WireConstants, b: BeamConstants, dy: Any) -> None:
    """dy/dt of the module under HEATING: MAS3 to MAS9, L2a to L3b, X0 to X8, EB-Ba to EB-B3, as they are written."""
    F_x = -b.k_x * y[0] - b.b_x * y[3]
    F_y = -b.k_y * y[1] + b.k_ya * y[2] - b.b_y * y[4]
    M = -b.k_a * y[2] + b.k_ya * y[1] - b.b_alpha * y[5]
    for i in range(2):
        half = 0.5 * (2.0 * i - 1.0) * b.W
        across = y[1] + half * (1.0 - math.cos(y[2]))
        along = b.L + y[0] + half * math.sin(y[2])
        length = math.sqrt(across**2 + along**2)
        by_x, by_y = along / length, across / length
        by_alpha = half * (across * math.sin(y[2]) + along * math.cos(y[2])) / length
        eps, deps = length / w.l0 - 1.0, (by_x * y[3] + by_y * y[4] + by_alpha * y[5]) / w.l0
        T = y[6 + i]
        s_MW = w.sigma_MW0 + w.sigma_T * (T - w.T0)
        s_A, s_M = s_MW + 0.5 * w.dsigma, s_MW - 0.5 * w.dsigma
        transforming = not mas and (modes[i] == TO_MARTENSITE or modes[i] == TO_AUSTENITE)
        x = y[8 + i] if mas else frozen[i]
        if transforming:
            s = s_A if modes[i] == TO_MARTENSITE else s_M
            x = w.E_M * (w.E_A * eps - s) / ((w.E_A - w.E_M) * s + w.E_A * w.E_M * w.eps_T)
        modulus = 1.0 / (x / w.E_M + (1.0 - x) / w.E_A)
        sigma = (eps - w.eps_T * x) * modulus
        gamma_T = (w.d * s_MW + w.eps_T) * w.sigma_T
        gamma = (0.5 * w.d * sigma + w.eps_T) * sigma - (0.5 * w.d * s_MW + w.eps_T) * s_MW
        latent = w.volume * (T * gamma_T + gamma)
        capacity = w.volume * (w.rho * w.c_V - T * w.d * w.sigma_T**2 * (x - 1.0))
        J = max(HEATING if i == 0 else -HEATING, 0.0) / w.n
        heat = J - w.lambda_ * w.surface * (T - T_E)
        dx = 0.0
        if mas:
            inverse_E_I = (w.eps_T + s_M / w.E_M - s_A / w.E_A) / (s_A - s_M)
            barrier_AM = 0.5 * max(s_A - sigma, 0.0) ** 2 * (1.0 / w.E_A + inverse_E_I)
            barrier_MA = 0.5 * max(sigma - s_M, 0.0) ** 2 * (1.0 / w.E_M + inverse_E_I)
            p_AM = w.omega_x * math.exp(-w.V_L / (K_B * T) * barrier_AM)
            p_MA = w.omega_x * math.exp(-w.V_L / (K_B * T) * barrier_MA)
            dx = -p_MA * x + p_AM * (1.0 - x)
            dy[8 + i] = dx
        elif transforming:
            by_fraction = -(w.eps_T + sigma * w.d) * modulus
            dx = -(modulus * deps - w.sigma_T * heat / capacity) / (by_fraction - w.sigma_T * latent / capacity)
        dy[6 + i] = (heat + latent * dx) / capacity
        force = w.n * w.section * sigma
        F_x, F_y, M = F_x - by_x * force, F_y - by_y * force, M - by_alpha * force
    dy[0], dy[1], dy[2] = y[3], y[4], y[5]
    dy[3], dy[4], dy[5] = F_x / b.m_H, F_y / b.m_H, M / b.J_H


compiled_transcription: Any = numba.njit(error_model='numpy')(transcription)


@numba.njit(error_model='numpy')  # type: ignore[untyped-decorator]
def transcription_repeatedly(count, y, modes, frozen, mas, w, b, dy):  # type: ignore[no-untyped-def]
    """Many evaluations of the transcription, each at another temperature."""
    for _ in range(count):
        y[6] += 1e-9
        compiled_transcription(y, modes, frozen, mas, w, b, dy)


def flow_repeatedly(count: int, state: SystemState, point: InputPoint, p: System, found: Evaluation) -> None:
    """Many evaluations of the flow, each at another temperature."""
    for _ in range(count):
        state.y[6] += 1e-9
        update_flow(0.0, state, point, p, found, EVERYTHING)


def least_times(calls: Mapping[str, Callable[[], object]], turns: int) -> dict[str, float]:
    """The least processor time [s] of each call, taken alternately."""
    least = dict.fromkeys(calls, math.inf)
    for call in calls.values():
        call()
    for _ in range(turns):
        for name, call in calls.items():
            start = time.process_time()
            call()
            least[name] = min(least[name], time.process_time() - start)
    return least


def evaluation(name: str, turns: int) -> dict[str, float]:
    """Nanoseconds of one evaluation of both, and their largest relative difference."""
    model = module('mas' if name == 'mas' else 'hybrid', 1e-4)
    p, work = own_scratch(model.compiled), new_work(model)
    state = new_run(model, np.array([HEATING, T_E]), work).state
    state.mode[:] = MODES[name]
    state.y[2:8] = 0.05, 1e-3, 2e-3, 0.1, T_E + 60.0, T_E + 5.0
    point = InputPoint(np.array([HEATING, T_E]), np.zeros(2))
    ours = Compiler(content_key(Path(__file__)), (*OWN, __name__)).function(flow_repeatedly)
    y, dy = state.y.copy(), np.zeros_like(state.y)
    calls = {
        'sma_sim': lambda: ours(CALLS, state, point, p, work.first),
        'transcription': lambda: transcription_repeatedly(
            CALLS, y, state.mode, state.x_frozen, p.mas, p.wire, model.constants, dy
        ),
    }
    least = least_times(calls, turns)
    difference = np.max(np.abs(dy - work.first.dy) / np.maximum(np.abs(dy), 1e-12))
    times = {f'{name}_ns': 1e9 * seconds / CALLS for name, seconds in least.items()}
    return times | {'ratio': least['sma_sim'] / least['transcription'], 'largest_difference': float(difference)}


def cost_of_samples(model: Model, turns: int) -> dict[str, dict[str, float]]:
    """Milliseconds of a 100 s run by what is sampled, and over a run with 3 samples."""
    command = random_command(3)

    def run(count: int, channels: tuple[str, ...] | None) -> Callable[[], object]:
        times = np.linspace(0.0, DURATION, count)
        return lambda: simulate(model, command, times, channels=channels)

    least = least_times({name: run(*what) for name, what in SAMPLES.items()}, turns)
    return {name: {'ms': 1e3 * s, 'over_3_samples': s / least['3']} for name, s in least.items()}


def measure(arguments: argparse.Namespace) -> dict[str, Any]:
    """All numbers."""
    samples = {
        kind: cost_of_samples(module(kind, rtol), arguments.turns) for kind, rtol in (('hybrid', 1e-4), ('mas', 3e-5))
    }
    return {
        'one evaluation of the flow': {name: evaluation(name, arguments.turns) for name in MODES},
        **{f'100 s run, {kind}, by samples': rows for kind, rows in samples.items()},
    }


if __name__ == '__main__':
    report(__doc__ or '', measure, turns=60)
