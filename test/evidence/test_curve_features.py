"""What tests of a wire show by themselves, on curves made of straight lines: temperatures, plateaus, starting values."""

from types import SimpleNamespace

import numpy as np
import pytest

from sma_sim import Config, Recording, wire_input
from sma_sim.evidence.data.quasi_static import both_ways, smoothed_way
from sma_sim.evidence.estimation.curve_features import (
    MARTENSITE_OVER_AUSTENITE,
    USUAL_SLOPE,
    CurveFeatures,
    IsobaricTest,
    IsothermalTest,
    Tangents,
    austenite_modulus,
    crossing,
    isobaric_features,
    isobaric_tests,
    isothermal_features,
    isothermal_test,
    median_slope,
    starting_values,
    tangents,
)
from sma_sim.evidence.estimation.paper_calibration import FURTHER_NAMES, Loop, moved_to, summary, temperature
from sma_sim.model.structures.discovery import known_structures
from sma_sim.words.wire_tests import plateaus_as_text
from sma_sim.words.wire_tests import tests_as_text as isobaric_as_text

COLD, HOT = 250.0, 400.0
COOLING, HEATING = (300.0, 315.0), (330.0, 350.0)  # M_f, M_s and A_s, A_f [K]
SLOPES = (2e-5, -1e-5)  # of the baselines, cold and hot [1/K]


def way(low, high, T):
    """Strain: a cold line, a straight transformation, a hot line; 0.04 at `low` and 0.01 at `high`."""
    inside = 0.04 - 0.03 * (T - low) / (high - low)
    cold, hot = 0.04 + SLOPES[0] * (T - low), 0.01 + SLOPES[1] * (T - high)
    return np.select([T - low < 0.0, T - high > 0.0], [cold, hot], inside)


def isobaric_curve(count=1500):
    up, down = np.linspace(COLD, HOT, count), np.linspace(HOT, COLD, count)
    return np.concatenate([up, down]), np.concatenate([way(*HEATING, up), way(*COOLING, down)])


def test_temperatures_are_where_straight_lines_meet():
    T, strain = isobaric_curve()
    found = isobaric_features('a', np.full(len(T), 1.5e8), T, strain)
    assert found is not None and (found.name, found.stress) == ('a', 1.5e8)
    assert found.temperatures == pytest.approx((*COOLING, *HEATING), abs=0.4)
    assert found.middles == pytest.approx((307.5, 340.0), abs=0.3) and found.hysteresis == pytest.approx(32.5, abs=0.3)
    for one in (found.heating, found.cooling):
        assert (one.cold_strain, one.hot_strain) == pytest.approx((0.04, 0.01), abs=5e-5)
        assert one.low < one.steepest < one.high
    assert found.recovered == pytest.approx(0.03, abs=1e-4)
    assert found.hottest_strain == pytest.approx(way(*HEATING, np.array(HOT)))
    strain[::7] = np.nan
    again = isobaric_features('a', np.full(len(T), 1.5e8), T, strain)
    assert again.temperatures == pytest.approx(found.temperatures, abs=0.3)


def test_what_is_no_isobaric_test():
    T, strain = isobaric_curve(300)
    stress = np.full(len(T), 1e8)
    drifting = stress * np.linspace(0.9, 1.1, len(T))
    for case in (
        (stress, T, strain * 1e-3),  # nothing transforms
        (drifting, T, strain),
        (-stress, T, strain),
        (stress, 300.0 + 0.1 * (T - 300.0), strain),  # 15 K
        (stress[:300], T[:300], strain[:300]),  # one way
        (stress[:9], T[:9], strain[:9]),
        (stress, T, np.full(len(T), np.nan)),
    ):
        assert isobaric_features('a', *case) is None
    assert isobaric_features('a', stress * np.linspace(0.98, 1.02, len(T)), T, strain) is not None
    assert isobaric_features('a', np.full(len(T), 1e6) * np.linspace(0.7, 1.3, len(T)), T, strain) is not None  # 1 MPa


def test_temperatures_lie_within_those_of_the_test():
    """Where a transformation is not finished, the last temperature is what is known; a tangent along its line says none."""
    T = np.linspace(320.0, 345.0, 800)
    found = tangents(T, way(*HEATING, T))
    assert 320.0 <= found.low <= found.steepest <= found.high <= 345.0
    assert crossing(np.array([2.0, 1.0]), -1.0, 3.0, 4.0) == pytest.approx(2.0)  # 1 + 2 T = 4 - (T - 3)
    assert crossing(np.array([2.0, 1.0]), 2.0, 3.0, 4.0) == 3.0


