"""A coil spring of SMA wire against the springs of textbooks, the helix of Love, and what an ohmmeter shows."""

import math

import numpy as np
import pytest

from sma_sim import Config, Dataset, FitOptions, Input, Model, Recording, calibrate, default_parameters, simulate
from sma_sim.model.material import latent_heat, sigma_A, sigma_M
from sma_sim.model.parameters import wire_constants
from sma_sim.model.structures.coil import STRUCTURE, strain
from sma_sim.solver.wire_columns import strains_and_ratios, stresses_from_forces

# Turns of a diameter that no one could wind keep the pitch so small that the helix is the spring of the textbook.
FLAT = {'coil.D': 1e-5, 'coil.h_0': 1e-5, 'coil.k': 0.0, 'coil.delta_0': 0.0, 'solver.rtol': 1e-9}
WEIGHT = {'coil.k': 0.0, 'coil.m': 0.03}


def coil_model(kinetics='hybrid', **changed):
    return Model(Config({name.replace('__', '.'): value for name, value in changed.items()}, 'coil', kinetics))


def at_rest(model, T_E=298.0, J=0.0, seconds=60.0):
    """The columns after `seconds` under one command."""
    command = Input(np.array([0.0, seconds]), np.array([[J, T_E]] * 2), (False, False), model.structure.input_columns)
    run = simulate(model, command, np.array([seconds]))
    assert run.completed
    return {name: float(run[name][-1]) for name in run.names}


def turns(values):
    """N of a coil with these parameters."""
    return values['wire.l0'] * math.sqrt(1.0 - (values['coil.h_0'] / values['wire.l0']) ** 2) / (math.pi * values['coil.D'])


@pytest.mark.parametrize(
    ('phase', 'x_M', 'T_E', 'weights'), [('A', 0.0, 380.0, (0.1, 0.2)), ('M', 1.0, 240.0, (10.0, 11.0))]
)
def test_each_phase_is_the_spring_of_the_textbook(phase, x_M, T_E, weights):
    """Two weights hang G d^4/(8 D^3 N) apart, G = E/3, in austenite and in martensite."""
    places, changed = [], {**FLAT, 'initial.x_M_1': x_M, 'wire.eps_T': 1e-3}
    for weight in weights:
        model = coil_model(**changed, **{'coil.m': weight / 9.81})
        place = at_rest(model, T_E, seconds=1.0)
        assert place['x_M'] == x_M and place['F_N'] == pytest.approx(weight, rel=1e-6)
        places.append(place['stroke_m'])
    c = model.config.parameters
    stiffness = c[f'wire.E_{phase}'] / 3.0 * (2.0 * c['wire.r0']) ** 4 / (8.0 * c['coil.D'] ** 3 * turns(c))
    assert (weights[1] - weights[0]) / (places[0] - places[1]) == pytest.approx(stiffness, rel=1e-6)


def test_stress_and_strain_are_those_of_a_twisted_bar():
    """At small pitch sigma = sqrt(3/2) 8 F D/(pi d^3), and eps = d delta/(sqrt(6) pi D^2 N)."""
    model = coil_model(**FLAT, **{'coil.m': 1.0 / 9.81, 'initial.x_M_1': 0.0})
    place, c = at_rest(model, 380.0, seconds=1.0), model.config.parameters
    columns = {name: np.array([value]) for name, value in place.items()}
    d, D, extension = 2.0 * c['wire.r0'], c['coil.D'], -place['stroke_m']
    stress = stresses_from_forces(model.config, columns)['stress'][0]
    assert stress == pytest.approx(math.sqrt(1.5) * 8.0 * place['F_N'] * D / (math.pi * d**3), rel=1e-6)
    eps = strains_and_ratios(model.config, columns)[0, 0, 0]
    assert eps == pytest.approx(d * extension / (math.sqrt(6.0) * math.pi * D**2 * turns(c)), rel=1e-6)
    assert stress == pytest.approx(c['wire.E_A'] * eps, rel=1e-9)


