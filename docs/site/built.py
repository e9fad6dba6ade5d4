"""What is wrong with built pages: links to nothing in them, and anything from the network."""

from __future__ import annotations

import re
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

_COLOURED = re.compile(r'</?span(?: class="[^"]*")?>')
"""What colours code: most tags of a page, and none of those that are looked at."""
_OUTSIDE = re.compile(r"(?:url\(|@import)\s*[\"']?((?:https?:)?//[^\"')\s]+)")


class _Page(HTMLParser):
    """The anchors of a page, what it links to, and what it loads."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.anchors: set[str] = set()
        self.links: list[str] = []
        self.loads: list[str] = []
        self.feed(_COLOURED.sub("", text))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = {name: value or "" for name, value in attrs}
        self.anchors |= {given[key] for key in ("id", "name") if key in given}
        if tag == "a" and "href" in given:
            self.links.append(given["href"])
        elif tag == "link" and given.get("rel") not in ("canonical", "license"):
            self.loads.append(given.get("href", ""))
        elif "src" in given:
            self.loads.append(given["src"])


def faults_of_site(folder: Path) -> list[str]:
    """Links to files or anchors that are not there, and addresses that pages load from outside."""
    # What lies below _static is the theme's own, and no page.
    pages = {path: _Page(path.read_text(encoding="utf-8")) for path in folder.glob("*.html")}
    faults = []
    for path, page in sorted(pages.items()):
        where = path.relative_to(folder)
        outside = [address for address in page.loads if urlsplit(address).netloc]
        faults += [f"{where}: loads {address} from the network" for address in outside]
        for link in [*page.links, *page.loads]:
            fault = _fault_of(link, path, pages)
            faults += [f"{where}: {fault}"] if fault else []
    for style in folder.rglob("*.css"):
        outside = _OUTSIDE.findall(style.read_text(encoding="utf-8"))
        faults += [f"{style.relative_to(folder)}: loads {address}" for address in outside]
    return faults


def _fault_of(link: str, path: Path, pages: dict[Path, _Page]) -> str | None:
    parts = urlsplit(link)
    if parts.scheme or parts.netloc:
        return None
    target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
    if not target.is_file():
        return f"links to {link}, which is not there"
    anchor = unquote(parts.fragment)
    if anchor and target in pages and anchor not in pages[target].anchors:
        return f"links to {link}, which has no such anchor"
    return None
