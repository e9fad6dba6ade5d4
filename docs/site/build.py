"""Builds the documentation as a site: python docs/site/build.py [FOLDER], out/site if left out.

A broken link, a missing anchor or picture, a code block that is not what it says, a public name
without docs and a request to the network are errors; then nothing is put into FOLDER.
"""

from __future__ import annotations

import gc
import shutil
import sys
import tempfile
from pathlib import Path

from blocks import faults_of_blocks
from built import faults_of_site
from reference import undocumented
from sphinx.cmd.build import main as sphinx
from stage import ROOT, misnamed, stage


def build(target: Path) -> list[str]:
    """Build the site into a folder; returns what is wrong with it."""
    with tempfile.TemporaryDirectory() as workshop:
        sources, made = Path(workshop, "sources"), Path(workshop, "site")
        faults = [*misnamed(), *stage(sources)]
        faults += faults_of_blocks(sources)
        faults += [f"omnitrack_sim.{name} has no docstring" for name in undocumented()]
        options = ["-b", "html", "-q", "-W", "--keep-going", "-c", str(Path(__file__).parent)]
        doctrees = ["-d", str(Path(workshop, "doctrees"))]
        if sphinx([*options, *doctrees, str(sources), str(made)]):
            return [*faults, "Sphinx has found faults, which it tells above"]
        faults += faults_of_site(made)
        if not faults:
            shutil.rmtree(target, ignore_errors=True)
            shutil.copytree(made, target)
    return faults


if __name__ == "__main__":
    # A build makes objects that stay to its end: to look for garbage takes a fifth of it.
    gc.disable()
    target = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "out" / "site"
    faults = build(target)
    if faults:
        raise SystemExit("\n".join(faults))
    print(f"open {target / 'index.html'}")
