"""`sma-sim init`: flags, questions on a terminal, units, what makes no robot, and the file that comes out."""

import os
import pty
import select
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sma_sim.cli.init import in_unit, to_si, units_of
from sma_sim.cli.main import main
from sma_sim.model.config import Config, read_config
from sma_sim.model.errors import UserError
from sma_sim.model.parameter_file import parameter_file, yaml_number
from sma_sim.model.program_parameters import DEFAULTS

ROOT = Path(__file__).resolve().parents[2]
ANSWER = 300.0  # [s]; the first check ever compiles


def test_module_yaml_is_what_the_writer_writes():
    assert (ROOT / 'config' / 'module.yaml').read_text() == parameter_file(Config())


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_numbers_read_back_in_yaml(value):
    import yaml

    text = yaml_number(value)
    assert '.' in text and yaml.safe_load(text) == value == float(text)


@pytest.mark.parametrize(
    ('text', 'si', 'usual', 'expected'),
    [
        ('98 mm', 'm', 'mm', 0.098),
        ('98', 'm', 'mm', 0.098),
        ('0.2mm', 'm', 'mm', 2e-4),
        ('150 um', 'm', 'mm', 150e-6),
        ('150 µm', 'm', 'mm', 150e-6),
        ('25 degC', 'K', 'degC', 298.15),
        ('-5', 'K', 'degC', 268.15),
        ('300 K', 'K', 'degC', 300.0),
        ('25 °C', 'K', 'degC', 298.15),
        ('2.1 GPa', 'Pa', 'GPa', 2.1e9),
        ('1e1 g', 'kg', 'g', 0.01),
        ('12', '-', '', 12.0),
        ('.5 W', 'W', 'W', 0.5),
        ('380 J/(kg K)', 'J/(kg K)', 'J/(kg K)', 380.0),
    ],
)
def test_units(text, si, usual, expected):
    assert to_si(text, si, usual) == expected


@pytest.mark.parametrize('text', ['', 'mm', '98 inch', '9,8 mm', '98 mm mm', 'nan', 'inf', '25 degC', '0x10'])
def test_what_is_no_length(text):
    with pytest.raises(UserError):
        to_si(text, 'm', 'mm')


@pytest.mark.parametrize('si', ['m', 'kg', 'Pa', 'Pa/K', 'W', 'K', '-'])
def test_shown_values_read_back(si):
    for unit in units_of(si):
        assert to_si(in_unit(0.375, si, unit), si, unit) == pytest.approx(0.375, rel=1e-9)


def init(folder, *words):
    return main(['init', '--out', str(folder / 'robot.yaml'), *words])


def test_flags_give_a_file_that_simulates(tmp_path, capsys):
    assert (
        init(
            tmp_path,
            '--beam-length',
            '120 mm',
            '--wire-length',
            '11.5 cm',
            '--wire-diameter',
            '0.2',
            '--wires',
            '4',
            '--ambient',
            '25 degC',
            '--set',
            'beam.b_x=1.5',
            '--effect',
            'gravity:g_x=3',
        )
        == 0
    )
    said = capsys.readouterr()
    assert 'static equilibrium found' in said.err and 'strained by 4.' in said.err
    assert said.out.strip().endswith('robot.yaml')
    config = read_config(tmp_path / 'robot.yaml')
    wanted = {'beam.L': 0.12, 'wire.l0': 0.115, 'wire.r0': 1e-4, 'wire.n': 4.0, 'environment.T_E': 298.15, 'beam.b_x': 1.5}
    for name in DEFAULTS:
        if not name.startswith('initial.'):
            assert config.parameters[name] == wanted.get(name, DEFAULTS[name].default), name
    assert config.effects == read_config(effects=['gravity:g_x=3']).effects
    assert '[m] length of the beam; default 0.1\n' in (tmp_path / 'robot.yaml').read_text()
    command, out = tmp_path / 'in.csv', tmp_path / 'out.csv'
    command.write_text('time_s,J_eq_W\n0,5\n2,0\n')
    words = ['--config', str(tmp_path / 'robot.yaml'), '--input', str(command), '--out', str(out)]
    assert main(['simulate', *words]) == 0


def test_an_own_file_is_the_start_of_another(tmp_path):
    source = ROOT / 'examples' / 'own_effect' / 'robot.yaml'
    assert init(tmp_path, '--config', str(source), '--no-questions') == 0
    first, second = read_config(source), read_config(tmp_path / 'robot.yaml')
    assert [active.values for active in first.effects] == [one.values for one in second.effects] and first.effects
    assert {k: v for k, v in first.parameters.items() if v == v} == {k: v for k, v in second.parameters.items() if v == v}


