"""The parts of the validation: which script measures them, and how their results become lines and tables."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from benches import table as bench_rows
from calibration import table as calibration_rows
from cases import of
from challenges import is_detectable, is_right
from control import table as control_rows
from designs import summary as design_rows
from equations import table as equation_rows
from guard import table as guard_rows
from invariance import table as invariance_rows
from laplace import table as laplace_rows
from latent import table as latent_table
from live_diagnosis import table as live_table
from measured import ratios as measured_ratios
from measured import table as measured_rows
from nitinol import rows as wire_rows
from observer import table as observer_rows
from other_forms import table as other_form_rows
from peers import METHODS, NAMING, named_by
from peers import table as peer_rows
from recovery import table as recovery_rows
from set_up_faults import table as set_up_rows

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
    """A table for each group of numbers that a script reports; groups of the same numbers are the rows of one."""
    text: list[str] = []
    alike: dict[tuple[str, ...], list[list[Any]]] = {}
    for name, group in result.items():
        if name == 'machine':
            continue
        if not isinstance(group, Mapping):
            alike.setdefault((), []).append([name.replace('_', ' '), group])
        elif any(isinstance(row, Mapping) for row in group.values()):
            columns = list(dict.fromkeys(key for row in group.values() for key in row))
            lines = ([key, *(row.get(column, '') for column in columns)] for key, row in group.items())
            text.append(rows([name, *map(heading, columns)], lines))
        else:
            alike.setdefault(tuple(group), []).append([name, *group.values()])
    for columns, lines in alike.items():
        text.append(rows(['', *map(heading, columns or ('',))], lines))
    return '\n\n'.join(text)


def likeness(result: Mapping[str, Any]) -> str:
    """Of each effect its size and what it is most like, with the cosines."""
    tables = []
    for name, effects in result.items():
        if name != 'machine':
            lines = (
                [effect, row['size'], ', '.join(f'{other} {cosine:.3f}' for other, cosine in row.items() if other != 'size')]
                for effect, row in effects.items()
            )
            tables.append(rows([name, 'size', 'most alike, with the cosine'], lines))
    return '\n\n'.join(tables)


def every(result: Any, key: str) -> list[Any]:
    """All values with this name, at any depth."""
    if not isinstance(result, Mapping):
        return []
    return [value for name, entry in result.items() for value in ([entry] if name == key else every(entry, key))]


def span(numbers: Iterable[float], unit: str = '') -> str:
    """The least and the largest of some numbers."""
    known = sorted(numbers)
    return f'{cell(known[0])} to {cell(known[-1])}{unit}'


def counted(results: list[Case]) -> str:
    """Hit rates of challenges, forces and pose together."""
    return '; '.join(f'{name}: {of(*numbers)}' for name, numbers in hit_rates(results) if numbers[1])


def found_again(results: list[Case]) -> str:
    """How many hidden effects were named, of those whose absence shows."""
    shows = [case for case in results if 'failed' not in case and case['bare'] >= 1.035]
    found = sum(case['case'][0] in case['effects'] for case in shows)
    return f'found where the error without it is above 1.035: {of(found, len(shows))}'


def held_out_stress(results: list[Case]) -> str:
    """The errors of the last models."""
    errors = (f'{case["steps"][-1]["held_out"]:.0f}' for case in results if 'failed' not in case)
    return f'held-out RMSE by case: {", ".join(errors)} MPa'


def challenge_tables(results: list[Case]) -> str:
    """Hit rates by part and channels, then every case."""
    results = [case for case in results if 'failed' not in case]
    counts = []
    for channels in ('forces', 'pose'):
        own = [case for case in results if case['case'][3] == (channels == 'forces')]
        counts += [[f'{name}, {channels}', of(*numbers)] for name, numbers in hit_rates(own) if numbers[1]]
    cases = [
        [
            part,
            ', '.join(hidden) or '-',
            seed,
            'forces' if forces else 'pose',
            case['bare'],
            case['last'],
            f'`{case["verdict"]}`',
            ', '.join(case['effects']),
            ', '.join(case['alike']),
        ]
        for case in results
        for part, hidden, seed, forces in [case['case']]
    ]
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
    figure = (
        '![Share of answers that are right against their probability, with 95 % intervals](../../figures/reliability.png)'
    )
    return '\n'.join(calibration_rows(results)) + '\n\n' + figure


def peers_named(results: list[Case]) -> str:
    """How often the diagnosis and the others name something that is hidden, or something where nothing is."""
    known = [case for case in results if 'failed' not in case]
    counts = ((title, named_by(known, method)) for method, title in METHODS.items() if method in NAMING)
    return f'{len(known)} robots; something hidden named, and false alarms: ' + '; '.join(
        f'{title} {right} of {seen}, {alarms} of {nothing}' for title, (right, seen, alarms, nothing) in counts
    )


def followed(results: list[Case]) -> str:
    """How well a predictive controller with an improved model follows, beside PI."""
    runs = [case['runs']['room'] for case in results if 'failed' not in case]
    ratios = sorted(run['predictive, improved']['error'] / run['PI']['error'] for run in runs)
    half, longest = sum(ratio <= 0.5 for ratio in ratios), max(one['longest_ms'] for run in runs for one in run.values())
    return f'error {span(ratios)} of that of PI, at most half on {half} of {len(ratios)}; longest step {longest:.1f} ms'


@dataclass(frozen=True)
class Part:
    """One line of the page: a script with its arguments, and what is made of its result.

    `subject`: the section of the page. `headline`: the result in a line; without it, what the table says outside of its
    rows. `table`: the details, in a file of their own. `minutes`: about how long the whole takes on two free cores. `share`
    of the whole is measured by default; of a script that counts something else than cases, `whole` is the number of it.
    `resumable`: it continues a file of cases. `needs`: what must be in the folder of shared data.
    """

    name: str
    title: str
    minutes: float
    command: tuple[str, ...]
    text: str
    subject: str
    headline: Callable[[Any], str] | None = None
    table: Callable[[Any], str] = grids
    resumable: bool = False
    needs: str = ''
    share: float = 1.0
    whole: int = 0

    @property
    def result_file(self) -> str:
        """The name of the result's file."""
        if self.name == 'intervals':
            return 'intervals.json'
        return f'{self.name}.jsonl' if self.resumable else f'{self.name}.json'

    def in_a_line(self, result: Any) -> str:
        """What the page says of the result."""
        if self.headline:
            return self.headline(result)
        return '; '.join(line for line in self.table(result).splitlines() if line and line[0] not in '|!')

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
SOLVER, NODE, FITS = 'The solver', 'The node', 'Fits and experiments'
LIVE, DIAGNOSIS, MEASURED = 'Beside a running robot', 'Diagnosis of simulated robots', 'Data of other origin'
PARTS = (
    Part(
        'reference',
        'Agreement with an independent implementation',
        minutes=1,
        command=('reference.py', '--folder', '{shared}/reference', '--json', '{file}'),
        text='Largest differences from trajectories of another implementation with other solvers.',
        subject=SOLVER,
        headline=lambda r: f'alpha differs by at most {max(every(r, "alpha [deg]")):.1g} deg',
        needs='reference',
    ),
    Part(
        'order',
        'Order of the solver',
        minutes=1,
        command=script('order'),
        text='Error of all states relative to their scales after 1 s of equal steps, when the step is halved; `order` is '
        'the mean slope. The stated orders are 4 for steps and 3 for the dense output, whose error within one step falls '
        'with the fourth power. The stiff MAS module shows the order reduction of every Rosenbrock method, below 1e-8.',
        subject=SOLVER,
        headline=lambda r: f'steps: {span(v["order"] for k, v in r["steps"].items() if "stiff" not in k)} (stated: 4)',
    ),
    Part(
        'speed',
        'Speed and error',
        minutes=5,
        command=script('speed'),
        text='30 random commands of 100 s with 10 steps of up to 15 W, 501 samples each. The error is against '
        '`solver.rtol` 1e-9. Ratios are from alternating runs.',
        subject=SOLVER,
        headline=lambda r: '; '.join(
            f'{name}: {cell(row["median_ms"])} ms, error of alpha at most {row["largest_alpha_error_deg"]:.1g} deg'
            for name, row in r['100 s runs'].items()
        ),
    ),
    Part(
        'flow',
        'Flow and samples',
        minutes=2,
        command=script('flow'),
        text='One evaluation of the flow without effects beside a straight transcription of the equations, and 100 s runs '
        'by the number of samples: of all columns, or of the channels that a recording has.',
        subject=SOLVER,
        headline=lambda r: f'{span(every(r, "ratio"))} times a straight transcription of the equations',
    ),
    Part(
        'startup',
        'Start-up',
        minutes=2,
        command=script('startup'),
        text='Time to the end of a small run, with an empty cache and later.',
        subject=SOLVER,
        headline=lambda r: f'first {span(every(r, "first_s"), " s")}, later {span(every(r, "later_s"), " s")}',
    ),
    Part(
        'solvers',
        'Other solvers',
        minutes=6,
        command=script('solvers', '--runs', '{count}'),
        text='The same compiled right-hand side with equivalently scaled tolerances and a restart at every change of the '
        'command and at every jump. `failed`: given up after 1,000 restarts or 300,000 evaluations of the right-hand side; '
        'multistep methods take a million and more in MAS runs. CVODE needs `scikit-sundae`.',
        subject=SOLVER,
        headline=lambda r: f'{span(t for t in every(r, "time_over_sma_sim") if t > 1.0)} times as long, where they finish',
        share=0.2,
        whole=5,
    ),
    Part(
        'robustness',
        'Robustness',
        minutes=4,
        command=script('robustness', '--runs', '{count}'),
        text='Random steps and ramps of up to 30 W with parameters 15 % off, both kinetics, at each tolerance.',
        subject=SOLVER,
        headline=lambda r: f'{sum(every(r, "failed"))} of {sum(every(r, "runs"))} runs failed',
        share=0.25,
        whole=1000,
    ),
    Part(
        'structures',
        'Structures',
        minutes=4,
        command=script('structures', '--runs', '{count}'),
        text="Median time of runs of 5 s at the defaults beside the module's, random runs with parameters up to 25 % off.",
        subject=SOLVER,
        headline=lambda r: (
            f'{sum(every(r, "failures"))} failures; {span(every(r, "times_the_module"))} times as long as the module'
        ),
        share=0.25,
        whole=1000,
    ),
    Part(
        'stack',
        'Modules in series',
        minutes=4,
        command=script('stack', '--runs', '{count}'),
        text='Time of a 100 s run by the number of modules, and random stacks with parameters up to 25 % off.',
        subject=SOLVER,
        headline=lambda r: (
            f'{span(every(r, "milliseconds"), " ms")} with one to ten modules; {sum(every(r, "failures"))} failures'
        ),
        share=0.25,
        whole=1000,
    ),
    Part(
        'dense',
        'Commands of a controller',
        minutes=2,
        command=script('dense'),
        text='100 s of a PI controller at 50 Hz with a noisy sensor, 5,000 changes of the command, against the same with 10 '
        'steps: ratios of processor times, by the standard deviation of the changes from row to row. Trial steps and '
        'tangents are those of a search, under the smoothed command.',
        subject=SOLVER,
        headline=lambda r: (
            f'{span(every(r, "simulation_ratio"))} times the time of 10 steps, trial steps of a search '
            f'{span(every(r, "trial_ratio"))}, tangents {span(every(r, "tangents_ratio"))}'
        ),
    ),
    Part(
        'tangents',
        'Derivatives of a fit',
        minutes=1,
        command=script('tangents'),
        text='The residuals of three recordings of 100 s in all unknowns of a fit: by tangents and by differences of runs. '
        'Processor time; error in units of the noise per standard deviation of the prior, against extrapolated central '
        'differences at rtol 1e-8.',
        subject=SOLVER,
        headline=lambda r: (
            f'one-sided differences take {span(every(r, "one_sided_over_tangents"))} times as long as tangents, '
            f'central ones {span(every(r, "central_over_tangents"))} times'
        ),
    ),
    Part(
        'node',
        'Rate and load',
        minutes=1,
        command=script('node'),
        text='Over DDS, integrating at 1 kHz and publishing at 100 Hz.',
        subject=NODE,
        headline=lambda r: (
            f'{r["node"]["messages_per_s"]:.0f} messages per second, {r["node"]["lost_samples"]} lost, '
            f'{100.0 * r["node"]["share_of_a_core"]:.0f} % of a core'
        ),
    ),
    Part(
        'soak',
        'The node for minutes',
        minutes=21,
        command=script('soak', '--seconds', '{count}'),
        text='One module, then two, each recording its own bag.',
        subject=NODE,
        headline=lambda r: (
            f'{sum(every(r, "samples_lost"))} of {sum(every(r, "samples"))} samples lost, '
            f'memory grows by {span(every(r, "memory_growth_MB"), " MB")}'
        ),
        share=0.1,
        whole=600,
    ),
    Part(
        'flood',
        'Two nodes under a flood of commands',
        minutes=39,
        command=script('flood', '--seconds', '{count}'),
        text="Two modules that record: `left` follows a /clock that stands still for 5 of 30 s, `right` the computer's "
        'clock and is paused as long; 1000 commands per second to each. `wrong_statuses`: those on /diagnostics that do '
        'not say what was done.',
        subject=NODE,
        headline=lambda r: (
            f'{sum(every(r, "wrong_statuses"))} of {sum(every(r, "statuses"))} statuses wrong; '
            f'{span(every(r, "stamps_within_2_ms_percent"), " %")} of the stamps within 2 ms'
        ),
        share=0.035,
        whole=1800,
    ),
    Part(
        'observer',
        'Observer',
        minutes=35,
        command=cases('observer', '--robots', '200', '--first', '243000'),
        text='Root mean squares over simulated robots with MAS kinetics, each parameter off by 5 to 15 %, a hidden '
        'effect in every third, random commands or a closed loop for 40 s; `held`: true values in the 95 % '
        'intervals; ms: processor time of an update.',
        subject=LIVE,
        table=joined(observer_rows),
        resumable=True,
        share=0.1,
    ),
    Part(
        'guard',
        'Guard',
        minutes=35,
        command=cases('guard', '--robots', '1000', '--first', '242000'),
        text='Robots with each parameter 15 % off, either way, a hidden effect in every second, commands of up to 25 W '
        'in bursts and for long, limits of 360 K and 250 MPa. Lost: of the stroke that a guard allows that knows '
        'the true state, or of that without a guard where commands were safe; by the scale alone: as a guard that '
        'knows all but T - T_E to a factor.',
        subject=LIVE,
        table=joined(guard_rows),
        resumable=True,
        share=0.02,
    ),
    Part(
        'live_diagnosis',
        'Live diagnosis',
        minutes=60,
        command=cases('live_diagnosis', '--days', '12', '--quiet', '100', '--seed', '261000'),
        text='Parts of days of ten minutes in which something changes, or nothing; and quiet hours in which the room '
        'gets warmer and colder by up to 2 K, as a thermometer tells. Laws of convection, friction and gravity are'
        ' not those of the library.',
        subject=LIVE,
        table=live_table,
        resumable=True,
        share=0.1,
    ),
    Part(
        'control',
        'Controllers with a model',
        minutes=60,
        command=cases('control', '--robots', '20', '--first', '244000'),
        text='A sum of two sines is followed, with the model of the data sheet and with that of a diagnosis, beside a PI '
        'controller tuned on the robot itself; within limits that leave room, and within limits that bind.',
        subject=LIVE,
        headline=followed,
        table=joined(control_rows),
        resumable=True,
        share=0.1,
    ),
    Part(
        'environments',
        'Environments',
        minutes=1,
        command=script('gym'),
        text='64 robots under random actions at 50 Hz in one vectorised environment, by wall and by processor time.',
        subject=LIVE,
        headline=lambda r: f'{span(every(r, "steps_per_second"))} steps per second',
    ),
    Part(
        'intervals',
        'Confidence intervals',
        minutes=25,
        command=script('intervals', '--seeds', '{count}'),
        text='Parameters 5 to 15 % off, three runs of 100 s at 50 Hz with forces and noise, another one held out; MAS data '
        'and fit. `coverage` is the share of 95 % intervals that hold the truth.',
        subject=FITS,
        headline=lambda r: f'95 % intervals that hold the truth: {r["pooled coverage"]}',
        share=0.12,
        whole=60,
    ),
    Part(
        'benches',
        'Confidence intervals of benches',
        minutes=40,
        command=cases('benches', '--first', '3000'),
        text='A slider, a blocked wire and a tensile test with what real benches have: a scale of power, delays, zeros, '
        'drifts, rooms, resolutions, a thermometer that lags, grips with a toe. The nominal model is fitted to three '
        'recordings, where nothing is missing and where thermal expansion or the grains of a polycrystal are; another '
        'recording is held out. `intervals that hold`: 95 % intervals that hold the truth. `curve within`: the '
        'part of the samples of the recording held out within 1.96 times what the fit leaves in their channel.',
        subject=FITS,
        table=joined(bench_rows),
        resumable=True,
    ),
    Part(
        'closed_loops',
        'Recordings of closed loops',
        minutes=8,
        command=script('loops'),
        text='A robot with hidden gravity and natural convection follows three references under a PI controller at 50 Hz, '
        'or gets 10 random steps: `sma-sim compare` of two bags of 100 s as a process of its own, and a diagnosis of three '
        'recordings with pose and forces.',
        subject=FITS,
        headline=lambda r: (
            f'compare {cell(r["sma-sim compare of two bags"]["closed loop"]["processor_s"])} processor s; a diagnosis takes '
            f'{cell(r["closed loop over steps"]["processor time"])} times that of steps'
        ),
    ),
    Part(
        'campaign',
        'A long campaign',
        minutes=15,
        command=script('campaign', '--largest', '{count}'),
        text='Fits of recordings of 100 s with five channels at 50 Hz and 10 random steps each, and of one of two hours: '
        'the parameters that are free by default, one start, intervals. `data`: what recordings take, `beyond`: the most '
        'that the process takes beside them; on a cluster of two workers, `useful` is the processor time of the fit in one '
        'thread over that of all its processes; `apart`, over that of one of two which run at once and have nothing to do '
        'with each other, as much as the processors of this machine leave of two at best.',
        subject=FITS,
        headline=lambda r: (
            f'{span([row["processor_s"] / (row["data_MB"] * row["iterations"]) for row in r["a fit"].values()], " s")} '
            'for each MB of recordings and iteration, '
            f'{100.0 * r["cluster"]["useful"]:.0f} % of a cluster useful ({100.0 * r["cluster"]["apart"]:.0f} % of '
            'processes that share nothing)'
        ),
        whole=200,
    ),
    Part(
        'designs',
        'Designed experiments',
        minutes=15,
        command=cases('designs'),
        text='Log evidence ratio for the true explanation that a designed sequence adds, beside two random ones.',
        subject=FITS,
        table=joined(design_rows),
        resumable=True,
        share=0.1,
    ),
    Part(
        'similarity',
        'Effects that look alike',
        minutes=3,
        command=script('similarity'),
        text="RMS change of each effect in units of the sensors' noise, and the cosines with the most similar changes.",
        subject=FITS,
        headline=lambda r: f'{sum(size < 1.0 for size in every(r, "size"))} of {len(every(r, "size"))} below the noise',
        table=likeness,
    ),
    Part(
        'challenges',
        'One hidden effect, or none',
        minutes=25,
        command=cases('challenges', '--part', 'library', 'nothing', '--seeds', '481'),
        text='[Challenges](../challenges.md) of a seed that no development used: one effect of the library, or none. '
        'Detectable: the held-out error without the effect is above 1.3.',
        subject=DIAGNOSIS,
        headline=counted,
        table=challenge_tables,
        resumable=True,
        share=0.1,
    ),
    Part(
        'beyond_one',
        'Two effects, and effects outside the library',
        minutes=29,
        command=cases('challenges', '--part', 'pairs', 'outside', '--seeds', '481'),
        text='Two effects of the library, or one that it does not have, without the search for an equation.',
        subject=DIAGNOSIS,
        headline=counted,
        table=challenge_tables,
        resumable=True,
        share=0.1,
    ),
    Part(
        'other_forms',
        'Listed effects in other forms',
        minutes=27,
        command=cases('other_forms', '--seeds', '581', '--channels', 'pose', 'forces'),
        text='Effects that the library lists, acting in another form: in one coordinate, in one wire, through air that both '
        'wires share, with another exponent. `right`: name and scope, or exactly the true equation.',
        subject=DIAGNOSIS,
        table=joined(other_form_rows),
        resumable=True,
        share=0.1,
    ),
    Part(
        'recovery',
        'Recovery against magnitude',
        minutes=8,
        command=cases('recovery', '--seeds', '503'),
        text='Six effects of the library whose strength is scaled until the best fit without them leaves a given normalized '
        'RMSE (1: nothing is missing). Another one named: beside the hidden effect, or in its place.',
        subject=DIAGNOSIS,
        headline=found_again,
        table=joined(recovery_rows),
        resumable=True,
        share=0.15,
    ),
    Part(
        'calibration',
        'Calibration of probabilities',
        minutes=60,
        command=(*cases('calibration'), '--figure', '{root}/docs/figures/reliability.png'),
        text='Robots that hide nothing, one effect from invisible to plain, two, laws in another form, laws of no list: how '
        "often the most probable answer is right. Odds: of the robot's own laws against models that lack one of them.",
        subject=DIAGNOSIS,
        table=calibration_table,
        resumable=True,
        share=0.1,
    ),
    Part(
        'laplace',
        "Odds by Laplace's method",
        minutes=20,
        command=cases('laplace'),
        text='Log odds of a model with an effect against the one without, by the search and by nested sampling (needs '
        '`dynesty`), where the two compete: the effect is missing, or worth at most 20 nats. The Gaussian about the optimum '
        'is cut at the bounds. What is left is its shape: `driver_lag` has a parameter without a derivative where it is 0.',
        subject=DIAGNOSIS,
        table=joined(laplace_rows),
        resumable=True,
        share=0.25,
    ),
    Part(
        'peers',
        'Other programs on the same robots',
        minutes=60,
        command=cases('peers'),
        text='The diagnosis beside pysindy, gplearn, sysidentpy and emcee (`benchmarks/requirements-peers.txt`), which are '
        'made for any system and know nothing of SMA ([what for](../../explanation/alternatives.md)). All start from the '
        'same calibrated model; equations are sought for the residual, or for the latent input that `sma-sim latent` '
        'estimates at the place of the hidden law. An equation counts where it removes 5 % of the squares of a run that it '
        'was not fitted to; it names something hidden if any variable of any hidden law is in it. Hits are of robots that '
        'the calibrated model predicts with a normalized RMSE of at least 1.1.',
        subject=DIAGNOSIS,
        headline=peers_named,
        table=joined(peer_rows),
        resumable=True,
        share=0.2,
    ),
    Part(
        'set_up_faults',
        'Faults of the set-up',
        minutes=25,
        command=cases('set_up_faults'),
        text='A sign, exchanged columns or commands, a unit, a noise that is stated wrong, outliers; in all recordings or '
        'in one, of robots that hide nothing and of robots that hide an effect '
        '([what is said](../../how-to/diagnose-your-robot.md#when-something-is-wrong-with-the-recordings)). '
        'Where the set-up stays uncertain, no effect is searched for.',
        subject=DIAGNOSIS,
        table=joined(set_up_rows),
        resumable=True,
    ),
    Part(
        'invariance',
        'Invariance of the diagnosis',
        minutes=7,
        command=cases('invariance'),
        text='The same data with runs in another order, under foreign names and units, with other seeds, and decimated. '
        '`same`: same verdict and first effect.',
        subject=DIAGNOSIS,
        table=joined(invariance_rows),
        resumable=True,
        share=0.1,
    ),
    Part(
        'equations',
        'Equations',
        minutes=25,
        command=cases('equations', '--no-known-effects', '--seeds', '41'),
        text='Effects that the library does not have, pose recorded, without the search among known effects.',
        subject=DIAGNOSIS,
        table=joined(equation_rows),
        resumable=True,
        share=0.12,
    ),
    Part(
        'latent',
        'Latent inputs',
        minutes=12,
        command=cases('latent', '--seeds', '311', '--channels', 'pose'),
        text='The port that is named, and the normalized RMSE without and with it (`left`).',
        subject=DIAGNOSIS,
        table=latent_table,
        resumable=True,
        share=0.12,
    ),
    Part(
        'diagnosis_time',
        'Where the time of a diagnosis goes',
        minutes=7,
        command=script('diagnosis_time'),
        text='Robots whose pose and forces were recorded in three runs of 100 s (or thirty), by what is hidden: nothing, '
        'effects of the library, one in a wire only, and one that asks for an equation.',
        subject=DIAGNOSIS,
        headline=lambda r: '; '.join(f'{name}: {seconds:.0f} s' for name, seconds in r['wall [s]']['all'].items()),
    ),
    Part(
        'module',
        'Data of another program',
        minutes=4,
        command=cases('invariance', '--cases', '--folder', *MODULE_DATA),
        text='Made by an independent simulation with MAS kinetics and sensor noise: nothing missing (e91), gravity across '
        'the beam (e92), natural convection (e93).',
        subject=MEASURED,
        table=joined(invariance_rows),
        resumable=True,
        needs='measured/module',
        share=0.28,
    ),
    Part(
        'measured',
        "Other people's benches",
        minutes=30,
        command=cases('measured', '{shared}/measured'),
        text='Recordings that others published: an actuator wire (Flexinol) and three levels of NiTiHf '
        '(<https://github.com/maestrolab/calibrating>), NiTiHf and NiTiCo at constant stress (SMA-REACT, '
        '`examples/real/isobaric`), a blocked element (<https://github.com/GuarnerosSIA/SMA_public>), a slider '
        '(<https://github.com/NicholasBaraghini/Modeling-and-Simulation-of-Mechatronic-Systems>), two of a hundred cycles '
        '(<https://github.com/matthewkuner/ASMADA>), the warming of a fabric (<https://github.com/dongsus41/SMA-control>), '
        'a dead weight (<https://github.com/MK-Zuk/SMA-dataset>). Errors are normalized RMSE, of the nominal model and of '
        'the last one; `probability` is that of what may be missing.',
        subject=MEASURED,
        headline=lambda r: (
            f'where something is named, errors of recordings held out fall {span(measured_ratios(r), " times")}'
        ),
        table=joined(measured_rows),
        resumable=True,
        needs='measured/flexinol',
    ),
    Part(
        'wire',
        'A real superelastic wire',
        minutes=15,
        command=cases('nitinol', '{shared}/measured/nitinol_wire/csv'),
        text='Stress RMSE of a NiTi wire, each case with other loops held out; see '
        '[a real wire](../../explanation/nitinol.md).',
        subject=MEASURED,
        headline=held_out_stress,
        table=joined(wire_rows),
        resumable=True,
        needs='measured/nitinol_wire',
        share=0.17,
    ),
)
