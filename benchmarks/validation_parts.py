"""The parts of the validation: which script measures them, and how their results become tables."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from calibration import table as calibration_rows
from cases import of
from challenges import is_detectable, is_right
from designs import summary as design_rows
from equations import table as equation_rows
from invariance import table as invariance_rows
from laplace import table as laplace_rows
from latent import table as latent_table
from nitinol import rows as wire_rows
from other_forms import table as other_form_rows
from recovery import table as recovery_rows

Case = dict[str, Any]


def cell(value: Any) -> str:
    """A value of a table."""
    if isinstance(value, Mapping):
        return ', '.join(f'{name} {cell(entry)}' for name, entry in value.items())
    if isinstance(value, list | tuple):
        return ', '.join(map(cell, value))
    return f'{value:.3g}' if isinstance(value, float) else f'{value}'


def heading(name: str) -> str:
    """The heading of a column of a script's numbers; names with a unit stay."""
    return name if '[' in name else name.replace('_', ' ')


def rows(head: Sequence[str], lines: Iterable[Sequence[Any]]) -> str:
    """A table in Markdown."""
    cells = [head, ['---'] * len(head), *(list(map(cell, line)) for line in lines)]
    return '\n'.join(f'| {" | ".join(line)} |' for line in cells)


def grids(result: Mapping[str, Any]) -> str:
    """A table for each group of numbers that a script reports."""
    text, single = [], {}
    for name, group in result.items():
        if name == 'machine':
            continue
        if isinstance(group, Mapping) and any(isinstance(row, Mapping) for row in group.values()):
            columns = list(dict.fromkeys(key for row in group.values() for key in row))
            lines = ([key, *(row.get(column, '') for column in columns)] for key, row in group.items())
            text.append(rows([name, *map(heading, columns)], lines))
        elif isinstance(group, Mapping):
            text.append(rows([name, ''], ([key.replace('_', ' '), value] for key, value in group.items())))
        else:
            single[name] = group
    return '\n\n'.join([*([rows(list(single), [list(single.values())])] if single else []), *text])


def challenge_tables(results: list[Case]) -> str:
    """Hit rates by part and channels, then every case."""
    results = [case for case in results if 'failed' not in case]
    counts = []
    for channels in ('forces', 'pose'):
        own = [case for case in results if case['case'][3] == (channels == 'forces')]
        counts += [[f'{name}, {channels}', of(*numbers)] for name, numbers in hit_rates(own) if numbers[1]]
    cases = [
        [part, ', '.join(hidden) or '-', seed, 'forces' if forces else 'pose', case['bare'], case['last'],
         f'`{case["verdict"]}`', ', '.join(case['effects']), ', '.join(case['alike'])]
        for case in results for part, hidden, seed, forces in [case['case']]
    ]  # fmt: skip
    head = ['', 'hidden', 'seed', 'recorded', 'error without', 'with', 'verdict', 'effects', 'indistinguishable']
    return rows(['', 'as it should be'], counts) + '\n\nEvery case:\n\n' + rows(head, cases)


def hit_rates(results: list[Case]) -> list[tuple[str, tuple[int, int]]]:
    """What should be counted, how often it is so, and of how many."""

    def part(name: str) -> list[Case]:
        return [case for case in results if case['case'][0] == name]

    seen = [case for case in part('library') if is_detectable(case)]
    unseen = [case for case in part('library') if not is_detectable(case)]
    outside = [case for case in part('outside') if is_detectable(case)]
    pairs = part('pairs')
    return [
        ('one effect, detectable: right one first', (sum(map(is_right, seen)), len(seen))),
        (
            'one effect, not detectable: none or the right one',
            (sum(not c['effects'] or is_right(c) for c in unseen), len(unseen)),
        ),
        ('nothing hidden: `none`', (sum(case['verdict'] == 'none' for case in part('nothing')), len(part('nothing')))),
        ('two effects: both found', (sum(set(case['case'][1]) <= set(case['effects']) for case in pairs), len(pairs))),
        ('outside the library, detectable: `unknown_effect`', (sum(map(is_unknown, outside)), len(outside))),
    ]


def is_unknown(case: Case) -> bool:
    """Whether the verdict says that no known effect explains the recordings."""
    return bool(case['verdict'] == 'unknown_effect')


def calibration_table(results: list[Case]) -> str:
    """Reliability, scores, every case; the figure."""
    figure = '![Share of answers that are right against their probability, with 95 % intervals](../figures/reliability.png)'
    return '\n'.join(calibration_rows(results)) + '\n\n' + figure


