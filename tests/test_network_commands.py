"""The command `omnitrack network` prints what the network and the route hold."""

from __future__ import annotations

import re

import pytest
from typer.testing import CliRunner

import omnitrack_sim as ot
from omnitrack_sim.cli import app
from omnitrack_sim.cli.common import out

NETWORK = ot.load_network("fig14")


@pytest.fixture(autouse=True)
def wide(monkeypatch):
    """A terminal on which no line is wrapped, whatever made the console before."""
    monkeypatch.setattr(out, "_width", 200)


def printed(*arguments: str) -> list[list[str]]:
    """The cells of each line that the command prints."""
    run = CliRunner().invoke(app, ["network", *arguments], env={"COLUMNS": "200"})
    assert run.exit_code == 0, run.output
    return [re.split(r" {2,}", line.strip()) for line in run.stdout.splitlines()]


def test_each_part_is_printed_with_its_ports_and_what_they_join():
    """A part's name, kind and sizes once, a line a port; open ends by their names; the sum."""
    rows = printed("fig14")
    named = {port: name for name, port in NETWORK.ports.items()}
    expected = []
    for fitting in NETWORK.fittings:
        for number, port in enumerate(fitting.fitting().port_names):
            end = f"{fitting.name}.{port}"
            name = f" ({named[end]})" if end in named else ""
            head = [] if number else [fitting.name, fitting.kind]
            expected.append([*head, port, NETWORK.joined_to.get(end) or f"open{name}"])
    first = [cell for cell in rows[0] if cell]
    assert first == ["part", "kind", "sizes", "port", "joined to"]
    found = rows[1 : 1 + len(expected)]
    # Sizes stand third where a part has its name.
    assert [row if len(row) == 2 else [*row[:2], *row[3:]] for row in found] == expected
    ends, total = rows[1 + len(expected) :]
    told = " ".join(ends).removeprefix("open ends: ").split(", ")
    assert told == [f"{end} ({named[end]})" for end in NETWORK.open_ends]
    assert total == [f"{len(NETWORK.fittings)} parts, {NETWORK.length:.3f} m of axis in all"]


@pytest.mark.parametrize(
    ("table", "sizes"),
    [
        ('kind = "straight"\nlength = 0.7', "D 160 mm, L 700 mm"),
        ('kind = "elbow"\nmean_radius = 0.09\nangle_deg = 45', "D 160 mm, Rm 90 mm, 45 deg"),
        (
            'kind = "reducer"\nlength = 0.3\ninner_diameter = 0.2\nend_diameter = 0.15',
            "D 200 to 150 mm, L 300 mm",
        ),
    ],
)
def test_sizes_of_a_part_are_in_millimetres_and_degrees(table, sizes, tmp_path):
    """Bores that are equal once, then lengths and angles by the signs of drawings."""
    file = tmp_path / "one.toml"
    file.write_text(f'[[fittings]]\nname = "p"\n{table}\n')
    assert printed(str(file))[1][2] == sizes


def test_a_route_is_printed_by_its_passages():
    """Name, manoeuvre, where it begins and its length, m; then the sum and how many."""
    route = ot.shortest_route(NETWORK, "inlet", "side")
    rows = printed("fig14", "--from", "inlet", "--to", "side")
    begin = rows.index(["passes", "manoeuvre", "from, m", "length, m"]) + 1
    expected = [
        [
            NETWORK.fittings[passage.index].name,
            passage.words,
            f"{passage.s_enter:.3f}",
            f"{passage.s_leave - passage.s_enter:.3f}",
        ]
        for passage in route.passages
    ]
    assert rows[begin : begin + len(expected)] == expected
    total = f"route: {route.centreline.length:.3f} m through {len(route.passages)} parts"
    assert rows[begin + len(expected)] == [total]
