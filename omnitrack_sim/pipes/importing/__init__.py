"""Networks from files of other programs, by the ending of the file's name."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from omnitrack_sim.base.errors import Fault, NetworkError
from omnitrack_sim.base.reading import faults_of, is_file
from omnitrack_sim.pipes.importing.assumptions import Import, ImportSettings, check_schedule
from omnitrack_sim.pipes.importing.building import build
from omnitrack_sim.pipes.importing.epanet import read_epanet
from omnitrack_sim.pipes.importing.isometric import build_plant
from omnitrack_sim.pipes.importing.pcf import read_pcf

MAX_BYTES = 20_000_000
"""Of an isometric: a plant of 100,000 components."""


def import_network(file: str | Path, **settings: Any) -> Import:
    """Return the network of a file of EPANET (``.inp``) or of an isometric (``.pcf``).

    EPANET's need the extra ``town``.

    Args:
        file: to read.
        settings: keys of ``ImportSettings``, such as ``bend_radius=1.0``.

    Raises:
        NetworkError: the file cannot be read, or nothing of it can be built; of an isometric every
            fault has its line.

    Example:
        >>> imported = ot.import_network("town.inp", scale=0.3048)  # doctest: +SKIP
        >>> print(imported.network, imported.length_ratio)  # doctest: +SKIP
    """
    path = Path(file)
    try:
        asked = ImportSettings(**settings)
    except ValidationError as error:
        keys = tuple(ImportSettings.model_fields)
        raise NetworkError(faults_of(error, lambda _: keys, lambda _: None)) from None
    check_schedule(asked.schedule)
    if not is_file(path):
        raise NetworkError(Fault(str(path), "no such file"))
    name = re.sub(r"[./\\\x00-\x1f\x7f-\x9f]", "_", path.stem) or "network"
    if path.suffix.lower() == ".inp":
        return build(name, read_epanet(path, asked), asked)
    if path.suffix.lower() != ".pcf":
        raise NetworkError(Fault(path.name, "is neither EPANET's .inp nor a .pcf"))
    if path.stat().st_size > MAX_BYTES:
        raise NetworkError(Fault(path.name, f"is too large: at most {MAX_BYTES} bytes are read"))
    try:
        # Isometrics are of ASCII; other letters stand in descriptions only.
        text = path.read_text(encoding="utf-8", errors="replace")
    except OSError as error:
        raise NetworkError(Fault(path.name, f"cannot be read: {error.strerror}")) from error
    return build_plant(name, *read_pcf(text, asked.schedule))
