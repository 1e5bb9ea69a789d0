"""Whole runs of every structure: the first law, and the order in which steps converge."""

import numpy as np
import pytest
from systems import raw_run, smooth_state
from test_energy import quadrature
from test_order import HALVINGS, fixed_steps, orders
from test_structures import HEATING, MOVING, command_of, model_of

from sma_sim.model.material import internal_energy
from sma_sim.model.structures.structure import numbers, record
from sma_sim.solver.inputs import segments

KINDS = ['hybrid', 'mas']
ENERGETIC = sorted(name for name, found in MOVING.items() if found.energy)


def friction_power(model, pose, rates):
    """What the structure's forces take that depend on velocities [W], at each of some states."""
    structure = model.structure
    made = record('Pose', structure.coordinate_names)
    still = made(*np.zeros(len(structure.coordinates)))
    found = []
    for q, v in zip(pose, rates, strict=True):
        forces = [np.array(numbers(structure.forces(made(*q), s, model.constants))) for s in (made(*v), still)]
        found.append((forces[0] - forces[1]) @ v)
    return np.array(found)


def energy_of(model, run, k):
    """Energy of the structure and its wires at a sample [J]."""
    structure, p = model.structure, model.compiled
    made = record('Pose', structure.coordinate_names)
    own = structure.energy(made(*run.pose[k]), made(*run.rates[k]), model.constants)
    stored = 0.0
    for wire in run.wires:
        ((strain, _),) = structure.strains([wire['length'][k]], model.config.parameters)
        stored += internal_energy(strain - p.wire.eps_T * wire['x_M'][k], wire['T'][k], wire['x_M'][k], p.wire)
    return own + p.wire.n * stored


@pytest.mark.parametrize('kind', KINDS)
@pytest.mark.parametrize('name', ENERGETIC)
def test_first_law_over_a_run(name, kind):
    """Energy at the end less energy at the start is what was exchanged, to 1e-6 of its magnitude."""
    model, source = model_of(name, kind, solver__rtol=1e-9), command_of(name, 12.0)
    p, w = model.compiled, model.compiled.wire
    breaks = np.unique(np.concatenate([segments(source)[0], raw_run(model, source, [0.0]).jumps[:, 0]]))
    nodes, weights = quadrature(breaks)
    run = raw_run(model, source, np.concatenate([[0.0], nodes, [breaks[-1]]]))
    assert run.status == 0 and all(np.ptp(wire['x_M']) > 0.05 for wire in run.wires[:1])
    powers = np.array(
        [
            *(w.n * wire['J'][1:-1] for wire in run.wires),
            *(-w.n * w.lambda_ * w.surface * (wire['T'][1:-1] - 298.0) for wire in run.wires),
            friction_power(model, run.pose[1:-1], run.rates[1:-1]),
        ]
    )
    exchanged = (np.abs(powers) @ weights).sum()
    change = energy_of(model, run, -1) - energy_of(model, run, 0)
    assert p.wires == len(run.wires) and exchanged > 1.0
    assert change == pytest.approx((powers @ weights).sum(), abs=1e-6 * exchanged)


# Kinks of the MAS kinetics, where a barrier vanishes or turns, are of a lower order: slow kinetics behind high barriers have
# none within the second that is looked at.
SMOOTH = {'wire__V_L': 2e-27, 'wire__omega_x': 0.3, 'wire__dsigma': 2e8}
TRANSFORMING = {
    'slider': 0.2,
    'rocker': 0.5,
    'coil': 0.6,
}  # [W], at which hybrid wires of little heat still transform a second later


@pytest.mark.filterwarnings('error::pytest.PytestUnraisableExceptionWarning')  # of kernels that fail as plain Python
@pytest.mark.parametrize('kind', KINDS)
@pytest.mark.parametrize('name', [*sorted(set(MOVING) - {'module', 'stack'}), pytest.param('stack', marks=pytest.mark.slow)])
def test_order_of_steps_of_every_structure(name, kind, interpreted):
    """Steps of half the length have a sixteenth of the error; as plain Python, for which nothing is compiled (but for the
    stack, whose kernels take matrices)."""
    slow = SMOOTH if kind == 'mas' and name not in TRANSFORMING else {}
    count, held = 8, TRANSFORMING.get(name, HEATING[name]) if kind == 'hybrid' else HEATING[name]
    start = smooth_state(model_of(name, kind, solver__rtol=1e-10, **slow), J_eq=held, after=1.0)
    assert kind == 'mas' or {4, 5} & set(start.mode)

    def errors_of_steps():
        model = model_of(name, kind, solver__rtol=1e-10, **slow)
        exact = fixed_steps(model, start, 1.0, 32 * count)
        return [np.abs((fixed_steps(model, start, 1.0, int(n) * count) - exact) / model.scales).max() for n in HALVINGS]

    errors = errors_of_steps() if name == 'stack' else interpreted(errors_of_steps)
    assert orders(errors).mean() == pytest.approx(4.0, abs=0.4)
    assert errors[-1] < 1e-8
