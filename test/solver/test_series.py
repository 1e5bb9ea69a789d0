"""Segments in series: the Jacobian that evaluates one segment at a time is that of the whole flow."""

import numpy as np
import pytest
from test_stack import stack

from sma_sim.model.layout import SystemState
from sma_sim.solver.linear import DENSE
from sma_sim.solver.series import jacobian_pattern
from sma_sim.solver.simulate import new_run, new_work
from sma_sim.solver.stepper import Segment, linearize_flow


@pytest.mark.parametrize('modes', [(3, 3), (4, 5), (5, 4), (1, 2)])
@pytest.mark.parametrize('kind', ['hybrid', 'mas'])
def test_the_jacobian_is_that_of_the_whole_flow(kind, modes):
    """In the plain Python of the kernels, at a random moving state; outside the pattern nothing depends on anything."""
    model, random = stack(3, kind, stack__g_x=4.0, stack__g_y=1.0), np.random.default_rng(5)
    p, work = model.compiled, new_work(model)
    u = np.array([6.0, -4.0, 2.0, 298.0])
    y = new_run(model, u, work).state.y
    y += 0.05 * model.scales * random.uniform(-1.0, 1.0, len(y))
    state = SystemState(y, np.resize(modes, p.wires), np.full(p.wires, 0.4))
    segment = Segment(0.0, 1.0, u, np.zeros(4), False)
    found = []
    for elimination in (work.elimination, DENSE):
        used = work._replace(elimination=elimination, jacobian=np.zeros_like(work.jacobian))
        linearize_flow(0.0, state, segment, p, used, False)
        found.append(used.jacobian)
    sparse, dense = found
    assert work.elimination.order.size == len(y) and np.count_nonzero(dense) > 100
    of_rows = np.abs(dense * model.scales).max(axis=1, keepdims=True)
    assert (np.abs((sparse - dense) * model.scales) <= 1e-9 * of_rows).all()
    pattern = jacobian_pattern(p, work.elimination.reach.astype(bool), len(y))
    assert not sparse[~pattern].any() and not (dense * model.scales)[~pattern].any()


@pytest.mark.parametrize(('kind', 'per_wire'), [('hybrid', 1), ('mas', 2)])
def test_elimination_from_the_end_to_the_base_brings_no_fill(kind, per_wire):
    """What depends on what, counted: wires on their segment, accelerations on neighbours and on rates of turning before."""
    for segments in (2, 3, 4, 7):
        model = stack(segments, kind)
        found = new_work(model).elimination
        own = 3 + 3 + 2 * per_wire
        wires, coordinates = 2 * per_wire * (3 + 3 + per_wire), 3 * 2
        neighbours, beyond = 3 * segments - 2, (segments - 1) * (segments - 2) // 2
        expected = segments * (wires + coordinates) + 3 * own * neighbours + 3 * beyond
        pattern = jacobian_pattern(model.compiled, found.reach.astype(bool), len(model.scales))
        assert np.count_nonzero(pattern) == len(found.entries) == expected
        assert len(found.rows) + len(found.columns) + len(found.order) == expected


@pytest.mark.parametrize('kind', ['hybrid', 'mas'])
def test_what_is_asked_of_segments_is_as_before_when_a_flow_is_linearised(kind):
    """All of them, of a series without effects; and no effect is left to push one."""
    model = stack(3, kind)
    p, work, n = model.compiled, new_work(model), 9
    state = new_run(model, np.array([0.0] * 3 + [298.0]), work).state
    linearize_flow(0.0, state, Segment(0.0, 1.0, np.array([6.0, -4.0, 2.0, 298.0]), np.zeros(4), False), p, work, False)
    asked = len(p.structure.effects) - n - 4
    assert p.structure.effects[asked : asked + 4].tolist() == [0.0, 3.0, 0.0, 3.0] and not p.structure.effects[:asked].any()
    assert work.first.dy.any()
