"""Figures of one step of a diagnosis: the channel that changed most, the fitted values, the errors, the screening."""

from __future__ import annotations

import math
from collections.abc import Sequence

from sma_sim.evidence.data.display_units import DISPLAY_UNITS
from sma_sim.evidence.diagnosis.conclusion import ModelStage
from sma_sim.evidence.diagnosis.review import StageChange
from sma_sim.evidence.estimation.uncertainty import GAUSS_95
from sma_sim.evidence.residual_analysis.compare import ComparedRun
from sma_sim.evidence.residual_analysis.metrics import ChannelScore, error_over_noise
from sma_sim.evidence.search.steps import CandidateFit
from sma_sim.model.parameters import Parameter
from sma_sim.report.html.figures import MEASURED, SHOWN, add_curve, envelope, interval_bars, log_axis, new_figure, small
from sma_sim.report.html.page import Plot
from sma_sim.report.palette import BLUE, GREY, ORANGE, PURPLE

MAX_CHANGE_POINTS = 1200
AS_GIVEN, BEFORE, AFTER = 'as given', 'calibrated before', 'after'
GIVEN = PURPLE
WIDE_RANGE = 10.0  # of a realistic range's ends: from here on the axis is logarithmic


def change_plot(change: StageChange, given: ComparedRun) -> Plot:
    """Measured and models in the channel that changed most, with residuals over noise below: the model as it was `given`,
    calibrated before the step, and after it."""
    channel, figure = change.channel, new_figure(2, [0.62, 0.38], gap=0.05)
    unit, factor = DISPLAY_UNITS[channel]
    at = envelope(change.before.residual(channel), MAX_CHANGE_POINTS)
    time = small(change.before.time[at])
    models = ((AS_GIVEN, given, GIVEN, 1.0), (BEFORE, change.before, ORANGE, 1.4), (AFTER, change.after, SHOWN, 1.4))
    curves = [('measured', change.before.measured[channel], MEASURED, 3.0)]
    curves += [(name, run.predicted[channel], colour, width) for name, run, colour, width in models]
    for name, values, colour, width in curves:
        hover, line = f'%{{y:.4g}} {unit} at %{{x:.2f}} s', {'color': colour, 'width': width}
        add_curve(figure, (time, factor * values[at]), name, line, hover)
    for name, run, colour, _ in models:
        hover, line = '%{y:.2f} x noise at %{x:.2f} s', {'color': colour, 'width': 1}
        add_curve(figure, (time, over_noise(run, channel, at)), name, line, hover, 2, showlegend=False)
    figure.update_yaxes(title_text=f'{channel} [{unit}]', row=1, col=1)
    figure.update_yaxes(title_text='res. / noise', nticks=5, row=2, col=1)
    figure.update_xaxes(title_text='time [s]', row=2, col=1)
    kind = 'held out' if change.held_out else 'fitted'
    words = (
        f'{channel} in {change.before.name} ({kind}), the channel that this step changed most: normalized RMSE '
        f'{error_over_noise([given], channel):.2f} of your model as it was given, {change.errors[0]:.2f} of the calibrated '
        f'one before the step, {change.errors[1]:.2f} after it. Below: measured - model over the noise.'
    )
    return Plot(figure, words, 380)


def over_noise(run: ComparedRun, channel: str, at: object) -> object:
    """Residual over noise at some samples."""
    return small(run.residual(channel)[at] / run.noise[channel])  # type: ignore[call-overload]


def range_plots(candidate: CandidateFit) -> list[Plot]:
    """A figure per fitted parameter of an effect: value and 95 % interval beside what is realistic."""
    fitted = candidate.fit.seen_values_of(candidate.name)
    stds = {name.rpartition('.')[2]: std for name, std in candidate.std.items() if f'.{candidate.name}.' in name}
    return [
        range_plot(parameter, fitted[parameter.name], stds.get(parameter.name, math.nan))
        for parameter in candidate.effect.parameters
        if parameter.name in fitted
    ]


def range_plot(parameter: Parameter, value: float, std: float) -> Plot:
    """One parameter."""
    figure, reach = new_figure(), GAUSS_95 * std
    real = parameter.realistic
    wide = real is not None and real[0] > 0.0 and real[1] >= WIDE_RANGE * real[0] and value > 0.0
    if real is not None:
        figure.add_scatter(x=list(real), y=[0, 0], mode='lines', name='realistic', line={'color': '#d5dae0', 'width': 22})
    if parameter.neutral is not None and not wide:
        figure.add_scatter(
            x=[parameter.neutral],
            y=[0],
            mode='markers',
            name='no effect',
            marker={'color': GREY, 'symbol': 'line-ns-open', 'size': 20, 'line': {'width': 2}},
        )
    below = [min(reach, 0.99 * value) if wide else reach]
    error = None if math.isnan(std) else interval_bars([reach], below, BLUE, thickness=2, width=6)
    figure.add_scatter(x=[value], y=[0], mode='markers', name='fitted', marker={'color': BLUE, 'size': 11}, error_x=error)
    figure.update_xaxes(title_text=f'{parameter.name} [{parameter.unit}]', nticks=6)
    if real is not None and wide:
        low, high = min(real[0], value), max(real[1], value)
        figure.update_xaxes(**log_axis(low / 1.3, 1.3 * high))
    figure.update_yaxes(visible=False, range=[-1, 1], fixedrange=True)
    figure.update_layout(margin={'l': 24, 'r': 24, 't': 30, 'b': 44})
    interval = '' if math.isnan(std) else f' ({value - reach:.4g} to {value + reach:.4g})'
    range_ = f'; realistic: {real[0]:g} to {real[1]:g}' if real else ''
    unit = '' if parameter.unit == '-' else f' {parameter.unit}'
    return Plot(figure, f'{parameter.name} = {value:.4g}{unit}{interval}{range_}', 150)


def channel_plot(before: ModelStage, after: ModelStage, given: Sequence[ChannelScore] = ()) -> Plot:
    """Errors by channel, held out where there is a held-out run; the channel that changed most first. `given`: of the
    model as it was given, in the same runs."""
    first = before.held_out_channel_errors or before.channel_errors
    then = after.held_out_channel_errors or after.channel_errors
    names = sorted(first, key=lambda name: then[name] / first[name])
    figure, errors = new_figure(), {score.channel: score.over_noise for score in given}
    shown = [(AS_GIVEN, errors, GIVEN)] if errors else []
    for label, values, colour in (*shown, (BEFORE, first, ORANGE), (AFTER, then, SHOWN)):
        figure.add_bar(x=names, y=[values.get(name) for name in names], name=label, marker={'color': colour})
    figure.add_hline(y=1.0, line={'color': GREY, 'dash': 'dot'})
    figure.update_yaxes(title_text='normalized RMSE')
    words = 'Normalized RMSE by channel'
    words += ', of your model as it was given, calibrated before this step, and after it' if errors else ' before and after'
    return Plot(figure, f'{words}; dotted: the noise.', 280)
