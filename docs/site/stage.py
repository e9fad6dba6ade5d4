"""Lays out the sources of the site in one folder: the pages with links that lead somewhere in it,
the files that they point to, and the pages that are made from code.

The pages themselves stay as they are, plain Markdown whose relative links work on a code host.
"""

from __future__ import annotations

import os
import re
import shutil
from pathlib import Path

from commands import write_commands
from reference import write_reference

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
CONTENTS = DOCS / "README.md"
"""The list of pages; the site's navigation."""
_LINK = re.compile(r"(?<=\]\()(?!\w+:)([^)#\s]+)(#[^)\s]+)?")
_ENTRY = re.compile(r"^\* \[(.+?)\]\((.+?)\)$", re.MULTILINE)
_HEADING = re.compile(r'^(?: *")?# (.+?)(?:\\n",)?$', re.MULTILINE)
"""The first heading of a page of Markdown, or of a notebook, in whose JSON it is a line."""
_FENCE = re.compile(r"^ *```")
_LANGUAGES = {".toml": "toml", ".xml": "xml", ".py": "python", ".cff": "yaml"}
"""Of files that a page shows."""
_ASIDE = "---\norphan: true\nnosearch: true\n---\n\n"
"""Head of a page that is reached by links alone."""


def navigation() -> dict[str, list[tuple[str, Path]]]:
    """Title and file of each page, by section, in the order of ``CONTENTS``."""
    sections: dict[str, list[tuple[str, Path]]] = {}
    for part in CONTENTS.read_text(encoding="utf-8").split("\n## ")[1:]:
        title, _, body = part.partition("\n")
        entries = [(name, (DOCS / target).resolve()) for name, target in _ENTRY.findall(body)]
        sections[title] = entries
    return sections


def _sections() -> dict[str, Path]:
    """The first page of each section of the list of pages, by the section's anchor."""
    return {f"#{title.lower().replace(' ', '-')}": own[0][1] for title, own in navigation().items()}


def misnamed() -> list[str]:
    """Pages whose heading is not their name in the navigation. The start page is the README, which
    has the project's name."""
    faults = []
    for name, path in (entry for entries in navigation().values() for entry in entries):
        heading = _HEADING.search(path.read_text(encoding="utf-8"))
        called = heading[1] if heading else None
        if pages()[path] != "index" and called != name:
            place = path.relative_to(ROOT)
            faults.append(f"{place}: its heading is {called}, its name in {CONTENTS.name} {name}")
    return faults


def pages() -> dict[Path, str]:
    """The page of the site that each file of Markdown or notebook becomes, without its ending."""
    named = {
        ROOT / "README.md": "index",
        CONTENTS: "index",
        ROOT / "benchmarks" / "README.md": "benchmarks",
        ROOT / "CHANGELOG.md": "changelog",
    }
    found = [*DOCS.rglob("*.md"), *DOCS.rglob("*.ipynb")]
    return {path: path.stem for path in found} | named


def stage(target: Path) -> list[str]:
    """Write the sources of the site into a new folder; returns the links that point to nothing."""
    target.mkdir(parents=True)
    shown: set[Path] = set()
    broken: list[str] = []
    for source, page in pages().items():
        if source == CONTENTS:
            continue
        text = _redirected(source, target, shown, broken)
        if page == "index":
            text += _toctrees()
        (target / f"{page}{source.suffix}").write_text(text, encoding="utf-8")
    for folder in sorted(shown):
        _write_folder(folder, target)
    write_commands(target)
    write_reference(target)
    return broken


def _redirected(source: Path, target: Path, shown: set[Path], broken: list[str]) -> str:
    """A page with its links to files turned to what stands for them in the site."""

    def turned(match: re.Match[str]) -> str:
        path = Path(os.path.normpath(source.parent / match[1]))
        if not path.exists():
            broken.append(f"{source.relative_to(ROOT)}: links to {match[1]}, which is not there")
            return match[1]
        if path == CONTENTS and match[2]:  # the list of pages is the navigation of the site
            return _place_of(_sections()[match[2]], target, shown)
        return _place_of(path, target, shown) + (match[2] or "")

    lines, fenced = [], False
    for line in source.read_text(encoding="utf-8").split("\n"):
        fenced ^= bool(_FENCE.match(line))
        lines.append(line if fenced else _LINK.sub(turned, line))
    return "\n".join(lines)


def _place_of(path: Path, target: Path, shown: set[Path]) -> str:
    """Where a file or folder of the project stands in the site. Files that are no page are copied;
    folders get a page that shows them."""
    found = pages()
    if path in found or path / "README.md" in found:
        page = path if path in found else path / "README.md"
        return f"{found[page]}{page.suffix}"
    if path.is_dir():
        shown.add(path)
        return f"{_folder_page(path)}.md"
    place = path.relative_to(DOCS if path.is_relative_to(DOCS) else ROOT)
    (target / place).parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(path, target / place)
    return str(place)


def _folder_page(folder: Path) -> str:
    return "files-" + "-".join(folder.relative_to(ROOT).parts)


def _write_folder(folder: Path, target: Path) -> None:
    """A page that shows the files of a folder: those that people write in full, others by size."""
    name = str(folder.relative_to(ROOT))
    parts = [f"{_ASIDE}# Files in `{name}`\n"]
    for path in sorted(path for path in folder.iterdir() if path.is_file()):
        language = _LANGUAGES.get(path.suffix)
        if language is None:
            parts.append(f"* `{path.name}`, {path.stat().st_size / 1024:.0f} KiB")
            continue
        text = path.read_text(encoding="utf-8")
        parts.append(f"\n## {path.name}\n\n````{language}\n{text.rstrip()}\n````\n")
    (target / f"{_folder_page(folder)}.md").write_text("\n".join(parts) + "\n", encoding="utf-8")


def _toctrees() -> str:
    """The navigation as Sphinx takes it, at the end of the first page."""
    found = pages()
    text = ""
    for title, entries in navigation().items():
        listed = "\n".join(
            f"{name} <{'self' if found[path] == 'index' else found[path]}>"
            for name, path in entries
        )
        text += f"\n```{{toctree}}\n:hidden:\n:caption: {title}\n\n{listed}\n```\n"
    return f"{text}\n```{{toctree}}\n:hidden:\n:caption: Python\n\napi\n```\n"