@dataclass(frozen=True)
class Part:
    """One section of the page: a script with its arguments, the file of its result, and the table made of it.

    `minutes`: about how long the whole takes on two free cores. `share` of the whole is measured by default; of a script
    that counts something else than cases, `whole` is the number of it. `resumable`: it continues a file of cases. `needs`:
    what must be in the folder of shared data.
    """

    name: str
    title: str
    minutes: float
    command: tuple[str, ...]
    text: str
    table: Callable[[Any], str] = grids
    resumable: bool = False
    needs: str = ''
    share: float = 1.0
    whole: int = 0

    @property
    def file(self) -> str:
        """The name of the result's file."""
        if self.name == 'intervals':
            return 'intervals.json'
        return f'{self.name}.jsonl' if self.resumable else f'{self.name}.json'

    def share_at(self, scale: float) -> float:
        """The share of the whole that is measured at a scale, to three digits."""
        return float(f'{min(1.0, scale * self.share):.3g}')

    def words(self, scale: float, **values: Any) -> list[str]:
        """The command at a scale, with what stands for the other names in braces."""
        share = self.share_at(scale)
        named = {'share': f'{share:g}', 'count': max(1, round(share * self.whole)), **values}
        return [word.format(**named) for word in self.command]

    def shown(self, scale: float) -> str:
        """The command, as one would type it."""
        words = self.words(scale, shared='../shared', file='', minutes='', root='')
        hidden = {'--json', '--file', '--minutes', '--figure'}
        return ' '.join(word for k, word in enumerate(words) if not {word, words[max(k - 1, 0)]} & hidden)


def script(name: str, *words: str) -> tuple[str, ...]:
    """A script that writes its numbers with --json."""
    return (f'{name}.py', *words, '--json', '{file}')


def cases(name: str, *words: str) -> tuple[str, ...]:
    """A script that keeps its cases in --file."""
    return (f'{name}.py', *words, '--file', '{file}', '--share', '{share}', '--minutes', '{minutes}', '--at-once', '2')


def joined(lines_of: Callable[[list[Case]], Iterable[str]]) -> Callable[[list[Case]], str]:
    """The table of a script that yields its lines."""
    return lambda results: '\n'.join(lines_of(results))


