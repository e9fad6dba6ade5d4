"""Excerpts in the results of a search, also where the pages are opened from a disk.

Sphinx's search takes the excerpt of a result from its page, which it fetches. A browser fetches
nothing from a disk, so the texts of all pages go into one script, which only the page of the search
loads and which answers there.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx

FILE = "_static/page_texts.js"
_DROPPED = re.compile(
    r"<(script|style|svg|math)\b.*?</\1>|<a class=\"headerlink\".*?</a>", re.DOTALL
)
_KEPT = re.compile(r"<(?!/?(?:section|h[1-6]|p|li|td|dt|dd)\b)[^>]*>")
_ATTRIBUTES = re.compile(r"<(\w+)\b[^>]*?( id=\"[^\"]*\")?[^>]*>")
_ANSWER = """
if (location.protocol === "file:") {
  window.fetch = async (address) => {
    const name = decodeURI(new URL(address, location.href).pathname).split("/").pop();
    const text = PAGE_TEXTS[name.replace(/\\.html$/, "")] ?? "";
    return new Response(`<div role="main">${text}</div>`);
  };
}
"""


def setup(app: Sphinx) -> dict[str, bool]:
    """Collect the pages while they are written."""
    texts: dict[str, str] = {}

    def collect(app: Sphinx, page: str, template: str, context: dict[str, Any], tree: Any) -> None:
        if page == "search":
            app.add_js_file("page_texts.js")
        elif tree is not None:
            text = _KEPT.sub("", _DROPPED.sub("", context["body"]))
            texts[page] = _ATTRIBUTES.sub(r"<\1\2>", text)

    def write(app: Sphinx, error: Exception | None) -> None:
        if error is None and app.builder.format == "html":
            script = f"const PAGE_TEXTS = {json.dumps(texts)};\n{_ANSWER}"
            Path(app.outdir, FILE).write_text(script, encoding="utf-8")

    app.connect("html-page-context", collect)
    app.connect("build-finished", write)
    return {"parallel_read_safe": True, "parallel_write_safe": False}
