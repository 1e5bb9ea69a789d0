"""Structures of one's own: they join without an edit of the package, and what is wrong with a file is told."""

import json
import math
import shutil
from pathlib import Path

import numpy as np
import pytest

from sma_sim import Recording, UserError, find_structures, read_config, wire_input
from sma_sim.cli.main import main
from sma_sim.compiler.structure_kernels import native_structure
from sma_sim.evidence.data.recording import in_order
from sma_sim.explore.application import Application
from sma_sim.explore.export import write_version
from sma_sim.explore.session import Start, open_session
from sma_sim.model.structures.discovery import StructureError, package_structures
from sma_sim.model.structures.structure import Structure
from sma_sim.solver.model import inertia_of

EXAMPLE = Path(__file__).resolve().parents[2] / 'examples' / 'own_structure'


def test_a_strangers_structure_is_short_and_needs_no_edit(tmp_path, capsys):
    lines = (EXAMPLE / 'rocker.py').read_text().splitlines()
    assert len([line for line in lines if line.strip()]) <= 40
    (tmp_path / 'c.csv').write_text('time_s,J_eq_W\n0,0\n2,1.2\n10,0\n12,0\n')
    out = tmp_path / 'out.csv'
    words = ['--config', str(EXAMPLE / 'robot.yaml')]
    assert main(['simulate', '--input', str(tmp_path / 'c.csv'), '--out', str(out), *words]) == 0
    header = out.read_text().splitlines()[0]
    assert header == 'time_s,J_eq_W,T_E_K,angle_rad,F_1_N,F_2_N,T_1_K,T_2_K,x_M_1,x_M_2,mode_1,mode_2'
    capsys.readouterr()
    assert main(['systems', 'rocker', '--json', *words]) == 0
    found = json.loads(capsys.readouterr().out)[0]
    assert found['inputs'] == ['time_s', 'J_eq_W', 'T_E_K'] and found['coordinates'][0]['name'] == 'angle'
    assert main(['compare', str(out), *words, '--noise', 'angle=1e-4']) == 0
    assert 'angle' in capsys.readouterr().out


def test_effects_without_a_meaning_are_said(tmp_path, capsys):
    """They are left out, as where one parameter file serves several systems; gravity would be missed otherwise."""
    (tmp_path / 'c.csv').write_text('time_s,J_eq_W\n0,0\n1,1\n')
    words = ['--config', str(EXAMPLE / 'robot.yaml'), '--input', str(tmp_path / 'c.csv'), '--out', str(tmp_path / 'o.csv')]
    assert main(['simulate', *words, *[w for n in ('gravity', 'beam_nonlinearity', 'slack') for w in ('--effect', n)]]) == 0
    told = capsys.readouterr().err
    assert 'note: effect gravity is left out: rocker declares no gravity' in told and 'slack' not in told
    assert 'note: effect beam_nonlinearity is left out: it acts on module' in told and 'not on rocker' in told


def test_systems_are_listed(capsys):
    assert main(['systems']) == 0
    text = capsys.readouterr().out
    listed = [name for name, found in package_structures().items() if found.has_own_columns]
    assert all(name in text for name in listed) and 'slider.k' in text and 'slider_at_T' not in text
    assert main(['systems', 'slidr']) == 2
    assert 'did you mean slider' in capsys.readouterr().err


def test_init_writes_the_file_of_a_structure(tmp_path, capsys):
    out = tmp_path / 'slider.yaml'
    words = ['init', '--system', 'slider', '--out', str(out), '--no-questions']
    assert main([*words, '--set', 'slider.k=55']) == 0
    config = read_config(out)
    assert config.system == 'slider' and config.parameters['slider.k'] == 55.0 and config.parameters['wire.n'] == 1.0
    assert 'beam:' not in out.read_text()
    for flags, message in (
        (['--beam-length', '100'], 'a slider has none; give its own with --set, which are slider.wires, slider.L'),
        (['--set', 'slider.L=0.3', '--set', 'slider.k=1e6'], 'against slider.L = 0.3 m'),
    ):
        assert main([*words, '--overwrite', *flags]) == 2
        assert message in capsys.readouterr().err


def changed(**fields):
    """The slider with some fields changed, as a file of the user's would have it."""
    structure = package_structures()['slider']
    return Structure(**{name: getattr(structure, name) for name in structure.__dataclass_fields__} | fields)