@pytest.mark.parametrize('h_0', [8e-3, 0.06])
def test_an_elastic_coil_is_the_helix_of_love(h_0):
    """At any pitch the energy E Om eps^2/2 is that of twisting and bending, and the force its slope."""
    values = STRUCTURE.default_values | {'coil.h_0': h_0}
    p, w = STRUCTURE.constants_of(values), wire_constants(values)
    around = 2.0 * math.cos(math.asin(h_0 / w.l0)) / values['coil.D']

    def energy(h):
        twist = around * (h - h_0) / w.l0
        bend = around * (math.sqrt(1.0 - (h / w.l0) ** 2) - math.cos(math.asin(h_0 / w.l0)))
        area_moment = 0.25 * math.pi * w.r0**4
        return 0.5 * w.l0 * (w.E_A / 3.0 * 2.0 * area_moment * twist**2 + w.E_A * area_moment * bend**2)

    for part in (-0.5, -0.1, 0.05, 0.2, 0.5, 0.8, 0.95, 0.99):
        h, step = part * w.l0, 1e-6 * w.l0
        eps, ratio = strain(h, p)
        assert 0.5 * w.E_A * w.volume * eps**2 == pytest.approx(energy(h), rel=1e-9)
        slope = (8.0 * (energy(h + step) - energy(h - step)) - energy(h + 2 * step) + energy(h - 2 * step)) / (12.0 * step)
        assert w.section * w.E_A * eps * ratio == pytest.approx(slope, rel=1e-6)


def test_strain_goes_on_smoothly_where_the_wire_is_straight():
    """Beyond 85 degrees of pitch, on both sides, it has the same value, slope and curvature, and grows ever faster."""
    p = STRUCTURE.default_constants
    for side in (1.0, -1.0):
        edge, h = side * math.sin(math.radians(85.0)) * p.l0, side * 1e-7 * p.l0
        inside, at, outside = (strain(edge + k * h, p) for k in (-1, 0, 1))
        assert outside[0] - 2.0 * at[0] + inside[0] == pytest.approx(0.0, abs=1e-9 * abs(at[0]))
        assert outside[1] - at[1] == pytest.approx(at[1] - inside[1], rel=1e-3)
        assert (at[0] - inside[0]) / (side * 1e-7) == pytest.approx(at[1], rel=1e-4)
        assert strain(3.0 * edge, p)[1] > strain(2.0 * edge, p)[1] > at[1]


@pytest.mark.parametrize('kinetics', ['hybrid', 'mas'])
def test_a_coil_lifts_its_weight(kinetics):
    """Cold it hangs where sigma = sigma_A, hot it is the spring of austenite; J = lambda A_s (T - T_E) at rest."""
    model = coil_model(kinetics, **WEIGHT, **{'solver.rtol': 1e-9})
    c, w = model.config.parameters, model.wire
    cold, hot = at_rest(model, seconds=1.0), at_rest(model, J=4.0)
    for place in (cold, hot):
        assert place['F_N'] == pytest.approx(c['coil.m'] * 9.81, rel=1e-6 if kinetics == 'hybrid' else 5e-3)  # it creeps
    stress = stresses_from_forces(model.config, {name: np.array([value]) for name, value in cold.items()})['stress'][0]
    assert stress == pytest.approx(sigma_A(298.0, w), rel=1e-6 if kinetics == 'hybrid' else 0.01)
    assert hot['T_K'] - 298.0 == pytest.approx(4.0 / (w.lambda_ * 2.0 * math.pi * w.r0 * w.l0), rel=1e-6)
    assert hot['x_M'] == pytest.approx(0.0, abs=1e-6) and sigma_M(hot['T_K'], w) > 1.5 * stress
    eps, ratio = strain(c['coil.h_0'] + c['coil.delta_0'] - hot['stroke_m'], model.constants)
    assert w.section * w.E_A * eps * ratio == pytest.approx(c['coil.m'] * 9.81, rel=1e-6)
    assert hot['stroke_m'] - cold['stroke_m'] > 0.04


def test_work_is_what_the_heat_and_the_phase_change_give():
    """Of a whole cycle the wire keeps nothing: electrical work less heat to the air is what damping takes, here nothing."""
    model = coil_model(**WEIGHT, **{'solver.rtol': 1e-8, 'coil.b': 0.02})
    times = np.array([0.0, 1.0, 11.0, 60.0])
    command = Input(
        times,
        np.array([[0.0, 298.0], [4.0, 298.0], [0.0, 298.0], [0.0, 298.0]]),
        (False, False),
        model.structure.input_columns,
    )
    run = simulate(model, command, np.arange(0.0, 60.0, 1e-3))
    w, t = model.wire, run.time
    lost = np.trapezoid(w.lambda_ * w.surface * (run['T_K'] - 298.0), t)
    speed = np.gradient(run['stroke_m'], t)
    assert lost + 0.02 * np.trapezoid(speed**2, t) == pytest.approx(40.0, rel=1e-3)
    assert run['x_M'][-1] == pytest.approx(run['x_M'][0], abs=1e-4)
    assert latent_heat(298.0, 7e7, w) * run['x_M'][0] > 0.01  # which is in the balance twice


