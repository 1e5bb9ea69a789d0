"""Section: the tests of a wire as a materials scientist reads them, measured and of the model."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from sma_sim.evidence.estimation.curve_features import TEMPERATURES, IsobaricTest
from sma_sim.evidence.residual_analysis.wire_tests import Characterization, EvaluatedTest
from sma_sim.model.config import Config
from sma_sim.report.html.figures import envelope, new_figure, small
from sma_sim.report.html.page import Block, Bullets, Grid, Paragraph, Plot, Section, Table
from sma_sim.report.palette import BLUE, GREEN, GREY, ORANGE, PURPLE, RED, SKY
from sma_sim.words.wire_tests import shown_cycles

LEVEL_COLOURS = (BLUE, ORANGE, GREEN, RED, PURPLE, SKY, GREY)
TEMPERATURE_COLOURS = dict(zip(TEMPERATURES, (BLUE, SKY, ORANGE, RED), strict=True))
CYCLE_VALUES: Mapping[str, Callable[[IsobaricTest], float]] = {
    **{f'{name} [deg C]': lambda test, k=k: test.temperatures[k] - 273.15 for k, name in enumerate(TEMPERATURES)},  # type: ignore[misc]
    'strain at the hottest point [%]': lambda test: 100.0 * test.hottest_strain,
    'recovered strain [%]': lambda test: 100.0 * test.recovered,
}
TEMPERATURE_LINES = {f'{name} [deg C]': colour for name, colour in TEMPERATURE_COLOURS.items()}
STRAIN_LINES = {'strain at the hottest point [%]': RED, 'recovered strain [%]': BLUE}
MAX_POINTS = 500  # of one curve
WORDS = (
    'Temperatures by tangents (the evaluation of ASTM F2082 and F3097): lines through the cold and the hot end of each way '
    'cross the steepest tangent between them. In brackets the same evaluation of the model.'
)


def characterization_section(found: Characterization, config: Config) -> Section:
    """Tables and figures of the isobaric and isothermal tests; empty without any."""
    blocks: list[Block] = []
    if found.isobaric:
        blocks += [Paragraph(WORDS), temperature_table(found.isobaric)]
        blocks += [cycle_table(test) for test in found.isobaric if test.measured.cycles]
    if found.isothermal:
        blocks.append(plateau_table(found))
    if found:
        blocks += [Bullets(slope_sentences(found, config)), Grid(figures(found, config))]
    return Section('Characterization', blocks)


def figures(found: Characterization, config: Config) -> list[Plot]:
    """The figures that the tests allow."""
    plots = [
        Plot(
            phase_diagram(found, config), 'Phase diagram. Marks: measured; lines: the model, dotted sigma_A and sigma_M', 360
        )
    ]
    if found.isobaric:
        levels = [(test, f'{1e-6 * test.measured.stress:.3g} MPa') for test in found.isobaric]
        plots = [
            Plot(
                curves_figure(levels, 'strain', ('T_K', 1.0, -273.15, 'temperature [deg C]'), (100.0, 'strain [%]')),
                'Strain over temperature. Dots: measured; lines: the model',
                360,
            ),
            *plots,
            Plot(
                over_stress(found.isobaric, lambda test: test.hysteresis, 'width of the hysteresis [K]'),
                'Width of the hysteresis over stress',
                300,
            ),
            Plot(
                over_stress(found.isobaric, lambda test: 100.0 * test.recovered, 'recovered strain [%]'),
                'Strain that heating recovers, over stress',
                300,
            ),
        ]
    for test in found.isobaric:
        if test.measured.cycles:
            plots += [
                Plot(
                    over_cycles(test, TEMPERATURE_LINES),
                    f'{label_of(test)}: transformation temperatures over the cycles. Marks: measured; lines: the model',
                    300,
                ),
                Plot(
                    over_cycles(test, STRAIN_LINES),
                    f'{label_of(test)}: strain at the hottest point, which grows by what stays behind, and recovered strain',
                    300,
                ),
            ]
    if found.isothermal:
        labelled = [(test, f'{test.measured.temperature - 273.15:.3g} deg C') for test in found.isothermal]
        plots.append(
            Plot(
                curves_figure(labelled, 'stress', ('strain', 100.0, 0.0, 'strain [%]'), (1e-6, 'stress [MPa]')),
                'Stress over strain. Dots: measured; lines: the model',
                360,
            )
        )
    return plots


def temperature_table(tests: Sequence[EvaluatedTest[IsobaricTest]]) -> Table:
    """Transformation temperatures and strains by level."""
    rows = []
    for test in tests:
        cells = [both(test, lambda one, k=k: one.temperatures[k] - 273.15, '.1f') for k in range(4)]  # type: ignore[misc]
        cells.append(both(test, lambda one: one.hysteresis, '.1f'))
        cells.append(both(test, lambda one: 100.0 * one.recovered, '.2f'))
        rows.append((label_of(test), f'{1e-6 * test.measured.stress:.4g}', *cells))
    temperatures = [f'{name} [deg C]' for name in TEMPERATURES]
    header = ('test', 'stress [MPa]', *temperatures, 'hysteresis [K]', 'recovered strain [%]')
    return Table(header, rows, 'Transformation temperatures')


def cycle_table(test: EvaluatedTest[IsobaricTest]) -> Table:
    """Transformation temperatures and strains of some of the cycles of a test, and their drift."""
    measured = test.measured.cycles
    shown = shown_cycles(len(measured))
    rows = [(str(k + 1), *(f'{value(measured[k]):.4g}' for value in CYCLE_VALUES.values())) for k in shown]
    rows.append(('drift', *(f'{last(measured[-1]) - last(measured[0]):+.3g}' for last in CYCLE_VALUES.values())))
    return Table(('cycle', *CYCLE_VALUES), rows, f'Cycles of {label_of(test)}')


def over_cycles(test: EvaluatedTest[IsobaricTest], lines: Mapping[str, str]) -> Any:
    """Features (names of CYCLE_VALUES, with their colours) over the number of the cycle, measured and of the model."""
    figure = new_figure()
    for name, colour in lines.items():
        value = CYCLE_VALUES[name]
        for cycles, mode in ((test.measured.cycles, 'markers'), (test.model.cycles if test.model else (), 'lines')):
            figure.add_scatter(
                x=list(range(1, len(cycles) + 1)),
                y=[value(one) for one in cycles],
                mode=mode,
                name=name,
                legendgroup=name,
                showlegend=mode == 'markers',
                marker={'color': colour, 'size': 6},
                line={'color': colour, 'width': 1.5},
            )
    figure.update_xaxes(title_text='cycle')
    figure.update_layout(margin_r=10)
    return figure


def plateau_table(found: Characterization) -> Table:
    """Plateau stresses and moduli by temperature."""
    rows = [
        (
            label_of(test),
            f'{test.measured.temperature - 273.15:.1f}',
            both(test, lambda one: 1e-6 * one.loading, '.0f'),
            both(test, lambda one: 1e-6 * one.unloading, '.0f'),
            both(test, lambda one: 1e-6 * one.hysteresis, '.0f'),
            both(test, lambda one: 1e-9 * one.modulus, '.1f'),
            both(test, lambda one: 100.0 * one.plateau_strain, '.2f'),
        )
        for test in found.isothermal
    ]
    header = (
        'test',
        'temperature [deg C]',
        'loading [MPa]',
        'unloading [MPa]',
        'hysteresis [MPa]',
        'modulus [GPa]',
        'plateau [%]',
    )
    return Table(header, rows, 'Plateau stresses')


def label_of(test: EvaluatedTest[Any]) -> str:
    """The name of a test, and whether it was held out."""
    return test.run.name + (' (held out)' if test.run.held_out else '')


def both(test: EvaluatedTest[Any], value: Callable[[Any], float], form: str) -> str:
    """A feature as measured, and as the model has it in brackets."""
    model = '-' if test.model is None else f'{value(test.model):{form}}'
    return f'{value(test.measured):{form}} ({model})'


def slope_sentences(found: Characterization, config: Config) -> list[str]:
    """What the measured slopes of the phase diagram are, beside that of the model."""
    own, words = 1e-6 * config.parameters['wire.sigma_T'], []
    for slope, way in zip(found.slopes, ('martensite', 'austenite'), strict=True):
        if np.isfinite(slope):
            words.append(
                f'The stress of the transformation to {way} rises by {1e-6 * slope:.3g} MPa/K (median of all pairs '
                f'of tests); sigma_T of the model is {own:.3g} MPa/K.'
            )
    return words


def curves_figure(
    tests: Sequence[tuple[EvaluatedTest[Any], str]],
    channel: str,
    over: tuple[str, float, float, str],
    shown: tuple[float, str],
) -> Any:
    """A channel of all tests over a state, a colour for each test."""
    column, scale, offset, label = over
    figure = new_figure()
    for k, (test, name) in enumerate(tests):
        colour = LEVEL_COLOURS[k % len(LEVEL_COLOURS)]
        at = envelope(test.run.measured[channel], MAX_POINTS)
        x = small(scale * test.run.states[column][at] + offset)
        figure.add_scatter(
            x=x,
            y=small(shown[0] * test.run.measured[channel][at]),
            mode='markers',
            legendgroup=name,
            showlegend=False,
            marker={'color': colour, 'size': 4, 'opacity': 0.5},
            hoverinfo='skip',
        )
        figure.add_scatter(
            x=x,
            y=small(shown[0] * test.run.predicted[channel][at]),
            mode='lines',
            legendgroup=name,
            name=name + (' (held out)' if test.run.held_out else ''),
            line={'color': colour, 'width': 1.8, 'dash': 'dash' if test.run.held_out else 'solid'},
        )
    figure.update_xaxes(title_text=label)
    figure.update_yaxes(title_text=shown[1])
    figure.update_layout(margin_r=10)
    return figure


def phase_diagram(found: Characterization, config: Config) -> Any:
    """Stress over temperature: where the transformations begin and end, measured and of the model."""
    figure = new_figure()
    for k, name in enumerate(TEMPERATURES):
        points = [(test.measured.temperatures[k], test.measured.stress) for test in found.isobaric]
        lines = [(test.model.temperatures[k], test.model.stress) for test in found.isobaric if test.model is not None]
        if points:
            add_states(figure, points, name, **marks(TEMPERATURE_COLOURS[name], 'circle'))
            add_states(figure, lines, name, **line(TEMPERATURE_COLOURS[name], 'solid'))
    for name, colour, value in (('loading', BLUE, 0), ('unloading', RED, 1)):
        points = [
            (test.measured.temperature, (test.measured.loading, test.measured.unloading)[value]) for test in found.isothermal
        ]
        if points:
            add_states(figure, points, f'plateau, {name}', **marks(colour, 'square-open'))
    add_transformation_stresses(figure, found, config)
    figure.update_xaxes(title_text='temperature [deg C]')
    figure.update_yaxes(title_text='stress [MPa]', rangemode='tozero')
    figure.update_layout(margin_r=10)
    return figure


def add_transformation_stresses(figure: Any, found: Characterization, config: Config) -> None:
    """sigma_A(T) and sigma_M(T) of the model where they are positive and measured."""
    p = config.parameters
    tests = [test.measured.stress for test in found.isobaric]
    top = 1.1 * max([*tests, *(test.measured.loading for test in found.isothermal)])
    for name, colour, part in (('sigma_A', BLUE, 0.5), ('sigma_M', RED, -0.5)):
        ends = [
            p['wire.T0'] + (stress - p['wire.sigma_MW0'] - part * p['wire.dsigma']) / p['wire.sigma_T']
            for stress in (0.0, top)
        ]
        add_states(figure, list(zip(ends, (0.0, top), strict=True)), name, **line(colour, 'dot'))


def add_states(figure: Any, states: Sequence[tuple[float, float]], name: str, **drawn: Any) -> None:
    """States (temperature [K], stress [Pa]), as marks of what was measured or as a line of the model."""
    T, stress = [T - 273.15 for T, _ in states], [1e-6 * stress for _, stress in states]
    figure.add_scatter(x=T, y=stress, name=name, legendgroup=name, **drawn)


def marks(colour: str, symbol: str) -> dict[str, Any]:
    """How measured states are drawn."""
    marker = {'color': colour, 'size': 9, 'symbol': symbol}
    return {'mode': 'markers', 'marker': marker, 'hovertemplate': '%{y:.4g} MPa at %{x:.1f} deg C'}


def line(colour: str, dash: str) -> dict[str, Any]:
    """How states of the model are drawn."""
    look = {'color': colour, 'width': 1.4, 'dash': dash}
    return {'mode': 'lines', 'line': look, 'showlegend': dash == 'dot', 'hoverinfo': 'skip'}


def over_stress(tests: Sequence[EvaluatedTest[IsobaricTest]], value: Callable[[IsobaricTest], float], label: str) -> Any:
    """A feature over the stress of the tests, measured and of the model."""
    figure = new_figure()
    figure.add_scatter(
        x=[1e-6 * test.measured.stress for test in tests],
        y=[value(test.measured) for test in tests],
        mode='markers',
        name='measured',
        marker={'color': GREY, 'size': 9, 'symbol': ['circle-open' if test.run.held_out else 'circle' for test in tests]},
    )
    known = [(test.model.stress, value(test.model)) for test in tests if test.model is not None]
    figure.add_scatter(
        x=[1e-6 * stress for stress, _ in known],
        y=[one for _, one in known],
        mode='lines+markers',
        name='model',
        line={'color': BLUE, 'width': 1.5},
        marker={'size': 5},
    )
    figure.update_xaxes(title_text='stress [MPa]')
    figure.update_yaxes(title_text=label, rangemode='tozero')
    figure.update_layout(margin_r=10)
    return figure