@pytest.mark.parametrize(
    ('fields', 'words'),
    [
        ({'gradients': lambda q, p: 1.0}, 'its gradients give 1 for wire 1 in position, differences of its lengths -1'),
        (
            {'strain': lambda length, p: (length / 0.094 - 1.0, 1.0 / 0.094)},
            'its strain gives 10.6383 as its second value at l = .* m, wire.l0 times differences of its first 1.0',
        ),
        ({'stiffness': lambda q, p, part: 10.0 * part * p.k * q.position}, 'its stiffness .* have 0.1 times as much'),
        ({'stiffness': lambda q, p, part: -part * p.k * q.position}, 'its stiffness .* have -1 times as much'),
        ({'stiffness': lambda q, p, part: p.k * q.position}, 'its stiffness is not in proportion to its part'),
        ({'energy': lambda q, v, p: 5.0 * p.k * (q.position + p.x_0) ** 2}, 'its forces give .* differences of its energy'),
        ({'forces': lambda q, v, p: (0.0, 0.0)}, r'its forces returns 2 number\(s\); expected 1'),
        ({'lengths': lambda q, p: p.nothing}, "its lengths fails: AttributeError: .*'nothing'"),
        ({'lengths': lambda q, p: sorted([p.L - q.position])[0]}, 'cannot be compiled'),
        ({'forces': lambda q, v, p: math.nan * q.position}, 'its forces returns nan at the default parameters'),
        ({'stiffness': lambda q, p, part: (0.0, part)}, r'its stiffness returns 2 number\(s\); expected 1'),
    ],
)
def test_wrong_structures_are_told(fields, words):
    with pytest.raises(StructureError, match=words):
        native_structure(changed(name=f'wrong_{len(words)}', **fields))


def test_structures_that_cannot_be_declared():
    for fields in ({'forces': None}, {'antagonistic': True}, {'wires': 0}, {'wires': 30}):
        with pytest.raises(ValueError, match='structure'):
            changed(**fields)


def test_files_of_structures_that_cannot_be_used(tmp_path):
    with pytest.raises(StructureError, match=r'structures\.paths: .* is not a folder'):
        find_structures([tmp_path / 'nowhere'])
    text = (EXAMPLE / 'rocker.py').read_text()
    for before, after, words in (
        ("name='rocker'", "name='lever'", "a structure named 'lever' exists already"),
        ("name='rocker'", "name='my rocker'", 'expected a name of letters, digits and _'),
        ("'angle', 'rad'", "'angle', 'deg'", 'the coordinate angle would be the column angle_deg'),
        ("'angle', 'rad'", "'angle', ''", "coordinate angle: expected a unit, such as 'm' or 'rad'"),
        ("'angle', 'rad', 0.1,", "'angle', 'rad', 0.0,", 'coordinate angle: scale = 0 rad; expected more than 0'),
        ("'positive where wire 1 is shorter'),", "''), Coordinate('angle', 'rad', 0.1),", 'angle is there twice'),
        ("'k', 50.0", "'k', '50 N'", r"parameter k: expected numbers, got default '50 N', bounds \(0.0, 100000.0\)"),
        ("50.0, 'N/m'", "50.0, ''", "parameter k: expected a unit, such as 'N/m'"),
        (
            "return math.hypot(along, p.h - up), math.hypot(along, p.h + up)",
            'pass',
            'its lengths give None for wire 1; expected a',
        ),
        (
            'return math.hypot(along, p.h - up), math',
            'return [1.0], math',
            r'its lengths give \[1.0\] for wire 1; expected a number',
        ),
        ("'k', 50.0", "'k', math.nan", 'parameter k: default nan N/m; expected 0 to 100000'),
        ("'k', 50.0", "'lambda', 50.0", "parameter 'lambda': a word of Python"),
        ("'angle', 'rad'", "'lambda', 'rad'", "coordinate 'lambda': a word of Python"),
        ("Parameter('k', 50.0, 'N/m', (0.0, 1e5), 'stiffness of each spring')", "'k'", "a list of Parameter; got 'k'"),
        ("'rocker.k', 'rocker.b'", "'rocker.c',", 'fitted names rocker.c, which is no parameter; its own are rocker.a'),
        ("'wire.n'", "'wire.N'", 'defaults names wire.N, which is no parameter'),
        ('p.h - up)', 'p.h - up) * math.acos(2.0 + q.angle)', 'its lengths fails: ValueError: math domain error'),
        (
            'return math.hypot(along, p.h - up)',
            'return -1.0',
            'its lengths give -1 m for wire 1 where all coordinates are 0',
        ),
        (text, 'STRUCTURE = 1', 'STRUCTURE must be an sma_sim.Structure'),
    ):
        (tmp_path / 'own.py').write_text(text.replace(before, after))
        assert before in text
        with pytest.raises(StructureError, match=words):
            find_structures([tmp_path])


def test_a_name_that_no_file_declares_is_told(tmp_path):
    (tmp_path / 'own.py').write_text('THING = 1\n')
    with pytest.raises(
        UserError, match=rf"system = 'own' \(.*; no STRUCTURE in {tmp_path} has this name\): expected one of"
    ):
        read_config(words=[f'structures.paths={tmp_path}', 'system=own'])


