"""Networks from files of other programs, by the ending of the file's name."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from omnitrack_sim.base.errors import Fault, NetworkError
from omnitrack_sim.base.reading import exists, faults_of, read_bytes
from omnitrack_sim.base.text import installing
from omnitrack_sim.pipes.condition import Condition, in_condition, load_condition
from omnitrack_sim.pipes.importing.assumptions import (
    Import,
    ImportNote,
    ImportSettings,
    check_schedule,
)
from omnitrack_sim.pipes.importing.building import build
from omnitrack_sim.pipes.importing.epanet import read_epanet
from omnitrack_sim.pipes.importing.isometric import build_plant
from omnitrack_sim.pipes.importing.pcf import read_pcf

MAX_BYTES = 20_000_000
"""Of an isometric: a plant of 100,000 components; of a town: one of 100,000 pipes."""


def import_network(
    file: str | Path, *, condition: str | Path | None = None, seed: int = 0, **settings: Any
) -> Import:
    """Return the network of a file of EPANET (``.inp``) or of an isometric (``.pcf``).

    EPANET's need the extra ``town``.

    Args:
        file: to read, or the name of one of wntr's examples, such as ``ky10``.
        condition: of the pipes: ``good``, ``fair``, ``poor`` or a file, by whose rates relief and
            couplings are drawn into the straights; without one all are ideal.
        seed: of these draws.
        settings: keys of ``ImportSettings``, such as ``bend_radius=1.0``.

    Raises:
        NetworkError: the file cannot be read, or nothing of it can be built; of an isometric every
            fault has its line; there is no such condition.

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
    if not exists(path):
        path = _example(str(file))
    name = re.sub(r"[./\\\x00-\x1f\x7f-\x9f]", "_", path.stem) or "network"
    if path.suffix.lower() not in (".inp", ".pcf"):
        raise NetworkError(Fault(path.name, "is neither EPANET's .inp nor a .pcf"))
    try:
        content = read_bytes(path, MAX_BYTES)
    except OSError as error:
        raise NetworkError(Fault(path.name, f"cannot be read: {error.strerror}")) from error
    except ValueError as error:
        raise NetworkError(Fault(path.name, str(error))) from error
    wear = None if condition is None else load_condition(condition)
    if path.suffix.lower() == ".inp":
        imported = build(name, read_epanet(path, asked), asked)
    else:
        # Isometrics are of ASCII; other letters stand in descriptions only.
        text = content.decode("utf-8", errors="replace")
        imported = build_plant(name, *read_pcf(text, asked.schedule))
    return imported if wear is None else _worn(imported, wear, seed)


def _worn(imported: Import, condition: Condition, seed: int) -> Import:
    """Return an import whose pipes are in a condition, which a note says."""
    network = in_condition(imported.network, condition, seed)
    kinds = Counter(part.kind for part in network.fittings if part.kind == "coupling")
    kinds.update(
        one.kind for part in network.pipes.parts for one in getattr(part.fitting, "relief", ())
    )
    drawn = ", ".join(f"{count} of {kind}" for kind, count in kinds.items())
    problem = f"drawn by seed {seed}: {drawn or 'nothing'}"
    note = ImportNote("assumed", f"condition {condition.name}", problem)
    return replace(imported, network=network, notes=(*imported.notes, note))


def _example(name: str) -> Path:
    """Return the file of a town that comes with wntr.

    Raises:
        NetworkError: there is none of that name, or no wntr.
    """
    towns = wntr_towns()
    if name in towns:
        return towns[name]
    problem = "no such file, nor a town of wntr of that name"
    if not towns:
        problem += f"; wntr, which has some, is not installed: {installing('town')}"
    raise NetworkError(Fault(name, problem, tuple(towns), given=name))


def wntr_towns() -> dict[str, Path]:
    """Return the files of the towns that come with wntr, by name; wntr is not imported."""
    wntr = find_spec("wntr")
    if wntr is None or wntr.origin is None:
        return {}
    folder = Path(wntr.origin).parent / "library" / "networks"
    return {path.stem: path for path in sorted(folder.glob("*.inp"))}
