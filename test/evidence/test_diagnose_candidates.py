"""Which effects a diagnosis tries and which values it believes; `add` and wrong use on the command line."""

import pytest
from isobaric_runs import BENCH as ISOBARIC
from simulated_data import config

from sma_sim import Config, Dataset, UserError, find_effects
from sma_sim.cli.main import main
from sma_sim.evidence.diagnosis.diagnose import diagnose
from sma_sim.evidence.estimation.plausibility import is_plausible, other_form
from sma_sim.evidence.model_selection.candidates import candidates_for, shape_values
from sma_sim.model.config import read_config
from sma_sim.model.effects.meaning import acts_on
from sma_sim.model.structures.module import STRUCTURE as MODULE


def test_candidates():
    names = {candidate.name for candidate in candidates_for(Config())}
    acting = {name for name, found in find_effects().items() if acts_on(found, MODULE)}
    assert {'sensor_crosstalk', 'sensor_drift', 'sensor_jump', 'clamp_slip', 'clock_skew', 'ambient_drift'} <= names
    assert {'driver_saturation', 'heat_capacity_difference'} <= names
    of_wires = {'stress_dependent_transformation_strain', 'grip_toe', 'temperature_gradient'}
    assert set(find_effects()) - acting == {'cubic_stiffness', 'backlash'} | of_wires  # of springs that a beam has not
    of_single_wires = {'r_phase_strain', 'transformation_plasticity', 'nucleation_peak'}
    assert acting - names == {*of_single_wires, 'power_scale', 'thermometer_lag'}
    of_slider = {candidate.name for candidate in candidates_for(Config(system='slider'))}
    assert of_single_wires | {'stress_dependent_transformation_strain'} <= of_slider
    assert not of_slider & {'grip_toe', 'temperature_gradient'}
    of_timeless = {candidate.name for candidate in candidates_for(read_config(words=ISOBARIC))}
    assert 'slack' in of_timeless and not of_timeless & {'guide_friction', 'sensor_lag', 'temperature_gradient'}
    assert 'gravity' not in {candidate.name for candidate in candidates_for(read_config(effects=['gravity']))}
    of_wire = {candidate.name for candidate in candidates_for(Config(system='wire'))}
    assert 'gravity' not in of_wire and 'polycrystal' in of_wire
    for candidate in candidates_for(Config()):
        for family in candidate.families:
            for probe in family:
                parameter = next(p for p in candidate.effect.parameters if p.name == probe.parameter)
                assert parameter.bounds[0] <= probe.neutral + probe.step <= parameter.bounds[1] and probe.step != 0.0
                if parameter.realistic:
                    assert is_plausible(candidate.effect, {probe.parameter: probe.neutral + probe.step, **probe.shape})


def test_shapes_are_probed_one_at_a_time():
    """Four shapes at three values each: the centre and the two others of each, not all 81 combinations; strengths whose
    range does not begin at neutral at three sizes, in the centre."""
    by_name = {candidate.name: candidate for candidate in candidates_for(Config())}
    for name, count in (('smooth_transformation', 9), ('r_phase', 5), ('beam_creep', 3), ('gravity', 1)):
        families = by_name[name].families
        shapes = [dict(family[0].shape) for family in families]
        centre = shapes[len(shapes) // 2]
        assert len({tuple(shape.items()) for shape in shapes}) == count
        of_centre = [[probe.step for probe in family] for family in families if family[0].shape == centre]
        assert len(families) - len(of_centre) == count - 1
        assert of_centre == sorted(of_centre) and len(of_centre) == (1 if name == 'gravity' else 3)
        assert all(sum(shape[key] != centre[key] for key in centre) <= 1 for shape in shapes)


def test_shapes_of_one_sign_are_divided_by_ratios():
    shapes = [p for found in find_effects().values() for p in found.parameters if p.neutral is None and p.realistic]
    positive = [p for p in shapes if p.realistic[0] > 0.0]
    assert 10 < len(positive) < len(shapes)
    for parameter in positive:
        first, middle, last = shape_values(parameter)
        assert first * last == pytest.approx(middle**2) == pytest.approx(parameter.realistic[0] * parameter.realistic[1])


def test_plausible_values():
    convection = find_effects()['natural_convection']
    assert is_plausible(convection, {'k': 40.0, 'm': 0.25}) and not is_plausible(convection, {'k': 4000.0})
    assert not is_plausible(convection, {'k': float('nan')})
    assert is_plausible(convection, {'k': 2.0, 'm': 0.9}) and other_form(convection, {'k': 2.0, 'm': 0.9}) == 'with m = 0.9'
    assert other_form(convection, {'k': 4000.0, 'm': 0.25}) == ''


def test_add_writes_what_the_node_runs(tmp_path, capsys):
    out = tmp_path / 'b.yaml'
    assert main(['add', 'gravity', 'natural_convection:k=20', '-o', str(out)]) == 0
    config_ = read_config(out)
    assert [active.effect.name for active in config_.effects] == ['gravity', 'natural_convection']
    assert main(['add', 'radiation', '--config', str(out), '-o', str(out)]) == 0
    assert len(read_config(out).effects) == 3
    assert main(['add', 'gravitation', '-o', str(out)]) == 2
    assert 'unknown effect gravitation' in capsys.readouterr().err
    assert main(['add', 'gravity', '-o', str(tmp_path / 'b.txt')]) == 2


def test_wrong_use(tmp_path, capsys):
    (tmp_path / 'run.csv').write_text('time_s,J_eq_W,alpha_rad\n0,0,0\n1,1,0\n2,1,0\n')
    for words, message in (
        (['nowhere.csv'], 'nowhere.csv'),
        ([str(tmp_path / 'run.csv'), '--hold-out', 'walk'], 'walk'),
        ([str(tmp_path / 'run.csv'), '--json', 'x.txt'], 'expected a name that ends in .json'),
    ):
        assert main(['diagnose', *words]) == 2
        said = capsys.readouterr().err
        assert message in said and 'Traceback' not in said
    with pytest.raises(UserError):
        diagnose(Dataset(()), config())
