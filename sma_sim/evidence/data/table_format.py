"""How a logger wrote a table: separators, decimal commas, comments and a row of units, found from its first lines."""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

from sma_sim.evidence.data.foreign_columns import SPELLINGS, UNITS
from sma_sim.evidence.data.workbook import open_text
from sma_sim.model.errors import UserError

MAX_LINE_LENGTH = 1_000_000  # characters; a longer line is no CSV of numbers
BLOCK_SIZE = 1 << 20  # characters of a file that are read at once: bounds the memory
SEPARATORS = {';': 'semicolons', '\t': 'tabs', '|': 'bars', ' ': 'spaces'}
COMMENTS = ('#', '//', '% ')  # what lines begin with that are comments; %time is a name
# Excel writes faults of a cell as #N/A or #REF!: they are no comments.
COMMENT_LINE = re.compile(r'(?m)^[ \t]*(?:#(?!N/A|NAME\?|NULL!|NUM!|REF!|VALUE!|DIV/0!)|//|% ).*$')
EXCEL_SEPARATOR = re.compile(r'"?sep=."?')  # a first line that tells Excel the sign between cells
# Signs that stand for a comma or a point that cannot belong to a number of the file, so that no cell with it is one.
FOREIGN_COMMA, FOREIGN_POINT = '\u201a', '\u00b7'
THOUSANDS = re.compile(r'[-+]?[1-9]\d{0,2},\d{3}')  # a decimal comma, or a separator of thousands: nobody can tell


@dataclass(frozen=True)
class TableFormat:
    """The names in the header, the sign between cells, and how many lines stand before the numbers.

    `units`: by column, what a row of units below the header says, without brackets.
    """

    header: Sequence[str]
    lines_before: int = 1
    separator: str = ','
    decimal_comma: bool = False
    has_comments: bool = False
    units: Mapping[str, str] = field(default_factory=dict)

    def notes(self) -> list[str]:
        """What was found that is not plain CSV."""
        found = []
        if self.separator != ',':
            found.append(f'cells are separated by {SEPARATORS[self.separator]}')
        if self.decimal_comma:
            found.append('decimals have commas')
        if self.units:
            found.append('the row of units is no sample')
        if self.has_comments:
            found.append(f'lines that begin with {", ".join(COMMENTS).rstrip()} are comments')
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


def table_format(path: Path) -> TableFormat:
    """How a table is written. Raises UserError where it has no header, or its commas have two meanings."""
    try:
        with open_text(path) as file:
            return format_of_lines(path, file)
    except OSError as error:
        raise UserError(f'cannot read {path}: {error.strerror}') from error
    except UnicodeDecodeError as error:
        raise UserError(f'{path} is not a CSV file in UTF-8: {error}; save it with that encoding') from error
    except csv.Error as error:
        raise UserError(f'{path} is not a CSV file: {error}') from error


def format_of_lines(path: Path, file: IO[str]) -> TableFormat:
    """The format of an open file."""
    comments, line, before = next_line(file)
    if not line:
        raise UserError(f'{path} is empty: expected a header and at least one row')
    later, following, passed = next_line(file)
    separator = separator_of(line, following)
    header = cells_of_line(line, separator)
    commented = cells_of_line(comments[-1].lstrip('#/% \t'), separator) if comments else []
    if all(is_number(cell.replace(',', '.')) for cell in header) and len(commented) == len(header) > 1:
        header, following, passed, before = commented, line, 0, before - 1  # the header is the last comment
    below = cells_of_line(following, separator) if following else []
    units = dict(zip(header, map(without_brackets, below), strict=False))
    if len(units) != len(header) or not are_units(below[: len(header)]):
        units, passed = {}, 0
    if separator == ',':
        return TableFormat(header, before + passed, has_comments=bool(comments or later), units=units)
    file.seek(0)
    return TableFormat(
        header, before + passed, separator, has_decimal_commas(path, file, separator), bool(comments or later), units
    )


def next_line(file: IO[str]) -> tuple[list[str], str, int]:
    """The comments before the next line with content, that line, and how many lines were read."""
    comments, count = [], 0
    while line := file.readline(MAX_LINE_LENGTH):
        count += 1
        if COMMENT_LINE.match(line):
            comments.append(line.strip())
        elif line.strip() and not EXCEL_SEPARATOR.fullmatch(line.strip()):
            return comments, line.rstrip('\n'), count
    return comments, '', count


def separator_of(line: str, following: str) -> str:
    """The sign between the cells of a header; spaces only where the next line has as many words."""
    for sign in ';\t|':
        if line.count(sign) > line.count(','):
            return sign
    words = len(line.split())
    return ' ' if ',' not in line and '"' not in line and words > 1 and len(following.split()) == words else ','


def cells_of_line(line: str, separator: str) -> list[str]:
    """The cells of one line without space around them."""
    if separator == ' ':
        return line.split()
    return [cell.strip() for cell in next(csv.reader([line], delimiter=separator), [])]


def are_units(cells: Sequence[str]) -> bool:
    """Whether a row holds units, some of them in brackets, and no number."""
    inner = [without_brackets(cell) for cell in cells]
    known = {unit for units in UNITS.values() for unit in units} | set(SPELLINGS) | {'', '1', 'V', 'A', 'mA', 'mV'}
    fine = all(one in known or one != cell for one, cell in zip(inner, cells, strict=True))
    return fine and not any(is_number(cell) for cell in cells) and any(one not in ('', '-') for one in inner)


def without_brackets(cell: str) -> str:
    """A unit without the brackets around it."""
    return re.sub(r'^[\[(](.*)[\])]$', r'\1', cell).strip()


def without_comments(text: str) -> str:
    """Whole lines, those that are comments empty."""
    return COMMENT_LINE.sub('', text) if any(sign in text for sign in COMMENTS) else text


def has_decimal_commas(path: Path, file: IO[str], separator: str) -> bool:
    """Whether the numbers have commas; the file is not separated by commas. Raises UserError where nobody can tell."""
    edge = re.escape(separator)
    number = re.compile(rf'(?m)(?:^|(?<=[{edge}\s"]))[-+]?\d*,\d+(?:[eE][-+]?\d+)?(?=[{edge}\s"]|$)')
    ambiguous = ''
    while text := file.read(BLOCK_SIZE):
        text += file.readline(MAX_LINE_LENGTH)
        for found in number.finditer(without_comments(text)) if ',' in text else ():
            if not THOUSANDS.fullmatch(found.group()):
                return True
            ambiguous = ambiguous or found.group()
    if ambiguous:
        raise UserError(
            f'{path}: {ambiguous} has a decimal comma or a separator of thousands, and no other number tells which; '
            f'expected points in decimals: write them so, and no separators of thousands'
        )
    return False


def is_number(cell: str) -> bool:
    """Whether a cell reads as a number."""
    try:
        float(cell)
    except ValueError:
        return False
    return True