def test_ways_are_told_by_where_temperature_turns():
    up, down = np.arange(0.0, 50.0), np.arange(49.0, -1.0, -1.0)
    values = np.arange(100.0)
    for T, order in ((np.concatenate([up, down]), 1), (np.concatenate([down, up]), -1)):
        ways = both_ways(T, values)
        rising, falling = ways
        assert (np.diff(rising[0]) >= 0.0).all() and (np.diff(falling[0]) <= 0.0).all()
        first, second = ways[::order]
        assert first[1][0] == 0.0 and second[1][-1] == 99.0 and first[1][-1] == second[1][0]
    assert both_ways(up, up) is None
    grid, smooth, slope = smoothed_way(down, 3.0 * down + 1.0)
    inner = slice(8, -8)
    assert (grid[0], grid[-1], len(grid)) == (0.0, 49.0, 200)
    assert smooth[inner] == pytest.approx(3.0 * grid[inner] + 1.0) and slope[inner] == pytest.approx(3.0)


def test_isobaric_tests_are_read_from_recordings_by_stress():
    structure, (T, strain) = bench(), isobaric_curve(400)
    times = np.linspace(0.0, 600.0, len(T))
    runs = []
    for name, stress in (('high', 2e8), ('low', 1e8)):
        values = np.column_stack([np.full(len(T), stress), T, np.zeros(len(T)), np.full(len(T), 298.0)])
        source = SimpleNamespace(times=times, values=values)
        runs.append(SimpleNamespace(name=name, structure=structure, time=times, channels={'strain': strain}, source=source))
    runs.append(SimpleNamespace(name='blind', structure=structure, channels={}, source=source, time=times))
    found = isobaric_tests(SimpleNamespace(recordings=tuple(runs)))
    assert [test.name for test in found] == ['low', 'high'] and found[0].temperatures[0] == pytest.approx(300.0, abs=0.6)
    lines = isobaric_as_text(found)
    assert len(lines) == 4 and lines[2].split() == [
        'low',
        '100',
        *(f'{t - 273.15:.1f}' for t in found[0].temperatures),
        f'{100.0 * found[0].recovered:.2f}',
        '%',
    ]


def bench():
    """The structure on which stress and temperature are imposed."""
    return next(one for one in known_structures().values() if [drive.name for drive in one.drives] == ['stress', 'T'])


def isothermal(T, loading, unloading, modulus=5e10, plateau_strain=0.04):
    return IsothermalTest(f'at{T:g}', T, loading, unloading, modulus, plateau_strain)


def isobaric(stress, middles, cold=0.05, hot=0.01):
    cooling, heating = (Tangents(m - 5.0, m + 5.0, m, cold, hot) for m in middles)
    return IsobaricTest(f'{stress:g}', stress, heating, cooling, 0.01 + stress / 6e10)


def test_starting_values_of_points_on_two_parallel_lines():
    """sigma = level + slope (T - T0) +- dsigma/2, however the points were measured."""
    slope, T0, level, width = 6e6, 330.0, 2e8, 1.2e8

    def at(T, side):
        return level + slope * (T - T0) + 0.5 * side * width

    loops = tuple(isothermal(T, at(T, 1.0), at(T, -1.0), plateau_strain=0.035) for T in (320.0, 335.0, 350.0))
    tests = tuple(
        isobaric(stress, tuple(T0 + (stress - level - 0.5 * side * width) / slope for side in (1.0, -1.0)))
        for stress in (1e8, 1.5e8)
    )
    for features in (CurveFeatures((), loops), CurveFeatures(tests, ()), CurveFeatures(tests, loops)):
        found = starting_values(features)
        assert found['wire.sigma_T'] == pytest.approx(slope) and found['wire.dsigma'] == pytest.approx(width)
        assert found['wire.sigma_MW0'] - slope * (found['wire.T0'] - T0) == pytest.approx(level)
        assert found['wire.E_M'] == pytest.approx(MARTENSITE_OVER_AUSTENITE * found['wire.E_A'])
        assert found['wire.E_A'] == pytest.approx(5e10 if features.isothermal else 6e10)
        softer = loops[0].loading * (1.0 / found['wire.E_M'] - 1.0 / found['wire.E_A'])
        assert found['wire.eps_T'] == pytest.approx(0.04 if features.isobaric else 0.035 - softer)
    points = CurveFeatures(tests, (isothermal(320.0, 1e8, float('nan')),)).points
    assert [len(way) for way in points] == [3, 2] and points[0][-1] == (320.0, 1e8)


def test_a_single_test_starts_from_usual_slopes():
    alone = starting_values(CurveFeatures((isobaric(1e8, (300.0, 320.0)),)))
    assert alone['wire.sigma_T'] == USUAL_SLOPE and alone['wire.dsigma'] == pytest.approx(20.0 * USUAL_SLOPE)
    assert (alone['wire.T0'], alone['wire.sigma_MW0'], alone['wire.E_A']) == (310.0, 1e8, 5e10)
    steep = CurveFeatures((), (isothermal(300.0, 1e8, 5e7), isothermal(301.0, 9e8, 8e8, 1e12)))
    assert starting_values(steep)['wire.sigma_T'] == 3e7 and starting_values(steep)['wire.E_A'] == 2e11
    two = CurveFeatures((isobaric(1e8, (300.0, 320.0)), isobaric(2e8, (310.0, 330.0))))
    assert austenite_modulus(two) == pytest.approx(6e10)
    assert median_slope([(0.0, 0.0), (1.0, 1.0), (2.0, 9.0)]) == pytest.approx(4.5)  # of 1, 4.5 and 8
    assert median_slope([(1.0, 0.0), (1.0, 5.0), (2.0, 7.0)]) == pytest.approx(4.5)  # two at one temperature have none


