"""Caps: closed ends of pipes, for walls, maps, missions and meshes."""

import mujoco
import numpy as np
import pytest
import trimesh

import omnitrack_sim as ot
from omnitrack_sim.pipes import Straight
from omnitrack_sim.pipes.fittings.straight import Cap
from omnitrack_sim.walls.export import network_xml
from omnitrack_sim.walls.meshes import THICKNESS, fitting_mesh, network_mesh
from omnitrack_sim.walls.rays import RayWalls

NETWORK = """
[[fittings]]
kind = "straight"
name = "inlet"
length = 0.6
[[fittings]]
kind = "cap"
name = "dead"
length = 0.4
[[joints]]
ports = ["inlet.end", "dead.start"]
"""

NEAR = "[start]\ndistance = 0.45\n"
"""Where a robot begins that drives up to the wall, m."""


@pytest.fixture
def blind(tmp_path):
    """A pipe with a closed end: its network and a scenario's keys that name it."""
    (tmp_path / "blind.toml").write_text(NETWORK)
    scenario = tmp_path / "into.toml"
    scenario.write_text('network = "blind.toml"\n[mission]\nstart = "inlet.start"\n')
    return scenario


def load(scenario, text):
    """The scenario with a mission's further keys."""
    scenario.write_text(scenario.read_text() + text)
    return ot.load_scenario(scenario)


@pytest.mark.parametrize("collider", ["exact", "primitives"])
def test_a_robot_is_sent_to_a_cap_and_stands_before_it(blind, collider):
    scenario = load(blind, f'goals = ["dead.end"]\n[physics]\ncollider = "{collider}"\n{NEAR}')
    result = ot.run(scenario)
    assert result.outcome == "reached_goal"
    nose = result.trajectory["position"][-1, 2] + scenario.robot.length / 2
    assert 1.0 - 0.012 < nose < 1.0 + 1e-4  # m; the wall is 1 m from the inlet


def test_a_cap_stops_a_robot_that_drives_on():
    """The goal is half a metre behind the wall: the motors stall before it."""
    pipes = [{"kind": "straight", "length": 0.6}, {"kind": "cap", "length": 0.4}]
    scenario = ot.override(ot.load_scenario("straight"), {"pipes": pipes})
    start = {"start.axis": [0, 0, 1], "start.distance": 0.4}
    scenario = ot.override(scenario, {"run.goal_distance": 0.99, **start})
    result = ot.run(scenario)
    nose = result.trajectory["position"][:, 2] + scenario.robot.length / 2
    assert result.outcome == "stalled"
    assert 1.0 - 2e-3 < nose.max() < 1.0 + 3e-3
    assert result.trajectory["normal_force"].max() < 20 * scenario.robot.preload


def test_an_explored_cap_is_a_closed_straight(blind):
    scenario = load(blind, 'map = "unknown"\ntask = "explore"\n[control]\ncruise_speed = 0.15\n')
    result = ot.run(scenario)
    assert result.outcome == "reached_goal"
    assert result.map_difference().same


def test_meshes_are_closed_at_caps():
    mesh = trimesh.Trimesh(*fitting_mesh(ot.Cap(0.3)), process=False)
    assert mesh.is_watertight
    assert mesh.euler_number == 2
    assert mesh.bounds[1, 2] == pytest.approx(0.3 + THICKNESS)
    network = ot.Network(
        fittings=[
            {"kind": "cap", "name": "low", "length": 0.3},
            {"kind": "cap", "name": "high", "length": 0.3},
        ],
        joints=[{"ports": ("low.start", "high.start")}],
    )
    # A hollow without an opening: an outer and an inner sphere, topologically.
    assert trimesh.Trimesh(*network_mesh(network.pipes), process=False).euler_number == 4


def test_an_exported_cap_stops_a_ball():
    """The wall of the MJCF lies at the port plane, and a ball that falls on it stays above."""
    pot = {"kind": "cap", "name": "pot", "length": 0.3}
    network = ot.Network(fittings=[pot], place={"axis": (0.0, 0.0, -1.0)})
    spec = mujoco.MjSpec.from_string(network_xml(network.pipes, "pot"))
    body = spec.worldbody.add_body(pos=[0, 0, -0.2])
    body.add_freejoint()
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.02, 0, 0], contype=1, conaffinity=2)
    model = spec.compile()
    data = mujoco.MjData(model)
    for _ in range(1000):
        mujoco.mj_step(model, data)
    assert data.qpos[2] == pytest.approx(-0.3 + 0.02, abs=1e-3)


def test_a_body_in_exact_pipes_lands_on_a_cap():
    """A box falls into a pot of any robot's pipes and rests on its end, which it sees below."""
    pot = {"kind": "cap", "name": "pot", "length": 0.3}
    spec = mujoco.MjSpec()
    body = spec.worldbody.add_body(pos=[0, 0, -0.1])
    body.add_freejoint()
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.02, 0.02, 0.02])
    pipes = ot.add_pipes(spec, ot.Network(fittings=[pot], place={"axis": (0.0, 0.0, -1.0)}))
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 1000)
    assert data.qpos[2] == pytest.approx(-0.28, abs=1e-3)
    assert pipes.clearance(data.qpos[:3]) == pytest.approx(0.02, abs=1e-3)
    assert pipes.rays(data.qpos[:3], [0, 0, -1]) == pytest.approx(0.02, abs=1e-3)


def test_nothing_is_joined_to_a_closed_port():
    fittings = [
        {"kind": "cap", "name": "low", "length": 0.3},
        {"kind": "straight", "name": "high", "length": 0.3},
    ]
    joints = [{"ports": ("low.end", "high.start")}]
    with pytest.raises(ot.NetworkError, match=r"'end' of 'low', which is closed"):
        _ = ot.Network(fittings=fittings, joints=joints).pipes
    steps = [
        ot.Step("low", ot.Cap(0.3), "start", "end"),
        ot.Step("high", ot.Straight(0.3), "start", "end"),
    ]
    with pytest.raises(ot.GeometryError, match="which is closed"):
        ot.route(steps)


def test_rays_end_at_a_cap():
    pipes = ot.Network(fittings=[{"kind": "cap", "name": "pot", "length": 0.3}]).pipes
    walls = RayWalls([pipes.parts], [pipes.closed_ends])
    place, along = np.array([[0.01, 0.0, 0.1]]), np.array([[0.0, 0.0, 1.0]])
    hit = walls.trace(np.zeros(1, int), place, np.eye(3)[None], along, 2.0)
    assert hit[0, 0, 0] == pytest.approx(0.2, abs=1e-5)


@pytest.mark.parametrize("fitting", [Cap(0.4), Straight(0.4), ot.Tee(), ot.Elbow(0.24)], ids=str)
def test_only_bores_behind_closed_ports_go_on(fitting):
    """Where a body sinks into an end the wall around it is that of the bore before it."""
    longer = fitting.extended(0.1)
    assert (longer == fitting) is not bool(fitting.closed_ports)
    rng = np.random.default_rng(1)
    low, high = fitting.bounds
    points = rng.uniform(low, high, (200, 3))
    for own, other in zip(
        fitting.signed_distance(points), longer.signed_distance(points), strict=True
    ):
        np.testing.assert_allclose(own, other, atol=1e-12)
    for name in fitting.closed_ports:
        moved = longer.ports[name].position - fitting.ports[name].position
        assert moved == pytest.approx(0.1 * fitting.ports[name].rotation[:, 2])
