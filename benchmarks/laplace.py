"""Are the odds of two models by Laplace's method those of nested sampling? On problems that are small enough for both.

    pip install dynesty
    python benchmarks/laplace.py [--pairs 20] [--live 250] [--minutes 120] [--at-once 2]

Each pair is the module without and with one listed effect, fitted to one recording of 20 s at 5 Hz with the noise of the
challenges: two parameters of the module, where its wires start, and the parameters of the effect are unknown. In half of the
recordings the effect is there, so strong that the best fit without it is a few to MOST nats less likely: where two models
compete. Beyond, nothing depends on it: the posterior is the same whether a model is 1,000 or 1,010 nats behind, and the
residuals of that model are so large that its Gauss-Newton Hessian is not that of its cost. Both methods have the same
priors, those of the search, and the same overdispersion; dynesty (Speagle 2020) integrates over all unknowns within their
bounds.

Nested sampling of a posterior that is a thousand times narrower than its prior takes most of its time to find it. So it
draws from a density q with heavy tails about the optimum (Student's t with DEGREES degrees of freedom, WIDTH times as wide
as the posterior) and weighs by prior over q, which leaves the integral as it is; other optima lie in the tails. New points
come from random walks, whose number of model runs does not depend on the shape of the posterior.

Asked is |difference of log odds| at most 1 in 95 % of pairs. Finished pairs are kept in --file.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from threading import Event
from typing import Any

import numpy as np
from cases import add_options, drawn, of, solved
from numpy.typing import NDArray
from scipy.stats import t as student

from sma_sim import Config, Dataset, FitOptions, Input, Model, Recording, default_parameters, simulate
from sma_sim.challenge.robot import NOISE_STD
from sma_sim.evidence.data.recording import CHANNEL_COLUMNS
from sma_sim.evidence.estimation.calibrate import problem_for
from sma_sim.evidence.estimation.fit_result import FitResult
from sma_sim.evidence.estimation.levenberg_marquardt import refit
from sma_sim.evidence.estimation.problem import Problem, at_defaults, residuals_at, start_point
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.estimation.stop_criteria import ADDED_EFFECT, FROM_PRIORS
from sma_sim.evidence.model_selection.candidates import Candidate, candidates_for
from sma_sim.evidence.model_selection.model_changes import with_candidate
from sma_sim.evidence.model_selection.score_tests import at_finite_step
from sma_sim.evidence.search.prior import prior_of_values
from sma_sim.evidence.search.score import Evidence, evidence_of
from sma_sim.model.effects.discovery import ActiveEffect
from sma_sim.solver.simulate import SimulationError

EFFECTS = (
    'gravity', 'natural_convection', 'thermal_crosstalk', 'polycrystal', 'driver_lag', 'driver_deadband', 'joint_friction',
    'beam_nonlinearity', 'power_gain_mismatch', 'clausius_clapeyron_mismatch',
)  # fmt: skip
FREE = ('beam.E', 'wire.c_V')
DURATION, RATE, FIRST_SEED = 20.0, 5.0, 9100
T_E = 298.0  # [K]
MOST = 20.0  # nats that an effect is worth
SCALINGS = 3  # of a strength: from the default it may be far
AGREED = 1.0  # nats
DEGREES, WIDTH = 3.0, 2.0
IMPOSSIBLE = -1e100  # log likelihood of what cannot be simulated
Vector = NDArray[np.float64]


def solve(effect: str, nats: float, seed: int, live: int, pool: Executor) -> dict[str, Any]:
    """The log odds of the model with the effect against that without it, by both methods."""
    context, nominal = SearchContext(pool, Event()), Config(default_parameters(), 'module', 'hybrid')
    candidate = next(one for one in candidates_for(nominal) if one.name == effect)
    strength = strength_worth(nats, nominal, candidate, seed, context) if nats else 0.0
    dataset = recorded(nominal, candidate, strength, seed)
    without = fit_without(dataset, nominal, context)
    with_it = fit_with(without, candidate, context)
    evidences = [evidence_of(fit, 0.0, context) for fit in (without, with_it)]
    k = min(one.overdispersion for one in evidences)
    sampled = [nested(fit, one, k, live, seed, context) for fit, one in zip((without, with_it), evidences, strict=True)]
    return {
        'laplace': evidences[1].score(k) - evidences[0].score(k), 'nested': sampled[1][0] - sampled[0][0],
        'std': math.hypot(sampled[0][1], sampled[1][1]), 'k': k, 'unknowns': [len(one.z) for one in evidences],
        'strength': strength, 'errors': [without.error, with_it.error], 'calls': [sampled[0][2], sampled[1][2]],
    }  # fmt: skip


def strength_worth(nats: float, nominal: Config, candidate: Candidate, seed: int, context: SearchContext) -> float:
    """The part of an effect's default without which the best fit is about so many nats less likely: in proportion to its
    square, as long as the effect is weak."""  # fmt: skip
    strength = 1.0
    for _ in range(SCALINGS):
        fit = fit_without(recorded(nominal, candidate, strength, seed), nominal, context)
        excess = max(1.0, 0.5 * (fit.squares - fit.problem.samples))
        strength *= min(1.0, math.sqrt(nats / excess))
    return strength


def recorded(nominal: Config, candidate: Candidate, strength: float, seed: int) -> Dataset:
    """One recording of a module whose free parameters are a little off, with a part of the effect at its default."""
    random = np.random.default_rng(seed)
    parameters = {**nominal.parameters, **{name: nominal.parameters[name] * random.uniform(0.9, 1.1) for name in FREE}}
    values = tuple(
        p.default if p.neutral is None else float(p.neutral) + strength * (p.default - float(p.neutral))
        for p in candidate.effect.parameters
    )
    active = (ActiveEffect(candidate.effect, values),) if strength else ()
    times = np.array([0.0, *np.sort(random.uniform(1.0, DURATION - 1.0, 3)), DURATION])
    levels = random.uniform(-12.0, 12.0, len(times))
    source = Input(times, np.column_stack([levels, np.full(len(times), T_E)]), (False, False))
    run = simulate(Model(Config(parameters, 'module', 'hybrid', active)), source, RATE)
    channels = {
        name: run[CHANNEL_COLUMNS[name]] + std * random.standard_normal(len(run.time)) for name, std in NOISE_STD.items()
    }
    return Dataset((Recording('run1', 'module', run.time, channels, source),), dict(NOISE_STD))


def fit_without(dataset: Dataset, nominal: Config, context: SearchContext) -> FitResult:
    """The nominal model, fitted; the delay is known."""
    options = FitOptions(free=FREE, kinetics='hybrid', starts=1, intervals=False)
    problem = replace(problem_for(dataset, nominal, options, 1), delay=0.0)
    return fitted([(problem, start_point(problem))], context)


def fit_with(base: FitResult, candidate: Candidate, context: SearchContext) -> FitResult:
    """The model with the effect: the best of the fits from a finite step, to either side, and from its defaults."""
    start = at_finite_step(candidate)
    turned = {
        p.parameter: 2.0 * p.neutral - start.values[p.parameter]
        for p in candidate.families[0]
        if p.parameter in start.values
    }
    starts = [with_candidate(base, one) for one in (start, replace(start, values={**start.values, **turned}))]
    problem = starts[0][0]
    return fitted([*starts, (problem, at_defaults(problem))], context)


def fitted(starts: Sequence[tuple[Problem, Vector]], context: SearchContext) -> FitResult:
    """The best of several fits."""
    tried = [refit(problem, z, context, how) for problem, z in starts for how in (ADDED_EFFECT, FROM_PRIORS)]
    found = [fit for fit in tried if fit is not None]
    if not found:
        raise SimulationError('the model cannot be simulated from any start')
    return min(found, key=lambda fit: fit.cost)


def nested(
    fit: FitResult, evidence: Evidence, k: float, live: int, seed: int, context: SearchContext
) -> tuple[float, float, int]:
    """Log evidence, its standard deviation, and how often the model was run, by nested sampling."""
    import dynesty

    problem, z = fit.problem, evidence.z
    low, high = problem.limits()
    hessian = np.eye(len(z))
    for part in evidence.parts:
        hessian[np.ix_(part.indices, part.indices)] += part.hessian / k**2
    spread = WIDTH * np.linalg.cholesky(np.linalg.inv(hessian))
    log_volume, calls = float(np.log(np.diag(spread)).sum()), [0]

    def point(cube: Vector) -> Vector:
        away: Vector = z + spread @ student.ppf(cube, DEGREES)
        return away

    def log_likelihood(at: Vector) -> float:
        if np.any(at < low) or np.any(at > high):
            return IMPOSSIBLE
        calls[0] += 1
        residuals = residuals_at(problem, at, context.pool)
        if any(one is None for one in residuals):
            return IMPOSSIBLE
        squares = sum(float(np.vdot(one, one)) for one in residuals)
        _, _, precision, log_density = prior_of_values(problem, at)
        log_prior = log_density - 0.5 * float(at @ (precision * at)) - 0.5 * len(at) * math.log(2.0 * math.pi)
        log_q = float(student.logpdf(np.linalg.solve(spread, at - z), DEGREES).sum()) - log_volume
        return -0.5 * squares / k**2 + log_prior - log_q

    sampler = dynesty.NestedSampler(
        log_likelihood, point, len(z), nlive=live, bound='multi', sample='rwalk', rstate=np.random.default_rng(seed)
    )
    sampler.run_nested(dlogz=0.05, print_progress=False)
    return float(sampler.results.logz[-1]), float(sampler.results.logzerr[-1]), calls[0]


def table(results: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """Every pair, then how many agree."""
    results = [one for one in results if 'failed' not in one]
    yield '| effect | strength | unknowns | error without | with | Laplace [nats] | nested | difference | model runs |'
    yield '|---|---|---|---|---|---|---|---|---|'
    for one in sorted(results, key=lambda one: one['case']):
        effect, (before, after) = one['case'][0], one['unknowns']
        yield (
            f'| {effect} | {one["strength"]:.2g} | {before}, {after} | {one["errors"][0]:.2f} | {one["errors"][1]:.2f} | '
            f'{one["laplace"]:.2f} | {one["nested"]:.2f} +- {one["std"]:.2f} | {one["laplace"] - one["nested"]:+.2f} | '
            f'{sum(one["calls"])} |'
        )
    yield ''
    if results:
        agreed = sum(abs(one['laplace'] - one['nested']) <= AGREED for one in results)
        yield f'difference of at most {AGREED:g}: {of(agreed, len(results))}'


def cases(pairs: int, live: int) -> list[tuple[str, float, int, int]]:
    """Effects in turn, every second round without them."""
    found = []
    for number in range(pairs):
        there = number // len(EFFECTS) % 2 == 0
        nats = round(float(np.random.default_rng(FIRST_SEED + number).uniform(0.0, MOST)), 1) if there else 0.0
        found.append((EFFECTS[number % len(EFFECTS)], nats, FIRST_SEED + number, live))
    return found


def main() -> None:
    """Compare the pairs that are not in the file yet, as far as the time goes; print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--pairs', type=int, default=2 * len(EFFECTS))
    parser.add_argument('--live', type=int, default=250, help='live points of nested sampling')
    add_options(parser, 'laplace.jsonl', 120.0)
    asked = parser.parse_args()
    results = solved(drawn(cases(asked.pairs, asked.live), asked.share), solve, asked, lambda one: list(table([one]))[2])
    print(*table(results), sep='\n')


if __name__ == '__main__':
    main()
