"""How a logger wrote a table: where it begins, separators, decimal commas, comments and a row of units."""

from __future__ import annotations

import csv
import re
from codecs import BOM_UTF16_BE, BOM_UTF16_LE
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from io import TextIOWrapper
from itertools import islice
from pathlib import Path
from typing import IO

from sma_sim.evidence.data.stated_units import known_unit
from sma_sim.evidence.data.workbook import SUFFIX, WINDOWS, open_text
from sma_sim.model.errors import UserError

MAX_LINE_LENGTH = 1_000_000  # characters; a longer line is no CSV of numbers
BLOCK_SIZE = 1 << 20  # characters of a file that are read at once: bounds the memory
SEPARATORS = {';': 'semicolons', '\t': 'tabs', '|': 'bars', ' ': 'spaces'}
COMMENTS = ('#', '//', '% ')  # what lines begin with that are comments; %time is a name
# Excel writes faults of a cell as #N/A or #REF!: they are no comments.
COMMENT_LINE = re.compile(r'(?m)^[ \t]*(?:#(?!N/?A|NV|WERT!|BEZUG!|ZAHL!|NAME\?|NULL!|NUM!|REF!|VALUE!|DIV/0!)|//|% ).*$')
EXCEL_SEPARATOR = re.compile(r'"?sep=."?')  # a first line that tells Excel the sign between cells
# Signs that stand for a comma or a point that cannot belong to a number of the file, so that no cell with it is one.
FOREIGN_COMMA, FOREIGN_POINT = '\u201a', '\u00b7'
# What data loggers write below the names of stamps, row numbers, samples and means, and programs as types of numbers.
DESCRIPTIONS = {'TS', 'RN', 'Smp', 'Avg', 'double', 'float', 'float64', 'int', 'int64'}
HEAD = 200  # lines in which a table begins: headers of data loggers have up to about a hundred
MIN_NUMBERS = 2  # in a row of a table that holds text too: a time and a quantity
SAMPLES = 3  # rows of numbers that make a table
UNIT_LABELS = frozenset(['unit', 'units', 'einheit', 'einheiten', 'y_unit_label'])  # what a line of units begins with
OPEN_QUOTE = re.compile(r'(?:^|[,;\t|]) *"[^"]*$')  # a cell that goes on in the next line; 5" is a length
MAX_BREAKS = 10  # lines in a quoted name at most
COLUMNS = 'columns'  # key of a map of tables without a header: the names of all columns
UNIT_ROWS = 2  # between the names and the numbers at most
MAX_SAID = 40  # characters of each row between them, where there are others
# What programs write where a value is missing: that of pandas, and of spreadsheets in German.
MISSING_CELLS = frozenset(
    [
        '',
        'nan',
        '-nan',
        'na',
        '<na>',
        'n/a',
        '#n/a',
        '#na',
        '#nv',
        'null',
        'none',
        *(s + '1.#' + w for s in ('', '-') for w in ('ind', 'qnan')),
    ]
)
PACKED = (b'\x1f\x8b', b'PK\x03\x04', b'BZh', b'\xfd7zXZ')  # what files of gzip, ZIP, bzip2 and xz begin with
DATE_TEXT = r'(?:\d{4}[-/]\d\d[-/]\d\d|\d\d?[./ -](?:\d\d?|[A-Za-z]{3})[./ -]\d{4},?)(?:[T ].*)?'
# Dates, times of day, durations.
SAMPLE_TEXT = re.compile(rf'{DATE_TEXT}|(?:\d+ days?,? )?\d\d?:\d\d:\d\d.*|\S+ (?:ms|sec|min|hr)')
THOUSANDS = re.compile(r'[-+]?[1-9]\d{0,2},\d{3}')  # a decimal comma, or a separator of thousands: nobody can tell
AMBIGUOUS = {  # by sign: what it may be in decimals, and how to write numbers of which everybody can tell
    ',': ('comma', 'expected points in decimals: write them so, and no separators of thousands'),
    '.': ('point', 'write no separators of thousands, or decimals with more or fewer than three digits'),
}