MODULE_DATA = tuple(f'{{shared}}/measured/module/{name}' for name in ('e91', 'e92', 'e93'))
PARTS = (
    Part('reference', 'Agreement with an independent implementation', 1,
         ('reference.py', '--folder', '{shared}/reference', '--json', '{file}'),
         'Largest differences from trajectories of another implementation with other solvers.', needs='reference'),
    Part('order', 'Order of the solver', 1, script('order'),
         'Error of all states relative to their scales after 1 s of equal steps, when the step is halved; '
         '`order` is the mean '
         'slope. The stated orders are 4 for steps and 3 for the dense output, whose error within one step '
         'falls with the fourth '
         'power. The stiff MAS module shows the order reduction of every Rosenbrock method, below 1e-8.'),
    Part('speed', 'Speed and error', 5, script('speed'),
         '30 random commands of 100 s with 10 steps of up to 15 W, 501 samples each. The error is against '
         '`solver.rtol` 1e-9. '
         'Ratios are from alternating runs.'),
    Part('flow', 'Flow and samples', 2, script('flow'),
         'One evaluation of the flow without effects beside a straight transcription of the equations, and 100 s runs by '
         'the number of samples: of all columns, or of the channels that a recording has.'),
    Part('startup', 'Start-up', 2, script('startup'), 'Time to the end of a small run, with an empty cache and later.'),
    Part('solvers', 'Other solvers', 6, script('solvers', '--runs', '{count}'),
         'The same compiled right-hand side with equivalently scaled tolerances and a restart at every change '
         'of the command '
         'and at every jump. `failed`: given up after 1,000 restarts or 300,000 evaluations of the right-hand side; '
         'multistep methods take a million and more in MAS runs. CVODE needs `scikit-sundae`.', share=0.2, whole=5),
    Part('robustness', 'Robustness', 4, script('robustness', '--runs', '{count}'),
         'Random steps and ramps of up to 30 W with parameters 15 % off, both models, at each tolerance.',
         share=0.25, whole=1000),
    Part('structures', 'Structures', 4, script('structures', '--runs', '{count}'),
         'Median time of runs of 5 s at the defaults beside the module\'s, and random runs with parameters up to 25 % off.',
         share=0.25, whole=1000),
    Part('node', 'The node', 1, script('node'), 'Over DDS, integrating at 1 kHz and publishing at 100 Hz.'),
    Part('stack', 'Modules in series', 4, script('stack', '--runs', '{count}'),
         'Time of a 100 s run by the number of modules, and random stacks with parameters up to 25 % off.',
         share=0.25, whole=1000),
    Part('soak', 'The node for minutes', 21, script('soak', '--seconds', '{count}'),
         'One module, then two, each recording its own bag.',
         share=0.1, whole=600),
    Part('flood', 'Two nodes under a flood of commands', 39, script('flood', '--seconds', '{count}'),
         'Two modules that record: `left` follows a /clock that stands still for 5 of 30 s, `right` the '
         'computer\'s clock and is paused as long; 1000 commands per second to each. `wrong_statuses`: those '
         'on /diagnostics that do not say what was done.', share=0.035, whole=1800),
    Part('intervals', 'Calibration and intervals', 25, script('intervals', '--seeds', '{count}'),
         'Parameters 5 to 15 % off, three runs of 100 s at 50 Hz with forces and noise, another one held out; '
         'MAS data and fit. '
         '`coverage` is the share of 95 % intervals that hold the truth.', share=0.12, whole=60),
    Part('challenges', 'Hidden effects', 25, cases('challenges', '--part', 'library', 'nothing', '--seeds', '481'),
         '[Challenges](challenges.md) of a seed that no development used: one effect of the library, or none. '
         'Detectable: the held-out error without the effect is above 1.3.', challenge_tables, True, share=0.1),
    Part('beyond_one', 'Two effects, and effects outside the library', 29,
         cases('challenges', '--part', 'pairs', 'outside', '--seeds', '481'),
         'Two effects of the library, or one that it does not have, without the search for an equation.',
         challenge_tables, True, share=0.1),
    Part('diagnosis_time', 'Where the time of a diagnosis goes', 7, script('diagnosis_time'),
         'Robots whose pose and forces were recorded in three runs of 100 s (or thirty), by what is hidden: nothing, '
         'effects of the library, one in a wire only, and one that asks for an equation.'),
    Part('calibration', 'Calibration of probabilities', 60,
         (*cases('calibration'), '--figure', '{root}/docs/figures/reliability.png'),
         'Robots that hide nothing, one effect from invisible to plain, two, laws in another form, laws of no list: how '
         'often the most probable answer is right. Odds: of the robot\'s own laws against models that lack one of them.',
         calibration_table, True, share=0.1),
    Part('laplace', 'Odds by Laplace\'s method', 20, cases('laplace'),
         'Log odds of a model with an effect against the one without, by the search and by nested sampling (needs '
         '`dynesty`).', joined(laplace_rows), True, share=0.25),
    Part('invariance', 'Invariance of the diagnosis', 7, cases('invariance'),
         'The same data with runs in another order, under foreign names and units, with other seeds, and decimated. '
         '`same`: same verdict and first effect.', joined(invariance_rows), True, share=0.1),
    Part('module', 'Data of another program', 4, cases('invariance', '--cases', '--folder', *MODULE_DATA),
         'Made by an independent simulation with MAS kinetics and sensor noise: nothing missing (e91), gravity '
         'across the beam '
         '(e92), natural convection (e93).', joined(invariance_rows), True, 'measured/module', share=0.28),
    Part('equations', 'Equations', 25, cases('equations', '--no-known-effects', '--seeds', '41'),
         'Effects that the library does not have, pose recorded, without the search among known effects.',
         joined(equation_rows), True, share=0.12),
    Part('other_forms', 'Listed effects in other forms', 27,
         cases('other_forms', '--seeds', '581', '--channels', 'pose', 'forces'),
         'Effects that the library lists, acting in another form: in one coordinate, in one wire, through air that both '
         'wires share, with another exponent. `right`: name and scope, or exactly the true equation.',
         joined(other_form_rows), True, share=0.1),
    Part('recovery', 'Recovery against magnitude', 8, cases('recovery', '--seeds', '503'),
         'Six effects of the library whose strength is scaled until the best fit without them leaves a given error over '
         'noise (1: nothing). Another one named: beside the hidden effect, or in its place.',
         joined(recovery_rows), True, share=0.15),
    Part('latent', 'Latent inputs', 12, cases('latent', '--seeds', '311', '--channels', 'pose'),
         'The port that is named, and the error over noise without and with it (`left`).', latent_table, True, share=0.12),
    Part('designs', 'Designed experiments', 15, cases('designs'),
         'Log evidence ratio for the true explanation that a designed sequence adds, beside two random ones.',
         joined(design_rows), True, share=0.1),
    Part('similarity', 'Effects that look alike', 3, script('similarity'),
         'RMS change over noise of each effect, and the cosines with the most similar changes.'),
    Part('wire', 'A real superelastic wire', 15, cases('nitinol', '{shared}/measured/nitinol_wire/csv'),
         'Stress RMSE of a NiTi wire, each case with other loops held out; see [a real wire](../explanation/nitinol.md).',
         joined(wire_rows), True, 'measured/nitinol_wire', share=0.17),
)  # fmt: skip
