"""Makes every figure and table of README and docs from the code as it is.

python benchmarks/make_figures.py [PART ...] [--list] [--stale] [--again] [--older]
    [--quick] [--workers N]

docs/figures.toml lists the parts: what each runs, which pictures it writes, and how long it takes.
Without PART all are made, hours on one core. As many parts as --workers are made side by side, the
longest first. A part that was made by today's physics is left out; one that was broken off goes on
behind its last finished command, and its sweeps behind their last batch. What a part makes is put
in place when all of it is there: pictures below docs, tables between the marks of the pages, and a
record in docs/figures.json with commit, date, processor time, and what short runs (probes) measure.
By these a test finds the parts whose physics has changed. A sentence of a page that quotes a figure
which its part no longer prints is named on standard error, with exit status 1: mend it by hand.

--stale makes the parts whose physics has changed, of those that are made. --older runs nothing: it
marks such parts, or those that are named, as made by older physics, and the pages say so. --quick
tries everything with few trials, in out/figures_quick, on a copy of the pages.
"""

from __future__ import annotations

import argparse
import datetime
import json
import os
import shlex
import shutil
import subprocess
import sys
import threading
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from making import pages
from making.parts import (
    Part,
    Record,
    probes_of,
    read_parts,
    read_records,
    stale,
    write_records,
)
from making.probes import Values, measured_all

from omnitrack_sim.base.text import counted, no_such
from omnitrack_sim.base.writing import write_file
from omnitrack_sim.results.provenance import environment

ROOT = Path(__file__).resolve().parents[1]
MADE = "made.json"
"""In a part's folder: what is being made there, and the processor time of each finished command."""


class Failed(Exception):
    """A command ended with another status than 0, or left a picture out."""


