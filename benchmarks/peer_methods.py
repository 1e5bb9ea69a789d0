"""What a scientist would otherwise use on these recordings, each as its authors document it; none knows of SMA.

- **pysindy** (Kaptanoglu et al. 2022). The discrepancy between a model and a measurement as a sparse polynomial of the
  states (Kaheman et al. 2019; Ebers, Steele and Kutz 2024: of the residual in the channels, or of what the dynamics miss),
  by STLSQ. And the weak form, made for noisy data: a model of the recorded channels alone, driven by the command.
- **gplearn** (Stephens). The same discrepancies as a formula that genetic programming finds, with the numbers of its
  documented example.
- **sysidentpy** (Lacerda et al. 2020). A polynomial NARX model by FROLS and Akaike's criterion, simulated freely: of the
  recorded channels, or of the residual.
- **emcee** (Foreman-Mackey et al. 2013). Samples of the posterior of the parameters of a given model.

What their documentation leaves to the user (threshold, degree, lags, sampling interval) is chosen among a few values by
what predicts one of the runs best from the other.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.estimation.problem import Problem, cost_at

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]
THRESHOLDS = (0.01, 0.03, 0.1, 0.3, 1.0)  # of STLSQ, on standardized terms, in standard deviations of what is explained
DEGREES = (1, 2)  # of polynomials
SHOWN_TERMS = 4  # of an equation
GENETIC_SAMPLES = 240  # of a run: formulas are evaluated 20,000 times
SUBDOMAINS = 200  # of the weak form, by run
WEAK_THRESHOLDS = (0.03, 0.3)  # those of them that are tried there: a simulation takes seconds
DIVERGED = 1e3  # standard deviations from where a simulated model has no meaning
BLOCKS, LAGS = (5, 20), (1, 2, 4)  # samples that are averaged for one of NARX, and lags of its output and inputs
WALKERS, BURN_IN = 32, 3  # of emcee; autocorrelation times that are left out


@dataclass(frozen=True)
class SeenRun:
    """A recording beside the calibrated model.

    `powers` (k, 2) [W] are commanded, to one wire of each bundle; `measured`, `modelled` (k, channels) are over the noise;
    `states` (k, names) are those of the model.
    """

    name: str
    time: Vector
    powers: Matrix
    measured: Matrix
    modelled: Matrix
    states: Matrix

    @property
    def residual(self) -> Matrix:
        """Measured minus modelled (k, channels), over the noise."""
        return self.measured - self.modelled


@dataclass(frozen=True)
class Equation:
    """A formula: its text, the variables in it, and its values (k,) at states (k, n)."""

    text: str
    variables: frozenset[str]
    values: Callable[[Matrix], Vector]


Samples = tuple[Matrix, Vector]  # states (k, n) of a run, and what is to be explained (k,)


@contextmanager
def quiet() -> Iterator[None]:
    """Without warnings of terms that are dropped and models that diverge."""
    with warnings.catch_warnings(), np.errstate(all='ignore'):
        warnings.simplefilter('ignore')
        yield


def rms(values: Matrix) -> float:
    """Root mean square; infinite where a value is none."""
    return float(np.sqrt(np.mean(np.square(values)))) if np.isfinite(values).all() else np.inf


def explained(equation: Equation, samples: Samples) -> float:
    """The part of the squares of a run that an equation takes away."""
    x, y = samples
    if not y.any():
        return 0.0
    with quiet():
        return 1.0 - (rms(y - equation.values(x)) / rms(y)) ** 2


def scaled(runs: Sequence[Samples]) -> tuple[Callable[[Matrix], Matrix], float]:
    """What standardizes states, and the size of what is to be explained."""
    x = np.concatenate([states for states, _ in runs])
    middle, size = x.mean(axis=0), x.std(axis=0) + 1e-12
    return lambda states: (states - middle) / size, rms(np.concatenate([y for _, y in runs])) or 1.0


def sparse_equation(runs: Sequence[Samples], names: Sequence[str]) -> Equation:
    """pysindy: a sparse polynomial."""
    import pysindy

    scale, size = scaled(runs)
    libraries = {degree: pysindy.PolynomialLibrary(degree=degree).fit(scale(runs[0][0])) for degree in DEGREES}

    def terms(states: Matrix, degree: int) -> Matrix:
        return np.asarray(libraries[degree].transform(scale(states)))

    def coefficients(chosen: Sequence[Samples], degree: int, threshold: float) -> Vector:
        optimizer = pysindy.STLSQ(threshold=threshold)
        optimizer.fit(np.concatenate([terms(x, degree) for x, _ in chosen]), np.concatenate([y for _, y in chosen]) / size)
        return np.asarray(optimizer.coef_).ravel()

    half = len(runs[0][0]) // 2
    *first, last = runs if len(runs) > 1 else [(x[part], y[part]) for x, y in runs for part in np.s_[:half, half:]]

    def miss(choice: tuple[int, float]) -> float:
        return rms(last[1] - size * terms(last[0], choice[0]) @ coefficients(first, *choice))

    with quiet():
        degree, threshold = min(product(DEGREES, THRESHOLDS), key=miss)
        found = coefficients(runs, degree, threshold)
    shown = [name.replace(' ', '*') for name in libraries[degree].get_feature_names(list(names))]
    ordered = [k for k in np.argsort(-np.abs(found)) if found[k] != 0.0]
    text = ' '.join(f'{size * found[k]:+.2g} {shown[k]}' for k in ordered[:SHOWN_TERMS])
    more = f' and {len(ordered) - SHOWN_TERMS} more' if len(ordered) > SHOWN_TERMS else ''
    variables = {part.partition('^')[0] for k in ordered for part in shown[k].split('*')}
    return Equation(f'{text or "0"}{more}', frozenset(variables), lambda x: size * terms(x, degree) @ found)


def genetic_equation(runs: Sequence[Samples], names: Sequence[str]) -> Equation:
    """gplearn: a formula of +, -, *, / and constants."""
    from gplearn.genetic import SymbolicRegressor

    scale, size = scaled(runs)
    thinned = [(x[::every], y[::every]) for x, y in runs for every in [max(1, len(y) // GENETIC_SAMPLES)]]
    search = SymbolicRegressor(
        population_size=1000,
        generations=20,
        p_crossover=0.7,
        p_subtree_mutation=0.1,
        p_hoist_mutation=0.05,
        p_point_mutation=0.1,
        max_samples=0.9,
        parsimony_coefficient=0.01,
        feature_names=list(names),
        random_state=0,
    )
    with quiet():
        search.fit(scale(np.concatenate([x for x, _ in thinned])), np.concatenate([y for _, y in thinned]) / size)
    program = search._program
    constants = {'1' for node in program.program if isinstance(node, float)}
    varies = np.ptp(program.execute(scale(thinned[0][0]))) > 0.0
    variables = constants | {names[node] for node in program.program if isinstance(node, int)} if varies else {'1'}
    return Equation(str(program), frozenset(variables), lambda x: size * np.asarray(program.execute(scale(x))))


def weak_model(training: Sequence[SeenRun], held_out: SeenRun) -> Matrix:
    """pysindy in weak form: the recorded channels (k, channels) of the held-out run, simulated from its first samples."""
    import pysindy

    channels = np.concatenate([run.measured for run in training])
    middle, size, strongest = channels.mean(axis=0), channels.std(axis=0), max(run.powers.max() for run in training)

    def seen(run: SeenRun) -> tuple[Matrix, Matrix]:
        return (run.measured - middle) / size, run.powers / strongest

    def fitted(runs: Sequence[SeenRun], degree: int, threshold: float) -> Any:
        np.random.seed(0)  # of the subdomains, which pysindy draws
        library = pysindy.WeakPDELibrary(
            function_library=pysindy.PolynomialLibrary(degree=degree, include_bias=False),
            include_bias=True,
            spatiotemporal_grid=runs[0].time,
            K=SUBDOMAINS,
        )
        states, inputs = map(list, zip(*map(seen, runs), strict=True))
        model = pysindy.SINDy(optimizer=pysindy.STLSQ(threshold=threshold), feature_library=library)
        model.fit(states, t=runs[0].time, u=inputs)
        plain = pysindy.SINDy(feature_library=pysindy.PolynomialLibrary(degree=degree))
        plain.fit(states, t=runs[0].time, u=inputs)
        plain.optimizer.coef_ = model.coefficients()  # to simulate: the weak form has no right-hand side of its own
        return plain

    def simulated(model: Any, run: SeenRun) -> Matrix:
        states, inputs = seen(run)

        def inside(t: float, x: Vector) -> float:
            return DIVERGED - float(np.abs(x).max())

        inside.terminal = True  # type: ignore[attr-defined]
        found = model.simulate(
            states[:3].mean(axis=0),
            run.time,
            u=lambda t: inputs[np.searchsorted(run.time, t, side='right') - 1],
            integrator_kws={'method': 'LSODA', 'rtol': 1e-5, 'atol': 1e-6, 'max_step': 0.5, 'events': inside},
        )
        return found * size + middle if len(found) == len(states) else np.full_like(states, np.inf)

    def miss(choice: tuple[int, float]) -> float:
        return rms(simulated(fitted(training[:1], *choice), training[-1]) - training[-1].measured)

    with quiet():
        return simulated(fitted(training, *min(product(DEGREES, WEAK_THRESHOLDS), key=miss)), held_out)


def narx(training: Sequence[Samples], held_out: Samples) -> Vector:
    """sysidentpy: the output (k,) of the held-out run by free simulation; inputs (k, n) and outputs (k,) are given."""
    from sysidentpy.basis_function import Polynomial
    from sysidentpy.model_structure_selection import FROLS
    from sysidentpy.parameter_estimation import LeastSquares

    scale, size = scaled(training)
    level = float(np.mean(np.concatenate([y for _, y in training])))

    def averaged(samples: Samples, block: int) -> tuple[Matrix, Matrix]:
        x, y = scale(samples[0]), (samples[1] - level) / size
        whole = len(y) // block * block
        inputs = x[:whole].reshape(-1, block, x.shape[1]).mean(axis=1)
        return inputs, y[:whole].reshape(-1, block).mean(axis=1)[:, None]

    def fitted(runs: Sequence[Samples], block: int, degree: int, lag: int) -> Any:
        lags = list(range(1, lag + 1))
        model = FROLS(
            order_selection=True,
            info_criteria='aic',
            n_info_values=15,
            ylag=lag,
            xlag=[lags] * runs[0][0].shape[1],
            estimator=LeastSquares(),
            basis_function=Polynomial(degree=degree),
            err_tol=None,
        )
        x, y = (np.concatenate(parts) for parts in zip(*(averaged(run, block) for run in runs), strict=True))
        return model.fit(X=x, y=y)

    def simulated(model: Any, samples: Samples, block: int) -> Vector:
        x, y = averaged(samples, block)
        values = model.predict(X=x, y=y[: model.max_lag]).ravel()
        middles = block * np.arange(len(values)) + 0.5 * (block - 1)
        shown: Vector = level + size * np.interp(np.arange(len(samples[1])), middles, values)
        return shown

    def miss(choice: tuple[int, int, int]) -> float:
        folds = [(run, [one for one in training if one is not run]) for run in training]
        return max(rms(simulated(fitted(rest, *choice), run, choice[0]) - run[1]) for run, rest in folds)

    with quiet():
        best = min(product(BLOCKS, DEGREES, LAGS), key=miss)
        return simulated(fitted(training, *best), held_out, best[0])


def sampled_intervals(problem: Problem, z: Vector, steps: int, pool: Executor) -> Mapping[str, Any]:
    """emcee: 95 % intervals of the free parameters (SI), from the optimum z; how many autocorrelation times it ran."""
    import emcee

    low, high = problem.limits()

    def log_posterior(at: Vector) -> float:
        return -cost_at(problem, at, pool) if (at > low).all() and (at < high).all() else -np.inf

    random = np.random.default_rng(0)
    start = np.clip(z + 1e-4 * random.standard_normal((WALKERS, len(z))), low + 1e-9, high - 1e-9)
    sampler = emcee.EnsembleSampler(WALKERS, len(z), log_posterior)
    sampler.random_state = np.random.RandomState(0).get_state()
    sampler.run_mcmc(start, steps)
    tau = float(np.max(sampler.get_autocorr_time(tol=0)))
    chain = sampler.get_chain(discard=min(int(BURN_IN * tau), steps // 2), flat=True)
    ends = {
        free.name: [free.value(float(end)) for end in np.percentile(chain[:, k], (2.5, 97.5))]
        for k, free in enumerate(problem.free)
    }
    return {'intervals': ends, 'times': steps / tau, 'runs': WALKERS * (steps + 1)}
