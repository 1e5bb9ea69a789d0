"""One self-contained HTML page from sections of words, tables and interactive figures.

A section is made by a function of evidence dataclasses in a file of its own; the page knows nothing of what they say.
plotly.js (its cartesian bundle, kept beside the templates) is written into the page once, so that the page works offline;
figures are drawn when they come into view, those in closed tabs when these are opened. `window.smaPage` tells how many
figures there are and how many are drawn.
"""

from __future__ import annotations

import gzip
import html
import os
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from importlib import metadata
from itertools import count
from pathlib import Path
from typing import Any

from sma_sim.evidence.data.tables import write_whole
from sma_sim.report.html.figure_json import figure_json

TEMPLATES = Path(__file__).parents[1] / 'templates'
PLOTLY = 'plotly-cartesian.min.js.gz'
SHORT = 9.95  # [s] below which a time has a digit behind the point
Cell = str


@dataclass(frozen=True)
class Paragraph:
    """A paragraph of plain text; `kind` 'lead' for the one to read first, 'note' for small print."""

    text: str
    kind: str = ''


@dataclass(frozen=True)
class Bullets:
    """A list of plain sentences, numbered where their order matters."""

    items: Sequence[str]
    numbered: bool = False


@dataclass(frozen=True)
class Table:
    """A table; cells are plain text, the first column is to the left, the others to the right."""

    header: Sequence[Cell]
    rows: Sequence[Sequence[Cell]]
    caption: str = ''


@dataclass(frozen=True)
class Plot:
    """A plotly figure (`plotly.graph_objects.Figure`) with a caption; `height` [px].

    The bundle in the page draws what has x and y axes (scatter, bar, heatmap, histogram, box, contour ...), images and pies.
    """

    figure: Any
    caption: str = ''
    height: int = 320


@dataclass(frozen=True)
class Grid:
    """Small figures beside each other, as many in a row as the screen has room for."""

    plots: Sequence[Plot]


@dataclass(frozen=True)
class Tabs:
    """Blocks of which one at a time is shown, chosen by its label."""

    tabs: Sequence[tuple[str, Sequence[Block]]]


@dataclass(frozen=True)
class Code:
    """A line to be typed."""

    text: str


@dataclass(frozen=True)
class Listing:
    """A text as it is, such as that of a file, behind its title until it is opened."""

    title: str
    text: str


Block = Paragraph | Bullets | Table | Plot | Grid | Tabs | Code | Listing


@dataclass(frozen=True)
class Section:
    """A part of the page with its heading, reached from the menu at the top."""

    title: str
    blocks: Sequence[Block]


@dataclass(frozen=True)
class Provenance:
    """What made a page: the `command`, and by name the text of every parameter file that it read its model from.

    `started`: when it began, on the clock of ``time.monotonic``.
    """

    command: str
    configurations: Mapping[str, str]
    started: float


def write_page(path: Path, title: str, sections: Sequence[Section], provenance: Provenance | None = None) -> None:
    """Write one self-contained page (offline; 1.5 MB of it are plotly.js), which says what made it. Raises UserError.

    Sections without blocks are left out. All text is escaped: names from files can do no harm.
    """
    now, version = datetime.now().astimezone(), metadata.version('sma_sim')
    made = f'Made on {now:%Y-%m-%d} at {now:%H:%M:%S} (UTC{now:%z}) by sma_sim {version}.'
    shown = [section for section in sections if section.blocks]
    text = page_text(title, [*shown, *provenance_sections(provenance)], made)
    write_whole(path, lambda file: file.write(text))


def provenance_sections(provenance: Provenance | None) -> list[Section]:
    """What makes the page again."""
    if provenance is None:
        return []
    listings = [Listing(f'The model as it was given: {name}', text) for name, text in provenance.configurations.items()]
    took = f'In {os.getcwd()}; done in {elapsed_words(time.monotonic() - provenance.started)}.'
    return [Section('How this page was made', [Code(provenance.command), Paragraph(took), *listings])]


def elapsed_words(seconds: float) -> str:
    """A time that something took, such as ``3 min 20 s``."""
    if seconds < SHORT:
        return f'{seconds:.1f} s'
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    parts = [f'{hours} h'] * (hours > 0) + [f'{minutes} min'] * (hours + minutes > 0) + [f'{rest} s'] * (hours == 0)
    return ' '.join(parts)


