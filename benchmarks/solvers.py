"""The same runs with other solvers, as their users would call them, for comparison.

    python benchmarks/solvers.py [--runs 5] [--json FILE]          (CVODE needs: pip install scikit-sundae)

All get the compiled right-hand side, the same scaled tolerances, a restart at every change of the command and, for
the hybrid model, at every jump (guards as event functions).
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any

import numba
import numpy as np
from common import DURATION, SAMPLES, largest_errors, median_time, module, random_command, report
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from sma_sim import Input, Model, simulate
from sma_sim.compiler.compile import package_compiler
from sma_sim.model.automaton import EDGES
from sma_sim.model.layout import InputPoint, System, SystemState
from sma_sim.model.system import flow, guard
from sma_sim.solver.events import TOLERANCE, jump
from sma_sim.solver.model import new_findings
from sma_sim.solver.simulate import new_run, new_work

Vector = NDArray[np.float64]
GUARDS_PER_MODE = 2
RTOL = 1e-4  # of the other solvers; ours takes its default
EXACT = 1e-9
MAX_RESTARTS = 1000  # of a run, which needs some 40: a solver may find the same event again and again
MAX_CALLS = 300_000  # of the right-hand side in a run: one-step methods need some 10,000, others may take minutes


class Problem:
    """Right-hand side and guards of a model, compiled, with the discrete state that they read."""

    def __init__(self, model: Model) -> None:
        self.model, p = model, model.compiled
        self.scales = model.scales
        self.obs = new_findings(model.compiled)
        self.u = np.array([0.0, 298.0])
        self.calls = 0
        self.compiled = compiled_functions(p)

    def begin(self, first_input: Vector) -> Vector:
        """The start state; modes and frozen fractions are reset."""
        run = new_run(self.model, first_input, new_work(self.model))
        self.state = SystemState(run.state.y.copy(), run.state.mode.copy(), run.state.x_frozen.copy())
        return run.state.y.copy()

    def rhs(self, t: float, y: Vector) -> Vector:
        """dy/dt."""
        dy = np.empty_like(y)
        self.write_rhs(t, y, dy)
        return dy

    def write_rhs(self, t: float, y: Vector, dy: Vector) -> None:
        """dy/dt into `dy` (a copy of y, since some solvers hand out a read-only one)."""
        self.calls += 1
        if self.calls > MAX_CALLS:
            raise RuntimeError(f'{MAX_CALLS} evaluations of the right-hand side, at {t:g} s')
        self.compiled[0](t, self.state._replace(y=np.array(y)), dy, self.u, self.obs)

    def guards(self, t: float, y: Vector, g: Vector) -> None:
        """Guards of the two wires' modes, positive when violated, into `g` (4,)."""
        dy = np.empty_like(y)
        self.compiled[1](t, self.state._replace(y=np.array(y)), dy, self.u, self.obs, g)

    def jump_at_once(self, t: float, y: Vector) -> None:
        """Take the jumps that are due where a stretch begins, which no event function would see."""
        if not self.model.compiled.mas:
            g = np.zeros(4)
            self.guards(t, y, g)
            self.take_jumps(t, y, [int(k) for k in np.flatnonzero(g > 0.0)])

    def take_jumps(self, t: float, y: Vector, which: list[int]) -> None:
        """Jump through the guards that fired, one per wire."""
        self.rhs(t, y)
        for wire in sorted({w // GUARDS_PER_MODE for w in which}):
            first = min(w % GUARDS_PER_MODE for w in which if w // GUARDS_PER_MODE == wire)
            edges = [k for k, edge in enumerate(EDGES) if edge.source == self.state.mode[wire]]
            jump(edges[first], wire, self.state, self.obs)


def compiled_functions(p: System) -> tuple[Any, Any]:
    """Right-hand side and guards as functions of few arguments: the system is a constant in them but for its scratch."""
    compiled_flow, compiled_guard = package_compiler().function(flow), package_compiler().function(guard)
    table = np.full((6, GUARDS_PER_MODE), -1)
    for edge in EDGES:
        table[edge.source, np.argmax(table[edge.source] < 0)] = edge.guard
    still, tolerance, whole = np.zeros(2), TOLERANCE.copy(), with_scratch(p)

    @numba.njit(error_model='numpy')  # type: ignore[untyped-decorator]
    def compiled_rhs(t, state, dy, u, obs, scratch):  # type: ignore[no-untyped-def]
        compiled_flow(t, state, InputPoint(u, still), whole(scratch), dy, obs)

    @numba.njit(error_model='numpy')  # type: ignore[untyped-decorator]
    def compiled_guards(t, state, dy, u, obs, g, scratch):  # type: ignore[no-untyped-def]
        own = whole(scratch)
        compiled_flow(t, state, InputPoint(u, still), own, dy, obs)
        for i in range(2):
            for k in range(2):
                which = table[state.mode[i], k]
                g[2 * i + k] = -1.0 if which < 0 else compiled_guard(which, i, own, obs) - tolerance[which]

    scratch = (p.effects.s, p.effects.out, p.effects.contribution, p.structure.effects)
    return lambda *given: compiled_rhs(*given, scratch), lambda *given: compiled_guards(*given, scratch)


def with_scratch(p: System) -> Any:
    """A compiled function of the scratch arrays that gives the whole system: constants of compiled code are read-only."""
    kinds = {'System': type(p), 'Effects': type(p.effects), 'Structure': type(p.structure), 'p': p}
    effects = ['s', 'out', 'contribution']
    inner = ', '.join(f'scratch[{effects.index(f)}]' if f in effects else f'p.effects.{f}' for f in p.effects._fields)
    table = ', '.join('scratch[3]' if f == 'effects' else f'p.structure.{f}' for f in p.structure._fields)
    parts = {'effects': f'Effects({inner})', 'structure': f'Structure({table})'}
    fields = ', '.join(parts.get(name, f'p.{name}') for name in p._fields)
    exec(f'def whole(scratch): return System({fields})', kinds)
    return numba.njit(kinds['whole'])


Solve = Callable[[Problem, float, float, Vector, Vector, float], tuple[float, Vector, Vector, list[int], int]]


def scipy_solver(method: str) -> Solve:
    """solve_ivp with terminal events."""

    def solve(
        problem: Problem, t: float, t_end: float, y: Vector, asked: Vector, rtol: float
    ) -> tuple[float, Vector, Vector, list[int], int]:
        g = np.zeros(4)

        def event(k: int) -> Any:
            def function(time: float, state: Vector) -> float:
                problem.guards(time, state, g)
                return float(g[k])

            function.terminal, function.direction = True, 1.0  # type: ignore[attr-defined]
            return function

        events = None if problem.model.compiled.mas else [event(k) for k in range(4)]
        done = solve_ivp(
            problem.rhs,
            (t, t_end),
            y,
            method,
            asked,
            events=events,
            rtol=rtol,
            atol=rtol * problem.scales,
            first_step=min(1e-4, t_end - t),
        )
        if done.status < 0:
            raise RuntimeError(done.message)
        fired = [k for k, times in enumerate(done.t_events or []) if len(times)]
        if fired:
            seen = np.reshape(done.y, (len(y), -1))
            return done.t_events[fired[0]][-1], done.y_events[fired[0]][-1], seen, fired, done.nfev
        return t_end, (done.y[:, -1] if len(asked) else y), done.y, fired, done.nfev

    return solve


def cvode(
    problem: Problem, t: float, t_end: float, y: Vector, asked: Vector, rtol: float
) -> tuple[float, Vector, Vector, list[int], int]:
    """CVODE (BDF) of SUNDIALS through scikit-sundae."""
    from sksundae.cvode import CVODE

    options: dict[str, Any] = {}
    if not problem.model.compiled.mas:

        def events(time: float, state: Vector, g: Vector) -> None:
            problem.guards(time, state, g)

        events.terminal, events.direction = [True] * 4, [1] * 4  # type: ignore[attr-defined]
        options = {'eventsfn': events, 'num_events': 4}
    solver = CVODE(problem.write_rhs, rtol=rtol, atol=rtol * problem.scales, max_num_steps=100_000, **options)
    times = np.unique(np.concatenate([[t], asked, [t_end]]))
    done = solver.solve(times, y)
    fired = [] if done.i_events is None else [k for k in range(4) if done.i_events[-1][k] > 0]
    keep = np.isin(done.t, asked)
    return float(done.t[-1]), np.array(done.y[-1]), np.array(done.y[keep]).T, fired, int(done.nfev)


def run_other(solve: Solve, problem: Problem, source: Input, rtol: float) -> tuple[dict[str, Vector], int]:
    """A run over all changes of the command and all jumps: samples of the pose and temperatures, restarts."""
    values = np.asarray(source.values)
    y = problem.begin(values[0])
    rows = np.full((len(y), len(SAMPLES)), np.nan)
    problem.calls, restarts = 0, 0
    for k in range(len(source.times) - 1):
        t, t_end = float(source.times[k]), float(source.times[k + 1])
        problem.u[:] = values[k]
        while t < t_end:
            # the end is asked for too: it is where the next stretch begins
            problem.jump_at_once(t, y)
            inside = np.logical_and(t <= SAMPLES, t_end > SAMPLES)
            asked = np.append(SAMPLES[inside], t_end)
            t_new, y, seen, fired, _ = solve(problem, t, t_end, y, asked, rtol)
            count = min(int(np.sum(SAMPLES[inside] <= t_new)), seen.shape[1])
            first = int(np.argmax(inside)) if inside.any() else 0
            rows[:, first : first + count] = seen[:, :count]
            t, restarts = t_new, restarts + 1
            if restarts > MAX_RESTARTS:
                raise RuntimeError(f'no progress at {t:g} s')
            if fired:
                problem.take_jumps(t, y, fired)
    rows[:, SAMPLES >= DURATION] = y[:, None]
    first_T = problem.model.compiled.first_T
    names = {'U_x_m': 0, 'U_y_m': 1, 'alpha_rad': 2, 'T_1_K': first_T, 'T_2_K': first_T + 1}
    return {name: rows[index] for name, index in names.items()}, restarts


def measure(arguments: argparse.Namespace) -> dict[str, Any]:
    """Time, right-hand-side calls, restarts and error of every solver."""
    solvers: dict[str, Solve] = {f'SciPy {m}': scipy_solver(m) for m in ('Radau', 'BDF', 'LSODA')}
    solvers['CVODE'] = cvode
    result: dict[str, Any] = {}
    for kind in ('hybrid', 'mas'):
        exact = [simulate(module(kind, EXACT), random_command(seed), SAMPLES).columns for seed in range(arguments.runs)]
        rows = {'sma_sim': ours(kind, 1e-5, exact)}
        for name, solve in solvers.items():
            rows[name] = theirs(kind, name, solve, RTOL, exact)
        for row in rows.values():
            row['time_over_sma_sim'] = row['median_ms'] / rows['sma_sim']['median_ms']
        result[kind] = rows
    return result


def ours(kind: str, rtol: float, exact: list[Any]) -> dict[str, Any]:
    """The numbers of sma_sim's own stepper."""
    times, errors, steps = [], [], []
    model = module(kind, rtol)
    for seed, truth in enumerate(exact):
        command = random_command(seed)
        run = simulate(model, command, SAMPLES)
        steps.append(run.steps)
        errors.append(largest_errors(run.columns, truth)['alpha'])
        times.append(1e3 * median_time(lambda command=command: simulate(model, command, SAMPLES), 3))
    return {
        'rtol': rtol,
        'median_ms': float(np.median(times)),
        'steps': int(np.median(steps)),
        'alpha_error_deg': float(np.median(errors)),
    }


def theirs(kind: str, name: str, solve: Solve, rtol: float, exact: list[Any]) -> dict[str, Any]:
    """The numbers of another solver; a failure is reported, not hidden."""
    problem = Problem(module(kind, 1e-5))
    times, errors, calls, restarts = [], [], [], []
    for seed, truth in enumerate(exact):
        command = random_command(seed)
        try:
            columns, count = run_other(solve, problem, command, rtol)
            calls.append(problem.calls)
            times.append(1e3 * median_time(lambda command=command: run_other(solve, problem, command, rtol), 1))
        except Exception as error:
            print(f'{kind}, {name}, command {seed}: {type(error).__name__}: {error}')
            continue
        errors.append(largest_errors(columns, truth)['alpha'])
        restarts.append(count)
    if not times:
        return {'rtol': rtol, 'median_ms': float('nan'), 'failed': len(exact)}
    return {
        'rtol': rtol,
        'median_ms': float(np.median(times)),
        'rhs_calls': int(np.median(calls)),
        'restarts': int(np.median(restarts)),
        'alpha_error_deg': float(np.median(errors)),
        'failed': len(exact) - len(times),
    }


if __name__ == '__main__':
    report(__doc__ or '', measure, runs=5)
