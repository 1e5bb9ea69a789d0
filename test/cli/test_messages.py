"""What a person reads after a mistake: what was given, what is expected, where to change it; exit code 2, no traceback."""

import errno
import math
import os
import signal
import subprocess
import sys
import warnings
from pathlib import Path

import pytest

from sma_sim import find_effects
from sma_sim.cli.main import main, physics_in_notes
from sma_sim.evidence.data.tables import write_whole
from sma_sim.model.errors import PhysicsWarning, UserError
from sma_sim.model.program_parameters import DEFAULTS


@pytest.fixture
def step(tmp_path):
    file = tmp_path / 'step.csv'
    file.write_text('time_s,J_eq_W\n0,0\n1,10\n2,0\n')
    return file


@pytest.fixture
def complaint(tmp_path, step, capsys):
    """Run `simulate` with words that are wrong; what it says on stderr."""

    def run(*words, source=step, out=tmp_path / 'out.csv'):
        code = main(['simulate', '--input', str(source), '--out', str(out), *words])
        lines = capsys.readouterr().err.splitlines(keepends=True)
        said = ''.join(line for line in lines if not line.startswith(('compiling the equations', 'compiled in ')))
        assert code == 2 and said.startswith('sma-sim simulate: ') and 'Traceback' not in said, said
        assert not (tmp_path / 'out.csv').exists() and not list(tmp_path.glob('.*.part'))
        return said

    return run


def unit_of(name):
    """What follows a number: nothing where it has no unit."""
    return '' if DEFAULTS[name].unit == '-' else f' {DEFAULTS[name].unit}'


def in_unit(name):
    return f' in{unit_of(name)}' if unit_of(name) else ''


@pytest.mark.parametrize('name', DEFAULTS)
def test_range_of_every_parameter(complaint, name):
    low, high = DEFAULTS[name].bounds
    unit = unit_of(name)
    for value in (2.0 * high + 1.0, low - 1.0 - abs(low)):
        said = complaint('--set', f'{name}={value}')
        assert f'{name} = {value:g}{unit} (on the command line): expected {low:g} to {high:g}{unit}\n' in said
    assert f"{name} = 'much' (on the command line): expected a number{in_unit(name)}" in complaint('--set', f'{name}=much')
    if not math.isnan(DEFAULTS[name].default):
        assert f'{name} = nan{unit} (' in complaint('--set', f'{name}=nan')


@pytest.mark.parametrize('name', DEFAULTS)
@pytest.mark.parametrize('value', ['true', 'text', '[1, 2]', "'12e9'", 'null'])
def test_type_of_every_parameter_in_yaml(complaint, tmp_path, name, value):
    group, key = name.split('.')
    file = tmp_path / 'robot.yaml'
    file.write_text(f'/**:\n  ros__parameters:\n    {group}:\n      {key}: {value}\n')
    said = complaint('--config', str(file))
    assert f'{name} = ' in said and f'(in {file}): expected a number{in_unit(name)}' in said
    if '12e9' in value:
        assert 'write 1.2e+10 without quotes' in said


@pytest.mark.parametrize(
    ('words', 'message'),
    [
        (['--set', 'wire.E_X=1'], 'unknown parameter wire.E_X (on the command line); did you mean wire.E_'),
        (['--set', 'E_A=1'], 'unknown parameter E_A (on the command line); did you mean wire.E_A'),
        (['--set', 'nothing.like.it=1'], 'unknown parameter nothing.like.it (on the command line)'),
        (['--set', 'wire.E_A'], '--set wire.E_A: expected name=value'),
        (['--set', 'model=mass'], "model = 'mass' (on the command line): expected one of hybrid, mas"),
        (
            ['--set', 'system=robot'],
            "system = 'robot' (on the command line): expected one of coil, lever, module, slider, spatial, stack, wire",
        ),
        (['--effect', 'gravitation'], 'unknown effect gravitation (effects.active, on the command line); did you mean'),
        (['--effect', 'gravity:g_z=1'], 'unknown parameter effects.gravity.g_z'),
        (['--effect', 'gravity:g_y'], "expected name:parameter=value,..., got 'g_y'"),
        (['--effect', 'gravity:g_y=1000'], 'effects.gravity.g_y = 1000 m/s^2 (on the command line): expected -50 to 50'),
        (['--set', 'effects.active=gravity,gravity'], 'effects.active (on the command line): gravity is there twice'),
        (['--set', 'effects.paths=/nowhere/at/all'], 'effects.paths: /nowhere/at/all is not a folder'),
        (['--config', '/nowhere.yaml'], 'cannot read /nowhere.yaml: No such file'),
        (['--config', '/'], 'cannot read /: Is a directory'),
        (['--rate', '0'], '--rate 0: expected more than 0'),
        (['--rate', 'nan'], '--rate nan: expected more than 0'),
        (['--integration-rate', '0.5'], '--integration-rate 0.5: expected 1 to 1e5'),
        (['--integration-rate', '1000', '--rate', '300'], '300 samples per second do not divide 1000 steps per second'),
        (['--integration-rate', '1000', '--interpolation', 'linear'], '--integration-rate needs --interpolation hold'),
        (['--set', 'beam.L=0.05'], 'at rest: check wire.l0 = 0.0957 m against beam.L = 0.05 m'),
        (['--system', 'wire'], 'has no column strain'),
    ],
)
def test_wrong_words(complaint, words, message):
    assert message in complaint(*words)


