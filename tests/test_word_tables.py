"""Tables on the terminal keep words whole."""

from __future__ import annotations

import io
import re

import pytest
from rich.console import Console

from omnitrack_sim.cli.word_table import LONG_WORD, WordTable, fitted
from omnitrack_sim.robots.kinds import ROBOTS, robot_class

HEADS = ("parameter", "value", "range", "unit", "provenance", "source")


def printed(table: WordTable, width: int) -> str:
    """A table as it is printed on a terminal of ``width`` columns."""
    console = Console(width=width, color_system=None)
    with console.capture() as capture:
        console.print(table)
    return capture.get()


def parameters(kind: str) -> tuple[WordTable, set[str]]:
    """The table of a robot's parameters, and the words in it."""
    table, words = WordTable(*HEADS, gap=1), set[str]()
    for row in robot_class(kind)().parameters():
        within = "" if row.within is None else "{:.6g} to {:.6g}".format(*row.within)
        value = f"{row.value:.6g}" if isinstance(row.value, float) else str(row.value)
        cells = (row.name, value, within, row.unit, row.provenance, row.source)
        table.add_row(*(cell.replace("[", r"\[") for cell in cells))
        words.update(word for cell in cells for word in cell.split())
    return table, words


@pytest.mark.parametrize("kind", sorted(set(ROBOTS) - {"mjcf"}))
@pytest.mark.parametrize("width", [80, 120])
def test_words_of_parameters_are_whole_on_a_terminal_of_80_columns(kind: str, width: int) -> None:
    """Each stands on one line, but for long ones, which go on behind a slash, a hyphen or a dot; no
    line is longer than the terminal, and nothing is left out."""
    table, words = parameters(kind)
    text = printed(table, width)
    assert max(map(len, text.splitlines())) <= width
    found = set(text.split())
    for word in words - found:
        assert len(word) >= LONG_WORD
        pieces = [piece for piece in re.split(r"(?<=[a-z][/.-])(?=[a-z])", word) if piece]
        assert len(pieces) > 1, word
        assert all(any(piece in other for other in found) for piece in pieces), word


def test_a_word_is_parted_only_where_it_must() -> None:
    """Where the longest words of all columns do not fit next to each other, they are parted; with
    room for one letter more they are not."""
    table = WordTable("a", "b", gap=1)
    table.add_row("tracking", "centreline")
    assert {"tracking", "centreline"} <= set(printed(table, 20).split())
    narrow = printed(table, 19)
    assert not {"tracking", "centreline"} <= set(narrow.split())
    letters = "".join(narrow.split())
    assert sorted(letters) == sorted("abtrackingcentreline")


def test_columns_give_way_in_proportion_to_their_need() -> None:
    """None gets narrower than its longest word as long as another has room to give."""
    assert fitted([3, 5], [10, 40], 60) == [10, 40]
    assert fitted([3, 5], [10, 40], 30) == [10, 20]
    assert fitted([9, 5], [10, 40], 16) == [9, 7]
    assert sum(fitted([9, 9], [10, 40], 12)) == 12


def test_a_long_word_is_never_cut_off() -> None:
    """Where no column can give way, a word goes on in the next line, without an ellipsis."""
    table = WordTable("name")
    table.add_row("x" * 30)
    text = printed(table, 12)
    assert "…" not in text
    assert text.count("x") == 30


def test_titles_and_styles_of_rows_are_kept():
    """A title above its table, and rows in the style they were given."""
    table = WordTable("name", "value")
    table.title, table.title_justify = "turn", "left"
    table.add_row("all", "3", style="bold")
    table.add_row("one", "2")
    console = Console(width=40, force_terminal=True, color_system="standard", file=io.StringIO())
    console.print(table)
    title, _, first, second = console.file.getvalue().splitlines()
    assert "turn" in title
    assert "\x1b[1m" in first
    assert "\x1b[1m" not in second
