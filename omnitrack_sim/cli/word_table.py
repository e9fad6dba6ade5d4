"""Tables on the terminal that keep words whole."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

from rich.console import Console, ConsoleOptions, RenderResult
from rich.table import Table
from rich.text import Text

LONG_WORD = 10
"""Letters from which on a word may be parted after a slash, a hyphen or a dot, as paths are."""
_JOINT = re.compile(r"(?<=[^\W\d][/.-])(?=[^\W\d])")


class WordTable(Table):
    """A table without lines whose columns are no narrower than their longest word.

    It gives up room beside the columns where they need it, and parts words only where they do not
    fit next to each other in the terminal's width.

    Args:
        heads: of the columns.
        gap: blanks on either side of a column.
    """

    def __init__(self, *heads: str, gap: int = 2) -> None:
        super().__init__(*heads, box=None, padding=(0, gap))

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Wrap the cells to the width of the console, and yield the table of these."""
        columns = [
            [_text(console, cell) for cell in (column.header, *column._cells)]
            for column in self.columns
        ]
        words = [[_lengths_of_words(text) for text in column] for column in columns]
        least = [max((n for each in column for n in each), default=0) for column in words]
        most = [max(_length(text) for text in column) for column in columns]
        gaps = self.padding[1] + self.padding[3], 1
        gap = next((n for n in gaps if sum(least) + n * len(least) <= options.max_width), gaps[-1])
        widths = fitted(least, most, options.max_width - gap * len(least))
        padding = self.padding if gap == gaps[0] else (0, 1, 0, 0)
        table = Table(
            title=self.title,
            title_justify=self.title_justify,
            box=None,
            padding=padding,
            show_header=self.show_header,
        )
        wrapped = [
            [_wrapped(text, width) for text in column]
            for column, width in zip(columns, widths, strict=True)
        ]
        for column, (head, *_), width in zip(self.columns, wrapped, widths, strict=True):
            table.add_column(head, justify=column.justify, width=width, overflow="fold")
        rows = zip(*(column[1:] for column in wrapped), strict=True)
        for cells, row in zip(rows, self.rows, strict=True):
            table.add_row(*cells, style=row.style)
        yield table


def fitted(least: Sequence[int], most: Sequence[int], room: int) -> list[int]:
    """Return widths of columns that take up ``room`` letters at most, where they can.

    Columns that are wider than they need be give way first, the widest of them the most.

    Args:
        least: width of the longest word in each column.
        most: width with which nothing is wrapped.
        room: letters for all columns together.
    """
    widths = list(most)
    for floors in (least, [1] * len(widths)):
        while sum(widths) > room:
            spare = [i for i, floor in enumerate(floors) if widths[i] > floor]
            if not spare:
                break
            widths[max(spare, key=widths.__getitem__)] -= 1
    return widths


def _text(console: Console, cell: object) -> Text:
    return cell if isinstance(cell, Text) else console.render_str(str(cell))


def _length(text: Text) -> int:
    return max(map(len, text.plain.split("\n")))


def _pieces(line: str) -> Iterable[str]:
    """Yield the pieces of a line that stay whole, with the blanks behind them."""
    for word in re.findall(r"\s*\S+\s*|\s+", line):
        yield from _JOINT.split(word) if len(word.strip()) >= LONG_WORD else [word]


def _lengths_of_words(text: Text) -> list[int]:
    return [len(piece.strip()) for line in text.plain.split("\n") for piece in _pieces(line)]


def _wrapped(text: Text, width: int) -> Text:
    """Return a text whose lines are parted between words to be no longer than ``width``."""
    lines = []
    for line in text.split("\n", allow_blank=True):
        offsets, begin, end = [], 0, 0
        for piece in _pieces(line.plain):
            if end > begin and end + len(piece.rstrip()) - begin > width:
                offsets.append(end)
                begin = end
            end += len(piece)
        lines += line.divide(offsets)
    for line in lines:
        line.rstrip()
    return Text("\n").join(lines)