def test_shear_does_not_lengthen_the_wire():
    """Its resistance is that of its own length, whatever the coil's."""
    model = coil_model(**WEIGHT)
    cold, hot = at_rest(model, seconds=1.0), at_rest(model, J=4.0)
    c, w = model.config.parameters, model.wire
    for place in (cold, hot):
        above = place['T_K'] - 293.15
        phases = [(1.0 - place['x_M'], 'A'), (place['x_M'], 'M')]
        rho = sum(x * c[f'wire.resistivity_{k}'] * (1.0 + c[f'wire.resistivity_T_{k}'] * above) for x, k in phases)
        assert place['R_ohm'] == pytest.approx(rho * w.l0 / w.section, rel=1e-9)
    assert cold['R_ohm'] > hot['R_ohm']


def test_a_bias_spring_takes_the_place_of_a_weight():
    """F = k (x + x_0) at rest, horizontally; the stiffer spring is drawn less far."""
    strokes = []
    for k in (4.0, 8.0):
        model = coil_model(**{'coil.k': k, 'coil.x_0': 0.3 / k, 'coil.incline': 0.0, 'solver.rtol': 1e-8})
        cold, hot = at_rest(model, seconds=1.0), at_rest(model, J=6.0)
        for place in (cold, hot):
            assert place['F_N'] == pytest.approx(k * (place['stroke_m'] + 0.3 / k), rel=1e-6)
        assert hot['x_M'] == pytest.approx(0.0, abs=1e-9)
        strokes.append(hot['stroke_m'] - cold['stroke_m'])
    assert strokes[0] > strokes[1] > 0.01


def test_the_textbook_section_against_one_stress_for_all():
    """What the documentation says of the plateau: a bar with an elastic core carries at most 16 % less, 6 % in the end."""
    surface = np.linspace(1.0, 200.0, 100_000)  # shear at the surface over that at which it begins to transform
    core = 2.0 / 3.0 * math.pi * (1.0 - 0.25 / surface**3)  # torque over R^3 tau
    one = math.pi / math.sqrt(2.0) * np.minimum(surface / math.sqrt(2.0), 1.0)
    assert (one / core - 1.0).max() == pytest.approx(0.164, abs=1e-3)
    assert one[-1] / core[-1] - 1.0 == pytest.approx(0.0607, abs=1e-4)
    assert one[0] == pytest.approx(core[0])


def test_parallel_coils_share_the_load():
    """n coils, each heated by J/n, lift n times the weight by as much."""
    single, double = coil_model(**WEIGHT), coil_model(**{**WEIGHT, 'coil.m': 0.06, 'wire.n': 2.0})
    for J in (0.0, 4.0):
        one, two = at_rest(single, J=J), at_rest(double, J=2.0 * J)
        assert two['stroke_m'] == pytest.approx(one['stroke_m'], abs=1e-6)
        assert two['F_N'] == pytest.approx(2.0 * one['F_N'], rel=1e-4)
    assert default_parameters('coil')['wire.n'] == 1.0


def test_a_coil_in_still_air_is_fitted_from_the_values_of_a_bundle():
    """Heat transfer a fifteenth of the default, which is that of another robot."""
    start, random, heat_transfer = Config(WEIGHT, 'coil'), np.random.default_rng(0), 30.0
    truth = start.variant({'wire.lambda': heat_transfer, 'wire.c_V': 600.0})
    surface = 2.0 * math.pi * start.parameters['wire.r0'] * start.parameters['wire.l0']
    rise = np.array([0.0, 90.0, 0.0, 60.0, 0.0, 0.0])  # [K] to which the wire is heated above the room
    columns = np.column_stack([rise * heat_transfer * surface, np.full(6, 298.0)])
    model, times = Model(truth), np.array([0.0, 4.0, 44.0, 90.0, 130.0, 170.0])
    run = simulate(model, Input(times, columns, (False, False), model.structure.input_columns), 4.0)
    noise = {'stroke': 2e-4, 'T': 0.3}
    shown = {
        name: run[column] + noise[name] * random.normal(size=len(run.time))
        for name, column in (('stroke', 'stroke_m'), ('T', 'T_K'))
    }
    recording = Recording(
        'run', 'coil', run.time, shown, Input(times, columns, (False, False), model.structure.input_columns)
    )
    found = calibrate(Dataset(recording, noise), start, FitOptions(kinetics='hybrid'))
    assert found.error == pytest.approx(1.0, abs=0.05) and not found.limits
    assert found.values['wire.lambda'] == pytest.approx(heat_transfer, rel=0.01)
    assert found.intervals['wire.c_V'].low < 600.0 < found.intervals['wire.c_V'].high
