"""Drawings of structures: wires are as long as the model says, and end on the part that moves."""

import math
from pathlib import Path

import numpy as np
import pytest

from sma_sim import Coordinate, Drawing, Structure, find_structures
from sma_sim.model.structures.discovery import package_structures
from sma_sim.model.structures.drawing import Sketch
from sma_sim.model.structures.links import fixed_transforms, moving_transforms
from sma_sim.model.structures.structure import numbers, record

EXAMPLE = Path(__file__).resolve().parents[2] / 'examples' / 'own_structure'
FOUND = {**package_structures(), **find_structures([EXAMPLE])}
ANGLES = [k * math.tau / 3 for k in range(3)]
FASTENED = {  # ends of the wires in the frame `end`
    'coil': [(0.0, 0.0, 0.0)],
    'slider': [(0.0, 0.0, 0.0)],
    'lever': [(6e-3, 0.0, 0.0)] * 2,
    'spatial': [(0.0, 5e-3 * math.cos(angle), 5e-3 * math.sin(angle)) for angle in ANGLES],
}


def poses(structure):
    """Coordinates by name: all zero, and at random."""
    random, constants = np.random.default_rng(5), structure.default_constants
    sizes = [coordinate.size(constants) for coordinate in structure.coordinates]
    for factors in (np.zeros(len(sizes)), *random.uniform(-2.0, 2.0, (3, len(sizes)))):
        yield dict(zip(structure.coordinate_names, (factors * sizes).tolist(), strict=True))


def lengths_at(structure, q):
    return numbers(structure.lengths(record('Pose', structure.coordinate_names)(**q), structure.default_constants))


def length(line):
    return float(np.linalg.norm(np.diff(np.array(line), axis=0), axis=1).sum())


def turned(rotation, point):
    x, y, z, w = rotation
    axis = np.array([x, y, z])
    return point + 2.0 * w * np.cross(axis, point) + 2.0 * np.cross(axis, np.cross(axis, point))


def in_base(transforms, frame, point):
    """A point of a frame in the root, up the tree."""
    up = {transform.child: transform for transform in transforms}
    point = np.array(point)
    while frame in up:
        point = turned(up[frame].rotation, point) + up[frame].translation
        frame = up[frame].parent
    return point


@pytest.mark.parametrize('name', [name for name in FOUND if FOUND[name].coordinates])
def test_wires_are_drawn_as_long_as_they_are(name):
    structure = FOUND[name]
    sketch = Sketch(structure, structure.default_values)
    at_zero = dict.fromkeys(structure.coordinate_names, 0.0)
    first = sketch.lines(at_zero, lengths_at(structure, at_zero))
    for q in poses(structure):
        expected = lengths_at(structure, q)
        lines = sketch.lines(q, expected)
        if structure.strain is None:
            assert [length(line) for line in lines.wires] == pytest.approx(expected, rel=1e-4)  # arcs are drawn as chords
        else:  # a coil of so much wire
            assert [abs(line[0][0] - line[-1][0]) for line in lines.wires] == pytest.approx(expected)
            assert [length(line) for line in lines.wires] == pytest.approx([structure.default_constants.l0], rel=0.03)
        if structure.segment is None:
            assert [tuple(line[0]) for line in lines.wires] == [tuple(line[0]) for line in first.wires]  # fixed ends
        assert lines.bodies and np.isfinite([point for line in lines.bodies for point in line]).all()


@pytest.mark.parametrize('name', FASTENED)
def test_wires_end_on_the_part_that_moves(name):
    structure = FOUND[name]
    sketch = Sketch(structure, structure.default_values)
    for q in poses(structure):
        ends = sketch.ends(sketch.lines(q, lengths_at(structure, q)))
        transforms = moving_transforms(sketch.tree, q, ends) + fixed_transforms(sketch.tree)
        assert len(transforms) == len(sketch.tree.links) - 1
        for (frame, end), fastened in zip(ends.items(), FASTENED[name], strict=True):
            assert in_base(transforms, 'end', fastened) == pytest.approx(end, abs=1e-12), frame
            assert in_base(transforms, frame, (0.0, 0.0, 0.0)) == pytest.approx(end, abs=1e-12)


