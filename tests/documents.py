"""The pages of the documentation, by their names."""

import sys
from pathlib import Path

DOCS = Path(__file__).parents[1] / "docs"
sys.path.append(str(DOCS / "site"))

import tables  # noqa: E402


def page(name: str) -> str:
    """Return the text of the one page of this name, in whichever folder of docs it stands, with
    the tables that are made from the code."""
    (path,) = DOCS.glob(f"*/{name}.md")
    return tables.with_tables(path.read_text(encoding="utf-8"))
