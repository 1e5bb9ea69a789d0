"""The offline part has nothing that exists on POSIX systems only, and no command of it needs ROS."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

from sma_sim.cli.common.commands import COMMANDS

ROOT = Path(__file__).resolve().parents[2]
OFFLINE = [file for file in sorted((ROOT / 'sma_sim').rglob('*.py')) if 'ros' not in file.relative_to(ROOT).parts]
POSIX_MODULES = {'fcntl', 'grp', 'posix', 'pty', 'pwd', 'readline', 'resource', 'syslog', 'termios', 'tty'}
POSIX_CALLS = {
    'os': {
        'chown',
        'fchmod',
        'fork',
        'forkpty',
        'getegid',
        'geteuid',
        'getgid',
        'getloadavg',
        'getpgid',
        'getpriority',
        'getuid',
        'killpg',
        'mkfifo',
        'nice',
        'rename',
        'sched_getaffinity',
        'setpgid',
        'setsid',
        'sysconf',
        'uname',
        'wait',
        'waitpid',
    },
    'signal': {
        'SIGALRM',
        'SIGCHLD',
        'SIGHUP',
        'SIGKILL',
        'SIGPIPE',
        'SIGQUIT',
        'SIGUSR1',
        'SIGUSR2',
        'alarm',
        'pause',
        'setitimer',
        'sigwait',
    },
}
TEXT_FILES = {'open', 'read_text', 'write_text', 'fdopen', 'NamedTemporaryFile', 'TextIOWrapper'}
START_METHODS = {'fork', 'forkserver'}
POSIX_PATHS = ('/tmp', '/dev/', '/proc/', '/var/', '/etc/', '/usr/')
# `sma-sim` as on a computer without ROS and without the modules of POSIX systems.
PROGRAM = """
import sys
class Missing:
    def find_spec(self, name, path=None, target=None):
        if name.split('.')[0] in {missing}:
            raise ModuleNotFoundError(f'No module named {{name!r}}', name=name)
for name in {missing}:
    sys.modules.pop(name, None)
sys.meta_path.insert(0, Missing())
from sma_sim.cli.main import main
for words in {lines}:
    try:
        code = main(words)
    except SystemExit as end:
        code = end.code
    assert code == 0, (words, code)
print('rclpy' in sys.modules)
"""


def keywords(call):
    return {keyword.arg: keyword.value for keyword in call.keywords}


def is_binary(call):
    modes = [*call.args, *keywords(call).values()]
    texts = {node.value for node in modes if isinstance(node, ast.Constant) and isinstance(node.value, str)}
    return any('b' in text and set(text) <= set('rwxab+') for text in texts)


def unportable(tree):
    """What a file does that is different or absent elsewhere: line and reason."""
    for node in ast.walk(tree):
        names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
        names += [node.module or ''] if isinstance(node, ast.ImportFrom) else []
        yield from ((node.lineno, f'imports {name}') for name in names if name.split('.')[0] in POSIX_MODULES)
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            if node.attr in POSIX_CALLS.get(node.value.id, ()):
                yield node.lineno, f'{node.value.id}.{node.attr}'
        elif isinstance(node, ast.ImportFrom) and node.module in POSIX_CALLS:
            yield from ((node.lineno, alias.name) for alias in node.names if alias.name in POSIX_CALLS[node.module])
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            if node.value.startswith(POSIX_PATHS) or node.value in START_METHODS:
                yield node.lineno, f'{node.value!r}'
        elif isinstance(node, ast.Call):
            yield from unportable_call(node)


def unportable_call(node):
    """Text files without an encoding have that of the system; a command line of a shell is that shell's."""
    function = node.func
    name = function.attr if isinstance(function, ast.Attribute) else getattr(function, 'id', '')
    of_os = isinstance(function, ast.Attribute) and isinstance(function.value, ast.Name) and function.value.id == 'os'
    given = keywords(node)
    if name in TEXT_FILES and 'encoding' not in given and not is_binary(node) and not (of_os and name == 'open'):
        positional = name == 'read_text' and node.args or name == 'write_text' and len(node.args) > 1
        if not positional and not (name == 'NamedTemporaryFile' and 'mode' not in given):
            yield node.lineno, f'{name} without an encoding'
    if getattr(given.get('shell'), 'value', False):
        yield node.lineno, 'shell=True'


def test_nothing_is_of_posix_systems_only():
    assert len(OFFLINE) > 150
    found = [f'{file}:{line}: {what}' for file in OFFLINE for line, what in unportable(ast.parse(file.read_text('utf-8')))]
    assert found == []


@pytest.mark.parametrize(
    'line',
    [
        'import fcntl',
        'from pwd import getpwnam',
        'os.getuid()',
        'from os import fork',
        'signal.SIGKILL',
        'x = "/tmp/a"',
        'open(a)',
        'open(a, "w")',
        'a.read_text()',
        'a.write_text(b)',
        'get_context("fork")',
        'os.rename(a, b)',
        'run(a, shell=True)',
    ],
)
def test_the_check_sees(line):
    assert list(unportable(ast.parse(line)))


@pytest.mark.parametrize('line', ['a.open("rb")', 'open(a, encoding="utf-8")', 'os.open(a, os.O_RDONLY)', 'signal.SIGINT'])
def test_the_check_leaves(line):
    assert not list(unportable(ast.parse(line)))


def run_without_ros(folder, lines):
    missing = sorted(POSIX_MODULES - {'posix'} | {'rclpy', 'std_msgs', 'sensor_msgs', 'rosbag2_py'})
    program = PROGRAM.format(missing=missing, lines=lines)
    return subprocess.run([sys.executable, '-c', program], cwd=folder, capture_output=True, text=True)


def test_help_of_every_command_without_ros(tmp_path):
    done = run_without_ros(tmp_path, [['--help'], *([verb, '--help'] for verb in COMMANDS)])
    assert done.returncode == 0 and done.stdout.splitlines()[-1] == 'False', done.stderr
    assert all(f'usage: sma-sim {verb}' in done.stdout for verb in COMMANDS)


def test_commands_without_ros(tmp_path):
    (tmp_path / 'step.csv').write_text('time_s,J_eq_W\n0,0\n1,10\n2,0\n', encoding='utf-8')
    done = run_without_ros(
        tmp_path,
        [
            ['effects'],
            ['simulate', '--input', 'step.csv', '--out', 'run.csv'],
            ['simulate', '--input', 'step.csv', '--out', 'run.mcap', '--effect', 'gravity'],
            ['bag', 'info', 'run.mcap'],
            ['plot', 'run.csv', '--out', 'run.png'],
        ],
    )
    assert done.returncode == 0 and done.stdout.splitlines()[-1] == 'False', done.stderr
    assert {'run.csv', 'run.mcap', 'run.png'} <= {file.name for file in tmp_path.iterdir()}