@pytest.mark.parametrize(
    ('content', 'message'),
    [
        ('wire: [1, 2', 'is not YAML'),
        ('- 1\n- 2\n', 'expected a mapping of parameters, got list'),
        ('/**:\n  ros__parameters: 3\n', 'expected a mapping below ros__parameters, got int'),
        ('/**:\n  ros__parameter:\n    model: mas\n', 'expected ros__parameters below it, got ros__parameter'),
        ('wire:\n  E_a: 1.0e9\n', 'unknown parameter wire.E_a'),
        ('effects:\n  active: [1, 2]\n', 'effects.active = [1, 2]'),
        ('effects:\n  active: 3\n', 'expected a list of names'),
        ('effects:\n  paths: [missing]\n', 'missing is not a folder'),
    ],
)
def test_wrong_yaml(complaint, tmp_path, content, message):
    file = tmp_path / 'robot.yaml'
    file.write_text(content)
    said = complaint('--config', str(file))
    assert message in said and ('robot.yaml' in said or 'missing' in said)


@pytest.mark.parametrize(
    ('content', 'message'),
    [
        ('', 'is empty: expected a header and at least one row'),
        ('time_s,J_eq_W\n', 'has a header but no rows'),
        ('time_s,J_eq_W\n0,1\n', 'expected at least two rows'),
        ('time_s,J_eq\n0,1\n1,1\n', 'has no column J_eq_W (rename J_eq; the unit is part of the name)'),
        (
            'time_ms,J_eq_W\n0,1\n1,1\n',
            'time_ms is in ms: expected time_s, which is time_ms multiplied by 0.001',
        ),
        ('a;b\n0;1\n', 'has no column time_s, J_eq_W; its columns are a, b'),
        ('time_s,J_eq_W,J_eq_W\n0,1,1\n1,1,1\n', 'has column J_eq_W more than once'),
        ('time_s,J_eq_W\n0,1\n1,nan\n', "row 3, column J_eq_W: expected a number, got 'nan'"),
        ('time_s,J_eq_W\n0,1\n1,inf\n', "row 3, column J_eq_W: expected a number, got 'inf'"),
        ('time_s,J_eq_W\n0,1\n1,\n', "row 3, column J_eq_W: expected a number, got 'nothing'"),
        ('time_s,J_eq_W\n0,1\n1\n', "row 3, column J_eq_W: expected a number, got 'nothing'"),
        ('time_s,J_eq_W\n0,1\n1,hot\n', "row 3, column J_eq_W: expected a number, got 'hot'"),
        ('time_s,J_eq_W\n0,1\n2,1\n1,0\n', 'row 4, column time_s: expected more than 2 s of the row before, got 1 s'),
        ('time_s,J_eq_W\n0,1\n0,1\n', 'row 3, column time_s: expected more than 0 s'),
        ('time_s,J_eq_W,T_E_K\n0,1,-25\n1,1,25\n', 'column T_E_K: expected kelvin between 150 and 2000, got -25'),
    ],
)
def test_wrong_input_files(complaint, tmp_path, content, message):
    file = tmp_path / 'input.csv'
    file.write_text(content)
    said = complaint(source=file)
    assert str(file) in said and message in said


