"""Measured walls: scans of pipes, read, smoothed and driven through."""

from __future__ import annotations

import json
import warnings
from pathlib import Path

import contact_lots
import numpy as np
import pytest
import thrown_bodies
from in_pipes import check_that_thrown_bodies_stay
from scipy.spatial import cKDTree

import omnitrack_sim as ot
from omnitrack_sim.base.rotations import Pose, unit
from omnitrack_sim.pipes import Part
from omnitrack_sim.pipes.heights import total_height
from omnitrack_sim.scenario import validate
from omnitrack_sim.walls.meshes import fitting_mesh
from omnitrack_sim.walls.rays import RayWalls

LENGTH = 0.5
WALL = ot.Straight(
    LENGTH,
    relief=[
        {"kind": "ovality", "ratio": 0.05, "direction_deg": 20},
        {"kind": "dent", "at": 0.2, "depth": 0.008, "length": 0.16, "width": 0.12},
        {"kind": "dent", "at": 0.3, "depth": 0.006, "length": 0.1, "width": 0.08, "angle_deg": 200},
    ],
)
"""What is scanned."""
ENDS = 0.1
"""Length at both ends, m, over which a measured wall is that of the bore, or passes into it."""


def radii_of(pipe: ot.Straight, length: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Radii, m, of a wall at lengths, m, and angles, rad."""
    return pipe.radius - total_height(pipe.patches, np.stack([length, angle], axis=-1))


def scan(noise: float, missing: float, spacing: float = 0.004, rays: int = 720) -> list[np.ndarray]:
    """Lengths, angles and radii of a scan of ``WALL``; a part of the rays has found nothing."""
    rng = np.random.default_rng(1)
    rings, turns = np.arange(0, LENGTH + 1e-9, spacing), 2 * np.pi * np.arange(rays) / rays
    length, angle = np.meshgrid(rings, turns, indexing="ij")
    radius = radii_of(WALL, length, angle) + rng.normal(0, noise, length.shape)
    radius[rng.random(radius.shape) < missing] = np.nan
    return [length, angle, radius]


def write(path: Path, length: np.ndarray, angle: np.ndarray, radius: np.ndarray) -> Path:
    """Write a scan in mm and degrees; a ray without a radius has an empty one."""
    rows = zip(1e3 * length.ravel(), np.degrees(angle.ravel()), 1e3 * radius.ravel(), strict=True)
    lines = [f"{s:.3f},{a:.3f}," + ("" if np.isnan(r) else f"{r:.4f}") for s, a, r in rows]
    path.write_text("\n".join(["length_mm,angle_deg,radius_mm", *lines]))
    return path


def errors(profile: ot.Profile) -> np.ndarray:
    """Differences, m, of a measured wall from ``WALL`` away from the ends."""
    s, angle = np.meshgrid(np.linspace(ENDS, LENGTH - ENDS, 150), np.radians(range(360)))
    return radii_of(ot.Straight(LENGTH, profile=profile), s, angle) - radii_of(WALL, s, angle)


@pytest.fixture(scope="module")
def exact() -> ot.Profile:
    """A scan without noise."""
    return ot.Profile.from_rays(*scan(0.0, 0.0, 0.005, 360))


def test_a_noisy_scan_is_read_back(tmp_path):
    """With noise of 0.5 mm and 5 % of the rays missing the wall is within 0.3 mm, and the file's
    reader says how many are."""
    path = write(tmp_path / "scan.csv", *scan(5e-4, 0.05))
    with pytest.warns(UserWarning, match=r"scan\.csv has no ray in [45]\.\d% of its cells"):
        profile = ot.load_profile(path)
    assert np.abs(errors(profile)).max() < 3e-4
    assert errors(profile).std() < 6e-5


def test_a_scan_without_noise_keeps_what_it_has(exact):
    """Nothing is smoothed away where there is no noise: to 0.02 mm."""
    assert np.abs(errors(exact)).max() < 2e-5


def test_a_gap_is_filled_from_around_it():
    """A gap of 20 mm by 60 degrees in an oval is as the oval goes on, to 0.2 mm; it is told how
    long it is."""
    length, angle, radius = scan(0.0, 0.0, 0.005, 360)
    hole = (abs(length - 0.4) < 0.0101) & (abs(angle - 1.5) < np.radians(30))
    radius[hole] = np.nan
    with pytest.warns(UserWarning, match="25 mm at most"):
        profile = ot.Profile.from_rays(length, angle, radius)
    assert np.abs(errors(profile)).max() < 2e-4


def test_a_helix_is_a_scan():
    """Rays by lot need no rings: to 0.3 mm."""
    rng = np.random.default_rng(2)
    length, angle = rng.uniform(0, LENGTH, 40000), rng.uniform(0, 2 * np.pi, 40000)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        profile = ot.Profile.from_rays(length, angle, radii_of(WALL, length, angle))
    assert np.abs(errors(profile)).max() < 3e-4


@pytest.mark.parametrize(
    ("row", "told"),
    [
        ("12.0,40.0", "row 9: has 2 values; the head names 3"),
        ("12.0,4O.0,80.0", "row 9: angle_deg is '4O.0', no number"),
        ("12.0,40.0,-80.0", "row 9: radius_mm is -80; must be over 0"),
        ("-12.0,40.0,80.0", "row 9: length_mm is -12; must be from"),
        ("inf,40.0,80.0", "row 9: length_mm is inf; must be"),
        ('12.0,40.0,"80', "row"),
    ],
)
def test_a_damaged_scan_is_told_by_its_row(tmp_path, row, told):
    """The error names file and row."""
    path = write(tmp_path / "scan.csv", *scan(0.0, 0.0, 0.02, 36))
    lines = path.read_text().splitlines()
    lines[8] = row
    path.write_text("\n".join(lines))
    with pytest.raises(ot.InputError, match=r"scan\.csv") as caught:
        ot.load_profile(path)
    assert told in str(caught.value)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "row 1: has nothing; its head must be length_m"),
        ("s,angle_deg,radius_mm\n1,2,3", "row 1: has 's, angle_deg, radius_mm'; its head must be"),
        ("length_m,length_mm,angle_deg,radius_mm\n", "row 1"),
        ("length_m,angle_deg,radius_mm\n0,0,80\n", "needs 32 rays"),
    ],
)
def test_a_scan_that_is_none_is_told(tmp_path, text, told):
    """Heads without units and files with too few rays are faults."""
    path = tmp_path / "scan.csv"
    path.write_text(text)
    with pytest.raises(ot.InputError) as caught:
        ot.load_profile(path)
    assert told in str(caught.value)


def test_a_scan_must_fit_its_pipe(exact):
    """Another unit, another pipe or a shorter one is refused, and a section that is no circle."""
    assert ot.Straight(0.6, profile=exact).profile is exact
    for wrong, told in (
        ({"length": 0.4}, "reaches to 0.5 m"),
        ({"inner_diameter": 0.3}, "mean radius of 0.0798"),
        ({"section": "egg"}, "circular bore"),
    ):
        with pytest.raises(ot.GeometryError, match=told):
            ot.Straight(**{"length": LENGTH, "profile": exact} | wrong)


def test_a_scenario_names_a_scan_beside_it_and_keeps_it(tmp_path, monkeypatch):
    """The file is looked for beside the scenario's; what a run saves has the wall itself, and
    drives through the same one."""
    write(tmp_path / "scan.csv", *scan(0.0, 0.0, 0.01, 90))
    file = tmp_path / "old.toml"
    pipes = f'pipes = [{{kind = "straight", length = {LENGTH}, profile = "scan.csv"}}]\n'
    file.write_text(pipes + "[run]\ntime_limit = 0.1\n")
    monkeypatch.chdir(tmp_path.parent)
    scenario = ot.load_scenario(file)
    result = ot.run(scenario)
    (tmp_path / "scan.csv").unlink()
    again = ot.load_result(result.save(tmp_path / "run")).scenario
    assert again.pipes == scenario.pipes
    np.testing.assert_array_equal(
        ot.run(again).trajectory["position"], result.trajectory["position"]
    )
    with pytest.raises(ot.ScenarioError, match=r"pipes\.0\.profile: .*scan.csv"):
        ot.load_scenario(file)


def test_a_network_names_a_scan_beside_it(tmp_path):
    """Its plain data have the wall itself."""
    write(tmp_path / "scan.csv", *scan(0.0, 0.0, 0.01, 90))
    file = tmp_path / "town.toml"
    fitting = f'name = "a"\nkind = "straight"\nlength = {LENGTH}\nprofile = "scan.csv"\n'
    file.write_text("[[fittings]]\n" + fitting)
    network = ot.load_network(file)
    copy = tmp_path / "copy.toml"
    copy.write_text(network.to_toml())
    assert ot.load_network(copy).fittings == network.fittings
    file.write_text(file.read_text().replace("scan.csv", "no.csv"))
    with pytest.raises(ot.NetworkError, match=r"fittings\.0\.profile: .*no\.csv"):
        ot.load_network(file)


def test_damaged_radii_of_a_saved_wall_are_faults(exact):
    """Radii that are no text of a grid, or of another one, are refused at their key."""
    table = json.loads(exact.model_dump_json())
    for change in ({"radii": "!"}, {"radii": table["radii"][:-8]}, {"columns": 17}):
        pipes = [{"kind": "straight", "length": LENGTH, "profile": table | change}]
        with pytest.raises(ot.ScenarioError, match=r"pipes\.0\.profile"):
            validate({"name": "x", "pipes": pipes})


def test_the_distance_is_that_of_the_nearest_place(exact):
    """No place of the measured wall is nearer than the distance, and one is as near, to 5 um."""
    pipe, rng = ot.Straight(LENGTH, profile=exact), np.random.default_rng(1)
    s, angle = np.meshgrid(np.arange(0.1, 0.3, 5e-4), np.radians(np.arange(0, 360, 0.35)))
    r = radii_of(pipe, s, angle)
    places = np.stack([r * np.cos(angle), r * np.sin(angle), s], axis=-1).reshape(-1, 3)
    points = rng.uniform(-0.075, 0.075, (2000, 3))
    points[:, 2] = rng.uniform(0.18, 0.22, len(points))
    distance = pipe.signed_distance(points)[0]
    points, distance = points[distance > 1e-3], distance[distance > 1e-3]
    away = cKDTree(places).query(points)[0]
    assert (distance - away).max() < 1e-6
    # The nearest of the places lies up to 0.35 mm aside.
    assert (away - distance - 6e-8 / distance).max() < 5e-6


@pytest.mark.parametrize("shape", contact_lots.SHAPES)
def test_contacts_tell_the_least_distance_of_any_body(exact, shape):
    """The deepest contact of each type of geom is as deep as branch and bound finds, to 0.02 mm."""
    lot = contact_lots.Lot(ot.Straight(LENGTH, profile=exact), shape)
    lot._bore *= 0.7
    assert lot.errors(12, np.random.default_rng([7])).max() < 2e-5


def test_meshes_and_rays_show_it(exact):
    """Corners of the mesh are on the wall, and rays end there."""
    pipe = ot.Straight(LENGTH, profile=exact)
    distance = pipe.signed_distance(fitting_mesh(pipe).vertices)[0]
    inner = distance > -0.002
    assert np.abs(distance[inner]).max() < 5e-5
    assert inner.mean() > 0.4
    rays = unit(np.random.default_rng(2).normal((0.0, 0.0, 0.3), 1.0, (200, 3)))
    parts, position = (Part("pipe", pipe, Pose()),), np.array([[0.01, -0.02, 0.2]])
    hits = RayWalls([parts]).trace(np.zeros(1, int), position, np.eye(3)[None], rays, 9)[0]
    met = np.isfinite(hits[:, 0])
    assert met.mean() > 0.6
    ends = position + hits[met, :1] * rays[met]
    assert np.abs(pipe.signed_distance(ends)[0]).max() < 1e-8


@pytest.mark.long
def test_bodies_thrown_into_a_measured_pipe_stay_there(exact):
    """Bodies of seven shapes at 1 to 12 m/s are in the bore half a second later."""
    table = {"kind": "straight", "length": LENGTH, "profile": exact}
    check_that_thrown_bodies_stay(thrown_bodies.fitting_alone(table))
