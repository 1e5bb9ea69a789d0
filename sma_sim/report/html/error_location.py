"""Section: where the error is, in words, and split by everything that the samples can be sorted by."""

from __future__ import annotations

from sma_sim.evidence.data.display_units import in_display_unit
from sma_sim.evidence.residual_analysis.error_by_stratum import Split, splits_of
from sma_sim.evidence.residual_analysis.spectrum import Band
from sma_sim.evidence.residual_analysis.summary import Summary
from sma_sim.report.html.figures import SHOWN, new_figure
from sma_sim.report.html.page import Block, Bullets, Grid, Paragraph, Plot, Section, Tabs
from sma_sim.report.palette import GREY

BAR_HEIGHT, FRAME_HEIGHT = 38, 92  # heights [px]


def error_location_section(summary: Summary) -> Section:
    """The ranked sentences, then a tab of splits per channel."""
    words = [*(finding.text for finding in summary.patterns), *(finding.text for finding in summary.findings)]
    nothing = Paragraph('It is spread evenly, or is no more than noise.', 'lead')
    first: Block = Bullets(words, numbered=True) if words else nothing
    note = (
        'Share of the squared error (blue) beside the share of the samples (grey): longer blue than grey means that the '
        'error concentrates there. The sentences above come from a search over these classes and their combinations; '
        'stretches of the runs are drawn again for the intervals, and the search is repeated on random halves of the data.'
    )
    tabs: list[tuple[str, list[Block]]] = [
        (channel, [Grid([*(split_plot(split) for split in splits_of(summary.splits, channel)),
                         *([band_plot(channel, summary.bands[channel])] if summary.bands[channel] else [])])])
        for channel in summary.comparison.channels
    ]  # fmt: skip
    return Section('Where the error is', [first, Paragraph(note, 'note'), Tabs(tabs)])


def split_plot(split: Split) -> Plot:
    """One channel by one way to sort."""
    shares = split.shares[::-1]
    words = [
        f'RMSE {in_display_unit(split.channel, share.rmse)}, {share.over_noise:.2f} x noise, '
        f'bias {in_display_unit(split.channel, share.bias)}'
        for share in shares
    ]
    return share_plot(
        f'by {split.by}',
        [share.label for share in shares],
        [share.error for share in shares],
        [share.time for share in shares],
        words,
    )


def band_plot(channel: str, bands: tuple[Band, ...]) -> Plot:
    """One channel by frequency: share of the squared error, and what white noise would have there."""
    total = sum(band.rms**2 for band in bands)
    noise = [(band.rms / band.over_noise) ** 2 / total if band.over_noise > 0.0 else 0.0 for band in bands]
    words = [f'RMS {in_display_unit(channel, band.rms)}, {band.over_noise:.2f} x noise' for band in bands]
    labels = [f'{band.low:g} to {band.high:g} Hz' for band in bands]
    return share_plot(
        'by frequency (grey: the noise)', labels[::-1], [band.share for band in bands][::-1], noise[::-1], words[::-1]
    )


def share_plot(title: str, labels: list[str], error: list[float], other: list[float], words: list[str]) -> Plot:
    """Horizontal bars of two shares."""
    figure = new_figure()
    for name, shares, colour in (('samples', other, GREY), ('squared error', error, SHOWN)):
        figure.add_bar(
            y=labels, x=[round(100.0 * share, 3) for share in shares], orientation='h', name=name, marker_color=colour,
            customdata=words, hovertemplate='%{x:.1f} %<br>%{customdata}', showlegend=False,
        )  # fmt: skip
    figure.update_layout(
        title={'text': title, 'font': {'size': 13}, 'x': 0, 'xref': 'paper', 'xanchor': 'left'}, barmode='group',
        bargap=0.25, margin={'l': 10, 'r': 10, 't': 34, 'b': 30},
    )  # fmt: skip
    figure.update_yaxes(automargin=True, showgrid=False, type='category')
    figure.update_xaxes(ticksuffix=' %', rangemode='tozero', nticks=4, tickangle=0)
    return Plot(figure, height=BAR_HEIGHT * len(labels) + FRAME_HEIGHT)