def test_an_inertia_that_cannot_be_is_told():
    """Of a function that depends on parameters, when a model is made of it."""
    found = changed(name='light', inertia=lambda p: p.m - 0.1)
    with pytest.raises(UserError, match=r"structure 'light': its inertia in position is -0\.07 kg; expected more than 0"):
        inertia_of(found, found.default_constants)
    assert inertia_of(found, found.constants_of({**found.default_values, 'slider.m': 0.3}))


def test_data_do_not_say_which_structure_files_are_run(tmp_path):
    (tmp_path / 'rocker2.py').write_text((EXAMPLE / 'rocker.py').read_text().replace('rocker', 'rocker2'))
    recorded = {'system': 'rocker2', 'structures.paths': [str(tmp_path)]}
    with pytest.raises(UserError, match=r'the structure rocker2 is needed, but only data name its folder'):
        read_config(recorded=recorded)
    named = read_config(words=[f'structures.paths={tmp_path}'], recorded={'system': 'rocker2'})
    assert named.system == 'rocker2' and named.parameters['rocker2.k'] == 50.0


def rocker_below(folder):
    """The example in a folder of its own."""
    (folder / 'parts').mkdir()
    (folder / 'parts' / 'rocker.py').write_text((EXAMPLE / 'rocker.py').read_text())


def test_what_was_read_before_says_nothing_of_a_recording():
    """Of an own structure: its channels are no others', and stand behind none of theirs."""
    find_structures([EXAMPLE])
    run, rest = np.arange(3.0), wire_input([0.0, 2.0], [0.0, 0.01])
    with pytest.raises(UserError, match="no channel 'angle'; it may have stress, "):
        Recording('pulled', 'wire', run, {'angle': run}, rest)
    assert in_order({'T', 'strain', 'angle', 'stress'}, 'wire') == ['stress', 'T', 'strain']


def test_files_that_are_written_elsewhere_find_the_structure(tmp_path, monkeypatch):
    """Its folder was given relative to the working directory, then to a file; each new file is to be read from anywhere."""
    rocker_below(tmp_path)
    (tmp_path / 'c.csv').write_text('time_s,J_eq_W\n0,0\n1,1.2\n4,-1\n6,0\n8,0\n')
    monkeypatch.chdir(tmp_path)
    for folder in ('first', 'second/below', 'third'):
        (tmp_path / folder).mkdir(parents=True)
    words = ['--set', 'structures.paths=parts', '--system', 'rocker', '--set', 'rocker.k=55']
    assert main(['init', '--out', 'first/robot.yaml', '--no-questions', *words]) == 0
    assert main(['add', 'slack', '--config', 'first/robot.yaml', '-o', 'second/below/robot.yaml']) == 0
    assert main(['simulate', '--config', 'first/robot.yaml', '--input', 'c.csv', '--out', 'run.csv', '--rate', '10']) == 0
    noise = [word for name in ('angle=1e-3', 'F_1=0.1', 'F_2=0.1', 'T_1=1', 'T_2=1') for word in ('--noise', name)]
    fit = ['fit', 'run.csv', '--config', 'first/robot.yaml', '--free', 'rocker.k', '--starts', '1', '--model', 'hybrid']
    assert main([*fit, *noise, '-o', 'third/fitted.yaml']) == 0
    monkeypatch.chdir('/')
    for file in ('first/robot.yaml', 'second/below/robot.yaml', 'third/fitted.yaml'):
        config = read_config(tmp_path / file)
        assert config.system == 'rocker' and abs(config.parameters['rocker.k'] - 55.0) < 0.5, file
    assert "paths: ['../../parts']" in (tmp_path / 'second/below/robot.yaml').read_text()


def test_a_session_finds_the_structure(tmp_path, monkeypatch):
    """Also after the session was moved, and in files that it gives away."""
    rocker_below(tmp_path)
    monkeypatch.chdir(tmp_path)
    start = Start(words=('structures.paths=parts', 'system=rocker'))
    with open_session(Path('s'), start) as session:
        session.change({'rocker.k': 55.0})
        text = Application(session, [], lambda *_: None).version_file('parameters.yaml', 2)[1]
    (tmp_path / 'downloads').mkdir()
    (tmp_path / 'downloads' / 'parameters.yaml').write_bytes(text)
    shutil.move(tmp_path / 's', tmp_path / 'deep' / 'er')
    with open_session(tmp_path / 'deep' / 'er', Start(words=('structures.paths=parts',))) as session:
        assert session.current.number == 2 and session.config().parameters['rocker.k'] == 55.0
        assert session.undo().number == 1 and session.config().system == 'rocker'
        write_version(session, session.version(2), tmp_path / 'downloads' / 'exported.yaml')
    monkeypatch.chdir('/')
    for name in ('parameters.yaml', 'exported.yaml'):
        assert read_config(tmp_path / 'downloads' / name).parameters['rocker.k'] == 55.0
