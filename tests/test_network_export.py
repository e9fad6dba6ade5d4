"""Exports of networks, and the command that writes them."""

from __future__ import annotations

import csv
import json

import mujoco
import numpy as np
import pytest
import trimesh
from commands import omnitrack
from network_samples import narrowed

from omnitrack_sim.pipes import Assembly
from omnitrack_sim.pipes.network import load_network, validate
from omnitrack_sim.pipes.random import random_network
from omnitrack_sim.show.projection import bore_faces
from omnitrack_sim.walls.export import COLUMNS, export_network
from omnitrack_sim.walls.meshes import network_mesh


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """The tower, exported: a network with a loop."""
    network = load_network("tower")
    files = {
        path.suffix: path
        for path in export_network(network.name, network.pipes, tmp_path_factory.mktemp("tower"))
    }
    return network, files


def test_exported_walls_stand_where_the_pipes_are(exported):
    """Rays from the axis of every straight and elbow hit the walls of the MJCF at the exact
    surface."""
    network, files = exported
    model = mujoco.MjModel.from_xml_path(str(files[".xml"]))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    hit = np.zeros(1, np.int32)
    for part in network.pipes.parts:
        line = part.axis(*part.fitting.port_names[:2])
        s = np.array([0.3, 0.5]) * line.length
        for point, frame in zip(line.at(s)[0], line.frame(s), strict=True):
            for angle in (0.3, 1.9, 4.0):
                ray = frame @ [np.cos(angle), np.sin(angle), 0]
                away = mujoco.mj_ray(model, data, point, ray, None, True, -1, hit)
                assert away > 0
                assert abs(network.pipes.signed_distance(point + away * ray)[0]) < 1e-3


@pytest.mark.parametrize(
    ("name", "loops"), [("tower", 1), ("house_sewer", 0), ("random", 0), ("reducers", 0)]
)
def test_the_solid_is_one_wall(name, loops):
    """The solid is watertight and in one piece; n open ends and l loops make its genus n - 1 + 2
    l."""
    made = {
        "random": lambda: random_network(3),
        "reducers": lambda: random_network(0, 12, diameters=(0.16, 0.12)),
    }
    network = made[name]() if name in made else load_network(name)
    mesh = trimesh.Trimesh(*network_mesh(network.pipes), process=False)
    assert mesh.is_watertight
    assert mesh.body_count == 1
    assert (2 - mesh.euler_number) // 2 == len(network.open_ends) - 1 + 2 * loops


def test_exported_solid_has_the_walls_volume(exported):
    """The STL holds that solid: it begins at the foot's port and has the volume of the walls within
    1 percent."""
    network, files = exported
    mesh = trimesh.load(files[".stl"])
    assert mesh.bounds[0][2] == pytest.approx(
        network.pipes.parts[12].port("end").position[2] - 0.084, abs=1e-4
    )
    assert mesh.volume == pytest.approx(network_mesh(network.pipes).volume, rel=0.01)


def test_exported_centrelines_lie_in_the_bore(exported):
    """The table has every fitting from port to port, in the bore, with unit tangents."""
    network, files = exported
    with open(files[".csv"], encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert tuple(rows[0]) == COLUMNS
    assert {row["name"] for row in rows} == {part.name for part in network.fittings}
    points = np.array([[float(row[f"{axis}_m"]) for axis in "xyz"] for row in rows])
    tangents = np.array([[float(row[f"tangent_{axis}"]) for axis in "xyz"] for row in rows])
    assert network.pipes.signed_distance(points)[0].min() > 0.04
    assert np.allclose(np.linalg.norm(tangents, axis=1), 1)
    curved = {row["name"] for row in rows if float(row["curvature_per_m"]) > 0}
    assert curved == {part.name for part in network.fittings if part.kind != "straight"}


def test_exports_of_a_reducer(tmp_path):
    """MJCF walls and centrelines of a network with a reducer lie where it does; the figure draws a
    cone."""
    network = validate(narrowed())
    files = {path.suffix: path for path in export_network(network.name, network.pipes, tmp_path)}
    model = mujoco.MjModel.from_xml_path(str(files[".xml"]))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    part = network.pipes.parts[4]
    hit = np.zeros(1, np.int32)
    for z in (0.02, 0.075, 0.13):
        for angle in np.linspace(0, 2 * np.pi, 7):
            ray = part.pose.rotation @ [np.cos(angle), np.sin(angle), 0]
            away = mujoco.mj_ray(
                model, data, part.pose.apply(np.array([0, 0, z])), ray, None, True, -1, hit
            )
            assert away == pytest.approx(0.08 - z * 0.02 / 0.15, abs=1.1e-4)
    with open(files[".csv"], encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if row["name"] == "r"]
    assert float(rows[-1]["s_m"]) == pytest.approx(0.15)
    assert trimesh.load(files[".stl"]).volume == pytest.approx(
        network_mesh(network.pipes).volume, rel=0.01
    )
    corners = part.pose.inverse().apply(bore_faces(Assembly((part,))))
    assert np.allclose(
        np.hypot(corners[..., 0], corners[..., 1]),
        np.interp(corners[..., 2], [0, 0.15], [0.08, 0.06]),
    )


def test_command_lists_routes_and_writes(tmp_path):
    """The command tells parts and route for machines and writes figure and export."""
    options = ["--from", "inlet", "--to", "low", "--plot", "a.svg", "--export", "x", "--json"]
    done = omnitrack("network", "fig14", *options, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    summary = json.loads(done.stdout)
    assert summary["route"]["fittings"][1]["manoeuvre"] == "run to branch"
    assert [end["name"] for end in summary["open_ends"]] == ["inlet", "top", "far", "side", "low"]
    assert (tmp_path / "a.svg").read_bytes().startswith(b"<?xml")
    assert {p.suffix for p in (tmp_path / "x").iterdir()} == {".xml", ".stl", ".csv"}


def test_command_tells_both_bores_of_a_reducer(tmp_path):
    """The table of parts has the sizes of a reducer."""
    (tmp_path / "n.toml").write_text(validate(narrowed()).to_toml())
    done = omnitrack("network", "n.toml", "--plot", "n.png", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "D 160 to 120 mm, L 150 mm" in done.stdout


def test_command_writes_random_networks(tmp_path):
    """--random with --out writes a file that loads back as the same network."""
    done = omnitrack("network", "--random", "4", "--fittings", "9", "--out", "r.toml", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "saved r.toml" in done.stdout
    assert load_network(tmp_path / "r.toml") == random_network(4, 9)


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["nowhere"], "fig14"),
        ([], "--random"),
        (["fig14", "--random", "1"], "--random"),
        (["fig14", "--from", "inlet"], "give both"),
        (["fig14", "--from", "inlet", "--to", "tee_1.branch"], "--to"),
        (["fig14", "--fittings", "3"], "--random"),
        (["fig14", "--plot", "a.gif"], "png, svg, pdf"),
    ],
)
def test_command_refuses(arguments, told):
    """Bad input ends with status 2 and says what to mend."""
    done = omnitrack("network", *arguments)
    assert done.returncode == 2
    assert told in done.stderr