@dataclass(frozen=True)
class TableFormat:
    """The names in the header, the sign between cells, and how many lines stand before the numbers.

    `units`: by column, what a row of units below the header says, without brackets; `above`: lines above the numbers that
    are no table, such as those in which a data logger describes itself; `between`: what those between the names and the
    numbers say of columns that a map names; `sheet`: that of a workbook, empty for its only one.
    """

    header: Sequence[str]
    lines_before: int = 1
    separator: str = ','
    decimal_comma: bool = False
    has_comments: bool = False
    units: Mapping[str, str] = field(default_factory=dict)
    above: int = 0
    between: str = ''
    encoding: str = ''
    sheet: str = ''

    def notes(self) -> list[str]:
        """What was found that is not plain CSV."""
        found = []
        if self.separator != ',':
            found.append(f'cells are separated by {SEPARATORS[self.separator]}')
        if self.decimal_comma:
            found.append('decimals have commas')
        if self.units:
            found.append('the row of units is no sample')
        if self.above:
            passed = f', among them {self.between}' if self.between else ''
            lines = '1 line above the numbers is' if self.above == 1 else f'{self.above} lines above the numbers are'
            found.append(f'{lines} no table{passed}')
        if self.has_comments:
            found.append(f'lines that begin with {", ".join(COMMENTS).rstrip()} are comments')
        if self.encoding == WINDOWS:
            found.append(f'letters are those of Windows ({WINDOWS})')
        return [f'{"; ".join(found)}: read so'] if found else []

    def plain(self, text: str) -> str:
        """Whole lines with commas between cells and points in decimals, and no comments."""
        text = without_comments(text)
        if self.separator == ',':
            return text
        signs: dict[str, str | int | None] = {',': '.', '.': FOREIGN_POINT} if self.decimal_comma else {',': FOREIGN_COMMA}
        if self.separator != ' ':
            return text.translate(str.maketrans(signs | {self.separator: ','}))
        text = re.sub(r'(?m)^[ \t]+|[ \t]+$', '', text.translate(str.maketrans(signs)))
        return re.sub(r'[ \t]+', ',', text)

    def as_written(self, cell: str) -> str:
        """A cell of `plain` as the file has it."""
        back: dict[str, str | int | None] = {FOREIGN_COMMA: ',', FOREIGN_POINT: '.'}
        if self.decimal_comma:
            back['.'] = ','
        return cell.translate(str.maketrans(back))


def table_format(path: Path, wanted: Collection[str] = (), sheet: str = '', names: Sequence[str] = ()) -> TableFormat:
    """How a table is written; `wanted`: names of columns that a map says it has; `sheet`: that of a workbook, empty for its
    only one; `names`: those that a map gives to all columns of a table without a header.

    Raises UserError where it has no header, or its commas have two meanings.
    """
    try:
        check_text(path)
        with open_text(path, sheet) as file:
            written = replace(format_of_lines(path, file, frozenset(wanted), names), sheet=sheet)
            return replace(written, encoding=file.encoding) if isinstance(file, TextIOWrapper) else written
    except OSError as error:
        raise UserError(f'cannot read {path}: {error.strerror}') from error
    except UnicodeDecodeError as error:
        raise UserError(f'{path} is not a CSV file in UTF-8: {error}; save it with that encoding') from error
    except csv.Error as error:
        raise UserError(f'{path} is not a CSV file: {error}') from error


def check_text(path: Path) -> None:
    """Raise UserError for a binary file, such as those of LabVIEW, MATLAB or old spreadsheets."""
    with path.open('rb') as raw:
        head = raw.read(HEAD)
    if head.startswith(PACKED) and path.suffix.lower() != SUFFIX:
        raise UserError(f'{path} is packed: unpack it, or save the sheet of a workbook as CSV')
    if b'\0' in head and path.suffix.lower() != SUFFIX and head[:2] not in (BOM_UTF16_LE, BOM_UTF16_BE):
        raise UserError(f'{path} is not a CSV file: it is binary; export the table as CSV in UTF-8')


