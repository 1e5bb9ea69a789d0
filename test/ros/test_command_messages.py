"""What the command line says of a mistake, and the help that it gives."""

import shlex

import pytest

import sma_sim
from sma_sim.cli.common.commands import COMMANDS, print_notes
from sma_sim.cli.main import main, parser_for


def told(capsys, words):
    """Exit code, and the last line on stderr."""
    try:
        code = main(shlex.split(words))
    except SystemExit as end:
        code = end.code
    return code, capsys.readouterr().err.strip().splitlines()[-1]


@pytest.fixture
def files(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'command.csv').write_text('time_s,J_eq_W\n0,0\n5,0\n')
    (tmp_path / 'german.csv').write_text('time_s;J_eq_W\n0;0\n5;1,234\n')
    (tmp_path / 'broken.yaml').write_text('wire:\n  E_A: [1.0\nbeam: 2\n')
    (tmp_path / 'run.csv').write_text('time_s,J_eq_W,alpha_rad\n' + ''.join(f'{k},0,{1e-3 * (k % 3)}\n' for k in range(20)))


@pytest.mark.parametrize(
    ('words', 'cure'),
    [
        ('simulat', 'did you mean simulate'),
        ('simulate --input command.csv --out a.csv --sytem wire', 'did you mean --system'),
        ('simulate --input command.csv --out a.csv --kinetics hybird', 'did you mean hybrid'),
        ('init mine.yaml', 'unrecognized arguments: mine.yaml; the file that is written is named by --out FILE'),
        ('fit --hold-out run3 runs', '--hold-out takes all names after it: give DATA before it'),
        ('simulate --input command.csv --out a.csv --set beam.e', 'such as --set beam.E=VALUE'),
        ('simulate --input command.csv --out a.csv --set beam.e=2e9', 'did you mean beam.E?'),
        ('simulate --input german.csv --out a.csv', 'a decimal comma or a separator of thousands'),
        (
            'simulate --input command.csv --out a.csv --config broken.yaml',
            'broken.yaml is not YAML: line 3, column 5: ',
        ),
        (
            'next run.csv --noise alpha=1e-3 --parameters beam.e',
            'beam.e: not fitted here; did you mean beam.E?',
        ),
        ('next run.csv --noise alpha=1e-3 --between gravty nothing', 'did you mean gravity'),
    ],
)
def test_a_mistake_is_said_in_a_line_with_its_cure(files, capsys, tmp_path, words, cure):
    code, line = told(capsys, words)
    assert code == 2 and cure in line, line
    assert not (tmp_path / 'a.csv').exists()


def test_the_version(capsys):
    with pytest.raises(SystemExit) as end:
        main(['--version'])
    assert end.value.code == 0 and capsys.readouterr().out == f'sma-sim {sma_sim.__version__}\n'


@pytest.mark.parametrize('verb', COMMANDS)
def test_every_command_has_an_example_that_it_takes(verb, capsys):
    words = shlex.split(COMMANDS[verb].example)
    assert words[:2] == ['sma-sim', verb] and parser_for(words[1:]).parse_args(words[1:]).verb == verb
    with pytest.raises(SystemExit):
        main([verb, '--help'])
    assert ' '.join(words) in ' '.join(capsys.readouterr().out.split())


def test_the_help_says_what_the_kinetics_are(capsys):
    with pytest.raises(SystemExit):
        main(['--help'])
    shown = ' '.join(capsys.readouterr().out.split())
    assert 'hybrid switches a wire between five modes' in shown and 'mas lets it transform at a rate' in shown


def test_both_names_of_the_kinetics_are_options():
    for option in ('--model', '--kinetics'):
        assert parser_for(['simulate']).parse_args(['simulate', '--input', 'a', '--out', 'b', option, 'mas']).model == 'mas'


def test_no_run_has_more_than_five_lines_of_notes(capsys):
    for count in (0, 5, 6, 40):
        print_notes(f'remark {k}' for k in range(count))
        lines = capsys.readouterr().err.splitlines()
        assert len(lines) == min(count, 5) and all(line.startswith('note: ') for line in lines)
        assert count < 6 or lines[-1] == f'note: and {count - 4} more notes'
