"""Wires of any make: what is plausible of a material, and how the material is known."""

import numpy as np
import pytest
from simulated_data import config as module

from sma_sim import FitOptions, Input, Recording, read_config
from sma_sim.evidence.estimation.free_parameters import choose_free, with_usual_limits
from sma_sim.evidence.estimation.plausibility import implausible_parameters
from sma_sim.evidence.estimation.residuals import SOFTEST, ZERO_LIMIT, fit_data
from sma_sim.model.errors import UserError
from sma_sim.model.materials import MATERIALS, material_of, usual_ranges
from sma_sim.words.fit_remarks import implausible_sentence

WIRE = ('system=wire', 'wire.sigma_T=8e6', 'wire.dsigma=1.6e8', 'wire.sigma_MW0=1e8')
NAMES = ('wire.E_A', 'wire.eps_T', 'wire.sigma_MW0', 'wire.lambda')


def found_at(base, values, material=''):
    """What is implausible of values (SI) that are all well known."""
    free, _ = choose_free(base, NAMES)
    z = np.array([parameter.coordinate(values.get(parameter.name, parameter.center)) for parameter in free])
    fitted = base.variant({p.name: p.value(float(x)) for p, x in zip(free, z, strict=True)})
    return implausible_parameters(fitted, free, z, 1e-6 * np.eye(len(z)), material)


@pytest.mark.parametrize(('T0', 'name'), [(290.0, 'superelastic'), (340.0, 'actuator'), (450.0, 'high-temperature')])
def test_transformation_temperatures_tell_the_material(T0, name):
    """Without load martensite forms at T0 - 22.5 K, austenite at T0 - 2.5 K: (sigma_MW0 +- dsigma/2)/sigma_T."""
    config = read_config(words=[*WIRE, f'wire.T0={T0}'])
    p = config.parameters
    assert material_of(p, 1) is MATERIALS[name] and material_of(p, 1, 'actuator') is MATERIALS['actuator']
    assert material_of(module().parameters, 2) is None


def test_limits_hold_what_is_usual_where_nothing_was_stated():
    """Natural convection from a wire of 0.4 mm is 22 W/(m^2 K): a twentieth of the default, which is another robot's."""
    base = read_config(words=['system=wire', 'wire.r0=1.9e-4'])
    (plain,), (usual,) = (free := choose_free(base, ['wire.lambda'])[0]), with_usual_limits(free, base)
    assert plain.value(plain.low) > 22.0 > usual.value(usual.low) and usual.value(usual.high) > plain.value(plain.high)
    cooling = usual_ranges(material_of(base.parameters, 1), base.parameters)['wire.lambda']
    ends = [abs(usual.coordinate(value)) for value in cooling]
    assert max(ends) == pytest.approx(2.0)  # standard deviations, at the farther end
    assert plain.scale < usual.scale
    stated = read_config(words=['system=wire', 'wire.r0=1.9e-4', 'wire.lambda=100'])
    free, _ = choose_free(stated, ['wire.lambda'])
    assert with_usual_limits(free, stated) == free
    assert (
        with_usual_limits(choose_free(module(), ['wire.lambda'])[0], module()) == choose_free(module(), ['wire.lambda'])[0]
    )


def test_a_wire_of_another_make_is_plausible_and_what_no_wire_has_is_not():
    base = read_config(words=[*WIRE, 'wire.T0=340', 'wire.E_A=3e10', 'wire.eps_T=0.025'])
    assert not found_at(base, {'wire.E_A': 8.5e10, 'wire.eps_T': 0.06, 'wire.sigma_MW0': 2.4e8})
    (strain,) = found_at(base, {'wire.eps_T': 0.11})
    assert strain.text == 'wire.eps_T 0.11 (an actuator wire of NiTi: 0.01667 to 0.07)'
    assert implausible_sentence([strain]).endswith('or its wire is of another material (--material).')
    assert not found_at(base, {'wire.E_A': 1.05e11}, 'high-temperature') and found_at(base, {'wire.E_A': 1.05e11})


@pytest.mark.parametrize('material', MATERIALS.values(), ids=MATERIALS)
def test_martensite_is_nowhere_usual_where_it_would_be_stiffer_than_any_austenite(material):
    assert all(0.0 < low < high for low, high in material.ranges.values())
    austenite, martensite = material.ranges['wire.E_A'], material.ranges['wire.E_M']
    assert martensite[0] < austenite[0] and martensite[1] < austenite[1]


def test_cooling_is_plausible_from_a_bundle_in_still_air_to_flowing_water():
    """lambda = Nu k/d of a wire of 0.2 mm: free convection in air at the least, a flow of water at the most."""
    config = read_config(words=[*WIRE, 'wire.r0=1e-4'])
    low, high = usual_ranges(MATERIALS['actuator'], config.parameters)['wire.lambda']
    assert (low, high) == pytest.approx((0.15 * 0.026 / 2e-4, 20.0 * 0.61 / 2e-4))
    assert not found_at(config, {'wire.lambda': 3000.0}) and not found_at(config, {'wire.lambda': 60.0})


def test_values_that_were_stated_are_judged_by_how_well_they_are_known():
    base = read_config(words=[*WIRE, 'wire.T0=340', 'wire.E_A=3e10'])
    stated = read_config(words=[*WIRE, 'wire.T0=340', 'wire.E_A=3e10', 'priors.wire.E_A=1e9'])
    assert [one.name for one in found_at(stated, {'wire.E_A': 3.4e10})] == ['wire.E_A']
    assert not found_at(base, {'wire.E_A': 5e10})


def test_a_material_that_there_is_not():
    with pytest.raises(UserError, match="material 'actuatr'.*did you mean actuator"):
        FitOptions(material='actuatr')


@pytest.mark.parametrize('is_zeroed', [True, False])
def test_a_strain_that_was_set_to_zero_under_load_lacks_what_the_load_did(is_zeroed):
    times, T = np.arange(50.0), np.linspace(300.0, 400.0, 50)
    values = np.column_stack([np.full(50, 2e8), T, 0.0 * T, np.full(50, 298.0)])
    source = Input(times, values, (True, True, False, False), ('stress_Pa', 'T_K', 'J_W', 'T_E_K'))
    strain = np.linspace(0.04, 0.0 if is_zeroed else 1e-4, 50)
    run = Recording('run', 'wire_under_load_at_T', times, {'strain': strain}, source)
    high = fit_data(run, {'strain': 1e-4}).zero_range[1]
    assert high == pytest.approx(ZERO_LIMIT + is_zeroed * 2e8 / SOFTEST)