@pytest.mark.parametrize(
    ('content', 'message'),
    [
        ('time_s,strain,J_W\n0,0.01,-1\n1,0.02,0\n', 'column J_W: heating cannot be negative, got -1 W'),
        ('time_s,strain\n0,1\n1,5\n', 'column strain: expected a fraction such as 0.05, got 5'),
    ],
)
def test_wrong_wire_files(complaint, tmp_path, content, message):
    file = tmp_path / 'wire.csv'
    file.write_text(content)
    assert message in complaint('--system', 'wire', source=file)


def test_wrong_paths(complaint, tmp_path):
    assert 'No such file' in complaint(source=tmp_path / 'missing.csv')
    assert 'Is a directory' in complaint(source=tmp_path)
    binary = tmp_path / 'binary.csv'
    binary.write_bytes(bytes(range(256)))
    assert 'is not a CSV file' in complaint(source=binary)
    assert 'cannot write' in complaint(out=tmp_path / 'no' / 'folder.csv')
    assert 'cannot write' in complaint('--jumps', str(tmp_path / 'no' / 'jumps.csv'), out=tmp_path / 'second.csv')


def test_what_is_no_file_is_written_to(complaint, step, tmp_path):
    """To replace /dev/null by a file would break it for every program."""
    full, pipe, link = tmp_path / 'full.csv', tmp_path / 'pipe.csv', tmp_path / 'link.csv'
    full.symlink_to('/dev/full')
    assert 'No space left' in complaint(out=full)
    assert full.is_symlink()
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    assert main(['simulate', '--input', str(step), '--out', str(pipe)]) == 0
    assert os.read(reader, 7) == b'time_s,' and pipe.is_fifo()
    os.close(reader)
    (tmp_path / 'target.csv').write_text('old')
    link.symlink_to('target.csv')
    assert main(['simulate', '--input', str(step), '--out', str(link)]) == 0
    assert link.is_symlink() and (tmp_path / 'target.csv').read_text().startswith('time_s,')


@pytest.mark.parametrize(
    ('output', 'code', 'words'), [('>&-', 0, ''), ('> /dev/full', 2, 'cannot write the output: No space left on device')]
)
def test_an_output_that_takes_nothing(output, code, words):
    command = f'"{sys.executable}" -m sma_sim.cli.main systems {output}'
    done = subprocess.run(['bash', '-c', command], capture_output=True, text=True, timeout=300)
    assert done.returncode == code and words in done.stderr and 'Traceback' not in done.stderr, done.stderr
    assert bool(done.stderr) == bool(words)


def test_full_disk(complaint, step):
    """Nothing half-written stays; /dev/full has no room for a single byte."""
    import sma_sim.evidence.data.tables as tables

    with pytest.raises(tables.UserError, match='cannot write .*full'):
        tables.write_whole(step.parent / 'full', lambda file: (_ for _ in ()).throw(OSError(28, 'No space left on device')))
    assert not list(step.parent.glob('.*.part'))


def test_a_disk_that_has_become_read_only(tmp_path, monkeypatch):
    """As an SD card does; not even a removal is allowed then, and a guard that saves its counters goes on."""

    def refuse(*words, **named):
        raise OSError(errno.EROFS, 'Read-only file system')

    for name in ('open', 'unlink', 'replace'):
        monkeypatch.setattr(Path, name, refuse)
    with pytest.raises(UserError, match='cannot write .*: Read-only file system'):
        write_whole(tmp_path / 'counters.json', lambda file: file.write('{}'))


OWN = """
from sma_sim import Effect, Parameter
EFFECT = Effect(name='own', port='{port}', equation='-', source='-', kernel={kernel},
                parameters=(Parameter('a', 1.0, 'W', (0.0, 9.0), 'size', '', 0.0, (0.1, 1.0)),))
"""


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        ('def broken(:\n', 'own.py cannot be loaded: SyntaxError'),
        ('import nothing_like_it\n', 'own.py cannot be loaded: ModuleNotFoundError'),
        ('EFFECT = 3\n', 'own.py: EFFECT must be an sma_sim.Effect, got int'),
        (OWN.format(port='wire_heating', kernel='lambda s, w, p: p.a'), "port 'wire_heating'; expected one of actuation"),
        (OWN.format(port='wire_heat', kernel='lambda s, w, p: p.b'), "effect 'own': its value fails: AttributeError"),
        (OWN.format(port='wire_heat', kernel='lambda s, w, p: s.heat'), "has no attribute 'heat'"),
        (OWN.format(port='structure_force', kernel='lambda s, w, p: (p.a, p.a)'), 'returns 2 numbers, port structure_force'),
        (OWN.format(port='wire_heat', kernel='lambda s, w, p: float(str(p.a))'), 'its value cannot be compiled: '),
        (OWN.format(port='wire_heat', kernel='lambda s, w, p: p.a').replace("'own'", "'gravity'"), 'exists already'),
        ('x = 1\n', 'unknown effect own'),
    ],
)
def test_wrong_effect_files(complaint, tmp_path, text, message):
    folder = tmp_path / 'effects'
    folder.mkdir()
    (folder / 'own.py').write_text(text)
    assert message in complaint('--set', f'effects.paths={folder}', '--effect', 'own')