@pytest.mark.parametrize(
    ('words', 'said'),
    [
        (['--wire-length', '1150'], 'strained by -90 %'),
        (['--wire-length', '120'], 'strained by'),
        (['--wire-length', '95 inch'], "unit 'inch'"),
        (['--beam-length', '0.1'], 'expected 1 mm to 10000 mm'),
        (['--ambient', 'warm'], 'not a number'),
        (['--wires', '0'], 'out of range'),
        (['--wire-length', '95', '--set', 'wire.l0=0.09'], 'say the same'),
        (['--set', 'wire.l=0.09'], 'did you mean'),
    ],
)
def test_what_makes_no_robot_leaves_no_file(tmp_path, capsys, words, said):
    assert init(tmp_path, *words) == 2
    assert said in capsys.readouterr().err and list(tmp_path.iterdir()) == []


def test_an_existing_file_stays_unless_told(tmp_path, capsys):
    (tmp_path / 'robot.yaml').write_text('mine')
    assert init(tmp_path, '--wires', '5') == 2
    assert '--overwrite' in capsys.readouterr().err and (tmp_path / 'robot.yaml').read_text() == 'mine'
    assert init(tmp_path, '--wires', '5', '--overwrite') == 0
    assert read_config(tmp_path / 'robot.yaml').parameters['wire.n'] == 5.0
    assert [file.name for file in tmp_path.iterdir()] == ['robot.yaml']


class Terminal:
    """`sma-sim init` on a terminal of its own."""

    def __init__(self, folder):
        self.keys, screen = pty.openpty()
        environment = os.environ | {'PYTHONPATH': str(ROOT)}
        self.process = subprocess.Popen(
            [sys.executable, '-m', 'sma_sim.cli.main', 'init'],
            cwd=folder,
            env=environment,
            stdin=screen,
            stdout=screen,
            stderr=screen,
            start_new_session=True,
        )
        os.close(screen)
        self.shown = ''

    def wait_for(self, words):
        """Read until the words have been shown since the last answer."""
        end = time.monotonic() + ANSWER
        while words not in self.shown:
            assert time.monotonic() < end, self.shown
            if not select.select([self.keys], [], [], 1.0)[0]:
                continue
            try:
                self.shown += os.read(self.keys, 4096).decode()
            except OSError as error:  # the other side closed
                raise AssertionError(self.shown) from error

    def answer(self, question, text):
        """Type an answer once the question, with its bracket, is there."""
        self.wait_for(f'{question} [')
        self.wait_for(']: ')
        self.shown = ''
        os.write(self.keys, f'{text}\n'.encode())

    def close(self):
        self.process.kill()
        self.process.wait()
        os.close(self.keys)


@pytest.fixture
def terminal(tmp_path):
    one = Terminal(tmp_path)
    yield one
    one.close()


REST = (
    'diameter of the beam',
    "Young's modulus of the beam",
    'distance of the two bundles at the plate',
    'mass of the plate',
    'wires in one bundle',
    'diameter of one wire',
)


def test_questions_on_a_terminal(terminal, tmp_path):
    terminal.answer('length of the beam', '12 parsec')
    terminal.wait_for("unit 'parsec' is not known here: expected m, mm, um, cm")
    terminal.answer('length of the beam', '0.0001')
    terminal.wait_for('out of range: expected 1 mm to 10000 mm')
    terminal.answer('length of the beam', '120')
    for question in REST:
        terminal.answer(question, '')
    terminal.answer('length of a wire when hot and unloaded', '130 mm')
    terminal.answer('ambient temperature', '21 degC')
    terminal.answer('largest heating power of one bundle', '')
    terminal.wait_for('This robot cannot be simulated: a wire is strained by')
    terminal.answer('length of the beam', '')
    for question in REST:
        terminal.answer(question, '')
    terminal.answer('length of a wire when hot and unloaded', '11.5 cm')
    terminal.answer('ambient temperature', '')
    terminal.answer('largest heating power of one bundle', '20')
    terminal.wait_for('static equilibrium found')
    terminal.wait_for('robot.yaml')
    assert terminal.process.wait(30) == 0
    values = read_config(tmp_path / 'robot.yaml').parameters
    wanted = {'beam.L': 0.12, 'wire.l0': 0.115, 'environment.T_E': 294.15, 'node.J_max': 20.0}
    expected = {name: parameter.default for name, parameter in DEFAULTS.items()} | wanted
    assert all(values[name] == expected[name] for name in DEFAULTS if not name.startswith('initial.'))


@pytest.mark.parametrize(('key', 'code', 'said'), [(b'\x04', 2, 'nothing was written'), (b'\x03', 130, 'stopped')])
def test_giving_up_writes_nothing(terminal, tmp_path, key, code, said):
    terminal.answer('length of the beam', '')
    terminal.wait_for('diameter of the beam [')
    if key == b'\x03':
        end = time.monotonic() + ANSWER
        while terminal.process.poll() is None and time.monotonic() < end:  # one just before the read begins is lost
            terminal.process.send_signal(signal.SIGINT)
            time.sleep(2.0)
    else:
        os.write(terminal.keys, key)
    terminal.wait_for(said)
    assert terminal.process.wait(30) == code and list(tmp_path.iterdir()) == []
