"""The page as one text: markup, style, scripts and data together."""

from __future__ import annotations

import html
import json
from functools import cache
from pathlib import Path
from typing import Any

from omnitrack_sim.base.text import printable

_HERE = Path(__file__).parent
LIBRARY = _HERE / "vendor" / "three"
"""three.js as its package on npm has it (README.md in it names the release)."""
MODULES = (
    "unpack",
    "motion",
    "stage",
    "cameras",
    "arrows",
    "plots",
    "strip",
    "chart",
    "seen",
    "words",
)
"""The page's own scripts; each imports others as ``replay/NAME``."""


def page_of(data: dict[str, Any]) -> str:
    """The page that shows ``data`` of ``write.replay_data``. The same data give the same text."""
    name = data["runs"][0]["heading"]["name"]
    fields = {
        "TITLE": html.escape(printable(f"{name}, replay")),
        "STYLE": _file("style.css"),
        "DATA": _as_script(data),
        "LICENCE": html.escape(_text(LIBRARY / "LICENSE"), quote=False),
        "SCRIPTS": "\n".join(_scripts()),
    }
    page = _file("replay.html")
    for field, text in fields.items():
        before, mark, after = page.partition(f"<!--{field}-->")
        assert mark, field
        page = before + text + after
    return page


def _scripts() -> list[str]:
    """All scripts as text, which the page makes modules of."""
    library = [
        ("three-core", LIBRARY / "three.core.min.js"),
        ("three", LIBRARY / "three.module.min.js"),
        ("orbit-controls", LIBRARY / "OrbitControls.js"),
    ]
    own = [(f"replay/{name}", _HERE / "page" / f"{name}.js") for name in (*MODULES, "main")]
    return [
        f'<script type="text/plain" data-module="{name}">{_text(path)}</script>'
        for name, path in (*library, *own)
    ]


def _as_script(data: dict[str, Any]) -> str:
    """JSON that may stand in a script element: no text in it can end the element, or begin a
    comment."""
    text = json.dumps(data, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c")


def _file(name: str) -> str:
    return _text(_HERE / "page" / name)


@cache
def _text(path: Path) -> str:
    return path.read_text(encoding="utf-8")
