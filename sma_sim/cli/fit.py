"""`sma-sim fit`: calibrate the model on recordings."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import asdict
from pathlib import Path
from typing import Any

from sma_sim.cli.common.commands import add_command
from sma_sim.cli.common.data import (
    EXIT_INTERRUPTED,
    add_data_options,
    add_search_options,
    check_outputs,
    chosen_executor,
    from_curves,
    print_written,
    read_data,
    system_words,
    table_text,
    write_json,
)
from sma_sim.cli.common.options import (
    ProgressLine,
    add_config_options,
    announce_first_compilation,
    config_from,
    folders_beside,
)
from sma_sim.evidence.data.recording import Dataset
from sma_sim.evidence.data.tables import write_whole
from sma_sim.evidence.estimation.calibrate import Calibration, FitOptions, calibrate
from sma_sim.evidence.estimation.cross_validation import RunFit, evaluate_held_out
from sma_sim.evidence.estimation.free_parameters import values_of
from sma_sim.evidence.estimation.homogeneity import HomogeneityTest, homogeneity_test
from sma_sim.evidence.estimation.plausibility import implausible_data, implausible_sentence
from sma_sim.evidence.estimation.run_estimates import agreement_sentence, by_run_data
from sma_sim.evidence.residual_analysis.compare import compared_calibration
from sma_sim.evidence.residual_analysis.summary import comparison_data, summarize
from sma_sim.model.parameter_file import parameter_file
from sma_sim.report.html.comparison_page import write_fit_page


def add_parser(verbs: Any) -> None:
    """Declare the verb."""
    parser = add_command(verbs, 'fit', 'estimate parameters of the model from recordings')
    add_data_options(parser)
    parser.add_argument(
        '--free', action='append', metavar='NAMES',
        help='parameters to fit, separated by commas (default: those that such data determine, and all of active effects)',
    )  # fmt: skip
    parser.add_argument(
        '--starts', type=int, default=2, metavar='N', help='number of starting points of the optimization (default 2)'
    )
    parser.add_argument('--robust', action='store_true', help="reduce the weight of outliers (Huber's loss)")
    add_search_options(parser, 'seed of the further starting points')
    parser.add_argument(
        '-o', '--out', type=Path, metavar='FILE.yaml', help='parameter file to write, for the node and --config'
    )
    add_config_options(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Fit, predict what was held out, write what was asked for."""
    check_outputs(arguments, arguments.out)
    config = config_from(arguments, *system_words(arguments))
    fitted, held_out = read_data(arguments, config)
    (config,) = from_curves(fitted, config)
    options = FitOptions(split_names(arguments.free), arguments.model, arguments.starts, arguments.robust, arguments.seed)
    announce_first_compilation()
    progress = ProgressLine('fitting')
    with chosen_executor(arguments) as executor:
        try:
            found = calibrate(fitted, config, options, executor, lambda *state: progress.show(step_words(*state)))
        finally:
            progress.close()
        if arguments.out:
            write_fitted(arguments, found)
        predicted = predict_held_out(found, held_out, executor)
        runs = runs_of_wire(found, fitted, held_out, executor)
    print(fit_text(found, predicted))
    if runs:
        print('', *runs.sentences, sep='\n')
    if arguments.json or arguments.report:
        summary = summarize(compared_calibration(found, fitted, held_out, predicted, 'fitted'))
    if arguments.json:
        further = {'run_by_run': asdict(runs) if runs else None, 'comparison': comparison_data(summary)}
        write_json(arguments.json, fit_result_data(found, predicted, fitted) | further)
    if arguments.report:
        write_fit_page(arguments.report, found, values_of(config), summary, (fitted, held_out), runs)
    print_written(arguments.out, arguments.report, arguments.json)
    return EXIT_INTERRUPTED if found.interrupted else 0


def split_names(words: Sequence[str] | None) -> tuple[str, ...] | None:
    """Names that are joined by commas."""
    if words is None:
        return None
    return tuple(name.strip() for word in words for name in word.split(',') if name.strip())


def step_words(label: str, iteration: int, cost: float) -> str:
    """What a fit is doing."""
    return f'{label}, step {iteration}, cost {cost:.4g}'


def predict_held_out(found: Calibration, held_out: Dataset | None, executor: Executor) -> tuple[RunFit, ...]:
    """The runs that were held out, unless the fit was stopped."""
    if held_out is None or found.interrupted:
        return ()
    return evaluate_held_out(found.config, held_out, found.delay, executor)


def runs_of_wire(
    found: Calibration, fitted: Dataset, held_out: Dataset | None, executor: Executor
) -> HomogeneityTest | None:
    """A wire run by run, where there are several runs and the fit was not stopped."""
    if found.config.system != 'wire' or found.interrupted:
        return None
    return homogeneity_test(found.config, fitted, held_out, executor)


def write_fitted(arguments: argparse.Namespace, found: Calibration) -> None:
    """Write the parameter file, with a line on where it comes from."""
    names = ', '.join(fit.name for fit in found.runs)
    origin = f'# Fitted by sma-sim fit to {names}: error over noise {found.error:.4g}, delay {1e3 * found.delay:.3g} ms.\n'
    text = origin + parameter_file(found.config, folders_beside(arguments, arguments.out))
    write_whole(arguments.out, lambda file: file.write(text))


