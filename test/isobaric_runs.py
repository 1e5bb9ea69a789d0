"""Simulated isobaric tests of an alloy whose parameters are known."""

import numpy as np

from sma_sim import Dataset, Input, Model, Recording, simulate

BENCH = [
    'system=wire',
    'bench.control=stress',
    'bench.temperature=prescribed',
    'model=hybrid',
    'wire.n=1',
    'wire.E_A=6e10',
    'wire.E_M=4e10',
    'wire.eps_T=0.04',
    'wire.sigma_T=8e6',
    'wire.T0=420',
    'wire.sigma_MW0=1e8',
    'wire.dsigma=1.6e8',
]


def isobaric_tests(truth, stresses, noise=1e-4, error_of_temperature=0.0):
    """A heating and a cooling at each stress [Pa], the noise twice that which is stated.

    `error_of_temperature` [K]: by how much the specimen is hotter than its thermocouple, one half wave along a test.
    """
    times, random, runs = np.linspace(0.0, 3000.0, 121), np.random.default_rng(0), []
    structure = truth.structure
    for stress in stresses:
        T = 360.0 + 120.0 * (1.0 - np.abs(times / 1500.0 - 1.0))
        apart = error_of_temperature * np.sin(np.pi * times / times[-1])
        given, felt = (
            Input(
                times,
                np.column_stack([np.full(len(T), stress), level, 0.0 * T, np.full(len(T), 298.0)]),
                (True, True, False, False),
                structure.input_columns,
            )
            for level in (T, T + apart)
        )
        strain = simulate(Model(truth), felt, times)['strain'] + noise * random.normal(size=len(T))
        name = f'{stress / 1e6:.0f}MPa'
        runs.append(Recording(name, structure.name, times, {'strain': strain}, given, exact_commands=True))
    return Dataset(tuple(runs), {'strain': 0.5 * noise})