def test_the_chain_of_a_stack_leads_to_its_last_plate():
    structure = FOUND['stack']
    sketch, half = Sketch(structure, structure.default_values), 0.5 * structure.default_values['plate.W']
    for q in poses(structure):
        ends = sketch.ends(sketch.lines(q, lengths_at(structure, q)))
        lines = sketch.lines(q, lengths_at(structure, q)).wires
        transforms = moving_transforms(sketch.tree, q, ends) + fixed_transforms(sketch.tree)
        for k, frame in ((1, 'alpha_1_link'), (2, 'alpha_2_link'), (3, 'end')):
            for number, side in ((2 * k - 1, half), (2 * k, -half)):
                assert in_base(transforms, frame, (0.0, side, 0.0)) == pytest.approx(ends[f'wire_{number}_end'], abs=1e-12)
                foot = in_base(transforms, f'wire_{number}', (0.0, 0.0, 0.0))
                assert foot == pytest.approx(lines[number - 1][0], abs=1e-12)


def test_the_wire_of_a_test_bench_is_drawn_as_long_as_it_is():
    structure = FOUND['wire']
    lines = Sketch(structure, structure.default_values).lines({}, [0.0987])
    assert [length(line) for line in lines.wires] == [pytest.approx(0.0987)]


def test_joints_have_limits_and_the_axes_that_are_told():
    told = Structure(
        'crane',
        'crane',
        (Coordinate('turn', 'rad', 0.1, axis='x', limit=0.3), Coordinate('lift', 'm', 0.01, axis='z')),
        1,
        lengths=lambda q, p: 0.1 - q.lift,
        forces=lambda q, v, p: (-q.turn, -q.lift),
        inertia=lambda p: (1.0, 1.0),
        drawing=Drawing(lambda q, p: [((0.0, 0.0, 0.1), (0.0, 0.0, q.lift))]),
    )
    turn, lift = (joint.motion for joint in Sketch(told, told.default_values).tree.joints[:2])
    assert (turn.axis, turn.upper, turn.revolute) == ((1.0, 0.0, 0.0), 0.3, True)
    assert (lift.axis, lift.upper, lift.revolute) == ((0.0, 0.0, 1.0), 0.1, False)
    assert lift.effort > turn.effort > 0.0  # URDF wants one, and only the lift is pulled
    with pytest.raises(ValueError, match="coordinate 'a': expected an axis x, y or z, got 'w'"):
        Coordinate('a', 'm', 1.0, axis='w')


def test_the_drawn_spatial_beam_is_a_cantilever_with_the_plate_on_its_tip():
    """Fixed and straight at its root, at the tip where and as the plate is; the plate joins the ends of the wires."""
    structure = FOUND['spatial']
    p, pose = structure.default_constants, record('Pose', structure.coordinate_names)
    for q in poses(structure):
        axis, plate = structure.drawing.bodies(pose(**q), p)
        ends = [wire[-1] for wire in structure.drawing.wires(pose(**q), p)]
        assert plate == [*ends, ends[0]] and np.mean(ends, axis=0) == pytest.approx(axis[-1])
        assert axis[0] == (0.0, 0.0, 0.0) and axis[-1] == pytest.approx((p.L + q['U_x'], q['U_y'], q['U_z']))
        _, y, z = np.array(axis).T
        at, slopes = np.linspace(0.0, p.L, len(axis)), {0.0: (0.0, 0.0), p.L: (q['alpha'], -q['beta'])}
        for x, expected in slopes.items():
            found = [np.polyval(np.polyder(np.polyfit(at, line, 3)), x) for line in (y, z)]
            assert found == pytest.approx(expected, abs=1e-9)
