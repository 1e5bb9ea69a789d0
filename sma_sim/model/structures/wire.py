"""One wire on a test bench, which imposes its strain or its stress, and leaves its temperature to the air or sets it.

With the stress imposed the strain eps is a coordinate. A machine that follows its load within the time `lag` obeys

    mu d2eps/dt2 = sigma_load - sigma - eta deps/dt,   eta = lag E_A,   mu = lag^2 E_A/4

per volume of the wire (critically damped for austenite), which tends to sigma = sigma_load for slow tests. Where a wire
transforms at one stress, its strain is not a function of stress and temperature: it runs at the rate
(sigma_load - sigma_A)/eta (or sigma_M), until heat or the end of the transformation stops it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

from sma_sim.model.parameters import PAPER, Parameter, wire_constants
from sma_sim.model.structures.structure import BALANCE, CONTROL, Coordinate, Drive, Structure, at_imposed_temperature


class LoadConstants(NamedTuple):
    """What the equations of a wire under load read, SI units."""

    l0: float
    volume: float  # of all wires of the bundle [m^3]
    eta: float  # [Pa s]
    mu: float  # [Pa s^2]


def load_constants(values: Mapping[str, float]) -> LoadConstants:
    """Constants from parameters by full name."""
    w, lag = wire_constants(values), values['bench.lag']
    return LoadConstants(w.l0, w.n * w.volume, lag * w.E_A, 0.25 * lag * lag * w.E_A)


def lengths(q: Any, p: Any) -> float:
    """Length of the wire [m]."""
    return float(p.l0 * (1.0 + q.strain))


def forces(q: Any, v: Any, p: Any, u: Any) -> float:
    """Load and damping on the coordinate strain [J]."""
    return float(p.volume * (u.stress - p.eta * v.strain))


IMPOSED_STRAIN = Structure(
    name='wire',
    title='bench',
    coordinates=(),
    wires=1,
    drives=(Drive('strain', '-', 'strain of the wire', bounds=(-0.5, 0.5)),),
    options={CONTROL: 'strain', **BALANCE},
    description='a tensile machine stretches the wire; heated by J, cooled by air',
    source=PAPER,
)
IMPOSED_STRESS = Structure(
    name='wire_under_load',
    title='bench',
    coordinates=(Coordinate('strain', '-', 0.01, 'of the wire', rate_scale=lambda p: 0.01 * p.eta / p.mu, joint=False),),
    wires=1,
    drives=(Drive('stress', 'Pa', 'stress that the load imposes', bounds=(0.0, 1e10)),),
    lengths=lengths,
    gradients=lambda q, p: p.l0,
    forces=forces,
    inertia=lambda p: p.volume * p.mu,
    constants=load_constants,
    parameters=(
        Parameter(
            'bench.lag',
            1e-4,
            's',
            (1e-6, 1.0),
            'time in which the machine follows its load',
            source='short beside any change in a test',
        ),
    ),
    defaults={'initial.x_M_1': 0.0},
    energy=lambda q, v, p: 0.5 * p.volume * p.mu * v.strain**2,
    options={CONTROL: 'stress', **BALANCE},
    variant_of=IMPOSED_STRAIN.name,
    description='a dead weight or a load-controlled machine; the wire is heated by J, cooled by air',
    source='sma_sim.model.structures.wire',
)


STRUCTURE = replace(
    IMPOSED_STRAIN,
    variants=(
        at_imposed_temperature(IMPOSED_STRAIN, 'a tensile machine stretches the wire, whose temperature is measured or set'),
        IMPOSED_STRESS,
        at_imposed_temperature(IMPOSED_STRESS, 'strain over temperature at constant stress: the isobaric test'),
    ),
)
