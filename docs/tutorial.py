"""Runs the tutorial's notebook from top to bottom and stores what it shows in it.

    python docs/tutorial.py

It needs the groups of development (nbclient, ipykernel) and takes less than a minute.
"""

from __future__ import annotations

import sys
from pathlib import Path

import nbformat
from nbclient import NotebookClient
from nbformat import NotebookNode

NOTEBOOK = Path(__file__).with_suffix(".ipynb")
_LONGEST = 300
"""Seconds that a cell may take."""


def executed(path: Path = NOTEBOOK) -> NotebookNode:
    """The notebook with the outputs of a new run, and nothing in it of the machine and the time.

    Raises:
        CellExecutionError: a cell raises; its traceback is the message.
    """
    notebook = nbformat.read(path, as_version=4)
    run = NotebookClient(notebook, timeout=_LONGEST, kernel_name="python3", record_timing=False)
    run.execute(cwd=str(path.parent))
    for cell in notebook.cells:
        if cell.cell_type == "code":
            cell.metadata.clear()
            cell.outputs = [one for one in cell.outputs if one.get("name") != "stderr"]
    language = {"name": "python", "file_extension": ".py", "mimetype": "text/x-python"}
    kernel = {"name": "python3", "display_name": "Python 3", "language": "python"}
    notebook.metadata = NotebookNode(kernelspec=kernel, language_info=language)
    return notebook


if __name__ == "__main__":
    nbformat.write(executed(), NOTEBOOK)
    print(f"wrote {NOTEBOOK}", file=sys.stderr)
