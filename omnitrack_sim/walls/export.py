"""Networks for other programs: MJCF of walls, STL of walls, CSV and GeoJSON of centrelines."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from omnitrack_sim.base.text import csv_text
from omnitrack_sim.base.writing import check_folder, write_files
from omnitrack_sim.pipes import Assembly
from omnitrack_sim.walls.geoms import add_plates, add_walls, new_spec
from omnitrack_sim.walls.meshes import network_mesh, stl_bytes

SPACING = 0.01
"""Greatest distance of neighbouring points of the centreline table, m."""
COLUMNS = (
    "name",
    "from",
    "to",
    "s_m",
    *(f"{axis}_m" for axis in "xyz"),
    *(f"tangent_{axis}" for axis in "xyz"),
    "curvature_per_m",
)


def export_network(name: str, pipes: Assembly, folder: str | Path) -> list[Path]:
    """Write ``NAME.xml`` (MJCF), ``NAME.stl`` and ``NAME_centrelines.csv``; returns their paths.

    The folder is made when missing; files of these names are replaced, all or none.

    Args:
        name: of the files and of the model in them.
        pipes: placed in the world.
        folder: where the files go.

    Raises:
        OutputError: a file cannot be written; then none is.
    """
    makers = {
        f"{name}.xml": lambda: network_xml(pipes, name).encode(),
        f"{name}.stl": lambda: network_stl(pipes),
        f"{name}_centrelines.csv": lambda: centreline_table(pipes).encode(),
    }
    # Before any work: the mesh of a large network takes far longer than this check.
    check_folder(folder, files=makers)
    return write_files({Path(folder) / file: make() for file, make in makers.items()})


def centreline_table(pipes: Assembly) -> str:
    """CSV of the axis curves of every fitting, ``COLUMNS`` wide.

    A tee has one curve for each pair of its ports.

    ``s_m`` is the arc length from the port ``from``; points and unit tangents in the world frame.
    """
    table: list[Sequence[str]] = [COLUMNS]
    for part in pipes.parts:
        for enter, leave in combinations(part.fitting.port_names, 2):
            line = part.axis(enter, leave)
            s = np.linspace(0, line.length, max(2, math.ceil(line.length / SPACING) + 1))
            point, tangent, _, curvature = line.at(s)
            for row in np.column_stack([s, point, tangent, curvature]):
                # Adding 0.0 turns -0.0 into 0.0, which would otherwise be written as "-0".
                table.append([part.name, enter, leave, *(f"{value + 0.0:.9g}" for value in row)])
    return csv_text(table)


def network_geojson(pipes: Assembly) -> str:
    """GeoJSON of the axes of every fitting, m, world frame.

    Straight lines by their ends, arcs by points at most 5 degrees apart; with name, kind and bore,
    m, and the name of a section that is no circle.
    """
    features = []
    for part in pipes.parts:
        for points, axis in zip(part.polylines(), part.fitting.axes, strict=True):
            properties: dict[str, Any] = {
                "name": part.name,
                "kind": part.fitting.kind,
                "bore_m": [round(2 * radius, 9) for radius in axis[1:]],
            }
            section = part.fitting.edge(part.fitting.port_names[-1])
            if section is not None:
                properties |= {"section": section.name, "bore_m": [round(section.size, 9)] * 2}
            geometry = {"type": "LineString", "coordinates": (points.round(6) + 0.0).tolist()}
            features.append({"type": "Feature", "properties": properties, "geometry": geometry})
    return json.dumps({"type": "FeatureCollection", "features": features}) + "\n"


def network_xml(network: Assembly, name: str) -> str:
    """MJCF of a network's collision walls, world frame; six digits, nothing else in it."""
    spec = new_spec(name)
    add_walls(spec, network)
    add_plates(spec, network, network.closed_ends)
    # An MjSpec writes XML only once it has been compiled.
    spec.compile()
    return spec.to_xml()


def network_stl(network: Assembly) -> bytes:
    """Return the walls of a whole network as one solid, binary STL, m, world frame.

    Single precision folds slivers at the rims of tees, so the file, unlike ``network_mesh``, is not
    quite watertight.
    """
    return stl_bytes(network_mesh(network))