def fit_text(found: Calibration, predicted: Sequence[RunFit]) -> str:
    """The result for the terminal."""
    lines = [
        f'Fitted the {found.config.model} model in {found.iterations} iterations ({found.seconds:.1f} s)'
        + ('' if found.converged else ', not converged') + (', stopped: the best so far' if found.interrupted else '') + '.',
        '', table_text(('parameter', 'value', '95 % interval', 'unit'), parameter_rows(found)), '',
        table_text(('error over noise', *found.channel_errors, 'all'), error_rows(found, predicted)),
    ]  # fmt: skip
    remarks = remarks_on(found)
    return '\n'.join([*lines, *([''] if remarks else []), *remarks])


def parameter_rows(found: Calibration) -> list[tuple[str, str, str, str]]:
    """Name, value, interval, unit."""
    intervals = {interval.name: interval for interval in found.uncertainty.intervals} if found.uncertainty else {}
    rows = []
    for parameter in found.free:
        known = intervals.get(parameter.name)
        text = '' if known is None else f'{known.low:.5g} to {known.high:.5g}' if known.seen else 'not determined'
        rows.append((parameter.name, f'{found.values[parameter.name]:.5g}', text, parameter.unit))
    return rows


def error_rows(found: Calibration, predicted: Sequence[RunFit]) -> list[tuple[str, ...]]:
    """Errors of every run by channel, those held out last."""

    def row(name: str, channels: Mapping[str, float], error: float) -> tuple[str, ...]:
        return (name, *(f'{channels[c]:.3f}' if c in channels else '' for c in found.channel_errors), f'{error:.3f}')

    rows = [row(fit.name, fit.channel_errors, fit.error) for fit in found.runs]
    rows.append(row('fitted runs', found.channel_errors, found.error))
    return rows + [row(f'{fit.name} (held out)', fit.channel_errors, fit.error) for fit in predicted]


def remarks_on(found: Calibration) -> list[str]:
    """Further remarks on the fit."""
    remarks = [f'not determined by these data: {name}' for name in (found.uncertainty.unseen if found.uncertainty else ())]
    remarks += [f'{name} lies on a bound of the fit' for name in found.at_bound]
    remarks += [f'{parameter.name} was kept fixed: {parameter.reason}' for parameter in found.fixed]
    remarks += [implausible_sentence(found.implausible)] if found.implausible else []
    remarks += [sentence] if (sentence := agreement_sentence(found.by_run)) else []
    other = [start for start in found.other_starts if not start.same]
    if other:
        points = f'{len(other)} of {len(found.other_starts) + 1} starting points'
        remarks.append(f'{points} led to another minimum, of higher cost: see --json')
    if found.cross_validation:
        scores = ', '.join(f'{model} {error:.3f}' for model, error in found.cross_validation.items())
        remarks.append(f'error over noise of runs left out in turn: {scores}')
    if any(fit.zero for fit in found.runs):
        zeros = ', '.join(f'{fit.name} {1e6 * fit.zero:.0f}' for fit in found.runs)
        remarks.append(f'zero of the strain gauge, estimated for each recording [1e-6]: {zeros}')
    else:  # a quasi-static test has no delay
        remarks.append(f'delay of the measurement: {1e3 * found.delay:.3g} ms')
    return remarks


def fit_result_data(found: Calibration, predicted: Sequence[RunFit], dataset: Dataset) -> dict[str, Any]:
    """The result for programs; SI units."""
    uncertainty = found.uncertainty
    intervals = {interval.name: interval for interval in uncertainty.intervals} if uncertainty else {}
    return {
        'model': found.config.model,
        'parameters': {
            parameter.name: {
                'value': found.values[parameter.name], 'unit': parameter.unit, **interval_data(intervals.get(parameter.name))
            }
            for parameter in found.free
        },
        'delay': found.delay,
        'delay_std': uncertainty.delay_std if uncertainty else None,
        'error': {
            'train': found.error, 'held_out': mean_error_of(predicted), 'channels': found.channel_errors,
            'runs': {fit.name: run_data(fit, held_out=False) for fit in found.runs}
            | {fit.name: run_data(fit, held_out=True) for fit in predicted},
        },
        'cross_validation': found.cross_validation,
        'unseen': uncertainty.unseen if uncertainty else None,
        'directions': [
            {'std': direction.std, 'weights': direction.weights} for direction in uncertainty.directions
        ] if uncertainty else None,
        'correlation': uncertainty.correlation if uncertainty else None,
        'at_bound': found.at_bound,
        'implausible': [implausible_data(parameter) for parameter in found.implausible],
        'by_recording': by_run_data(found.by_run),
        'held': {parameter.name: parameter.reason for parameter in found.fixed},
        'other_starts': [
            {'excess': start.excess, 'same': start.same, 'values': start.values} for start in found.other_starts
        ],
        'noise_std': dataset.noise_std,
        'converged': found.converged,
        'interrupted': found.interrupted,
        'seconds': found.seconds,
    }  # fmt: skip


def interval_data(interval: Any) -> dict[str, Any]:
    """An interval as plain data."""
    return {} if interval is None else {name: getattr(interval, name) for name in ('low', 'high', 'std', 'log', 'seen')}


def run_data(fit: RunFit, held_out: bool) -> dict[str, Any]:
    """The errors of one run as plain data."""
    return {
        'error': fit.error,
        'channels': fit.channel_errors,
        'held_out': held_out,
        'x_M': fit.x_M,
        'start': fit.start,
        'zero': fit.zero,
    }


def mean_error_of(fits: Sequence[RunFit]) -> float | None:
    """The error over noise of several runs, None for none."""
    return float((sum(fit.error**2 for fit in fits) / len(fits)) ** 0.5) if fits else None
