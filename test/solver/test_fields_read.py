"""What a kernel of a user's own reads is inferred: x_M is then solved for, however the kernel gets at it."""

import warnings

import numpy as np
import pytest
from systems import active, make_model

from sma_sim import find_effects, simulate, wire_input
from sma_sim.compiler.effect_kernels import native_effect
from sma_sim.compiler.fields_read import check_fields, fields_read, uses_time
from sma_sim.model.effects.discovery import EffectError, package_effects
from sma_sim.model.effects.ports import State

SLOPE = 40e6  # [Pa]
TEXT = """
import math
from sma_sim import Effect, Parameter
import {folder}_helper

def local(state, by): return by * (state.x - 0.5)
def twice(state, by): return local(state, by)
def closure(by): return lambda s, w, p: (by * p.slope * (s.x - 0.5), p.slope * (s.x - 0.5))
def unpacked(s, w, p):
    T, x = s.T, s.x
    return p.slope * (x - 0.5), p.slope * (x - 0.5)

EFFECT = Effect(name='{folder}', port='{port}', equation='-', source='a test', kernel={kernel},
    parameters=(Parameter('slope', 40e6, 'Pa', (0.0, 1e9), 'of the stress over x_M', '', 0.0, (0.0, 1e9)),))
"""
HELPER = 'def shift(s, by):\n    return by * (s.x - 0.5)\n'
KERNELS = {
    'by_helper': 'lambda s, w, p: (twice(s, p.slope), local(s, p.slope))',
    'by_module': 'lambda s, w, p: (by_module_helper.shift(s, p.slope), local(s, p.slope))',
    'by_closure': 'closure(1.0)',
    'by_unpacking': 'unpacked',
    'by_index': 'lambda s, w, p: (p.slope * (s[4] - 0.5), p.slope * (s[4] - 0.5))',
}


def own_effect(folder, name, kernel, port='transformation_stress'):
    """An effect in a folder of a user's own."""
    place = folder / name
    place.mkdir()
    (place / f'{name}.py').write_text(TEXT.format(folder=name, kernel=kernel, port=port))
    (place / f'{name}_helper.py').write_text(HELPER)
    return find_effects([place])[name]


@pytest.mark.parametrize('name', KERNELS)
def test_the_fraction_is_that_of_its_own_equation(tmp_path, name):
    """sigma = sigma_A + s_A(x_M) while the wire transforms: with the x_M of the step before it would be off."""
    found = own_effect(tmp_path, name, KERNELS[name])
    model = make_model('wire', effects=[active(name, {name: found})])
    run = simulate(model, wire_input([0.0, 1.0, 2.0], [0.03, 0.06, 0.02]), 200.0)
    w, on = model.compiled.wire, {mode: run['mode'] == mode for mode in (4, 5)}
    for mode, half in ((4, 0.5), (5, -0.5)):
        assert on[mode].sum() > 10
        level = w.sigma_MW0 + w.sigma_T * (run['T_K'] - w.T0) + half * w.dsigma + SLOPE * (run['x_M'] - 0.5)
        assert run['stress_Pa'][on[mode]] == pytest.approx(level[on[mode]], abs=1.0)


def test_fields_of_kernels():
    def inner(s, k):
        return s.T_E + k

    assert fields_read(lambda s, w, p: s.T + w.x * p.eps) == {'T'}
    assert fields_read(lambda s, w, p: inner(s, 1.0) if p.a > 0.0 else s.deps) == {'T_E', 'deps'}
    assert fields_read(lambda s, w, p: max(s.T, 0.0)) == {'T'}
    assert fields_read(lambda s, w, p: getattr(s, 'x')) == {'x'}  # noqa: B009
    assert fields_read(None) == frozenset()
    for unclear in (
        lambda s, w, p: s[p.k],
        lambda s, w, p: sum(s),
        lambda s, w, p: inner(k=1.0, s=s),
        lambda s, w, p: max(*s),
    ):
        assert fields_read(unclear) == set(State._fields)


def test_the_library_is_read_exactly():
    """No effect of the package falls back to reading everything, and those that depend on time or x_M are known."""
    effects = package_effects()
    assert all(fields_read(effect.kernel) != set(State._fields) for effect in effects.values())
    shifting = {e.name for e in effects.values() if e.port in ('wire_strain', 'transformation_stress')}
    assert {name for name in shifting if 'x' in fields_read(effects[name].kernel)} == {
        'attachment_compliance',
        'grip_toe',
        'nucleation_peak',
        'polycrystal',
        'r_phase_strain',
        'smooth_transformation',
        'stress_dependent_transformation_strain',
        'temperature_gradient',
        'thermal_expansion',
    }
    timed = {'ambient_drift', 'clamp_slip', 'sensor_drift', 'sensor_jump'}
    assert {name for name, effect in effects.items() if uses_time(effect)} == timed
    for effect in effects.values():
        check_fields(effect)


def test_what_is_not_known_yet_is_refused(tmp_path):
    kernel = 'lambda s, w, p: (p.slope * s.sigma, p.slope * s.dx)'
    with pytest.raises(EffectError, match=r'its value reads s\.dx, s\.sigma, not known yet when port transformation_stress'):
        native_effect(own_effect(tmp_path, 'early', kernel))


def test_a_declaration_is_no_longer_needed(tmp_path):
    (tmp_path / 'old.py').write_text(
        TEXT.format(folder='old', kernel=KERNELS['by_index'], port='transformation_stress').replace(
            "source='a test',", "source='a test', depends_on_x=True,"
        )
    )
    (tmp_path / 'old_helper.py').write_text(HELPER)
    with pytest.raises(EffectError, match='depends_on_x.*remove it: what a kernel reads is inferred'):
        find_effects([tmp_path])


def test_the_surface_by_its_old_name_works_with_a_warning(tmp_path):
    runs = []
    for name in ('surface', 'area'):
        found = own_effect(tmp_path, f'by_{name}', f'lambda s, w, p: 1e-3 * p.slope * w.{name}', 'wire_heat')
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter('always')
            model = make_model('wire', effects=[active(f'by_{name}', {f'by_{name}': found})])
            runs.append(simulate(model, wire_input([0.0, 1.0], [0.03, 0.03]), 10.0))
        assert [str(one.message).partition(';')[0] for one in said if 'w.area' in str(one.message)] == (
            ["effect 'by_area' reads w.area, which is called w.surface now: the lateral surface of a wire [m^2]"]
            * (name == 'area')
        )
    assert (runs[0]['T_K'] == runs[1]['T_K']).all() and runs[0]['T_K'][-1] > 300.0


def test_time_in_a_helper_makes_the_flow_depend_on_time(tmp_path):
    found = own_effect(tmp_path, 'timed', 'lambda s, w, p: p.slope * math.sin(s.t)', 'wire_heat')
    model = make_model('wire', effects=[active('timed', {'timed': found})])
    assert model.uses_time and not make_model('wire').uses_time
    assert np.isfinite(simulate(model, wire_input([0.0, 1.0], [0.03, 0.03]), 10.0)['T_K']).all()