class Maker:
    """Makes parts and keeps their records.

    Attributes:
        parts: of the manifest. records: of those that were made.
        docs: folder of the pages. out: where the commands write.
        workers: processes of a command, where it can use several.
        physics: measurements of today, of all probes that some part needs.
    """

    def __init__(self, manifest: Path, docs: Path, out: Path, workers: int, quick: bool) -> None:
        self.parts, self.docs, self.out = read_parts(manifest), docs, out
        self.workers, self.quick = workers, quick
        self.file = docs / "figures.json"
        self.records = read_records(self.file)
        self.physics: dict[str, Values] = {}
        # Parts that are made side by side fill the same pages and the same file of records.
        self._placing = threading.Lock()

    def measure(self, names: list[str]) -> None:
        """Measure the probes that some parts need."""
        wanted = probes_of(self.parts[name] for name in names) - set(self.physics)
        self.physics |= measured_all(wanted)

    def complete(self, name: str) -> bool:
        """Return whether a part was made in full by today's physics and by these commands."""
        part, record = self.parts[name], self.records.get(name)
        return (
            record is not None
            and not record.older
            and list(record.commands) == part.lines("OUT", quick=self.quick)
            and not record.differs(part, self.physics)
            and all((self.docs / picture).is_file() for picture in part.files)
        )

    def make(self, name: str, again: bool = False) -> list[str]:
        """Run what is left of a part, and put its pictures, tables and record in place.

        Returns:
            Sentences of pages, each behind its page's name, that quote a figure which the part has
            printed before and does not print any longer.
        """
        part, folder = self.parts[name], self.out / name
        probes = {probe: self.physics[probe] for probe in part.probes}
        asked = {"commands": part.lines("OUT", quick=self.quick), "probes": probes}
        kept = folder / MADE
        state = json.loads(kept.read_text()) if kept.is_file() else None
        if again or state is None or {key: state[key] for key in asked} != asked:
            shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir(parents=True)
            state = asked | {"cpu_s": []}
            write_file(kept, json.dumps(state).encode())
        for number, line in enumerate(part.lines(folder, self.workers, self.quick)):
            if number >= len(state["cpu_s"]):
                printed, seconds = run(line)
                write_file(folder / f"{number}.md", printed)
                state["cpu_s"].append(round(seconds, 1))
                write_file(kept, json.dumps(state).encode())
        printed = "\n".join(
            (folder / f"{number}.md").read_text(encoding="utf-8")
            for number in range(len(part.commands))
        )
        record = Record(
            commit=commit(),
            date=datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
            cpu_s=round(sum(state["cpu_s"]), 1),
            commands=tuple(asked["commands"]),
            versions=environment()["versions"],
            probes=probes,
        )
        with self._placing:
            return self._put(part, record, pages.pieces(printed))

    def _put(self, part: Part, record: Record, made: Mapping[str, str]) -> list[str]:
        """Put what a part has made in place: pictures, pages, then the record; see ``make``."""
        missing = [name for name in part.files.values() if not self._made(part, name).is_file()]
        wanted = {
            match["piece"]
            for page in pages.pages_of(self.docs)
            for match in pages.MARK.finditer(page.read_text(encoding="utf-8"))
            if match["part"] == part.name
        }
        missing += [f"## {piece}" for piece in sorted(wanted - set(made))]
        if missing:
            raise Failed(f"{part.name} did not make {', '.join(missing)}")
        # Another run may have made other parts in the meantime.
        self.records = read_records(self.file) | {part.name: record}
        for target, source in part.files.items():
            write_file(self.docs / target, self._made(part, source).read_bytes())
        stale = [
            f"{page.relative_to(self.docs.parent)}: {sentence}"
            for page in pages.pages_of(self.docs)
            for sentence in pages.stale_sentences(page.read_text("utf-8"), part.name, made)
        ]
        self.fill({part.name: made})
        write_records(self.records, self.file)
        return stale

    def _made(self, part: Part, name: str) -> Path:
        return self.out / part.name / name

    def fill(self, made: Mapping[str, Mapping[str, str]]) -> None:
        """Fill the pages with pieces by part; say of the others, and at the foot, what made them.

        Parts that are not in ``made`` keep their text, with the note that their record asks for.
        """
        for page in pages.pages_of(self.docs):
            text = page.read_text(encoding="utf-8")

            def body(match) -> str:
                name = match["part"]
                own = made.get(name, {}).get(match["piece"], match["body"])
                return pages.with_note(own, name, self.records.get(name))

            names = pages.parts_of(page, self.docs, self.parts)
            new = pages.with_foot(pages.filled(text, body), pages.foot(names, self.records))
            if new != text:
                write_file(page, new.encode())

    def mark_older(self, names: list[str]) -> None:
        """Say of parts that were made that other physics has made them."""
        for name in names:
            if name in self.records:
                row = vars(self.records[name]) | {"older": True, "probes": {}}
                self.records[name] = Record(**row)
        write_records(self.records, self.file)
        self.fill({})


def run(line: str) -> tuple[bytes, float]:
    """Run a command of a part; returns what it prints, and its processor time, s.

    Raises:
        Failed: it ended with another status than 0.
    """
    words = shlex.split(line)
    start = ["-m", "omnitrack_sim.cli"] if words[0] == "omnitrack" else [str(ROOT / words[0])]
    command = [sys.executable, *start, *words[1:]]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as process:
        printed = process.stdout.read() if process.stdout else b""
        # getrusage() would count the children of all parts that are made side by side.
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise Failed(f"status {process.returncode} of: {line}")
    return printed, used.ru_utime + used.ru_stime


def commit() -> str:
    """Return the commit of the checkout, with ``+changes`` where its code is another.

    Pages and pictures, which are being made, do not count.
    """
    code = ["omnitrack_sim", "scenarios", "benchmarks"]
    git = ["git", "-C", str(ROOT)]
    head = subprocess.run([*git, "rev-parse", "HEAD"], capture_output=True, text=True, check=True)
    changed = subprocess.run(
        [*git, "status", "--porcelain", "--", *code], capture_output=True, text=True, check=True
    )
    return head.stdout.strip() + ("+changes" if changed.stdout else "")


