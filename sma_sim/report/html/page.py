"""One self-contained HTML page from sections of words, tables and interactive figures.

A section is made by a function of evidence dataclasses; the page knows nothing of what they say.
plotly.js (its cartesian bundle, kept beside the templates) is written into the page once, so that the page works offline;
figures are drawn when they come into view, those in closed tabs when these are opened. `window.smaPage` tells how many
figures there are and how many are drawn.
"""

from __future__ import annotations

import base64
import gzip
import html
import json
import math
import os
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from importlib import metadata
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sma_sim.evidence.data.tables import write_whole

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
    """A table whose words wrap, and that scrolls sideways where its numbers are too wide."""
    head = ''.join(f'<th>{html.escape(cell)}</th>' for cell in table.header)
    rows = ''.join('<tr>' + ''.join(map(cell_html, row)) + '</tr>' for row in table.rows)
    caption = f'<caption>{html.escape(table.caption)}</caption>' if table.caption else ''
    return f'<div class="wide"><table>{caption}<thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table></div>'


def cell_html(cell: Cell) -> str:
    """A cell of words or of a number."""
    return f'<td{" class=words" if cell[:1].isalpha() else ""}>{html.escape(cell)}</td>'


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


# A figure as the page carries it: JSON in which long curves are packed into 16 bits per number, equal ones once.
#
# A packed curve is `{"packed": k}`: entry k of the figure's `packed` has the smallest number, the step, and the multiples of
# the step as base64 of unsigned 16-bit integers (little-endian; the largest one is a gap). templates/page.js unpacks them.
# The steps are a hundred times finer than the pixels of a screen.
STEPS, GAP = 65_534, 65_535
MIN_PACKED = 16  # numbers of a curve that is packed
BINARY = {'float64': ('f8', '<f8'), 'float32': ('f4', '<f4'), 'int32': ('i4', '<i4'), 'uint8': ('u1', '|u1')}


def figure_json(figure: Any) -> str:
    """The text of a `plotly.graph_objects.Figure`; a number that is not finite becomes null, or a gap in a curve."""
    packed: dict[str, int] = {}
    parts = {
        'data': [json_value(trace.to_plotly_json(), packed) for trace in figure.data],
        'layout': json_value(figure.layout.to_plotly_json(), packed),
        'packed': [json.loads(text) for text in packed],
    }
    return json.dumps(parts, separators=(',', ':'), allow_nan=False)


def json_value(value: Any, packed: dict[str, int]) -> Any:
    """JSON's types only; long curves of float32 go to `packed` (text of an entry: its place)."""
    if isinstance(value, dict):
        return {name: json_value(entry, packed) for name, entry in value.items()}
    if isinstance(value, np.ndarray):
        return array_json(value, packed)
    if isinstance(value, list | tuple):
        return [json_value(entry, packed) for entry in value]
    if isinstance(value, np.generic):
        return json_value(value.item(), packed)
    return None if isinstance(value, float) and not math.isfinite(value) else value


def array_json(values: NDArray[Any], packed: dict[str, int]) -> Any:
    """An array: packed, in plotly.js's own binary form, or as a list."""
    if values.dtype == np.float32 and values.ndim == 1 and len(values) >= MIN_PACKED:
        return {'packed': packed.setdefault(json.dumps(packed_curve(values)), len(packed))}
    if values.dtype.name not in BINARY or values.ndim > 2:
        return json_value(values.tolist(), packed)
    name, order = BINARY[values.dtype.name]
    shape = {} if values.ndim == 1 else {'shape': ', '.join(map(str, values.shape))}
    return {'dtype': name, 'bdata': base64_of(values.astype(order)), **shape}


def packed_curve(values: NDArray[np.float32]) -> dict[str, Any]:
    """A curve in 16-bit steps."""
    known = np.isfinite(values)
    exact = values.astype(np.float64)
    low, high = (float(exact[known].min()), float(exact[known].max())) if known.any() else (0.0, 0.0)
    step = (high - low) / STEPS or 1.0
    steps = np.full(len(values), GAP, dtype='<u2')
    steps[known] = np.rint((exact[known] - low) / step)
    return {'low': low, 'step': step, 'steps': base64_of(steps)}


def base64_of(values: NDArray[Any]) -> str:
    """The bytes of an array."""
    return base64.b64encode(values.tobytes()).decode('ascii')
