"""Runs the notebooks of the documentation from top to bottom and stores what they show in them.

    python docs/tutorials/tutorial.py [NAME ...] [--out FOLDER]

It needs the groups of development (nbclient, ipykernel) and takes less than three minutes.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import nbformat
from nbclient import NotebookClient
from nbformat import NotebookNode

FOLDER = Path(__file__).parent
NOTEBOOKS = {path.stem: path for path in sorted(FOLDER.glob("*.ipynb"))}
_LONGEST = 300
"""Seconds that a cell may take."""


def executed(path: Path, folder: Path | None = None) -> NotebookNode:
    """A notebook with the outputs of a new run, and nothing in it of the machine and the time.

    Args:
        path: of it. folder: in which it runs, and leaves its files; its own by default.

    Raises:
        CellExecutionError: a cell raises; its traceback is the message.
    """
    notebook = nbformat.read(path, as_version=4)
    run = NotebookClient(notebook, timeout=_LONGEST, kernel_name="python3", record_timing=False)
    run.execute(cwd=str(folder or path.parent))
    for cell in notebook.cells:
        if cell.cell_type == "code":
            cell.metadata.clear()
            cell.outputs = [one for one in cell.outputs if one.get("name") != "stderr"]
    language = {"name": "python", "file_extension": ".py", "mimetype": "text/x-python"}
    kernel = {"name": "python3", "display_name": "Python 3", "language": "python"}
    notebook.metadata = NotebookNode(kernelspec=kernel, language_info=language)
    return notebook


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(NOTEBOOKS)}; all")
    parser.add_argument("--out", type=Path, default=FOLDER, help="where they go; default: in place")
    given = parser.parse_args()
    for name in given.names or NOTEBOOKS:
        with TemporaryDirectory() as folder:
            found = executed(NOTEBOOKS[name], Path(folder))
        nbformat.write(found, given.out / f"{name}.ipynb")
        print(f"wrote {given.out / name}.ipynb", file=sys.stderr)
