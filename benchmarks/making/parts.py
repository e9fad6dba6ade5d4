"""The parts that ``make figures`` makes, and what is recorded of each that was made."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from making.probes import PROBES, TOLERANCE, Values, difference
from omnitrack_sim.base.writing import write_file

SIZES = {False: 0, True: 1}
"""Place of a size for the whole and for the quick form."""


@dataclass(frozen=True)
class Part:
    """Figures and tables that are made together.

    Attributes:
        name: of the part.
        about: what it answers.
        minutes: of one processor core, about.
        probes: names of the physics that it depends on; none for closed forms and pictures of
            pipes.
        commands: ``omnitrack ...`` or ``benchmarks/... .py ...``, one after the other. ``{out}`` is
            the part's own folder, ``{workers}`` the number of processes, ``{NAME}`` a size.
        sizes: name of a size, and its value in the whole and in the quick form.
        files: pictures and notebooks below docs, each with the one below ``{out}`` that becomes
            it.
    """

    name: str
    about: str
    minutes: float
    commands: tuple[str, ...]
    probes: tuple[str, ...] = ()
    sizes: Mapping[str, tuple[int, int]] = field(default_factory=dict)
    files: Mapping[str, str] = field(default_factory=dict)

    def lines(self, out: Path | str, workers: int = 1, quick: bool = False) -> list[str]:
        """Return the commands with folder, number of processes and sizes in their places."""
        sizes = {name: values[SIZES[quick]] for name, values in self.sizes.items()}
        return [line.format(out=out, workers=workers, **sizes) for line in self.commands]


def read_parts(manifest: Path) -> dict[str, Part]:
    """Return the parts of a manifest by name, in its order."""
    table = tomllib.loads(manifest.read_text(encoding="utf-8"))
    parts = {}
    for name, row in table.items():
        lists = {key: tuple(row[key]) for key in ("commands", "probes") if key in row}
        parts[name] = Part(name=name, **(row | lists))
        unknown = set(parts[name].probes) - set(PROBES)
        if unknown:
            raise ValueError(f"{manifest}: {name} names no probes: {', '.join(sorted(unknown))}")
    return parts


@dataclass(frozen=True)
class Record:
    """What is known of a part that was made.

    Attributes:
        commit: of the code that made it. date: ISO 8601.
        cpu_s: processor time of all its commands, s.
        older: it was made by other physics than that of the code beside it, and the pages say so.
        commands: that made it, with their sizes.
        versions: of the packages.
        probes: measurements of the probes that the part names, by probe.
    """

    commit: str
    date: str
    cpu_s: float
    older: bool = False
    commands: tuple[str, ...] = ()
    versions: Mapping[str, Any] = field(default_factory=dict)
    probes: Mapping[str, Values] = field(default_factory=dict)

    def differs(self, part: Part, physics: Mapping[str, Values]) -> list[str]:
        """Return the probes of a part whose measurements are others today than when it was made.

        Args:
            part: of the record.
            physics: measurements of today, of the part's probes at least.
        """
        return [
            name
            for name in part.probes
            if name not in self.probes or difference(self.probes[name], physics[name]) > TOLERANCE
        ]


def read_records(file: Path) -> dict[str, Record]:
    """Return the records by part; none if there is no such file."""
    if not file.is_file():
        return {}
    data = json.loads(file.read_text(encoding="utf-8"))
    measured = data["probes"]
    records = {}
    for name, row in data["parts"].items():
        probes = {probe: measured[probe][int(index)] for probe, index in row["probes"].items()}
        records[name] = Record(**(row | {"commands": tuple(row["commands"]), "probes": probes}))
    return records


def write_records(records: Mapping[str, Record], file: Path) -> None:
    """Write the records; a measurement that several parts share stands there once."""
    measured: dict[str, list[Values]] = {}
    parts = {}
    for name, record in sorted(records.items()):
        row = asdict(record)
        for probe, values in record.probes.items():
            known = measured.setdefault(probe, [])
            if values not in known:
                known.append(values)
            row["probes"][probe] = known.index(values)
        parts[name] = row
    data = {"probes": dict(sorted(measured.items())), "parts": parts}
    write_file(file, (json.dumps(data, indent=1) + "\n").encode())


def stale(
    parts: Mapping[str, Part], records: Mapping[str, Record], physics: Mapping[str, Values]
) -> dict[str, list[str]]:
    """Return the parts whose record claims today's physics and has another, with the probes."""
    found = {
        name: record.differs(parts[name], physics)
        for name, record in records.items()
        if name in parts and not record.older
    }
    return {name: probes for name, probes in found.items() if probes}


def probes_of(parts: Iterable[Part]) -> set[str]:
    """Return the names of all probes that some parts depend on."""
    return {probe for part in parts for probe in part.probes}