def page_text(title: str, sections: Sequence[Section], made: str = '') -> str:
    """The text of a page; `made` says when, and by what."""
    numbers = count()
    menu = ''.join(f'<a href="#part{k}">{html.escape(section.title)}</a>' for k, section in enumerate(sections))
    body = ''.join(
        f'<section id="part{k}"><h2>{html.escape(section.title)}</h2>{blocks_html(section.blocks, numbers)}</section>'
        for k, section in enumerate(sections)
    )
    parts = {
        'title': html.escape(title),
        'made': html.escape(made),
        'menu': menu,
        'body': body,
        'style': template('page.css'),
        'script': template('page.js'),
        'plotly': plotly_script(),
    }
    page, text = template('page.html').split('{{'), ''
    for piece in page[1:]:
        name, _, rest = piece.partition('}}')
        text += parts[name] + rest
    return page[0] + text


def template(name: str) -> str:
    """A file of the page's frame."""
    return (TEMPLATES / name).read_text(encoding='utf-8')


def plotly_script() -> str:
    """plotly.js, as the text of a script element."""
    return gzip.decompress((TEMPLATES / PLOTLY).read_bytes()).decode('utf-8').replace('</script', '<\\/script')


def blocks_html(blocks: Sequence[Block], numbers: count[int]) -> str:
    """Blocks one after the other."""
    return ''.join(block_html(block, numbers) for block in blocks)


def block_html(block: Block, numbers: count[int]) -> str:
    """One block."""
    if isinstance(block, Paragraph):
        return f'<p class="{block.kind}">{html.escape(block.text)}</p>'
    if isinstance(block, Bullets):
        kind = 'ol' if block.numbered else 'ul'
        return f'<{kind}>{"".join(f"<li>{html.escape(item)}</li>" for item in block.items)}</{kind}>'
    if isinstance(block, Table):
        return table_html(block)
    if isinstance(block, Plot):
        return plot_html(block, next(numbers))
    if isinstance(block, Code):
        return f'<pre>{html.escape(block.text)}</pre>'
    if isinstance(block, Listing):
        return f'<details><summary>{html.escape(block.title)}</summary><pre>{html.escape(block.text)}</pre></details>'
    if isinstance(block, Grid):
        return f'<div class="grid">{blocks_html(block.plots, numbers)}</div>'
    return tabs_html(block, numbers)


def table_html(table: Table) -> str:
    """A table that scrolls sideways where it is too wide."""
    head = ''.join(f'<th>{html.escape(cell)}</th>' for cell in table.header)
    rows = ''.join('<tr>' + ''.join(f'<td>{html.escape(cell)}</td>' for cell in row) + '</tr>' for row in table.rows)
    caption = f'<caption>{html.escape(table.caption)}</caption>' if table.caption else ''
    return f'<div class="wide"><table>{caption}<thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table></div>'


def plot_html(plot: Plot, number: int) -> str:
    """An element for a figure, and its data."""
    data = figure_json(plot.figure).replace('</', '<\\/')
    caption = f'<figcaption>{html.escape(plot.caption)}</figcaption>' if plot.caption else ''
    return (
        f'<figure><div class="plot" id="plot{number}" style="height:{plot.height}px"></div>'
        f'<script type="application/json" id="data{number}">{data}</script>{caption}</figure>'
    )


def tabs_html(tabs: Tabs, numbers: count[int]) -> str:
    """Buttons and the panes that they show, the first open."""
    if len(tabs.tabs) == 1:
        return blocks_html(tabs.tabs[0][1], numbers)
    buttons = ''.join(
        f'<button type="button" role="tab" aria-selected="{str(k == 0).lower()}">{html.escape(label)}</button>'
        for k, (label, _) in enumerate(tabs.tabs)
    )
    panes = ''.join(
        f'<div class="pane" role="tabpanel"{"" if k == 0 else " hidden"}>{blocks_html(blocks, numbers)}</div>'
        for k, (_, blocks) in enumerate(tabs.tabs)
    )
    return f'<div class="tabs"><div class="buttons" role="tablist">{buttons}</div>{panes}</div>'