def copied(docs: Path, target: Path) -> Path:
    """Copy the pages and pictures, for a trial; returns the folder of the copies."""
    shutil.copytree(docs, target / "docs", dirs_exist_ok=True)
    shutil.copyfile(docs.parent / "README.md", target / "README.md")
    return target / "docs"


def main() -> None:
    """Make the parts that are asked for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("parts", nargs="*", metavar="PART", help="of docs/figures.toml; all")
    parser.add_argument("--list", action="store_true", help="show the parts and run nothing")
    parser.add_argument("--stale", action="store_true", help="parts whose physics has changed")
    parser.add_argument("--again", action="store_true", help="from the beginning")
    parser.add_argument("--older", action="store_true", help="mark as made by older physics")
    parser.add_argument("--quick", action="store_true", help="few trials, on a copy of the pages")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--manifest", type=Path, default=ROOT / "docs" / "figures.toml")
    parser.add_argument("--docs", type=Path, default=ROOT / "docs")
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "figures")
    given = parser.parse_args()
    out = given.out.with_name(given.out.name + "_quick") if given.quick else given.out
    docs = copied(given.docs, out / "pages") if given.quick else given.docs
    maker = Maker(given.manifest, docs, out, 1, given.quick)
    unknown = [name for name in given.parts if name not in maker.parts]
    if unknown:
        parser.exit(2, "".join(f"{no_such(one, list(maker.parts), 'part ')}\n" for one in unknown))
    names = given.parts or list(maker.parts)
    if given.list:
        show(maker, names)
        return
    if given.stale or (given.older and not given.parts):
        maker.measure(list(maker.records))
        names = [name for name in stale(maker.parts, maker.records, maker.physics) if name in names]
    if given.older:
        maker.mark_older(names)
        return
    maker.measure(names)
    sys.exit(1 if make_all(maker, names, given.again, given.workers) else 0)


def make_all(maker: Maker, names: list[str], again: bool, workers: int) -> list[str]:
    """Make parts, so many side by side; returns those that failed.

    A part that is made alone has all workers for its commands.
    """
    wanted = []
    for name in names:
        if maker.complete(name) and not again:
            print(f"{name}: made by today's physics", flush=True)
        else:
            wanted.append(name)
    maker.workers = max(1, workers // max(1, len(wanted)))
    wanted.sort(key=lambda name: -maker.parts[name].minutes)  # so that all end at about one time
    with ThreadPoolExecutor(workers) as pool:
        good = pool.map(lambda name: make_one(maker, name, again), wanted)
        return [name for name, made in zip(wanted, good, strict=True) if not made]


def make_one(maker: Maker, name: str, again: bool) -> bool:
    """Make a part and say how it went; returns whether it was made, and no sentence is stale."""
    print(f"{name}: about {maker.parts[name].minutes:g} min of one core", flush=True)
    try:
        stale = maker.make(name, again)
    except Failed as fault:
        print(f"{name}: {fault}", file=sys.stderr, flush=True)
        return False
    print(f"{name}: {pages.minutes(maker.records[name].cpu_s)}", flush=True)
    for sentence in stale:
        print(f"{name} no longer prints a figure of {sentence}", file=sys.stderr, flush=True)
    return not stale


def show(maker: Maker, names: list[str]) -> None:
    """Print the parts with their cost and the commit that made them."""
    for name in names:
        part, record = maker.parts[name], maker.records.get(name)
        made = "not made" if record is None else f"commit {record.commit[:7]}"
        made += ", older physics" if record is not None and record.older else ""
        print(f"{name:20s} {part.minutes:6.1f} min  {made:30s} {part.about}")
    total = sum(maker.parts[name].minutes for name in names)
    print(f"{counted(len(names), 'part')}, {total:.0f} min of one core")


if __name__ == "__main__":
    main()