def format_of_lines(path: Path, file: IO[str], wanted: frozenset[str], given: Sequence[str]) -> TableFormat:
    """The format of an open file."""
    head = with_whole_names(list(islice(iter(lambda: file.readline(MAX_LINE_LENGTH), ''), HEAD)))
    content = [k for k, line in enumerate(head) if is_content(line)]
    if not content:
        raise UserError(f'{path} is empty: expected a header and at least one row')
    if head[content[0]].lstrip().startswith(('<', '{', '[{')):
        raise UserError(f'{path} is not a CSV file: it is HTML or JSON; export the table as CSV in UTF-8')
    if given:
        return with_decimals(path, file, format_of_numbers(path, head, content, given))
    lines = [head[k] for k in content]
    first = first_of_table(path, lines)
    separator = separator_of(lines[first], lines[first + 1] if first + 1 < len(lines) else '')
    header = cells_of_line(lines[first], separator)
    rows = units_below(header, lines[first + 1 : first + 1 + UNIT_ROWS], separator)
    passed = first + len(rows)
    between = ''
    if not wanted <= set(header) and (named := line_with_names(lines, wanted)):
        first, passed, separator = named
        header = cells_of_line(lines[first], separator)
        below = [unit_cells(line, separator) for line in lines[first + 1 : passed + 1]]
        rows = [
            cells[: len(header)] for cells in below if len(cells) >= len(header) and are_units(chosen(header, cells, wanted))
        ]
        between = said_between([chosen(header, cells, wanted) for cells in below if cells not in rows])
    at, before = content[first], content[passed] + 1
    comments = [line for line in head[:at] if COMMENT_LINE.match(line)]
    commented = [cells_of_line(line.lstrip('#/% \t'), separator) for line in comments]
    fitting = [cells for cells in commented if len(cells) == len(header) > 1]
    names = [cells for cells in fitting if not all(map(known_unit, cells))] or fitting
    if all(is_number(cell.replace(',', '.')) for cell in header) and names:
        header, rows, before = names[-1], [], at  # the header is the last comment
    above = passed - len(rows)
    first_numbers = at if before == at else next(iter(content[passed + 1 : passed + 2]), before)
    rows = rows or units_beside(header, head[:first_numbers], separator)
    units = {name: without_brackets(cell) for name, cell in zip(header, rows[0], strict=False)} if rows else {}
    later = any(COMMENT_LINE.match(line) for line in head[at:])
    units = {name: '' if unit in DESCRIPTIONS else unit for name, unit in units.items()}
    return with_decimals(
        path, file, TableFormat(header, before, separator, False, bool(comments) or later, units, above, between)
    )


def format_of_numbers(path: Path, head: Sequence[str], content: Sequence[int], names: Sequence[str]) -> TableFormat:
    """The format of a table whose columns a map names: it begins at the first rows of as many numbers. Raises UserError.

    `content`: which lines of the `head` of the file are no comments, and not empty.
    """
    lines, width = [head[k] for k in content], len(names)
    for k, line in enumerate(lines):
        likely = separator_of(line, lines[k + 1] if k + 1 < len(lines) else '')
        for separator in dict.fromkeys((likely, *SEPARATORS, ',')):
            if len(cells_of_line(line, separator)) < width or not all_samples(lines[k : k + SAMPLES], width, separator):
                continue
            before = head[: content[k]]
            check_names_above(path, [cells_of_line(one.lstrip('#/% \t'), separator) for one in before], names)
            rows = units_beside(names, before, separator)
            units = {name: without_brackets(cell) for name, cell in zip(names, rows[0], strict=False)} if rows else {}
            between = said_between([cells_of_line(one, separator) for one in lines[k - 1 : k]])
            has_comments = any(map(COMMENT_LINE.match, head))
            return TableFormat(names, content[k], separator, False, has_comments, units, k, between)
    raise UserError(
        f'{path} has no rows of {width} numbers, as many as {COLUMNS} of the map has names: {", ".join(names)[:60]}; its '
        f'first line is {lines[0].strip()[:60]!r}'
    )


def check_names_above(path: Path, rows: Sequence[Sequence[str]], names: Sequence[str]) -> None:
    """Raise UserError where a row above the numbers has names of a map in another order."""
    for row in rows:
        common = [name for name in names if name and row.count(name) == 1]
        if len(common) > 1 and any(row.index(name) != names.index(name) for name in common):
            raise UserError(
                f'{path} has names of its own, {", ".join(row)[:60]}, in another order than {COLUMNS} of the map, '
                f'{", ".join(names)[:60]}: leave {COLUMNS} out, which names those of a table without names'
            )


def with_decimals(path: Path, file: IO[str], found: TableFormat) -> TableFormat:
    """The format of an open file with what its decimals have: points or commas. Raises UserError where nobody can tell."""
    if found.separator == ',':
        return found
    file.seek(0)
    for _ in range(found.lines_before):
        file.readline(MAX_LINE_LENGTH)
    return replace(found, decimal_comma=has_decimal_commas(path, file, found.separator))


def is_content(line: str) -> bool:
    """Whether a line has cells: it is no comment, not empty, and not for Excel."""
    return bool(line.strip(' \t\r\n,;|') and not COMMENT_LINE.match(line) and not EXCEL_SEPARATOR.fullmatch(line.strip()))


