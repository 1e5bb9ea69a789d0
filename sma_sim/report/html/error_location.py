"""Section: where the error is, in words, and split by everything that the samples can be sorted by."""

from __future__ import annotations

from sma_sim.evidence.data.display_units import in_display_unit
from sma_sim.evidence.residual_analysis.error_by_stratum import Split
from sma_sim.evidence.residual_analysis.metrics import error_over_noise
from sma_sim.evidence.residual_analysis.spectrum import Band
from sma_sim.evidence.residual_analysis.summary import Summary
from sma_sim.report.html.figures import SHOWN, new_figure
from sma_sim.report.html.page import Block, Bullets, Grid, Paragraph, Plot, Section, Tabs
from sma_sim.report.palette import GREY
from sma_sim.words.comparison import spread_sentence

BAR_HEIGHT, FRAME_HEIGHT = 38, 92  # heights [px]
MAX_SENTENCES = 5  # before the channels, each of which has all of its own
SEARCH_NOTE = (
    'The sentences come from a search over the classes below and their combinations, the most important first; all of them '
    'stand with their channel. Stretches of the runs are drawn again for the intervals, and the search is repeated on '
    'random halves of the data. '
)
SPLIT_NOTE = (
    'In the figures the share of the squared error (blue) is beside the share of the samples (grey): longer blue than grey '
    'means that the error concentrates there.'
)


def error_location_section(summary: Summary) -> Section:
    """The most important sentences, then a tab per channel, the worst first: all that is said of it, and its splits."""
    remarks, names = summary.remarks, by_error(summary)
    lead: Block = Paragraph(spread_sentence(summary), 'lead')
    if remarks:
        lead = Bullets([remark.text for remark in remarks[:MAX_SENTENCES]], numbered=True)
    note = (SEARCH_NOTE if remarks else '') + SPLIT_NOTE
    tabs: list[tuple[str, list[Block]]] = [
        (f'{channel}: {error:.3g} x noise', channel_blocks(summary, channel)) for channel, error in names.items()
    ]
    return Section('Where the error is', [lead, Paragraph(note, 'note'), Tabs(tabs)])


def by_error(summary: Summary) -> dict[str, float]:
    """The normalized RMSE of each channel in all runs, the largest first."""
    found = {channel: error_over_noise(summary.comparison.runs, channel) for channel in summary.comparison.channels}
    return dict(sorted(found.items(), key=lambda item: -item[1]))


def channel_blocks(summary: Summary, channel: str) -> list[Block]:
    """What is said of a channel, and its splits."""
    sentences = [remark.text for remark in summary.remarks if remark.channel == channel]
    bands = [band_plot(channel, summary.bands[channel])] if summary.bands[channel] else []
    splits = Grid([*(split_plot(split) for split in summary.splits if split.channel == channel), *bands])
    return [*([Bullets(sentences)] if sentences else []), splits]


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
            y=labels,
            x=[round(100.0 * share, 3) for share in shares],
            orientation='h',
            name=name,
            marker_color=colour,
            customdata=words,
            hovertemplate='%{x:.1f} %<br>%{customdata}',
            showlegend=False,
        )
    figure.update_layout(
        title={'text': title, 'font': {'size': 13}, 'x': 0, 'xref': 'paper', 'xanchor': 'left'},
        barmode='group',
        bargap=0.25,
        margin={'l': 10, 'r': 10, 't': 34, 'b': 30},
    )
    figure.update_yaxes(automargin=True, showgrid=False, type='category')
    figure.update_xaxes(ticksuffix=' %', rangemode='tozero', nticks=4, tickangle=0)
    return Plot(figure, height=BAR_HEIGHT * len(labels) + FRAME_HEIGHT)
