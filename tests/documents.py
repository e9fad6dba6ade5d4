"""The pages of the documentation, by their names."""

import sys
from pathlib import Path

DOCS = Path(__file__).parents[1] / "docs"
sys.path.append(str(DOCS / "site"))

import tables  # noqa: E402, F401  (for the tests of the pages)


def page(name: str) -> str:
    """Return the text of the one page of this name, in whichever folder of docs it stands."""
    (path,) = DOCS.glob(f"*/{name}.md")
    return path.read_text(encoding="utf-8")