def first_of_table(path: Path, lines: Sequence[str]) -> int:
    """Which of the lines with content has the names of the columns: the first above rows of as many numbers as it has names;
    line 0 where there are no such rows. Raises UserError where that would pass over numbers."""
    for are_rows in (all_samples, have_numbers):
        for k, line in enumerate(lines):
            separator = separator_of(line, lines[k + 1] if k + 1 < len(lines) else '')
            header = cells_of_line(line, separator)
            numbers = [is_number(cell.replace(',', '.')) for cell in header]
            if len(header) < 2 or all(numbers) or (k > 0 and any(numbers)) or unit_cells(line, separator) != header:
                continue
            passed = 1 + len(units_below(header, lines[k + 1 : k + 1 + UNIT_ROWS], separator))
            rows = lines[k + passed : k + passed + SAMPLES]
            if len(rows) >= min(SAMPLES, len(lines) - passed) > 0 and are_rows(rows, len(header), separator):
                if any(all_samples([one], len(header), separator) for one in lines[:k]):
                    raise UserError(
                        f'{path} has numbers above the names {", ".join(header)[:60]} too: save each table in a file'
                    )
                return k
    return 0


def line_with_names(lines: Sequence[str], wanted: frozenset[str]) -> tuple[int, int, str] | None:
    """Which of the lines with content has all names that are `wanted`, the last line before the numbers, and the separator.

    Between both may be what a logger says of its channels. None where no line has the names.
    """
    for k, line in enumerate(lines):
        separator = next((sign for sign in (*SEPARATORS, ',') if wanted <= set(cells_of_line(line, sign))), '')
        if separator:
            width = len(cells_of_line(line, separator))
            starts = (j for j in range(k + 1, len(lines)) if all_samples(lines[j : j + SAMPLES], width, separator))
            return k, next(starts, k + 1) - 1, separator
    return None


def chosen(header: Sequence[str], cells: Sequence[str], wanted: frozenset[str]) -> list[str]:
    """The cells of a row in the columns that are wanted."""
    return [cell for name, cell in zip(header, cells, strict=False) if name in wanted]


def said_between(rows: Sequence[Sequence[str]]) -> str:
    """What rows between names and numbers say, shortened."""
    return ', '.join(repr(' '.join(row))[:MAX_SAID] for row in rows if any(row))


def all_samples(lines: Sequence[str], width: int, separator: str) -> bool:
    """Whether all lines are samples of as many columns."""
    return all(is_sample(cells_of_line(line, separator), width, separator) for line in lines)


def have_numbers(lines: Sequence[str], width: int, separator: str) -> bool:
    """Whether all lines have as many columns, two of them with numbers in each line: others may hold text."""
    rows = [[cell.replace(',', '.') for cell in cells_of_line(line, separator)] for line in lines]
    fits = all(width - 1 <= len(row) and not any(row[width:]) for row in rows)
    return fits and sum(all(map(is_number, column)) for column in zip(*rows, strict=False)) >= MIN_NUMBERS


def is_sample(cells: Sequence[str], width: int, separator: str) -> bool:
    """Whether a row has a number, and nothing but numbers, dates and gaps, in as many columns; the last may be left out."""
    decimals = [cell if separator == ',' else cell.replace(',', '.') for cell in cells]
    numbers = [is_number(cell) and cell.lower() not in MISSING_CELLS for cell in decimals]
    known = [
        number or cell.lower() in MISSING_CELLS or SAMPLE_TEXT.fullmatch(cell) is not None
        for number, cell in zip(numbers, cells, strict=True)
    ]
    return any(numbers) and all(known) and not any(cells[width:]) and len(cells) >= width - 1


def units_below(header: Sequence[str], lines: Sequence[str], separator: str) -> list[list[str]]:
    """The rows of units below the names of the columns."""
    rows = list[list[str]]()
    for line in lines:
        cells = unit_cells(line, separator)
        if len(cells) < len(header) or not are_units(cells[: len(header)]):
            break
        rows.append(cells[: len(header)])
    return rows


def units_beside(header: Sequence[str], lines: Sequence[str], separator: str) -> list[list[str]]:
    """The last of the lines around the names of the columns that holds their units, as a comment or with a label before."""
    for line in reversed(lines):
        written = line.lstrip('#/% \t')
        cells = unit_cells(written, separator)[: len(header)]
        labelled = any(cells) and cells != cells_of_line(written, separator)[: len(header)]
        if labelled or (len(cells) == len(header) > 1 and all(known_unit(without_brackets(cell)) for cell in cells)):
            return [cells] if cells != list(header) else []
    return []