def test_a_loop_whose_unloading_has_no_plateau_is_half_a_hysteresis_above_the_middle():
    """Below A_f a wire keeps its strain: what loading says still counts, at its own temperature."""
    open_loop = isothermal(320.0, 3e8, float('nan'))
    alone = starting_values(CurveFeatures((), (open_loop,)))
    assert (alone['wire.T0'], alone['wire.dsigma']) == (320.0, USUAL_SLOPE)
    assert alone['wire.sigma_MW0'] == pytest.approx(3e8 - 0.5 * USUAL_SLOPE)
    both = starting_values(CurveFeatures((), (open_loop, isothermal(330.0, 3.6e8, 2e8))))
    assert both['wire.sigma_T'] == pytest.approx(6e6) and both['wire.dsigma'] == pytest.approx(1.6e8)
    assert both['wire.T0'] == 325.0 and both['wire.sigma_MW0'] == pytest.approx(0.5 * (2.2e8 + 2.8e8))


def test_a_loop_says_at_which_temperature_and_whether_it_was_heated():
    up = np.linspace(0.0, 0.05, 300)
    strain = np.concatenate([up, up[::-1]])
    stress = np.concatenate(
        [np.minimum(6e10 * up, 3e8), np.minimum(np.maximum(3e8 - 6e10 * (0.05 - up[::-1]), 1.2e8), 6e10 * up[::-1])]
    )
    times = np.linspace(0.0, 100.0, len(strain))

    def loop(J):
        source = wire_input(times, strain, J, np.full(len(strain), 325.0))
        return Recording('loop', 'wire', times, {'stress': stress}, source)

    found = isothermal_test(loop(0.0))
    assert found is not None and found.temperature == 325.0 and isothermal_test(loop(0.1)) is None
    assert found.hysteresis == pytest.approx(1.8e8, rel=0.02)
    assert plateaus_as_text([found])[2].split() == [
        'loop',
        f'{325.0 - 273.15:.1f}',
        f'{found.loading / 1e6:.1f}',
        f'{found.unloading / 1e6:.1f}',
        f'{100.0 * found.plateau_strain:.2f}',
        '%',
    ]
    assert isothermal_features('short', np.full(600, 325.0), 0.09 * strain, stress) is None
    assert isothermal_features('few', np.full(9, 325.0), strain[:9], stress[:9]) is None
    one_way = isothermal_features('up', np.full(300, 325.0), strain[:300], stress[:300])
    assert one_way is None


def test_another_reference_temperature_changes_no_stress():
    """sigma_MW0 + sigma_T (T - T0) at any T."""
    values = {'wire.sigma_T': 2e6, 'wire.T0': 315.0, 'wire.sigma_MW0': 1e8, 'wire.E_A': 1.0}
    moved = moved_to(values, 323.0)
    assert (moved['wire.T0'], moved['wire.E_A']) == (323.0, 1.0)
    for T in (300.0, 350.0):
        before, after = (v['wire.sigma_MW0'] + v['wire.sigma_T'] * (T - v['wire.T0']) for v in (values, moved))
        assert before == pytest.approx(after)


def test_loops_of_the_papers_calibration_side_by_side():
    """Slopes between neighbours that are more than a kelvin apart, and the spread of dsigma."""
    levels, heights = (1e8, 1.01e8, 1.5e8), (1e7, 1.2e7, 0.8e7)
    runs = [
        Recording(
            f'at{T}', 'wire', np.arange(2.0), {'stress': np.zeros(2)}, wire_input([0.0, 1.0], [0.0, 0.01], 0.0, [T, T])
        )
        for T in (300.0, 300.5, 310.0)
    ]
    fits = {
        run.name: SimpleNamespace(values=dict(zip(FURTHER_NAMES, (level, height), strict=True)), uncertainty=None)
        for run, level, height in zip(runs, levels, heights, strict=True)
    }
    found = summary(Config(), None, runs, fits, {run.name: 1.0 for run in runs}, 5e6)
    assert found.slopes == pytest.approx((0.49e8 / 9.5,)) and found.dsigma_spread == pytest.approx(1.5)
    first = found.loops[0]
    assert isinstance(first, Loop) and (first.T_E, first.sigma_MW, first.dsigma, first.rmse) == (300.0, 1e8, 1e7, 1.0)
    assert np.isnan(first.sigma_MW_std) and temperature(runs[1]) == 300.5
