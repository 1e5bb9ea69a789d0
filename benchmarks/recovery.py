"""Recovery against magnitude: how weak an effect is still found, and with which probability.

    python benchmarks/recovery.py [--effects NAME ...] [--errors 1.02 1.05 ...] [--seeds 71] [--forces] [--minutes 60]
                                  [--at-once 1]

A robot (sma_sim/challenge) hides one effect, whose strength is scaled until the best fit without it leaves about the error
over noise that is asked for: what it leaves over the noise, sqrt(error^2 - 1), is nearly in proportion to the strength of a
weak effect. The probability of the truth is the one that the diagnosis gives to the effect, in whatever scope. Three runs,
the last of them held out. Finished cases are kept in --file, so that a run can be continued.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator, Mapping
from concurrent.futures import Executor
from dataclasses import replace
from threading import Event
from typing import Any

import numpy as np
from cases import add_options, drawn, solved

from sma_sim.challenge.draw import named_truth
from sma_sim.challenge.make import RecordingPlan, challenge_with
from sma_sim.challenge.truth import Truth
from sma_sim.evidence.data.train_test_split import hold_out_last
from sma_sim.evidence.diagnosis.diagnose import diagnose
from sma_sim.evidence.estimation.prepared_fit import prepare
from sma_sim.evidence.estimation.search_context import SearchContext
from sma_sim.evidence.model_selection.nominal_fit import DiagnosisRequest, nominal_fit
from sma_sim.model.effects.discovery import find_effects
from sma_sim.model.effects.scope import SEPARATOR
from sma_sim.words.diagnosis_data import as_data

# By effect of the library, the parameter of its truth that is its strength: nothing where that is 0.
STRENGTHS = {
    'natural_convection': 'h_50',
    'thermal_crosstalk': 'k',
    'beam_creep': 'c',
    'polycrystal': 'H',
    'driver_deadband': 'P_q',
    'gravity': 'share',
    'guide_friction': 'mu',
    'driver_lag': 't_r',
    'beam_nonlinearity': 'c',
    'clausius_clapeyron_mismatch': 'excess',
    'pretension_mismatch': 'd',
    'latent_heat_scale': 'f',
}
ERRORS = (1.02, 1.05, 1.1, 1.2, 1.5, 2.0, 3.0)
EDGES = (1.0, 1.035, 1.075, 1.15, 1.3, 1.7, 2.5, math.inf)  # of the errors by which cases are counted
WEAKER = 0.9  # times a strength that no listed effect has
PLAN = RecordingPlan(3, 100.0, 20.0)


def scaled(truth: Truth, values: Mapping[str, float], strength: str, factor: float) -> Truth:
    """The truth with these values of its parameters, its strength multiplied as far as its bounds let it."""
    wanted = {p.name: values[p.name] * (factor if p.name == strength else 1.0) for p in truth.parameters}
    fixed = tuple(replace(p, realistic=(min(max(wanted[p.name], p.bounds[0]), p.bounds[1]),) * 2) for p in truth.parameters)
    return replace(truth, parameters=fixed, signed=())


def at_strength(
    effect: str, error: float, seed: int, forces: bool, plan: RecordingPlan, pool: Executor
) -> tuple[Truth, float]:
    """The truth of an effect so strong that the best fit without it leaves about this error, and over what is drawn."""
    truth = named_truth(effect)
    full = challenge_with((truth,), seed, forces, plan)
    values = {name: value for name, (value, _) in full.answer.effects[0].parameters.items()}
    training, _ = hold_out_last(full.dataset, None)
    start = prepare(training, full.nominal, 'mas')
    left = nominal_fit(start, DiagnosisRequest().options, SearchContext(pool, Event())).error
    factor = math.sqrt((error**2 - 1.0) / max(left**2 - 1.0, 1e-4))
    while not is_listed(made := scaled(truth, values, STRENGTHS[effect], factor), full.robot.parameters):
        factor *= WEAKER
    return made, factor


def is_listed(truth: Truth, parameters: Mapping[str, float]) -> bool:
    """Whether the library's effect may have the values of a truth that is drawn from one point: no heat is below none."""
    if truth.listed is None:
        return True
    values = {p.name: p.realistic[0] for p in truth.parameters if p.realistic}
    bounds = {p.name: p.bounds for p in find_effects()[truth.library].parameters}
    return all(bounds[name][0] <= value <= bounds[name][1] for name, value in truth.listed(values, parameters).items())


def solve(effect: str, error: float, seed: int, forces: bool, pool: Executor) -> dict[str, Any]:
    """A robot with the effect that leaves about this error, diagnosed."""
    truth, factor = at_strength(effect, error, seed, forces, PLAN, pool)
    made = challenge_with((truth,), seed, forces, PLAN)
    data = as_data(diagnose(made.dataset, made.nominal, request=DiagnosisRequest(equation=False), executor=pool))
    return {
        'factor': factor,
        'bare': data['error'][0]['train'],
        'last': data['error'][-1]['train'],
        'verdict': data['verdict'],
        'effects': data['effects'],
        'probability': probability(effect, data),
    }


def probability(effect: str, data: Mapping[str, Any]) -> float:
    """That the effect is there, in whatever scope: the weight of all models that have it."""
    return float(
        sum(
            model['probability']
            for model in data['models']
            if any(name.partition(SEPARATOR)[0] == effect for name in model['effects'])
        )
    )


def table(results: list[dict[str, Any]]) -> Iterator[str]:
    """Shares by the error that the best fit without the effect leaves, then every case."""
    results = [one for one in results if 'failed' not in one]
    yield '| error without it | cases | found | another one named | mean probability of the truth |'
    yield '|---|---|---|---|---|'
    for low, high in zip(EDGES, EDGES[1:], strict=False):
        own = [one for one in results if low <= one['bare'] < high or (low == 1.0 and one['bare'] < low)]
        if own:
            found = sum(one['case'][0] in one['effects'] for one in own)
            wrong = sum(any(name != one['case'][0] for name in one['effects']) for one in own)
            mean = np.mean([one['probability'] for one in own])
            above = f'{low:g} to {high:g}' if math.isfinite(high) else f'above {low:g}'
            yield f'| {above} | {len(own)} | {found} | {wrong} | {mean:.2f} |'
    yield ''
    yield '| effect | asked | seed | strength | error without | with | verdict | effects | probability |'
    yield '|---|---|---|---|---|---|---|---|---|'
    for one in sorted(results, key=lambda one: one['case']):
        effect, error, seed, _ = one['case']
        yield (
            f'| {effect} | {error:g} | {seed} | {one["factor"]:.2g} | {one["bare"]:.3f} | {one["last"]:.3f} | '
            f'`{one["verdict"]}` | {", ".join(one["effects"])} | {one["probability"]:.2f} |'
        )


def main() -> None:
    """Solve what is not in the file yet, as far as the time goes, and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--effects', nargs='+', choices=list(STRENGTHS), default=list(STRENGTHS), metavar='NAME')
    parser.add_argument('--errors', nargs='+', type=float, default=list(ERRORS))
    parser.add_argument('--seeds', nargs='+', type=int, default=[71])
    parser.add_argument('--forces', action='store_true', help='the forces of the wires are recorded too')
    add_options(parser, 'recovery.jsonl', 60.0)
    asked = parser.parse_args()
    cases = [
        (effect, error, seed, asked.forces) for seed in asked.seeds for error in asked.errors for effect in asked.effects
    ]
    results = solved(drawn(cases, asked.share), solve, asked, lambda result: list(table([result]))[-1])
    print(*table(results), sep='\n')


if __name__ == '__main__':
    main()