def unit_cells(line: str, separator: str) -> list[str]:
    """The cells of a line that may hold units, without the label at its beginning."""
    cells = cells_of_line(line, separator)
    return ['', *cells[1:]] if cells and cells[0].lower().rstrip(':') in UNIT_LABELS else cells


def with_whole_names(lines: Sequence[str]) -> list[str]:
    """The first lines of a file, those that a quoted name with line breaks goes on in all in the last of them."""
    found = list(lines)
    for k in range(len(found)):
        for end in range(k + 1, min(k + MAX_BREAKS, len(found))) if OPEN_QUOTE.search(found[k]) else ():
            if found[end].count('"') % 2:
                found[end] = ' '.join(line.strip('\r\n') for line in found[k:end]) + ' ' + found[end]
                found[k:end] = [''] * (end - k)
                break
    return found


def separator_of(line: str, following: str) -> str:
    """The sign between the cells of a header, or of numbers; spaces only where the next line has as many words."""
    for sign in ';\t|':
        if line.count(sign) > line.count(',') or are_numbers(line, sign):
            return sign
    words = len(line.split())
    has_commas = ',' in line and (', ' in line or not are_numbers(line, ' '))
    return ' ' if not has_commas and '"' not in line and words > 1 and len(following.split()) == words else ','


def are_numbers(line: str, separator: str) -> bool:
    """Whether a line has several cells with this sign between them, all of which belong to a sample."""
    cells = cells_of_line(line, separator)
    return len(cells) > 1 and is_sample(cells, len(cells), separator)


def cells_of_line(line: str, separator: str) -> list[str]:
    """The cells of one line without space around them."""
    if separator == ' ':
        return line.split()
    return [cell.strip() for cell in next(csv.reader([line], delimiter=separator), [])]


def are_units(cells: Sequence[str]) -> bool:
    """Whether a row holds units, half of which at least are known or in brackets, and no number."""
    inner = [without_brackets(cell) for cell in cells]
    filled = [(one, cell) for one, cell in zip(inner, cells, strict=True) if one not in ('', '1', '-')]
    known = [one != cell or one in DESCRIPTIONS or known_unit(one, loosely=True) != '' for one, cell in filled]
    return 2 * sum(known) >= len(known) > 0 and not any(is_number(cell) for cell in cells if cell != '1')


def without_brackets(cell: str) -> str:
    """A unit without the brackets around it."""
    return re.sub(r'^[\[(](.*)[\])]$', r'\1', cell).strip()


def without_comments(text: str) -> str:
    """Whole lines, those that are comments empty."""
    return COMMENT_LINE.sub('', text) if any(sign in text for sign in COMMENTS) else text


def has_decimal_commas(path: Path, file: IO[str], separator: str) -> bool:
    """Whether the numbers have commas; the file is not separated by commas. Raises UserError where nobody can tell.

    Semicolons are of places where decimals have commas: points before three digits each time may part thousands there.
    """
    edge = re.escape(separator)
    number = re.compile(rf'(?m)(?:^|(?<=[{edge}\s"]))[-+]?\d*[,.]\d+(?:[eE][-+]?\d+)?(?=[{edge}\s"]|$)')
    ambiguous, has_decimal_points = dict[str, str](), separator != ';'
    while text := file.read(BLOCK_SIZE):
        text += file.readline(MAX_LINE_LENGTH)
        if ',' not in text and has_decimal_points:
            continue
        for found in map(re.Match.group, number.finditer(without_comments(text))):
            sign = ',' if ',' in found else '.'
            if THOUSANDS.fullmatch(found.replace('.', ',')):
                ambiguous.setdefault(sign, found)
            elif sign == ',':
                return True
            else:
                has_decimal_points = True
    if has_decimal_points:
        ambiguous.pop('.', None)
    for sign, found in ambiguous.items():
        word, cure = AMBIGUOUS[sign]
        raise UserError(
            f'{path}: {found} has a decimal {word} or a separator of thousands, and no other number tells which; {cure}'
        )
    return False


def is_number(cell: str) -> bool:
    """Whether a cell reads as a number."""
    try:
        float(cell)
    except ValueError:
        return False
    return True