def test_an_edit_within_a_second_is_seen(tmp_path, monkeypatch):
    """Of a helper module that keeps its length: bytecode would be taken for that of the edited file."""
    monkeypatch.setattr(sys, 'dont_write_bytecode', False)
    (tmp_path / 'own.py').write_text('import quick_helper\n' + OWN.format(port='wire_heat', kernel='quick_helper.heat'))
    for factor in range(1, 6):
        (tmp_path / 'quick_helper.py').write_text(f'def heat(s, w, p):\n    return {factor}.0\n')
        os.utime(tmp_path / 'quick_helper.py', (1e9, 1e9))
        assert find_effects([tmp_path])['own'].kernel(None, None, None) == factor


def test_helpers_of_one_name_belong_to_their_folders(tmp_path):
    """Two folders in one process, each with a helper module of the same name."""
    for name, factor in (('one', 1.0), ('two', 2.0)):
        (tmp_path / name).mkdir()
        (tmp_path / name / 'shared_name.py').write_text(f'FACTOR = {factor}\n')
        text = OWN.format(port='wire_heat', kernel='lambda s, w, p: shared_name.FACTOR').replace("'own'", f"'{name}'")
        (tmp_path / name / f'{name}.py').write_text('import shared_name\n' + text)
    found = find_effects([tmp_path / 'one', tmp_path / 'two'])
    assert [found[name].kernel(None, None, None) for name in ('one', 'two')] == [1.0, 2.0]


def test_edited_effect_takes_effect(step, tmp_path):
    """Also through a helper module, and within the same second."""
    folder = tmp_path / 'effects'
    folder.mkdir()
    text = OWN.format(port='wire_heat', kernel='lambda s, w, p: own_helper.heat(p.a)')
    (folder / 'own.py').write_text('import own_helper\n' + text)
    hottest = []
    for factor in (0.0, 0.01, 0.02):
        (folder / 'own_helper.py').write_text(f'def heat(a):\n    return {factor} * a\n')
        out = tmp_path / 'run.csv'
        words = ['--set', f'effects.paths={folder}', '--effect', 'own']
        assert main(['simulate', '--input', str(step), '--out', str(out), *words]) == 0
        hottest.append(max(float(line.split(',')[8]) for line in out.read_text().splitlines()[1:]))
    assert hottest[0] + 0.01 < hottest[1] < hottest[2] - 0.01


def test_unknown_effect_to_list(capsys):
    assert main(['effects', 'gravty']) == 2
    assert 'did you mean gravity' in capsys.readouterr().err


def test_ctrl_c_while_python_imports(monkeypatch, capsys):
    def interrupted(name):
        raise KeyboardInterrupt

    monkeypatch.setattr('sma_sim.cli.main.import_module', interrupted)
    assert main(['effects']) == 130
    assert capsys.readouterr().err == 'sma-sim: stopped\n'


def test_ctrl_c_after_all_is_done_changes_nothing(monkeypatch):
    before = signal.getsignal(signal.SIGINT)
    monkeypatch.setattr(sys, 'argv', ['sma-sim', 'effects'])
    try:
        assert main() == 0 and signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)


def test_a_warning_about_physics_is_a_note(capsys):
    with pytest.warns(UserWarning, match='of something else'), physics_in_notes():
        warnings.warn('of something else', UserWarning, stacklevel=1)
    with physics_in_notes():
        warnings.warn('a wire melts', PhysicsWarning, stacklevel=1)
    assert capsys.readouterr().err == 'note: a wire melts\n'
