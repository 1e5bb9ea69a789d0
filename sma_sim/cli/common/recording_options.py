"""Options of the commands that put the model beside measurements, and the data that they stand for."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path

from sma_sim.cli.common.commands import add_kinetics, print_notes
from sma_sim.cli.common.config_options import add_namespace_option, config_from
from sma_sim.evidence.data.column_map import entries_of_map
from sma_sim.evidence.data.recording import Dataset
from sma_sim.evidence.data.sources import META_FILE, recordings_in
from sma_sim.evidence.data.tables import check_writable
from sma_sim.evidence.estimation.curve_features import CurveFeatures, curve_features
from sma_sim.evidence.estimation.dask_cluster import dask_executor
from sma_sim.evidence.estimation.executors import executor_or_threads
from sma_sim.evidence.estimation.prepared_fit import on_leading_bench, started_from
from sma_sim.model.config import Config
from sma_sim.model.errors import UserError
from sma_sim.model.given import effect_folders_of
from sma_sim.model.materials import MATERIALS
from sma_sim.model.optional import require
from sma_sim.model.parameter_file import parameter_file
from sma_sim.report.html.page import Provenance
from sma_sim.words.json_values import write_json as write_json
from sma_sim.words.repair_notes import grouped_notes
from sma_sim.words.wire_tests import features_as_text
from sma_sim.workflow.data_request import DataRequest

EXIT_INTERRUPTED = 130  # exit code after Ctrl-C


def add_data_options(parser: argparse.ArgumentParser) -> None:
    """``DATA...`` and options about them, ``--report``, ``--json``, ``--scheduler``."""
    add_recording_options(parser)
    parser.add_argument('--report', type=report_path, metavar='FILE.html', help='HTML report to write, with figures')
    parser.add_argument('--json', type=Path, metavar='FILE.json', help='results to write, for programs')
    parser.add_argument('--scheduler', metavar='ADDRESS', help='Dask cluster that does the work, such as tcp://host:8786')


def add_beginning_option(parser: argparse.ArgumentParser) -> None:
    """``--in-motion`` of what does not find that by itself."""
    parser.add_argument(
        '--in-motion',
        action='store_true',
        help='estimate how warm wires were, and where the pose was, when each recording begins (default: all begin at rest)',
    )


def add_recording_options(parser: argparse.ArgumentParser, nargs: str = '+') -> None:
    """``DATA...`` and how they are to be read."""
    parser.add_argument('data', nargs=nargs, type=Path, metavar='DATA', help='CSV files, bags, or folders of them')
    parser.add_argument(
        '--hold-out',
        nargs='+',
        action='extend',
        default=[],
        metavar='FILE-OR-STEM',
        help='recordings that are not fitted, only predicted: a file, a folder, or the name of one in DATA',
    )
    add_reading_options(parser)


def add_reading_options(parser: argparse.ArgumentParser) -> None:
    """How recordings are to be read: ``--system``, ``--map``, ``--noise``, ``--namespace``."""
    parser.add_argument(
        '--system', metavar='NAME', help='what was measured (default: the system of --config, else of --map)'
    )
    parser.add_argument('--map', type=Path, metavar='FILE', help='YAML file that maps foreign columns and units')
    parser.add_argument(
        '--noise',
        action='append',
        default=[],
        metavar='CHANNEL=STD',
        help='standard deviation of the noise of a channel, SI units (default: that of meta.json, else estimated)',
    )
    add_namespace_option(parser)


def report_path(text: str) -> Path:
    """The file of a report. Refused without plotly, before hours of work."""
    try:
        require('plotly.subplots', 'a report')
    except UserError as error:
        raise argparse.ArgumentTypeError(str(error)) from error
    return Path(text)


def system_words(arguments: argparse.Namespace) -> list[str]:
    """``--system`` as a word of the configuration; where nothing says a system, that for which the map was written.

    Raises UserError for what is no map.
    """
    files = getattr(arguments, 'configs', None) or getattr(arguments, 'config', None)
    system = arguments.system
    if not (system or files or any(word.startswith('system=') for word in arguments.words)) and arguments.map:
        system = entries_of_map(arguments.map).get('system')
    return [f'system={system}'] if system else []


def add_search_options(parser: argparse.ArgumentParser, seed_of: str) -> None:
    """``--model`` and ``--seed`` of what searches."""
    add_kinetics(parser, ('hybrid', 'mas', 'auto'), 'those that --config or --set gives, else auto')
    parser.add_argument('--seed', type=int, default=0, metavar='N', help=seed_of)


def add_limit_option(parser: argparse.ArgumentParser) -> None:
    """``--limit`` and ``--material`` of what fits."""
    parser.add_argument(
        '--material',
        default='',
        choices=tuple(MATERIALS),
        help='of the wires: which values are plausible (default: of a single wire as its transformation temperatures say)',
    )
    parser.add_argument(
        '--limit',
        action='append',
        default=[],
        metavar='NAME=LOW:HIGH',
        dest='limits',
        help='between which values (SI) a parameter, the delay or zero.strain is estimated, in place of the usual limits',
    )


def print_progress(words: str) -> None:
    """Print what is being done."""
    print(f'  {words}', file=sys.stderr, flush=True)


def print_written(*files: Path | None) -> None:
    """Name the files that were written."""
    for file in files:
        if file:
            print(file)


def check_outputs(arguments: argparse.Namespace, *more: Path | None) -> None:
    """Raise UserError, before any long work, where an output cannot be written or has an unexpected suffix."""
    for path, suffixes in ((arguments.report, ('.html', '.htm')), (arguments.json, ('.json',))):
        if path is not None and path.suffix not in suffixes:
            raise UserError(f'{path}: expected a name that ends in {suffixes[0]}')
    for path in (arguments.report, arguments.json, *more):
        if path is not None:
            check_writable(path, files_read(arguments))


def files_read(arguments: argparse.Namespace) -> Iterator[Path]:
    """What no output may take the place of: recordings, the noise that is stated beside them, the map, the model."""
    for path in (*arguments.data, *map(Path, arguments.hold_out)):
        yield path
        if path.exists():
            yield (path if path.is_dir() else path.parent) / META_FILE
            with suppress(UserError):  # one that cannot be read is told when it is
                yield from recordings_in(path)
    models = getattr(arguments, 'configs', None) or [getattr(arguments, 'config', None)]
    yield from filter(None, (arguments.map, *models))


def read_data(arguments: argparse.Namespace, config: Config) -> tuple[Dataset, Dataset | None]:
    """The recordings to fit and those held out; notes on what was repaired go to stderr. Raises UserError."""
    request = data_request(arguments)
    dataset = request.read(config)
    print_notes(grouped_notes([dataset]))
    if getattr(arguments, 'in_motion', False):
        dataset = replace(dataset, recordings=tuple(replace(one, in_motion=True) for one in dataset.recordings))
    return request.split(dataset)


def model_and_recordings(arguments: argparse.Namespace, *outputs: Path | None) -> tuple[Config, Dataset, Dataset | None]:
    """The model, the recordings to fit and those held out, once the `outputs` can be written. Raises UserError."""
    check_outputs(arguments, *outputs)
    config = config_from(arguments, *system_words(arguments))
    return config, *read_data(arguments, config)


def data_request(arguments: argparse.Namespace) -> DataRequest:
    """The recordings that the options name. Raises UserError."""
    noise = noise_from(arguments.noise)
    return DataRequest(tuple(arguments.data), tuple(arguments.hold_out), arguments.map, noise, arguments.namespace)


def from_curves(fitted: Dataset, *configs: Config, is_fitted: bool = True) -> list[Config]:
    """The configurations with starts from the curves of the tests of a wire, whose features are printed."""
    curves = print_curves(fitted)
    return [started_from(curves, on_leading_bench(config, fitted), is_fitted) for config in configs]


def print_curves(dataset: Dataset) -> CurveFeatures:
    """Print what the curves of the tests of a wire show, if there are any; returns it."""
    if curves := curve_features(dataset):
        print(*features_as_text(curves), '', sep='\n', flush=True)
    return curves


def noise_from(words: Sequence[str]) -> dict[str, float]:
    """Noise by channel [SI] from ``channel=std`` words. Raises UserError."""
    noise = {}
    for word in words:
        name, equals, text = word.partition('=')
        try:
            noise[name.strip()] = float(text)
        except ValueError as error:
            raise UserError(f'--noise {word}: expected CHANNEL=STD in SI units, such as alpha=0.00035') from error
        if not equals:
            raise UserError(f'--noise {word}: expected CHANNEL=STD in SI units, such as alpha=0.00035')
    return noise


def provenance_of(arguments: argparse.Namespace, *configs: tuple[Path | None, Config]) -> Provenance:
    """What makes a report: the command, and the models that it was given, each from a parameter file or without one."""
    texts = {}
    for path, config in configs:
        folders = [str(folder.resolve()) for folder in effect_folders_of(path, arguments.words)]
        texts[str(path or 'without a parameter file')] = parameter_file(config, folders)
    return Provenance(arguments.command, texts, arguments.started)


@contextmanager
def chosen_executor(arguments: argparse.Namespace) -> Iterator[Executor]:
    """The cluster of ``--scheduler``, or all cores of this machine. Raises UserError."""
    with dask_executor(arguments.scheduler) if arguments.scheduler else executor_or_threads(None) as executor:
        yield executor
